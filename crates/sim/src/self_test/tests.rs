use std::f64::consts::PI;

use horizon_model::check::maximum;
use horizon_model::{Lagged, Model};

use super::*;
use crate::batch::source;

fn number(name: &str, truth: f64, estimate: f64, std: Option<f64>) -> Found {
    let half = 1.96 * std.unwrap_or(f64::NAN);
    let is_dead_time = name.starts_with("dead time");
    Found {
        kind: if is_dead_time { FoundKind::DeadTime } else { FoundKind::Parameter },
        name: name.to_owned(),
        truth,
        estimate,
        std,
        interval: interval(estimate - half, estimate + half),
    }
}

/// Runs of one number each.
fn test_of(found: Vec<Found>, source: Source) -> SelfTest {
    let runs: Vec<Run> = found
        .into_iter()
        .map(|found| Some(Identified { found: vec![found], flown: None }))
        .collect();
    SelfTest::of(&runs, source)
}

#[test]
fn every_parameter_of_the_model_has_its_own_truth() {
    // Numbers that occur once.
    let mut plant = NOMINAL;
    (plant.horizontal.gain, plant.vertical.gain, plant.yaw.gain) = (1.0, 2.0, 3.0);
    plant.theta_0 = 4.0;
    (plant.horizontal.tau_s, plant.vertical.tau_s, plant.yaw.tau_s) = (5.0, 6.0, 7.0);
    (plant.horizontal.dead_zone, plant.vertical.dead_zone, plant.yaw.dead_zone) = (8.0, 9.0, 10.0);
    plant.accel_max_mps2 = 11.0;
    let truths = Lagged::PARAMETER.map(|row| truth_of(&plant, row.name));
    for (truth, expected) in truths.iter().zip(1..) {
        assert!((truth - f64::from(expected)).abs() < 1e-12, "{truth} is not number {expected}");
    }
    assert!(truth_of(&plant, "mass").is_nan());
}

#[test]
fn an_interval_holds_its_ends_and_none_holds_nothing() {
    let with = |[lower, upper]: [f64; 2]| Found {
        interval: interval(lower, upper),
        ..number("tau_h", 1.0, 1.0, None)
    };
    for (ends, holds) in [
        ([0.5, 1.5], Some(true)),
        ([1.0, 1.5], Some(true)),
        ([0.5, 1.0], Some(true)),
        ([1.1, 1.5], Some(false)),
        ([f64::NEG_INFINITY, 0.9], Some(false)),
        ([f64::NAN, f64::NAN], None),
    ] {
        assert_eq!(with(ends).holds(), holds, "{ends:?}");
    }
}

#[test]
fn a_row_sums_the_errors_of_all_runs() {
    let runs = [number("tau_h", 1.0, 1.3, Some(0.1)), number("tau_h", 2.0, 1.9, Some(0.3))];
    let row = SelfTestRow::of(&runs.iter().collect::<Vec<_>>()).unwrap();
    assert_eq!((row.name.as_str(), row.truth, row.estimate), ("tau_h", 1.0, 1.3));
    assert!((row.error_mean - 0.1).abs() < 1e-12, "{row:?}");
    assert!((row.error_rms - 0.05_f64.sqrt()).abs() < 1e-12, "{row:?}");
    assert!(row.std_mean.is_some_and(|std| (std - 0.2).abs() < 1e-12), "{row:?}");
    assert_eq!(row.coverage, Some(0.5));
    assert_eq!(SelfTestRow::of(&[]), None);
    // One run that claims nothing leaves no mean of the claims.
    let silent = [number("tau_h", 1.0, 1.3, Some(0.1)), number("tau_h", 1.0, 1.3, None)];
    let row = SelfTestRow::of(&silent.iter().collect::<Vec<_>>()).unwrap();
    assert_eq!((row.std_mean, row.coverage), (None, Some(0.0)));
}

