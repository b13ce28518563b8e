//! Time of one step of each vehicle model, and of one step with its derivatives.
//!
//! `cargo bench -p horizon-model`. By three calls: what [`Model::linearize`] does by default.

use divan::{Bencher, black_box};
use horizon_model::rows::Sticks;
use horizon_model::{Kinematic, Lagged, Linearized, Model};
use nalgebra::SVector;

const DT_S: f64 = 0.02;

fn main() {
    divan::main();
}

fn sticks() -> Sticks {
    Sticks::new(0.3, -0.4, 0.2, 0.5)
}

/// State and parameter of the thesis' model in flight.
fn kinematic() -> (SVector<f64, 4>, SVector<f64, 4>) {
    ([0.4, -1.2, 1.3, 0.7].into(), [1.29, 0.445, 0.994, 0.03].into())
}

/// State and parameter of the lagged model in flight.
fn lagged() -> (SVector<f64, 11>, SVector<f64, 11>) {
    (
        [0.4, -1.2, 1.3, 0.7, 0.3, -0.2, 0.1, 0.5, 0.05, -0.04, 0.01].into(),
        [1.9, 0.89, 1.4, -0.06, 0.64, 0.25, 0.12, 0.07, 0.12, 0.08, 1.1].into(),
    )
}

#[divan::bench(sample_size = 1000)]
fn kinematic_step(bencher: Bencher<'_, '_>) {
    let ((s, p), u) = (kinematic(), sticks());
    bencher.bench_local(|| Kinematic.step(black_box(&s), black_box(&u), black_box(&p), DT_S));
}

#[divan::bench(sample_size = 1000)]
fn kinematic_linearize(bencher: Bencher<'_, '_>) {
    let ((s, p), u) = (kinematic(), sticks());
    bencher.bench_local(|| Kinematic.linearize(black_box(&s), black_box(&u), black_box(&p), DT_S));
}

#[divan::bench(sample_size = 1000)]
fn lagged_step(bencher: Bencher<'_, '_>) {
    let (model, (s, p), u) = (Lagged::default(), lagged(), sticks());
    bencher.bench_local(|| model.step(black_box(&s), black_box(&u), black_box(&p), DT_S));
}

#[divan::bench(sample_size = 1000)]
fn lagged_linearize(bencher: Bencher<'_, '_>) {
    let (model, (s, p), u) = (Lagged::default(), lagged(), sticks());
    bencher.bench_local(|| model.linearize(black_box(&s), black_box(&u), black_box(&p), DT_S));
}

#[divan::bench(sample_size = 1000)]
fn lagged_linearize_by_three_calls(bencher: Bencher<'_, '_>) {
    let (model, (s, p), u) = (Lagged::default(), lagged(), sticks());
    bencher.bench_local(|| {
        let (s, u, p) = (black_box(&s), black_box(&u), black_box(&p));
        Linearized {
            s_next: model.step(s, u, p, DT_S),
            by_state: model.step_by_state(s, u, p, DT_S),
            by_parameter: model.step_by_parameter(s, u, p, DT_S),
        }
    });
}
