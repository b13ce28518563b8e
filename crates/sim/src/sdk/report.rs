//! Status of the drone in the text SDK, in the units of the SDK.

use horizon_model::rows::pose;
use tello_io::tello::text::{Field, Query, StateLine};

use crate::drone::{DronePhase, Truth};
use crate::firmware::SdkVersion;
use crate::world::whole_percent;

/// Reading of the distance sensor on the floor. cm
const TOF_FLOOR_CM: f64 = 10.0;
/// Temperatures of a drone that has flown a little. degrees Celsius
const TEMPERATURES: (f64, f64) = (61.0, 63.0);
/// Height by air pressure of the floor. m
const BARO_FLOOR_M: f64 = 138.82;
/// Gravity at rest. 0.001 g
const GRAVITY_MG: f64 = -1000.0;

/// The state line, as the firmware of `version` sends it.
pub(super) fn state_line(truth: &Truth, version: SdkVersion, theta_start: f64) -> StateLine {
    let height_m = truth.pose[pose::Z];
    let yaw_deg = yaw_deg(truth, theta_start);
    let line = match version {
        SdkVersion::V1_3 => StateLine::default(),
        SdkVersion::V2_0 | SdkVersion::V3_0 => no_pad(),
    };
    line.with(Field::Pitch, 0.0)
        .with(Field::Roll, 0.0)
        .with(Field::Yaw, yaw_deg)
        .with(Field::Vgx, tenths(truth.velocity.x_mps))
        .with(Field::Vgy, tenths(truth.velocity.y_mps))
        .with(Field::Vgz, tenths(-truth.velocity.z_mps))
        .with(Field::Templ, TEMPERATURES.0)
        .with(Field::Temph, TEMPERATURES.1)
        .with(Field::Tof, (100.0 * height_m).trunc().max(TOF_FLOOR_CM))
        .with(Field::H, height_cm(truth))
        .with(Field::Bat, f64::from(whole_percent(truth.battery_pct)))
        .with(Field::Baro, BARO_FLOOR_M + height_m)
        .with(Field::Time, truth.motor_s.trunc())
        .with(Field::Agx, 0.0)
        .with(Field::Agy, 0.0)
        .with(Field::Agz, GRAVITY_MG)
}

/// Heading since power-up, clockwise from above: -180..=180, and no -0. degrees
fn yaw_deg(truth: &Truth, theta_start: f64) -> f64 {
    let yaw_deg = -(truth.pose[pose::THETA] - theta_start).to_degrees();
    (yaw_deg - 360.0 * (yaw_deg / 360.0).round()).trunc() + 0.0
}

/// State line of a drone with mission pads that looks for none.
fn no_pad() -> StateLine {
    let away = -200.0;
    let mut line = StateLine::default()
        .with(Field::Mid, -2.0)
        .with(Field::X, away)
        .with(Field::Y, away)
        .with(Field::Z, away);
    line.mpry = Some([0; 3]);
    line
}

/// The reply to `query`; `None` if this version does not know it.
pub(super) fn answer(
    query: Query,
    truth: &Truth,
    version: SdkVersion,
    theta_start: f64,
) -> Option<String> {
    let is_later = version >= SdkVersion::V2_0;
    let height_m = truth.pose[pose::Z];
    Some(match query {
        Query::Battery => whole_percent(truth.battery_pct).to_string(),
        Query::Speed => "100.0".into(),
        Query::Time => format!("{}s", truth.motor_s.trunc()),
        Query::Wifi => "90".into(),
        Query::Ssid if version == SdkVersion::V3_0 => "TELLO-SIM".into(),
        Query::Sdk if version == SdkVersion::V3_0 => "30".into(),
        Query::Sdk if is_later => "20".into(),
        Query::SerialNumber if is_later => "0TQDG7BEDB0E9P".into(),
        Query::Height => format!("{}dm", height_cm(truth) / 10.0),
        Query::Temperature => format!("{}~{}C", TEMPERATURES.0, TEMPERATURES.1),
        Query::Attitude => format!("pitch:0;roll:0;yaw:{};", yaw_deg(truth, theta_start)),
        Query::Barometer => format!("{:.6}", BARO_FLOOR_M + height_m),
        Query::Acceleration => format!("agx:0.00;agy:0.00;agz:{GRAVITY_MG:.2};"),
        Query::TimeOfFlight => format!("{}mm", (1000.0 * height_m).trunc().max(100.0)),
        Query::Ssid | Query::Sdk | Query::SerialNumber => return None,
    })
}

/// Steps of 10, and nothing on the floor.
fn height_cm(truth: &Truth) -> f64 {
    if truth.phase == DronePhase::Grounded {
        0.0
    } else {
        10.0 * (10.0 * truth.pose[pose::Z]).trunc()
    }
}

