//! From an estimate to the sticks: prediction, reference over the horizon, plan.
//!
//! Owns for which time each stick is planned. Dead times differ between axes: the plan begins when a stick of the
//! fastest axis that is sent now acts, and the first inputs of the slower axes are committed: they are in transit
//! already. The controller plans effective inputs; `Model::input_for` gives the sticks.

mod brake;
mod plan_start;

use std::iter::repeat_n;

use horizon_control::{Mpc, MpcProblem, MpcReport, SoftConstraints, SqpError, predict};
use horizon_model::rows::{Pose, Sticks, pos_w, pose, stick};
use horizon_model::{InputFifo, angle};
use nalgebra::{SMatrix, SVector};

use super::Vehicle;
use super::baseline::Baseline;
use super::committed::Committed;
use super::walls::{Clearance, PlanWalls, Walls};
use crate::forgetting::decay;
use crate::{Mission, PlanClearance, Reference, clip_target};
use brake::Brake;
pub(super) use brake::BrakeOrder;
pub(super) use plan_start::PlanStart;

/// Age of a plan at which its sticks are reduced to `1/e`, thesis section 4.3.9. ticks
const PLAN_DECAY_TICKS: f64 = 10.0;

/// Largest age of a plan at which its clearance from walls still counts. ticks
const CLEAR_LAG_MAX: u32 = 5;

/// Bounds of the sticks of a plan.
#[derive(Debug, Clone, Copy)]
pub(super) struct StickBounds {
    /// Smallest stick of each axis. 1, in [-1, 1]
    pub(super) lower: Sticks,
    /// Largest stick of each axis. 1, in [-1, 1]
    pub(super) upper: Sticks,
}

/// Controller with its references, constraints and newest plan.
#[derive(Debug)]
pub(super) struct Planner<M: Vehicle<NS, NP>, const NS: usize, const NP: usize, const NR: usize> {
    model: M,
    dt_s: f64,
    mpc: Mpc<M, NS, { stick::COUNT }, { pose::COUNT }, NP, NR>,
    baseline: Baseline<NP>,
    bounds: StickBounds,
    committed: Committed,
    /// Committed effective inputs of the newest plan, by step; as long as the horizon.
    u_given: Vec<Sticks>,
    /// References of the newest plan by stage, of the mission and as states.
    references: Vec<Reference>,
    s_ref: Vec<SVector<f64, NS>>,
    /// State at the beginning of the newest plan.
    s_0: SVector<f64, NS>,
    /// Parameter of the newest plan.
    p: SVector<f64, NP>,
    /// Ticks since the plan in use was solved; `None` without a plan.
    lag: Option<u32>,
    /// Walls and obstacles that the plan keeps away from; `None`: it knows none.
    walls: Option<Walls>,
    /// Clearance of the newest plan.
    clearance: Option<Clearance>,
    /// Whether the newest solve gave a plan that stays inside of the room and out of obstacles that do not move.
    is_newest_clear: bool,
    /// Brings the vehicle to rest, whatever the mission.
    brake: Brake,
}

impl<M: Vehicle<NS, NP>, const NS: usize, const NP: usize, const NR: usize> Planner<M, NS, NP, NR> {
    /// A planner without a plan. `bounds` are those of the sticks; model and bounds of `mpc` are those of
    /// effective inputs. A stage of `mpc` begins where the nominal
    /// [`given_steps`](super::committed::given_steps) end.
    pub(super) fn new(
        model: M,
        (mpc, baseline): (Mpc<M, NS, { stick::COUNT }, { pose::COUNT }, NP, NR>, Baseline<NP>),
        bounds: StickBounds,
        fifo: &InputFifo<{ stick::COUNT }>,
        dt_s: f64,
    ) -> Self {
        let stages = mpc.plan().len();
        let committed = Committed::new(fifo.nominal_steps(), mpc.settings());
        let u_given = vec![Sticks::zeros(); mpc.settings().horizon_steps()];
        Self {
            model,
            dt_s,
            mpc,
            baseline,
            bounds,
            committed,
            u_given,
            references: vec![Reference::default(); stages],
            s_ref: vec![SVector::zeros(); stages],
            s_0: SVector::zeros(),
            p: SVector::zeros(),
            lag: None,
            walls: None,
            clearance: None,
            is_newest_clear: true,
            brake: Brake::default(),
        }
    }

