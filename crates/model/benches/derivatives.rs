//! Error and time of the derivatives of the thesis' vehicle by hand, by dual numbers and by differences.
//!
//! `cargo bench -p horizon-model --features dual --bench derivatives` prints the three, with ratios to by hand;
//! it fails if an error is larger than documented.

use std::hint::black_box;
use std::time::Instant;

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
        let (sin, cos) = (s[3] + p[3]).sin_cos();
        SVector::from([
            s[0] + p[0] * (cos * u[1] + sin * u[0]) * dt_s,
            s[1] + p[0] * (sin * u[1] - cos * u[0]) * dt_s,
            s[2] + p[1] * u[3] * dt_s,
            s[3] + p[2] * u[2] * dt_s,
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
        ("differences", measured(Plain)),
    ] {
        let by_state = (found.by_state - exact.by_state).amax();
        let error = by_state.max((found.by_parameter - exact.by_parameter).amax());
        let bound = if name == "differences" { 1e-9 } else { 1e-15 };
        assert!(error <= bound, "{name}: error {error:e}");
        println!("{name:<12} {error:>10.1e} {:>10.1} {:>8.1}", time_s * 1e9, time_s / hand_s);
    }
}
