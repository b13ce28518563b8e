//! Missions as written in JSON, and the checks that all kinds have in common.

use horizon_model::rows::{Pose, pose};
use horizon_model::setting::{SettingError, finite, in_range, positive};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use strum::VariantNames;

use crate::path::{Heading, Limits};
use crate::targets::TargetTable;

/// Mission, as written in a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema, VariantNames)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
#[strum(serialize_all = "snake_case")]
pub enum MissionTable {
    /// Each target is a constant reference until it is reached, as in the thesis.
    Targets(TargetTable),
    /// Straight sides through waypoints, with rounded corners.
    Waypoints(WaypointTable),
    /// A smooth curve through waypoints.
    Spline(SplineTable),
    /// A circle or a part of one.
    Circle(CircleTable),
    /// Poses at given times.
    Trajectory(TrajectoryTable),
}

impl MissionTable {
    /// First key of each kind.
    pub const NAMES: &[&str] = <Self as VariantNames>::VARIANTS;

    /// Poses of the mission's list of targets or waypoints, world frame, with their keys; none of a circle and of a
    /// trajectory, which may have thousands. m, rad. Allocates.
    pub fn poses(&self) -> impl Iterator<Item = (String, Pose)> + '_ {
        let (key, poses) = match self {
            Self::Targets(table) => ("targets.targets", &*table.targets),
            Self::Waypoints(table) => ("waypoints.waypoints", &*table.waypoints),
            Self::Spline(table) => ("spline.waypoints", &*table.waypoints),
            Self::Circle(_) | Self::Trajectory(_) => ("", &[][..]),
        };
        poses.iter().enumerate().map(move |(k, at)| (format!("{key}[{k}]"), Pose::from(*at)))
    }
}

/// Straight sides through waypoints, with rounded corners.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WaypointTable {
    /// Poses to pass one after the other, 2..=300: x, y, z in m, theta in rad.
    pub waypoints: Vec<[f64; pose::COUNT]>,
    /// How often the whole is flown; more than once needs a last waypoint that is the first. 1..=100
    #[serde(default = "one_lap", skip_serializing_if = "is_one_lap")]
    pub laps: u32,
    /// Distance at which the path passes an inner waypoint; less where half a side is too short, 0 where the path turns
    /// back on itself, and half of it once a waypoint was missed. m, >= 0, below `reach`
    #[serde(default = "corner_m")]
    pub corner_m: f64,
    /// Where the vehicle looks.
    #[serde(default)]
    pub heading: Heading,
    /// How fast the path is flown.
    #[serde(default)]
    pub limits: LimitTable,
    /// How the reference keeps together with the vehicle.
    #[serde(default)]
    pub follow: FollowTable,
}

/// A curve with continuous curvature through waypoints: a cubic spline over the chord length.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SplineTable {
    /// Poses on the curve, 3..=300: x, y, z in m, theta in rad.
    pub waypoints: Vec<[f64; pose::COUNT]>,
    /// Whether the curve returns smoothly to its first waypoint, which is not repeated.
    #[serde(default)]
    pub closed: bool,
    /// How often the curve is flown; more than once needs a closed one. 1..=100
    #[serde(default = "one_lap", skip_serializing_if = "is_one_lap")]
    pub laps: u32,
    /// Where the vehicle looks.
    #[serde(default)]
    pub heading: Heading,
    /// How fast the curve is flown.
    #[serde(default)]
    pub limits: LimitTable,
    /// How the reference keeps together with the vehicle.
    #[serde(default)]
    pub follow: FollowTable,
}

/// A circle at constant height.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CircleTable {
    /// Centre x, y and height z in m; theta in rad is the heading where that is fixed.
    #[serde(rename = "centre")]
    pub centre_w: [f64; pose::COUNT],
    /// Radius. m, 0.05..=50
    pub radius_m: f64,
    /// Where the circle begins: direction from the centre, counter-clockwise from x. rad, -1000..=1000
    #[serde(default)]
    pub begin_rad: f64,
    /// Length. turns, >= 0.01, 500 m at most
    #[serde(default = "turns")]
    pub turns: f64,
    /// Sense of rotation, seen from above.
    #[serde(default)]
    pub direction: Direction,
    /// Where the vehicle looks.
    #[serde(default)]
    pub heading: Heading,
    /// How fast the circle is flown.
    #[serde(default)]
    pub limits: LimitTable,
    /// How the reference keeps together with the vehicle.
    #[serde(default)]
    pub follow: FollowTable,
}

/// Sense of rotation, seen from above.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// From x to y.
    #[default]
    CounterClockwise,
    /// From y to x.
    Clockwise,
}

