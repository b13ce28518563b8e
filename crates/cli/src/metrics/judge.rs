//! The judge of a flight: what it reached, when, and how far off it was.
//!
//! Owns a reach test of its own: a controller that believes to be there is not asked. It is fed one
//! pose per tick, the true one or the estimated one. The clock starts when the controller has reached
//! its first target and stops when the pose has reached the last, all in order.

use nalgebra::Vector2;
use schemars::JsonSchema;
use serde::Serialize;
use tello_model::rows::{Pose, Sticks};

use super::course::{Course, Offset, horizontal};
use super::{Metrics, Samples};

/// Distance to the next target at which a corner is left behind. m
const CORNER_LEFT_M: f64 = 0.25;

/// Largest cosine of the turn at a corner. From a right angle on the path itself does not lead beyond
/// it; the cosine of a right angle is zero up to rounding.
const CORNER_COS_MAX: f64 = 1e-9;

/// Follows one flight.
#[derive(Debug, Clone)]
pub struct Judge {
    course: Course,
    dt_s: f64,
    /// Targets that the pose has reached.
    reached: usize,
    /// When the pose entered the first target, and when the clock started and stopped. s
    entered_s: Option<f64>,
    began_s: Option<f64>,
    ended_s: Option<f64>,
    samples: Samples,
    corners: Vec<Corner>,
    fence: Fence,
}

/// Figures of one flight by one source of poses.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Score {
    /// Figures between start and end.
    #[serde(flatten)]
    pub metrics: Metrics,
    /// As `finish_s`, but from when the pose first was within reach of the first target: a controller
    /// that waits there pays here. s
    pub since_entry_s: Option<f64>,
    /// Overshoot past each corner that was reached: the longest way beyond it along the incoming side
    /// before the next target is 0.25 m away. m, >= 0
    pub overshoots_m: Vec<f64>,
}

/// Largest offset from the outline while flying.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, JsonSchema)]
pub struct Fence {
    /// Horizontal. m
    pub distance_m: f64,
    /// Up or down. m, >= 0
    pub height_m: f64,
}

/// A target at which the way turns by a right angle or more.
#[derive(Debug, Clone, PartialEq)]
struct Corner {
    /// Index of the target.
    target: usize,
    at_w: Vector2<f64>,
    /// Unit vector along the incoming side.
    way_w: Vector2<f64>,
    next_w: Vector2<f64>,
    overshoot_m: f64,
    is_left: bool,
}

impl Judge {
    /// The judge of a flight along `course` with ticks every `dt_s`.
    pub fn new(course: &Course, dt_s: f64) -> Self {
        Self {
            corners: corners(&course.targets),
            course: course.clone(),
            dt_s,
            reached: 0,
            entered_s: None,
            began_s: None,
            ended_s: None,
            samples: Samples::default(),
            fence: Fence::default(),
        }
    }

    /// Adds the tick at `now_s`. `has_begun` says whether the controller has reached its first target.
    pub fn add(&mut self, now_s: f64, at: &Pose, u_sent: &Sticks, has_begun: bool) {
        let offset = self.course.offset(at);
        self.fence.widen(&offset);
        if self.course.is_reached(self.reached, at) {
            self.reached += 1;
            self.entered_s.get_or_insert(now_s);
        }
        if !has_begun || self.is_finished() {
            return;
        }
        self.began_s.get_or_insert(now_s);
        self.samples.add(now_s, at, u_sent, offset.distance_m);
        for corner in &mut self.corners {
            corner.pass(&horizontal(at), self.reached);
        }
        if self.reached == self.course.targets.len() {
            self.ended_s = Some(now_s);
        }
    }

    /// Whether the last target was reached.
    pub fn is_finished(&self) -> bool {
        self.ended_s.is_some()
    }

    /// Whether the first target was reached, by controller and pose.
    pub fn has_begun(&self) -> bool {
        self.began_s.is_some() && self.entered_s.is_some()
    }

    /// Largest offset from the outline, from the first tick on.
    pub fn fence(&self) -> Fence {
        self.fence
    }

    /// Horizontal distances to the outline between start and end. m
    pub fn distances_m(&self) -> &[f64] {
        &self.samples.distances_m
    }

    /// The figures so far; `None` before the start.
    pub fn score(&self) -> Option<Score> {
        // A flight of one tick lasts one period, as in the thesis.
        let lasted_s = |since_s: Option<f64>| Some(self.ended_s? - since_s? + self.dt_s);
        let corners = self.corners.iter().filter(|corner| self.reached > corner.target);
        Some(Score {
            metrics: self.samples.metrics(lasted_s(self.began_s))?,
            since_entry_s: lasted_s(self.entered_s),
            overshoots_m: corners.map(|corner| corner.overshoot_m).collect(),
        })
    }
}

impl Fence {
    fn widen(&mut self, offset: &Offset) {
        self.distance_m = self.distance_m.max(offset.distance_m);
        self.height_m = self.height_m.max(offset.height_m.abs());
    }
}

impl Corner {
    /// Notes how far `at_w` lies beyond the corner while it is the next target or just passed.
    fn pass(&mut self, at_w: &Vector2<f64>, reached: usize) {
        if self.is_left || reached < self.target {
            return;
        }
        self.overshoot_m = self.overshoot_m.max((at_w - self.at_w).dot(&self.way_w));
        let is_near_next = (at_w - self.next_w).norm() <= CORNER_LEFT_M;
        self.is_left = reached > self.target + 1 || (reached > self.target && is_near_next);
    }
}

fn corners(targets: &[Pose]) -> Vec<Corner> {
    let corner = |(target, around): (usize, &[Pose])| {
        let [from_w, at_w, next_w] =
            [around.first()?, around.get(1)?, around.get(2)?].map(horizontal);
        let way_w = (at_w - from_w).try_normalize(0.0)?;
        let on_w = (next_w - at_w).try_normalize(0.0)?;
        let corner = Corner { target, at_w, way_w, next_w, overshoot_m: 0.0, is_left: false };
        (way_w.dot(&on_w) <= CORNER_COS_MAX).then_some(corner)
    };
    (1..).zip(targets.windows(3)).filter_map(corner).collect()
}

#[cfg(test)]
mod tests;
