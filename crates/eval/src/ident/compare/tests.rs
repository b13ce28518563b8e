use horizon_estim::Observed;
use horizon_model::rows::Pose;

use super::*;

const DT_S: f64 = 0.1;
const HORIZON_STEPS: usize = 10;

/// A track along x at 1 m/s, `offset_m` beside it.
fn track_at(offset_m: f64) -> MotionTrack {
    const STEPS: usize = 21;
    let at = |k: usize| Pose::new(DT_S * k as f64, offset_m, 1.0, 0.0);
    MotionTrack {
        pose: (0..STEPS).map(at).collect(),
        velocity: vec![Pose::new(1.0, 0.0, 0.0, 0.0); STEPS],
        acceleration: vec![Pose::zeros(); STEPS],
        o: (0..STEPS).map(|k| Observed::full(at(k))).collect(),
        is_trusted: vec![true; STEPS],
        is_current: vec![true; STEPS],
    }
}

/// A flight whose causal track is 0.3 m beside the smoothed one.
fn flight(is_lost: bool) -> ValidationFlight {
    let smoothed = track_at(0.0);
    let steps = smoothed.pose.len();
    ValidationFlight {
        recording: Recording { u: vec![Sticks::zeros(); steps], o: smoothed.o.clone() },
        smoothed,
        causal: track_at(0.3),
        is_lost: vec![is_lost; steps],
    }
}

fn assert_near(got: [f64; 3], expected: [f64; 3]) {
    for (got, expected) in got.iter().zip(expected) {
        assert!((got - expected).abs() < 1e-12, "{got} instead of {expected}");
    }
}

#[test]
fn errors_at_the_horizons_are_those_of_the_samples() {
    let mut errors = ForecastErrors::new(HORIZON_STEPS);
    // Horizons of 0.2, 0.6 and 1.0 s are 2, 6 and 10 steps.
    for (index, scale) in [(1, 1.0), (5, 2.0), (9, 3.0)] {
        errors.push(index, &(scale * Pose::new(0.3, -0.4, 0.1, 0.2)));
        errors.push(index, &(scale * Pose::new(0.0, 0.1, -0.1, -0.2)));
    }
    let errors = Errors::of(&errors, DT_S);
    assert_eq!(errors.count, 2);
    // Distances 0.5 and 0.1.
    let rmse_m = (0.13_f64).sqrt();
    assert_near(errors.xy_rmse_m, [rmse_m, 2.0 * rmse_m, 3.0 * rmse_m]);
    assert_near(errors.xy_median_m, [0.5, 1.0, 1.5]);
    assert_near(errors.z_rmse_m, [0.1, 0.2, 0.3]);
    assert_near(errors.theta_rmse_rad, [0.2, 0.4, 0.6]);
}

#[test]
fn a_rule_is_judged_from_both_starts_with_and_without_lost_commands() {
    let mut tally = Tally::new(HORIZON_STEPS);
    for is_lost in [false, true] {
        tally.add(&flight(is_lost), HORIZON_STEPS, |_| StandStill);
    }
    let ranked = tally.ranked("standing still", DT_S);
    // Two starts in each flight, of which one flight is masked.
    assert_eq!([&ranked.smoothed, &ranked.causal].map(|errors| errors.count), [4, 4]);
    assert_eq!([&ranked.smoothed_masked, &ranked.causal_masked].map(|errors| errors.count), [2, 2]);
    assert_near(ranked.smoothed.xy_rmse_m, HORIZONS_S);
    assert_near(ranked.smoothed_masked.xy_rmse_m, HORIZONS_S);
    // The causal forecast is 0.3 m aside, across the error that grows.
    assert_near(ranked.causal.xy_rmse_m, HORIZONS_S.map(|s| s.hypot(0.3)));
    let mut tally = Tally::new(HORIZON_STEPS);
    tally.add(&flight(false), HORIZON_STEPS, |_| ConstantVelocity { dt_s: DT_S });
    let ranked = tally.ranked("constant velocity", DT_S);
    assert_near(ranked.smoothed.xy_rmse_m, [0.0; 3]);
    assert_near(ranked.causal.xy_rmse_m, [0.3; 3]);
}

#[test]
fn without_samples_an_error_is_no_number() {
    let errors = Errors::of(&ForecastErrors::new(HORIZON_STEPS), DT_S);
    assert_eq!(errors.count, 0);
    assert!(errors.xy_rmse_m.iter().chain(&errors.xy_median_m).all(|error| error.is_nan()));
}

#[test]
fn nothing_to_compare_is_refused() {
    let error = compare(&[], &[], 5, &[]).unwrap_err();
    assert_eq!(error.to_string(), "nothing to compare");
}

#[test]
fn the_text_says_what_was_judged() {
    let mut tally = Tally::new(HORIZON_STEPS);
    tally.add(&flight(false), HORIZON_STEPS, |_| StandStill);
    let models = vec![tally.ranked("standing still", DT_S)];
    let mut comparison = Comparison { horizons_s: HORIZONS_S, folds: 3, lost: 0.124, models };
    let text = comparison.to_string();
    assert!(text.contains("on logs not fitted to, 3 parts; commands lost in 12 %"), "{text}");
    assert!(text.contains("standing still                      0.200 0.600 1.000"), "{text}");
    comparison.folds = 0;
    assert!(comparison.to_string().contains("on the logs of --judge"), "{comparison}");
}
