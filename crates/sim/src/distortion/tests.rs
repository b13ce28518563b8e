use super::*;
use crate::fault::ScriptedFault;
use horizon_model::check::amax;

/// True pose in `step`: along a line, turning.
fn truth(step: u64) -> Pose {
    let t_s = step as f64 * DT_S;
    Pose::new(1.0 + 0.5 * t_s, -2.0, 1.2, 0.3 + 0.1 * t_s)
}

/// Reports of 4 s with `fault` from 1 s on for 2 s.
fn reports(fault: InjectedFault) -> Vec<MocapReport> {
    let script = vec![ScriptedFault { fault, from_s: 1.0, for_s: 2.0 }];
    let mut faults = Faults::new(script).unwrap();
    let mut distortion = Distortion::new(4);
    let mut last = MocapReport::Silent;
    let report = |step| {
        faults.begin(step, &truth(step));
        last = distortion.report(MocapReport::Pose(truth(step)), last, &faults, step);
        last
    };
    (0..200).map(report).collect()
}

/// Poses in the 100 steps of the fault; in the others the truth is reported.
fn poses(fault: InjectedFault) -> Vec<Pose> {
    let reports = reports(fault);
    for (step, report) in (0..).zip(&reports) {
        if !(50..150).contains(&step) {
            assert_eq!(*report, MocapReport::Pose(truth(step)), "step {step}");
        }
    }
    let pose = |report: &MocapReport| match report {
        MocapReport::Pose(o) => *o,
        other => panic!("{other:?}"),
    };
    reports[50..150].iter().map(pose).collect()
}

fn assert_close(got: &Pose, expected: &Pose, tolerance: f64) {
    assert!(amax(&(got - expected)) < tolerance, "{got} instead of {expected}");
}

fn standard_deviation(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    (values.map(|value| (value - mean).powi(2)).sum::<f64>() / n).sqrt()
}

#[test]
fn a_still_object_stands_where_the_drone_was_plus_its_offset() {
    let offset_w_m = [0.3, -0.4, 0.1];
    let still = |noise_m, noise_rad| {
        poses(InjectedFault::MocapStill { offset_w_m, turn_rad: 0.5, noise_m, noise_rad })
    };
    let at = truth(50) + Pose::new(0.3, -0.4, 0.1, 0.5);
    for o in still(0.0, 0.0) {
        assert_close(&o, &at, 1e-12);
    }
    let noisy = still(0.002, 0.01);
    // Four standard errors of the deviation of 100 draws: 0.28 of it.
    for (row, sd) in [(pose::X, 0.002), (pose::Z, 0.002), (pose::THETA, 0.01)] {
        let got = standard_deviation(noisy.iter().map(|o| o[row]));
        assert!((got / sd - 1.0).abs() < 0.28, "row {row}: {got} instead of {sd}");
    }
    assert_ne!(noisy[0], noisy[1], "noise is no frozen pose");
}

#[test]
fn a_split_object_is_the_drone_or_the_other_one_as_often_as_set() {
    let offset_w_m = [0.25, 0.0, 0.0];
    let other = truth(50) + Pose::new(0.25, 0.0, 0.0, 0.0);
    let split = poses(InjectedFault::MocapSplit { offset_w_m, fraction: 0.5 });
    let is_other = |o: &&Pose| amax(&(*o - other)) < 1e-12;
    let elsewhere = split.iter().filter(is_other).count();
    // Four standard deviations of 100 draws.
    assert!((30..=70).contains(&elsewhere), "{elsewhere}");
    for (k, o) in (0_u64..).zip(&split).filter(|(_, o)| !is_other(o)) {
        assert_close(o, &truth(50 + k), 1e-12);
    }
}

#[test]
fn a_shifted_position_is_off_by_the_same_way_while_the_drone_moves() {
    let off = Pose::new(0.2, -0.1, 0.3, 0.0);
    let shifted = poses(InjectedFault::MocapShifted { offset_w_m: [0.2, -0.1, 0.3] });
    for (k, o) in (0_u64..).zip(&shifted) {
        assert_close(o, &(truth(50 + k) + off), 1e-12);
    }
}

