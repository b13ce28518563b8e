mod dead_time;
mod disturbance;
mod expansion;
mod given;
mod hessian;
mod indefinite;
mod late;
mod models;
mod not_finite;
mod soft;
mod stages;
mod subproblem;
mod termination;

use horizon_model::check::{Point, amax, model_gap};
use horizon_model::rows::{Pose, Sticks, gain, pose, stick};
use horizon_model::{Kinematic, Matrix, Vector};
use nalgebra::Vector1;

use self::models::{Cart, Steep};
use super::*;

const DT_S: f64 = 0.02;

/// A controller of the vehicle and everything else that an [`MpcProblem`] needs.
struct Case {
    mpc: Mpc<Kinematic, 4, 4, 4, 4, 4>,
    s_0: Pose,
    p: Vector<4>,
    u_before: Sticks,
    s_ref: Vec<Pose>,
    u_given: Vec<Sticks>,
    given_steps: [usize; 4],
}

fn table(horizon_steps: usize, bound: f64) -> MpcTable {
    MpcTable {
        horizon_steps,
        stages: Vec::new(),
        input_cost: InputCost::Absolute,
        c_u: vec![1.2, 1.2, 0.8, 0.8],
        c_s: vec![1.5, 1.5, 1.0, 1.0],
        c_s_end: vec![15.0, 15.0, 10.0, 10.0],
        u_lb: vec![-bound; 4],
        u_ub: vec![bound; 4],
        solver: SolverTable {
            qp: QpKind::Clarabel,
            cost_tolerance: 1e-9,
            iterations_max: 50,
            qp_tolerance: 1e-10,
            qp_iterations_max: 50,
        },
    }
}

impl Case {
    fn new(table: &MpcTable) -> Self {
        let s_0 = Pose::new(0.1, -0.4, 1.0, 3.0);
        let s_ref = s_0 + Pose::new(0.3, -0.2, 0.1, 0.4);
        Self {
            mpc: Mpc::new(Kinematic, table.check::<Kinematic, 4, 4, 4, 4>().unwrap(), DT_S)
                .unwrap(),
            s_0,
            p: Vector::from([1.3, 0.45, 1.0, -0.3]),
            u_before: Sticks::new(0.1, -0.2, 0.3, 0.0),
            s_ref: vec![s_ref; table.horizon_steps],
            u_given: Vec::new(),
            given_steps: [0; 4],
        }
    }

    fn solve_while(&mut self, is_late: &mut dyn FnMut() -> bool) -> Result<MpcReport, SqpError> {
        let Self { mpc, s_0, p, u_before, s_ref, u_given, given_steps } = self;
        let given_steps = *given_steps;
        mpc.solve(&MpcProblem { s_0, p, u_before, s_ref, u_given, given_steps }, is_late)
    }

    fn solve(&mut self) -> MpcReport {
        self.solve_while(&mut || false).unwrap()
    }
}

/// Optimal inputs of `s_{k+1} = a s_k + b u_k` with the weights of `1/2 (sum r u^2 + q s^2)`, the
/// last state weighted by `q_end`: backward Riccati recursion, then a simulation.
fn regulator<const NS: usize>(
    (a, b): (Matrix<NS, NS>, Matrix<NS, 1>),
    (r, q, q_end): (f64, Matrix<NS, NS>, Matrix<NS, NS>),
    s_0: Vector<NS>,
    steps: usize,
) -> Vec<f64> {
    let mut gains = Vec::new();
    let mut value = q_end;
    for _ in 0..steps {
        let gain = b.transpose() * value * a / (r + (b.transpose() * value * b)[0]);
        value = q + a.transpose() * value * (a - b * gain);
        gains.push(gain);
    }
    let mut s = s_0;
    let act = |gain: &Matrix<1, NS>| {
        let u = -(gain * s)[0];
        s = a * s + b * u;
        u
    };
    gains.iter().rev().map(act).collect()
}

