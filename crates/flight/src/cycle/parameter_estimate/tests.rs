use horizon_estim::{ArrivalTable, MheSettings, Observed};
use horizon_model::Kinematic;
use horizon_model::rows::{Pose, Sticks, gain};

use super::*;
use crate::DeadTimeError;

type Estimator = Mhe<Kinematic, 4, { stick::COUNT }, { pose::COUNT }, { gain::COUNT }>;

const P_PRIOR: [f64; 4] = [1.2, 0.5, 1.0, -0.1];
const C_P: [f64; 4] = [20.0, 10.0, 5.0, 2.0];

/// `None`: a fixed arrival.
fn estimator(forget_s: Option<f64>) -> Estimator {
    let arrival = forget_s.map_or(ArrivalTable::Fixed, |forget_s| ArrivalTable::Carried {
        c_0: vec![1.0; 4],
        forget_s,
    });
    let settings =
        MheSettings::builder(P_PRIOR).window_steps(2).c_o([100.0; 4]).c_s([20.0; 4]).c_p(C_P);
    Mhe::new(Kinematic, settings.arrival(arrival).build(&Kinematic).unwrap(), 0.02).unwrap()
}

fn started() -> Estimator {
    let mut mhe = estimator(Some(60.0));
    mhe.start(&Pose::zeros()).unwrap();
    mhe
}

#[test]
fn there_is_no_estimate_before_the_first_pose_and_none_with_a_fixed_arrival() {
    assert_eq!(ParameterEstimate::of(&estimator(Some(60.0)), None), None);
    let mut fixed = estimator(None);
    fixed.start(&Pose::zeros()).unwrap();
    assert_eq!(ParameterEstimate::of(&fixed, None), None);
    assert!(ParameterEstimate::of(&started(), None).is_some());
}

#[test]
fn a_flight_that_moved_nothing_leaves_prior_and_weights() {
    let ParameterEstimate { p, covariance, dead_time_change_s } =
        ParameterEstimate::of(&started(), None).unwrap();
    assert_eq!((p, dead_time_change_s), (P_PRIOR.to_vec(), None));
    for (i, row) in covariance.iter().enumerate() {
        for (j, entry) in row.iter().enumerate() {
            let expected = if i == j { C_P[i].powi(-2) } else { 0.0 };
            assert!((entry - expected).abs() < 1e-9, "{i}, {j}: {entry} instead of {expected}");
        }
    }
}

#[test]
fn motion_narrows_the_rows_that_it_shows_and_no_others() {
    let mut mhe = started();
    let mut u = Sticks::zeros();
    u[stick::THROTTLE] = 0.5;
    let mut o = Pose::zeros();
    for _ in 0..50 {
        o[pose::Z] += 0.02 * 0.8 * 0.5;
        assert!(mhe.update(&u, &Observed::full(o), &mut || false).is_ok());
    }
    let estimate = ParameterEstimate::of(&mhe, None).unwrap();
    let ratio = |row: usize| estimate.covariance[row][row] * C_P[row].powi(2);
    assert!(estimate.p[gain::LAMBDA_V] > 0.6, "{estimate:?}");
    assert!(ratio(gain::LAMBDA_V) < 0.5, "{estimate:?}");
    assert!(ratio(gain::LAMBDA_A) > 0.99, "{estimate:?}");
}

#[test]
fn the_dead_times_are_those_that_the_flight_found() {
    let mhe = started();
    let change = DeadTimeChange {
        steps: [2; stick::COUNT],
        change_s: Sticks::repeat(0.04),
        error: Some(DeadTimeError { mean_s: -0.015, sd_s: 0.01 }),
        throttle_error: None,
        yaw_error: None,
    };
    let longer_s = |change| ParameterEstimate::of(&mhe, change).unwrap().dead_time_change_s;
    assert_eq!(longer_s(Some(change)), change.found_s());
    // Without motion that shows it, the correction alone shows nothing.
    assert_eq!(longer_s(Some(DeadTimeChange { error: None, ..change })), None);
    assert_eq!(longer_s(None), None);
}
