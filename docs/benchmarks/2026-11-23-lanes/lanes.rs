//! What several problems per core bring to the stage-wise recursion: a copy of its arithmetic with 1, 4 and 8
//! problems in the lanes of one number, against the scalar one, in one run.
//!
//! Commands: README.md. 8 states, 4 inputs, 14 stages, coupled neighbouring inputs, no active bounds, no second
//! derivatives and penalties: the common case of `crates/control/src/qp/riccati/recursion.rs`. Dynamics
//! are as sparse as those of the lagged vehicle. Each lane must have the bits of the scalar recursion.

use std::array::from_fn;
use std::hint::black_box;
use std::ops::{Add, Div, Mul, Neg};
use std::time::Instant;

use wide::{f64x4, f64x8};

const NS: usize = 8;
const NU: usize = 4;
const STAGES: usize = 14;
/// Problems that each variant solves in a pass.
const PROBLEMS: usize = 64;
const PASSES: usize = 4000;

/// A number, or one number of each of several problems; the default is zero.
trait Number: Copy + Default + From<f64> + Add<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self> {
    const LANES: usize;
    fn of(lanes: &dyn Fn(usize) -> f64) -> Self;
    fn lane(self, lane: usize) -> f64;
    fn is_zero(self) -> bool;
}

macro_rules! number {
    ($type:ty, $lanes:expr, $of:expr, $lane:expr, $is_zero:expr) => {
        impl Number for $type {
            const LANES: usize = $lanes;
            fn of(lanes: &dyn Fn(usize) -> f64) -> Self { $of(lanes) }
            fn lane(self, lane: usize) -> f64 { $lane(self, lane) }
            #[inline(always)]
            fn is_zero(self) -> bool { $is_zero(self) }
        }
    };
}

number!(f64, 1, |of: &dyn Fn(usize) -> f64| of(0), |x, _| x, |x| x == 0.0);
number!(f64x4, 4, |of| Self::new(from_fn(of)), |x: Self, lane: usize| x.to_array()[lane],
    |x: Self| x.simd_eq(f64x4::ZERO).to_bitmask() == 15);
number!(f64x8, 8, |of| Self::new(from_fn(of)), |x: Self, lane: usize| x.to_array()[lane],
    |x: Self| x.simd_eq(f64x8::ZERO).to_bitmask() == 255);
