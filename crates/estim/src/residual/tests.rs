//! Gradient and Hessian, as assembled, against differences of the cost and of the gradient.

use std::f64::consts::PI;

use horizon_model::check::jacobian_gap;
use horizon_model::rows::{Pose, Sticks, pose};
use horizon_model::{Kinematic, Vector};

use super::*;

type Vehicle = Residuals<Kinematic, 4, 4, 4, 4>;

const DT_S: f64 = 0.02;

fn residuals(observation_loss: Loss, transition_loss: Loss) -> Vehicle {
    Residuals {
        model: Kinematic,
        dt_s: DT_S,
        c_o: Vector::from([3.0, 2.5, 2.0, 0.5]),
        c_s: Vector::from([0.4, 0.5, 0.3, 0.2]),
        observation_loss,
        transition_loss,
    }
}

fn parameter() -> Vector<4> {
    Vector::from([1.29, 0.445, 0.994, -0.4])
}

/// Poses whose headings lie on both sides of every wrap.
fn poses() -> impl Iterator<Item = Pose> {
    [-9.0, -PI, -0.7, 0.0, 1.2, PI - 1e-9, PI, PI + 1e-9, 7.0]
        .map(|theta| Pose::new(0.4, -1.2, 1.3, theta))
        .into_iter()
}

/// A short trajectory that neither the observations nor the model explain.
fn path_data() -> (Vec<Pose>, Vec<Sticks>, Vec<Observed<4>>) {
    let s: Vec<Pose> = poses().collect();
    let u = (1..s.len()).map(|k| Sticks::repeat(0.1 * k as f64 - 0.4)).collect();
    let mut o: Vec<_> =
        s.iter().map(|s| Observed::full(s + Pose::new(0.3, -0.2, 0.1, 0.4))).collect();
    o[3] = Observed::missing();
    o[5].is_present[pose::THETA] = false;
    o[5].o[pose::THETA] = f64::NAN;
    (s, u, o)
}

#[test]
fn the_assembled_gradient_is_the_derivative_of_the_cost() {
    let robust = [
        (Loss::None, Loss::None),
        (Loss::Huber { scale: 1.0 }, Loss::Tukey { scale: 30.0 }),
        (Loss::Tukey { scale: 3.0 }, Loss::Huber { scale: 2.0 }),
    ];
    for (observation_loss, transition_loss) in robust {
        let blocks = residuals(observation_loss, transition_loss);
        let (s, u, o) = path_data();
        let p = parameter();
        let mut chain = Chain::new(s.len());
        chain.clear(s.len());
        let cost = blocks
            .accumulate(&Iterate { s: &s, u: &u, o: &o, p: &p }, Curvature::GaussNewton, &mut chain)
            .unwrap();
        let again = blocks.cost(&Iterate { s: &s, u: &u, o: &o, p: &p });
        assert!((cost - again).abs() < 1e-12 * cost, "{cost} and {again}");

        let by_parameter = chain.parameter_block.gradient.transpose();
        let cost_of_p =
            |p: &Vector<4>| Vector::from([blocks.cost(&Iterate { s: &s, u: &u, o: &o, p })]);
        let gap = jacobian_gap(cost_of_p, &p, &by_parameter);
        assert!(gap < 1e-6, "{transition_loss:?}: gap {gap:e} by p");
        for k in 0..s.len() {
            let cost_of_s = |s_k: &Pose| {
                let mut s = s.clone();
                s[k] = *s_k;
                Vector::from([blocks.cost(&Iterate { s: &s, u: &u, o: &o, p: &p })])
            };
            let by_state = chain.blocks_mut()[k].gradient.transpose();
            let gap = jacobian_gap(cost_of_s, &s[k], &by_state);
            assert!(gap < 1e-6, "{observation_loss:?}: gap {gap:e} by s[{k}]");
        }
    }
}

/// The chain that the blocks make of an iterate.
fn assembled(
    blocks: &Vehicle,
    curvature: Curvature,
    iterate: &Iterate<'_, 4, 4, 4, 4>,
) -> Chain<4, 4> {
    let mut chain = Chain::new(iterate.s.len());
    chain.clear(iterate.s.len());
    blocks.accumulate(iterate, curvature, &mut chain).unwrap();
    chain
}

