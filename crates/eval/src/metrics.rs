//! Metrics of a flight: the definitions behind the thesis' section 5.2.
//!
//! The clock of `finish_s`, and with it all samples, starts when the controller has reached its first
//! target; for a path that is when it has settled there (`start.settle_s`), so waiting at the start is
//! free. `since_entry_s` starts earlier: when the pose first comes within reach of the first target.
//! Both stop at the last target. Distances are horizontal, to the outline of the reference path. Which
//! count decides that the last is reached is the difference between a [`FlownTrack`], which takes that of the
//! controller, and a [`Judge`], which has its own.

mod clearance;
mod corner;
mod hover;
mod judge;
mod outages;
mod progress;
mod reference_path;

use horizon_model::rows::{Pose, Sticks, pose};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::quantile;

pub use clearance::{LeastClearance, Surroundings};
pub use corner::{Corner, corners};
pub use hover::{Hover, HoverScore};
pub use judge::{Fence, Judge, Score};
pub use outages::{OutageCounter, Outages};
pub use progress::PathProgress;
pub use reference_path::{Offset, ReferencePath, horizontal, offset};

/// Horizontal distance to the path beyond which the thesis does not count a flight as valid. m
pub const VALID_DISTANCE_M: f64 = 0.3;

/// Lateness beyond which a tick counts as late. ms
pub(crate) const LATE_TICK_MS: f64 = 5.0;

/// Figures of one flight from the first target to the last.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Metrics {
    /// From when the controller has reached the first target to reaching the last. s
    pub finish_s: Option<f64>,
    /// Horizontal distance to the path, median. m
    pub distance_median_m: f64,
    /// Horizontal distance to the path, 95 % quantile. m
    pub distance_p95_m: f64,
    /// Horizontal distance to the path, largest. m
    pub distance_max_m: f64,
    /// Speed in x, y, z, median. m/s
    #[serde(alias = "speed_median_m_s")]
    pub speed_median_mps: f64,
    /// Euclidean norm of the four sticks, median. 1
    pub input_norm_median: f64,
}

/// One lap of a way that is flown several times.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Lap {
    /// Time in it. s
    pub lasted_s: f64,
    /// Horizontal distance to the path, median. m
    pub distance_median_m: f64,
    /// Horizontal distance to the path, 95 % quantile. m
    pub distance_p95_m: f64,
    /// Horizontal distance to the path, largest. m
    pub distance_max_m: f64,
}

/// Samples of the ticks between start and end.
#[derive(Debug, Clone, Default)]
struct Samples {
    distances_m: Vec<f64>,
    /// Where in `distances_m` each lap begins, and when (s).
    lap_begins: Vec<(usize, f64)>,
    speeds_mps: Vec<f64>,
    /// Norms of the sticks. 1
    input_norms: Vec<f64>,
    previous: Option<(f64, Pose)>,
}

impl Samples {
    /// Adds the tick at `now_s` (s) with the pose `at` (world frame; m, rad), the sent sticks (1) and the
    /// distance to the path (m).
    fn add(&mut self, now_s: f64, at: &Pose, u_sent: &Sticks, distance_m: f64) {
        self.distances_m.push(distance_m);
        self.input_norms.push(u_sent.norm());
        if let Some((previous_s, previous)) = &self.previous {
            let moved_w = at.fixed_rows::<3>(pose::X) - previous.fixed_rows::<3>(pose::X);
            self.speeds_mps.push(moved_w.norm() / (now_s - previous_s));
        }
        self.previous = Some((now_s, *at));
    }

    /// The samples from `now_s` (s) on are of this lap, from 0, or a later one.
    fn enter(&mut self, lap: usize, now_s: f64) {
        while self.lap_begins.len() <= lap {
            self.lap_begins.push((self.distances_m.len(), now_s));
        }
    }

    /// Figures of each lap that was begun, with ticks every `dt_s`; none of a way that is flown once.
    fn laps(&self, dt_s: f64) -> Vec<Lap> {
        let Some((newest_s, _)) = self.previous.filter(|_| self.lap_begins.len() > 1) else {
            return Vec::new();
        };
        let begins = self.lap_begins.iter().copied();
        let ends = begins.clone().skip(1).chain([(self.distances_m.len(), newest_s + dt_s)]);
        let of = |((begin, began_s), (end, ended_s))| {
            let distances_m = self.distances_m.get(begin..end)?;
            Some(Lap {
                lasted_s: ended_s - began_s,
                distance_median_m: quantile(distances_m, 0.5)?,
                distance_p95_m: quantile(distances_m, 0.95)?,
                distance_max_m: quantile(distances_m, 1.0)?,
            })
        };
        begins.zip(ends).filter_map(of).collect()
    }