/// Poses at given times, joined by cubics; the first and the last pose are taken at rest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TrajectoryTable {
    /// The poses.
    pub points: PointsTable,
    /// Acceleration with which the reference takes up speed again after it has waited, and leads
    /// the vehicle to the first pose. m/s^2, >= 0.01
    #[serde(default = "accel_max_mps2")]
    pub accel_max_mps2: f64,
    /// How the reference keeps together with the vehicle.
    #[serde(default)]
    pub follow: FollowTable,
}

/// Poses at given times, here or in a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PointsTable {
    /// At least two: t in s and rising, x, y, z in m, theta in rad.
    Rows(Vec<[f64; TIMED_COUNT]>),
    /// Name of a file with the header `t,x,y,z,theta`, relative to the file that names it.
    Csv(String),
}

/// Numbers in a row of a trajectory: a time and a pose.
pub const TIMED_COUNT: usize = 1 + pose::COUNT;

/// How fast a path is flown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct LimitTable {
    /// Speed along the path. m/s, >= 0.01
    pub speed_max_mps: f64,
    /// Acceleration along the path and towards the centre of its curvature, together. m/s^2,
    /// >= 0.01
    pub accel_max_mps2: f64,
    /// The same where the speed rises: a vehicle that cannot keep up there is late, but not off the path. Missing:
    /// `accel_max_mps2`. m/s^2, >= `accel_max_mps2`
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed_up_max_mps2: Option<f64>,
    /// Speed upwards or downwards. m/s, >= 0.01
    pub climb_max_mps: f64,
    /// Yaw rate. rad/s, >= 0.01
    pub turn_max_radps: f64,
}

/// How a reference keeps together with the vehicle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct FollowTable {
    /// A waypoint counts as reached within this distance, the norm over x, y, z and theta.
    /// m and rad, 0.02..=2
    pub reach: f64,
    /// When the reference sets off.
    pub start: StartTable,
    /// When the reference waits for the vehicle.
    pub wait: WaitTable,
}

/// When a reference sets off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct StartTable {
    /// Distance to the first pose, the norm over x, y, z and theta. m and rad, >= 0.02
    pub within: f64,
    /// Time for which the vehicle must stay within twice that, and within `reach`, without a break. s, 0..=60
    pub settle_s: f64,
}

/// When a reference waits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct WaitTable {
    /// Distance by which the vehicle may be late before the reference slows down. m, > 0
    pub begin_m: f64,
    /// Such a distance at which the reference stands still. m, > `begin_m`
    pub stop_m: f64,
    /// Distance beside the trajectory that counts like these; null or missing: none does. m, > 0, the first below
    /// the second
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aside_m: Option<[f64; 2]>,
}

// What a mission leaves out is as in `configs/missions/square.json`; a circle is one turn from x to y.

fn corner_m() -> f64 {
    0.1
}

