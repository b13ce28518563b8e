//! Error and time of the derivatives of the thesis' vehicle by hand, by dual numbers, of compiled expressions and by
//! differences.
//!
//! `cargo bench -p horizon-model --features dual --bench derivatives` prints them, with ratios to by hand;
//! it fails if an error is larger than documented.

use std::hint::black_box;
use std::time::Instant;

use horizon_model::check::{amax, maximum};
use horizon_model::expression::{Binary, Compiled, Graph, Program, Unary, Variable};
use horizon_model::{Dual, DualModel, Kinematic, Linearized, Model, Scalar};
use nalgebra::SVector;

const DT_S: f64 = 0.02;
const RUNS: u32 = 200_000;

/// [`Kinematic`] with no derivative.
#[derive(Debug, Clone, Copy)]
struct Plain;

impl DualModel<4, 4, 4, 4> for Plain {
    fn step<D: Scalar>(
        &self,
        s: &SVector<D, 4>,
        u: &SVector<D, 4>,
        p: &SVector<D, 4>,
        dt_s: f64,
    ) -> SVector<D, 4> {
        let ([x, y, z, theta], [lambda_h, lambda_v, lambda_a, theta_0]): ([D; 4], [D; 4]) =
            ((*s).into(), (*p).into());
        let [roll, pitch, yaw, throttle] = (*u).into();
        let (sin, cos) = (theta + theta_0).sin_cos();
        SVector::from([
            x + lambda_h * (cos * pitch + sin * roll) * dt_s,
            y + lambda_h * (sin * pitch - cos * roll) * dt_s,
            z + lambda_v * throttle * dt_s,
            theta + lambda_a * yaw * dt_s,
        ])
    }

    fn observe<D: Scalar>(&self, s: &SVector<D, 4>) -> SVector<D, 4> {
        *s
    }
}

impl Model<4, 4, 4, 4> for Plain {
    fn step(
        &self,
        s: &SVector<f64, 4>,
        u: &SVector<f64, 4>,
        p: &SVector<f64, 4>,
        dt_s: f64,
    ) -> SVector<f64, 4> {
        DualModel::step(self, s, u, p, dt_s)
    }

    fn observe(&self, s: &SVector<f64, 4>) -> SVector<f64, 4> {
        *s
    }
}

/// [`Kinematic`] as a graph of expressions.
fn compiled() -> Option<Compiled<4, 4, 4, 4>> {
    use Binary::{Add, Mul, Sub};
    let mut graph = Graph::default();
    let s = [0, 1, 2, 3].map(|row| graph.variable(Variable::State(row)));
    let [roll, pitch, yaw, throttle] = [0, 1, 2, 3].map(|row| graph.variable(Variable::Input(row)));
    let [lambda_h, lambda_v, lambda_a, theta_0] =
        [0, 1, 2, 3].map(|row| graph.variable(Variable::Parameter(row)));
    let dt = graph.variable(Variable::Period);
    let [.., theta] = s;
    let psi = graph.binary(Add, theta, theta_0);
    let (sin, cos) = (graph.unary(Unary::Sin, psi), graph.unary(Unary::Cos, psi));
    let products = [(cos, pitch), (sin, roll), (sin, pitch), (cos, roll)];
    let [a, b, c, d] = products.map(|(left, right)| graph.binary(Mul, left, right));
    let rates = [graph.binary(Add, a, b), graph.binary(Sub, c, d), throttle, yaw];
    let gains = [lambda_h, lambda_h, lambda_v, lambda_a];
    let mut next = s;
    for (next, (rate, gain)) in next.iter_mut().zip(rates.into_iter().zip(gains)) {
        let velocity = graph.binary(Mul, gain, rate);
        let way = graph.binary(Mul, velocity, dt);
        *next = graph.binary(Add, *next, way);
    }
    let program = Program::compile(&mut graph, &next, &s, (4, 4)).ok()?;
    Compiled::new(Box::leak(Box::new(program)))
}

/// Derivatives at one point in flight, and the time of one of them. s
#[expect(clippy::disallowed_methods, reason = "a bench measures time")]
fn measured(model: impl Model<4, 4, 4, 4>) -> (Linearized<4, 4>, f64) {
    let s = [0.4, -1.2, 1.3, 0.7].into();
    let (u, p) = ([0.3, -0.4, 0.2, 0.5].into(), [1.29, 0.445, 0.994, 0.03].into());
    let start = Instant::now();
    for _ in 0..RUNS {
        black_box(model.linearize(black_box(&s), black_box(&u), black_box(&p), DT_S));
    }
    (model.linearize(&s, &u, &p, DT_S), start.elapsed().as_secs_f64() / f64::from(RUNS))
}

fn main() {
    let (exact, hand_s) = measured(Kinematic);
    println!("{:<12} {:>10} {:>10} {:>8}", "derivatives", "error", "time, ns", "ratio");
    for (name, (found, time_s)) in [
        ("by hand", (exact, hand_s)),
        ("dual", measured(Dual(Plain))),
        ("compiled", compiled().map_or((exact, f64::NAN), measured)),
        ("differences", measured(Plain)),
    ] {
        let by_state = amax(&(found.by_state - exact.by_state));
        let error = maximum(by_state, amax(&(found.by_parameter - exact.by_parameter)));
        let bound = if name == "differences" { 1e-9 } else { 1e-15 };
        assert!(error <= bound, "{name}: error {error:e}");
        println!("{name:<12} {error:>10.1e} {:>10.1} {:>8.1}", time_s * 1e9, time_s / hand_s);
    }
}