    /// The covariance of the estimate, asked for only if the margin follows it.
    pub(super) fn covariance(
        &self,
        of_estimate: impl FnOnce() -> Option<SMatrix<f64, NS, NS>>,
    ) -> Option<SMatrix<f64, NS, NS>> {
        self.walls.as_ref().filter(|walls| walls.follows_covariance()).and_then(|_| of_estimate())
    }

    /// The planner with walls and obstacles.
    pub(super) fn with_walls(self, walls: Option<Walls>) -> Self {
        Self { walls, ..self }
    }

    /// Chooses whether plans bring the vehicle to rest, as near as they can, or follow the mission.
    pub(super) fn brake(&mut self, order: BrakeOrder) {
        self.brake.set(order);
    }

    /// Whether plans bring the vehicle to rest.
    pub(super) fn is_braking(&self) -> bool {
        self.brake.is_on()
    }

    /// Where a braking vehicle at `at` is held, or as far as it may brake. World frame. m, rad
    pub(super) fn held(&self, at: &Pose) -> Option<Pose> {
        self.brake.held(at)
    }

    /// Whether plans hold a vehicle that has braked at one position.
    pub(super) fn is_at_rest(&self) -> bool {
        self.brake.is_at_rest()
    }

    /// Length of the plan. steps
    pub(super) fn horizon_steps(&self) -> usize {
        self.mpc.settings().horizon_steps()
    }

    /// Ticks since the plan in use was solved; `None` without a plan.
    pub(super) fn lag(&self) -> Option<u32> {
        self.lag
    }

    /// Steps 7 and 8 of thesis section 4.3.11: predict over the dead time (4.26), ask the mission, solve.
    ///
    /// # Errors
    /// As [`Mpc::solve`].
    pub(super) fn plan(
        &mut self,
        start: &PlanStart<'_, NS, NP>,
        mission: &Mission,
        is_late: &mut dyn FnMut() -> bool,
    ) -> Result<MpcReport, SqpError> {
        if self.committed.dead_time_steps != *start.fifo.dead_time_steps() {
            self.committed = Committed::new(start.fifo.dead_time_steps(), self.mpc.settings());
        }
        self.predict_start(start);
        self.fill_given(start);
        self.begin_walls(start);
        self.fill_references(mission, start);
        match self.lag {
            Some(_) => self.mpc.shift(),
            None => self.mpc.reset(),
        }
        let solved = self.solve(start, is_late);
        self.lag = match self.lag {
            _ if solved.as_ref().is_ok_and(MpcReport::has_new_plan) => Some(0),
            // After a late or failed solve the shifted plan goes on.
            lag => lag.map(|lag| lag.saturating_add(1)),
        };
        (self.clearance, self.is_newest_clear) = self.find_clearance();
        solved
    }

    /// Predicts the state at the beginning of the plan, by the sticks that act until then.
    fn predict_start(&mut self, start: &PlanStart<'_, NS, NP>) {
        let inputs = (start.first_period..start.begin_ahead()).map(|ahead| start.applied(ahead));
        self.s_0 = predict(&self.model, start.s_hat, start.p_hat, inputs, self.dt_s);
        self.p = start.p_hat + self.baseline.p_correction;
    }

    /// Fills the committed inputs of the first steps of the plan.
    ///
    /// In an outage a brake goes on from the sticks that were sent: the cost of a change from those that act in their
    /// place would let each plan begin with the same small step, and only first steps are ever sent.
    fn fill_given(&mut self, start: &PlanStart<'_, NS, NP>) {
        let given = self.committed.given_steps_max();
        let begin_ahead = start.begin_ahead();
        for (k, u) in self.u_given.iter_mut().take(given).enumerate() {
            let ahead = begin_ahead + k.cast_signed();
            let mut sticks = start.applied(ahead);
            if self.brake.is_on() {
                let sent = start.fifo.applied(ahead);
                for (axis, from) in self.committed.last_given_steps.into_iter().enumerate() {
                    if k >= from {
                        sticks[axis] = sent[axis];
                    }
                }
            }
            *u = self.model.effect(&sticks, &self.p);
        }
    }

