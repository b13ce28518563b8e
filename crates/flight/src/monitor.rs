//! Whether motion capture, drone and commands show the same motion.
//!
//! Owns the comparison of these sources: poses that stand still with the inputs, the poses with the drone's own
//! velocity, height and heading, the direction of the motion with that of the inputs. What follows from a finding is
//! the supervisor's decision. No clock, link or file is known here.
//!
//! | file                      | compares                                                     |
//! |---------------------------|--------------------------------------------------------------|
//! | `monitor/stillness.rs`    | the pose with itself, over 0.8 and 2.4 s, and with the inputs |
//! | `monitor/hidden_speed.rs` | the speed by the poses with the drone's, along an axis that is still |
//! | `monitor/displacement.rs` | displacements by poses, drone and inputs before the drone's axes are known |
//! | `monitor/typical_vehicle.rs` | nothing: the motion that the monitors expect under the inputs |
//! | `monitor/velocity.rs`     | the pose's displacement with the drone's velocity             |
//! | `monitor/height.rs`       | the pose's height with the drone's                            |
//! | `monitor/heading.rs`      | the turn by the poses with the drone's, and both with the inputs |
//! | `monitor/direction.rs`    | the direction of the motion with that of the applied inputs   |

mod direction;
mod displacement;
mod heading;
mod height;
mod hidden_speed;
mod settings;
mod stillness;
mod typical_vehicle;
mod velocity;

use horizon_model::rows::{Pose, Sticks};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use direction::DirectionMonitor;
use heading::HeadingMonitor;
use height::HeightMonitor;
use stillness::{FrozenMonitor, StillnessMonitor};
use velocity::VelocityMonitor;

pub use settings::{MonitorSettings, MonitorTable};

use crate::forgetting::{LEAK_RATIO, LeakySum};

/// How two sources of one quantity compare.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Agreement {
    /// One source is absent, or nothing has shown yet that it measures this quantity.
    #[default]
    Unknown,
    /// Both differ by no more than their errors.
    Agrees,
    /// Both differ by more than their errors.
    Doubtful,
    /// Both differ by so much, or for so long, that one is wrong.
    Disagrees,
}

/// Motion as the drone reports it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DroneMotion {
    /// Velocity along two horizontal axes of unknown direction and handedness. m/s
    pub horizontal_d_mps: Option<[f64; 2]>,
    /// Height over an unknown level. m
    pub height_m: Option<f64>,
    /// Heading from an unknown direction, in an unknown sense. rad
    pub heading_rad: Option<f64>,
}

/// Measurements and inputs of one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Pose accepted in this tick, world frame; `None` if there was none. m, rad
    pub pose: Option<Pose>,
    /// Newest report of the drone; `None` if there is no fresh one.
    pub drone: Option<DroneMotion>,
    /// Inputs applied in the period before, if the link is up. 1
    pub u_applied: Sticks,
    /// Whether inputs act, as far as known.
    pub link_is_up: bool,
}

/// Findings of the monitors after a tick.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Findings {
    /// For how long the pose has been stiller than that of a flying vehicle; `None`: it moves. s
    pub still_s: Option<f64>,
    /// For how long the pose, or one axis of it, has been still although the inputs should move it; `None`: it is not,
    /// or moves. A still pose also counts without inputs after a longer time, unless the drone's velocity agrees. s
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frozen_s: Option<f64>,
    /// Displacement by the poses against the drone's velocity.
    pub velocity: Agreement,
    /// Speed by the drone, if it has shown that it reports one. m/s
    pub drone_speed_mps: Option<f64>,
    /// Difference of the displacements by the poses and by the drone: length of the vector; before the drone's axes are
    /// known, excess over the tolerances (docs/model.md, section 6). m
    pub displacement_error_m: f64,
    /// Height by the poses against the drone's.
    pub height: Agreement,
    /// Difference of both heights. m
    pub height_error_m: f64,
    /// Turn by the poses against the drone's.
    #[serde(default)]
    pub heading: Agreement,
    /// Difference of both turns. rad
    #[serde(default)]
    pub heading_error_rad: f64,
    /// Angle from the direction of the inputs to that of the motion, counter-clockwise from above;
    /// `None` while the inputs excite too little. rad
    pub direction_error_rad: Option<f64>,
    /// Whether `direction_error_rad` has been too large for so long that the heading is wrong, or the frame looked
    /// mirrored, which `direction_error_rad` does not show.
    pub is_direction_wrong: bool,
}

