//! The judge of a flight: what it reached, when, and how far off it was.
//!
//! Owns a reach test of its own: the target counter of the controller does not count. It is fed one
//! pose per tick, the true one or the estimated one. The clock starts when the controller has reached
//! its first target and stops when the pose has reached the last, all in order.
//! Where poses cannot show that a mission is over, its last target counts from when the controller has reached it
//! ([`ReferencePath::ends_with_mission`]).

use horizon_model::rows::{Pose, Sticks};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::corner::Corner;
use super::reference_path::{Offset, ReferencePath, horizontal};
use super::{Lap, Metrics, Samples};

/// Follows one flight.
#[derive(Debug, Clone)]
pub struct Judge {
    reference: ReferencePath,
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
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
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
    /// Figures of each lap that was begun; none of a way that is flown once.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub laps: Vec<Lap>,
}

/// Largest offset from the outline while flying.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Fence {
    /// Horizontal. m
    pub distance_m: f64,
    /// Up or down. m, >= 0
    pub height_m: f64,
}

impl Judge {
    /// The judge of a flight along `reference` with ticks every `dt_s`.
    pub fn new(reference: &ReferencePath, dt_s: f64) -> Self {
        Self {
            corners: reference.corners(),
            reference: reference.clone(),
            dt_s,
            reached: 0,
            entered_s: None,
            began_s: None,
            ended_s: None,
            samples: Samples::default(),
            fence: Fence::default(),
        }
    }

    /// Adds the tick at `now_s` with the pose `at` (world frame; m, rad) and the sent sticks (1), when the controller
    /// has reached `targets_reached` of the mission's targets.
    pub fn add(&mut self, now_s: f64, at: &Pose, u_sent: &Sticks, targets_reached: usize) {
        let offset = self.reference.offset(at);
        self.fence.widen(&offset);
        let has_begun = targets_reached > 0;
        let is_too_early = self.reference.ends_with_mission
            && self.reached + 1 == self.reference.targets.len()
            && targets_reached < self.reference.targets_count;
        if !is_too_early && self.reference.is_reached(self.reached, at) {
            self.reached += 1;
            self.entered_s.get_or_insert(now_s);
        }
        if !has_begun || self.is_finished() {
            return;
        }
        self.began_s.get_or_insert(now_s);
        self.samples.enter(self.reference.lap(self.reached, self.reference.targets.len()), now_s);
        self.samples.add(now_s, at, u_sent, offset.distance_m);
        for corner in &mut self.corners {
            corner.pass(&horizontal(at), self.reached);
        }
        if self.reached == self.reference.targets.len() {
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

    /// The figures so far; `None` with fewer than two ticks since the start.
    pub fn score(&self) -> Option<Score> {
        // The last tick lasts a period, too, as in the thesis.
        let lasted_s = |since_s: Option<f64>| Some(self.ended_s? - since_s? + self.dt_s);
        let corners = self.corners.iter().filter(|corner| corner.is_reached(self.reached));
        Some(Score {
            metrics: self.samples.metrics(lasted_s(self.began_s))?,
            since_entry_s: lasted_s(self.entered_s),
            overshoots_m: corners.map(Corner::overshoot_m).collect(),
            laps: self.samples.laps(self.dt_s),
        })
    }
}

impl Fence {
    fn widen(&mut self, offset: &Offset) {
        self.distance_m = self.distance_m.max(offset.distance_m);
        self.height_m = self.height_m.max(offset.height_m.abs());
    }
}

#[cfg(test)]
mod tests;
