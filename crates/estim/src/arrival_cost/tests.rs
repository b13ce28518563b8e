//! The arrival cost against a Kalman filter, which knows the same by other means.

use std::ops::Range;

use horizon_model::check::{amax, jacobian_gap};
use horizon_model::{Bounds, Matrix, Row, Vector};
use nalgebra::{DMatrix, DVector};

use super::*;
use crate::levenberg::{LeastSquares, LmSettings, LmTable, solve};
use crate::loss::Loss;
use crate::residual::Observed;
use crate::window_problem::WindowProblem;

const NS: usize = 3;
const NU: usize = 1;
const NO: usize = 1;
const NP: usize = 2;
const ALL: usize = NS + NP;
const DT_S: f64 = 0.1;
/// So long that one step leaves all of it: `exp(-dt / NEVER_S)` is 1.
const NEVER_S: f64 = 1e18;

type State = Vector<NS>;
type Parameter = Vector<NP>;

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

    fn step(&self, s: &State, u: &Vector<NU>, p: &Parameter, dt_s: f64) -> State {
        self.step_by_state(s, u, p, dt_s) * s + self.step_by_parameter(s, u, p, dt_s) * p
    }

    fn step_by_state(&self, _: &State, _: &Vector<NU>, _: &Parameter, dt_s: f64) -> Matrix<NS, NS> {
        Matrix::<NS, NS>::new(1.0, dt_s, dt_s, 0.0, 0.8, 0.0, 0.0, 0.0, 0.95)
    }

    fn step_by_input(&self, _: &State, _: &Vector<NU>, p: &Parameter, _: f64) -> Matrix<NS, NU> {
        State::new(0.0, 0.2 * p.x, 0.0)
    }

    fn step_by_parameter(
        &self,
        _: &State,
        u: &Vector<NU>,
        _: &Parameter,
        _: f64,
    ) -> Matrix<NS, NP> {
        Matrix::<NS, NP>::new(0.0, 0.0, 0.2 * u.x, 0.2, 0.0, 0.0)
    }

    fn observe(&self, s: &State) -> Vector<NO> {
        Vector::from([s.x])
    }

    fn observe_by_state(&self, _: &State) -> Matrix<NO, NS> {
        Matrix::<NO, NS>::new(1.0, 0.0, 0.0)
    }

    fn at_rest(&self, o: &Vector<NO>) -> State {
        State::new(o.x, 0.0, 0.0)
    }
}

const C_O: f64 = 50.0;
const C_S: State = State::new(20.0, 2.0, 4.0);
const C_0: State = State::new(30.0, 3.0, 10.0);
const C_P: Parameter = Parameter::new(2.0, 5.0);
const P_PRIOR: Parameter = Parameter::new(1.0, 0.0);
const S_0: State = State::new(0.3, 0.0, 0.0);

type Window = WindowProblem<Cart, NS, NU, NO, NP>;

fn residuals() -> Residuals<Cart, NS, NU, NO, NP> {
    Residuals {
        model: Cart,
        dt_s: DT_S,
        c_o: Vector::from([C_O]),
        c_s: C_S,
        observation_loss: Loss::None,
        transition_loss: Loss::None,
    }
}

fn prior() -> Prior<NP> {
    let bounds = Bounds { lo: Parameter::repeat(-1e6), hi: Parameter::repeat(1e6) };
    Prior { c_p: C_P, p_prior: P_PRIOR, bounds }
}

/// A window that is about to see its first step.
fn started(window: usize, forget_s: f64) -> Window {
    let settings = ArrivalSettings::Carried { c_0: C_0, forget_s };
    let mut problem = WindowProblem::new(residuals(), prior(), settings, window);
    problem.start(S_0);
    problem
}

/// A window of four steps that has seen `steps` of the recording.
fn flown(steps: usize, forget_s: f64) -> Window {
    let mut problem = started(4, forget_s);
    go_on(&mut problem, 0..steps);
    problem
}