/// All monitors of one flight.
#[derive(Debug, Clone)]
pub struct Monitors {
    stillness: StillnessMonitor,
    frozen: FrozenMonitor,
    velocity: Option<VelocityMonitor>,
    height: Option<HeightMonitor>,
    heading: Option<HeadingMonitor>,
    direction: DirectionMonitor,
}

impl Monitors {
    /// Monitors that have seen nothing. `dt_s` > 0 is the period. The only allocation.
    pub fn new(settings: &MonitorSettings, dt_s: f64) -> Self {
        let table = &settings.0;
        Self {
            stillness: StillnessMonitor::new(table.still_m, dt_s),
            frozen: FrozenMonitor::new(dt_s),
            velocity: table.displacement_m.map(|limit_m| VelocityMonitor::new(limit_m, dt_s)),
            height: table.height_m.map(|limit_m| HeightMonitor::new(limit_m, dt_s)),
            heading: table.heading_rad.map(|limit_rad| HeadingMonitor::new(limit_rad, dt_s)),
            direction: DirectionMonitor::new(table.direction_rad, dt_s),
        }
    }

    /// Takes a pose (world frame, m and rad) that the stream repeated in the coming tick of a flight. It is no new
    /// measurement, but counts for the stillness: a stream that repeats its poses and changes the last digit now and
    /// then has too few new ones.
    ///
    /// Real time: no allocation, constant cost.
    pub(crate) fn observe_repeated(&mut self, pose: &Pose) {
        self.stillness.observe(pose);
    }

    /// Takes whether the heading of the coming tick's pose was measured with it; otherwise the heading was lost or
    /// refused, and is that of an earlier pose. Without a call the heading counts as measured.
    ///
    /// Real time: no allocation, constant cost.
    pub(crate) fn note_heading_measured(&mut self, is_its_own: bool) {
        if let Some(heading) = &mut self.heading {
            heading.observe(is_its_own);
        }
    }

    /// Forgets the direction of the motion, since the poses have jumped or jump in the coming tick.
    ///
    /// Real time: no allocation, constant cost.
    pub(crate) fn restart_direction(&mut self) {
        self.direction.reset();
    }

    /// Takes a tick in flight.
    ///
    /// Real time: no allocation, constant cost.
    pub fn update(&mut self, sample: &Sample) -> Findings {
        let still = self.stillness.update(sample.pose.as_ref());
        let by_velocity = self.velocity.as_mut().map(|monitor| monitor.update(sample));
        let by_height = self.height.as_mut().map(|monitor| monitor.update(sample));
        let by_heading = self.heading.as_mut().map(|monitor| monitor.update(sample));
        let (velocity, displacement_error_m) = by_velocity.unwrap_or_default();
        let (height, height_error_m) = by_height.unwrap_or_default();
        let (heading, heading_error_rad) = by_heading.unwrap_or_default();
        let (direction_error_rad, is_direction_wrong) = self.direction.update(sample);
        Findings {
            still_s: still.all_s,
            frozen_s: self.frozen.update(&still, sample, velocity),
            velocity,
            drone_speed_mps: self.velocity.as_ref().and_then(VelocityMonitor::speed_mps),
            displacement_error_m,
            height,
            height_error_m,
            heading,
            heading_error_rad,
            direction_error_rad,
            is_direction_wrong,
        }
    }

