//! Time of one update of the moving horizon estimator: the thesis' window of 30 steps with four states,
//! and the vehicle with lag under a carried arrival cost, eleven states and eleven parameters.
//!
//! `cargo bench -p horizon-estim`. The flights are simulated with noise, so that the robust loss works.

use divan::{Bencher, black_box};
use horizon_estim::{ArrivalTable, LmTable, LossTable, Mhe, MheTable, Observed};
use horizon_model::rows::{Motion, Pose, Sticks, lag, motion, pose, stick};
use horizon_model::{Kinematic, Lagged, Model};
use nalgebra::SVector;

const DT_S: f64 = 0.02;

type LaggedMhe = Mhe<Lagged, { motion::COUNT }, { stick::COUNT }, { pose::COUNT }, { lag::COUNT }>;

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
    let mut mhe = Mhe::new(Kinematic, settings, DT_S).expect("the period is positive");
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

/// The weights are those of `configs/fly.json`, up to what does not cost time.
fn lagged_table(window_steps: usize) -> MheTable {
    let p = [1.9, 0.89, 1.4, -0.06, 0.64, 0.25, 0.12, 0.07, 0.12, 0.08, 1.1];
    let mut c_s = Motion::repeat(100.0);
    c_s.fixed_rows_mut::<{ stick::COUNT }>(motion::V_X).fill(10.0);
    (c_s[motion::D_X], c_s[motion::D_Y], c_s[motion::D_Z]) = (2.2, 2.2, 5.0);
    MheTable {
        window_steps,
        c_o: vec![2500.0, 2500.0, 2500.0, 250.0],
        c_s: c_s.as_slice().to_vec(),
        c_p: vec![10.0; lag::COUNT],
        p_prior: p.to_vec(),
        p_lb: p.map(|p| p - 0.5 * f64::abs(p)).to_vec(),
        p_ub: p.map(|p| p + 0.5 * f64::abs(p)).to_vec(),
        observation_loss: LossTable::Huber { scale: 2.5 },
        transition_loss: LossTable::None {},
        arrival: ArrivalTable::Carried { c_0: vec![5.0; motion::COUNT], forget_s: 60.0 },
        shift_prior: false,
        solver: LmTable {
            damping_start: 0.0,
            cost_tolerance: 1e-3,
            step_tolerance: 1e-9,
            iterations_max: 3,
        },
    }
}

/// A started estimator of the vehicle with lag and the flight that it is to follow.
#[expect(clippy::expect_used, reason = "there is nothing to measure with a table that is refused")]
fn lagged_flight(window_steps: usize) -> (LaggedMhe, Vec<(Sticks, Observed<4>)>) {
    let table = lagged_table(window_steps);
    let settings = table
        .check::<Lagged, { motion::COUNT }, { stick::COUNT }, { pose::COUNT }, { lag::COUNT }>()
        .expect("the table above is valid");
    let p = SVector::from_column_slice(&table.p_prior);
    let model = Lagged::default();
    let mut mhe = Mhe::new(model, settings, DT_S).expect("the period is positive");
    let o = Pose::new(0.0, 0.0, 1.0, 3.0);
    mhe.start(&o);
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
