//! Budget of a tick: heap calls, counted.
//!
//! Zero, but for the subproblems that Clarabel solves: all of them, or the few that the stage-wise solver leaves and
//! its report counts. Clarabel allocates for its own bookkeeping in every solve; that number is recorded here and may
//! only go down without a line in the changelog. What is rare counts as well: periods without a tick, solves that end
//! because they are late, an estimator that fails and starts anew.

use std::alloc::System;
use std::ops::Range;
use std::path::Path;

use horizon_control::QpKind;
use horizon_model::rows::Sticks;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use tello_flight::cycle::{self, FlightTable, Inbox, Operator, Outcome, Solve, Tick, Unwatched};
use tello_flight::{Fault, ObstacleTable, Phase, Pilot, Start};
use tello_io::config;
use tello_sim::failing_model::{self, FAILING_PART, FailingPart};
use tello_sim::virtual_time::VirtualFlight;
use tello_sim::{InjectedFault, PasserTable, Profile, ScriptedFault, SimTable};

#[global_allocator]
static GLOBAL: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Heap calls of Clarabel in one solve of a quadratic program.
const HEAP_CALLS_PER_QP: usize = 2;

/// Ticks flown.
const TICKS: usize = 1_000;

/// Events in the ticks of a flight.
#[derive(Debug, Default)]
struct Seen {
    planned: usize,
    unplanned: usize,
    /// Changes of the link to down, and back to up.
    outages: usize,
    returns: usize,
    /// Ticks whose plan is nearer to an obstacle than the margin.
    constrained: usize,
    /// Ticks with a subproblem that Clarabel solved.
    by_clarabel: usize,
    /// Ticks in which a person steered.
    by_hand: usize,
    /// Periods without a tick before each tick that catches up.
    skipped: Vec<u64>,
    /// Solves that ended because they were late.
    late_estimates: usize,
    late_plans: usize,
    /// Ticks in which the estimator failed, and those of them in which it was started anew.
    failures: u64,
    restarts: u64,
    is_landed: bool,
}

/// One flight whose ticks are counted.
struct Case {
    name: &'static str,
    flight: FlightTable,
    sim: SimTable,
    seed: u64,
    /// From here on for two seconds a person steers, who asks to land two seconds later. ticks
    by_hand_from: Option<usize>,
    /// Whether every third tick has no time left from some poll of its solvers on.
    is_late: bool,
    /// When the estimator fails.
    breaks_in: Option<Range<u64>>,
}

impl Case {
    /// The built-in mission from the air, or that of a file of settings.
    #[expect(clippy::unwrap_used, reason = "a test may panic")]
    fn new(name: &'static str, config: Option<&Path>, profile: Profile, seed: u64) -> Self {
        let (fly, mission) = config::fly(config, None).unwrap();
        let flight = config::flight(&fly, mission, Start::Airborne);
        let sim = SimTable { profile, ..tello_sim::settings(None).unwrap() };
        Self { name, flight, sim, seed, by_hand_from: None, is_late: false, breaks_in: None }
    }

    fn with_clarabel(mut self) -> Self {
        self.flight.cycle.mpc.solver.qp = QpKind::Clarabel;
        self
    }

    /// A pole that reaches over the path: constraints become active.
    fn beside_a_pole(mut self) -> Self {
        let (centre_m, z_m) = ([-2.1, -2.2], [-0.2, 2.5]);
        self.flight.cycle.obstacles =
            vec![ObstacleTable::Cylinder { centre_m, radius_m: 0.15, z_m }];
        self
    }

    /// The control thread stands still: the last time for so long that the flight ends.
    fn that_stalls(mut self) -> Self {
        let stall = |(from_s, periods): (f64, u64)| ScriptedFault {
            fault: InjectedFault::ControlStalled,
            from_s: from_s - 0.01,
            for_s: 0.02 * periods as f64,
        };
        self.sim.faults = [2.0, 4.0, 6.0].into_iter().zip(STALLS).map(stall).collect();
        self
    }

    fn that_is_late(self) -> Self {
        Self { is_late: true, ..self }
    }

    /// As often as a flight goes on with. Poses count as of their tick, or are moved on to it by the model, which
    /// fails.
    fn whose_estimator_fails(mut self, uses_measurement_time: bool) -> Self {
        self.flight.cycle.uses_measurement_time = uses_measurement_time;
        let from = 250;
        let ticks = u64::from(self.flight.cycle.supervisor.solver_failures_max);
        Self { breaks_in: Some(from..from + ticks), ..self }
    }

