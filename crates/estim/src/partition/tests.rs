use horizon_model::rows::{Motion, Pose, Sticks, lag, motion, pose};
use horizon_model::{Lagged, Model};

use crate::arrival::ArrivalSettings;
use crate::levenberg::{LmSettings, LmTable, solve};
use crate::loss::Loss;
use crate::reduced_system::Bounds;
use crate::residual::{Observed, Residuals};
use crate::trajectory::{Prior, Trajectory};

use super::*;

const DT_S: f64 = 0.02;
const WINDOW: usize = 6;

type Parameter = SVector<f64, { lag::COUNT }>;
type Window = Trajectory<Lagged, { motion::COUNT }, 4, { pose::COUNT }, { lag::COUNT }>;

fn window() -> Window {
    let p_prior = Parameter::from([1.9, 0.89, 1.4, -0.06, 0.64, 0.25, 0.12, 0.07, 0.12, 0.08, 1.1]);
    let residuals = Residuals {
        model: Lagged::default(),
        dt_s: DT_S,
        c_o: SVector::from([1000.0, 1000.0, 1000.0, 150.0]),
        c_s: Motion::from([200.0, 200.0, 200.0, 100.0, 1.0, 1.0, 5.0, 3.0, 1.5, 1.5, 5.0]),
        observation_loss: Loss::Huber { scale: 2.0 },
        transition_loss: Loss::None,
    };
    let bounds =
        Bounds { lo: p_prior - Parameter::repeat(0.05), hi: p_prior + Parameter::repeat(0.1) };
    let prior = Prior { c_p: Parameter::repeat(30.0), p_prior, bounds };
    let arrival = ArrivalSettings::Carried { c_0: Motion::repeat(20.0), forget_s: 2.0 };
    let mut window = Trajectory::new(residuals, prior, arrival, WINDOW);
    window.start(Motion::zeros());
    window
}

/// Sticks and pose of step `k`: a flight that the prior does not explain, with jumps of height and heading.
fn recorded(k: u32) -> (Sticks, Observed<{ pose::COUNT }>) {
    let t = DT_S * f64::from(k);
    let u =
        Sticks::new((2.0 * t).sin(), (3.0 * t).cos(), 0.5 * (5.0 * t).sin(), 0.7 * (4.0 * t).cos());
    let mut o = Pose::new(0.4 * t * t, -0.2 * t, 1.0 + 0.3 * t.sin(), 0.5 * t);
    if k % 11 == 5 {
        o[pose::Z] += 0.1;
    }
    if k % 17 == 8 {
        o[pose::THETA] += 0.3;
    }
    (u, if k % 13 == 7 { Observed::missing() } else { Observed::full(o) })
}

#[test]
fn groups_are_estimated_as_the_whole() {
    let table = LmTable {
        damping_start: 0.0,
        cost_tolerance: 0.0,
        step_tolerance: 1e-15,
        iterations_max: 2,
    };
    let settings = LmSettings::try_from(&table).unwrap();
    assert!(LaggedPartition::new::<{ motion::COUNT }, { lag::COUNT }>(Lagged::GROUPS, 1).is_some());
    let (mut apart, mut whole) = (window(), window().undivided());
    for k in 0..200 {
        let (u, observed) = recorded(k);
        for window in [&mut apart, &mut whole] {
            // As while a link is down.
            window.hold_parameter((90..120).contains(&k));
            if window.states().len() > WINDOW {
                window.pop();
            }
            window.push(&u, &observed);
            let report = solve(window, &settings, &mut || false).unwrap();
            assert!(report.cost.is_finite(), "{report:?}");
        }
        let gap = (apart.newest() - whole.newest()).amax();
        let p_gap = (apart.parameter() - whole.parameter()).amax();
        // Rounding alone; the conditions of the two differ.
        assert!(gap < 1e-9 && p_gap < 1e-9, "{gap:e}, {p_gap:e} in step {k}");
    }
    assert!((whole.parameter() - window().parameter()).amax() > 0.01, "nothing was learnt");
}

#[test]
fn other_groups_are_left_whole() {
    let is_known = |groups: &[Group]| LaggedPartition::new::<11, 11>(groups, 1).is_some();
    assert!(!is_known(&[]) && !is_known(&Lagged::GROUPS[..1]));
    assert!(!is_known(&[Lagged::GROUPS[1], Lagged::GROUPS[0]]));
    // Of the right size, but not all there is.
    assert!(LaggedPartition::new::<12, 11>(Lagged::GROUPS, 1).is_none());
}
