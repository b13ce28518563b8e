//! How near to the optimum a solve ends.

use horizon_model::Vector;
use horizon_model::check::maximum;

use super::*;

/// State (angle from upright, rate), input (acceleration of the pivot), parameter (length). The Hessian of Gauss and
/// Newton is not that of the cost.
#[derive(Debug, Clone, Copy)]
struct Pendulum;

impl Model<2, 1, 1, 1> for Pendulum {
    fn step(&self, s: &Vector<2>, u: &Vector<1>, p: &Vector<1>, dt_s: f64) -> Vector<2> {
        let rate = s[1] + (s[0].sin() * 9.81 - s[0].cos() * u[0]) / p[0] * dt_s;
        Vector::from([s[0] + rate * dt_s, rate])
    }

    fn observe(&self, s: &Vector<2>) -> Vector<1> {
        Vector::from([s[0]])
    }
}

#[test]
fn no_solve_ends_further_above_the_optimum_than_its_tolerance_allows() {
    const STAGES: usize = 15;
    let (model, p) = (Pendulum, Vector::from([0.45]));
    let settings = MpcSettings::builder(STAGES).c_s_end([30.0, 6.0]).bounds([-8.0], [8.0]);
    let mut mpc =
        Mpc::<_, 2, 1, 1, 1, 2>::new(model, settings.clone().build(&model).unwrap(), 0.04).unwrap();
    let exact = settings
        .solver(SolverTable { cost_tolerance: 1e-14, ..SolverTable::default() })
        .build(&model)
        .unwrap();
    let mut exact = Mpc::<_, 2, 1, 1, 1, 2>::new(model, exact, 0.04).unwrap();
    let reference = [Vector::zeros(); STAGES];
    let (mut s, mut u) = (Vector::from([0.3, 0.0]), Vector::zeros());
    let mut worst = 0.0_f64;
    for k in 0..1000 {
        // Uniform errors of the estimate.
        let error = |factor: u32| 0.002 * (f64::from(k * factor % 101) / 50.0 - 1.0);
        let s_hat = s + Vector::from([error(7919), 5.0 * error(6101)]);
        let problem = MpcProblem::new(&s_hat, &p, &u, &reference);
        let cost = mpc.solve(&problem, &mut || false).unwrap().cost;
        exact.plan.clone_from(&mpc.plan);
        let least = exact.solve(&problem, &mut || false).unwrap().cost;
        worst = maximum(worst, cost / least - 1.0);
        u = mpc.plan()[0];
        mpc.shift();
        s = model.step(&s, &u, &p, 0.04);
    }
    assert!(worst < 1e-6, "{worst:e} above the least cost");
}

#[test]
fn a_plan_that_does_not_fit_is_refused_and_one_beyond_the_bounds_moved() {
    let mut case = Case::new(&table(3, 0.8));
    assert!(case.solve().has_new_plan());
    let before = case.mpc.plan().to_vec();
    let refused = case.mpc.set_plan(&[Sticks::zeros(); 2]);
    assert_eq!(refused, Err(SqpError::Plan { given: 2, stages: 3 }));
    let refused = case.mpc.set_plan(&[Sticks::zeros(), Sticks::repeat(f64::NAN), Sticks::zeros()]);
    let expected = "u[1][0] = NaN is not finite";
    assert_eq!(refused.unwrap_err().to_string(), expected);
    assert_eq!(case.mpc.plan(), before);
    case.mpc.set_plan(&[Sticks::new(2.0, -2.0, 0.3, 0.0); 3]).unwrap();
    assert_eq!(case.mpc.plan(), [Sticks::new(0.8, -0.8, 0.3, 0.0); 3]);
}

/// A lag of 2 s.
#[derive(Debug, Clone, Copy)]
struct Lag;

impl Model<1, 1, 1, 0> for Lag {
    fn step(&self, s: &Vector1<f64>, u: &Vector1<f64>, _p: &Vector<0>, dt_s: f64) -> Vector1<f64> {
        s + dt_s * 0.5 * (u - s)
    }

    fn observe(&self, s: &Vector1<f64>) -> Vector1<f64> {
        *s
    }
}

#[test]
fn a_plan_at_its_reference_is_optimal_up_to_rounding() {
    fn without_a_new_plan<const STAGES: usize>(c_u: f64, goal: f64) -> usize {
        let settings = MpcSettings::builder(STAGES).c_u([c_u]).bounds([-1e3], [1e3]);
        let settings = settings.input_cost(InputCost::Difference);
        let mut mpc =
            Mpc::<_, 1, 1, 1, 0, 1>::new(Lag, settings.build(&Lag).unwrap(), 0.1).unwrap();
        let (mut s, mut u) = (Vector1::zeros(), Vector1::zeros());
        let (p, s_ref) = (Vector::zeros(), [Vector1::new(goal); STAGES]);
        let mut count = 0;
        for _ in 0..1000 {
            let report = mpc.solve(&MpcProblem::new(&s, &p, &u, &s_ref), &mut || false).unwrap();
            count += usize::from(!report.has_new_plan());
            u = mpc.plan()[0];
            s = Lag.step(&s, &u, &p, 0.1);
            mpc.shift();
        }
        assert!((s[0] - goal).abs() < 1e-6, "{s}");
        count
    }
    assert_eq!(without_a_new_plan::<10>(0.1, 0.3), 0);
    assert_eq!(without_a_new_plan::<10>(0.3, 20.0), 0);
    assert_eq!(without_a_new_plan::<30>(1.0, 0.7), 0);
}
