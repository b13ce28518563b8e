//! Which values a fault may have.

use std::slice;

use horizon_model::setting::{SettingError, in_range};

use super::InjectedFault;

/// Offsets. m
const OFFSET_M: [f64; 2] = [-100.0, 100.0];
/// Standard deviations, their growth and other sizes. m, rad, m/s, rad/s
const SIZE: [f64; 2] = [0.0, 100.0];
/// Velocities. m/s
const VELOCITY_MPS: [f64; 2] = [-10.0, 10.0];
/// Angles and rates of the heading. rad, rad/s
const TURN: [f64; 2] = [-10.0, 10.0];
/// Times that are at least one step. s
const TIME_S: [f64; 2] = [crate::DT_S, 1e3];
/// Smallest value accepted as positive. In the unit of the value
const SMALL: f64 = 1e-6;

/// Least and largest value of each key of a fault, also of each number of a list.
const RANGES: [(&str, [f64; 2]); 21] = [
    ("offset_m", OFFSET_M),
    ("noise_m", SIZE),
    ("noise_rad", SIZE),
    ("growth_mps", SIZE),
    ("growth_radps", SIZE),
    ("sway_m", SIZE),
    ("lowered_m", SIZE),
    ("radius_m", [SMALL, 100.0]),
    ("speed_mps", [0.0, 10.0]),
    ("velocity_mps", VELOCITY_MPS),
    ("turn_rad", TURN),
    ("yaw_radps", TURN),
    ("fraction", [0.0, 1.0]),
    ("scale", [SMALL, 1e6]),
    ("period_s", TIME_S),
    ("lost_s", TIME_S),
    ("delay_s", [0.0, 1e3]),
    ("growth", [0.0, 10.0]),
    // The largest is more than a relay sends.
    ("bytes_per_s", [SMALL, 1e9]),
    ("sticks", [-1.0, 1.0]),
    ("rate_hz", [SMALL, 1.0 / crate::DT_S]),
];

