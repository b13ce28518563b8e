//! Mission of a flight: targets, paths and trajectories, and how far they are flown.
//!
//! Owns the reference that the controller is given, now and over its horizon. It reads no clock and
//! no file: time is the number of [`Mission::advance`] calls, a CSV file comes in as rows.
//!
//! | file                    | owns                                                          |
//! |-------------------------|---------------------------------------------------------------|
//! | `mission/table.rs`      | missions as written in JSON                                   |
//! | `mission/csv.rs`        | timed poses as CSV text                                       |
//! | `mission/build.rs`      | from a table to a checked mission                             |
//! | `mission/carrot.rs`     | the reference on the way to a waypoint                        |
//! | `mission/timed_path.rs` | a trajectory with its waypoints                               |
//! | `mission/speed.rs`      | a mission flown slower or faster than it is written           |
//! | `mission/survey.rs`     | length, time, box and speeds of a mission                     |
//! | `mission/follower.rs`   | the reference along a trajectory: start, wait, missed corners |

mod build;
mod carrot;
mod csv;
mod follower;
mod speed;
mod survey;
mod table;
#[cfg(test)]
mod tests;
mod timed_path;

use follower::Follower;
use horizon_model::rows::{Pose, PoseRate};
use horizon_model::setting::{SettingError, positive};

use crate::Obstacle;
use crate::targets::Targets;

pub use build::falling_times;
pub use csv::{CsvError, CsvErrors, parse_csv};
pub use speed::SPEED_AS_WRITTEN;
pub(crate) use survey::Demand;
pub use survey::{PathPoint, Survey};
pub(crate) use table::near;
pub use table::{
    CircleTable, Direction, FollowTable, LimitTable, MissionTable, PointsTable, SplineTable,
    StartTable, TIMED_COUNT, TrajectoryTable, WaitTable, WaypointTable,
};

/// Distance between the points of an outline that is a curve. m
const OUTLINE_SPACING_M: f64 = 0.02;

/// Time that a vehicle takes to a constant target, or to the beginning of a path. s
const TARGET_S: f64 = 15.0;

/// Where the vehicle should be, and how fast.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Reference {
    /// Pose. theta is continuous over a mission: one turn fits all references of a horizon. m, rad
    pub pose: Pose,
    /// Derivative of `pose` by time. m/s, rad/s
    pub rate: PoseRate,
}

impl Reference {
    fn at_rest(pose: Pose) -> Self {
        Self { pose, rate: Pose::zeros() }
    }
}

/// A checked mission and how far it is flown.
///
/// The reference of a path leads from where the vehicle is to the first pose, on the straight line,
/// and stands there until the vehicle has settled. Then it moves along the path. Both as fast as the
/// limits of the path allow; it slows down or stands still for a vehicle that is late, and arrives
/// at rest. To a waypoint that the vehicle has passed out of reach it leads back in the same way;
/// from there the path goes on, with tighter corners from the first such waypoint on.
///
/// Real time: functions without a line on their cost allocate nothing and take at most a binary search.
#[derive(Debug, Clone, PartialEq)]
pub struct Mission(Kind);

#[derive(Debug, Clone, PartialEq)]
enum Kind {
    Targets(Targets),
    Path(Box<Follower>),
}

impl Mission {
    /// The mission of `table` with nothing flown, for a period of `dt_s`.
    ///
    /// Allocates all that the mission needs. A path of 6 m takes less than a millisecond.
    ///
    /// # Errors
    /// The first value that breaks its rule, with its key below the table, e.g.
    /// `waypoints.corner_m`. A trajectory whose CSV file was not read yet.
    pub fn new(table: &MissionTable, dt_s: f64) -> Result<Self, SettingError> {
        let dt_s = positive("dt_s", dt_s)?;
        let (section, kind) = match table {
            MissionTable::Targets(table) => ("targets", Targets::new(table).map(Kind::Targets)),
            MissionTable::Waypoints(table) => ("waypoints", along(build::waypoints(table, dt_s))),
            MissionTable::Spline(table) => ("spline", along(build::spline(table, dt_s))),
            MissionTable::Circle(table) => ("circle", along(build::circle(table, dt_s))),
            MissionTable::Trajectory(table) => ("trajectory", along(build::timed(table, dt_s))),
        };
        kind.map(Self).map_err(|error| error.under(section))
    }

