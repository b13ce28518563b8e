//! What poses, drone and inputs show before the drone's axes are known.

use std::f64::consts::FRAC_PI_2;

use horizon_model::check::maximum;
use horizon_model::rows::{Sticks, stick};

use super::*;
use crate::monitor::DroneMotion;
use crate::monitor::typical_vehicle::lag_decay;

const DT_S: f64 = 0.02;

/// The monitor after inputs that sway along x in the world frame while the drone follows them in its axes, which
/// are turned by `turn_rad`, and the poses move at a constant velocity. m/s
fn swaying(turn_rad: f64, poses_mps: f64, count: u32) -> VelocityMonitor {
    let mut monitor = VelocityMonitor::new(0.6, DT_S);
    let mut v_mps = 0.0;
    for k in 0..count {
        let t_s = f64::from(k) * DT_S;
        let mut u_applied = Sticks::zeros();
        u_applied[stick::PITCH] = if t_s.rem_euclid(4.0) < 2.0 { -0.5 } else { 0.3 };
        let pose = Some(Pose::new(poses_mps * t_s, 0.0, 1.0, 0.0));
        let by_drone = Complex::from_polar(1.0, turn_rad) * v_mps;
        let drone = DroneMotion {
            horizontal_d_mps: Some([by_drone.re, by_drone.im]),
            height_m: None,
            heading_rad: None,
        };
        let sample = Sample { pose, drone: Some(drone), u_applied, link_is_up: true };
        monitor.update(&sample);
        let asked_mps = velocity_w_mps(&sample.u_applied, 0.0).re;
        v_mps += (asked_mps - v_mps) * (1.0 - lag_decay(DT_S));
    }
    monitor
}

#[test]
fn drone_and_inputs_that_agree_show_the_displacement_that_the_poses_deny() {
    for turn_rad in [0.0, 1.0, -2.5] {
        let monitor = swaying(turn_rad, 0.2, 180);
        let asked_m = monitor.displacements.inputs_w_m.re;
        let poses_m = monitor.displacements.poses_w_m.re;
        assert!(asked_m < -0.5 && poses_m > 0.15, "{asked_m}, {poses_m} m");
        // The drone's report is a period late.
        let (square_m2, product_m2) = (poses_m.powi(2) + asked_m.powi(2), poses_m * asked_m);
        let expected_m = (square_m2 - 2.0 * product_m2 * 0.785_f64.cos()).sqrt() + 0.25 * asked_m;
        let got_m = monitor.difference_m().unwrap();
        assert!((got_m - expected_m).abs() < 0.03, "{turn_rad} rad: {got_m}, {expected_m} m");
    }
    let early = swaying(0.0, 0.1, 30);
    assert!(early.sums_by_inputs.variance(FIXED) < MOTION_MIN);
    assert_eq!(early.difference_m(), None, "too little motion shows no axes");
}

#[test]
fn inputs_and_reports_are_turned_by_the_heading() {
    let mut u_applied = Sticks::zeros();
    (u_applied[stick::PITCH], u_applied[stick::ROLL]) = (0.5, 0.2);
    let sample = Sample { pose: None, drone: None, u_applied, link_is_up: true };
    let close = |a: Complex<f64>, b: Complex<f64>| (a - b).norm() < 1e-12;
    // Forward is x and right is -y, at a heading of zero.
    assert!(close(velocity_w_mps(&sample.u_applied, 0.0), Complex::new(1.9 * 0.43, -1.9 * 0.13)));
    assert!(close(
        velocity_w_mps(&sample.u_applied, FRAC_PI_2),
        Complex::new(1.9 * 0.13, 1.9 * 0.43)
    ));
    let drone_d_mps = in_axes_kinds(Complex::new(0.3, 0.1), FRAC_PI_2);
    let expected = [(0.3, 0.1), (0.3, -0.1), (-0.1, 0.3), (0.1, 0.3)];
    for (drone_d_mps, (x, y)) in drone_d_mps.into_iter().zip(expected) {
        assert!(close(drone_d_mps, Complex::new(x, y)), "{drone_d_mps}");
    }
}

/// The monitor after ten seconds around a circle of 1 m at 0.5 m/s, and where the vehicle is then. m
fn after_a_circle() -> (VelocityMonitor, Complex<f64>) {
    let mut monitor = VelocityMonitor::new(0.6, DT_S);
    let mut at_w = Complex::default();
    for k in 0..500 {
        let v_mps = Complex::from_polar(0.5, 0.5 * f64::from(k) * DT_S);
        let (_, error_m) = see(&mut monitor, &mut at_w, v_mps * DT_S, v_mps);
        assert!(error_m < 0.2, "{error_m} m");
    }
    (monitor, at_w)
}

/// A tick in which the poses move by `poses_w_m`, and the drone reports a velocity.
fn see(
    monitor: &mut VelocityMonitor,
    at_w: &mut Complex<f64>,
    poses_w_m: Complex<f64>,
    by_drone_mps: Complex<f64>,
) -> (Agreement, f64) {
    *at_w += poses_w_m;
    let drone = DroneMotion {
        horizontal_d_mps: Some([by_drone_mps.re, by_drone_mps.im]),
        height_m: None,
        heading_rad: None,
    };
    let pose = Some(Pose::new(at_w.re, at_w.im, 1.0, 0.0));
    let u_applied = Sticks::zeros();
    monitor.update(&Sample { pose, drone: Some(drone), u_applied, link_is_up: true })
}

