use super::*;
use crate::firmware::PLAIN;
use crate::world::World;
use crate::world::tests::table;
use crate::{Profile, SimTable};

/// A truth that a report is made of.
fn truth(is_flying: bool, x_mps: f64, y_mps: f64, z_mps: f64) -> Truth {
    let clean = SimTable { profile: Profile::Clean, has_spread: false, ..table() };
    let truth = World::new(&clean, 1).unwrap().truth();
    let phase = if is_flying { DronePhase::Flying } else { DronePhase::Grounded };
    let velocity = Velocity { x_mps, y_mps, z_mps, yaw_radps: 0.0 };
    Truth { phase, velocity, motor_s: 7.0, ..truth }
}

fn reporter(change: impl FnOnce(&mut StatusTable), truth: &Truth) -> Reporter {
    let mut table = PLAIN.status;
    change(&mut table);
    Reporter::new(table, truth)
}

/// Velocity reported of a vehicle that flies at 1, 2, 3 m/s with a heading of 0.2 rad.
fn velocity(change: impl FnOnce(&mut VelocityReport)) -> [f64; 3] {
    let truth = truth(true, 1.0, 2.0, 3.0);
    let reporter = reporter(|table| change(&mut table.velocity), &truth);
    let Velocity { x_mps, y_mps, z_mps, .. } = reporter.reported(truth).velocity;
    [x_mps, y_mps, z_mps]
}

fn assert_close(got: [f64; 3], expected: [f64; 3]) {
    let is_close = got.iter().zip(expected).all(|(got, expected)| (got - expected).abs() < 1e-12);
    assert!(is_close, "{got:?} instead of {expected:?}");
}

#[test]
fn the_plain_drone_reports_the_truth() {
    for is_flying in [true, false] {
        let truth = truth(is_flying, 1.0, 2.0, 3.0);
        let reporter = Reporter::new(PLAIN.status, &truth);
        assert_eq!(reporter.reported(truth), truth);
        assert_eq!(reporter.is_flying(), is_flying);
    }
}

#[test]
fn a_velocity_is_absent_turned_mirrored_or_upside_down() {
    assert_close(velocity(|report| report.is_present = false), [0.0; 3]);
    let quarter = std::f64::consts::FRAC_PI_2;
    assert_close(velocity(|report| report.turn_rad = quarter), [-2.0, 1.0, 3.0]);
    assert_close(velocity(|report| report.is_mirrored = true), [1.0, -2.0, 3.0]);
    assert_close(velocity(|report| report.is_upside_down = true), [1.0, 2.0, -3.0]);
    let (sin, cos) = 0.2_f64.sin_cos();
    let body = [cos + 2.0 * sin, 2.0 * cos - sin, 3.0];
    assert_close(velocity(|report| report.axes = Axes::Body), body);
    let swapped = velocity(|report| (report.turn_rad, report.is_mirrored) = (-quarter, true));
    assert_close(swapped, [2.0, 1.0, 3.0]);
}

#[test]
fn a_drone_that_misses_its_drift_reports_its_own_velocity() {
    let now = truth(true, 1.0, 2.0, 3.0);
    for (measured, expected) in
        [(Measured::True, [1.0, 2.0, 3.0]), (Measured::Own, [0.9, 2.25, 3.0])]
    {
        let mut reporter = reporter(|table| table.velocity.measured = measured, &now);
        reporter.advance(&now, [-0.1, 0.25]);
        let Velocity { x_mps, y_mps, z_mps, .. } = reporter.reported(now).velocity;
        assert_close([x_mps, y_mps, z_mps], expected);
    }
}

#[test]
fn velocity_and_flag_come_late() {
    let late = |table: &mut StatusTable| {
        table.velocity.late_s = 0.2;
        table.flying_late_s = 0.1;
    };
    let mut reporter = reporter(late, &truth(false, 0.0, 0.0, 0.0));
    for k in 1..=30 {
        let now = truth(true, f64::from(k), 0.0, 0.0);
        reporter.advance(&now, [0.0; 2]);
        let reported = reporter.reported(now);
        assert_close([reported.velocity.x_mps, 0.0, 0.0], [f64::from((k - 10).max(0)), 0.0, 0.0]);
        assert_eq!(reporter.is_flying(), k > 5, "after {k} steps");
    }
}

#[test]
fn a_wrong_flag_is_wrong_and_counts_its_own_motor_time() {
    for (flying, in_the_air, on_the_ground) in [
        (FlyingFlag::Right, true, false),
        (FlyingFlag::Inverted, false, true),
        (FlyingFlag::Standing, false, false),
        (FlyingFlag::Flying, true, true),
    ] {
        for (is_flying, expected) in [(true, in_the_air), (false, on_the_ground)] {
            let now = truth(is_flying, 0.0, 0.0, 0.0);
            let mut reporter = reporter(|table| table.flying = flying, &now);
            (0..50).for_each(|_| reporter.advance(&now, [0.0; 2]));
            assert_eq!(reporter.is_flying(), expected, "{flying:?}, flies: {is_flying}");
            let motor_s = reporter.reported(now).motor_s;
            let claimed_s = if expected { 1.0 } else { 0.0 };
            let expected_s = if flying == FlyingFlag::Right { 7.0 } else { claimed_s };
            assert!((motor_s - expected_s).abs() < 1e-9, "{flying:?}: {motor_s} s");
        }
    }
}

#[test]
fn a_height_is_absent_or_drifts() {
    let now = truth(true, 0.0, 0.0, 0.0);
    let absent = reporter(|table| table.has_height = false, &now);
    assert!(absent.reported(now).pose[pose::Z].abs() < 1e-12);
    let mut drifting = reporter(|table| table.height_drift_mps = 0.1, &now);
    (0..100).for_each(|_| drifting.advance(&now, [0.0; 2]));
    let height_m = drifting.reported(now).pose[pose::Z];
    assert!((height_m - now.pose[pose::Z] - 0.2).abs() < 1e-9, "{height_m} m");
}

#[test]
fn a_heading_is_absent_mirrored_drifting_or_late() {
    let start = truth(true, 0.0, 0.0, 0.0);
    let begin = start.pose[pose::THETA];
    let after = |change: fn(&mut HeadingReport)| {
        let mut reporter = reporter(|table| change(&mut table.heading), &start);
        let mut now = start;
        for _ in 0..50 {
            now.pose[pose::THETA] += 0.01;
            reporter.advance(&now, [0.0; 2]);
        }
        reporter.reported(now).pose[pose::THETA] - begin
    };
    for (change, expected) in [
        ((|_| {}) as fn(&mut HeadingReport), 0.5),
        (|report| report.is_present = false, 0.0),
        (|report| report.is_mirrored = true, -0.5),
        (|report| report.drift_radps = -0.2, 0.3),
        (|report| report.late_s = 0.2, 0.4),
    ] {
        let got = after(change);
        assert!((got - expected).abs() < 1e-12, "{got} rad instead of {expected}");
    }
}