    /// The figures; `None` with less than two ticks.
    fn metrics(&self, finish_s: Option<f64>) -> Option<Metrics> {
        Some(Metrics {
            finish_s,
            distance_median_m: quantile(&self.distances_m, 0.5)?,
            distance_p95_m: quantile(&self.distances_m, 0.95)?,
            distance_max_m: quantile(&self.distances_m, 1.0)?,
            speed_median_mps: quantile(&self.speeds_mps, 0.5)?,
            input_norm_median: quantile(&self.input_norms, 0.5)?,
        })
    }
}

/// Poses and sticks of a flight, tick by tick, from its first target to its last.
#[derive(Debug, Clone)]
pub struct FlownTrack {
    reference: ReferencePath,
    dt_s: f64,
    samples: Samples,
    began_s: Option<f64>,
    flown_s: f64,
    is_finished: bool,
}

impl FlownTrack {
    /// A track along `reference`, nothing flown yet.
    pub fn new(reference: ReferencePath, dt_s: f64) -> Self {
        Self {
            reference,
            dt_s,
            samples: Samples::default(),
            began_s: None,
            flown_s: 0.0,
            is_finished: false,
        }
    }

    /// Adds the tick at `now_s` (s), which ended with `targets_reached` targets reached: the pose `at` (world
    /// frame; m, rad) and the sent sticks (1).
    ///
    /// Ticks before the first target and after the last do not count.
    pub fn add(&mut self, now_s: f64, at: &Pose, u_sent: &Sticks, targets_reached: usize) {
        if targets_reached == 0 || self.is_finished {
            return;
        }
        let began_s = *self.began_s.get_or_insert(now_s);
        let count = self.reference.targets_count;
        // Of a curve the controller counts the ends alone.
        let is_curve = self.reference.is_curve();
        let lap = if is_curve { 0 } else { self.reference.lap(targets_reached, count) };
        self.samples.enter(lap, now_s);
        self.samples.add(now_s, at, u_sent, self.reference.offset(at).distance_m);
        self.flown_s = now_s - began_s + self.dt_s;
        self.is_finished = targets_reached == self.reference.targets_count;
    }

    /// The figures so far; `None` with fewer than two ticks since the first target.
    pub fn metrics(&self) -> Option<Metrics> {
        self.samples.metrics(self.is_finished.then_some(self.flown_s))
    }

    /// Figures of each lap that was begun; none of a way that is flown once, and none of a curve, of which the
    /// controller counts the ends alone.
    pub fn laps(&self) -> Vec<Lap> {
        self.samples.laps(self.dt_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> [Pose; 5] {
        [[0.0, 0.0], [1.5, 0.0], [1.5, 1.5], [0.0, 1.5], [0.0, 0.0]]
            .map(|[x, y]| Pose::new(x, y, 1.0, 0.0))
    }

    fn reference() -> ReferencePath {
        let targets = square().to_vec();
        ReferencePath {
            outline: targets.clone(),
            targets_count: targets.len(),
            targets,
            reach: 0.2,
            ends_with_mission: false,
            laps: 1,
            rounds: 1.0,
        }
    }

    #[test]
    fn only_the_ticks_between_first_and_last_target_count() {
        let mut track = FlownTrack::new(reference(), 0.02);
        let (far, near) = (Pose::new(9.0, 9.0, 1.0, 0.0), Pose::new(0.75, 0.1, 1.0, 0.0));
        let u = Sticks::new(0.3, 0.4, 0.0, 0.0);
        track.add(0.0, &far, &u, 0);
        assert!(track.metrics().is_none());
        for k in 1..=10_u32 {
            track.add(f64::from(k) * 0.02, &near, &u, if k == 10 { 5 } else { 1 });
        }
        track.add(0.22, &far, &u, 5);
        let metrics = track.metrics().unwrap();
        assert!((metrics.finish_s.unwrap() - 0.2).abs() < 1e-12, "{metrics:?}");
        assert!((metrics.distance_max_m - 0.1).abs() < 1e-3, "{metrics:?}");
        assert!((metrics.input_norm_median - 0.5).abs() < 1e-12, "{metrics:?}");
    }

    #[test]
    fn a_curve_has_no_laps_that_the_controller_counts() {
        for (targets_count, laps_count) in [(5, 3), (2, 0)] {
            let reference = ReferencePath { targets_count, laps: 3, rounds: 3.0, ..reference() };
            let mut track = FlownTrack::new(reference, 0.02);
            for k in 1..=10_u32 {
                // The targets of a curve are its ends.
                let reached = match k {
                    10 => targets_count,
                    5..10 if targets_count > 2 => 3,
                    _ => 1,
                };
                track.add(f64::from(k) * 0.02, &square()[0], &Sticks::zeros(), reached);
            }
            assert_eq!(track.laps().len(), laps_count, "{targets_count} targets");
        }
    }
}
