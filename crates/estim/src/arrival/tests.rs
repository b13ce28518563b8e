//! The arrival cost against a Kalman filter, which knows the same by other means.

use nalgebra::{DMatrix, DVector};
use tello_model::Row;

use super::*;
use crate::corner::Bounds;
use crate::levenberg::{LmSettings, LmTable, Problem, solve};
use crate::loss::Loss;
use crate::residual::Observed;
use crate::trajectory::Trajectory;

const NS: usize = 3;
const NU: usize = 1;
const NO: usize = 1;
const NP: usize = 2;
const ALL: usize = NS + NP;
const DT_S: f64 = 0.1;
/// So long that one step leaves all of it: `exp(-dt / NEVER_S)` is 1.
const NEVER_S: f64 = 1e18;

type State = SVector<f64, NS>;
type Parameter = SVector<f64, NP>;

/// A position that a velocity with lag drives, and a wandering velocity: linear in state and parameter
/// together.
#[derive(Debug, Clone, Copy)]
struct Cart;

impl Model<NS, NU, NO, NP> for Cart {
    const NAME: &'static str = "cart";
    const STATE: [Row; NS] =
        [Row::linear("x", "m"), Row::linear("v", "m/s"), Row::linear("d", "m/s")];
    const INPUT: [Row; NU] = [Row::linear("u", "1")];
    const OBSERVATION: [Row; NO] = [Row::linear("x", "m")];
    const PARAMETER: [Row; NP] = [Row::linear("gain", "m/s"), Row::linear("bias", "m/s")];

    fn step(&self, s: &State, u: &SVector<f64, NU>, p: &Parameter, dt_s: f64) -> State {
        self.step_by_state(s, u, p, dt_s) * s + self.step_by_parameter(s, u, p, dt_s) * p
    }

    fn step_by_state(
        &self,
        _: &State,
        _: &SVector<f64, NU>,
        _: &Parameter,
        dt_s: f64,
    ) -> SMatrix<f64, NS, NS> {
        SMatrix::<f64, NS, NS>::new(1.0, dt_s, dt_s, 0.0, 0.8, 0.0, 0.0, 0.0, 0.95)
    }

    fn step_by_input(
        &self,
        _: &State,
        _: &SVector<f64, NU>,
        p: &Parameter,
        _: f64,
    ) -> SMatrix<f64, NS, NU> {
        State::new(0.0, 0.2 * p.x, 0.0)
    }

    fn step_by_parameter(
        &self,
        _: &State,
        u: &SVector<f64, NU>,
        _: &Parameter,
        _: f64,
    ) -> SMatrix<f64, NS, NP> {
        SMatrix::<f64, NS, NP>::new(0.0, 0.0, 0.2 * u.x, 0.2, 0.0, 0.0)
    }

    fn observe(&self, s: &State) -> SVector<f64, NO> {
        SVector::from([s.x])
    }

    fn observe_by_state(&self, _: &State) -> SMatrix<f64, NO, NS> {
        SMatrix::<f64, NO, NS>::new(1.0, 0.0, 0.0)
    }

    fn at_rest(&self, o: &SVector<f64, NO>) -> State {
        State::new(o.x, 0.0, 0.0)
    }
}

const C_O: f64 = 50.0;
const C_S: State = State::new(20.0, 2.0, 4.0);
const C_0: State = State::new(30.0, 3.0, 10.0);
const C_P: Parameter = Parameter::new(2.0, 5.0);
const P_PRIOR: Parameter = Parameter::new(1.0, 0.0);

fn residuals() -> Residuals<Cart, NS, NU, NO, NP> {
    Residuals {
        model: Cart,
        dt_s: DT_S,
        c_o: SVector::from([C_O]),
        c_s: C_S,
        observation_loss: Loss::None,
        transition_loss: Loss::None,
    }
}

fn prior() -> Prior<NP> {
    let bounds = Bounds { lo: Parameter::repeat(-1e6), hi: Parameter::repeat(1e6) };
    Prior { c_p: C_P, p_prior: P_PRIOR, bounds }
}

