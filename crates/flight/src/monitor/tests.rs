//! Each monitor beside a motion that it must accept, and beside those that it must reject.

use std::f64::consts::{FRAC_PI_2, PI};

use horizon_model::rows::{pose, stick};

use super::*;

mod direction;
mod golden;

pub(super) const DT_S: f64 = 0.02;

pub(super) fn monitors() -> Monitors {
    Monitors::new(&MonitorSettings::try_from(&MonitorTable::default()).unwrap(), DT_S)
}

/// Noise of the motion capture: repeats every 97 steps. m
pub(super) fn noise_m(k: u32, sd_m: f64) -> f64 {
    // Uniform, with a standard deviation of 0.29 of its range.
    sd_m / 0.29 * (f64::from((k * 37 + 11) % 97) / 97.0 - 0.5)
}

/// A flight along a square: one second each way, as poses and as the drone reports.
struct Flight {
    monitors: Monitors,
    k: u32,
    at: Pose,
    velocity_mps: [f64; 2],
}

/// What is wrong with a flight.
#[derive(Clone, Copy)]
struct Wrong {
    /// Velocity that the poses have beside the true one. m/s
    drift_mps: [f64; 3],
    /// How the drone reports its velocity.
    report: fn([f64; 2]) -> Option<[f64; 2]>,
    /// Angle from the direction that the inputs ask for. rad
    turn_rad: f64,
}

const RIGHT: Wrong = Wrong { drift_mps: [0.0; 3], report: Some, turn_rad: 0.0 };

impl Flight {
    fn new() -> Self {
        let mut flight =
            Self { monitors: monitors(), k: 0, at: Pose::zeros(), velocity_mps: [0.0; 2] };
        flight.monitors.update_on_ground(&flight.sample(&RIGHT, Sticks::zeros()));
        for _ in 0..100 {
            flight.at[pose::Z] += 0.5 * DT_S;
            let sample = flight.sample(&RIGHT, Sticks::zeros());
            flight.monitors.update(&sample);
        }
        flight
    }

    fn sample(&self, wrong: &Wrong, u_applied: Sticks) -> Sample {
        let mut seen = self.at;
        seen[pose::X] += noise_m(self.k, 4e-4);
        seen[pose::Y] += noise_m(self.k + 31, 4e-4);
        let tenths = |v: f64| (10.0 * v).round() / 10.0;
        let horizontal_d_mps = (wrong.report)(self.velocity_mps).map(|v| v.map(tenths));
        let height_m = Some(tenths(self.at[pose::Z]) - 0.3);
        let drone = Some(DroneMotion { horizontal_d_mps, height_m, heading_rad: None });
        Sample { pose: Some(seen), drone, u_applied, link_is_up: true }
    }

    /// Flies for `seconds`; the last findings. The poses are the true ones plus the drift.
    fn fly(&mut self, seconds: f64, wrong: &Wrong) -> Findings {
        let mut findings = Findings::default();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "30 s at most")]
        let steps = (seconds / DT_S).round() as u32;
        let mut offset_m = [0.0; 3];
        for _ in 0..steps {
            self.k += 1;
            let side = self.k / 50 % 4;
            let mut u = Sticks::zeros();
            let (asked, axis) = ([0.4, -0.4, -0.4, 0.4][side as usize], side % 2);
            u[if axis == 0 { stick::PITCH } else { stick::ROLL }] = asked;
            // Forward is x and right is -y; the vehicle follows within 0.6 s.
            let (sin, cos) = wrong.turn_rad.sin_cos();
            let (x, y) = (u[stick::PITCH], -u[stick::ROLL]);
            let target_mps = [1.8 * (cos * x - sin * y), 1.8 * (sin * x + cos * y)];
            for (v, target) in self.velocity_mps.iter_mut().zip(target_mps) {
                *v += (target - *v) * (1.0 - (-DT_S / 0.6).exp());
            }
            self.at[pose::X] += self.velocity_mps[0] * DT_S;
            self.at[pose::Y] += self.velocity_mps[1] * DT_S;
            for (offset, drift) in offset_m.iter_mut().zip(wrong.drift_mps) {
                *offset += drift * DT_S;
            }
            let mut sample = self.sample(wrong, u);
            if let Some(seen) = &mut sample.pose {
                for (row, offset) in [pose::X, pose::Y, pose::Z].into_iter().zip(offset_m) {
                    seen[row] += offset;
                }
            }
            findings = self.monitors.update(&sample);
        }
        findings
    }
}

