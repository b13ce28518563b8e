//! Findings over scripted flights, compared with recorded ones digit by digit: an arithmetic change of any
//! monitor must show here and be looked at.

use std::fmt::Write;

use nalgebra::Complex;

use super::*;

/// Findings every 0.2 s, recorded by the test itself (it prints what it got).
const RECORDED: &str = include_str!("golden.txt");

/// One scripted flight.
struct Script {
    name: &'static str,
    /// Angle from the direction that the inputs ask for. rad
    turn_rad: f64,
    /// Heading rate. rad/s
    yaw_radps: f64,
    /// Velocity of the poses beside the true one. m/s
    drift_mps: [f64; 3],
    /// When the drift begins. s
    drift_from_s: f64,
    /// Velocity that the drone reports, of the true one and the heading.
    report: fn(Complex<f64>, f64) -> Complex<f64>,
    /// Inputs that hold the vehicle against the drift after its begin.
    is_held: bool,
}

const SCRIPTS: [Script; 6] = [
    Script {
        name: "drift of poses, axes of the body",
        turn_rad: 0.1,
        yaw_radps: 0.4,
        drift_mps: [0.2, 0.3, -0.15],
        drift_from_s: 6.0,
        report: |v, theta| v * Complex::from_polar(1.0, 0.7 - theta),
        is_held: false,
    },
    Script {
        name: "drift before the axes are known",
        turn_rad: -0.2,
        yaw_radps: 0.1,
        drift_mps: [0.0, 0.6, 0.05],
        drift_from_s: 0.0,
        report: |v, _| v.conj() * Complex::from_polar(1.0, -1.2),
        is_held: true,
    },
    Script {
        name: "no drift, axes unknown for long",
        turn_rad: 0.3,
        yaw_radps: -0.3,
        drift_mps: [0.0; 3],
        drift_from_s: 0.0,
        report: |v, theta| 0.5 * (v * Complex::from_polar(1.0, theta)).conj(),
        is_held: false,
    },
    Script {
        name: "heading wrong by a right angle",
        turn_rad: FRAC_PI_2,
        yaw_radps: 0.2,
        drift_mps: [0.0; 3],
        drift_from_s: 0.0,
        report: |v, _| v,
        is_held: false,
    },
    Script {
        name: "wrong by a little less than the limit",
        turn_rad: -0.7,
        yaw_radps: 0.0,
        drift_mps: [0.0, 0.0, 0.06],
        drift_from_s: 3.0,
        report: |v, _| -v,
        is_held: false,
    },
    Script {
        name: "slow drift",
        turn_rad: 0.0,
        yaw_radps: 0.05,
        drift_mps: [0.09, 0.0, -0.05],
        drift_from_s: 5.0,
        report: |v, _| v * Complex::new(0.0, 1.0),
        is_held: false,
    },
];

/// Flies `script` and writes what is found.
fn fly(script: &Script, to: &mut String) {
    let mut monitors = monitors();
    let tenths = |v: f64| (10.0 * v).round() / 10.0;
    let (mut at, mut seen_offset_m) = (Pose::new(0.3, -0.2, 0.05, 0.4), [0.0; 3]);
    let mut v_w = Complex::new(0.0, 0.0);
    writeln!(to, "# {}", script.name).unwrap();
    for k in 0..600_u32 {
        let t_s = f64::from(k) * DT_S;
        let is_on_ground = t_s < 0.3;
        let (forward, left) = ((1.3 * t_s).sin() * 0.6, (0.9 * t_s + 0.4).cos() * 0.4);
        let mut u_applied = Sticks::zeros();
        if !is_on_ground {
            (u_applied[stick::PITCH], u_applied[stick::ROLL]) = (forward, -left);
            let direction = Complex::from_polar(1.0, at[pose::THETA] + script.turn_rad);
            let mut target = 1.9 * Complex::new(forward, left) * direction;
            if script.is_held && t_s > script.drift_from_s + 1.5 {
                target -= Complex::new(script.drift_mps[0], script.drift_mps[1]);
            }
            v_w += (target - v_w) * (1.0 - (-DT_S / 0.55).exp());
            at[pose::Z] = (at[pose::Z] + 0.5 * DT_S).min(1.2 + 0.1 * (0.7 * t_s).sin());
            at[pose::THETA] += script.yaw_radps * DT_S;
            at[pose::X] += v_w.re * DT_S;
            at[pose::Y] += v_w.im * DT_S;
        }
        if t_s >= script.drift_from_s && !is_on_ground {
            for (offset, drift) in seen_offset_m.iter_mut().zip(script.drift_mps) {
                *offset += drift * DT_S;
            }
        }
        let mut seen = at;
        for (row, offset) in [pose::X, pose::Y, pose::Z].into_iter().zip(seen_offset_m) {
            seen[row] += offset + noise_m(k + 7 * u32::try_from(row).unwrap(), 4e-4);
        }
        let v = (script.report)(v_w, at[pose::THETA]);
        let drone = DroneMotion {
            horizontal_d_mps: (k % 211 > 4).then(|| [tenths(v.re), tenths(v.im)]),
            height_m: Some(tenths(at[pose::Z]) - 0.3),
            heading_rad: None,
        };
        let sample = Sample {
            pose: (k % 53 > 3).then_some(seen),
            drone: (k % 307 > 9).then_some(drone),
            u_applied,
            link_is_up: !(430..450).contains(&k),
        };
        if is_on_ground {
            monitors.update_on_ground(&sample);
            continue;
        }
        let found = monitors.update(&sample);
        if k % 10 == 0 {
            writeln!(
                to,
                "{t_s:.2} {:?} {:.9} {:?} {:?} {:.9} {:.9?} {} {:.6?}",
                found.velocity,
                found.displacement_error_m,
                found.drone_speed_mps,
                found.height,
                found.height_error_m,
                found.direction_error_rad,
                found.is_direction_wrong,
                found.still_s
            )
            .unwrap();
        }
    }
}