#[test]
fn a_linear_system_without_active_bounds_gets_the_closed_form_regulator() {
    const STEPS: usize = 30;
    let table = MpcTable {
        c_u: vec![0.5],
        c_s: vec![2.0, 0.3],
        c_s_end: vec![9.0, 4.0],
        u_lb: vec![-1e3],
        u_ub: vec![1e3],
        ..table(STEPS, 1.0)
    };
    let mut mpc =
        Mpc::<_, 2, 1, 2, 0, 2>::new(Cart, table.check::<Cart, 2, 1, 2, 0>().unwrap(), 0.1)
            .unwrap();
    let s_0 = Vector::from([1.5, -0.7]);
    let s_ref = [Vector::zeros(); STEPS];
    let problem = MpcProblem {
        s_0: &s_0,
        p: &Vector::zeros(),
        u_before: &Vector1::zeros(),
        s_ref: &s_ref,
        u_given: &[],
        given_steps: [0; 1],
    };
    let report = mpc.solve(&problem, &mut || false).unwrap();
    assert_eq!(report.stop, SqpStop::CostTolerance);

    let square = |w: [f64; 2]| Matrix::from_diagonal(&Vector::from(w).map(|w: f64| w * w));
    let weights = (0.25, square([2.0, 0.3]), square([9.0, 4.0]));
    let expected = regulator(Cart::dynamics(0.1), weights, s_0, STEPS);
    for (k, (u, expected)) in mpc.plan().iter().zip(expected).enumerate() {
        // The subproblem is solved to a gap of 1e-10 on inputs of order 1.
        assert!((u[0] - expected).abs() < 1e-5, "u_{k} = {} instead of {expected}", u[0]);
    }
}

#[test]
fn the_vehicle_without_active_bounds_gets_four_regulators_in_world_axes() {
    // Turned into world axes the sticks drive four integrators, and with equal weights on roll and
    // pitch the turn leaves the cost alone.
    const STEPS: usize = 25;
    let mut case = Case::new(&table(STEPS, 1.0));
    assert!(case.solve().has_new_plan());
    let way = case.s_0 - case.s_ref[0];
    let axis = |row: usize, gain: f64, c_u: f64, c_s: f64| {
        let one = |value: f64| Matrix::<1, 1>::new(value);
        let weights = (c_u * c_u, one(c_s * c_s), one(100.0 * c_s * c_s));
        regulator((one(1.0), one(DT_S * gain)), weights, Vector1::new(way[row]), STEPS)
    };
    let v_x = axis(pose::X, case.p[gain::LAMBDA_H], 1.2, 1.5);
    let v_y = axis(pose::Y, case.p[gain::LAMBDA_H], 1.2, 1.5);
    let throttle = axis(pose::Z, case.p[gain::LAMBDA_V], 0.8, 1.0);
    let yaw = axis(pose::THETA, case.p[gain::LAMBDA_A], 0.8, 1.0);
    let mut psi = case.s_0[pose::THETA] + case.p[gain::THETA_0];
    for (k, u) in case.mpc.plan().iter().enumerate() {
        let (sin, cos) = psi.sin_cos();
        let mut expected = Sticks::zeros();
        expected[stick::ROLL] = sin * v_x[k] - cos * v_y[k];
        expected[stick::PITCH] = cos * v_x[k] + sin * v_y[k];
        expected[stick::YAW] = yaw[k];
        expected[stick::THROTTLE] = throttle[k];
        // The outer iteration ends at a relative drop of 1e-9: inputs to its square root.
        assert!(amax(&(u - expected)) < 3e-5, "u_{k} = {u} instead of {expected}");
        psi += DT_S * case.p[gain::LAMBDA_A] * yaw[k];
    }
}

#[test]
fn inputs_stay_within_their_bounds_and_the_cost_never_rises() {
    for input_cost in [InputCost::Absolute, InputCost::Difference] {
        let one_step = SolverTable { iterations_max: 1, ..table(1, 1.0).solver };
        let mut case = Case::new(&MpcTable { input_cost, solver: one_step, ..table(13, 0.35) });
        case.s_ref.fill(case.s_0 + Pose::new(-2.0, 1.5, 1.0, -2.5));
        let (mut cost, mut active) = (f64::INFINITY, 0);
        for round in 0..12 {
            let report = case.solve();
            assert!(report.cost_start <= cost, "round {round}: {report:?} after {cost}");
            assert!(report.cost <= report.cost_start, "round {round}: {report:?}");
            cost = report.cost;
            for u in case.mpc.plan() {
                assert!(u.iter().all(|value| value.abs() <= 0.35), "round {round}: {u}");
                active += u.iter().filter(|value| value.abs() > 0.349).count();
            }
        }
        assert!(active > 100, "only {active} inputs at a bound");
    }
}

#[test]
fn every_jacobian_of_the_small_models_meets_its_numeric_twin() {
    let dt_s = 0.1;
    let (s, u) = (Vector::from([0.7, -1.2]), Vector1::new(0.4));
    let gap = model_gap(&Cart, &Point { s, u, p: Vector::zeros(), dt_s }).gap;
    assert!(gap < 1e-8, "cart: gap {gap:e}");
    for u in [0.0, 0.4, -1.0] {
        let (s, u) = (Vector1::new(0.7), Vector1::new(u));
        let steep = Steep { gradient_scale: 1.0 };
        let gap = model_gap(&steep, &Point { s, u, p: Vector::zeros(), dt_s }).gap;
        assert!(gap < 1e-8, "steep: gap {gap:e} at {u}");
    }
}

