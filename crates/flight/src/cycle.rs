//! One tick of the control loop.
//!
//! Owns the order of the thesis' section 4.3.11 and what is kept from tick to tick. A tick is a
//! pure function of its inbox: no clock, socket, file or environment. Flight, simulation and replay
//! call the same [`Cycle::tick`]; they differ in who fills the [`Inbox`] and who reads the
//! [`Outcome`].

mod baseline;
mod build;
mod catch_up;
mod committed;
mod dead_time;
mod hand_over;
mod immobility;
mod impact;
mod inbox;
mod link;
mod measurement_time;
mod mission_checks;
mod moving_obstacle;
mod outcome;
mod parameter_estimate;
mod planning;
mod planning_table;
mod pose_plausibility;
mod progress;
mod proposed_sticks;
mod record;
mod sense;
mod standing_start;
mod supervise;
mod table;
mod timing;
mod vehicle;
mod walls;
mod worst_case;

use std::fmt::Debug;

use horizon_control::{MpcReport, SqpStop, predict};
use horizon_estim::{Mhe, MheError, Observed};
use horizon_model::InputFifo;
use horizon_model::rows::{Pose, Sticks, pose, stick};
use nalgebra::SVector;

use crate::drone::DroneStatus;
use crate::gate::{Approved, Gate};
use crate::time::TimeNs;
use crate::{LinkDecision, Mission, Monitors, Pilot, PoseFilter, Supervisor};

pub use baseline::{HeldObservations, Pipeline};
pub use build::{build, build_with};
pub use dead_time::DeadTimeChange;
use hand_over::HandOver;
use immobility::Immobility;
use impact::Impact;
use link::Link;
use measurement_time::TickObservations;
pub use mission_checks::{beside_moving_obstacle, misfits, notes, take_off_clearance};
use planning::{PlanStart, Planner};
use pose_plausibility::Plausibility;
use progress::Progress;
use standing_start::StandingStart;
use worst_case::WorstCase;

pub use crate::Operator;
pub use inbox::{Inbox, SIGHTINGS_MAX, TickStage, Unwatched, Watch};
pub use outcome::{Outcome, Solve};
pub use parameter_estimate::ParameterEstimate;
pub use planning_table::PlanningTable;
pub use record::{FilteredRecord, LinkRecord, PhaseRecord, PoseRecord, RowsRecord, SticksRecord};
pub use record::{Sink, Topic};
pub use sense::{SIGHTING_AGE_MAX, is_flight_phase};
pub use table::{CycleTable, DT_S, FlightTable, StandingTable};
pub use timing::Timing;
pub use vehicle::{ModelKind, Vehicle, WithModel};
pub use walls::{Clearance, WallTable};

/// The period whose sticks this tick decides. The `ahead` of a period, as of [`InputFifo::applied`], counts from it.
const COMING: isize = 0;
/// The period that ended with this tick, before the push of the tick.
const JUST_ENDED: isize = -1;
/// The period that ended with this tick, after the push, which moves the coming period on by one.
const JUST_ENDED_AFTER_PUSH: isize = -2;

/// A cycle of any model: what flight, simulation and replay hold.
pub trait Tick: Send {
    /// One tick: fills `out` from `inbox` and the state of the ticks before. `watch` gets the sticks as soon as they
    /// are decided, and answers whether the solvers are late.
    ///
    /// Real time: no allocation of ours; the solvers poll `watch` once per iteration and before a fall-back.
    fn tick(&mut self, inbox: &Inbox, watch: &mut dyn Watch, out: &mut Outcome);

    /// An empty outcome with all its buffers, to be filled by [`Tick::tick`] again and again.
    fn new_outcome(&self) -> Outcome;

    /// Where the newest estimate leads if the sticks `u_planned` act for a period each, thesis equation
    /// 4.26; while the link is found to be down, what acts in their place. `None` before the first estimate.
    ///
    /// Real time: no allocation, one model step per period.
    fn forecast(&self, u_planned: &[Sticks]) -> Option<Pose>;

