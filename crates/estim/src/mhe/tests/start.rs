//! Where the estimator starts, and what it returns for an observation that no state at rest explains.

use super::*;
use horizon_model::{Matrix, Vector};

/// A boat whose distance and direction are seen: `s' = s + dt p u`. It rests at `rest`, or by default.
#[derive(Debug, Clone, Copy)]
struct Boat {
    rest: Option<[f64; 2]>,
}

/// The default at rest.
const BOAT: Boat = Boat { rest: None };

impl Model<2, 2, 2, 1> for Boat {
    fn step(&self, s: &Vector<2>, u: &Vector<2>, p: &Vector<1>, dt_s: f64) -> Vector<2> {
        s + u * (p[0] * dt_s)
    }

    fn observe(&self, s: &Vector<2>) -> Vector<2> {
        Vector::from([s.norm(), s[1].atan2(s[0])])
    }

    fn observe_by_state(&self, s: &Vector<2>) -> Matrix<2, 2> {
        let squared = s.norm_squared();
        let (by_distance, by_angle) = (s / squared.sqrt(), Vector::from([-s[1], s[0]]) / squared);
        Matrix::from_rows(&[by_distance.transpose(), by_angle.transpose()])
    }

    fn at_rest(&self, o: &Vector<2>) -> Vector<2> {
        let found = Vector::from([o[0] * o[1].cos(), o[0] * o[1].sin()]);
        self.rest.map_or(found, Vector::from)
    }
}

fn estimator(boat: Boat) -> Mhe<Boat, 2, 2, 2, 1> {
    let settings = MheSettings::builder([1.0]).c_o([100.0; 2]).build(&boat).unwrap();
    Mhe::new(boat, settings, 0.1).unwrap()
}

#[test]
fn a_start_says_what_rest_leaves_of_the_observation() {
    let o = Vector::from([2.0, 0.7]);
    assert!(estimator(BOAT).start(&o).unwrap().norm() < 1e-12);
    let left = estimator(Boat { rest: Some([1.0, 0.0]) }).start(&o).unwrap();
    assert!((left - Vector::from([1.0, 0.7])).norm() < 1e-12, "{left}");
}

#[test]
fn a_state_without_observation_or_derivative_is_refused() {
    let o = Vector::from([2.0, 0.7]);
    for (rest, what) in [([0.0, 0.0], "derivative"), ([f64::NAN, 0.0], "state")] {
        let mut mhe = estimator(Boat { rest: Some(rest) });
        mhe.start_at(&o).unwrap();
        let error = mhe.start(&o).unwrap_err();
        assert_eq!(error, MheError::NonFinite { what, k: 0 });
        assert!(!mhe.is_started());
    }
}

#[test]
fn a_given_state_is_where_the_window_begins() {
    let (mut s, p) = (Vector::from([1.5, 1.2]), [1.2].into());
    let mut mhe = estimator(Boat { rest: Some([0.0, 0.0]) });
    mhe.start_at(&s).unwrap();
    assert_eq!(mhe.window(), &[s]);
    for k in 0..60 {
        let u = Vector::from([f64::sin(0.3 * f64::from(k)), f64::cos(0.2 * f64::from(k)) - 0.3]);
        s = BOAT.step(&s, &u, &p, 0.1);
        let observed = Observed::full(BOAT.observe(&s));
        assert!(mhe.update(&u, &observed, &mut || false).unwrap().cost.is_finite());
    }
    assert!((mhe.s_hat() - s).norm() < 1e-3 && (mhe.p_hat() - p).norm() < 1e-3, "{}", mhe.p_hat());
    assert!(mhe.state_covariance().is_some());
    mhe.start_at(&s).unwrap();
    assert!(mhe.state_covariance().is_none(), "that of the window before");
}
