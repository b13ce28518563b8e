//! How often periods may be missed, and solvers may fail.

use super::super::tests::{ALOFT, Fixture};
use super::*;

/// Whether a flight lands in which each `ticks` ticks begin with one of the evidence `e`.
fn lands(e: &Evidence, ticks: u32) -> bool {
    let mut fixture = Fixture::flying();
    (0..200).any(|_| {
        fixture.pass(1, e);
        fixture.run(ticks - 1, &ALOFT).phase != Phase::Flying
    })
}

#[test]
fn one_missed_period_per_ten_ticks_never_ends_a_flight() {
    // The missed one is the eleventh of ten ticks.
    let late = Evidence { skipped: 1, ..ALOFT };
    assert_eq!([9, 10].map(|ticks| lands(&late, ticks)), [true, false]);
}

#[test]
fn one_failed_solve_in_three_never_ends_a_flight() {
    let failed = Evidence { has_estimator_failed: true, ..ALOFT };
    assert_eq!([2, 3].map(|ticks| lands(&failed, ticks)), [true, false]);
}