/// Solves from zero for the one input of `Steep` that leads to 1. Report and input come back.
fn solve_steep(gradient_scale: f64, iterations_max: u32) -> (MpcReport, f64) {
    let table = MpcTable {
        c_u: vec![0.1],
        c_s: vec![0.0],
        c_s_end: vec![10.0],
        u_lb: vec![-2.0],
        u_ub: vec![2.0],
        solver: SolverTable { iterations_max, ..table(1, 1.0).solver },
        ..table(1, 1.0)
    };
    let settings = table.check::<Steep, 1, 1, 1, 0>().unwrap();
    let mut mpc = Mpc::<_, 1, 1, 1, 0, 1>::new(Steep { gradient_scale }, settings, 1.0).unwrap();
    let (s_0, u_before, s_ref) = (Vector1::zeros(), Vector1::zeros(), [Vector1::new(1.0)]);
    let problem = MpcProblem {
        s_0: &s_0,
        p: &Vector::zeros(),
        u_before: &u_before,
        s_ref: &s_ref,
        u_given: &[],
        given_steps: [0; 1],
    };
    let report = mpc.solve(&problem, &mut || false).unwrap();
    (report, mpc.plan()[0][0])
}

#[test]
fn a_step_that_overshoots_is_shortened() {
    // The linear model asks for u = 100 / (100 + 0.01). That leads to 41 instead of 1, its half to
    // 5.5, its quarter to 0.87: only the quarter lowers the cost.
    let (report, u) = solve_steep(1.0, 1);
    assert_eq!(report.stop, SqpStop::IterationLimit);
    assert!((u - 25.0 / 100.01).abs() < 1e-8, "{u}");

    let (report, u) = solve_steep(1.0, 50);
    assert_eq!(report.stop, SqpStop::CostTolerance, "{report:?}");
    // Without input cost u + 40 u^3 = 1; its weight of 1e-4 of the state's moves u by less.
    assert!((u + 40.0 * u.powi(3) - 1.0).abs() < 1e-4, "{u}");
}

#[test]
fn a_step_that_does_not_lower_the_cost_is_not_taken() {
    let (report, u) = solve_steep(-1.0, 50);
    assert_eq!((report.stop, report.iterations), (SqpStop::Stalled, 0), "{report:?}");
    assert_eq!(u.to_bits(), 0.0_f64.to_bits());
    assert!(!report.has_new_plan());
}

#[test]
fn a_shifted_plan_starts_nearer_to_the_optimum_than_zeros() {
    let mut warm = Case::new(&table(25, 0.8));
    assert!(warm.solve().has_new_plan());
    warm.s_0 = warm.mpc.planned_states()[0];
    warm.u_before = warm.mpc.plan()[0];
    warm.mpc.shift();
    let mut cold = Case::new(&table(25, 0.8));
    cold.s_0 = warm.s_0;
    cold.u_before = warm.u_before;
    let (warm, cold) = (warm.solve(), cold.solve());
    assert!(warm.iterations < cold.iterations, "warm {warm:?}, cold {cold:?}");
    assert!(warm.cost_start < cold.cost_start, "warm {warm:?}, cold {cold:?}");
    let gap = (warm.cost / cold.cost - 1.0).abs();
    assert!(gap < 1e-8, "both end at the same optimum, gap {gap:e}");
}

#[test]
fn shift_drops_the_first_input_and_repeats_the_last() {
    let mut case = Case::new(&table(5, 0.8));
    assert!(case.solve().has_new_plan());
    let (u, s) = (case.mpc.plan().to_vec(), case.mpc.planned_states().to_vec());
    case.mpc.shift();
    assert_eq!(*case.mpc.plan(), [u[1], u[2], u[3], u[4], u[4]]);
    assert_eq!(*case.mpc.planned_states(), [s[1], s[2], s[3], s[4], s[4]]);
}

#[test]
fn reset_forgets_the_plan() {
    let mut case = Case::new(&table(5, 0.8));
    let first = case.solve();
    case.mpc.reset();
    assert_eq!(*case.mpc.plan(), [Sticks::zeros(); 5]);
    assert_eq!(case.solve(), first);
}

