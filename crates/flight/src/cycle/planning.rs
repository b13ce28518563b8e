//! From an estimate to the sticks: prediction, reference over the horizon, plan.
//!
//! Owns in which moment each stick is planned. Dead times differ between axes: the plan begins when the
//! fastest stick sent now would act, and the first inputs of the slower ones are already in transit.
//! The controller plans effective inputs; `Model::input_for` gives the sticks.

use std::iter::repeat_n;

use horizon_control::{Ask, Mpc, MpcReport, SoftConstraints, SolveError, predict};
use horizon_model::rows::{Pose, Sticks, pos_w, pose, stick};
use horizon_model::{InputFifo, Model, angle};
use nalgebra::{Matrix3, SMatrix, SVector};

use super::baseline::Baseline;
use super::committed::Committed;
use super::walls::{Clearance, PlanWalls, Walls};
use crate::{Mission, Reference, clip_target};

/// Ticks after which an unused plan has lost `1 - 1/e` of its authority, thesis section 4.3.9.
const PLAN_DECAY_TICKS: f64 = 10.0;

/// Ticks after which an unused plan is too old to be judged against walls.
const CLEAR_LAG_MAX: u32 = 5;

/// A vehicle that brakes is held where it is once it is slower, until it is so far away. m/s, m
const REST_MPS: f64 = 0.1;
const REST_M: f64 = 0.5;

/// What the plan follows from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known<'a, const NS: usize, const NP: usize> {
    /// Newest estimate. In the units of the model's rows
    pub(super) s_hat: &'a SVector<f64, NS>,
    /// Parameter estimate. In the units of its rows
    pub(super) p_hat: &'a SVector<f64, NP>,
    /// Covariance of `s_hat`; `None`: unknown. Units of its rows, squared
    pub(super) covariance: Option<SMatrix<f64, NS, NS>>,
    /// Sticks that were sent.
    pub(super) fifo: &'a InputFifo<{ stick::COUNT }>,
    /// What acts in place of all of them in an outage.
    pub(super) instead: Option<Sticks>,
    /// First period after the estimate, seen from the coming step.
    pub(super) from_ahead: isize,
}

impl<const NS: usize, const NP: usize> Known<'_, NS, NP> {
    /// The sticks that act in the step `ahead` of the coming one.
    fn applied(&self, ahead: isize) -> Sticks {
        self.instead.unwrap_or_else(|| self.fifo.applied(ahead))
    }
}

/// Controller with all that it is asked.
#[derive(Debug)]
pub(super) struct Planner<M, const NS: usize, const NP: usize, const NR: usize>
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP>,
{
    model: M,
    dt_s: f64,
    mpc: Mpc<M, NS, { stick::COUNT }, { pose::COUNT }, NP, NR>,
    baseline: Baseline<NP>,
    u_lb: Sticks,
    u_ub: Sticks,
    committed: Committed,
    u_given: Vec<Sticks>,
    references: Vec<Reference>,
    s_ref: Vec<SVector<f64, NS>>,
    /// Where the newest plan begins, and its parameter.
    s_0: SVector<f64, NS>,
    p: SVector<f64, NP>,
    /// Ticks since the plan in use was solved; `None` without a plan.
    lag: Option<u32>,
    /// What the plan keeps away from; `None`: nothing.
    walls: Option<Walls>,
    clearance: Option<Clearance>,
    is_clear: bool,
    /// Whether the plan brings the vehicle to rest, whatever the mission, and where it is held then.
    is_braking: bool,
    rest: Option<Pose>,
}

