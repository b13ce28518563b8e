//! Time of one update of the moving horizon estimator, thesis window: 30 steps, four states.
//!
//! `cargo bench -p tello-estim`. The flight is simulated with noise, so that the robust loss works.

use divan::{Bencher, black_box};
use nalgebra::SVector;
use tello_estim::{ArrivalTable, LmTable, LossTable, Mhe, MheTable, Observed};
use tello_model::rows::{Pose, Sticks};
use tello_model::{Kinematic, Model};

const DT_S: f64 = 0.02;

fn main() {
    divan::main();
}

fn table(iterations_max: u32) -> MheTable {
    MheTable {
        window_steps: 30,
        c_o: vec![3.0, 3.0, 2.0, 0.5],
        c_s: vec![0.4, 0.4, 0.4, 0.2],
        c_p: vec![20.0, 20.0, 20.0, 100.0],
        p_prior: vec![1.29, 0.445, 0.994, 0.033],
        p_lb: vec![0.7, 0.2, 0.8, -0.5],
        p_ub: vec![1.5, 1.0, 1.2, 0.5],
        observation_loss: LossTable::Huber { scale: 1.0 },
        transition_loss: LossTable::None {},
        arrival: ArrivalTable::Fixed,
        shift_prior: false,
        solver: LmTable {
            damping_start: 1e-6,
            cost_tolerance: 1e-6,
            step_tolerance: 1e-8,
            iterations_max,
        },
    }
}

/// A started estimator and the flight that it is to follow.
#[expect(clippy::expect_used, reason = "there is nothing to measure with a table that is refused")]
fn flight(iterations_max: u32) -> (Mhe<Kinematic, 4, 4, 4, 4>, Vec<(Sticks, Observed<4>)>) {
    let table = table(iterations_max);
    let settings = table.check::<Kinematic, 4, 4, 4, 4>().expect("the table above is valid");
    let p = SVector::from_column_slice(&table.p_prior);
    let mut mhe = Mhe::new(Kinematic, settings, DT_S);
    let mut s = Pose::new(0.0, 0.0, 1.0, 3.0);
    mhe.start(&s);
    let steps: Vec<_> = (0..1000_u32)
        .map(|k| {
            let t = f64::from(k) * DT_S;
            let u = Sticks::new(0.5 * t.sin(), 0.4 * t.cos(), 0.3, 0.2 * (2.0 * t).sin());
            s = Kinematic.step(&s, &u, &p, DT_S);
            // Deterministic noise of a few millimetres, and now and then an outlier.
            let noise = f64::from(k * 7919 % 101) * 1e-4 + if k % 50 == 0 { 1.0 } else { 0.0 };
            (u, Observed::full(s + Pose::repeat(noise)))
        })
        .collect();
    (mhe, steps)
}

/// Mean over 1000 consecutive updates with at most `iterations_max` iterations each.
#[expect(clippy::expect_used, reason = "a refused update is not what is measured")]
#[divan::bench(args = [1, 2, 50])]
fn a_thousand_updates(bencher: Bencher<'_, '_>, iterations_max: u32) {
    let (mhe, steps) = flight(iterations_max);
    bencher
        .counter(divan::counter::ItemsCount::new(steps.len()))
        .with_inputs(|| mhe.clone())
        .bench_values(|mut mhe| {
            for (u, observed) in &steps {
                let cost = mhe.update(u, observed, &mut || false).map(|report| report.cost);
                black_box(cost).expect("a simulated flight is finite");
            }
            mhe
        });
}
