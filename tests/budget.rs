//! What a tick may cost: heap calls, counted.
//!
//! Zero, but for the subproblems that Clarabel solves: all of them, or the few that the stage-wise solver leaves and
//! its report counts. Clarabel allocates for its own bookkeeping in every solve; that number is recorded here and may
//! only go down without a line in the changelog.

use std::alloc::System;

use horizon_control::QpKind;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use tello_flight::cycle::{self, Inbox, Unwatched};
use tello_flight::{ObstacleTable, Start};
use tello_io::config;
use tello_sim::virtual_time::VirtualFlight;
use tello_sim::{Profile, SimTable};

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
    losses: usize,
    returns: usize,
    /// Ticks whose plan is nearer to an obstacle than the margin.
    constrained: usize,
    /// Ticks with a subproblem that Clarabel solved.
    by_clarabel: usize,
}

/// All flights in one test: a second thread would count into the first one's region.
#[test]
fn a_tick_calls_the_heap_only_inside_clarabel() {
    for (profile, seed, qp) in [
        (Profile::BadDay, 1, QpKind::Riccati),
        (Profile::Outages, 9, QpKind::Riccati),
        (Profile::GoodDay, 3, QpKind::Riccati),
        (Profile::BadDay, 1, QpKind::Clarabel),
    ] {
        let seen = count_heap_calls(profile, seed, qp);
        println!("{profile:?}: {seen:?}");
        assert!(seen.planned > TICKS / 2, "{profile:?}: few of {TICKS} ticks planned: {seen:?}");
        if profile == Profile::Outages {
            // Each loss amends the window, each return resumes the mission.
            assert!(seen.losses > 0 && seen.returns > 0, "no outage noticed: {seen:?}");
        }
        assert_eq!(profile == Profile::GoodDay, seen.constrained > 20, "{profile:?}: {seen:?}");
        // The stage-wise solver leaves one subproblem in a few hundred to Clarabel, if any.
        let expected = match qp {
            QpKind::Clarabel => seen.planned..=seen.planned,
            QpKind::Riccati => 0..=TICKS / 500,
        };
        assert!(expected.contains(&seen.by_clarabel), "{profile:?}, {qp:?}: {seen:?}");
    }
}

/// Flies the built-in mission and holds each tick to its budget.
#[expect(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]
fn count_heap_calls(profile: Profile, seed: u64, qp: QpKind) -> Seen {
    let (fly, mission) = config::fly(None, None).unwrap();
    let sim = SimTable { profile, ..tello_sim::settings(None).unwrap() };
    let mut flight = config::flight(&fly, mission, Start::Airborne);
    flight.cycle.mpc.solver.qp = qp;
    if profile == Profile::GoodDay {
        // A pole that reaches over the path: constraints become active.
        let (centre_m, z_m) = ([-2.1, -2.2], [-0.2, 2.5]);
        flight.cycle.obstacles = vec![ObstacleTable::Cylinder { centre_m, radius_m: 0.15, z_m }];
    }

    // The inputs of the ticks, recorded first: the simulator may use the heap as it likes.
    let mut virtual_flight = VirtualFlight::new(&flight, &sim, seed).unwrap();
    let inboxes: Vec<Inbox> = (0..TICKS)
        .map(|_| {
            virtual_flight.tick().unwrap();
            virtual_flight.inbox().clone()
        })
        .collect();

    let mut cycle = cycle::build(&flight).unwrap();
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
            *(if link.state.is_down() { &mut seen.losses } else { &mut seen.returns }) += 1;
        }
        seen.by_clarabel += usize::from(clarabel_count > 0);
        assert!(
            heap_calls <= clarabel_count * HEAP_CALLS_PER_QP,
            "tick {}: {heap_calls} heap calls, {clarabel_count} of {qp_count} quadratic programs by Clarabel",
            inbox.step
        );
    }
    seen
}
