//! The estimator against reference solutions of 200 real windows, found by another solver.

use std::fs;

use horizon_estim::{ArrivalTable, LmTable, LossTable, Mhe, MheSettings, Observed};
use horizon_model::Kinematic;
use horizon_model::check::{amax, maximum};
use horizon_model::rows::{Pose, Sticks, gain, pose, stick};
use nalgebra::SVector;
use serde::Deserialize;

use crate::support;

/// One window: `s0` fixed, `u[k]` acts from state `k` to `k + 1`, `o[k]` observes state `k + 1`.
#[derive(Deserialize)]
struct Window {
    s0: [f64; pose::COUNT],
    o: Vec<[f64; pose::COUNT]>,
    u: Vec<[f64; stick::COUNT]>,
    s_hat: Vec<[f64; pose::COUNT]>,
    p_hat: [f64; gain::COUNT],
    cost: f64,
}

/// The weights with which the reference was computed; the bounds are inactive there.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn settings() -> MheSettings<4, 4, 4> {
    MheSettings::builder([1.29, 0.445, 0.994, 0.033])
        .c_o([3.0, 3.0, 2.0, 0.5])
        .c_s([0.4, 0.4, 0.4, 0.2])
        .c_p([20.0, 20.0, 20.0, 100.0])
        .bounds([0.1, 0.1, 0.1, -3.0], [10.0, 10.0, 10.0, 3.0])
        .losses(LossTable::Huber { scale: 1.0 }, LossTable::None {})
        .arrival(ArrivalTable::Fixed)
        .solver(LmTable { cost_tolerance: 1e-13, step_tolerance: 1e-12, ..LmTable::default() })
        .build(&Kinematic)
        .unwrap()
}

#[test]
fn every_reference_window_is_solved_to_the_same_optimum() {
    let Some(path) = support::data("mhe_windows.jsonl") else { return };
    let text = fs::read_to_string(path).unwrap();
    let mut mhe = Mhe::new(Kinematic, settings(), 0.02).unwrap();
    let (mut cost_gap, mut state_gap, mut parameter_gap) = (0.0_f64, 0.0_f64, 0.0_f64);
    let mut count = 0;
    for line in text.lines() {
        let window: Window = serde_json::from_str(line).unwrap();
        mhe.start(&Pose::from(window.s0)).unwrap();
        let mut cost = f64::NAN;
        for (u, o) in window.u.iter().zip(&window.o) {
            let observed = Observed::full(Pose::from(*o));
            cost = mhe.update(&Sticks::from(*u), &observed, &mut || false).unwrap().cost;
        }
        let gap = (cost / window.cost - 1.0).abs();
        assert!(gap < 1e-6, "window {count}: cost {cost} instead of {}", window.cost);
        cost_gap = maximum(cost_gap, gap);
        assert_eq!(mhe.window().len(), window.s_hat.len() + 1);
        for (k, (s, expected)) in mhe.window().iter().skip(1).zip(&window.s_hat).enumerate() {
            let gap = amax(&(s - Pose::from(*expected)));
            assert!(gap < 1e-5, "window {count}, state {}: gap {gap:e}", k + 1);
            state_gap = maximum(state_gap, gap);
        }
        let gap = amax(&(mhe.p_hat() - SVector::from(window.p_hat)));
        assert!(gap < 1e-5, "window {count}: parameter gap {gap:e}");
        parameter_gap = maximum(parameter_gap, gap);
        count += 1;
    }
    println!(
        "{count} windows; worst gaps: cost {cost_gap:.1e}, state {state_gap:.1e} m or rad, \
         parameter {parameter_gap:.1e}"
    );
    assert_eq!(count, 200);
}