    /// One period passes; the vehicle is now at `pose_hat`.
    ///
    /// The reference moves on, and at most one target is reached: `|target - pose_hat| <= reach` over
    /// x, y, z and theta, theta on the circle. Nothing passes at a pose that is not finite.
    ///
    /// Real time: no allocation; cost in proportion to the lag of the vehicle.
    pub fn advance(&mut self, pose_hat: &Pose) {
        match &mut self.0 {
            Kind::Targets(targets) => {
                targets.advance(pose_hat);
            }
            Kind::Path(follower) => follower.advance(pose_hat),
        }
    }

    /// Goes on from where the vehicle is: it was held up, `pose_hat` and its rate `velocity_hat` are
    /// where it is now.
    ///
    /// The reference goes to the point of the path that is nearest to the vehicle, between the last
    /// waypoint that was reached and the next one, and takes over the vehicle's speed along the path.
    /// A reference that leads to a waypoint starts anew at the vehicle, from rest. Nothing happens while
    /// it stands at a target.
    ///
    /// Real time: no allocation; cost in proportion to the nodes within 1 m of the reference.
    pub fn resume(&mut self, pose_hat: &Pose, velocity_hat: &Pose) {
        if let Kind::Path(follower) = &mut self.0 {
            follower.resume(pose_hat, velocity_hat);
        }
    }

    /// The references at the ends of stages that last so many periods each, the first of which begins
    /// `first_ahead` periods after now, if the vehicle keeps the lag that it has.
    ///
    /// A reference that is about to set off does so in these.
    ///
    /// Real time: no allocation, cost in proportion to the periods and the stages.
    pub fn fill(&self, first_ahead: usize, stages: &[u32], refs: &mut [Reference]) {
        match &self.0 {
            Kind::Targets(targets) => refs.fill(Reference::at_rest(*targets.current())),
            Kind::Path(follower) => follower.fill(first_ahead, stages, refs),
        }
    }

    /// The pose to reach next, the last one when all are reached. World frame. m, rad
    pub fn target(&self) -> &Pose {
        match &self.0 {
            Kind::Targets(targets) => targets.current(),
            Kind::Path(follower) => &follower.next().pose,
        }
    }

    /// Number of targets reached. A path without waypoints of its own has two: beginning and end.
    pub fn targets_reached(&self) -> usize {
        match &self.0 {
            Kind::Targets(targets) => targets.reached(),
            Kind::Path(follower) => follower.reached(),
        }
    }

    /// Number of targets, at least one.
    pub fn targets_count(&self) -> usize {
        match &self.0 {
            Kind::Targets(targets) => targets.poses().len(),
            Kind::Path(follower) => follower.waypoints().len(),
        }
    }

    /// Whether the last target was reached.
    pub fn is_finished(&self) -> bool {
        self.targets_reached() == self.targets_count()
    }

    /// Whether the reference leads back to a waypoint that was missed.
    pub(crate) fn is_returning(&self) -> bool {
        matches!(&self.0, Kind::Path(follower) if follower.is_returning())
    }

    /// Whether references are constant targets, which the clipping of thesis equation 4.20 is for.
    pub(crate) fn is_pointwise(&self) -> bool {
        matches!(self.0, Kind::Targets(_))
    }

    /// Where the reference is now; `None` before the first [`Mission::advance`], and for constant targets,
    /// which the vehicle may be far from. World frame. m, rad
    pub fn reference(&self) -> Option<Pose> {
        self.now().map(|reference| reference.pose)
    }