#[test]
fn a_step_of_the_poses_does_not_hide_the_drift_that_begins_with_it() {
    let (mut monitor, mut at_w) = after_a_circle();
    let (step_m, hovering) = (Complex::new(0.2, 0.0), Complex::default());
    let mut agreement = see(&mut monitor, &mut at_w, step_m, hovering).0;
    assert!(monitor.ages[0].error_m().is_some(), "a step is no motion that shows the axes");
    for _ in 0..150 {
        let drift_m = Complex::new(0.5 * DT_S, 0.0);
        agreement = agreement.max(see(&mut monitor, &mut at_w, drift_m, hovering).0);
    }
    assert_eq!(agreement, Agreement::Disagrees, "0.2 m and 3 s at 0.5 m/s");
}

#[test]
fn what_a_vehicle_can_move_in_a_period_is_no_step() {
    // 0.5 m/s by the drone: (0.5 + 1) m/s for 0.02 s and 0.03 m.
    for (moved_m, is_jump) in [(0.059, false), (0.061, true)] {
        let (mut monitor, mut at_w) = after_a_circle();
        let before = monitor.ages[0].sums.poses_squares;
        let poses_w_m = Complex::new(moved_m, 0.0);
        see(&mut monitor, &mut at_w, poses_w_m, Complex::new(0.5, 0.0));
        let is_learnt = monitor.ages[0].sums.poses_squares > before;
        assert_eq!(is_learnt, !is_jump, "{moved_m} m");
    }
}

/// Largest difference in a flight along sides of 4 m at 1.2 m/s, and after it in a hover while the poses drift along x:
/// in ticks of the flight, and time of the drift until it is refused. The drone reports its speed, times `scale`,
/// `late` ticks later. m, s
fn along_sides(scale: f64, late: usize, drift_mps: f64) -> (f64, Option<f64>) {
    let mut monitor = VelocityMonitor::new(0.6, DT_S);
    let (mut at_w, mut v_mps) = (Complex::default(), Complex::default());
    let mut earlier_mps = vec![Complex::default(); late];
    let mut largest_m: f64 = 0.0;
    let reported = |earlier_mps: &mut Vec<Complex<f64>>, v_mps: Complex<f64>| {
        earlier_mps.push(v_mps * scale);
        let tenths = |v: f64| (10.0 * v).round() / 10.0;
        let by_drone = earlier_mps.remove(0);
        Complex::new(tenths(by_drone.re), tenths(by_drone.im))
    };
    for k in 0..2000 {
        let side = Complex::from_polar(1.2, FRAC_PI_2 * f64::from(k / 200));
        v_mps += (side - v_mps) * (1.0 - lag_decay(DT_S));
        let by_drone_mps = reported(&mut earlier_mps, v_mps);
        let (_, error_m) = see(&mut monitor, &mut at_w, v_mps * DT_S, by_drone_mps);
        largest_m = maximum(largest_m, error_m);
    }
    let refused = (0..400).find(|_| {
        let drift_w_mps = Complex::new(drift_mps, 0.0);
        let by_drone_mps = reported(&mut earlier_mps, Complex::default());
        let seen = see(&mut monitor, &mut at_w, drift_w_mps * DT_S, by_drone_mps);
        seen.0 == Agreement::Disagrees
    });
    (largest_m, refused.map(|k| f64::from(k) * DT_S))
}

#[test]
fn a_drone_whose_reports_are_late_or_of_another_scale_counts_all_the_same() {
    for (scale, late_s) in
        [(1.0, 0.0), (0.8, 0.0), (1.2, 0.0), (1.4, 0.0), (1.0, 0.3), (1.0, 0.5), (0.85, 0.9)]
    {
        let late = steps(late_s, DT_S);
        let (largest_m, refused_s) = along_sides(scale, late, 0.5);
        let case = format!("x {scale}, {late_s} s late: {largest_m:.2} m, {refused_s:?} s");
        assert!(largest_m < 0.6, "{case}");
        // The limit after 1.45 s, and 1.5 s of doubt, later by the age of the reports.
        assert!(refused_s.is_some_and(|refused_s| refused_s < 3.1 + late_s), "{case}");
    }
}

#[test]
fn a_drone_that_has_shown_a_speed_reports_one_of_zero_also_after_a_silent_tick() {
    let (mut monitor, mut at_w) = (VelocityMonitor::new(0.6, DT_S), Complex::default());
    let none = Complex::default();
    let mut speed_mps = |reported_mps: Option<f64>| {
        if let Some(reported_mps) = reported_mps {
            see(&mut monitor, &mut at_w, none, Complex::from(reported_mps));
        } else {
            let u_applied = Sticks::zeros();
            monitor.update(&Sample { pose: None, drone: None, u_applied, link_is_up: true });
        }
        monitor.speed_mps()
    };
    assert_eq!(speed_mps(Some(0.0)), None, "it may report none at all");
    assert_eq!(speed_mps(Some(0.5)), Some(0.5));
    assert_eq!(speed_mps(Some(0.0)), Some(0.0));
    assert_eq!(speed_mps(None), None);
    assert_eq!(speed_mps(Some(0.0)), Some(0.0), "after a silent tick");
}

#[test]
fn what_was_flown_while_poses_and_drone_were_silent_is_no_difference() {
    let (mut monitor, mut at_w) = after_a_circle();
    let v_mps = Complex::new(0.5, 0.0);
    let silence = Sample { pose: None, drone: None, u_applied: Sticks::zeros(), link_is_up: true };
    for _ in 0..100 {
        assert_eq!(monitor.update(&silence), (Agreement::Unknown, 0.0));
    }
    at_w += v_mps * DT_S * 100.0;
    assert_eq!(see(&mut monitor, &mut at_w, v_mps * DT_S, v_mps).0, Agreement::Unknown);
    for _ in 0..100 {
        let (_, error_m) = see(&mut monitor, &mut at_w, v_mps * DT_S, v_mps);
        assert!(error_m < 0.2, "{error_m} m");
    }
}