impl InjectedFault {
    /// Accepts the values of the fault. A number whose key has no range is never accepted.
    ///
    /// # Errors
    /// The first value outside of its range.
    pub(super) fn check(&self) -> Result<(), SettingError> {
        // A fault without values is a text.
        let written = serde_json::to_value(self).unwrap_or_default();
        for (name, values) in written.as_object().into_iter().flatten() {
            for (key, value) in values.as_object().into_iter().flatten() {
                let range = RANGES.iter().find(|(ranged, _)| ranged == key);
                let [low, high] = range.map_or([f64::NAN; 2], |(_, range)| *range);
                let numbers = value.as_array().map_or(slice::from_ref(value), Vec::as_slice);
                for number in numbers.iter().filter(|number| !number.is_boolean()) {
                    // JSON has no number that is not finite.
                    let number = number.as_f64().unwrap_or(f64::NAN);
                    in_range(&format!("{name}.{key}"), number, low..=high)?;
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each fault with a value at `at`, its key, the least and the largest of what it may be.
    type Rule = (&'static str, fn(f64) -> InjectedFault, [f64; 2]);

    const RULES: [Rule; 31] = [
        (
            "drone_held.sway_m",
            |sway_m| InjectedFault::DroneHeld { sway_m, lowered_m: 0.0 },
            [0.0, 100.0],
        ),
        (
            "drone_held.lowered_m",
            |lowered_m| InjectedFault::DroneHeld { sway_m: 0.0, lowered_m },
            [0.0, 100.0],
        ),
        (
            "drone_pushed.velocity_mps",
            |at| InjectedFault::DronePushed { velocity_w_mps: [0.0, at, 0.0] },
            [-10.0, 10.0],
        ),
        ("mocap_still.offset_m", |at| still([0.0, at, 0.0], [0.0; 3]), [-100.0, 100.0]),
        ("mocap_still.turn_rad", |at| still([0.0; 3], [at, 0.0, 0.0]), [-10.0, 10.0]),
        ("mocap_still.noise_m", |at| still([0.0; 3], [0.0, at, 0.0]), [0.0, 100.0]),
        ("mocap_still.noise_rad", |at| still([0.0; 3], [0.0, 0.0, at]), [0.0, 100.0]),
        (
            "mocap_axes_stuck.noise_m",
            |noise_m| InjectedFault::MocapAxesStuck { axes: [true; 3], noise_m },
            [0.0, 100.0],
        ),
        (
            "mocap_walker.offset_m",
            |at| walker([0.0, 0.0, at], [1.0, 0.0, 0.0, 0.0]),
            [-100.0, 100.0],
        ),
        ("mocap_walker.radius_m", |at| walker([0.0; 3], [at, 0.0, 0.0, 0.0]), [1e-6, 100.0]),
        ("mocap_walker.speed_mps", |at| walker([0.0; 3], [1.0, at, 0.0, 0.0]), [0.0, 10.0]),
        ("mocap_walker.noise_m", |at| walker([0.0; 3], [1.0, 0.0, at, 0.0]), [0.0, 100.0]),
        ("mocap_walker.noise_rad", |at| walker([0.0; 3], [1.0, 0.0, 0.0, at]), [0.0, 100.0]),
        (
            "mocap_drift.velocity_mps",
            |at| InjectedFault::MocapDrift { velocity_w_mps: [0.0, at, 0.0], yaw_radps: 0.0 },
            [-10.0, 10.0],
        ),
        (
            "mocap_drift.yaw_radps",
            |yaw_radps| InjectedFault::MocapDrift { velocity_w_mps: [0.0; 3], yaw_radps },
            [-10.0, 10.0],
        ),
        ("mocap_frame.turn_rad", |at| frame(at, 1.0), [-10.0, 10.0]),
        ("mocap_frame.scale", |at| frame(0.0, at), [1e-6, 1e6]),
        (
            "mocap_heading.turn_rad",
            |turn_rad| InjectedFault::MocapHeading { turn_rad },
            [-10.0, 10.0],
        ),
        ("mocap_noise.growth_mps", |at| noise(at, 0.0), [0.0, 100.0]),
        ("mocap_noise.growth_radps", |at| noise(0.0, at), [0.0, 100.0]),
        ("mocap_occluded.period_s", |at| occluded(at, 1.0), [0.02, 1000.0]),
        ("mocap_occluded.lost_s", |at| occluded(1.0, at), [0.02, 1000.0]),
        (
            "mocap_split.offset_m",
            |at| InjectedFault::MocapSplit { offset_w_m: [0.0, at, 0.0], fraction: 0.5 },
            [-100.0, 100.0],
        ),
        (
            "mocap_split.fraction",
            |fraction| InjectedFault::MocapSplit { offset_w_m: [0.0; 3], fraction },
            [0.0, 1.0],
        ),
        (
            "mocap_shifted.offset_m",
            |at| InjectedFault::MocapShifted { offset_w_m: [0.0, at, 0.0] },
            [-100.0, 100.0],
        ),
        ("mocap_lag.delay_s", |delay_s| InjectedFault::MocapLag { delay_s }, [0.0, 1000.0]),
        ("mocap_lag_ramp.growth", |growth| InjectedFault::MocapLagRamp { growth }, [0.0, 10.0]),
        (
            "mocap_slow_link.bytes_per_s",
            |bytes_per_s| InjectedFault::MocapSlowLink { bytes_per_s },
            [1e-6, 1e9],
        ),
        ("second_controller.sticks", |at| second([0.0, 0.0, at, 0.0], 20.0), [-1.0, 1.0]),
        ("second_controller.rate_hz", |at| second([0.0; 4], at), [1e-6, 50.0]),
        ("second_controller.sticks", |at| second([at, 0.0, 0.0, 0.0], 20.0), [-1.0, 1.0]),
    ];

    const fn still(
        offset_w_m: [f64; 3],
        [turn_rad, noise_m, noise_rad]: [f64; 3],
    ) -> InjectedFault {
        InjectedFault::MocapStill { offset_w_m, turn_rad, noise_m, noise_rad }
    }

    const fn walker(
        offset_w_m: [f64; 3],
        [radius_m, speed_mps, noise_m, noise_rad]: [f64; 4],
    ) -> InjectedFault {
        InjectedFault::MocapWalker { offset_w_m, radius_m, speed_mps, noise_m, noise_rad }
    }

    const fn frame(turn_rad: f64, scale: f64) -> InjectedFault {
        InjectedFault::MocapFrame { turn_rad, scale, is_mirrored: false }
    }

    const fn noise(growth_mps: f64, growth_radps: f64) -> InjectedFault {
        InjectedFault::MocapNoise { growth_mps, growth_radps }
    }

    const fn occluded(period_s: f64, lost_s: f64) -> InjectedFault {
        InjectedFault::MocapOccluded { period_s, lost_s }
    }

    const fn second(sticks: [f64; 4], rate_hz: f64) -> InjectedFault {
        InjectedFault::SecondController { sticks, rate_hz }
    }

    #[test]
    fn every_value_is_accepted_up_to_its_limits_and_refused_beyond() {
        for (key, fault, [least, most]) in RULES {
            for at in [least, most] {
                assert!(fault(at).check().is_ok(), "{key} = {at}");
            }
            // Beyond by a millionth of the range, or below the smallest positive number.
            let aside = 1e-6 * (most - least);
            for at in [least - aside, most + aside, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                assert_eq!(fault(at).check().unwrap_err().key, key, "{at}");
            }
        }
    }

    #[test]
    fn keys_of_messages_are_the_keys_of_the_settings() {
        for (key, fault, [least, _]) in RULES {
            let written = serde_json::to_value(fault(least)).unwrap();
            let value = written.pointer(&format!("/{}", key.replace('.', "/")));
            assert!(value.is_some(), "{key}: {written}");
            let (name, _) = key.split_once('.').unwrap();
            for (field, _) in written[name].as_object().unwrap().iter().filter(|(_, v)| !is_flag(v))
            {
                let key = format!("{name}.{field}");
                assert!(RULES.iter().any(|(rule, ..)| *rule == key), "no rule for {key}");
            }
        }
    }

    /// Whether a value has no range: true, false, or several of them.
    fn is_flag(value: &serde_json::Value) -> bool {
        value.is_boolean() || value[0].is_boolean()
    }

    #[test]
    fn faults_without_values_are_always_accepted() {
        for fault in [
            InjectedFault::MocapLost,
            InjectedFault::DroneReboot { falls: true },
            InjectedFault::ControlStalled,
        ] {
            assert!(fault.check().is_ok(), "{fault:?}");
        }
    }
}