    /// From the ground to the ground, past an obstacle that moves slowly enough for a take-off beside it, two seconds
    /// by hand.
    fn whole(mut self) -> Self {
        self.flight.start = Start::Grounded;
        self.flight.cycle.obstacles = vec![ObstacleTable::Moving { radius_m: 0.2 }];
        let (from_w_m, to_w_m) = ([-3.5, -2.0, 1.0], [-0.5, -2.0, 1.0]);
        self.sim.passer = Some(PasserTable { from_w_m, to_w_m, speed_mps: 0.29, hidden_s: None });
        Self { by_hand_from: Some(450), ..self }
    }
}

/// Periods without a tick: one; more than sticks are repeated for; as many as are made up for.
const STALLS: [u64; 3] = [1, 6, 200];

/// All flights in one test: a second thread would count into the first one's region.
#[test]
fn a_tick_calls_the_heap_only_inside_clarabel() {
    let thesis = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/thesis/as_flown.json");
    let failing = |name| Case::new(name, None, Profile::Clean, 3);
    let thesis = Case::new("thesis", Some(&thesis), Profile::GoodDay, 3);
    for (case, planned_min) in vec![
        (Case::new("bad day", None, Profile::BadDay, 1), 500),
        (Case::new("outages", None, Profile::Outages, 9), 500),
        (Case::new("pole", None, Profile::GoodDay, 3).beside_a_pole(), 500),
        (Case::new("Clarabel", None, Profile::BadDay, 1).with_clarabel(), 500),
        (Case::new("whole flight", None, Profile::GoodDay, 5).whole(), 250),
        (Case::new("stalls", None, Profile::GoodDay, 3).that_stalls(), 250),
        (Case::new("late", None, Profile::GoodDay, 3).that_is_late(), 400),
        (failing("estimator fails").whose_estimator_fails(false), 400),
        (failing("estimator and poses fail").whose_estimator_fails(true), 400),
        (thesis, 500),
    ] {
        let (name, qp) = (case.name, case.flight.cycle.mpc.solver.qp);
        let seen = count_heap_calls(&case);
        println!("{name}: {seen:?}");
        assert!(seen.planned > planned_min, "{name}: few of {TICKS} ticks planned: {seen:?}");
        assert_happened(&case, &seen);
        // The stage-wise solver leaves one subproblem in a few hundred to Clarabel, if any.
        let expected = match qp {
            QpKind::Clarabel => seen.planned..=seen.planned,
            QpKind::Riccati => 0..=TICKS / 500,
        };
        assert!(expected.contains(&seen.by_clarabel), "{name}: {seen:?}");
    }
}

/// Asserts that the events of `case` happened in its flight, and no others.
fn assert_happened(case: &Case, seen: &Seen) {
    let name = case.name;
    if name == "outages" {
        // Each outage amends the window, each return resumes the mission.
        assert!(seen.outages > 0 && seen.returns > 0, "no outage noticed: {seen:?}");
    }
    if name == "whole flight" {
        assert!(seen.by_hand > 90 && seen.is_landed, "{seen:?}");
    }
    assert_eq!(["pole", "whole flight"].contains(&name), seen.constrained > 20, "{name}: {seen:?}");
    let stalls: &[u64] = if name == "stalls" { &STALLS } else { &[] };
    assert_eq!(seen.skipped, stalls, "{name}");
    let [least, most] = if name == "late" { [50, TICKS] } else { [0, 0] };
    for late in [seen.late_estimates, seen.late_plans] {
        assert!((least..=most).contains(&late), "{name}: {seen:?}");
    }
    let failures = case.breaks_in.as_ref().map_or(0, |ticks| ticks.end - ticks.start);
    // A pose that the failing model moves on to the tick is none: the estimator starts anew with the next one.
    let is_moved_on = case.flight.cycle.uses_measurement_time;
    let restarts = if is_moved_on { failures / 2 } else { failures };
    assert_eq!((seen.failures, seen.restarts), (failures, restarts), "{name}: {seen:?}");
}

/// A cycle of the flight of `case`.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn cycle(case: &Case) -> Box<dyn Tick> {
    if case.breaks_in.is_some() {
        failing_model::cycle(&case.flight).unwrap()
    } else {
        cycle::build(&case.flight).unwrap()
    }
}

/// Breaks the estimator of this thread in the ticks of `case` in which it fails.
fn set_broken(case: &Case, step: u64) {
    let is_broken = case.breaks_in.as_ref().is_some_and(|ticks| ticks.contains(&step));
    FAILING_PART.set(if is_broken { FailingPart::Estimator } else { FailingPart::Nothing });
}