impl<M, const NS: usize, const NP: usize, const NR: usize> Planner<M, NS, NP, NR>
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP>,
{
    /// A planner without a plan. `u_lb` and `u_ub` are bounds of the sticks; those of `mpc` are of their
    /// effect, as is its model. A stage begins where the nominal
    /// [`given_steps`](super::committed::given_steps) end.
    pub(super) fn new(
        model: M,
        (mpc, baseline): (Mpc<M, NS, { stick::COUNT }, { pose::COUNT }, NP, NR>, Baseline<NP>),
        (u_lb, u_ub): (Sticks, Sticks),
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
            u_lb,
            u_ub,
            committed,
            u_given,
            references: vec![Reference::default(); stages],
            s_ref: vec![SVector::zeros(); stages],
            s_0: SVector::zeros(),
            p: SVector::zeros(),
            lag: None,
            walls: None,
            clearance: None,
            is_clear: true,
            is_braking: false,
            rest: None,
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
    pub(super) fn within(self, walls: Option<Walls>) -> Self {
        Self { walls, ..self }
    }

    /// From now on plans follow the mission, or bring the vehicle to rest as near as they can.
    pub(super) fn brake(&mut self, is_braking: bool) {
        self.is_braking = is_braking;
        self.rest = self.rest.filter(|_| is_braking);
    }

    /// Whether plans bring the vehicle to rest.
    pub(super) fn is_braking(&self) -> bool {
        self.is_braking
    }

    /// Whether plans hold a vehicle that has braked at one place.
    pub(super) fn is_at_rest(&self) -> bool {
        self.rest.is_some()
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
        known: &Known<'_, NS, NP>,
        mission: &Mission,
        is_late: &mut dyn FnMut() -> bool,
    ) -> Result<MpcReport, SolveError> {
        if self.committed.dead_time_steps != *known.fifo.dead_time_steps() {
            self.committed = Committed::new(known.fifo.dead_time_steps(), self.mpc.settings());
        }
        let first = known.fifo.known_steps();
        let first_ahead = first.cast_signed();
        let inputs = (known.from_ahead..first_ahead).map(|ahead| known.applied(ahead));
        let s_0 = predict(&self.model, known.s_hat, known.p_hat, inputs, self.dt_s);
        self.s_0 = s_0;
        self.p = known.p_hat + self.baseline.p_correction;
        let given = self.committed.given_steps_max();
        for (k, u) in self.u_given.iter_mut().take(given).enumerate() {
            *u = self.model.effect(&known.applied(first_ahead + k.cast_signed()), &self.p);
        }
        // The mission is where the estimate is: in the past, if this is used a tick later.
        let since_estimate = usize::try_from(-known.from_ahead).unwrap_or(0);
        if let Some(walls) = &mut self.walls {
            let committed = first + self.committed.steps_max;
            let covariance_w = covariance_after(&self.model, known, committed as f64 * self.dt_s);
            walls.begin_after(first as f64 * self.dt_s, covariance_w);
        }
        self.refer(mission, &s_0, since_estimate + first);
        match self.lag {
            Some(_) => self.mpc.shift(),
            None => self.mpc.reset(),
        }
        let ask = Ask {
            s_0: &s_0,
            p: &self.p,
            u_before: &self.model.effect(&known.applied(first_ahead - 1), &self.p),
            u_given: &self.u_given[..given],
            given_steps: self.committed.given_steps,
            s_ref: &self.s_ref,
        };
        let walls =
            self.walls.as_ref().map(|walls| PlanWalls { model: &self.model, p: &self.p, walls });
        let walls = walls.as_ref().map(|walls| walls as &dyn SoftConstraints<NS>);
        let solved = self.mpc.solve_with(&ask, walls, is_late);
        self.lag = match self.lag {
            _ if solved.as_ref().is_ok_and(MpcReport::has_new_plan) => Some(0),
            // A late or failed solve is not waited for: the shifted plan goes on.
            lag => lag.map(|lag| lag.saturating_add(1)),
        };
        (self.clearance, self.is_clear) = self.find_clearance();
        solved
    }

    /// Fills the references of the plan that begins at `s_0`, `first` steps after the estimate.
    fn refer(&mut self, mission: &Mission, s_0: &SVector<f64, NS>, first: usize) {
        let from = self.model.observe(s_0);
        let near = |at: &Pose| angle::nearest_turn(at, &from, &M::OBSERVATION);
        if self.is_braking {
            let rest = near(&self.rest(&from, s_0));
            self.s_ref.fill(self.model.moving(&rest, &Pose::zeros(), s_0));
            return;
        }
        if mission.is_pointwise() {
            let distance_max = self.baseline.max_target_distance;
            let target = clip_target(&near(mission.target()), &from, distance_max);
            self.s_ref.fill(self.model.moving(&target, &Pose::zeros(), s_0));
            return;
        }
        mission.fill(first, self.mpc.settings().stage_steps(), &mut self.references);
        // The heading is continuous over the horizon: one turn fits all.
        let turn = self
            .references
            .first()
            .map_or(0.0, |first| near(&first.pose)[pose::THETA] - first.pose[pose::THETA]);
        for (s_ref, reference) in self.s_ref.iter_mut().zip(&self.references) {
            let mut at = reference.pose;
            at[pose::THETA] += turn;
            *s_ref = self.model.moving(&at, &reference.rate, s_0);
        }
    }

    /// Where a vehicle that brakes and is at `from` comes to rest: held at one place, it does not creep on.
    fn rest(&mut self, from: &Pose, s_0: &SVector<f64, NS>) -> Pose {
        let next = self.model.observe(&self.model.step(s_0, &Sticks::zeros(), &self.p, self.dt_s));
        let is_slow = (pos_w(&next) - pos_w(from)).norm() < REST_MPS * self.dt_s;
        let is_near = |rest: &Pose| (pos_w(rest) - pos_w(from)).norm() < REST_M;
        self.rest = self.rest.filter(is_near).or_else(|| is_slow.then_some(*from));
        self.rest.unwrap_or(*from)
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

    /// What the plan keeps away from; `None`: nothing.
    pub(super) fn walls(&self) -> Option<&Walls> {
        self.walls.as_ref()
    }

    /// Whether the newest plan stays inside of the room and out of obstacles that do not move; true without a plan.
    /// `None`: plans know no walls, or the newest one is too old.
    pub(super) fn is_clear(&self) -> Option<bool> {
        self.walls.as_ref()?;
        match self.lag {
            None => Some(true),
            Some(lag) => (lag <= CLEAR_LAG_MAX).then_some(self.is_clear),
        }
    }

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

    /// Reference for [`Planner::s_pred`]; for the step after it if no stick is in transit longer than
    /// another.
    pub(super) fn reference(&self) -> Option<Pose> {
        let at = self.committed.given_stages.saturating_sub(1);
        self.s_ref.get(at).map(|s_ref| self.model.observe(s_ref))
    }

    /// Step 4: the sticks that the plan holds for now, weaker the older the plan, thesis section 4.3.9.
    pub(super) fn sticks(&self) -> Sticks {
        let (true, Some(lag)) = (self.has_usable_plan(), self.lag) else { return Sticks::zeros() };
        let plan = self.mpc.plan();
        let effect = Sticks::from_fn(|axis, _| {
            let fraction = self.committed.fraction[axis];
            let [at, after] = self.committed.open_stages[axis].map(|stage| plan[stage][axis]);
            (1.0 - fraction) * at + fraction * after
        });
        self.stick_for(&(effect * (-f64::from(lag) / PLAN_DECAY_TICKS).exp()))
    }

    /// The planned sticks of the whole horizon, by step.
    pub(super) fn planned_sticks(&self) -> impl Iterator<Item = Sticks> {
        let stages = self.mpc.plan().iter().zip(self.mpc.settings().stage_steps());
        stages.flat_map(|(effect, steps)| repeat_n(self.stick_for(effect), *steps as usize))
    }

    fn stick_for(&self, effect: &Sticks) -> Sticks {
        let stick = self.model.input_for(effect, &self.p);
        // `clamp` keeps NaN: the gate refuses it.
        Sticks::from_fn(|axis, _| stick[axis].clamp(self.u_lb[axis], self.u_ub[axis]))
    }

    /// Whether there is a plan that reaches to now.
    pub(super) fn has_usable_plan(&self) -> bool {
        let usable = self.horizon_steps().saturating_sub(self.committed.steps_max);
        self.lag.is_some_and(|lag| (lag as usize) < usable)
    }

    /// Advances by a period without a new plan: the present plan ages.
    pub(super) fn skip(&mut self) {
        if let Some(lag) = &mut self.lag {
            *lag = lag.saturating_add(1);
            self.mpc.shift();
        }
    }

    /// Follows the obstacle that moves by a period.
    pub(super) fn follow(&mut self, obstacle_w: Option<[f64; 3]>) {
        self.walls.iter_mut().for_each(|walls| walls.follow(obstacle_w, self.dt_s));
    }

    /// Forgets the plan.
    pub(super) fn drop_plan(&mut self) {
        self.lag = None;
    }
}

/// Covariance of the position `after_s` after the estimate, whatever the sticks are until then; zero if it is unknown.
/// m^2
fn covariance_after<M, const NS: usize, const NP: usize>(
    model: &M,
    known: &Known<'_, NS, NP>,
    after_s: f64,
) -> Matrix3<f64>
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP>,
{
    let Some(covariance) = known.covariance else { return Matrix3::zeros() };
    let step = model.step_by_state(known.s_hat, &Sticks::zeros(), known.p_hat, after_s);
    let pose_by_state = model.observe_by_state(known.s_hat) * step;
    let pos_by_state = pose_by_state.fixed_rows::<3>(pose::X);
    pos_by_state * covariance * pos_by_state.transpose()
}

#[cfg(test)]
mod tests;
