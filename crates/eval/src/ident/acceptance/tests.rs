use horizon_estim::{Observed, Recording};
use horizon_model::rows::Sticks;

use super::super::report::DelayRow;
use super::*;
use crate::ident::job::fixtures;

/// Why a fit to one log of 900 steps is refused that is in order but for `change`.
fn refusal(change: impl Fn(&mut FitReport)) -> String {
    let recording = Recording { u: vec![Sticks::zeros(); 900], o: vec![Observed::missing(); 900] };
    let logs = [fixtures::log("a", recording)];
    let table = crate::ident::settings(None).unwrap();
    let job = fixtures::job(&table, &logs);
    let mut fit = crate::ident::report::tests::fit();
    change(&mut fit);
    let values = [Accepted { value: fit.parameters[0].value, is_prior: false }];
    let file = parameter_file(&job, &fit, &values).unwrap();
    accept(&job, &fit, &[], &file).err().map_or_else(String::new, |why| why.to_string())
}

#[test]
fn a_fit_to_little_of_a_log_or_with_a_dead_time_out_of_range_is_refused() {
    let delay = |verdict| DelayRow {
        sticks: "yaw".to_owned(),
        dead_time_s: 0.04,
        verdict,
        std_s: None,
        lower_s: None,
        upper_s: None,
    };
    assert_eq!(refusal(|fit| fit.steps = 300), "");
    let why = refusal(|fit| (fit.steps, fit.steps_lost) = (299, 400));
    assert!(why.starts_with("only 299 of 900 steps can be used"), "{why}");
    let why = refusal(|fit| fit.steps_lost = 451);
    assert!(why.starts_with("in 451 of 900 steps"), "{why}");
    for verdict in [DelayMinimum::Minimum, DelayMinimum::Zero, DelayMinimum::Undecided] {
        assert_eq!(refusal(|fit| fit.delay = vec![delay(verdict)]), "", "{verdict:?}");
    }
    let why = refusal(|fit| fit.delay = vec![delay(DelayMinimum::EndOfRange)]);
    assert!(why.starts_with("the dead time of yaw is not the 0.04 s"), "{why}");
    let why = refusal(|fit| fit.parameters[0].is_at_bound = true);
    assert!(why.contains("units") && why.contains("shifted in time or exchanged"), "{why}");
}

#[test]
fn each_parameter_has_its_sticks() {
    use horizon_model::{Kinematic, Lagged, Model};
    let horizontal = [stick::ROLL, stick::PITCH];
    let of = |name: &str| match name {
        "lambda_v" | "tau_v" | "dead_v" => &[stick::THROTTLE][..],
        "lambda_a" | "tau_a" | "dead_a" => &[stick::YAW],
        _ => &horizontal,
    };
    for row in Kinematic::PARAMETER.iter().chain(&Lagged::PARAMETER) {
        assert_eq!(sticks_of(row.name), of(row.name), "{}", row.name);
    }
}

#[test]
fn a_prior_is_kept_where_sticks_rested_or_the_logs_add_little() {
    let row = |std_laplace: f64| ParameterRow {
        name: "tau_v",
        unit: "s",
        value: 0.7,
        std: std_laplace,
        std_laplace,
        lower: 0.5,
        upper: 0.9,
        is_at_bound: false,
    };
    let rms = |throttle: f64| {
        let mut rms = [0.3; stick::COUNT];
        rms[stick::THROTTLE] = throttle;
        rms
    };
    for (std_laplace, throttle, expected) in [
        (0.3, 0.04, true),
        (f64::NAN, 0.04, true),
        (0.1, 0.04, false),
        (0.1, 0.004, true),
        (0.3, 0.2, true),
        (0.1, 0.2, false),
    ] {
        let got = is_unknown(&row(std_laplace), &rms(throttle), 0.4);
        assert_eq!(got, expected, "{std_laplace}, {throttle}");
    }
}

#[test]
fn a_bound_is_taken_that_the_interval_holds() {
    let row = |value: f64, half: f64| ParameterRow {
        name: "tau_a",
        unit: "s",
        value,
        std: half / 2.0,
        std_laplace: half / 2.0,
        lower: value - half,
        upper: value + half,
        is_at_bound: false,
    };
    for (value, half, expected) in [
        (0.03, 0.1, 0.05),
        (0.03, 0.01, 0.03),
        (0.5, 0.2, 0.4),
        (0.5, 0.05, 0.5),
        (0.2, 0.5, 0.2),
        (0.03, f64::INFINITY, 0.05),
    ] {
        let got = nearest_bound(&row(value, half), 0.05, 0.4);
        assert!((got - expected).abs() < 1e-15, "{value} +- {half}: {got}");
    }
    assert!(nearest_bound(&row(f64::NAN, 0.1), 0.05, 0.4).is_nan());
    // One piece is resampled to itself: an interval without width, beside the one of its curvature.
    let resampled = |std_laplace: f64| ParameterRow { std_laplace, ..row(0.03, 0.0) };
    for (std_laplace, expected) in [(0.18, 0.05), (0.005, 0.03), (f64::NAN, 0.03)] {
        let got = nearest_bound(&resampled(std_laplace), 0.05, 0.4);
        assert!((got - expected).abs() < 1e-15, "{std_laplace}: {got}");
    }
}