#[test]
fn stuck_axes_stay_under_their_noise_and_the_others_are_right() {
    let stuck =
        |noise_m| poses(InjectedFault::MocapAxesStuck { axes: [true, false, true], noise_m });
    for (k, o) in (0_u64..).zip(stuck(0.0)) {
        let (onset, now) = (truth(50), truth(50 + k));
        let expected = Pose::new(onset[pose::X], now[pose::Y], onset[pose::Z], now[pose::THETA]);
        assert_close(&o, &expected, 1e-12);
    }
    let noisy = stuck(0.002);
    // Four standard errors of the deviation of 100 draws: 0.28 of it.
    for row in [pose::X, pose::Z] {
        let got_m = standard_deviation(noisy.iter().map(|o| o[row]));
        assert!((got_m / 0.002 - 1.0).abs() < 0.28, "row {row}: {got_m} m");
    }
}

#[test]
fn a_walker_moves_on_a_circle_at_its_speed() {
    let walker = InjectedFault::MocapWalker {
        offset_w_m: [0.6, 0.0, 0.0],
        radius_m: 0.5,
        speed_mps: 0.4,
        noise_m: 0.0,
        noise_rad: 0.0,
    };
    let walk = poses(walker);
    assert_close(&walk[0], &(truth(50) + Pose::new(0.6, 0.0, 0.0, 0.0)), 1e-12);
    let theta = truth(50)[pose::THETA];
    let centre = (walk[0][pose::X] - 0.5 * theta.sin(), walk[0][pose::Y] + 0.5 * theta.cos());
    for pair in walk.windows(2) {
        let step = pair[1] - pair[0];
        let speed_mps = step[pose::X].hypot(step[pose::Y]) / DT_S;
        assert!((speed_mps - 0.4).abs() < 1e-4, "{speed_mps} m/s");
        let radius_m = (pair[1][pose::X] - centre.0).hypot(pair[1][pose::Y] - centre.1);
        assert!((radius_m - 0.5).abs() < 1e-9, "{radius_m} m");
        // It walks forward.
        let along =
            step[pose::X] * pair[0][pose::THETA].cos() + step[pose::Y] * pair[0][pose::THETA].sin();
        assert!(along > 0.99 * step[pose::X].hypot(step[pose::Y]), "{step}");
    }
}

#[test]
fn a_drift_grows_with_time() {
    let drift = InjectedFault::MocapDrift { velocity_w_mps: [0.1, 0.0, -0.2], yaw_radps: 0.05 };
    for (k, o) in (0_u32..).zip(poses(drift)) {
        let t_s = f64::from(k) * DT_S;
        let expected = truth(50 + u64::from(k)) + Pose::new(0.1, 0.0, -0.2, 0.05) * t_s;
        assert_close(&o, &expected, 1e-12);
    }
}

#[test]
fn a_frame_is_mirrored_scaled_and_turned() {
    let frame = |turn_rad, is_mirrored, scale| {
        poses(InjectedFault::MocapFrame { turn_rad, is_mirrored, scale })[0]
    };
    let [x, y, z, theta] = truth(50).into();
    assert_close(&frame(0.0, true, 1.0), &Pose::new(x, -y, z, -theta), 1e-12);
    assert_close(&frame(0.0, false, 1.1), &Pose::new(1.1 * x, 1.1 * y, 1.1 * z, theta), 1e-12);
    assert_close(&frame(PI / 2.0, false, 1.0), &Pose::new(-y, x, z, theta + PI / 2.0), 1e-12);
    let all = Pose::new(1.1 * y, 1.1 * x, 1.1 * z, PI / 2.0 - theta);
    assert_close(&frame(PI / 2.0, true, 1.1), &all, 1e-12);
}

#[test]
fn a_turned_heading_leaves_the_position_and_stays_in_its_interval() {
    for (turn_rad, expected) in [(PI / 2.0, 0.4 + PI / 2.0), (PI, 0.4 - PI), (-3.0, -2.6)] {
        let mut at = truth(50);
        at[pose::THETA] = expected;
        assert_close(&poses(InjectedFault::MocapHeading { turn_rad })[0], &at, 1e-12);
    }
}

#[test]
fn noise_grows_from_nothing() {
    let poses = poses(InjectedFault::MocapNoise { growth_mps: 0.05, growth_radps: 0.1 });
    assert_close(&poses[0], &truth(50), 1e-12);
    let errors = (0_u32..).zip(poses).map(|(k, o)| (o - truth(50 + u64::from(k)))[pose::X]);
    let errors: Vec<f64> = errors.collect();
    // Mean square of 0.05 t over the first and the last half second: 0.0144^2 and 0.088^2.
    let first = standard_deviation(errors[..25].iter().copied());
    let last = standard_deviation(errors[75..].iter().copied());
    assert!((0.007..0.022).contains(&first) && (0.05..0.13).contains(&last), "{first} {last}");
}