impl Flight {
    /// Hovers for `seconds` while the poses drift, as a controller does that holds the pose: the vehicle flies
    /// against the drift. Time of the first disagreement in it. s
    fn hold(&mut self, seconds: f64, drift_mps: [f64; 3]) -> Option<f64> {
        let [x_mps, y_mps, z_mps] = drift_mps;
        self.velocity_mps = [-x_mps, -y_mps];
        let held = self.at;
        let mut u_applied = Sticks::zeros();
        let stick = |v_mps: f64| v_mps / 1.8 + 0.07 * f64::from(v_mps.abs() > 0.0).copysign(v_mps);
        (u_applied[stick::PITCH], u_applied[stick::ROLL]) = (stick(-x_mps), stick(y_mps));
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "150 s at most"
        )]
        let steps = (seconds / DT_S).round() as u32;
        let mut is_wrong = |_: &u32| {
            self.k += 1;
            self.at -= Pose::new(x_mps, y_mps, z_mps, 0.0) * DT_S;
            let mut sample = self.sample(&RIGHT, u_applied);
            if let Some(seen) = &mut sample.pose {
                *seen += held - self.at;
            }
            let findings = self.monitors.update(&sample);
            [findings.velocity, findings.height].contains(&Agreement::Disagrees)
        };
        (0..steps).find(&mut is_wrong).map(|step| f64::from(step) * DT_S)
    }
}

#[test]
fn a_drift_in_a_hover_is_refused_also_after_a_long_one_and_without_known_axes() {
    for known in [true, false] {
        for (drift_mps, end_s) in [(0.15, 20.0), (0.2, 12.0), (0.3, 8.0), (0.5, 5.0)] {
            let mut flight = Flight::new();
            if known {
                flight.fly(8.0, &RIGHT);
                assert_eq!(flight.hold(120.0, [0.0; 3]), None);
            }
            let refused_s = flight.hold(30.0, [0.0, drift_mps, 0.0]);
            println!("{drift_mps} m/s, axes known {known}: {refused_s:?} s");
            assert!(refused_s.is_some_and(|refused_s| refused_s < end_s), "{refused_s:?}");
        }
    }
}

#[test]
fn a_slow_drift_of_the_height_is_refused_before_it_is_one_metre() {
    for drift_mps in [0.018, -0.018, 0.005] {
        let mut flight = Flight::new();
        let refused_s = flight.hold(250.0, [0.0, 0.0, drift_mps]);
        let refused_m = refused_s.unwrap() * drift_mps.abs();
        println!("{drift_mps} m/s: {refused_m} m");
        assert!(refused_m < 1.0, "{refused_m}");
    }
}

#[test]
fn wrong_reports_are_no_disagreement() {
    for wrong_steps in [5, 10, 30] {
        let mut flight = Flight::new();
        flight.fly(8.0, &RIGHT);
        let refused = (0..100).any(|step| {
            let mut sample = flight.sample(&RIGHT, Sticks::zeros());
            let height_m = sample.drone.and_then(|drone| drone.height_m);
            let height_m = height_m.map(|h_m| if step < wrong_steps { h_m - 1.5 } else { h_m });
            sample.drone =
                Some(DroneMotion { horizontal_d_mps: None, height_m, heading_rad: None });
            flight.monitors.update(&sample).height == Agreement::Disagrees
        });
        assert!(!refused, "{wrong_steps} steps");
    }
}

#[test]
fn one_report_is_none_after_a_smaller_doubt_either() {
    let mut doubt = Doubt::default();
    let mut last = |error: f64, ticks: usize| {
        (0..ticks).map(|_| doubt.update(error, 1.0, 0.02)).last().unwrap()
    };
    assert_eq!(last(1.5, 15), Agreement::Doubtful);
    assert_eq!(last(0.0, 20), Agreement::Agrees);
    assert_eq!(last(2.5, 5), Agreement::Doubtful, "a report of 0.1 s");
    assert_eq!(last(2.5, 1), Agreement::Disagrees);
}

