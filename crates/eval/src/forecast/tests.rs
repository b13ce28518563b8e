use horizon_model::angle::wrap;
use horizon_model::check::maximum;
use horizon_model::rows::{Pose, Sticks, gain, pose, stick};
use horizon_model::{Kinematic, Lagged, Model};
use nalgebra::SVector;

use super::*;

const DT_S: f64 = 0.02;
const STEPS: usize = 400;
const HORIZON: usize = 50;

/// Sticks that swing, as a pilot's.
fn sticks() -> Vec<Sticks> {
    let stick = |k: usize, row: usize| 0.6 * (0.03 * k as f64 * (1.0 + 0.3 * row as f64)).sin();
    (0..STEPS).map(|k| Sticks::from_fn(|row, _| stick(k, row))).collect()
}

/// The flight of `model` from rest, every step trusted.
fn flown<M, const NS: usize, const NP: usize>(
    model: &M,
    p: &SVector<f64, NP>,
    u: &[Sticks],
    wind: &Pose,
) -> MotionTrack
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP>,
{
    let mut s = model.at_rest(&Pose::new(0.3, -0.2, 1.0, 2.0));
    let mut track = MotionTrack {
        pose: vec![],
        velocity: vec![],
        acceleration: vec![],
        o: vec![],
        is_trusted: vec![true; STEPS],
        is_current: vec![true; STEPS],
    };
    for (k, u) in u.iter().enumerate() {
        let s_next = model.step(&s, u, p, DT_S);
        let pose = model.observe(&s);
        track.pose.push(pose + wind * (k as f64 * DT_S));
        track.velocity.push((model.observe(&s_next) - pose) / DT_S + wind);
        track.acceleration.push(Pose::zeros());
        s = s_next;
    }
    track
}

fn lagged_p() -> SVector<f64, 11> {
    SVector::from([2.0, 0.9, 1.4, -0.06, 0.63, 0.25, 0.12, 0.07, 0.12, 0.08, 1.1])
}

fn worst(errors: &ForecastErrors) -> f64 {
    let largest = |at: &HorizonErrors| {
        maximum(at.horizontal.rmse, maximum(at.vertical.rmse, at.heading.rmse))
    };
    errors.curve().iter().map(largest).fold(0.0, maximum)
}

#[test]
fn a_model_predicts_its_own_flight() {
    let (u, p) = (sticks(), lagged_p());
    let track = flown(&Lagged::default(), &p, &u, &Pose::zeros());
    let driven = Driven::new(Lagged::default(), &p, &Pose::repeat(1.2), &u, &track, DT_S);
    let errors = prediction_errors(&driven, &track, &track, &[], HORIZON);
    assert!(worst(&errors) < 1e-9, "{}", worst(&errors));
    let kinematic = SVector::<f64, { gain::COUNT }>::new(1.3, 0.45, 1.0, 0.03);
    let track = flown(&Kinematic, &kinematic, &u, &Pose::zeros());
    let driven = Driven::new(Kinematic, &kinematic, &Pose::zeros(), &u, &track, DT_S);
    let errors = prediction_errors(&driven, &track, &track, &[], HORIZON);
    assert!(worst(&errors) < 1e-9, "{}", worst(&errors));
    let hold = prediction_errors(&StandStill, &track, &track, &[], HORIZON);
    assert!(worst(&hold) > 0.1, "nothing to predict: {}", worst(&hold));
}

#[test]
fn what_the_sticks_do_not_explain_decays() {
    let (u, p, wind) = (sticks(), lagged_p(), Pose::new(0.3, 0.0, 0.0, 0.0));
    let track = flown(&Lagged::default(), &p, &u, &wind);
    let error = |decay_s: f64| {
        let decay_s = Pose::new(decay_s, decay_s, 0.0, 0.0);
        let driven = Driven::new(Lagged::default(), &p, &decay_s, &u, &track, DT_S);
        prediction_errors(&driven, &track, &track, &[], HORIZON)
            .at(HORIZON)
            .unwrap()
            .horizontal
            .rmse
    };
    // The wind stays while its forecast decays: after t = 1 s, wind (t - sum of dt exp(-k dt / tau)).
    let forgotten = 0.3 * (1.0 - DT_S * (1.0 - (-1.0_f64).exp()) / (1.0 - (-DT_S).exp()));
    assert!((error(1.0) - forgotten).abs() < 1e-9, "{} and {forgotten}", error(1.0));
    assert!((error(0.0) - 0.3).abs() < 1e-9, "{}", error(0.0));
    assert!(error(1e9) < 1e-6, "{}", error(1e9));
}

#[test]
fn constant_velocity_predicts_a_straight_flight_through_half_a_turn() {
    let velocity = Pose::new(0.5, -0.2, 0.1, 1.0);
    let pose = |k: usize| {
        let mut pose = velocity * (k as f64 * DT_S);
        pose[pose::THETA] = wrap(pose[pose::THETA]);
        pose
    };
    let track = MotionTrack {
        pose: (0..STEPS).map(pose).collect(),
        velocity: vec![velocity; STEPS],
        acceleration: vec![Pose::zeros(); STEPS],
        o: vec![],
        is_trusted: vec![true; STEPS],
        is_current: vec![true; STEPS],
    };
    let errors = prediction_errors(&ConstantVelocity { dt_s: DT_S }, &track, &track, &[], HORIZON);
    assert!(worst(&errors) < 1e-9, "{}", worst(&errors));
    let hold = prediction_errors(&StandStill, &track, &track, &[], HORIZON).at(HORIZON).unwrap();
    assert!((hold.horizontal.rmse - 0.29_f64.sqrt()).abs() < 1e-9, "{hold:?}");
    assert!((hold.vertical.median - 0.1).abs() < 1e-9, "{hold:?}");
    assert!((hold.heading.rmse - 1.0).abs() < 1e-9, "{hold:?}");
}

#[test]
fn only_trusted_ends_without_exclusion_between_are_judged() {
    let u = vec![Sticks::zeros(); STEPS];
    let mut track = flown(&Lagged::default(), &lagged_p(), &u, &Pose::zeros());
    let count = |track: &MotionTrack, is_excluded: &[bool], steps: usize| {
        prediction_errors(&StandStill, track, track, is_excluded, HORIZON)
            .at(steps)
            .unwrap()
            .horizontal
            .count
    };
    // Starts 0, 10, .. 390; the last horizon must lie within the flight.
    assert_eq!(count(&track, &[], 1), 40);
    assert_eq!(count(&track, &[], 50), 35);
    let mut is_excluded = vec![false; STEPS];
    is_excluded[100] = true;
    // Excluded between start and horizon, both ends included.
    assert_eq!(count(&track, &is_excluded, 1), 39);
    assert_eq!(count(&track, &is_excluded, 50), 29);
    track.is_trusted[100] = false;
    // Start 100 and the forecast that ends there.
    assert_eq!(count(&track, &[], 50), 33);
    assert!(prediction_errors(&StandStill, &track, &track, &[], HORIZON).at(51).is_none());
    assert!(prediction_errors(&StandStill, &track, &track, &[], HORIZON).at(0).is_none());
}