#[test]
fn flights_by_hand_pass_if_the_mean_error_is_small_or_within_its_claims() {
    for (name, truth, error, std, is_passed) in [
        ("tau_h", 1.0, 0.029, Some(1e-6), true),
        ("tau_h", 1.0, 0.031, Some(1e-6), false),
        ("tau_h", -1.0, -0.029, None, true),
        ("tau_h", 1.0, 0.19, Some(0.05), true),
        ("tau_h", 1.0, 0.21, Some(0.05), false),
        ("dead time yaw", 0.1, 0.0049, Some(1e-6), true),
        ("dead time yaw", 0.1, 0.0051, Some(1e-6), false),
        // A parameter has no such allowance.
        ("dead_h", 0.1, 0.0049, Some(1e-6), false),
    ] {
        let found = number(name, truth, truth + error, std);
        let test = test_of(vec![found], Source::ByHand);
        assert_eq!(test.is_passed, is_passed, "{name} {truth} {error} {std:?}");
    }
    // Four runs: the mean is twice as sure.
    let four = |estimate| (0..4).map(|_| number("tau_h", 1.0, estimate, Some(0.05))).collect();
    assert!(test_of(four(1.09), Source::ByHand).is_passed);
    assert!(!test_of(four(1.11), Source::ByHand).is_passed);
    assert!(test_of(vec![number("tau_h", 1.0, 1.11, Some(0.05))], Source::ByHand).is_passed);
    assert!(!test_of(Vec::new(), Source::ByHand).is_passed, "nothing was found");
    let found = vec![number("tau_h", 1.0, 1.0, Some(0.1))];
    let test = SelfTest::of(&[Some(Identified { found, flown: None }), None], Source::ByHand);
    assert!(!test.is_passed && test.to_string().contains(", 1 refused\n"), "{test}");
}

#[test]
fn an_automatic_flight_passes_if_the_intervals_hold_none_is_refused_and_it_flies_as_well() {
    let run = |holds: bool, after_m: f64| {
        let flown = [0.1, after_m].map(|distance_m| {
            let mut flown = Flown::example(Some(9.0), 0.2);
            flown.distances_m[source::TRUTH] = vec![distance_m];
            flown
        });
        let estimate = if holds { 1.0 } else { 2.0 };
        let found = vec![number("tau_h", 1.0, estimate, Some(0.1))];
        Some(Identified { found, flown: Some(flown) })
    };
    let runs = |held: usize, after_m: f64| -> Vec<Run> {
        (0..10).map(|number| run(number < held, after_m)).collect()
    };
    let test = |runs: &[Run]| SelfTest::of(runs, Source::Automatic);
    let good = test(&runs(9, 0.1));
    assert!(good.is_passed && (good.coverage - 0.9).abs() < 1e-12, "{good}");
    assert!(good.to_string().ends_with("passed\n"), "{good}");
    assert!(!test(&runs(8, 0.1)).is_passed, "eight of ten intervals");
    assert!(!test(&runs(10, 0.2)).is_passed, "it flies worse");
    let mut refused = runs(10, 0.1);
    refused[3] = None;
    let refused = test(&refused);
    assert_eq!((refused.runs, refused.refused, refused.is_passed), (10, 1, false));
    assert!(refused.to_string().ends_with("FAILED\n"), "{refused}");
    let found = vec![number("tau_h", 1.0, 1.0, Some(0.1))];
    let not_flown: Vec<Run> = vec![Some(Identified { found, flown: None })];
    assert!(!test(&not_flown).is_passed, "it was not flown");
}

#[test]
fn flights_of_one_seed_are_flights_of_one_vehicle_each_with_its_own_sticks() {
    let (truth, logs) = simulate(3, None).unwrap();
    assert_eq!(truth, simulate(3, None).unwrap().0);
    assert_ne!(truth, simulate(4, None).unwrap().0);
    assert_eq!(logs.len() as u64, FLIGHTS);
    for log in &logs {
        assert_eq!((log.recording.u.len(), log.recording.o.len()), (FLIGHT_STEPS, FLIGHT_STEPS));
    }
    assert_ne!(logs[0].recording.u, logs[1].recording.u);
    // Headings go on over the wrap.
    for log in &logs {
        let seen = log.recording.o.iter().filter(|o| o.is_present[pose::THETA]);
        let headings: Vec<f64> = seen.map(|o| o.o[pose::THETA]).collect();
        assert!(headings.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= PI + 1e-9));
    }
    let turned = logs.iter().flat_map(|log| &log.recording.o).map(|o| o.o[pose::THETA].abs());
    assert!(turned.fold(0.0, maximum) > PI, "no flight turned over the wrap");
}