    /// The parameter by the estimator; `None` before the first estimate and with a fixed arrival.
    ///
    /// Allocates the answer: for the end of a flight, not for its ticks.
    fn parameter_estimate(&self) -> Option<ParameterEstimate>;
}

/// Filter, estimator, predictor, controller, supervisor and gate around one vehicle model.
#[derive(Debug)]
pub struct Cycle<M: Vehicle<NS, NP>, const NS: usize, const NP: usize, const NR: usize> {
    model: M,
    dt_s: f64,
    pipeline: Pipeline,
    held: HeldObservations,
    uses_measurement_time: bool,
    filter: PoseFilter,
    plausibility: Plausibility,
    /// Largest difference of a heading to the estimated one that is accepted. rad
    jump_rad: f64,
    mhe: Mhe<M, NS, { stick::COUNT }, { pose::COUNT }, NP>,
    /// `None`: commands are taken to act.
    link: Option<Link>,
    mission: Mission,
    planner: Planner<M, NS, NP, NR>,
    monitors: Monitors,
    progress: Progress,
    immobility: Immobility,
    impact: Impact,
    standing_start: StandingStart,
    worst_case: WorstCase<NS, NP>,
    supervisor: Supervisor,
    hand_over: HandOver,
    gate: Gate,
    fifo: InputFifo<{ stick::COUNT }>,
    /// Dry run: the vehicle is carried, nothing is sent, and neutral sticks enter the FIFO.
    is_dry_run: bool,
    memory: Memory,
}

/// What one tick leaves to the next beside the states of the parts.
#[derive(Debug, Default)]
struct Memory {
    /// When the newest accepted position with anything new was measured.
    position_at: Option<TimeNs>,
    /// When the newest accepted heading with anything new was measured.
    heading_at: Option<TimeNs>,
    /// Headings accepted so far.
    headings: u32,
    drone: Option<DroneStatus>,
    /// Pose accepted in this tick. m, rad
    o_seen: Option<Pose>,
    /// Accepted pose that the stream only repeated in this tick. m, rad
    o_repeated: Option<Pose>,
    has_estimator_failed: bool,
    has_controller_failed: bool,
    /// Whether the controller followed the mission in the tick before.
    is_on_mission: bool,
}

impl<M, const NS: usize, const NP: usize, const NR: usize> Tick for Cycle<M, NS, NP, NR>
where
    M: Vehicle<NS, NP>,
{
    /// Sense, estimate, supervise, plan, gate, send.
    ///
    /// With [`Pipeline::SameTick`] the sticks of this tick follow from the newest observation. With
    /// [`Pipeline::NextTick`] plan and estimate are made after the decision and used one tick later,
    /// as the published controller does with its asynchronous handlers.
    fn tick(&mut self, inbox: &Inbox, watch: &mut dyn Watch, out: &mut Outcome) {
        out.clear(inbox.step);
        self.catch_up(inbox, watch);
        let seen = self.sense(inbox, out);
        self.planner
            .follow_obstacle(inbox.obstacle_w, out.filtered.and_then(|filtered| filtered.o));

        self.estimate_in_same_tick(seen.as_ref(), watch, out);
        let pilot = self.supervise(inbox, out);
        let may_steer = pilot == Some(Pilot::Controller);
        self.note_mission(may_steer);
        if may_steer {
            self.progress.count_flown(self.dt_s);
            self.plan_in_same_tick(watch, out);
        }

        let u_proposed = self.proposed_sticks(pilot, inbox);
        let approved = self.pass_gate(pilot, &u_proposed, inbox);
        let u_sent = self.sent(approved, inbox);
        self.follow_immobility(pilot, &u_sent);
        self.fifo.push(&u_sent);
        (out.u_proposed, out.approved, out.u_sent) = (u_proposed, approved, u_sent);
        out.plan_lag = self.planner.lag();
        watch.send(out);

        self.solve_for_next_tick(may_steer, seen.as_ref(), watch, out);
        if !may_steer {
            self.planner.drop_plan();
        }
        out.note_targets(&self.mission);
    }

    fn new_outcome(&self) -> Outcome {
        Outcome::with_buffers(&M::STATE, &M::PARAMETER, self.planner.horizon_steps())
    }

    fn forecast(&self, u_planned: &[Sticks]) -> Option<Pose> {
        if !self.mhe.is_started() {
            return None;
        }
        let outage_input = self.outage_input();
        let applied = u_planned.iter().map(|u| outage_input.unwrap_or(*u));
        let s_pred = predict(&self.model, self.mhe.s_hat(), self.mhe.p_hat(), applied, self.dt_s);
        Some(self.model.observe(&s_pred))
    }

    fn parameter_estimate(&self) -> Option<ParameterEstimate> {
        ParameterEstimate::of(&self.mhe, self.link.as_ref().and_then(Link::dead_time))
    }
}

