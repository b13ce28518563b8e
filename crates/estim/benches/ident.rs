//! Time of an identification over the size of its data: as many pieces as the thesis has, and 4 and 16
//! times as many.
//!
//! `cargo bench -p horizon-estim --bench ident`. The flights are simulated, with noise of a fixed seed.

use divan::{Bencher, black_box};
use horizon_estim::{Curvature, Ident, IdentSettings, LmTable, Observed, Piece};
use horizon_model::rows::{Pose, Sticks};
use horizon_model::{Kinematic, Model};
use nalgebra::SVector;

const DT_S: f64 = 0.02;

/// Pieces and steps per piece of the thesis' identification.
const PIECES: u32 = 89;
const STEPS: u32 = 311;

fn main() {
    divan::main();
}

#[expect(
    clippy::expect_used,
    reason = "there is nothing to measure with settings that are refused"
)]
fn settings(curvature: Curvature, iterations_max: u32) -> IdentSettings<4, 4, 4> {
    IdentSettings::builder([0.9, 0.6, 0.9, 0.0])
        .c_o([3.0, 3.0, 2.0, 0.3])
        .c_s([1.0, 1.0, 0.1, 0.3])
        .c_p([1.0; 4])
        .bounds([0.1, 0.1, 0.1, -3.0], [10.0, 10.0, 10.0, 3.0])
        .curvature(curvature)
        .solver(LmTable {
            damping_start: 1e-8,
            cost_tolerance: 1e-8,
            step_tolerance: 1e-10,
            iterations_max,
        })
        .build(&Kinematic)
        .expect("each weight is in its range")
}

/// Flights that the model explains up to noise of a few centimetres.
fn pieces(count: u32) -> Vec<Piece<4, 4>> {
    let p = SVector::from([1.29, 0.445, 0.994, 0.033]);
    let piece = |piece: u32| {
        let mut s = Pose::new(0.0, 0.0, 1.0, f64::from(piece % 6));
        let (mut u, mut o) = (Vec::new(), Vec::new());
        for k in 0..STEPS {
            let t = f64::from(k) * DT_S + f64::from(piece);
            let sticks = Sticks::new(0.5 * t.sin(), 0.4 * t.cos(), 0.3, 0.2 * (2.0 * t).sin());
            let noise = f64::from((piece * STEPS + k) * 7919 % 101) * 1e-3;
            o.push(Observed::full(s + Pose::repeat(noise)));
            s = Kinematic.step(&s, &sticks, &p, DT_S);
            u.push(sticks);
        }
        Piece { u, o }
    };
    (0..count).map(piece).collect()
}

#[expect(clippy::expect_used, reason = "there is nothing to measure without pieces")]
fn ident(settings: &IdentSettings<4, 4, 4>, times: u32) -> Ident<Kinematic, 4, 4, 4, 4> {
    Ident::new(Kinematic, settings, DT_S, pieces(PIECES * times)).expect("the pieces are finite")
}

/// Solves from the start and counts steps of data.
#[expect(clippy::expect_used, reason = "a solve that fails is not what is measured")]
fn measure(bencher: Bencher<'_, '_>, settings: &IdentSettings<4, 4, 4>, times: u32) {
    let mut ident = ident(settings, times);
    bencher.counter(divan::counter::ItemsCount::new(PIECES * times * STEPS)).bench_local(|| {
        ident.start();
        black_box(ident.solve(&mut || false)).expect("simulated flights are finite").cost
    });
}

/// One iteration, with the pass that starts a solve.
#[divan::bench(args = [1, 4, 16])]
fn one_iteration(bencher: Bencher<'_, '_>, times: u32) {
    measure(bencher, &settings(Curvature::GaussNewton, 1), times);
}

/// Until the cost no longer changes.
#[divan::bench(args = [1, 4, 16])]
fn whole_solve(bencher: Bencher<'_, '_>, times: u32) {
    measure(bencher, &settings(Curvature::Exact, 100), times);
}
