use horizon_model::{Bounds, Vector};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;

use super::*;

const NS: usize = 3;
const NP: usize = 2;
const LEN: usize = 7;
const SIZE: usize = LEN * NS + NP;

/// A random chain of rows `J` with its dense twin `J'J` and a random gradient.
fn random_chain(runner: &mut TestRunner) -> (Chain<NS, NP>, DMatrix<f64>, DVector<f64>) {
    let mut draw = || (-1.0..1.0_f64).new_tree(runner).unwrap().current();
    // Each state row touches its own block, the next one and the parameter.
    let mut j = DMatrix::<f64>::zeros(LEN * NS * 2, SIZE);
    for row in 0..j.nrows() {
        let k = row / (2 * NS);
        let end = ((k + 2) * NS).min(LEN * NS);
        for col in (k * NS..end).chain(LEN * NS..SIZE) {
            j[(row, col)] = draw();
        }
    }
    let dense = j.tr_mul(&j);
    let gradient = DVector::from_fn(SIZE, |_, _| draw());
    let mut chain = Chain::new(LEN);
    chain.clear(LEN);
    let p = LEN * NS;
    for (k, block) in chain.blocks_mut().iter_mut().enumerate() {
        block.diagonal = dense.fixed_view::<NS, NS>(k * NS, k * NS).into();
        if k > 0 {
            block.before = dense.fixed_view::<NS, NS>(k * NS, (k - 1) * NS).into();
        }
        block.border = dense.fixed_view::<NS, NP>(k * NS, p).into();
        block.gradient = gradient.fixed_rows::<NS>(k * NS).into();
    }
    chain.parameter_block.hessian = dense.fixed_view::<NP, NP>(p, p).into();
    chain.parameter_block.gradient = gradient.fixed_rows::<NP>(p).into();
    (chain, dense, gradient)
}

fn no_bounds() -> Bounds<NP> {
    Bounds { lo: Vector::repeat(f64::NEG_INFINITY), hi: Vector::repeat(f64::INFINITY) }
}

fn solve(chain: &mut Chain<NS, NP>, damping: f64, bounds: &Bounds<NP>) -> (DVector<f64>, f64) {
    let reduced = chain.eliminate(damping).unwrap();
    let (p_step, decrease) = reduced.solve(damping, &Vector::zeros(), bounds).unwrap();
    let mut d = DVector::zeros(SIZE);
    for (k, step) in chain.back_substitute(&p_step).iter().enumerate() {
        d.fixed_rows_mut::<NS>(k * NS).copy_from(step);
    }
    d.fixed_rows_mut::<NP>(LEN * NS).copy_from(&p_step);
    (d, decrease)
}

#[test]
fn a_chain_solves_like_its_dense_twin() {
    let mut runner = TestRunner::deterministic();
    for damping in [1e-3, 0.1, 10.0] {
        let (mut chain, dense, gradient) = random_chain(&mut runner);
        let (d, decrease) = solve(&mut chain, damping, &no_bounds());
        let damped = &dense + DMatrix::identity(SIZE, SIZE) * damping;
        let expected = -damped.clone().cholesky().unwrap().solve(&gradient);
        let gap = (&d - &expected).norm() / expected.norm();
        // The damping bounds the condition number by about 1e4.
        assert!(gap < 1e-11, "gap {gap:e} with damping {damping}");
        let model = -gradient.dot(&d) - 0.5 * d.dot(&(damped * &d));
        assert!((decrease - model).abs() < 1e-10 * model, "{decrease} instead of {model}");
        assert!((chain.diagonal_max() - dense.diagonal().max()).abs() < 1e-15);
    }
}

#[test]
fn the_covariance_of_the_last_state_is_that_of_the_dense_inverse() {
    let (mut chain, dense, _) = random_chain(&mut TestRunner::deterministic());
    let reduced = chain.eliminate(0.0).unwrap();
    let found = chain.last_covariance(&reduced).unwrap();
    let inverse = dense.cholesky().unwrap().inverse();
    let last = (LEN - 1) * NS;
    let expected = inverse.fixed_view::<NS, NS>(last, last);
    let gap = (found - expected).norm() / expected.norm();
    assert!(gap < 1e-10, "gap {gap:e}");
    let nothing = Chain::<NS, NP>::new(LEN);
    assert_eq!(nothing.last_covariance(&reduced), Err(NotPositive));
}

#[test]
fn a_bound_is_kept_and_the_states_follow() {
    let (mut chain, dense, gradient) = random_chain(&mut TestRunner::deterministic());
    let (free, _) = solve(&mut chain, 0.1, &no_bounds());
    let mut bounds = no_bounds();
    let half = 0.5 * free[LEN * NS];
    bounds.lo[0] = half.min(0.0);
    bounds.hi[0] = half.max(0.0);
    let (d, decrease) = solve(&mut chain, 0.1, &bounds);
    assert_eq!(d[LEN * NS].to_bits(), half.to_bits());
    let damped = dense + DMatrix::identity(SIZE, SIZE) * 0.1;
    let optimality = &damped * &d + &gradient;
    for row in (0..SIZE).filter(|row| *row != LEN * NS) {
        assert!(optimality[row].abs() < 1e-12, "row {row}: gradient {:e}", optimality[row]);
    }
    let model = -gradient.dot(&d) - 0.5 * d.dot(&(damped * &d));
    assert!((decrease - model).abs() < 1e-10 * model, "{decrease} instead of {model}");
}

#[test]
fn two_halves_with_a_common_parameter_solve_like_one_problem() {
    let mut runner = TestRunner::deterministic();
    let (mut left, ..) = random_chain(&mut runner);
    let (mut right, ..) = random_chain(&mut runner);
    let mut shared = left.eliminate(0.1).unwrap();
    shared += &right.eliminate(0.1).unwrap();
    let (p_step, _) = shared.solve(0.1, &Vector::zeros(), &no_bounds()).unwrap();
    let mut gradient = p_step * 0.1;
    for chain in [&mut left, &mut right] {
        let steps = chain.back_substitute(&p_step).to_vec();
        gradient += chain.parameter_block.hessian * p_step + chain.parameter_block.gradient;
        for (block, step) in chain.blocks_mut().iter().zip(&steps) {
            gradient += block.border.tr_mul(step);
        }
    }
    assert!(gradient.norm() < 1e-11, "gradient by the shared parameter {:e}", gradient.norm());
}

#[test]
fn a_pinned_state_stays() {
    let (mut chain, ..) = random_chain(&mut TestRunner::deterministic());
    chain.pin(2);
    let (d, _) = solve(&mut chain, 0.1, &no_bounds());
    assert_eq!(d.fixed_rows::<NS>(2 * NS).norm().to_bits(), 0.0_f64.to_bits());
    assert!(d.fixed_rows::<NS>(3 * NS).norm() > 0.0);
}

#[test]
fn nan_and_singular_blocks_are_refused() {
    let (mut chain, ..) = random_chain(&mut TestRunner::deterministic());
    chain.blocks_mut()[3].diagonal[(1, 1)] = f64::NAN;
    assert_eq!(chain.eliminate(0.1), Err(NotPositive));
    assert!(chain.diagonal_max().is_nan());
    chain.clear(LEN);
    assert_eq!(chain.eliminate(0.0), Err(NotPositive));
}