#[test]
fn a_flight_that_is_as_it_seems_raises_no_alarm_in_any_frame_of_the_drone() {
    type Report = fn([f64; 2]) -> Option<[f64; 2]>;
    let reports: [Report; 4] = [
        Some,
        |[x, y]| Some([-y, x]),
        |[x, y]| Some([y, x]),
        |[x, y]| Some([0.6 * x - 0.8 * y, -0.8 * x - 0.6 * y]),
    ];
    for report in reports {
        let findings = Flight::new().fly(30.0, &Wrong { report, ..RIGHT });
        assert_eq!(findings.velocity, Agreement::Agrees, "{findings:?}");
        assert!(findings.displacement_error_m < 0.15, "{findings:?}");
        assert_eq!(findings.height, Agreement::Agrees, "{findings:?}");
        assert_eq!((findings.still_s, findings.is_direction_wrong), (None, false));
    }
}

#[test]
fn a_drone_without_velocities_does_not_count() {
    type Report = fn([f64; 2]) -> Option<[f64; 2]>;
    let reports: [Report; 2] = [|_| None, |_| Some([0.0, 0.0])];
    for report in reports {
        let wrong = Wrong { report, drift_mps: [0.5, 0.0, 0.0], ..RIGHT };
        let findings = Flight::new().fly(20.0, &wrong);
        assert_eq!(findings.velocity, Agreement::Unknown, "{findings:?}");
        assert_eq!(findings.drone_speed_mps, None);
    }
}

#[test]
fn poses_that_drift_away_from_the_drones_motion_are_doubted_and_then_refused() {
    for (drift_mps, doubt_s, end_s) in [(1.0, 1.2, 2.2), (0.3, 3.9, 5.4), (0.15, 15.0, 17.0)] {
        let mut flight = Flight::new();
        assert_eq!(flight.fly(8.0, &RIGHT).velocity, Agreement::Agrees);
        let wrong = Wrong { drift_mps: [0.0, drift_mps, 0.0], ..RIGHT };
        let mut doubted = None;
        let mut refused = None;
        for tenth in 1..200 {
            let mut trial = Flight { monitors: flight.monitors.clone(), ..flight };
            let found = trial.fly(f64::from(tenth) * 0.1, &wrong).velocity;
            let now_s = f64::from(tenth) * 0.1;
            if found >= Agreement::Doubtful && doubted.is_none() {
                doubted = Some(now_s);
            }
            if found >= Agreement::Disagrees {
                refused = Some(now_s);
                break;
            }
        }
        let (doubted, refused) = (doubted.unwrap(), refused.unwrap());
        println!("{drift_mps} m/s: doubted after {doubted:.1} s, refused after {refused:.1} s");
        assert!(doubted <= doubt_s && refused <= end_s, "{drift_mps}: {doubted}, {refused}");
    }
}

#[test]
fn a_drift_that_begins_before_the_axes_are_known_is_refused() {
    for drift_mps in [0.5, 0.9] {
        // The vehicle is flown against the drift, as a controller does that holds the pose.
        let wrong = Wrong { drift_mps: [0.0, drift_mps, 0.0], ..RIGHT };
        let is_refused = |tenth: u32| {
            Flight::new().fly(f64::from(tenth) * 0.1, &wrong).velocity == Agreement::Disagrees
        };
        let refused = (1..100).find(|tenth| is_refused(*tenth));
        assert!(refused.is_some_and(|tenth| tenth <= 45), "{drift_mps} m/s: {refused:?}");
    }
}

#[test]
fn a_drone_in_another_unit_does_not_count() {
    let wrong = Wrong { report: |v| Some(v.map(|v| 10.0 * v)), ..RIGHT };
    for tenth in 1..100 {
        let found = Flight::new().fly(f64::from(tenth) * 0.1, &wrong).velocity;
        assert_eq!(found, Agreement::Unknown, "{tenth}");
    }
}

#[test]
fn nothing_is_compared_while_poses_are_missing_and_the_displacement_is_no_error() {
    let mut flight = Flight::new();
    flight.fly(8.0, &RIGHT);
    let drone =
        Some(DroneMotion { horizontal_d_mps: Some([1.0, 0.0]), height_m: None, heading_rad: None });
    let blind = Sample { pose: None, drone, u_applied: Sticks::zeros(), link_is_up: true };
    for _ in 0..100 {
        assert_eq!(flight.monitors.update(&blind).velocity, Agreement::Unknown);
    }
    flight.at[pose::X] += 2.0;
    let found = flight.monitors.update(&Sample { pose: Some(flight.at), ..blind });
    assert_eq!(found.velocity, Agreement::Agrees, "{found:?}");
}

