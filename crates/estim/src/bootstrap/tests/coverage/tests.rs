use std::convert::Infallible;
use std::f64::consts::TAU;

use horizon_model::rows::{Pose, Sticks};
use horizon_model::{Kinematic, Vector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::*;
use crate::ident::{IdentSettings, Piece};
use crate::levenberg::LmTable;
use crate::residual::Observed;

const DT_S: f64 = 0.02;
const TRUTH: [f64; 4] = [1.3, 0.5, 1.0, 0.1];
const C_O: [f64; 4] = [100.0, 100.0, 100.0, 50.0];
const C_S: [f64; 4] = [4.0, 4.0, 4.0, 8.0];

/// Standard normal, Box and Muller.
fn normal(generator: &mut ChaCha8Rng) -> f64 {
    let mut uniform = || ((generator.next_u64() >> 11) as f64 + 0.5) / (1_u64 << 53) as f64;
    (-2.0 * uniform().ln()).sqrt() * (TAU * uniform()).cos()
}

/// Pieces drawn from the statistical model itself: independent noise on transitions and observations
/// with deviations that are the inverse of the weights.
fn drawn(seed: u64, pieces: u32, steps: u32) -> Vec<Piece<4, 4>> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let weighted = |weights: [f64; 4], generator: &mut ChaCha8Rng| {
        Pose::from(weights.map(|weight| normal(generator) / weight))
    };
    let piece = |_| {
        let mut s = weighted([1.0; 4], &mut generator);
        let phase = weighted([0.5; 4], &mut generator);
        let (mut u, mut o) = (Vec::new(), Vec::new());
        for k in 0..steps {
            let applied = Sticks::from_fn(|axis, _| (phase[axis] + 0.15 * f64::from(k)).sin());
            o.push(Observed::full(s + weighted(C_O, &mut generator)));
            u.push(applied);
            s = Kinematic.step(&s, &applied, &Vector::from(TRUTH), DT_S)
                + weighted(C_S, &mut generator) * DT_S;
        }
        Piece { u, o }
    };
    (0..pieces).map(piece).collect()
}

/// Identification of drawn data; every weight is `factor` times what it should be.
fn trial(seed: u64, factor: f64, resamples: u64) -> Result<Trial<4>, TrialError> {
    let scaled = |weights: [f64; 4]| weights.map(|weight| weight * factor);
    let settings = IdentSettings::builder([1.0, 1.0, 1.0, 0.0])
        .c_o(scaled(C_O))
        .c_s(scaled(C_S))
        .c_p([0.01; 4])
        .bounds([-9.0; 4], [9.0; 4])
        .solver(LmTable { damping_start: 1e-8, iterations_max: 50, ..LmTable::default() })
        .build(&Kinematic)
        .unwrap();
    let mut ident = Ident::new(Kinematic, &settings, DT_S, drawn(seed, 30, 20)).unwrap();
    let report = ident.solve(&mut || false)?;
    assert!(report.iterations < 50, "{report:?}");
    Trial::new(&mut ident, &Vector::from(TRUTH), seed, resamples)
}

#[test]
#[ignore = "40 identifications with bootstrap: in .ci/run all"]
fn every_interval_covers_what_is_drawn_from_the_model_itself() {
    let calibration = calibrate(0..40, |seed| trial(seed, 1.0, 40)).unwrap().unwrap();
    assert_eq!(calibration.methods.len(), 4);
    for coverage in &calibration.methods {
        // 160 intervals of 95 %: three deviations are 0.052. 40 resamples of 30 pieces know
        // their quantiles less well.
        let fraction = coverage.fraction.mean();
        assert!(
            (0.86..=0.995).contains(&fraction),
            "{}: {fraction} of the intervals",
            coverage.method
        );
        for (row, (claimed, actual)) in coverage.std.iter().zip(&calibration.std).enumerate() {
            // 40 trials know a deviation to 11 %.
            let ratio = claimed / actual;
            assert!((0.65..1.45).contains(&ratio), "{}, row {row}: {ratio}", coverage.method);
        }
    }
}

/// The claim itself, for each method and parameter; prints the fractions.
#[test]
#[ignore = "takes minutes"]
fn intervals_of_95_percent_hold_the_truth_in_90_to_99_of_100_of_200_identifications() {
    let calibration = calibrate(0..200, |seed| trial(seed, 1.0, 100)).unwrap().unwrap();
    for coverage in &calibration.methods {
        eprintln!("{}: {:.3?}", coverage.method, coverage.fraction.as_slice());
        for fraction in coverage.fraction.iter() {
            assert!((0.90..=0.99).contains(fraction), "{}: {fraction}", coverage.method);
        }
    }
}

#[test]
#[ignore = "40 identifications: in .ci/run all"]
fn wrong_weights_only_mislead_the_plain_covariance() {
    // Weights of a third claim three times the deviation.
    let calibration = calibrate(0..40, |seed| trial(seed, 1.0 / 3.0, 0)).unwrap().unwrap();
    let ratios: Vec<_> = calibration
        .methods
        .iter()
        .map(|coverage| (coverage.method, coverage.std.component_div(&calibration.std).mean()))
        .collect();
    let [("plain", plain), ("scaled", scaled), ("clustered", clustered)] = ratios[..] else {
        panic!("{ratios:?}");
    };
    // The mean of four deviations, each known to 11 % from 40 trials.
    assert!((2.5..3.6).contains(&plain), "plain {plain}");
    assert!((0.8..1.25).contains(&scaled), "scaled {scaled}");
    assert!((0.8..1.25).contains(&clustered), "clustered {clustered}");
}

#[test]
fn a_tally_counts_what_the_trials_say() {
    let trial = |seed: u64| -> Result<Trial<1>, Infallible> {
        let error = Vector::from([if seed == 0 { 3.0 } else { 1.0 }]);
        let claim = Claim { method: "plain", std: error * 2.0, holds: [seed != 0] };
        Ok(Trial { error, claims: vec![claim] })
    };
    let calibration = calibrate(0..4, trial).unwrap().unwrap();
    assert!((calibration.bias.x - 1.5).abs() < 1e-15 && (calibration.std.x - 1.0).abs() < 1e-15);
    let [coverage] = calibration.methods[..] else { panic!("{calibration:?}") };
    assert!((coverage.fraction.x - 0.75).abs() < 1e-15);
    assert!((coverage.std.x - (48.0_f64 / 4.0).sqrt()).abs() < 1e-15, "{}", coverage.std.x);
    assert_eq!(calibrate(0..1, trial), Ok(None));
}