/// Columns of rows.
type Matrix<T, const R: usize, const C: usize> = [[T; R]; C];
#[inline(always)]
fn add_mul<T: Number, const R: usize, const K: usize, const C: usize>(sum: &mut Matrix<T, R, C>, a: &Matrix<T, R, K>, b: &Matrix<T, K, C>) {
    for (column, b) in sum.iter_mut().zip(b) {
        let mut entries = *column;
        for (a, b) in a.iter().zip(b) {
            if !b.is_zero() {
                entries.iter_mut().zip(a).for_each(|(entry, a)| *entry = *entry + *b * *a);
            }
        }
        *column = entries;
    }
}
#[inline(always)]
fn mul<T: Number, const R: usize, const K: usize, const C: usize>(a: &Matrix<T, R, K>, b: &Matrix<T, K, C>) -> Matrix<T, R, C> {
    let mut product = [[T::default(); R]; C];
    add_mul(&mut product, a, b);
    product
}
#[inline(always)]
fn transpose<T: Number, const R: usize, const C: usize>(a: &Matrix<T, R, C>) -> Matrix<T, C, R> {
    from_fn(|row| from_fn(|col| a[col][row]))
}
#[inline(always)]
fn add<T: Number, const R: usize, const C: usize>(sum: &mut Matrix<T, R, C>, a: &Matrix<T, R, C>) {
    sum.as_flattened_mut().iter_mut().zip(a.as_flattened()).for_each(|(sum, a)| *sum = *sum + *a);
}
/// One stage of `T::LANES` problems. Dynamics, diagonal of the cost, coupling, gradients.
#[derive(Clone, Copy)]
struct Stage<T> {
    a: Matrix<T, NS, NS>, b: Matrix<T, NS, NU>,
    s: [T; NS], u: [T; NU], coupling: [T; NU],
    g_s: Matrix<T, NS, 1>, g_u: Matrix<T, NU, 1>,
}
/// Cost to go.
#[derive(Clone, Copy, Default)]
struct Value<T> {
    by_state: Matrix<T, NS, NS>, gradient: Matrix<T, NS, 1>, by_state_before: Matrix<T, NS, NU>,
    by_before: Matrix<T, NU, NU>, gradient_before: Matrix<T, NU, 1>,
}
/// `qp::riccati::recursion::eliminate` without active bounds, second derivatives and penalties.
#[inline(always)]
fn eliminate<T: Number>(stage: &Stage<T>, next: &Value<T>) -> Value<T> {
    let Stage { a, b, .. } = stage;
    let mut hessian = next.by_state;
    (0..NS).for_each(|i| hessian[i][i] = hessian[i][i] + stage.s[i]);
    let (mut gradient, mut by_input) = (next.gradient, [[T::default(); NU]; NU]);
    add(&mut gradient, &stage.g_s);
    let mut through = mul(&hessian, b);
    (0..NU).for_each(|i| by_input[i][i] = stage.u[i]);
    let mut offset = stage.g_u;
    add_mul(&mut offset, &transpose(b), &gradient);
    add(&mut through, &next.by_state_before);
    add(&mut by_input, &next.by_before);
    add_mul(&mut by_input, &transpose(b), &next.by_state_before);
    add(&mut offset, &next.gradient_before);
    let through = transpose(&through);
    add_mul(&mut by_input, &through, b);
    let (by_state, mut by_before) = (mul(&through, a), [[T::default(); NU]; NU]);
    (0..NU).for_each(|i| by_before[i][i] = stage.coupling[i]);
    (0..NU).for_each(|i| invert(&mut by_input, i));
    let (policy, offset) = (mul(&by_input, &by_state), mul(&by_input, &offset));
    let (taken, policy_before) = (transpose(&by_state), mul(&by_input, &by_before));
    let mut value = Value {
        by_state: mul(&transpose(&mul(&hessian, a)), a),
        gradient: mul(&transpose(a), &gradient),
        by_state_before: mul(&taken, &policy_before),
        by_before: mul(&by_before, &policy_before),
        gradient_before: mul(&by_before, &offset),
    };
    add_mul(&mut value.gradient, &taken, &offset);
    add_mul(&mut value.by_state, &taken, &policy);
    value
}
/// The symmetric pivot operator.
#[inline(always)]
fn invert<T: Number>(m: &mut Matrix<T, NU, NU>, i: usize) {
    let reciprocal = T::from(1.0) / m[i][i];
    let column = m[i];
    let mut scaled = column.map(|entry| entry * reciprocal);
    for j in (0..NU).filter(|j| *j != i) {
        let factor = -column[j];
        (0..NU).for_each(|row| m[j][row] = m[j][row] + factor * scaled[row]);
        m[j][i] = scaled[j];
    }
    scaled[i] = -reciprocal;
    m[i] = scaled;
}
/// Stage `k` of problem `problem`: a lagged vehicle, whose heading turns its body into the world.
fn stage<T: Number>(first: usize, k: usize) -> Stage<T> {
    let of = |value: &dyn Fn(f64) -> f64| T::of(&|lane| value(0.37 * (first + lane) as f64 + 0.11 * k as f64));
    let matrix = |row: usize, col: usize, x: f64| match (row, col) {
        _ if row == col => if row < 4 { 1.0 } else { 0.9 + 0.05 * x.sin() },
        (0, 4) | (1, 5) => 0.05 * x.cos(),
        (0, 5) | (1, 4) => 0.05 * x.sin(),
        (0, 3) | (1, 3) => 0.02 * (3.0 * x).sin(),
        (2, 6) | (3, 7) => 0.05,
        _ => 0.0,
    };
    Stage {
        a: from_fn(|col| from_fn(|row| of(&|x| matrix(row, col, x)))),
        b: from_fn(|col| from_fn(|row| of(&|x| if row == col + 4 { 0.1 + 0.02 * x.cos() } else { 0.0 }))),
        s: from_fn(|i| of(&|x| 1.0 + 0.3 * (x + i as f64).sin())),
        u: from_fn(|i| of(&|x| 0.2 + 0.1 * (x - i as f64).cos())),
        coupling: from_fn(|_| of(&|x| -0.05 - 0.01 * x.sin())),
        g_s: [from_fn(|i| of(&|x| (x * (i + 1) as f64).sin()))],
        g_u: [from_fn(|i| of(&|x| (x + i as f64).cos()))],
    }
}
type Problem<T> = [Stage<T>; STAGES];
fn problems<T: Number>() -> Vec<Problem<T>> {
    let of = |first| from_fn(|k| stage(first, k));
    (0..PROBLEMS).step_by(T::LANES).map(of).collect()
}
#[inline(never)]
fn recursion<T: Number>(problem: &Problem<T>) -> Value<T> {
    problem.iter().rev().fold(Value::default(), |value, stage| eliminate(stage, &value))
}
/// The bits of all results, problem by problem.
fn bits<T: Number>(problems: &[Problem<T>]) -> Vec<u64> {
    let of = |value: &Value<T>, lane: usize| -> Vec<u64> {
        let rows = value.by_state.as_flattened().iter().chain(&value.gradient[0]);
        let rows = rows.chain(value.by_state_before.as_flattened()).chain(&value.gradient_before[0]);
        rows.map(|entry| entry.lane(lane).to_bits()).collect()
    };
    let values = problems.iter().map(recursion);
    values.flat_map(|value| (0..T::LANES).flat_map(move |lane| of(&value, lane))).collect()
}
/// Time of a problem in one pass over all. ns
fn pass<T: Number>(problems: &[Problem<T>]) -> f64 {
    let start = Instant::now();
    for problem in problems {
        black_box(recursion(black_box(problem)));
    }
    start.elapsed().as_secs_f64() * 1e9 / PROBLEMS as f64
}

fn main() {
    let (one, four, eight) = (problems::<f64>(), problems::<f64x4>(), problems::<f64x8>());
    let scalar = bits(&one);
    assert!(scalar.iter().all(|bits| f64::from_bits(*bits).is_finite()));
    assert!(bits(&four) == scalar && bits(&eight) == scalar, "other bits");
    let mut best = [f64::INFINITY; 3];
    for _ in 0..PASSES {
        let times = [pass(&one), pass(&four), pass(&eight)];
        best = from_fn(|i| best[i].min(times[i]));
    }
    println!("same bits in every lane; shortest of {PASSES} passes, ns per problem of {STAGES} stages");
    for (name, time) in ["scalar", "4 lanes", "8 lanes"].iter().zip(best) {
        println!("{name:8} {time:7.0}  {:5.2}", best[0] / time);
    }
}