#[test]
fn planned_states_follow_from_the_plan() {
    let mut case = Case::new(&table(13, 0.8));
    assert!(case.solve().has_new_plan());
    let mut s = case.s_0;
    for (u, planned) in case.mpc.plan().iter().zip(case.mpc.planned_states()) {
        s = Kinematic.step(&s, u, &case.p, DT_S);
        assert_eq!(s, *planned);
    }
}

#[test]
fn a_controller_may_be_moved_to_the_control_thread() {
    fn is_send<T: Send>(_: &T) {}
    is_send(&Case::new(&table(1, 0.8)).mpc);
}

#[test]
fn equal_asks_give_equal_bits() {
    let [mut first, mut second] = [(); 2].map(|()| Case::new(&table(13, 0.8)));
    assert_eq!(first.solve(), second.solve());
    assert_eq!(first.mpc.plan(), second.mpc.plan());
}

#[test]
fn an_optimal_plan_is_a_new_plan_without_any_step() {
    let mut case = Case::new(&table(13, 0.8));
    case.s_ref.fill(case.s_0);
    let report = case.solve();
    assert_eq!((report.stop, report.iterations), (SqpStop::CostTolerance, 0), "{report:?}");
    assert!(report.has_new_plan());
    assert_eq!(*case.mpc.plan(), [Sticks::zeros(); 13]);
}

#[test]
fn a_subproblem_cut_short_leaves_the_plan_alone() {
    let solver = SolverTable { qp_iterations_max: 2, ..table(1, 1.0).solver };
    let mut case = Case::new(&MpcTable { solver, ..table(13, 0.8) });
    let report = case.solve();
    assert_eq!((report.stop, report.iterations, report.qp_iterations), (SqpStop::QpUnsolved, 0, 2));
    assert!(!report.has_new_plan());
    assert_eq!(report.cost.to_bits(), report.cost_start.to_bits());
    assert_eq!(*case.mpc.plan(), [Sticks::zeros(); 13]);
}

/// Puts a value that is not finite into a problem.
type Spoil = fn(&mut Case);

#[test]
fn what_is_not_finite_is_refused_and_changes_nothing() {
    let mut case = Case::new(&table(3, 0.8));
    assert!(case.solve().has_new_plan());
    let (u, s) = (case.mpc.plan().to_vec(), case.mpc.planned_states().to_vec());
    let spoils: [(Spoil, &str); 5] = [
        (|case| case.s_0[pose::Y] = f64::NAN, "s_0[1] = NaN is not finite"),
        (|case| case.p[gain::THETA_0] = f64::INFINITY, "p[3] = inf is not finite"),
        (|case| case.u_before[stick::YAW] = f64::NAN, "u_before[2] = NaN is not finite"),
        (|case| case.s_ref[2][pose::X] = f64::NAN, "s_ref[2][0] = NaN is not finite"),
        (
            |case| case.s_0[pose::X] = 1e300,
            "the present plan costs inf: state, reference or weights are too large, or the model is not finite",
        ),
    ];
    for (spoil, message) in spoils {
        case = Case { mpc: case.mpc, ..Case::new(&table(3, 0.8)) };
        spoil(&mut case);
        let error = case.solve_while(&mut || false).unwrap_err();
        assert_eq!(error.to_string(), message);
        assert_eq!(case.mpc.plan(), u, "{message}");
        assert_eq!(case.mpc.planned_states(), s, "{message}");
    }
}

#[test]
fn a_wrong_number_of_references_is_refused() {
    let mut case = Case::new(&table(3, 0.8));
    case.s_ref.pop();
    let error = case.solve_while(&mut || false).unwrap_err();
    assert_eq!(error, SqpError::Horizon { given: 2, stages: 3 });
    assert_eq!(error.to_string(), "2 references for a horizon of 3 stages");
}

#[test]
fn the_iteration_limit_is_an_outcome() {
    let solver = SolverTable { iterations_max: 2, ..table(1, 1.0).solver };
    let mut case = Case::new(&MpcTable { solver, ..table(13, 0.8) });
    let report = case.solve();
    assert_eq!((report.stop, report.iterations), (SqpStop::IterationLimit, 2));
    assert!(report.has_new_plan());
}

#[test]
fn a_bad_period_is_refused() {
    let settings = table(3, 0.8).check::<Kinematic, 4, 4, 4, 4>().unwrap();
    let error = Mpc::<_, 4, 4, 4, 4, 4>::new(Kinematic, settings, 0.0).unwrap_err();
    assert_eq!(error.to_string(), "dt_s = 0: expected finite and > 0");
}