/// One update of a window of at most `window` steps, to the optimum.
fn update(
    trajectory: &mut Trajectory<Cart, NS, NU, NO, NP>,
    window: usize,
    u: &SVector<f64, NU>,
    observed: &Observed<NO>,
) {
    let table = LmTable {
        damping_start: 0.0,
        cost_tolerance: 0.0,
        step_tolerance: 1e-15,
        iterations_max: 5,
    };
    if trajectory.states().len() > window {
        trajectory.pop();
    }
    trajectory.push(u, observed);
    let _ = solve(trajectory, &LmSettings::try_from(&table).unwrap(), &mut || false).unwrap();
}

/// Input and observation of step `k` of a made-up recording; every seventh observation is missing.
fn recorded(k: usize) -> (SVector<f64, NU>, Observed<NO>) {
    let t = k as f64 * DT_S;
    let u = SVector::from([(0.9 * t).sin() + 0.4 * (2.3 * t).cos()]);
    let noise = (k * 7919 % 101) as f64 * 4e-4 - 0.02;
    let o = SVector::from([1.7 * (0.6 * t).sin() + 0.1 * t + noise]);
    (u, if k % 7 == 3 { Observed::missing() } else { Observed::full(o) })
}

/// The textbook filter on state and constant parameter together, dense.
struct Kalman {
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl Kalman {
    /// `c_p` infinite: the parameter is known.
    fn new(s_0: &State, c_p: &Parameter) -> Self {
        let mean = DVector::from_iterator(ALL, s_0.iter().chain(&P_PRIOR).copied());
        let sd = C_0.iter().chain(c_p).map(|c| 1.0 / c);
        let variances = DVector::from_iterator(ALL, sd.map(|sd| sd * sd));
        Self { mean, covariance: DMatrix::from_diagonal(&variances) }
    }

    fn update(&mut self, u: &SVector<f64, NU>, observed: &Observed<NO>) {
        let (s, p) = (State::zeros(), Parameter::zeros());
        let mut f = DMatrix::identity(ALL, ALL);
        f.view_mut((0, 0), (NS, NS)).copy_from(&Cart.step_by_state(&s, u, &p, DT_S));
        f.view_mut((0, NS), (NS, NP)).copy_from(&Cart.step_by_parameter(&s, u, &p, DT_S));
        self.mean = &f * &self.mean;
        self.covariance = &f * &self.covariance * f.transpose();
        for (row, c_s) in C_S.iter().enumerate() {
            self.covariance[(row, row)] += (DT_S / c_s).powi(2);
        }
        if !observed.is_present[0] {
            return;
        }
        let mut h = DMatrix::zeros(NO, ALL);
        h[(0, 0)] = 1.0;
        let innovation = (&h * &self.covariance * h.transpose())[(0, 0)] + C_O.powi(-2);
        let gain = &self.covariance * h.transpose() / innovation;
        self.mean += &gain * (observed.o.x - self.mean[0]);
        // Joseph's form keeps it symmetric.
        let rest = DMatrix::identity(ALL, ALL) - &gain * h;
        self.covariance =
            &rest * &self.covariance * rest.transpose() + &gain * gain.transpose() * C_O.powi(-2);
    }
}

#[test]
fn a_carried_arrival_makes_the_estimator_a_kalman_filter() {
    for window in 2..=10 {
        let s_0 = State::new(0.3, 0.0, 0.0);
        let settings = ArrivalSettings::Carried { c_0: C_0, forget_s: NEVER_S };
        let mut trajectory = Trajectory::new(residuals(), prior(), settings, window);
        trajectory.start(s_0);
        let mut kalman = Kalman::new(&s_0, &C_P);
        for k in 0..300 {
            let (u, observed) = recorded(k);
            update(&mut trajectory, window, &u, &observed);
            kalman.update(&u, &observed);
            let s_gap = (trajectory.newest() - kalman.mean.fixed_rows::<NS>(0)).amax();
            let p_gap = (trajectory.parameter() - kalman.mean.fixed_rows::<NP>(NS)).amax();
            assert!(s_gap < 1e-9, "window {window}, step {k}: state gap {s_gap:e}");
            assert!(p_gap < 1e-9, "window {window}, step {k}: parameter gap {p_gap:e}");
            trajectory.linearize().unwrap();
            let covariance = trajectory.information_of_parameter().try_inverse().unwrap();
            let expected = kalman.covariance.fixed_view::<NP, NP>(NS, NS);
            let gap = (covariance - expected).amax() / expected.amax();
            assert!(gap < 1e-9, "window {window}, step {k}: covariance gap {gap:e}");
        }
    }
}