/// Shows a window of four steps more of the recording.
fn go_on(problem: &mut Window, steps: Range<usize>) {
    for k in steps {
        let (u, observed) = recorded(k);
        update(problem, 4, u, &observed);
    }
}

/// One update of a window of at most `window` steps. The problem is quadratic: one iteration solves it.
fn update(problem: &mut Window, window: usize, u: Vector<NU>, observed: &Observed<NO>) {
    let table = LmTable {
        damping_start: 0.0,
        cost_tolerance: 0.0,
        step_tolerance: 1e-15,
        iterations_max: 1,
    };
    if problem.states().len() > window {
        problem.pop();
    }
    problem.push(&u, observed);
    let settings = LmSettings::try_from(&table).unwrap();
    let report = solve(problem, &settings, &mut || false).unwrap();
    assert!(report.cost >= 0.0, "{report:?}");
}

/// Input and observation of step `k` of a made-up recording; every seventh observation is missing.
fn recorded(k: usize) -> (Vector<NU>, Observed<NO>) {
    let t = k as f64 * DT_S;
    let u = Vector::from([(0.9 * t).sin() + 0.4 * (2.3 * t).cos()]);
    let noise = (k * 7919 % 101) as f64 * 4e-4 - 0.02;
    let o = Vector::from([1.7 * (0.6 * t).sin() + 0.1 * t + noise]);
    (u, if k % 7 == 3 { Observed::missing() } else { Observed::full(o) })
}

