//! Which values a fault may have.

use horizon_model::setting::{SettingError, in_range};

use super::InjectedFault;

/// Largest offset, radius or noise. m
const SIZE_MAX_M: f64 = 100.0;
/// Largest speed. m/s
const SPEED_MAX_MPS: f64 = 10.0;
/// Largest angle, rate or noise of the heading. rad, rad/s
const TURN_MAX: f64 = 10.0;
/// Longest time. s
const TIME_MAX_S: f64 = 1e3;
/// Shortest time: one step. s
const TIME_MIN_S: f64 = crate::DT_S;
/// Fastest link: more than a relay sends. 1/s
const BYTES_PER_S_MAX: f64 = 1e9;
/// Smallest value accepted as positive. In the unit of the value
const SMALL: f64 = 1e-6;

impl InjectedFault {
    /// Accepts the values of the fault.
    ///
    /// # Errors
    /// The first value outside of its range.
    pub(super) fn check(&self) -> Result<(), SettingError> {
        let size = |key: &str, values: &[f64]| all(key, values, -SIZE_MAX_M, SIZE_MAX_M);
        let sd = |key: &str, value: f64| all(key, &[value], 0.0, SIZE_MAX_M);
        let speed = |key: &str, values: &[f64]| all(key, values, -SPEED_MAX_MPS, SPEED_MAX_MPS);
        let turn = |key: &str, value: f64| all(key, &[value], -TURN_MAX, TURN_MAX);
        match *self {
            Self::MocapStill { offset_w_m, turn_rad, noise_m, noise_rad } => {
                size("mocap_still.offset_m", &offset_w_m)?;
                turn("mocap_still.turn_rad", turn_rad)?;
                sd("mocap_still.noise_m", noise_m)?;
                sd("mocap_still.noise_rad", noise_rad)
            }
            Self::MocapSplit { offset_w_m, fraction } => {
                size("mocap_split.offset_m", &offset_w_m)?;
                all("mocap_split.fraction", &[fraction], 0.0, 1.0)
            }
            Self::MocapShifted { offset_w_m } => size("mocap_shifted.offset_m", &offset_w_m),
            Self::MocapAxesStuck { axes: _, noise_m } => sd("mocap_axes_stuck.noise_m", noise_m),
            Self::MocapWalker { offset_w_m, radius_m, speed_mps, noise_m, noise_rad } => {
                size("mocap_walker.offset_m", &offset_w_m)?;
                all("mocap_walker.radius_m", &[radius_m], SMALL, SIZE_MAX_M)?;
                all("mocap_walker.speed_mps", &[speed_mps], 0.0, SPEED_MAX_MPS)?;
                sd("mocap_walker.noise_m", noise_m)?;
                sd("mocap_walker.noise_rad", noise_rad)
            }
            Self::MocapDrift { velocity_w_mps, yaw_radps } => {
                speed("mocap_drift.velocity_mps", &velocity_w_mps)?;
                turn("mocap_drift.yaw_radps", yaw_radps)
            }
            Self::MocapFrame { turn_rad, scale, is_mirrored: _ } => {
                turn("mocap_frame.turn_rad", turn_rad)?;
                all("mocap_frame.scale", &[scale], SMALL, 1e6)
            }
            Self::MocapHeading { turn_rad } => turn("mocap_heading.turn_rad", turn_rad),
            Self::MocapNoise { growth_mps, growth_radps } => {
                sd("mocap_noise.growth_mps", growth_mps)?;
                sd("mocap_noise.growth_radps", growth_radps)
            }
            Self::MocapOccluded { period_s, lost_s } => {
                all("mocap_occluded.period_s", &[period_s], TIME_MIN_S, TIME_MAX_S)?;
                all("mocap_occluded.lost_s", &[lost_s], TIME_MIN_S, TIME_MAX_S)
            }
            Self::MocapLag { delay_s } => all("mocap_lag.delay_s", &[delay_s], 0.0, TIME_MAX_S),
            Self::MocapLagRamp { growth } => all("mocap_lag_ramp.growth", &[growth], 0.0, 10.0),
            Self::MocapSlowLink { bytes_per_s } => {
                all("mocap_slow_link.bytes_per_s", &[bytes_per_s], SMALL, BYTES_PER_S_MAX)
            }
            Self::DroneHeld { sway_m, lowered_m } => check_held(sway_m, lowered_m),
            Self::DronePushed { velocity_w_mps: v } => speed("drone_pushed.velocity_mps", &v),
            Self::SecondController { sticks, rate_hz } => check_second(&sticks, rate_hz),
            Self::MocapLost
            | Self::MocapSilent
            | Self::MocapFixed
            | Self::MocapFrozen
            | Self::MocapNan
            | Self::MocapFar
            | Self::MocapAside
            | Self::MocapFlipped
            | Self::MocapMillimetres
            | Self::MocapOther
            | Self::DroneDeaf
            | Self::DroneMute
            | Self::DroneSticksStuck
            | Self::DroneRefusesLand
            | Self::DroneReboot { .. }
            | Self::ControlStalled => Ok(()),
        }
    }
}

fn check_held(sway_m: f64, lowered_m: f64) -> Result<(), SettingError> {
    all("drone_held.sway_m", &[sway_m], 0.0, SIZE_MAX_M)?;
    all("drone_held.lowered_m", &[lowered_m], 0.0, SIZE_MAX_M)
}

fn check_second(sticks: &[f64], rate_hz: f64) -> Result<(), SettingError> {
    all("second_controller.sticks", sticks, -1.0, 1.0)?;
    all("second_controller.rate_hz", &[rate_hz], SMALL, 1.0 / crate::DT_S)
}

fn all(key: &str, values: &[f64], low: f64, high: f64) -> Result<(), SettingError> {
    values.iter().try_for_each(|value| in_range(key, *value, low..=high).map(|_| ()))
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