    /// Sets time and covariance of the beginning of the plan for walls and obstacles.
    fn begin_walls(&mut self, start: &PlanStart<'_, NS, NP>) {
        let Some(walls) = &mut self.walls else { return };
        let first = start.fifo.known_steps();
        let committed = first + self.committed.steps_max;
        let covariance_w = start.covariance_after(&self.model, committed as f64 * self.dt_s);
        walls.begin_after(first as f64 * self.dt_s, covariance_w);
    }

    /// The sticks before the first step of the plan, from which changes cost; see [`Planner::fill_given`].
    fn before(&self, start: &PlanStart<'_, NS, NP>) -> Sticks {
        let ahead = start.begin_ahead() - 1;
        if self.brake.is_on() { start.fifo.applied(ahead) } else { start.applied(ahead) }
    }

    /// Solves for a plan from the start, committed inputs, walls and references that are filled in.
    fn solve(
        &mut self,
        start: &PlanStart<'_, NS, NP>,
        is_late: &mut dyn FnMut() -> bool,
    ) -> Result<MpcReport, SqpError> {
        let problem = MpcProblem {
            s_0: &self.s_0,
            p: &self.p,
            u_before: &self.model.effect(&self.before(start), &self.p),
            u_given: &self.u_given[..self.committed.given_steps_max()],
            given_steps: self.committed.given_steps,
            s_ref: &self.s_ref,
        };
        let (model, p) = (&self.model, &self.p);
        let walls = self.walls.as_ref().map(|walls| PlanWalls { model, p, walls });
        let walls = walls.as_ref().map(|walls| walls as &dyn SoftConstraints<NS>);
        self.mpc.solve_with(&problem, walls, is_late)
    }

    /// Fills the references of the plan.
    fn fill_references(&mut self, mission: &Mission, start: &PlanStart<'_, NS, NP>) {
        let from = self.model.observe(&self.s_0);
        if self.brake.is_on() {
            let at_rest = self.brake_reference(&from, start);
            self.set_constant_reference(&angle::nearest_turn(&at_rest, &from, &M::OBSERVATION));
        } else if mission.is_pointwise() {
            let target = angle::nearest_turn(mission.target(), &from, &M::OBSERVATION);
            self.set_constant_reference(&clip_target(
                &target,
                &from,
                self.baseline.max_target_distance,
            ));
        } else {
            self.set_path_reference(mission, start, &from);
        }
    }

    /// The reference of the whole plan is `at`, at rest.
    fn set_constant_reference(&mut self, at: &Pose) {
        self.s_ref.fill(self.model.moving(at, &Pose::zeros(), &self.s_0));
    }

    /// The references are those of the path of `mission`, for a plan that begins at the pose `from`.
    fn set_path_reference(
        &mut self,
        mission: &Mission,
        start: &PlanStart<'_, NS, NP>,
        from: &Pose,
    ) {
        let first_ahead = start.periods_since_estimate() + start.fifo.known_steps();
        mission.fill(first_ahead, self.mpc.settings().stage_steps(), &mut self.references);
        // The heading is continuous over the horizon: one turn fits all.
        let turn_rad = self.references.first().map_or(0.0, |first| {
            angle::nearest_turn(&first.pose, from, &M::OBSERVATION)[pose::THETA]
                - first.pose[pose::THETA]
        });
        for (s_ref, reference) in self.s_ref.iter_mut().zip(&self.references) {
            let mut at = reference.pose;
            at[pose::THETA] += turn_rad;
            *s_ref = self.model.moving(&at, &reference.rate, &self.s_0);
        }
    }

    /// State when a stick of the slowest axis, sent now, begins to act, by the newest plan.
    pub(super) fn s_pred(&self) -> &SVector<f64, NS> {
        match self.committed.given_stages.checked_sub(1) {
            Some(last) => &self.mpc.planned_states()[last],
            None => &self.s_0,
        }
    }

    /// How near the newest plan comes to walls and obstacles; `None` far away.
    pub(super) fn clearance(&self) -> Option<Clearance> {
        self.clearance
    }