/// The textbook filter on state and constant parameter together, dense.
struct Kalman {
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl Kalman {
    /// `c_p` infinite: the parameter is known.
    fn new(c_p: &Parameter) -> Self {
        let mean = DVector::from_iterator(ALL, S_0.iter().chain(&P_PRIOR).copied());
        let sd = C_0.iter().chain(c_p).map(|c| 1.0 / c);
        let variances = DVector::from_iterator(ALL, sd.map(|sd| sd * sd));
        Self { mean, covariance: DMatrix::from_diagonal(&variances) }
    }

    fn update(&mut self, u: Vector<NU>, observed: &Observed<NO>) {
        let (s, p) = (State::zeros(), Parameter::zeros());
        let mut f = DMatrix::identity(ALL, ALL);
        f.view_mut((0, 0), (NS, NS)).copy_from(&Cart.step_by_state(&s, &u, &p, DT_S));
        f.view_mut((0, NS), (NS, NP)).copy_from(&Cart.step_by_parameter(&s, &u, &p, DT_S));
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
fn the_information_on_the_parameter_is_the_schur_complement() {
    let mut arrival = ArrivalCost::<NS, NP>::new(C_0, NEVER_S, DT_S, None);
    arrival.hessian_ss = Matrix::from_row_slice(&[4.0, 1.0, 0.0, 1.0, 3.0, 0.5, 0.0, 0.5, 2.0]);
    arrival.hessian_sp = Matrix::from_row_slice(&[1.0, 0.0, -0.5, 0.3, 0.2, 1.0]);
    arrival.hessian_pp = Matrix::from_row_slice(&[5.0, 0.4, 0.4, 6.0]);
    let inverse = arrival.hessian_ss.try_inverse().unwrap();
    let expected =
        arrival.hessian_pp - arrival.hessian_sp.transpose() * inverse * arrival.hessian_sp;
    assert!(amax(&(arrival.information().unwrap() - expected)) < 1e-12);
}

#[test]
fn a_carried_arrival_makes_the_estimator_a_kalman_filter() {
    for window in 2..=10 {
        let mut problem = started(window, NEVER_S);
        let mut kalman = Kalman::new(&C_P);
        for k in 0..300 {
            let (u, observed) = recorded(k);
            update(&mut problem, window, u, &observed);
            kalman.update(u, &observed);
            let s_gap = amax(&(problem.newest() - kalman.mean.fixed_rows::<NS>(0)));
            let p_gap = amax(&(problem.parameter() - kalman.mean.fixed_rows::<NP>(NS)));
            assert!(s_gap < 1e-9, "window {window}, step {k}: state gap {s_gap:e}");
            assert!(p_gap < 1e-9, "window {window}, step {k}: parameter gap {p_gap:e}");
            problem.linearize().unwrap();
            let covariance = problem.information_of_parameter().try_inverse().unwrap();
            let expected = kalman.covariance.fixed_view::<NP, NP>(NS, NS);
            let gap = amax(&(covariance - expected)) / amax(expected);
            assert!(gap < 1e-9, "window {window}, step {k}: covariance gap {gap:e}");
        }
    }
}

/// State and parameter in one vector.
fn joint(s: &State, p: &Parameter) -> Vector<ALL> {
    Vector::from_iterator(s.iter().chain(p).copied())
}

/// The information matrix of state and parameter.
fn information(arrival: &ArrivalCost<NS, NP>) -> Matrix<ALL, ALL> {
    let mut h = Matrix::<ALL, ALL>::zeros();
    h.fixed_view_mut::<NS, NS>(0, 0).copy_from(&arrival.hessian_ss);
    h.fixed_view_mut::<NS, NP>(0, NS).copy_from(&arrival.hessian_sp);
    h.fixed_view_mut::<NP, NS>(NS, 0).copy_from(&arrival.hessian_sp.transpose());
    h.fixed_view_mut::<NP, NP>(NS, NS).copy_from(&arrival.hessian_pp);
    h
}

/// Information about the parameter while nothing else is known of the state.
fn marginal(arrival: &ArrivalCost<NS, NP>) -> Matrix<NP, NP> {
    let hessian_ss = arrival.hessian_ss.try_inverse().unwrap();
    let b = arrival.hessian_sp;
    arrival.hessian_pp - b.transpose() * hessian_ss * b
}

#[test]
fn the_gradient_and_the_curvature_meet_their_numeric_twins() {
    let problem = flown(50, 10.0);
    let arrival = problem.arrival();
    let split =
        |x: &Vector<ALL>| (x.fixed_rows::<NS>(0).into_owned(), x.fixed_rows::<NP>(NS).into_owned());
    let cost = |x: &Vector<ALL>| {
        let (s, p) = split(x);
        Vector::from([arrival.cost(&s, &p)])
    };
    let (s, p) = (State::new(0.5, -0.3, 0.2), Parameter::new(0.7, 0.4));
    let (mut block, mut parameter_block) = (Block::zeros(), ReducedSystem::zeros());
    arrival.add_to(&mut block, &mut parameter_block, &s, &p);
    let gradient = joint(&block.gradient, &parameter_block.gradient);
    let gap = jacobian_gap(cost, &joint(&s, &p), &gradient.transpose());
    // The largest gradients are some 1e4.
    assert!(gap < 1e-8, "gradient gap {gap:e}");
    let gradient = |x: &Vector<ALL>| {
        let (s, p) = split(x);
        let (by_s, by_p) = arrival.gradient(&s, &p);
        joint(&by_s, &by_p)
    };
    let gap = jacobian_gap(gradient, &joint(&s, &p), &information(arrival));
    assert!(gap < 1e-8, "curvature gap {gap:e}");
    assert_eq!((block.diagonal, parameter_block.hessian), (arrival.hessian_ss, arrival.hessian_pp));
}

#[test]
fn a_held_parameter_is_a_known_one() {
    let mut problem = started(4, 10.0);
    problem.hold_parameter(true);
    let mut kalman = Kalman::new(&Parameter::repeat(f64::INFINITY));
    for k in 0..200 {
        let (u, observed) = recorded(k);
        update(&mut problem, 4, u, &observed);
        kalman.update(u, &observed);
        let gap = amax(&(problem.newest() - kalman.mean.fixed_rows::<NS>(0)));
        assert!(gap < 1e-9, "step {k}: state gap {gap:e}");
        assert_eq!(problem.parameter(), &P_PRIOR, "step {k}");
    }
    let gap = amax(&(marginal(problem.arrival()) - prior().information()));
    assert!(gap < 1e-12, "the prior's information moved by {gap:e}");
    problem.hold_parameter(false);
    go_on(&mut problem, 200..400);
    let moved = amax(&(problem.parameter() - P_PRIOR));
    assert!(moved > 0.1, "the parameter moved by {moved} only");
}

#[test]
fn what_is_known_of_a_parameter_outlasts_its_holding() {
    let mut problem = flown(100, 10.0);
    problem.pop();
    let (p, known) = (*problem.parameter(), marginal(problem.arrival()));
    let p_mean = problem.arrival().p_mean;
    problem.hold_parameter(true);
    go_on(&mut problem, 100..200);
    assert_eq!(problem.parameter(), &p);
    let gap = amax(&(marginal(problem.arrival()) - known)) / amax(&known);
    assert!(gap < 1e-12, "information moved by {gap:e}");
    let gap = amax(&(problem.arrival().p_mean - p_mean));
    assert!(gap < 1e-12, "mean moved by {gap:e}");
}

#[test]
fn forgetting_mixes_the_information_of_the_window_with_the_prior() {
    let forget_s = 2.0;
    let factor = (-DT_S / forget_s).exp();
    let kept = flown(50, NEVER_S);
    let mut forgetting = kept.arrival().clone();
    forgetting.forgetting_factor = factor;
    let mut never = kept.arrival().clone();
    let iterate = kept.iterate();
    forgetting.absorb_oldest_step(&residuals(), &iterate, &prior(), false);
    never.absorb_oldest_step(&residuals(), &iterate, &prior(), false);
    let mut prior_information = Matrix::<ALL, ALL>::zeros();
    prior_information.fixed_view_mut::<NP, NP>(NS, NS).copy_from(&prior().information());
    let expected = information(&never) * factor + prior_information * (1.0 - factor);
    let gap = amax(&(information(&forgetting) - expected)) / amax(&expected);
    assert!(gap < 1e-14, "information gap {gap:e}");
    let (s, p) = (State::new(0.1, 0.2, 0.3), Parameter::new(2.0, -1.0));
    let at = |arrival: &ArrivalCost<NS, NP>| {
        let (by_s, by_p) = arrival.gradient(&s, &p);
        joint(&by_s, &by_p)
    };
    let by_prior = prior().information() * (p - P_PRIOR);
    let expected = at(&never) * factor + joint(&State::zeros(), &by_prior) * (1.0 - factor);
    let gap = amax(&(at(&forgetting) - expected)) / amax(&expected);
    // The mean is the solution of equations whose condition is about 1e5.
    assert!(gap < 1e-10, "gradient gap {gap:e}");
}

#[test]
fn hours_leave_it_symmetric_and_positive() {
    let mut problem = started(2, 20.0);
    let floor = prior().information() * (1.0 - (-DT_S / 20.0_f64).exp());
    for k in 0..100_000 {
        let (u, observed) = recorded(k);
        update(&mut problem, 2, u, &observed);
        if k % 1000 != 999 {
            continue;
        }
        let arrival = problem.arrival();
        let h = information(arrival);
        assert_eq!(h, h.transpose(), "step {k}");
        let lowest = h.symmetric_eigenvalues().min();
        assert!(lowest > 0.0, "step {k}: eigenvalue {lowest:e}");
        let least = (marginal(arrival) - floor).symmetric_eigenvalues().min();
        assert!(
            least > 0.0,
            "step {k}: the parameter's information is {least:e} below the prior's"
        );
    }
}

#[test]
fn a_refused_transition_begins_again() {
    let problem = flown(50, 10.0);
    let mut arrival = problem.arrival().clone();
    let refusing = Residuals { transition_loss: Loss::Tukey { scale: 1.0 }, ..residuals() };
    // The second state is a kilometre from where the model leads.
    let s = [problem.states()[0], State::new(1e3, 0.0, 0.0)];
    let iterate = Iterate { s: &s, ..problem.iterate() };
    arrival.absorb_oldest_step(&refusing, &iterate, &prior(), false);
    assert_eq!((arrival.s_mean, arrival.p_mean), (s[1], P_PRIOR));
    assert_eq!(marginal(&arrival), prior().information());
}