#[test]
fn an_occlusion_comes_again() {
    let reports = reports(InjectedFault::MocapOccluded { period_s: 0.4, lost_s: 0.1 });
    let lost: Vec<usize> = (0..200).filter(|step| reports[*step] == MocapReport::Lost).collect();
    let expected: Vec<usize> = (50..150).filter(|step| (step - 50) % 20 < 5).collect();
    assert_eq!(lost, expected);
}

#[test]
fn what_is_not_seen_is_not_distorted() {
    let still = InjectedFault::MocapStill {
        offset_w_m: [1.0, 0.0, 0.0],
        turn_rad: 0.0,
        noise_m: 0.0,
        noise_rad: 0.0,
    };
    let script = vec![ScriptedFault { fault: still, from_s: 0.0, for_s: 1.0 }];
    let mut faults = Faults::new(script).unwrap();
    faults.begin(0, &truth(0));
    for by_chance in [MocapReport::Lost, MocapReport::Silent] {
        let mut distortion = Distortion::new(1);
        assert_eq!(distortion.report(by_chance, MocapReport::Silent, &faults, 0), by_chance);
    }
}

#[test]
fn a_report_changes_as_its_fault_lets_it() {
    let frozen = [InjectedFault::MocapFixed, InjectedFault::MocapFrozen];
    let moving = [
        InjectedFault::MocapFar,
        InjectedFault::MocapFlipped,
        InjectedFault::MocapMillimetres,
        InjectedFault::MocapShifted { offset_w_m: [0.3, 0.0, 0.0] },
        InjectedFault::MocapHeading { turn_rad: 0.4 },
        InjectedFault::MocapDrift { velocity_w_mps: [0.1, -0.2, 0.05], yaw_radps: 0.1 },
        InjectedFault::MocapFrame { turn_rad: 0.4, is_mirrored: true, scale: 1.5 },
        InjectedFault::MocapAxesStuck { axes: [true, false, true], noise_m: 0.0 },
        InjectedFault::MocapWalker {
            offset_w_m: [1.0, 0.0, 0.0],
            radius_m: 0.5,
            speed_mps: 0.8,
            noise_m: 0.0,
            noise_rad: 0.0,
        },
    ];
    for fault in frozen.into_iter().chain(moving) {
        let script = vec![ScriptedFault { fault, from_s: 1.0, for_s: 2.0 }];
        let mut faults = Faults::new(script).unwrap();
        let (poses, distortion) = (poses(fault), Distortion::new(4));
        for (step, pair) in (51..149).zip(poses.windows(2)) {
            faults.begin(step - 1, &truth(step - 1));
            faults.begin(step, &truth(step));
            let change = distortion.change(truth(step) - truth(step - 1), &faults, step);
            let mut seen = pair[1] - pair[0];
            seen[pose::THETA] = angle::wrap(seen[pose::THETA]);
            assert_close(&change, &seen, 1e-9);
            assert_eq!(amax(&change) > 0.0, !frozen.contains(&fault), "{fault:?}");
        }
    }
}

#[test]
fn between_the_steps_a_split_object_rests_where_it_is_the_other_one() {
    let split = InjectedFault::MocapSplit { offset_w_m: [0.25, 0.0, 0.0], fraction: 0.5 };
    let script = vec![ScriptedFault { fault: split, from_s: 1.0, for_s: 2.0 }];
    let (mut faults, mut distortion) = (Faults::new(script).unwrap(), Distortion::new(4));
    let mut resting = 0;
    for step in 0..200 {
        faults.begin(step, &truth(step));
        let by_chance = MocapReport::Pose(truth(step));
        let is_true = distortion.report(by_chance, by_chance, &faults, step) == by_chance;
        let moved = truth(step + 1) - truth(step);
        let change = distortion.change(moved, &faults, step);
        assert_eq!(change, if is_true { moved } else { Pose::zeros() }, "step {step}");
        resting += u32::from(!is_true);
    }
    // Four standard deviations of 100 draws.
    assert!((30..=70).contains(&resting), "{resting}");
}
