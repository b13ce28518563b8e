//! What the drone says of itself in the text SDK, in the units of the SDK.

use horizon_model::rows::pose;
use tello_io::tello::text::{Field, Query, StateLine};

use crate::drone::{Phase, Truth};
use crate::firmware::SdkVersion;
use crate::wire::whole_percent;

/// What the distance sensor reads on the floor. cm
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

/// What drones with mission pads say while they look for none.
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
    if truth.phase == Phase::Grounded { 0.0 } else { 10.0 * (10.0 * truth.pose[pose::Z]).trunc() }
}

/// In tenths of the unit, without -0.
fn tenths(value: f64) -> f64 {
    (10.0 * value).trunc() + 0.0
}
