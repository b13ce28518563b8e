use std::f64::consts::TAU;

use horizon_model::angle::wrap;
use horizon_model::check::maximum;
use horizon_model::rows::{Pose, pose};
use proptest::prelude::*;

use super::*;

const DT_S: f64 = 0.02;

/// A flight of 20 s: accelerations up to 1 m/s^2, three turns.
fn truth(k: usize) -> Pose {
    let t = k as f64 * DT_S;
    Pose::new(
        (0.9 * t).sin(),
        0.5 * t - (0.7 * t).cos(),
        1.0 + 0.2 * (0.5 * t).sin(),
        TAU * t / 6.0,
    )
}

fn true_velocity(k: usize) -> Pose {
    let t = k as f64 * DT_S;
    Pose::new(0.9 * (0.9 * t).cos(), 0.5 + 0.7 * (0.7 * t).sin(), 0.1 * (0.5 * t).cos(), TAU / 6.0)
}

/// The flight as a mocap reports it: millimetre noise, 5 % of the positions off by 0.3 m, flips of the
/// heading of up to half a second, losses and repetitions.
fn observed(steps: usize) -> Vec<Observed<{ pose::COUNT }>> {
    let mut o: Vec<Pose> = Vec::new();
    for k in 0..steps {
        // Fixed sequences without a period in common: no random numbers needed.
        let noise = |row: usize| 0.001 * (1.7 * k as f64 + 2.3 * row as f64).sin();
        let mut sample = truth(k) + Pose::from_fn(|row, _| noise(row));
        if k % 20 == 7 {
            sample[pose::X] += 0.3;
        }
        if k % 150 < 25 {
            sample[pose::THETA] += 1.9;
        }
        sample[pose::THETA] = wrap(sample[pose::THETA]);
        if k % 130 > 125 {
            sample = Pose::zeros();
        }
        if k % 11 == 10 {
            sample = o[k - 1];
        }
        o.push(sample);
    }
    o.into_iter().map(Observed::full).collect()
}

fn worst(estimates: &[Pose], truth: impl Fn(usize) -> Pose, rows: &[usize]) -> f64 {
    let gap = |(k, estimate): (usize, &Pose)| {
        let gap = estimate - truth(k);
        rows.iter().map(|row| gap[*row].abs()).fold(0.0, maximum)
    };
    estimates.iter().enumerate().skip(50).map(gap).fold(0.0, maximum)
}

const PLACE: [usize; 3] = [pose::X, pose::Y, pose::Z];

#[test]
fn the_smoother_recovers_a_flight_from_outliers_flips_losses_and_repetitions() {
    let track = smooth(&observed(1000), DT_S);
    let turns = ((track.pose[50][pose::THETA] - truth(50)[pose::THETA]) / TAU).round() * TAU;
    let truth = |k| truth(k) + Pose::new(0.0, 0.0, 0.0, turns);
    let place = worst(&track.pose, truth, &PLACE);
    let velocity = worst(&track.velocity, true_velocity, &PLACE);
    let heading = worst(&track.pose, truth, &[pose::THETA]);
    // An outlier of 75 scales keeps 4 / (3 + 75^2) of its weight: a pull of 0.2 mm over the noise.
    assert!(place < 0.004, "{place} m");
    assert!(velocity < 0.05, "{velocity} m/s");
    assert!(heading < 0.02, "{heading} rad");
    assert!(track.is_trusted.iter().filter(|is_trusted| **is_trusted).count() > 600);
}

#[test]
fn the_tracker_knows_nothing_of_the_future() {
    let o = observed(1000);
    let whole = track(&o, DT_S);
    let half = track(&o[..500], DT_S);
    assert_eq!(whole.pose[..500], half.pose[..]);
    assert_eq!(whole.velocity[..500], half.velocity[..]);
    let place = worst(&whole.pose, truth, &PLACE);
    // Four lost samples at 1 m/s^2 of unknown acceleration, and the outliers from one side.
    assert!(place < 0.05, "{place} m");
}

#[test]
fn steps_far_from_samples_are_not_trusted() {
    let mut o = observed(400);
    // Through a gap the path keeps its heading.
    for observed in &mut o {
        observed.o[pose::THETA] = 0.3;
    }
    for observed in &mut o[200..300] {
        *observed = Observed::missing();
    }
    let track = smooth(&o, DT_S);
    assert!(track.is_trusted[195] && track.is_trusted[340]);
    assert!(!track.is_trusted[205..295].iter().any(|is_trusted| *is_trusted));
}

#[test]
fn a_pose_repeated_without_a_heading_is_no_new_sample() {
    let mut seen = Observed::full(truth(10));
    seen.is_present[pose::THETA] = false;
    let valid = valid_samples(&[seen, seen, Observed::full(truth(11))]);
    assert_eq!(valid.iter().map(Option::is_some).collect::<Vec<_>>(), [true, false, true]);
}

#[test]
fn a_flight_without_samples_is_still_a_track() {
    let track = smooth(&vec![Observed::missing(); 20], DT_S);
    assert!(track.pose.iter().all(|pose| pose.iter().all(|value| value.is_finite())));
    assert!(track.is_trusted.iter().all(|is_trusted| !is_trusted));
    assert!(smooth(&[], DT_S).pose.is_empty());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn any_samples_give_finite_tracks(
        values in prop::collection::vec(prop::array::uniform4(-1e3..1e3), 1..60),
    ) {
        let o: Vec<_> = values.iter().map(|value| Observed::full(Pose::from(*value))).collect();
        for track in [smooth(&o, DT_S), track(&o, DT_S)] {
            prop_assert_eq!(track.pose.len(), o.len());
            prop_assert!(track.pose.iter().chain(&track.velocity).all(|v| v.iter().all(|x| x.is_finite())));
        }
    }
}
