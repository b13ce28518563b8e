//! A reference that moves along a trajectory and keeps together with the vehicle.
//!
//! Owns when the reference sets off, waits, goes back to a missed waypoint and arrives, and which waypoints are
//! reached. A path off the trajectory is `carrot.rs`. Trajectories are never changed: only the time on them runs
//! slower.

use horizon_model::rows::{Pose, pose};
use horizon_model::setting::SettingError;

use super::Reference;
use super::carrot::Carrot;
use super::table::FollowTable;
use super::timed_path::{TimedPath, Waypoint};
use crate::path::Limits;
use crate::targets::pose_distance;
use crate::trajectory::{Moment, Trajectory};

/// Arc length along the trajectory within which a vehicle that was held up is looked for. m
const RESUME_WINDOW_M: f64 = 1.0;

/// Least growth of the pace while nothing holds the reference up: where the trajectory itself takes up the whole
/// acceleration, nothing is left for more pace. 1/s
const PACE_GROWTH_MIN: f64 = 0.1;

/// Largest distance from the first waypoint while the vehicle settles, over `start.within`; at most the reach of that
/// waypoint. The plan has the path in its horizon before the reference sets off, and begins to speed up for it. A
/// vehicle that oscillates about the waypoint sets off, too: its motion along the path shows its dead times. 1
const SETTLE_LEAVE_RATIO: f64 = 2.0;

/// Speed below which a trajectory stands still, whatever the pace. m/s
const STANDSTILL_MPS: f64 = 1e-3;

/// Motion of the reference.
#[derive(Debug, Clone, Copy, PartialEq)]
enum FollowStage {
    /// Stands at the first waypoint; it is not known yet where the vehicle is.
    Unplaced,
    /// Leads the vehicle to the first waypoint.
    Approach(Carrot),
    /// Stands at the first waypoint, where the vehicle settles.
    Settle {
        /// Periods until it sets off.
        left: usize,
    },
    /// Moves along the trajectory.
    Run,
    /// Leads the vehicle to the next waypoint, which it has missed.
    Return(Carrot),
}

/// Where on the trajectory the reference is.
#[derive(Debug, Clone, Copy, PartialEq)]
struct PathTime {
    /// Time on the trajectory. s
    at_s: f64,
    /// How fast that time runs. 1, 0..=1
    pace: f64,
}

/// At the beginning, at full pace.
const START: PathTime = PathTime { at_s: 0.0, pace: 1.0 };

/// A reference along a trajectory.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Follower {
    normal: TimedPath,
    /// Path with tighter corners, from the first missed waypoint on; `None`: `normal` goes on.
    careful: Option<TimedPath>,
    has_missed: bool,
    follow: FollowTable,
    limits: Limits,
    dt_s: f64,
    settle_periods: usize,
    stage: FollowStage,
    time: PathTime,
    /// Pace that the lag of the vehicle allows. 1, 0..=1
    pace_max: f64,
    /// Node of the trajectory up to which the vehicle has come.
    vehicle_node: usize,
    /// Number of waypoints reached.
    reached: usize,
}

impl Follower {
    /// A reference at the beginning of `path`, which goes on along `careful`, if there is one, after a missed waypoint.
    ///
    /// `limits` are for the return to full pace and for ways to waypoints; `dt_s` is the period.
    ///
    /// # Errors
    /// A value of `follow` that breaks its rule.
    pub(super) fn new(
        path: TimedPath,
        careful: Option<TimedPath>,
        follow: &FollowTable,
        limits: Limits,
        dt_s: f64,
    ) -> Result<Self, SettingError> {
        let follow = follow.check().map_err(|error| error.under("follow"))?.clone();
        let settle_periods = horizon_model::steps(follow.start.settle_s, dt_s);
        Ok(Self {
            normal: path,
            careful,
            has_missed: false,
            follow,
            limits,
            dt_s,
            settle_periods,
            stage: FollowStage::Unplaced,
            time: START,
            pace_max: 1.0,
            vehicle_node: 0,
            reached: 0,
        })
    }