impl<M: Vehicle<NS, NP>, const NS: usize, const NP: usize, const NR: usize> Cycle<M, NS, NP, NR> {
    /// Step 6 of thesis section 4.3.11: the newest state and the parameters, from the window that ends with the period
    /// `ahead` of the coming one.
    fn estimate(
        &mut self,
        seen: Option<&TickObservations>,
        ahead: isize,
        watch: &mut dyn Watch,
        out: &mut Outcome,
    ) {
        let Some(TickObservations { newest, at_tick }) = seen else { return };
        if self.mhe.is_started() {
            let (u_applied, decision) = self.follow_link(ahead, at_tick);
            (out.link, out.outage_input) = (decision, self.outage_input());
            // A jump of the poses is no motion of the vehicle.
            let has_jumped = self.plausibility.has_jumped();
            if has_jumped {
                self.mhe.hold_parameter(true);
            }
            let solved = self.mhe.update(&u_applied, newest, &mut || watch.is_late());
            if self.memory.is_on_mission {
                self.correct_dead_time(ahead);
            }
            // After the update, which still solves the corrected window with a free parameter.
            self.mhe.hold_parameter(has_jumped || !self.link_is_up());
            self.memory.has_estimator_failed = solved.is_err();
            if solved.is_err() {
                self.start_estimate(&at_tick.o);
            }
            out.estimator = Some(solved.into());
        } else {
            self.start_estimate(&at_tick.o);
        }
        out.dead_time = self.link.as_ref().and_then(Link::dead_time);
        watch.mark(TickStage::Estimated);
        out.s_hat.extend_from_slice(self.mhe.s_hat().as_slice());
        out.p_hat.extend_from_slice(self.mhe.p_hat().as_slice());
    }

    /// Starts the estimator at rest where `o` was observed.
    fn start_estimate(&mut self, o: &Pose) {
        self.memory.has_estimator_failed |= self.mhe.start(o).is_err();
    }

    /// Tests the link by the period `ahead` of the coming one; on a change corrects what the estimator received before
    /// and lets the mission go on from where the vehicle is. Returns the applied sticks of that period, and the
    /// decision; `None` without a link monitor.
    fn follow_link(
        &mut self,
        ahead: isize,
        observed: &Observed<{ pose::COUNT }>,
    ) -> (Sticks, Option<LinkDecision>) {
        let u_nominal = self.fifo.applied(ahead);
        let Some(link) = &mut self.link else { return (u_nominal, None) };
        let p = SVector::from_column_slice(self.mhe.p_hat().as_slice());
        let (decision, changed) = link.update(&u_nominal, &self.plausibility.steady(observed), &p);
        let u_applied = link.applied(0);
        if let Some(steps) = changed {
            // The newest of these steps is not in the window yet. Before the start there is no window.
            assert_amended(&self.mhe.amend(steps.saturating_sub(1), |age| link.applied(age + 1)));
            if link.is_up() {
                self.resume();
            }
        }
        (u_applied, Some(decision))
    }

