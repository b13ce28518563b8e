//! The choice of the Hessian where an active bound hides a direction of negative curvature.

use horizon_model::{HessianKind, HessianRequest, InputHessian, Model};
use horizon_model::{Matrix, Vector};
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