    /// The path that is flown.
    fn path(&self) -> &TimedPath {
        self.careful.as_ref().filter(|_| self.has_missed).unwrap_or(&self.normal)
    }

    /// See [`super::Mission::advance`].
    pub(super) fn advance(&mut self, pose_hat: &Pose) {
        if !is_finite(pose_hat) {
            return;
        }
        match self.stage {
            FollowStage::Unplaced => self.approach(pose_hat, self.carrot(pose_hat)),
            FollowStage::Approach(carrot) => {
                self.approach(pose_hat, self.advanced(carrot, pose_hat));
            }
            FollowStage::Settle { left } => self.settle(pose_hat, left),
            FollowStage::Run => self.run(pose_hat),
            FollowStage::Return(carrot) => {
                let carrot = self.advanced(carrot, pose_hat);
                self.stage = FollowStage::Return(carrot);
                if carrot.is_arrived() && self.is_at_next(pose_hat) {
                    self.set_off_again();
                }
            }
        }
    }

    /// A reference that leads from `pose_hat` to the next waypoint.
    fn carrot(&self, pose_hat: &Pose) -> Carrot {
        Carrot::new(pose_hat, &self.next().pose, &self.limits)
    }

    /// `carrot` one period later, the vehicle at `pose_hat`.
    fn advanced(&self, carrot: Carrot, pose_hat: &Pose) -> Carrot {
        let moved = carrot.after(self.dt_s);
        moved.with_allowed_pace(self.allowed_pace(moved.lag_m(pose_hat)))
    }

    /// Settling begins where the vehicle is close enough, `carrot` arrived or not.
    fn approach(&mut self, pose_hat: &Pose, carrot: Carrot) {
        self.stage = FollowStage::Approach(carrot);
        if self.first_distance(pose_hat) <= self.follow.start.within {
            self.settle(pose_hat, self.settle_periods);
        }
    }

    fn first_distance(&self, pose_hat: &Pose) -> f64 {
        pose_distance(&self.path().waypoints[0].pose, pose_hat)
    }

    /// Distance to the first waypoint at which a vehicle that settles has left it.
    fn settle_leave(&self) -> f64 {
        let FollowTable { start, reach, .. } = &self.follow;
        (SETTLE_LEAVE_RATIO * start.within).min(reach.max(start.within))
    }

    /// `left` periods are missing until the reference sets off.
    fn settle(&mut self, pose_hat: &Pose, left: usize) {
        self.stage = match left.checked_sub(1) {
            _ if self.first_distance(pose_hat) > self.settle_leave() => {
                FollowStage::Approach(self.carrot(pose_hat))
            }
            Some(left) => FollowStage::Settle { left },
            None => {
                self.reached = 1;
                FollowStage::Run
            }
        };
    }

    /// Moves the reference along the trajectory, and `vehicle_node` up to the reference at most.
    fn run(&mut self, pose_hat: &Pose) {
        self.time = self.after(self.time, self.pace_max);
        let Self { time, vehicle_node, .. } = *self;
        let trajectory = self.trajectory();
        let reference_node = trajectory.node_before(time.at_s);
        let between = (vehicle_node..=reference_node).rev();
        let vehicle_node = trajectory.nearest(between, pose_hat).unwrap_or(vehicle_node);
        let lag_m =
            trajectory.arc_at_m(time.at_s) - trajectory.arc_beside_m(vehicle_node, pose_hat);
        let aside_m = trajectory.aside_m(vehicle_node, pose_hat);
        self.vehicle_node = vehicle_node;
        let aside_pace = self.follow.wait.aside_m.map_or(1.0, |ends_m| falling(aside_m, ends_m));
        self.pace_max = self.allowed_pace(lag_m).min(aside_pace);
        if self.is_finished() {
            return;
        }
        if self.is_at_next(pose_hat) {
            self.reached += 1;
        } else if self.has_missed_next() {
            self.stage = FollowStage::Return(self.carrot(pose_hat));
        }
    }

    /// Pace for a vehicle that is late by `lag_m`: 1 up to `begin_m`, 0 from `stop_m` on.
    fn allowed_pace(&self, lag_m: f64) -> f64 {
        falling(lag_m, [self.follow.wait.begin_m, self.follow.wait.stop_m])
    }