/// In tenths of the unit, without -0.
fn tenths(value: f64) -> f64 {
    (10.0 * value).trunc() + 0.0
}

#[cfg(test)]
mod tests {
    use horizon_model::rows::Pose;

    use super::*;
    use crate::ReceivedOrders;
    use crate::plant::Velocity;

    fn truth(height_m: f64, theta: f64) -> Truth {
        Truth {
            pose: Pose::new(0.0, 0.0, height_m, theta),
            velocity: Velocity { x_mps: 0.57, y_mps: -0.04, z_mps: 0.31, yaw_radps: 0.0 },
            phase: DronePhase::Flying,
            link_is_up: true,
            battery_pct: 41.2,
            motor_s: 12.9,
            received: ReceivedOrders::default(),
        }
    }

    #[test]
    fn the_heading_is_clockwise_whole_and_within_half_a_turn() {
        for (turned_deg, expected) in [
            (0.0, 0.0),
            (0.4, 0.0),
            (-90.4, 90.0),
            (90.4, -90.0),
            (200.5, 159.0),
            (-540.5, -179.0),
            (725.0, -5.0),
        ] {
            let got = yaw_deg(&truth(1.0, 0.3 + f64::to_radians(turned_deg)), 0.3);
            assert_eq!(got.to_bits(), f64::to_bits(expected), "{got} after {turned_deg} degrees");
        }
    }

    #[test]
    fn velocities_come_in_decimetres_and_down_is_positive() {
        let line = state_line(&truth(1.0, 0.0), SdkVersion::V1_3, 0.0);
        for (field, expected) in [(Field::Vgx, 5.0), (Field::Vgy, 0.0), (Field::Vgz, -3.0)] {
            assert_eq!(
                line.get(field).map(f64::to_bits),
                Some(f64::to_bits(expected)),
                "{field:?}"
            );
        }
    }

    #[test]
    fn heights_come_in_steps_and_the_distance_sensor_has_a_least() {
        let read = |truth: &Truth| {
            let line = state_line(truth, SdkVersion::V2_0, 0.0);
            [Field::H, Field::Tof, Field::Baro].map(|field| line.get(field).unwrap())
        };
        let near = |got: [f64; 3], expected: [f64; 3]| {
            let gaps = got.iter().zip(expected).map(|(got, expected)| (got - expected).abs());
            assert!(
                gaps.fold(0.0, horizon_model::check::maximum) < 1e-9,
                "{got:?}, not {expected:?}"
            );
        };
        near(read(&truth(1.287, 0.0)), [120.0, 128.0, 138.82 + 1.287]);
        near(read(&truth(0.05, 0.0)), [0.0, 10.0, 138.87]);
        let grounded = Truth { phase: DronePhase::Grounded, ..truth(1.287, 0.0) };
        near(read(&grounded), [0.0, 128.0, 138.82 + 1.287]);
    }

    #[test]
    fn a_later_sdk_speaks_of_mission_pads_and_knows_more_questions() {
        let answered = |version| {
            [Query::Sdk, Query::SerialNumber, Query::Ssid]
                .map(|query| answer(query, &truth(1.0, 0.0), version, 0.0))
        };
        assert_eq!(answered(SdkVersion::V1_3), [None, None, None]);
        assert_eq!(answered(SdkVersion::V2_0)[0].as_deref(), Some("20"));
        assert_eq!(answered(SdkVersion::V2_0)[2], None);
        assert_eq!(answered(SdkVersion::V3_0)[0].as_deref(), Some("30"));
        assert!(answered(SdkVersion::V3_0).iter().all(Option::is_some));
        let pad = |version| state_line(&truth(1.0, 0.0), version, 0.0).get(Field::Mid);
        assert_eq!((pad(SdkVersion::V1_3), pad(SdkVersion::V2_0)), (None, Some(-2.0)));
    }

    #[test]
    fn answers_have_the_units_of_the_sdk() {
        for (query, expected) in [
            (Query::Battery, "42"),
            (Query::Time, "12s"),
            (Query::Height, "12dm"),
            (Query::TimeOfFlight, "1287mm"),
            (Query::Temperature, "61~63C"),
            (Query::Barometer, "140.107000"),
            (Query::Attitude, "pitch:0;roll:0;yaw:-45;"),
        ] {
            let got = answer(query, &truth(1.287, 0.79), SdkVersion::V1_3, 0.0);
            assert_eq!(got.as_deref(), Some(expected), "{query:?}");
        }
        let floor = answer(Query::TimeOfFlight, &truth(0.05, 0.0), SdkVersion::V1_3, 0.0);
        assert_eq!(floor.as_deref(), Some("100mm"));
    }
}
