//! Settings of the simulated drone: what differs between real ones, and the air around them.

use horizon_model::rows::{Sticks, stick};
use horizon_model::setting::{SettingError, in_range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::datagram_channel::AirTable;

/// Longest time by which a report may be late, or for which an order may be ignored. s
const LATE_MAX_S: f64 = 60.0;

/// From here on a stick counts as fully deflected. 1
const GESTURE: f64 = 0.95;

/// Firmware properties of the drone, and its radio link.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DroneTable {
    /// Charge that running motors take: 0.125 empties a full battery to a tenth in 12 minutes. %/s,
    /// 0..=100
    pub drain_pct_per_s: f64,
    /// The text SDK that it knows.
    pub sdk: SdkVersion,
    /// Whether a status packet of the binary protocol precedes its first answer in the text SDK, as reported of
    /// real ones (not verified). Clients that expect one reply for each question are one late from then on.
    pub binary_first: bool,
    /// Where its answers go.
    pub reply_to: ReplyTo,
    /// Datagrams on their way, in either direction.
    pub air: AirTable,
    /// Reaction to the order to stop the motors.
    pub emergency: EmergencyTable,
    /// Reaction to the order to land.
    pub landing: LandingTable,
    /// Whether it lands after 15 s in which it heard nothing; if not, the last sticks act for ever.
    pub lands_on_silence: bool,
    /// Inputs that act while commands get lost by chance.
    pub outage: OutageBehaviour,
    /// Whether all sticks at full deflection, pitch back and throttle down, stop its motors.
    pub stops_at_gesture: bool,
    /// Charge below which it reports that its battery is low, below half of it critical. %, 0..=100
    pub warns_below_pct: u8,
    /// Status reports.
    pub status: StatusTable,
}

/// In which protocol the order to stop the motors is executed. For the binary one this is not verified.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EmergencyTable {
    /// In the binary protocol.
    pub binary: bool,
    /// In the text SDK.
    pub text: bool,
}

/// Reaction to an order to land.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LandingTable {
    /// Whether the last sticks act horizontally and in yaw while it lands; otherwise it levels.
    pub keeps_sticks: bool,
    /// Time after the first order in which orders to land are not heard. s, 0..=60
    pub deaf_s: f64,
    /// Number of first orders to land that are not heard.
    pub deaf_count: u32,
    /// Whether every order to land is refused: `error` in the text SDK, no answer in the binary
    /// protocol.
    pub is_refused: bool,
    /// Sticks that call a landing off.
    pub cancelled_by: CancelledBy,
}

/// Sticks that call an ordered landing off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CancelledBy {
    /// None do.
    Nothing,
    /// Sticks that are not neutral.
    Deflection,
    /// All sticks, neutral ones too.
    AnySticks,
}

/// Inputs of a vehicle whose commands get lost by chance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OutageBehaviour {
    /// Neutral sticks.
    Level,
    /// The last sticks that arrived.
    Held,
    /// One or the other, drawn for each outage.
    Mixed,
}

/// Reports of the drone on its motion, in both protocols.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StatusTable {
    /// Report of flying or standing.
    pub flying: FlyingFlag,
    /// Age of the report of flying or standing, in addition to the period of the status. s, 0..=60
    pub flying_late_s: f64,
    /// Velocity.
    pub velocity: VelocityReport,
    /// Whether there is a height; otherwise it is 0.
    pub has_height: bool,
    /// Drift of the reported height, as of a barometer. m/s, -1..=1
    pub height_drift_mps: f64,
    /// Heading.
    pub heading: HeadingReport,
}

/// The reported heading, from that at power-up.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HeadingReport {
    /// Whether there is one; otherwise it is 0.
    pub is_present: bool,
    /// Whether its sense is the opposite one.
    pub is_mirrored: bool,
    /// Its drift, as of a gyroscope. rad/s, -1..=1
    pub drift_radps: f64,
    /// Age, in addition to the period of the status. s, 0..=60
    pub late_s: f64,
}

impl HeadingReport {
    /// A report that is present and follows the true heading at once.
    pub const RIGHT: Self =
        Self { is_present: true, is_mirrored: false, drift_radps: 0.0, late_s: 0.0 };
}

/// Report of flying or standing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FlyingFlag {
    /// The truth.
    Right,
    /// The opposite.
    Inverted,
    /// Always that it stands.
    Standing,
    /// Always that it flies.
    Flying,
}

