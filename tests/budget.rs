//! What a tick may cost: heap calls, counted.
//!
//! Zero in our code. Clarabel allocates for its own bookkeeping in every solve; that number is
//! recorded here and may only go down without a line in the changelog.

use std::alloc::System;

use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use tello_control::Start;
use tello_ctl::config;
use tello_ctl::cycle::{self, Inbox, Unwatched};
use tello_ctl::virtual_time::VirtualFlight;
use tello_sim::Profile;

#[global_allocator]
static GLOBAL: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Heap calls of Clarabel in one solve of a quadratic program.
const HEAP_CALLS_PER_QP: usize = 2;

/// Ticks flown.
const TICKS: usize = 1_000;

#[test]
fn a_tick_calls_the_heap_only_inside_clarabel() {
    let (fly, mission) = config::fly(None, None).unwrap();
    let mut sim = config::sim(None).unwrap();
    sim.profile = Profile::BadDay;
    let flight = config::flight(&fly, mission, Start::Airborne);

    // What the ticks are told, recorded first: the simulator may use the heap as it likes.
    let mut virtual_flight = VirtualFlight::new(&flight, &sim, 1).unwrap();
    let inboxes: Vec<Inbox> = (0..TICKS)
        .map(|_| {
            virtual_flight.tick().unwrap();
            virtual_flight.inbox().clone()
        })
        .collect();

    let mut cycle = cycle::build(&flight).unwrap();
    let mut out = cycle.new_outcome();
    let (mut planned, mut unplanned) = (0, 0);
    for inbox in &inboxes {
        let region = Region::new(GLOBAL);
        cycle.tick(inbox, &mut Unwatched::default(), &mut out);
        let change = region.change();
        let heap_calls = change.allocations + change.deallocations + change.reallocations;
        let qp_count = match &out.controller {
            Some(cycle::Solve::Done(report)) => report.iterations as usize,
            Some(cycle::Solve::Failed(error)) => panic!("tick {}: {error}", inbox.step),
            None => 0,
        };
        if qp_count == 0 {
            unplanned += 1;
        } else {
            planned += 1;
        }
        assert!(
            heap_calls <= qp_count * HEAP_CALLS_PER_QP,
            "tick {}: {heap_calls} heap calls with {qp_count} quadratic programs",
            inbox.step
        );
    }
    println!("{planned} ticks with a plan, {unplanned} without");
    assert!(planned > TICKS / 2, "only {planned} of {TICKS} ticks planned");
}