    /// Walls and obstacles that the plan keeps away from; `None`: it knows none.
    pub(super) fn walls(&self) -> Option<&Walls> {
        self.walls.as_ref()
    }

    /// Whether the newest plan stays inside of the room and out of obstacles that do not move.
    pub(super) fn plan_clearance(&self) -> PlanClearance {
        match self.lag {
            _ if self.walls.is_none() => PlanClearance::Unknown,
            None => PlanClearance::Clear,
            Some(lag) if lag > CLEAR_LAG_MAX => PlanClearance::Unknown,
            Some(_) if self.is_newest_clear => PlanClearance::Clear,
            Some(_) => PlanClearance::Blocked,
        }
    }

    /// Clearance of the newest plan, and whether the plan is clear, as of [`Walls::clearance`].
    fn find_clearance(&self) -> (Option<Clearance>, bool) {
        let Some(walls) = &self.walls else { return (None, true) };
        let mut ahead_s = 0.0;
        let stages = self.mpc.planned_states().iter().zip(self.mpc.settings().stage_steps());
        let poses = stages.map(|(s, steps)| {
            ahead_s += self.dt_s * f64::from(*steps);
            (self.model.observe(s), ahead_s)
        });
        walls.clearance(poses)
    }

    /// Reference for [`Planner::s_pred`]; for the step after it if all axes have the same dead time.
    pub(super) fn reference(&self) -> Option<Pose> {
        let at = self.committed.given_stages.saturating_sub(1);
        self.s_ref.get(at).map(|s_ref| self.model.observe(s_ref))
    }

    /// Step 4: the planned sticks for now, reduced with the age of the plan, thesis section 4.3.9; neutral without one.
    pub(super) fn sticks(&self) -> Sticks {
        let (true, Some(lag)) = (self.has_usable_plan(), self.lag) else { return Sticks::zeros() };
        let plan = self.mpc.plan();
        let effect = Sticks::from_fn(|axis, _| {
            let fraction = self.committed.fraction[axis];
            let [at, after] = self.committed.open_stages[axis].map(|stage| plan[stage][axis]);
            (1.0 - fraction) * at + fraction * after
        });
        self.stick_for(&(effect * decay(f64::from(lag), PLAN_DECAY_TICKS)))
    }

    /// The planned sticks of the whole horizon, by step.
    pub(super) fn planned_sticks(&self) -> impl Iterator<Item = Sticks> {
        let stages = self.mpc.plan().iter().zip(self.mpc.settings().stage_steps());
        stages.flat_map(|(effect, steps)| repeat_n(self.stick_for(effect), *steps as usize))
    }

    /// Sticks that have the effective input `effect`, within their bounds.
    fn stick_for(&self, effect: &Sticks) -> Sticks {
        let stick = self.model.input_for(effect, &self.p);
        let StickBounds { lower, upper } = &self.bounds;
        // `clamp` keeps NaN: the gate refuses it.
        Sticks::from_fn(|axis, _| stick[axis].clamp(lower[axis], upper[axis]))
    }

    /// Whether there is a plan whose horizon has not passed yet.
    pub(super) fn has_usable_plan(&self) -> bool {
        let usable = self.horizon_steps().saturating_sub(self.committed.steps_max);
        self.lag.is_some_and(|lag| (lag as usize) < usable)
    }

    /// Advances by a period without a new plan.
    pub(super) fn age_plan(&mut self) {
        if let Some(lag) = &mut self.lag {
            *lag = lag.saturating_add(1);
            self.mpc.shift();
        }
    }

    /// Follows the moving obstacle by a period, in which its position was measured at `obstacle_w` or not at all,
    /// beside the vehicle at `vehicle`, world frame. m
    pub(super) fn follow_obstacle(&mut self, obstacle_w: Option<[f64; 3]>, vehicle: Option<Pose>) {
        let vehicle_w = vehicle.as_ref().map(pos_w);
        self.walls
            .iter_mut()
            .for_each(|walls| walls.follow_obstacle(obstacle_w, vehicle_w, self.dt_s));
    }

    /// Forgets the plan.
    pub(super) fn drop_plan(&mut self) {
        self.lag = None;
    }
}

#[cfg(test)]
mod tests;