    /// Whether the vehicle is within reach of the next waypoint, and that counts already.
    fn is_at_next(&self, pose_hat: &Pose) -> bool {
        let next = self.next();
        self.time.at_s >= next.counts_from_s
            && pose_distance(&next.pose, pose_hat) <= self.follow.reach
    }

    /// Whether the vehicle has left the next waypoint behind. The last one cannot be missed: the
    /// reference stays there.
    fn has_missed_next(&self) -> bool {
        let is_last = self.reached + 1 == self.path().waypoints.len();
        let is_past = self.vehicle_node >= self.next().leave;
        !is_last && (is_past || self.time.at_s >= self.path().trajectory.end_s())
    }

    /// From the missed waypoint, which is reached now, on along the trajectory from rest. A vehicle that has missed one
    /// corner would miss others, and each return costs seconds: from the first one on corners are tighter.
    fn set_off_again(&mut self) {
        self.has_missed = true;
        let node = self.next().node;
        self.go_to(node, self.path().trajectory.nodes()[node].at_s, 0.0);
        self.reached += 1;
        self.stage = FollowStage::Run;
    }

    /// See [`super::Mission::resume`].
    pub(super) fn resume(&mut self, pose_hat: &Pose, velocity_hat: &Pose) {
        let is_known = is_finite(pose_hat) && is_finite(velocity_hat);
        if !is_known || self.is_finished() {
            return;
        }
        match self.stage {
            FollowStage::Unplaced | FollowStage::Settle { .. } => {}
            FollowStage::Approach(_) => self.stage = FollowStage::Approach(self.carrot(pose_hat)),
            FollowStage::Return(_) => self.stage = FollowStage::Return(self.carrot(pose_hat)),
            FollowStage::Run => self.resume_run(pose_hat, velocity_hat),
        }
    }

    /// Goes to the point of the trajectory that is nearest to the vehicle: within [`RESUME_WINDOW_M`] behind
    /// `vehicle_node` and ahead of the reference, between the waypoint reached last and the next one.
    fn resume_run(&mut self, pose_hat: &Pose, velocity_hat: &Pose) {
        let path = self.path();
        let reference_node = path.trajectory.node_before(self.time.at_s);
        let mut first = path.waypoints[self.reached - 1].node.min(self.vehicle_node);
        while path.length_m(first, self.vehicle_node) > RESUME_WINDOW_M {
            first += 1;
        }
        let mut last = self.next().node.max(first);
        while last > reference_node && path.length_m(reference_node, last) > RESUME_WINDOW_M {
            last -= 1;
        }
        // From the reference outwards: a trajectory that stands still is not begun again.
        let around = (first..=last.min(reference_node)).rev().chain(reference_node + 1..=last);
        let Some(node) = path.trajectory.nearest(around, pose_hat) else { return };
        let found = path.trajectory.nodes()[node];
        let vel_w = found.vel_w();
        let speed2 = vel_w.norm_squared();
        let along = vel_w.dot(&velocity_hat.fixed_rows::<3>(pose::X));
        let pace = if speed2 < STANDSTILL_MPS.powi(2) { 1.0 } else { along / speed2 };
        let at_s = if node == reference_node { self.time.at_s } else { found.at_s };
        self.go_to(node, at_s, pace.clamp(0.0, 1.0));
    }

    /// Puts the reference to `at_s`, the vehicle beside `node`.
    fn go_to(&mut self, node: usize, at_s: f64, pace: f64) {
        self.time = PathTime { at_s, pace };
        self.vehicle_node = node;
        self.pace_max = 1.0;
    }

    /// The time one period later.
    fn after(&self, time: PathTime, pace_max: f64) -> PathTime {
        let pace = if time.pace < pace_max {
            let growth = self.pace_growth(&self.path().trajectory.at(time.at_s), time.pace);
            (time.pace + self.dt_s * growth).min(pace_max)
        } else {
            pace_max
        };
        PathTime { at_s: (time.at_s + self.dt_s * pace).min(self.path().trajectory.end_s()), pace }
    }

