//! What a tick may cost: heap calls, counted.
//!
//! Zero, but for the subproblems that Clarabel solves: all of them, or the few that the stage-wise solver leaves and
//! its report counts. Clarabel allocates for its own bookkeeping in every solve; that number is recorded here and may
//! only go down without a line in the changelog.

use std::alloc::System;
use std::path::Path;

use horizon_control::QpKind;
use horizon_model::rows::Sticks;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use tello_flight::cycle::{self, FlightTable, Inbox, Operator, Unwatched};
use tello_flight::{ObstacleTable, Phase, Pilot, Start};
use tello_io::config;
use tello_sim::virtual_time::VirtualFlight;
use tello_sim::{PasserTable, Profile, SimTable};

#[global_allocator]
static GLOBAL: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Heap calls of Clarabel in one solve of a quadratic program.
const HEAP_CALLS_PER_QP: usize = 2;

/// Ticks flown.
const TICKS: usize = 1_000;

/// What the ticks of a flight went through.
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
}

impl Case {
    /// The built-in mission from the air, or that of a file of settings.
    #[expect(clippy::unwrap_used, reason = "a test may panic")]
    fn new(name: &'static str, config: Option<&Path>, profile: Profile, seed: u64) -> Self {
        let (fly, mission) = config::fly(config, None).unwrap();
        let flight = config::flight(&fly, mission, Start::Airborne);
        let sim = SimTable { profile, ..tello_sim::settings(None).unwrap() };
        Self { name, flight, sim, seed, by_hand_from: None }
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

    /// From the ground to the ground, past an obstacle that moves, two seconds by hand.
    fn whole(mut self) -> Self {
        self.flight.start = Start::Grounded;
        self.flight.cycle.obstacles = vec![ObstacleTable::Moving { radius_m: 0.2 }];
        let (from_m, to_m) = ([-3.5, -2.2, 1.0], [-0.5, -2.2, 1.0]);
        self.sim.passer = Some(PasserTable { from_m, to_m, speed_mps: 0.5, hidden_s: None });
        Self { by_hand_from: Some(450), ..self }
    }
}

/// All flights in one test: a second thread would count into the first one's region.
#[test]
fn a_tick_calls_the_heap_only_inside_clarabel() {
    let thesis = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/thesis/as_flown.json");
    let thesis = Case::new("thesis", Some(&thesis), Profile::GoodDay, 3);
    for (case, planned_min) in [
        (Case::new("bad day", None, Profile::BadDay, 1), 500),
        (Case::new("outages", None, Profile::Outages, 9), 500),
        (Case::new("pole", None, Profile::GoodDay, 3).beside_a_pole(), 500),
        (Case::new("Clarabel", None, Profile::BadDay, 1).with_clarabel(), 500),
        (Case::new("whole flight", None, Profile::GoodDay, 5).whole(), 250),
        (thesis, 500),
    ] {
        let (name, qp) = (case.name, case.flight.cycle.mpc.solver.qp);
        let seen = count_heap_calls(&case);
        println!("{name}: {seen:?}");
        assert!(seen.planned > planned_min, "{name}: few of {TICKS} ticks planned: {seen:?}");
        if name == "outages" {
            // Each outage amends the window, each return resumes the mission.
            assert!(seen.outages > 0 && seen.returns > 0, "no outage noticed: {seen:?}");
        }
        if name == "whole flight" {
            assert!(seen.by_hand > 90 && seen.is_landed, "{seen:?}");
        }
        assert_eq!(
            ["pole", "whole flight"].contains(&name),
            seen.constrained > 20,
            "{name}: {seen:?}"
        );
        // The stage-wise solver leaves one subproblem in a few hundred to Clarabel, if any.
        let expected = match qp {
            QpKind::Clarabel => seen.planned..=seen.planned,
            QpKind::Riccati => 0..=TICKS / 500,
        };
        assert!(expected.contains(&seen.by_clarabel), "{name}: {seen:?}");
    }
}

/// Flies `case` and holds each tick to its budget.
#[expect(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]
fn count_heap_calls(case: &Case) -> Seen {
    let Case { flight, sim, seed, .. } = case;
    let qp = flight.cycle.mpc.solver.qp;

    // The inputs of the ticks, recorded first: the simulator may use the heap as it likes.
    let mut virtual_flight = VirtualFlight::new(flight, sim, *seed).unwrap();
    let inboxes: Vec<Inbox> = (0..TICKS)
        .map(|tick| {
            let is_by_hand =
                case.by_hand_from.is_some_and(|from| (from..from + 100).contains(&tick));
            virtual_flight.set_manual(is_by_hand.then(|| Sticks::new(0.1, 0.0, 0.0, 0.0)));
            if case.by_hand_from.is_some_and(|from| tick == from + 200) {
                virtual_flight.set_operator(Operator::Land);
            }
            virtual_flight.tick().unwrap();
            virtual_flight.inbox().clone()
        })
        .collect();

    let mut cycle = cycle::build(flight).unwrap();
    let mut out = cycle.new_outcome();
    let mut seen = Seen::default();
    for inbox in &inboxes {
        let region = Region::new(GLOBAL);
        cycle.tick(inbox, &mut Unwatched::default(), &mut out);
        let change = region.change();
        let heap_calls = change.allocations + change.deallocations + change.reallocations;
        let (qp_count, clarabel_count) = match &out.controller {
            Some(cycle::Solve::Done(report)) if qp == QpKind::Riccati => {
                (report.iterations as usize, report.qp_fallbacks as usize)
            }
            Some(cycle::Solve::Done(report)) => {
                (report.iterations as usize, report.iterations as usize)
            }
            Some(cycle::Solve::Failed(error)) => panic!("tick {}: {error}", inbox.step),
            None => (0, 0),
        };
        if qp_count == 0 {
            seen.unplanned += 1;
        } else {
            seen.planned += 1;
        }
        seen.constrained += usize::from(out.clearance.is_some_and(|near| near.active > 0));
        if let Some(link) = out.link.filter(|link| link.changed) {
            *(if link.state.is_down() { &mut seen.outages } else { &mut seen.returns }) += 1;
        }
        seen.by_hand += usize::from(out.ruling.is_some_and(|one| one.pilot == Some(Pilot::Person)));
        seen.is_landed |= out.phase() == Phase::Landed;
        seen.by_clarabel += usize::from(clarabel_count > 0);
        assert!(
            heap_calls <= clarabel_count * HEAP_CALLS_PER_QP,
            "tick {}: {heap_calls} heap calls, {clarabel_count} of {qp_count} quadratic programs by Clarabel",
            inbox.step
        );
    }
    seen
}
