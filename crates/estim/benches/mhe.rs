//! Time of one update of the moving horizon estimator: the thesis' window of 30 steps with four states,
//! and the vehicle with lag under a carried arrival cost, eleven states and eleven parameters.
//!
//! `cargo bench -p horizon-estim`. The flights are simulated with noise, so that the robust loss works.

use divan::{Bencher, black_box};
use horizon_estim::{ArrivalTable, LmTable, LossTable, Mhe, MheSettings, Observed};
use horizon_model::rows::{Pose, Sticks, lag, motion, pose, stick};
use horizon_model::setting::SettingError;
use horizon_model::{Kinematic, Lagged, Model};
use nalgebra::SVector;

const DT_S: f64 = 0.02;

type LaggedMhe = Mhe<Lagged, { motion::COUNT }, { stick::COUNT }, { pose::COUNT }, { lag::COUNT }>;

fn main() {
    divan::main();
}

/// The expected parameter, with which the flights are simulated.
const P: [f64; 4] = [1.29, 0.445, 0.994, 0.033];

fn settings(iterations_max: u32) -> Result<MheSettings<4, 4, 4>, SettingError> {
    MheSettings::builder(P)
        .c_o([3.0, 3.0, 2.0, 0.5])
        .c_s([0.4, 0.4, 0.4, 0.2])
        .c_p([20.0, 20.0, 20.0, 100.0])
        .bounds([0.7, 0.2, 0.8, -0.5], [1.5, 1.0, 1.2, 0.5])
        .losses(LossTable::Huber { scale: 1.0 }, LossTable::None {})
        .arrival(ArrivalTable::Fixed)
        .solver(LmTable {
            damping_start: 1e-6,
            cost_tolerance: 1e-6,
            step_tolerance: 1e-8,
            iterations_max,
        })
        .build(&Kinematic)
}

/// A started estimator and the flight that it is to follow.
#[expect(
    clippy::expect_used,
    reason = "there is nothing to measure with settings that are refused"
)]
fn flight(iterations_max: u32) -> (Mhe<Kinematic, 4, 4, 4, 4>, Vec<(Sticks, Observed<4>)>) {
    let settings = settings(iterations_max).expect("each weight is in its range");
    let p = SVector::from(P);
    let mut mhe = Mhe::new(Kinematic, settings, DT_S).expect("the period is positive");
    let mut s = Pose::new(0.0, 0.0, 1.0, 3.0);
    mhe.start(&s).expect("the pose is finite");
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

/// Times the updates of a whole flight, each time from the same start.
#[expect(clippy::expect_used, reason = "a refused update is not what is measured")]
fn follow<M, const NS: usize, const NP: usize>(
    bencher: Bencher<'_, '_>,
    mhe: &Mhe<M, NS, { stick::COUNT }, { pose::COUNT }, NP>,
    steps: &[(Sticks, Observed<{ pose::COUNT }>)],
) where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP> + Clone + Sync,
{
    bencher
        .counter(divan::counter::ItemsCount::new(steps.len()))
        .with_inputs(|| mhe.clone())
        .bench_values(|mut mhe| {
            for (u, observed) in steps {
                let cost = mhe.update(u, observed, &mut || false).map(|report| report.cost);
                black_box(cost).expect("a simulated flight is finite");
            }
            mhe
        });
}

/// Mean over 1000 consecutive updates with at most `iterations_max` iterations each.
#[divan::bench(args = [1, 2, 50])]
fn a_thousand_updates(bencher: Bencher<'_, '_>, iterations_max: u32) {
    let (mhe, steps) = flight(iterations_max);
    follow(bencher, &mhe, &steps);
}

/// The expected parameter of the vehicle with lag, with which its flights are simulated.
const P_LAGGED: [f64; lag::COUNT] =
    [1.9, 0.89, 1.4, -0.06, 0.64, 0.25, 0.12, 0.07, 0.12, 0.08, 1.1];

/// The weights are those of `configs/fly.json`, up to what does not cost time.
fn lagged_settings(
    window_steps: usize,
) -> Result<MheSettings<{ motion::COUNT }, { pose::COUNT }, { lag::COUNT }>, SettingError> {
    let mut c_s = [100.0; motion::COUNT];
    c_s[motion::V_X..motion::V_X + stick::COUNT].fill(10.0);
    (c_s[motion::D_X], c_s[motion::D_Y], c_s[motion::D_Z]) = (2.2, 2.2, 5.0);
    let beside = |fraction: f64| P_LAGGED.map(|p| p + fraction * p.abs());
    MheSettings::builder(P_LAGGED)
        .window_steps(window_steps)
        .c_o([2500.0, 2500.0, 2500.0, 250.0])
        .c_s(c_s)
        .c_p([10.0; lag::COUNT])
        .bounds(beside(-0.5), beside(0.5))
        .losses(LossTable::Huber { scale: 2.5 }, LossTable::None {})
        .arrival(ArrivalTable::Carried { c_0: vec![5.0; motion::COUNT], forget_s: 60.0 })
        .solver(LmTable {
            damping_start: 0.0,
            cost_tolerance: 1e-3,
            step_tolerance: 1e-9,
            iterations_max: 3,
        })
        .build(&Lagged::default())
}

/// A started estimator of the vehicle with lag and the flight that it is to follow.
#[expect(
    clippy::expect_used,
    reason = "there is nothing to measure with settings that are refused"
)]
fn lagged_flight(window_steps: usize) -> (LaggedMhe, Vec<(Sticks, Observed<4>)>) {
    let settings = lagged_settings(window_steps).expect("each weight is in its range");
    let p = SVector::from(P_LAGGED);
    let model = Lagged::default();
    let mut mhe = Mhe::new(model, settings, DT_S).expect("the period is positive");
    let o = Pose::new(0.0, 0.0, 1.0, 3.0);
    mhe.start(&o).expect("the pose is finite");
    let mut s = model.at_rest(&o);
    let steps = (0..1000_u32).map(|k| {
        let t = f64::from(k) * DT_S;
        let u = Sticks::new(0.5 * t.sin(), 0.4 * t.cos(), 0.3, 0.2 * (2.0 * t).sin());
        s = model.step(&s, &u, &p, DT_S);
        // Deterministic noise of 0 to 0.3 mm; every 50th pose is 0.1 m off.
        let noise = f64::from(k * 7919 % 101) * 3e-6 + if k % 50 == 0 { 0.1 } else { 0.0 };
        (u, Observed::full(model.observe(&s) + Pose::repeat(noise)))
    });
    (mhe, steps.collect())
}

/// Mean over 1000 consecutive updates of the vehicle with lag, by length of the window.
#[divan::bench(args = [5, 15, 30])]
fn a_thousand_lagged_updates(bencher: Bencher<'_, '_>, window_steps: usize) {
    let (mhe, steps) = lagged_flight(window_steps);
    follow(bencher, &mhe, &steps);
}