/// The inputs of the ticks of `case`, recorded first: the simulator may use the heap as it likes.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn record(case: &Case) -> Vec<Inbox> {
    let Case { flight, sim, seed, .. } = case;
    let mut virtual_flight = VirtualFlight::with_cycle(cycle(case), flight, sim, *seed).unwrap();
    let mut inboxes: Vec<Inbox> = Vec::with_capacity(TICKS);
    for step in 0..TICKS {
        let is_by_hand = case.by_hand_from.is_some_and(|from| (from..from + 100).contains(&step));
        virtual_flight.set_manual(is_by_hand.then(|| Sticks::new(0.1, 0.0, 0.0, 0.0)));
        if case.by_hand_from.is_some_and(|from| step == from + 200) {
            virtual_flight.set_operator(Operator::Land);
        }
        // At the first poll both solvers are late, later the controller alone, in the end none.
        let late_at_poll = u32::try_from(step / 3 % 6).ok().filter(|_| step % 3 == 0);
        virtual_flight.set_late_at_poll(late_at_poll.filter(|_| case.is_late));
        set_broken(case, step as u64);
        virtual_flight.tick().unwrap();
        let inbox = virtual_flight.inbox();
        // While the loop stands still there is none.
        if inboxes.last().is_none_or(|last| last.step < inbox.step) {
            inboxes.push(inbox.clone());
        }
    }
    inboxes
}

/// Flies `case` and holds each tick to its budget.
fn count_heap_calls(case: &Case) -> Seen {
    let inboxes = record(case);
    let mut cycle = cycle(case);
    let mut out = cycle.new_outcome();
    let mut seen = Seen::default();
    for inbox in &inboxes {
        set_broken(case, inbox.step);
        let mut watch = Unwatched::as_recorded(inbox);
        let region = Region::new(GLOBAL);
        cycle.tick(inbox, &mut watch, &mut out);
        let change = region.change();
        let heap_calls = change.allocations + change.deallocations + change.reallocations;
        let clarabel_count = seen.add(case, (inbox, &out), cycle.forecast(&[]).is_some());
        assert!(
            heap_calls <= clarabel_count * HEAP_CALLS_PER_QP,
            "{}, tick {}: {heap_calls} heap calls, {clarabel_count} quadratic programs by Clarabel",
            case.name,
            inbox.step
        );
    }
    seen
}

impl Seen {
    /// Adds a tick, after which there is an estimate or not. Returns how many of its quadratic programs Clarabel
    /// solved.
    #[expect(clippy::panic, reason = "a test may panic")]
    fn add(&mut self, case: &Case, (inbox, out): (&Inbox, &Outcome), is_started: bool) -> usize {
        let by_riccati = case.flight.cycle.mpc.solver.qp == QpKind::Riccati;
        let (qp_count, clarabel_count) = match &out.controller {
            Some(Solve::Done(report)) if by_riccati => (report.iterations, report.qp_fallbacks),
            Some(Solve::Done(report)) => (report.iterations, report.iterations),
            Some(Solve::Failed(error)) => panic!("tick {}: {error}", inbox.step),
            None => (0, 0),
        };
        *(if qp_count == 0 { &mut self.unplanned } else { &mut self.planned }) += 1;
        self.constrained += usize::from(out.clearance.is_some_and(|near| near.active > 0));
        if let Some(link) = out.link.filter(|link| link.has_changed) {
            *(if link.state.is_down() { &mut self.outages } else { &mut self.returns }) += 1;
        }
        self.by_hand +=
            usize::from(out.decision.is_some_and(|one| one.pilot == Some(Pilot::Person)));
        self.is_landed |= out.phase() == Phase::Landed;
        self.by_clarabel += usize::from(clarabel_count > 0);
        self.skipped.extend((inbox.skipped > 0).then_some(inbox.skipped));
        let is_late = |solve: &Option<Solve>| matches!(solve, Some(Solve::Done(at_end)) if at_end.stop == "late");
        self.late_estimates += usize::from(is_late(&out.estimator));
        self.late_plans += usize::from(is_late(&out.controller));
        let has_failed =
            out.decision.is_some_and(|one| one.faults.contains(Fault::EstimatorFailed));
        self.failures += u64::from(has_failed);
        self.restarts += u64::from(has_failed && is_started);
        clarabel_count as usize
    }
}
