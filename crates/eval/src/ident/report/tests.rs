use super::*;

fn parameter(name: &'static str, is_at_bound: bool) -> ParameterRow {
    let (value, std) = (1.5, 0.25);
    let (lower, upper) = (1.0, 2.0);
    ParameterRow { name, unit: "m/s", value, std, std_laplace: std, lower, upper, is_at_bound }
}

/// A fit without anything to note.
pub(in crate::ident) fn fit() -> FitReport {
    FitReport {
        settings: "ident.json".to_owned(),
        model: "kinematic",
        p: vec![1.5],
        std: vec![0.25],
        covariance: None,
        parameters: vec![parameter("lambda_h", false)],
        dead_time_s: vec![0.32; 4],
        delay: Vec::new(),
        cost: 12.5,
        iterations: 7,
        stop: "cost tolerance",
        solve_seconds: 0.5,
        pieces: 3,
        steps: 900,
        steps_lost: 0,
        bootstrap: None,
        is_resampled: false,
        verdict: Vec::new(),
        refused: None,
    }
}

fn bootstrap(resamples: usize, asked: u64) -> Bootstrap {
    Bootstrap {
        resamples,
        unconverged: 1,
        distinct: 2,
        asked,
        seed: 5,
        seconds: 1.25,
        mean: vec![1.5],
        correlation: vec![vec![1.0]],
    }
}

#[test]
fn a_bootstrap_is_whole_with_as_many_resamples_as_were_asked_for() {
    assert!(bootstrap(100, 100).is_whole());
    assert!(!bootstrap(99, 100).is_whole());
}

#[test]
fn every_verdict_on_a_dead_time_keeps_its_meaning() {
    for (verdict, expected) in [
        (DelayVerdict::Minimum, DelayMinimum::Minimum),
        (DelayVerdict::Zero, DelayMinimum::Zero),
        (DelayVerdict::EndOfRange, DelayMinimum::EndOfRange),
        (DelayVerdict::Undecided, DelayMinimum::Undecided),
    ] {
        assert_eq!(DelayMinimum::from(verdict), expected);
    }
}

#[test]
fn a_fit_without_trouble_has_no_line_about_it() {
    assert_eq!(
        fit().to_string(),
        "model         kinematic (ident.json)\n\
         pieces        3, 900 steps\n\
         cost          12.500000, 7 iterations, cost tolerance, 0.500 s\n\
         parameter          value       std  95 % interval (Laplace)\n\
         lambda_h         1.50000   0.25000     1.0000 .. 2.0000    m/s\n"
    );
}

#[test]
fn bounds_lost_steps_and_refusals_are_reported() {
    let delay = DelayRow {
        sticks: "roll, pitch".to_owned(),
        dead_time_s: 0.32,
        verdict: DelayMinimum::Undecided,
        std_s: None,
        lower_s: None,
        upper_s: None,
    };
    let known = DelayRow {
        sticks: "yaw".to_owned(),
        std_s: Some(0.01),
        lower_s: Some(0.3),
        upper_s: Some(0.34),
        ..delay.clone()
    };
    let fit = FitReport {
        parameters: vec![parameter("lambda_h", true)],
        delay: vec![delay, known],
        steps_lost: 40,
        bootstrap: Some(bootstrap(99, 100)),
        is_resampled: true,
        verdict: vec!["too few pieces".to_owned()],
        refused: Some("lambda_h = -1".to_owned()),
        ..fit()
    };
    let text = fit.to_string();
    for line in [
        "left out      40 steps with lost commands\n",
        "95 % interval (bootstrap)\n",
        "2.0000    m/s, at its bound\n",
        "roll, pitch       0.3200 s, dead time\n",
        "yaw               0.3200    0.0100     0.3000 .. 0.3400    s, dead time\n",
        "bootstrap     99 of 100 resamples, 2 distinct, 1 not converged, seed 5, 1.2 s\n",
        "  lambda_h      1.00\n",
        "note          too few pieces\n",
        "refused       no parameter file, since fly would refuse it: lambda_h = -1\n",
    ] {
        assert!(text.contains(line), "no {line:?} in\n{text}");
    }
}

#[test]
fn several_fits_are_a_row_each_and_a_star_is_a_bound() {
    let other = FitReport {
        settings: "other.json".to_owned(),
        parameters: vec![parameter("lambda_h", true)],
        ..fit()
    };
    let used = |steps, skipped: &[&str]| FileUsed {
        path: "a.log".into(),
        sha256: String::new(),
        steps,
        skipped: skipped.iter().map(ToString::to_string).collect(),
    };
    let report = IdentReport {
        fit: fit(),
        against: vec![other],
        comparison: None,
        dt_s: 0.02,
        files_used: vec![used(10, &[]), used(20, &["line 3", "line 4"])],
        files_skipped: vec![FileSkipped { path: "b.log".into(), why: "empty".to_owned() }],
        seconds: 1.0,
        written: vec!["out".into()],
        revision: "x",
    };
    assert_eq!(
        report.to_string(),
        "logs          2 used, 30 steps\n\
         \x20 a.log: 10 steps, 0.2 s at 50 Hz\n\
         \x20 a.log: 20 steps, 0.4 s at 50 Hz; line 3; line 4\n\
         \x20 not used: b.log: empty\n\
         ident.json                       cost     12.500   lambda_h 1.5000\n\
         other.json                       cost     12.500   lambda_h 1.5000*\n\
         * at its bound\n\
         written       out\n"
    );
}
