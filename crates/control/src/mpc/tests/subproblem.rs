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

/// `s' = s + 10 u + c u^2 / 2` with `c` = `curvature`: with the costate `w` the exact Hessian by the input is `w c`
/// more than that of Gauss-Newton, and the convexified one is that of Gauss-Newton.
#[derive(Debug, Clone, Copy)]
struct Curved {
    curvature: f64,
}

impl Model<1, 1, 1, 0> for Curved {
    fn step(&self, s: &Vector1<f64>, u: &Vector1<f64>, _p: &Vector<0>, _dt_s: f64) -> Vector1<f64> {
        s.add_scalar(10.0 * u.x + 0.5 * self.curvature * u.x.powi(2))
    }

    fn hessian_by_input(
        &self,
        request: &HessianRequest<'_, 1, 1, 0>,
    ) -> Option<InputHessian<1, 1>> {
        let HessianRequest { w, kind, .. } = *request;
        let by_input = if kind == HessianKind::Exact { w.x * self.curvature } else { 0.0 };
        Some(InputHessian {
            by_state: Matrix::zeros(),
            by_input_state: Matrix::zeros(),
            by_input: Matrix::<1, 1>::new(by_input),
        })
    }

    fn observe(&self, s: &Vector1<f64>) -> Vector1<f64> {
        *s
    }
}

#[test]
fn a_step_whose_descent_is_half_of_its_predicted_decrease_is_taken() {
    // From `u = 0` to 100 with the bound `u` = 8 active: the costate is -1, the gradient -10, the exact Hessian 2 - c,
    // so the descent is 80 and the decrease 80 + 32 (c - 2). Convexified, the Hessian is 2 and the minimum at 5.
    let planned = |curvature: f64| {
        let model = Curved { curvature };
        let settings = MpcSettings::builder(1)
            .c_u([1.0])
            .c_s([0.0])
            .c_s_end([0.1])
            .bounds([-8.0], [8.0])
            .solver(SolverTable {
                qp: QpKind::Riccati,
                iterations_max: 1,
                ..SolverTable::default()
            })
            .build(&model)
            .unwrap();
        let mut mpc = Mpc::<_, 1, 1, 1, 0, 1>::new(model, settings, 1.0).unwrap();
        // The first plan leaves the bound active.
        for s_ref in [1000.0, 100.0] {
            mpc.plan.u.fill(Vector1::zeros());
            let problem = MpcProblem {
                s_0: &Vector1::zeros(),
                p: &Vector::zeros(),
                u_before: &Vector1::zeros(),
                s_ref: &[Vector1::new(s_ref)],
                u_given: &[],
                given_steps: [0],
            };
            let report = mpc.solve(&problem, &mut || false).unwrap();
            assert_eq!((report.iterations, report.qp_fallbacks), (1, 0), "{report:?}");
        }
        mpc.plan()[0].x
    };
    // The line search halves the step to the bound.
    for (curvature, expected) in [(4.49, 4.0), (4.51, 5.0)] {
        let u = planned(curvature);
        assert!((u - expected).abs() < 1e-6, "{curvature}: {u} instead of {expected}");
    }
}