#[test]
fn findings_are_those_that_were_recorded() {
    let mut got = String::new();
    for script in &SCRIPTS {
        fly(script, &mut got);
    }
    let differs = got.lines().zip(RECORDED.lines()).position(|(got, recorded)| got != recorded);
    assert!(
        got.lines().count() == RECORDED.lines().count() && differs.is_none(),
        "line {:?} differs; if that is intended, this goes into golden.txt:\n{got}",
        differs.map(|line| line + 1)
    );
}

#[test]
fn stillness_is_found_when_it_was_recorded() {
    // Steps until a pose at rest is found, by its noise (standard deviation, m) and speed (m/s).
    let found = |sd_m: f64, speed_mps: f64, axis: usize| {
        let mut stillness = StillnessMonitor::new(0.0015, DT_S);
        (0..300_u32).position(|k| {
            let mut at = Pose::new(
                noise_m(k, sd_m),
                noise_m(k + 13, sd_m),
                1.0 + noise_m(k + 57, sd_m),
                f64::from(k) * 0.1,
            );
            // In motion for a second, then slow.
            at[axis] += 0.3 * f64::from(k.min(50)) * DT_S + speed_mps * f64::from(k) * DT_S;
            stillness.update(Some(&at)).all_s.is_some()
        })
    };
    for (sd_m, speed_mps, axis, steps) in [
        (0.0, 0.0, pose::X, Some(88)),
        (4e-4, 0.0, pose::Y, Some(88)),
        (1e-3, 0.0, pose::Z, Some(88)),
        (0.0, 0.0024, pose::X, Some(89)),
        (0.0, 0.0026, pose::Z, None),
    ] {
        assert_eq!(found(sd_m, speed_mps, axis), steps, "{sd_m} m, {speed_mps} m/s, row {axis}");
    }
}

#[test]
fn doubt_adds_up_to_disagreement_and_leaks_slowly() {
    let mut doubt = Doubt::default();
    let mut on = |error: f64, times: usize| {
        (0..times).map(|_| doubt.update(error, 1.0, 0.25)).last().unwrap()
    };
    assert_eq!(on(1.0, 1), Agreement::Agrees);
    assert_eq!(on(1.01, 5), Agreement::Doubtful);
    assert_eq!(on(2.0, 1), Agreement::Disagrees);
    // 1.5 s of doubt less 0.2 of 2.25 s leave 1.05 s.
    assert_eq!(on(0.5, 9), Agreement::Agrees);
    assert_eq!(on(2.0, 1), Agreement::Doubtful);
    assert_eq!(on(1.5, 1), Agreement::Disagrees);
    assert_eq!(on(0.0, 1000), Agreement::Agrees);
    assert_eq!(on(2.0, 1), Agreement::Doubtful);
    assert_eq!(on(2.001, 1), Agreement::Disagrees);
    assert_eq!(on(f64::NAN, 1), Agreement::Disagrees);
}

#[test]
fn the_direction_is_forgotten_on_request() {
    let mut flight = Flight::new();
    let findings = flight.fly(3.0, &Wrong { turn_rad: PI, ..RIGHT });
    assert!(findings.is_direction_wrong);
    flight.monitors.restart_heading_and_direction();
    let findings = flight.fly(DT_S, &RIGHT);
    assert_eq!((findings.direction_error_rad, findings.is_direction_wrong), (None, false));
}

#[test]
fn stillness_is_forgotten_on_reset() {
    let mut stillness = StillnessMonitor::new(0.0015, DT_S);
    let here = Pose::new(1.0, 2.0, 1.0, 0.0);
    assert!((0..60).fold(None, |_, _| stillness.update(Some(&here)).all_s).is_some());
    stillness.reset();
    let steps = (0..60).take_while(|_| stillness.update(Some(&here)).all_s.is_none()).count();
    assert_eq!(steps, 39, "0.8 s of poses are needed again");
}

#[test]
fn the_direction_needs_half_a_second_of_motion() {
    let mut direction = DirectionMonitor::new(0.785, DT_S);
    let (mut at, mut v_mps) = (Pose::zeros(), 0.0);
    let mut u_applied = Sticks::zeros();
    // Stronger than any input, so that the length of the motion is what decides.
    u_applied[stick::PITCH] = 20.0;
    let steps = (0..100).take_while(|_| {
        v_mps += (1.9 * u_applied[stick::PITCH] - v_mps) * (1.0 - (-DT_S / 0.6).exp());
        at[pose::X] += v_mps * DT_S;
        let sample = Sample { pose: Some(at), drone: None, u_applied, link_is_up: true };
        direction.update(&sample).0.is_none()
    });
    // The first pose has no displacement; the time is forgotten as it is summed up.
    assert_eq!(steps.count(), 27);
}