/// The reported velocity. Rotation, mirror and sign are applied in this order.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VelocityReport {
    /// Whether there is one; otherwise it is 0.
    pub is_present: bool,
    /// Its horizontal axes.
    pub axes: Axes,
    /// Angle by which its horizontal axes are turned. rad, -10..=10
    pub turn_rad: f64,
    /// Whether its second horizontal axis has the other sign. With a turn of a quarter, the two axes are
    /// swapped.
    pub is_mirrored: bool,
    /// Whether its vertical axis has the other sign.
    pub is_upside_down: bool,
    /// Age, in addition to the period of the status. s, 0..=60
    pub late_s: f64,
    /// Which velocity that is.
    pub measured: Measured,
}

/// Which velocity a drone reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Measured {
    /// The true one.
    True,
    /// That of its own measurement, by which it holds its place. The drone does not see its drift: the disturbance
    /// velocity is missing, or the error of the rigid body's optical flow is in it.
    Own,
}

/// Horizontal axes of the reported velocity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Axes {
    /// Those of the world.
    World,
    /// Those of the vehicle, which turn with it.
    Body,
}

/// Version of the text SDK.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Serialize, Deserialize, JsonSchema)]
pub enum SdkVersion {
    /// The plain Tello: neither `sdk?` nor `sn?`.
    #[serde(rename = "1.3")]
    V1_3,
    /// The Tello EDU.
    #[serde(rename = "2.0")]
    V2_0,
    /// The Robomaster TT: knows `port`.
    #[serde(rename = "3.0")]
    V3_0,
}

/// Where answers go.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReplyTo {
    /// To the address and port that was heard.
    Sender,
    /// To port 8889 of the host, whichever port it sends from.
    Port8889,
}

/// A drone on a good day, and a perfect radio.
#[cfg(test)]
pub(crate) const PLAIN: DroneTable = DroneTable {
    drain_pct_per_s: 0.125,
    sdk: SdkVersion::V1_3,
    binary_first: true,
    reply_to: ReplyTo::Sender,
    air: crate::datagram_channel::PERFECT,
    emergency: EmergencyTable { binary: true, text: true },
    landing: LandingTable {
        keeps_sticks: false,
        deaf_s: 0.0,
        deaf_count: 0,
        is_refused: false,
        cancelled_by: CancelledBy::Nothing,
    },
    lands_on_silence: true,
    outage: OutageBehaviour::Level,
    stops_at_gesture: true,
    warns_below_pct: 10,
    status: StatusTable {
        flying: FlyingFlag::Right,
        flying_late_s: 0.0,
        velocity: VelocityReport {
            is_present: true,
            axes: Axes::World,
            turn_rad: 0.0,
            is_mirrored: false,
            is_upside_down: false,
            late_s: 0.0,
            measured: Measured::True,
        },
        has_height: true,
        height_drift_mps: 0.0,
        heading: HeadingReport::RIGHT,
    },
};

impl DroneTable {
    /// Whether the sticks `u` are the gesture that stops its motors.
    pub(crate) fn is_stopped_by(&self, u: &Sticks) -> bool {
        let is_down = u[stick::PITCH] <= -GESTURE && u[stick::THROTTLE] <= -GESTURE;
        let is_aside = u[stick::ROLL].abs() >= GESTURE && u[stick::YAW].abs() >= GESTURE;
        self.stops_at_gesture && is_down && is_aside
    }

    /// These settings, each within its range.
    ///
    /// # Errors
    /// The first value that breaks its rule.
    pub(crate) fn checked(self) -> Result<Self, SettingError> {
        in_range("drain_pct_per_s", self.drain_pct_per_s, 0.0..=100.0)?;
        in_range("warns_below_pct", self.warns_below_pct, 0..=100)?;
        self.air.check().map_err(|error| error.under("air"))?;
        in_range("landing.deaf_s", self.landing.deaf_s, 0.0..=LATE_MAX_S)?;
        let StatusTable { flying_late_s, velocity, height_drift_mps, heading, .. } = self.status;
        in_range("status.flying_late_s", flying_late_s, 0.0..=LATE_MAX_S)?;
        in_range("status.velocity.turn_rad", velocity.turn_rad, -10.0..=10.0)?;
        in_range("status.velocity.late_s", velocity.late_s, 0.0..=LATE_MAX_S)?;
        in_range("status.height_drift_mps", height_drift_mps, -1.0..=1.0)?;
        in_range("status.heading.drift_radps", heading.drift_radps, -1.0..=1.0)?;
        in_range("status.heading.late_s", heading.late_s, 0.0..=LATE_MAX_S)?;
        Ok(self)
    }
}