    /// Rate of the reference; `None` before the first [`Mission::advance`], and for constant targets. World frame.
    /// m/s, rad/s
    pub(crate) fn reference_rate(&self) -> Option<PoseRate> {
        self.now().map(|reference| reference.rate)
    }

    fn now(&self) -> Option<Reference> {
        match &self.0 {
            Kind::Targets(_) => None,
            Kind::Path(follower) => follower.now(),
        }
    }

    /// How long the mission takes as planned, the approach included: a guess for constant targets. s
    pub fn planned_s(&self) -> f64 {
        match &self.0 {
            Kind::Targets(targets) => TARGET_S * targets.poses().len() as f64,
            Kind::Path(follower) => TARGET_S + follower.planned_s(),
        }
    }

    /// The first pose: where a simulated flight in the air begins. World frame. m, rad
    pub fn first_pose(&self) -> Pose {
        match &self.0 {
            Kind::Targets(targets) => targets.poses()[0],
            Kind::Path(follower) => follower.waypoints()[0].pose,
        }
    }

    /// Statistics of the mission as planned: length, time, extent, speeds. Allocates.
    pub fn survey(&self) -> Survey {
        match &self.0 {
            Kind::Targets(targets) => Survey::of_targets(targets.poses(), self.planned_s()),
            Kind::Path(follower) => Survey::of_path(follower.trajectory()),
        }
    }

    /// The most that the path asks of a vehicle; `None` for constant targets. Allocates nothing; cost in
    /// proportion to the path.
    pub(crate) fn demands(&self) -> Option<survey::Demands> {
        match &self.0 {
            Kind::Targets(_) => None,
            Kind::Path(follower) => Some(survey::Demands::of(follower.trajectory())),
        }
    }

    /// Least distance of the reference path from `obstacles`, negative inside of one, with the straight lines between
    /// targets; `None` without obstacles. m. Cost in proportion to the path and the obstacles.
    pub fn clearance_m(&self, obstacles: &[Obstacle]) -> Option<f64> {
        match &self.0 {
            Kind::Targets(targets) => survey::clearance_m(targets.poses().iter(), obstacles),
            Kind::Path(follower) => {
                let nodes = follower.trajectory().nodes();
                survey::clearance_m(nodes.iter().map(|node| &node.pose), obstacles)
            }
        }
    }

    /// The poses that have to be reached: targets or waypoints, of a curve its beginning and end. World
    /// frame. m, rad. Allocates.
    pub fn stops(&self) -> Vec<Pose> {
        match &self.0 {
            Kind::Targets(targets) => targets.poses().to_vec(),
            Kind::Path(follower) => follower.waypoints().iter().map(|stop| stop.pose).collect(),
        }
    }

    /// The line that flights are measured against: the targets or waypoints themselves, or a curve
    /// every 0.02 m. World frame. m, rad. Allocates.
    pub fn outline(&self) -> Vec<Pose> {
        match &self.0 {
            Kind::Path(follower) if follower.waypoints().len() <= 2 => curve(follower),
            _ => self.stops(),
        }
    }
}

fn along(follower: Result<Follower, SettingError>) -> Result<Kind, SettingError> {
    follower.map(|follower| Kind::Path(Box::new(follower)))
}

/// Nodes of the trajectory at about the spacing of an outline, both ends among them.
fn curve(follower: &Follower) -> Vec<Pose> {
    let nodes = follower.trajectory().nodes();
    let mut drawn_m = f64::NEG_INFINITY;
    let last = nodes.len() - 1;
    let is_drawn = |(i, node): &(usize, &crate::trajectory::Node)| {
        let is_due = *i == last || node.arc_m - drawn_m >= OUTLINE_SPACING_M;
        if is_due {
            drawn_m = node.arc_m;
        }
        is_due
    };
    nodes.iter().enumerate().filter(is_drawn).map(|(_, node)| node.pose).collect()
}