#[test]
fn a_height_that_drifts_is_refused() {
    let mut flight = Flight::new();
    assert_eq!(flight.fly(3.0, &RIGHT).height, Agreement::Agrees);
    for drift_mps in [0.1, -0.1] {
        let wrong = Wrong { drift_mps: [0.0, 0.0, drift_mps], ..RIGHT };
        let mut trial = Flight { monitors: flight.monitors.clone(), ..flight };
        let findings = trial.fly(9.5, &wrong);
        assert_eq!(findings.height, Agreement::Disagrees, "{findings:?}");
    }
}

#[test]
fn settings_out_of_range_are_refused_with_their_key() {
    let check = |table: MonitorTable| MonitorSettings::try_from(&table).map(|_| ());
    let good = MonitorTable::default();
    assert_eq!(check(good.clone()), Ok(()));
    let none = MonitorTable { displacement_m: None, height_m: None, ..good.clone() };
    assert_eq!(check(none), Ok(()));
    for (table, key) in [
        (MonitorTable { still_m: 0.02, ..good.clone() }, "still_m"),
        (MonitorTable { still_m: 0.0, ..good.clone() }, "still_m"),
        (MonitorTable { displacement_m: Some(0.1), ..good.clone() }, "displacement_m"),
        (MonitorTable { height_m: Some(f64::NAN), ..good.clone() }, "height_m"),
        (MonitorTable { heading_rad: Some(1.6), ..good.clone() }, "heading_rad"),
        (MonitorTable { direction_rad: 1e9, ..good.clone() }, "direction_rad"),
    ] {
        assert_eq!(check(table).unwrap_err().key, key);
    }
}

#[test]
fn every_key_is_required_but_those_that_older_logs_lack() {
    let schema = serde_json::to_value(schemars::schema_for!(MonitorTable)).unwrap();
    let required = schema["required"].as_array().unwrap();
    assert_eq!(required.len() + 1, schema["properties"].as_object().unwrap().len(), "{schema}");
    let older =
        r#"{"still_m": 0.001, "displacement_m": null, "height_m": null, "direction_rad": 0.8}"#;
    assert_eq!(serde_json::from_str::<MonitorTable>(older).unwrap().heading_rad, Some(0.6));
    assert!(
        serde_json::from_str::<MonitorTable>(
            r#"{"still_m": 0.001, "height_m": null, "direction_rad": 0.8}"#
        )
        .is_err()
    );
}

#[test]
fn a_heading_that_is_not_the_poses_own_is_not_compared() {
    for is_its_own in [true, false] {
        let mut monitors = monitors();
        let mut u_applied = Sticks::zeros();
        u_applied[stick::YAW] = 0.5;
        let mut look = |theta_rad: f64, drone_rad: f64| {
            let drone = DroneMotion {
                horizontal_d_mps: None,
                height_m: None,
                heading_rad: Some(drone_rad),
            };
            let pose = Some(Pose::new(0.0, 0.0, 1.0, theta_rad));
            let is_step = (theta_rad - drone_rad).abs() > 1.0;
            monitors.note_heading_measured(is_its_own || !is_step);
            let sample = Sample { pose, drone: Some(drone), u_applied, link_is_up: true };
            monitors.update(&sample).heading
        };
        for k in 0..100 {
            let theta_rad = 0.5 * DT_S * f64::from(k);
            assert!(look(theta_rad, theta_rad) <= Agreement::Agrees);
        }
        let expected = if is_its_own { Agreement::Doubtful } else { Agreement::Unknown };
        assert_eq!(look(2.4, 1.0), expected, "{is_its_own}");
    }
}

#[test]
fn a_still_height_counts_against_an_excess_of_the_throttle_alone() {
    let still = stillness::Still { rows_s: [None, None, Some(1.0)], ..stillness::Still::default() };
    for (throttle, is_found) in [(0.18, false), (0.3, true)] {
        let mut frozen = FrozenMonitor::new(DT_S);
        let found = (0..400).find(|k| {
            let u_applied = Sticks::new(0.0, 0.0, 0.0, throttle * f64::from(1 - k / 200 * 2));
            let sample = Sample { pose: None, drone: None, u_applied, link_is_up: true };
            frozen.update(&still, &sample, Agreement::Agrees).is_some()
        });
        assert_eq!(found.is_some(), is_found, "{throttle}");
    }
}