/// Compares every block of the Hessian with differences of the assembled gradient.
fn assert_curvature(blocks: &Vehicle, curvature: Curvature, iterate: &Iterate<'_, 4, 4, 4, 4>) {
    let Iterate { s, u, o, p } = *iterate;
    let mut chain = assembled(blocks, curvature, iterate);
    let by_p = |p: &Vector<4>| assembled(blocks, curvature, &Iterate { s, u, o, p });
    // Relative to the largest entries, (C_s / dt)^2 = 625.
    let gap = jacobian_gap(|p| by_p(p).parameter_block.gradient, p, &chain.parameter_block.hessian);
    assert!(gap < 1e-6, "parameter_block: gap {gap:e}");
    for k in 1..s.len() {
        let by_s = |at: usize, value: &Pose| {
            let mut s = s.to_vec();
            s[at] = *value;
            let iterate = Iterate { s: &s, u, o, p };
            assembled(blocks, curvature, &iterate).blocks_mut()[k].gradient
        };
        let block = chain.blocks_mut()[k];
        let gaps = [
            jacobian_gap(|s_k| by_s(k, s_k), &s[k], &block.diagonal),
            jacobian_gap(|s_before| by_s(k - 1, s_before), &s[k - 1], &block.before),
            jacobian_gap(|p| by_p(p).blocks_mut()[k].gradient, p, &block.border),
        ];
        for (name, gap) in ["diagonal", "before", "border"].iter().zip(gaps) {
            assert!(gap < 1e-6, "{name} of block {k}: gap {gap:e}");
        }
    }
}

#[test]
fn the_exact_curvature_is_the_derivative_of_the_gradient_whatever_the_residuals() {
    for (observation_loss, transition_loss) in [
        (Loss::None, Loss::None),
        // Convex, with most residuals in the linear part.
        (Loss::Huber { scale: 1.0 }, Loss::None),
        (Loss::None, Loss::Huber { scale: 2.0 }),
        (Loss::Huber { scale: 0.3 }, Loss::Huber { scale: 0.5 }),
    ] {
        let blocks = residuals(observation_loss, transition_loss);
        let (s, u, o) = path_data();
        let p = parameter();
        assert_curvature(&blocks, Curvature::Exact, &Iterate { s: &s, u: &u, o: &o, p: &p });
    }
}

#[test]
fn the_assembled_curvature_is_the_derivative_of_the_gradient_where_residuals_vanish() {
    let blocks = residuals(Loss::Huber { scale: 1.0 }, Loss::None);
    let (_, u, _) = path_data();
    let p = parameter();
    let mut s = vec![Pose::new(0.4, -1.2, 1.3, 3.0)];
    for (k, u) in u.iter().enumerate() {
        s.push(blocks.model.step(&s[k], u, &p, DT_S));
    }
    let o: Vec<_> = s.iter().map(|s| Observed::full(*s)).collect();
    assert_curvature(&blocks, Curvature::GaussNewton, &Iterate { s: &s, u: &u, o: &o, p: &p });
}

#[test]
fn absent_rows_weigh_nothing() {
    let blocks = residuals(Loss::None, Loss::None);
    let (s, u, o) = path_data();
    let mut without = o.clone();
    without[0] = Observed::missing();
    let p = parameter();
    let cost = |o: &[Observed<4>]| blocks.cost(&Iterate { s: &s, u: &u, o, p: &p });
    let expected = 0.5 * blocks.observation(&s[0], &o[0]).norm_squared();
    assert!((cost(&o) - cost(&without) - expected).abs() < 1e-9 * cost(&o));
}

#[test]
fn a_residual_that_is_not_finite_is_named() {
    let blocks = residuals(Loss::Tukey { scale: 1.0 }, Loss::Tukey { scale: 1.0 });
    let (mut s, u, o) = path_data();
    let p = parameter();
    let mut chain = Chain::new(s.len());
    chain.clear(s.len());
    s[3][pose::Z] = f64::NAN;
    let error = blocks
        .accumulate(&Iterate { s: &s, u: &u, o: &o, p: &p }, Curvature::GaussNewton, &mut chain)
        .unwrap_err();
    // State 3 is not observed; the first block that meets it is the transition into it.
    assert_eq!(error, LmError::NonFinite { block: "r_dyn", k: 3 });
}
