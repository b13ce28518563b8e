use nalgebra::SVector;

use super::*;

const DT_S: f64 = 0.02;

fn flight(ticks: Vec<TickRow>) -> Flight {
    Flight {
        path: "a.mcap".into(),
        name: "a".into(),
        dt_s: DT_S,
        judged: 0..ticks.len(),
        ticks,
        outline: vec![],
        targets: vec![],
        corners: vec![],
        gaps: vec![],
        reached: [0, 0],
        notes: vec![],
        unjudged: None,
    }
}

/// A flight whose link is down in these ticks.
fn with_link(is_down: &[bool]) -> Flight {
    let tick = |(period, is_down): (u64, &bool)| TickRow {
        period,
        is_link_down: Some(*is_down),
        ..TickRow::default()
    };
    flight((10..).zip(is_down).map(tick).collect())
}

#[test]
fn a_band_lasts_from_its_first_tick_to_the_end_of_its_last() {
    for (is_down, expected_s) in [
        (&[][..], &[][..]),
        (&[false, false], &[]),
        (&[true], &[(0.2, 0.22)]),
        (&[true, true, false, true], &[(0.2, 0.24), (0.26, 0.28)]),
        (&[false, true, true], &[(0.22, 0.26)]),
    ] {
        let found = spans_s(&with_link(is_down), is_link_down);
        assert_eq!(found.len(), expected_s.len(), "{is_down:?}");
        for (found, expected) in found.iter().zip(expected_s) {
            let gap = (found.0 - expected.0).abs().max((found.1 - expected.1).abs());
            assert!(gap < 1e-12, "{found:?} instead of {expected:?}");
        }
    }
    assert!(!is_link_down(&TickRow::default()), "without a monitor nothing is known");
}

#[test]
fn the_distance_is_that_from_the_reference_in_space_and_only_while_it_is_followed() {
    let tick = TickRow {
        estimate: Some(Pose::new(0.3, 0.0, 1.4, 3.0)),
        reference: Some(Pose::new(0.0, 0.0, 1.0, 0.0)),
        target: Some(Pose::new(9.0, 0.0, 1.0, 0.0)),
        phase: Some(Phase::Flying),
        ..TickRow::default()
    };
    assert!((error_m(&tick) - 0.5).abs() < 1e-12);
    // A recording of the thesis has neither phases nor references.
    let older = TickRow { phase: None, reference: None, ..tick.clone() };
    assert!((error_m(&older) - 8.7_f64.hypot(0.4)).abs() < 1e-12);
    for without in [
        TickRow { phase: Some(Phase::Landing), ..tick.clone() },
        TickRow { estimate: None, ..tick.clone() },
        TickRow { reference: None, target: None, ..tick },
    ] {
        assert!(error_m(&without).is_nan(), "{without:?}");
    }
}

/// A vehicle at rest at (1, 2, 1) with `theta`, whose sticks are full forward.
fn pushed(period: u64, theta: f64) -> TickRow {
    let mut u = horizon_model::rows::Sticks::zeros();
    u[stick::PITCH] = 1.0;
    TickRow {
        period,
        estimate: Some(Pose::new(1.0, 2.0, 1.0, theta)),
        param: Some(SVector::from([2.0, 1.0, 1.0, 0.0])),
        u_sent: Some(u),
        ..TickRow::default()
    }
}

#[test]
fn the_inputs_are_summed_from_the_state_in_the_direction_of_the_vehicle() {
    let quarter = std::f64::consts::FRAC_PI_2;
    let sums = cumulative_input(&flight(vec![pushed(0, 0.0), pushed(1, quarter), pushed(2, 0.0)]));
    assert_eq!(sums[0], None, "the sum begins");
    let step_m = 2.0 * DT_S;
    for (sum, [x, y]) in sums[1..].iter().zip([[step_m, 0.0], [step_m, step_m]]) {
        let gap = sum.unwrap() - Pose::new(1.0 + x, 2.0 + y, 1.0, 0.0);
        assert!(gap.norm() < 1e-12, "{gap}");
    }
}

#[test]
fn the_sum_begins_anew_after_five_seconds_and_after_a_gap() {
    let mut ticks: Vec<TickRow> = (0..600).map(|period| pushed(period, 0.0)).collect();
    ticks[100].estimate = None;
    let sums = cumulative_input(&flight(ticks));
    let begins: Vec<usize> = (0..600).filter(|k| sums[*k].is_none()).collect();
    assert_eq!(begins, [0, 100, 101, 351]);
    let last = sums[350].unwrap();
    assert!((last[pose::X] - 1.0 - 249.0 * 2.0 * DT_S).abs() < 1e-9, "{last}");
}

#[test]
fn a_row_without_a_value_is_a_gap() {
    let ticks = vec![pushed(0, 0.5), TickRow { period: 1, ..TickRow::default() }];
    let values = row(&flight(ticks), pose::THETA, |tick| tick.estimate);
    assert!((values[0] - 0.5).abs() < 1e-12 && values[1].is_nan(), "{values:?}");
}

#[test]
fn an_outage_and_a_fault_are_bands_with_their_names_and_a_good_flight_has_none() {
    let svg = |flight: &Flight| sticks("Sticks", flight).svg();
    let mut bad = with_link(&[false, true, false]);
    bad.ticks[2].phase = Some(Phase::Flying);
    bad.ticks[2].faults = vec!["mocap_lost".to_owned()];
    let (good, bad) = (svg(&with_link(&[false; 3])), svg(&bad));
    for name in [LINK_DOWN, "fault"] {
        assert!(bad.contains(name) && !good.contains(name), "{name}");
    }
}