    /// Largest growth of `pace` with which the reference keeps its acceleration. 1/s
    ///
    /// The reference has velocity `pace v` and acceleration `pace^2 a + pace' v` with the
    /// trajectory's `v` and `a`: the larger root of `|pace^2 a + pace' v| = accel_max`.
    fn pace_growth(&self, at: &Moment, pace: f64) -> f64 {
        let (vel_w, accel_w) = (at.vel_w(), pace.powi(2) * at.accel_w());
        let (speed2, along) = (vel_w.norm_squared(), vel_w.dot(&accel_w));
        if speed2 < STANDSTILL_MPS.powi(2) {
            return 1.0 / self.dt_s;
        }
        let left = self.limits.accel_mps2.powi(2) - accel_w.norm_squared();
        let root = (along.powi(2) + speed2 * left).max(0.0).sqrt();
        ((root - along) / speed2).max(PACE_GROWTH_MIN)
    }

    /// See [`super::Mission::fill`].
    pub(super) fn fill(&self, first_ahead: usize, stages: &[u32], refs: &mut [Reference]) {
        let (mut standing, mut time) = match self.stage {
            FollowStage::Unplaced => return refs.fill(Reference::at_rest(self.next().pose)),
            FollowStage::Approach(carrot) | FollowStage::Return(carrot) => {
                return carrot.fill(first_ahead, stages, self.dt_s, refs);
            }
            // The last period of settling is spent at the beginning of the path, too.
            FollowStage::Settle { left } => (left + 1, START),
            FollowStage::Run => (0, self.time),
        };
        let mut advance = || {
            if standing > 0 {
                standing -= 1;
            } else {
                time = self.after(time, self.pace_max);
            }
            time
        };
        for _ in 0..first_ahead {
            advance();
        }
        for (entry, steps) in refs.iter_mut().zip(stages) {
            if let Some(time) = (0..*steps).map(|_| advance()).last() {
                *entry = self.reference(time);
            }
        }
    }

    /// The reference of now; `None` before the vehicle was seen.
    pub(super) fn now(&self) -> Option<Reference> {
        match self.stage {
            FollowStage::Unplaced => None,
            FollowStage::Approach(carrot) | FollowStage::Return(carrot) => Some(carrot.reference()),
            FollowStage::Settle { .. } => Some(self.reference(START)),
            FollowStage::Run => Some(self.reference(self.time)),
        }
    }

    /// Time from the beginning of the trajectory to its end, with the time to settle. s
    pub(super) fn planned_s(&self) -> f64 {
        self.follow.start.settle_s + self.path().trajectory.end_s()
    }

    fn reference(&self, time: PathTime) -> Reference {
        let at = self.path().trajectory.at(time.at_s);
        Reference { pose: at.pose, rate: time.pace * at.rate }
    }

    /// The waypoint to reach, the last one when all are reached.
    pub(super) fn next(&self) -> &Waypoint {
        &self.path().waypoints[self.reached.min(self.path().waypoints.len() - 1)]
    }

    pub(super) fn reached(&self) -> usize {
        self.reached
    }

    pub(super) fn waypoints(&self) -> &[Waypoint] {
        &self.path().waypoints
    }

    /// See [`super::Mission::is_returning`].
    pub(super) fn is_returning(&self) -> bool {
        matches!(self.stage, FollowStage::Return(_))
    }

    pub(super) fn is_finished(&self) -> bool {
        self.reached == self.path().waypoints.len()
    }

    pub(super) fn trajectory(&self) -> &Trajectory {
        &self.path().trajectory
    }
}

/// 1 up to `begin_m`, 0 from `stop_m` on, straight between.
fn falling(distance_m: f64, [begin_m, stop_m]: [f64; 2]) -> f64 {
    1.0 - ((distance_m - begin_m) / (stop_m - begin_m)).clamp(0.0, 1.0)
}

fn is_finite(v: &Pose) -> bool {
    v.iter().all(|entry| entry.is_finite())
}

#[cfg(test)]
mod tests;
