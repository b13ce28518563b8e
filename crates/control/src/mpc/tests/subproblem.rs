//! A quadratic problem solved by hand, and the choice of the Hessian where an active bound hides a direction of
//! negative curvature.

use horizon_model::check::maximum;
use horizon_model::{HessianKind, HessianRequest, InputHessian, Matrix, Model, Vector};
use nalgebra::{Vector1, Vector2};

use super::*;

/// `s' = s + 10 u_2 + 3 u_1 u_2`: with the costate `w` the exact Hessian by the inputs is `3 w [[0, 1], [1, 0]]`, and
/// its convexified replacement zero.
#[derive(Debug, Clone, Copy)]
struct Saddle;

impl Model<1, 2, 1, 0> for Saddle {
    fn step(&self, s: &Vector1<f64>, u: &Vector2<f64>, _p: &Vector<0>, _dt_s: f64) -> Vector1<f64> {
        s.add_scalar(10.0 * u.y + 3.0 * u.x * u.y)
    }

    fn hessian_by_input(
        &self,
        request: &HessianRequest<'_, 1, 2, 0>,
    ) -> Option<InputHessian<1, 2>> {
        let HessianRequest { w, kind, .. } = *request;
        let mixed = if kind == HessianKind::Exact { 3.0 * w.x } else { 0.0 };
        Some(InputHessian {
            by_state: Matrix::zeros(),
            by_input_state: Matrix::zeros(),
            by_input: Matrix::<2, 2>::new(0.0, mixed, mixed, 0.0),
        })
    }

    fn observe(&self, s: &Vector1<f64>) -> Vector1<f64> {
        *s
    }
}

#[test]
fn a_step_along_negative_curvature_behind_an_active_bound_is_not_taken() {
    let settings = MpcSettings::builder(1)
        .c_u([1.0, 1.0])
        .c_s([0.0])
        .c_s_end([0.1])
        .bounds([-5.0, -1.0], [5.0, 1.0])
        .solver(SolverTable { qp: QpKind::Riccati, iterations_max: 1, ..SolverTable::default() })
        .build(&Saddle)
        .unwrap();
    let mut mpc = Mpc::<_, 1, 2, 1, 0, 1>::new(Saddle, settings, 1.0).unwrap();
    // From `u = 0`: the costate is 1, the gradient (0, 10), the exact Hessian [[1, 3], [3, 2]], its determinant -7.
    let mut solve = |s_ref: f64| {
        mpc.plan.u.fill(Vector2::zeros());
        let problem = MpcProblem {
            s_0: &Vector1::zeros(),
            p: &Vector::zeros(),
            u_before: &Vector2::zeros(),
            s_ref: &[Vector1::new(s_ref)],
            u_given: &[],
            given_steps: [0; 2],
        };
        let report = mpc.solve(&problem, &mut || false).unwrap();
        assert_eq!((report.iterations, report.qp_fallbacks), (1, 0), "{report:?}");
        assert!(report.cost < report.cost_start, "{report:?}");
        mpc.plan()[0]
    };
    // All bounds inactive: a pivot is negative. It leaves the upper bound of `u_2` active.
    assert_eq!(solve(100.0), Vector2::new(0.0, 1.0));
    // With that bound all pivots are positive, and (-3, 1) is a saddle point uphill.
    assert_eq!(solve(-100.0), Vector2::new(0.0, -1.0));
}

/// `s' = s + u`: the quadratic problem is the whole problem.
#[derive(Debug, Clone, Copy)]
struct Sum;

impl Model<1, 1, 1, 0> for Sum {
    fn step(&self, s: &Vector1<f64>, u: &Vector1<f64>, _p: &Vector<0>, _dt_s: f64) -> Vector1<f64> {
        s + u
    }

    fn observe(&self, s: &Vector1<f64>) -> Vector1<f64> {
        *s
    }
}

#[test]
fn the_step_of_a_linear_system_is_that_of_its_quadratic_problem_solved_by_hand() {
    for qp in [QpKind::Riccati, QpKind::Clarabel] {
        // J = (u_0^2 + u_1^2) / 2 + (u_0 + u_1 - 3)^2 / 2: at u = 0 the gradient is (-3, -3) and the Hessian
        // [[2, 1], [1, 2]]. The step is (1, 1), its decrease 4.5 - 1.5; within a bound of 0.5 it is (0.5, 0.5).
        for (u_max, expected, cost) in [(5.0, 1.0, 1.5), (0.5, 0.5, 2.25)] {
            let solver = SolverTable { qp, iterations_max: 1, ..SolverTable::default() };
            let settings = MpcSettings::builder(2)
                .input_cost(InputCost::Absolute)
                .c_u([1.0])
                .c_s([0.0])
                .c_s_end([1.0])
                .bounds([-u_max], [u_max])
                .solver(solver)
                .build(&Sum)
                .unwrap();
            let mut mpc = Mpc::<_, 1, 1, 1, 0, 1>::new(Sum, settings, 1.0).unwrap();
            let problem = MpcProblem {
                s_0: &Vector1::zeros(),
                p: &Vector::zeros(),
                u_before: &Vector1::zeros(),
                s_ref: &[Vector1::new(3.0); 2],
                u_given: &[],
                given_steps: [0; 1],
            };
            let report = mpc.solve(&problem, &mut || false).unwrap();
            let gap = mpc.plan().iter().map(|u| (u.x - expected).abs()).fold(0.0, maximum);
            assert!(gap < 1e-7, "{qp:?}: {:?} instead of {expected}", mpc.plan());
            assert!((report.cost_start - 4.5).abs() < 1e-12, "{qp:?}: {report:?}");
            assert!((report.cost - cost).abs() < 1e-7, "{qp:?}: {report:?}");
        }
    }
}