const fn one_lap() -> u32 {
    1
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that serde calls")]
fn is_one_lap(laps: &u32) -> bool {
    *laps == one_lap()
}

fn turns() -> f64 {
    1.0
}

fn accel_max_mps2() -> f64 {
    LimitTable::default().accel_max_mps2
}

impl Default for LimitTable {
    fn default() -> Self {
        Self {
            speed_max_mps: 1.2,
            accel_max_mps2: 0.9,
            speed_up_max_mps2: None,
            climb_max_mps: 0.3,
            turn_max_radps: 1.0,
        }
    }
}

impl Default for FollowTable {
    fn default() -> Self {
        Self { reach: 0.2, start: StartTable::default(), wait: WaitTable::default() }
    }
}

impl Default for StartTable {
    fn default() -> Self {
        Self { within: 0.1, settle_s: 1.0 }
    }
}

impl Default for WaitTable {
    fn default() -> Self {
        Self { begin_m: 0.15, stop_m: 0.4, aside_m: None }
    }
}

impl LimitTable {
    pub(super) fn check(&self) -> Result<Limits, SettingError> {
        let speed_up_mps2 = self.speed_up_max_mps2.unwrap_or(self.accel_max_mps2);
        Ok(Limits {
            speed_up_mps2: at_least(self.accel_max_mps2, "speed_up_max_mps2", speed_up_mps2)?,
            speed_mps: at_least(LIMIT_MIN, "speed_max_mps", self.speed_max_mps)?,
            accel_mps2: at_least(LIMIT_MIN, "accel_max_mps2", self.accel_max_mps2)?,
            climb_mps: at_least(LIMIT_MIN, "climb_max_mps", self.climb_max_mps)?,
            turn_radps: at_least(LIMIT_MIN, "turn_max_radps", self.turn_max_radps)?,
        })
    }
}

impl MissionTable {
    /// How often the path is flown.
    pub const fn laps(&self) -> u32 {
        match self {
            Self::Waypoints(table) => table.laps,
            Self::Spline(table) => table.laps,
            Self::Targets(_) | Self::Circle(_) | Self::Trajectory(_) => 1,
        }
    }
}

impl FollowTable {
    /// The table, if it is valid.
    pub(super) fn check(&self) -> Result<&Self, SettingError> {
        in_range("reach", self.reach, NEAR_MIN..=2.0)?;
        near("start.within", self.start.within)?;
        in_range("start.settle_s", self.start.settle_s, 0.0..=60.0)?;
        positive("wait.begin_m", self.wait.begin_m)?;
        positive("wait.stop_m", self.wait.stop_m)?;
        if self.wait.stop_m <= self.wait.begin_m {
            let rule = format!("above wait.begin_m = {}", self.wait.begin_m);
            return Err(SettingError::new("wait.stop_m", self.wait.stop_m, rule));
        }
        if let Some([begin_m, stop_m]) = self.wait.aside_m {
            positive("wait.aside_m[0]", begin_m)?;
            positive("wait.aside_m[1]", stop_m)?;
            if stop_m <= begin_m {
                let rule = format!("above wait.aside_m[0] = {begin_m}");
                return Err(SettingError::new("wait.aside_m[1]", stop_m, rule));
            }
        }
        Ok(self)
    }
}

/// Waypoints, checked: at least `count_min`, finite, and no two in a row at the same position.
pub(super) fn check_waypoints(
    waypoints: &[[f64; pose::COUNT]],
    count_min: usize,
) -> Result<Vec<Pose>, SettingError> {
    if !(count_min..=WAYPOINTS_MAX).contains(&waypoints.len()) {
        let rule = format!("{count_min}..={WAYPOINTS_MAX} poses");
        return Err(SettingError::new("waypoints", waypoints.len(), rule));
    }
    for (k, waypoint) in waypoints.iter().enumerate() {
        for (row, value) in waypoint.iter().enumerate() {
            finite(&format!("waypoints[{k}][{row}]"), *value)?;
        }
    }
    let poses: Vec<Pose> = waypoints.iter().map(|waypoint| Pose::from(*waypoint)).collect();
    for (k, pair) in poses.windows(2).enumerate() {
        check_apart(k + 1, &pair[1], &pair[0])?;
    }
    Ok(poses)
}

/// The poses of all laps: the first pose of a lap is the last of the lap before.
pub(super) fn repeat(poses: &mut Vec<Pose>, laps: u32) -> Result<(), SettingError> {
    in_range("laps", laps, 1..=LAPS_MAX)?;
    let count = poses.len();
    if laps > 1 && poses.first() != poses.last() {
        let rule = "1 for a path whose last waypoint is not its first: it cannot be repeated";
        return Err(SettingError::new("laps", laps, rule));
    }
    for _ in 1..laps {
        poses.extend_from_within(1..count);
    }
    Ok(())
}

/// Refuses waypoint `k` if it is at the place of the one before.
pub(super) fn check_apart(k: usize, at: &Pose, before: &Pose) -> Result<(), SettingError> {
    if (at - before).fixed_rows::<3>(pose::X).norm() < APART_MIN_M {
        let rule = format!("at least {APART_MIN_M} m from the waypoint before");
        return Err(SettingError::new(
            format!("waypoints[{k}]"),
            format!("{:?}", at.as_slice()),
            rule,
        ));
    }
    Ok(())
}

/// Smallest limit with which a path comes to an end. m/s, m/s^2, rad/s
pub(super) const LIMIT_MIN: f64 = 0.01;

/// Least distance within which a pose can count as reached: the estimate has noise. m and rad
const NEAR_MIN: f64 = 0.02;

/// `value` if it is a distance that a vehicle can keep.
///
/// # Errors
/// It is below 0.02 or not finite.
pub(crate) fn near(key: &str, value: f64) -> Result<f64, SettingError> {
    at_least(NEAR_MIN, key, value)
}

/// `value` if it is finite and not below `min`.
///
/// # Errors
/// It is below or not finite.
pub(super) fn at_least(min: f64, key: &str, value: f64) -> Result<f64, SettingError> {
    let refusal = || SettingError::new(key, value, format!("finite and >= {min}"));
    (value.is_finite() && value >= min).then_some(value).ok_or_else(refusal)
}

/// Largest number of laps.
const LAPS_MAX: u32 = 100;

/// Largest number of waypoints.
const WAYPOINTS_MAX: usize = 300;

/// Smallest distance from one waypoint to the next. m
const APART_MIN_M: f64 = 0.01;

#[cfg(test)]
mod tests;