    /// Corrects the dead times by the motion of this flight; `ahead` of the coming one is the period that ended last.
    fn correct_dead_time(&mut self, ahead: isize) {
        let Some(link) = &mut self.link else { return };
        let fifo = &mut self.fifo;
        if !link.correct_dead_time(fifo) {
            return;
        }
        let steps = (self.mhe.window().len() - 1).min(link.state_steps());
        link.rewrite_nominal(steps, |back| fifo.applied(ahead - back.cast_signed()));
        assert_amended(&self.mhe.amend(steps, |age| link.applied(age)));
    }

    /// What the gate lets through of the sticks that `pilot` proposes.
    fn pass_gate(&self, pilot: Option<Pilot>, u_proposed: &Sticks, inbox: &Inbox) -> Approved {
        match pilot {
            Some(Pilot::Controller) => self.gate.pass(u_proposed, self.pose_age_s(inbox)),
            Some(Pilot::Person) => self.gate.pass_manual(u_proposed),
            None => Approved::neutral(),
        }
    }

    /// Notes whether the controller follows the mission in this tick. After braking, or after others steered, resumes
    /// it from where the vehicle is.
    fn note_mission(&mut self, may_steer: bool) {
        let is_on_mission = may_steer && !self.planner.is_braking();
        let was_on_mission = std::mem::replace(&mut self.memory.is_on_mission, is_on_mission);
        if is_on_mission && !was_on_mission {
            self.resume();
        }
    }

    /// Lets the mission go on from where the vehicle is now, at its present speed.
    fn resume(&mut self) {
        self.progress.reset_smallest_error();
        if let Some(motion) = self.motion() {
            self.mission.resume(&motion.pose, &motion.rate);
        }
    }

    fn link_is_up(&self) -> bool {
        self.link.as_ref().is_none_or(Link::is_up)
    }

    /// What acts in place of all that is sent; `None` while the link is up.
    fn outage_input(&self) -> Option<Sticks> {
        self.link.as_ref().and_then(Link::outage_input)
    }

    /// Step 9 of thesis section 4.3.11: progress of the mission by the newest estimate; it waits for a braking vehicle.
    fn advance_mission(&mut self) {
        if self.mhe.is_started() && !self.planner.is_braking() {
            self.mission.advance(&self.model.observe(self.mhe.s_hat()));
        }
    }

    /// Steps 7 and 8 of thesis section 4.3.11: the plan that follows from the newest estimate.
    ///
    /// `first_period`, relative to the coming one, is the first one after that estimate.
    fn plan(&mut self, first_period: isize, watch: &mut dyn Watch, out: &mut Outcome) {
        if !self.mhe.is_started() {
            return;
        }
        let start = PlanStart {
            s_hat: self.mhe.s_hat(),
            p_hat: self.mhe.p_hat(),
            covariance: self.planner.covariance(|| self.mhe.state_covariance()),
            fifo: &self.fifo,
            outage_input: self.outage_input(),
            first_period,
        };
        let solved = self.planner.plan(&start, &self.mission, &mut || watch.is_late());
        watch.mark(TickStage::Planned);
        // Late is no failure until the plan is older than its horizon.
        let is_late = matches!(&solved, Ok(report) if report.stop == SqpStop::Late);
        let has_new_plan = solved.as_ref().is_ok_and(MpcReport::has_new_plan);
        let goes_on = is_late && self.planner.has_usable_plan();
        self.memory.has_controller_failed = !(has_new_plan || goes_on);
        out.controller = Some(solved.into());
        if watch.reads_plan() {
            out.plan.extend(self.planner.planned_sticks().map(<[f64; stick::COUNT]>::from));
        }
        out.s_pred.extend_from_slice(self.planner.s_pred().as_slice());
        out.reference = self.planner.reference();
        out.clearance = self.planner.clearance();
    }
}

/// Sent sticks are finite: a window that is amended by them can be solved. It may not have started.
fn assert_amended<T: Debug>(amended: &Result<T, MheError>) {
    debug_assert!(!matches!(amended, Err(MheError::NonFinite { .. })), "{amended:?}");
}

#[cfg(test)]
mod tests;