    /// Forgets turns and direction of the motion, since the heading was wrong so far.
    ///
    /// Real time: no allocation, constant cost.
    pub(crate) fn restart_heading_and_direction(&mut self) {
        self.direction.reset();
        if let Some(heading) = &mut self.heading {
            heading.reset();
        }
    }

    /// Takes a tick on the ground, where all differences are zero. Axes of the drone that are known stay known.
    ///
    /// Real time: no allocation, constant cost.
    pub fn update_on_ground(&mut self, sample: &Sample) {
        self.stillness.reset();
        self.direction.reset_on_ground();
        if let Some(velocity) = &mut self.velocity {
            velocity.reset_on_ground(sample);
        }
        if let Some(height) = &mut self.height {
            height.reset_on_ground(sample);
        }
        if let Some(heading) = &mut self.heading {
            heading.reset();
        }
    }
}

/// Time constant with which a displacement or turn is forgotten. s
const FORGET_S: f64 = 15.0;

/// Consistency of two sources over time: doubt while the difference is beyond the limit, disagreement once the doubt
/// adds up to [`DOUBT_MAX_S`], or to [`DOUBT_LARGE_MAX_S`] while the difference has been beyond twice the limit for
/// more than [`REPORT_S`].
#[derive(Debug, Clone, Default)]
#[expect(clippy::struct_field_names, reason = "the postfix is the unit")]
struct Doubt {
    /// For how long the difference has been beyond the limit in sum, [`LEAK_RATIO`] of the other time subtracted:
    /// the vehicle stops while in doubt, and the difference may fade; doubt that returns adds up. s
    doubtful_s: LeakySum,
    /// For how long the difference has been beyond twice the limit without a break.
    large_s: f64,
    /// Time without a pose since the latest comparison, and between the two before it. s
    wait_s: f64,
    wait_before_s: f64,
}

/// Sum of the doubt from which on it is disagreement. s
const DOUBT_MAX_S: f64 = 1.5;
/// [`DOUBT_MAX_S`] while the difference has been beyond twice the limit for more than [`REPORT_S`]. s
const DOUBT_LARGE_MAX_S: f64 = 0.3;
/// Time between two reports of the drone: one wrong report alone is no large difference. s
const REPORT_S: f64 = 0.11;

/// Longest time without a pose that one comparison may count for, that of a source of 4 Hz. s
const WAIT_MAX_S: f64 = 0.24;

impl Doubt {
    /// Takes a period of `dt_s` without a pose. The next comparison counts for this time, too, as far as the comparison
    /// before came after as long a time: then poses usually come so rarely.
    fn wait(&mut self, dt_s: f64) {
        self.wait_s = (self.wait_s + dt_s).min(WAIT_MAX_S);
    }

    /// Takes the difference `error` of a period of `dt_s`, in the unit of `limit`; a difference of NaN is in doubt.
    fn update(&mut self, error: f64, limit: f64, dt_s: f64) -> Agreement {
        // A comparison stands for the shorter of the last two gaps.
        let counted_s = dt_s + self.wait_before_s.min(self.wait_s);
        (self.wait_s, self.wait_before_s) = (0.0, self.wait_s);
        // False for NaN.
        if error <= limit {
            self.doubtful_s.leak(LEAK_RATIO * counted_s);
            self.large_s = 0.0;
            return Agreement::Agrees;
        }
        self.doubtful_s.add(counted_s);
        self.large_s = if error <= 2.0 * limit { 0.0 } else { self.large_s + counted_s };
        let is_large = self.large_s > REPORT_S;
        let limit_s = if is_large { DOUBT_LARGE_MAX_S } else { DOUBT_MAX_S };
        let is_short = self.doubtful_s.value() < limit_s;
        if is_short { Agreement::Doubtful } else { Agreement::Disagrees }
    }
}

#[cfg(test)]
mod tests;
