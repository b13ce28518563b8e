//! What a flight along targets was worth: the definitions behind the thesis' section 5.2.
//!
//! A flight starts when the pose is within reach of the first target and ends when it is within
//! reach of the last. Distances are to the polyline through the targets, sampled every 0.02 m.

use nalgebra::Vector2;
use schemars::JsonSchema;
use serde::Serialize;
use tello_model::rows::{Pose, Sticks, pose};

/// Spacing of the sampled polyline, in x, y and z together. m
const PATH_SPACING_M: f64 = 0.02;

/// Horizontal distance to the path beyond which the thesis does not count a flight as valid. m
pub const VALID_DISTANCE_M: f64 = 0.3;

/// Figures of one flight from the first target to the last.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct Metrics {
    /// From reaching the first target to reaching the last. s
    pub finish_s: Option<f64>,
    /// Horizontal distance to the path, median. m
    pub distance_median_m: f64,
    /// Horizontal distance to the path, 95 % quantile. m
    pub distance_p95_m: f64,
    /// Horizontal distance to the path, largest. m
    pub distance_max_m: f64,
    /// Speed in x, y, z, median. m/s
    pub speed_median_m_s: f64,
    /// Euclidean norm of the four sticks, median. 1
    pub input_norm_median: f64,
}

/// Poses and sticks of a flight, tick by tick, from its first target to its last.
#[derive(Debug, Clone)]
pub struct Track {
    path_w: Vec<Vector2<f64>>,
    dt_s: f64,
    distances_m: Vec<f64>,
    speeds_m_s: Vec<f64>,
    input_norms: Vec<f64>,
    targets_count: usize,
    began_s: Option<f64>,
    flown_s: f64,
    previous: Option<(f64, Pose)>,
    is_finished: bool,
}

impl Track {
    /// A track along `targets`, nothing flown yet.
    pub fn new(targets: &[Pose], dt_s: f64) -> Self {
        Self {
            path_w: sample_path(targets),
            dt_s,
            distances_m: Vec::new(),
            speeds_m_s: Vec::new(),
            input_norms: Vec::new(),
            targets_count: targets.len(),
            began_s: None,
            flown_s: 0.0,
            previous: None,
            is_finished: false,
        }
    }

    /// Adds the tick at `now_s`, which ended with `targets_reached` targets reached.
    ///
    /// Ticks before the first target and after the last do not count.
    pub fn add(&mut self, now_s: f64, at: &Pose, u_sent: &Sticks, targets_reached: usize) {
        if targets_reached == 0 || self.is_finished {
            return;
        }
        let began_s = *self.began_s.get_or_insert(now_s);
        self.distances_m.push(self.distance_m(at));
        self.input_norms.push(u_sent.norm());
        if let Some((previous_s, previous)) = &self.previous {
            let moved_w = at.fixed_rows::<3>(pose::X) - previous.fixed_rows::<3>(pose::X);
            self.speeds_m_s.push(moved_w.norm() / (now_s - previous_s));
        }
        self.previous = Some((now_s, *at));
        self.flown_s = now_s - began_s + self.dt_s;
        self.is_finished = targets_reached == self.targets_count;
    }

    /// The figures so far; `None` if the first target was never reached.
    pub fn metrics(&self) -> Option<Metrics> {
        Some(Metrics {
            finish_s: self.is_finished.then_some(self.flown_s),
            distance_median_m: quantile(&self.distances_m, 0.5)?,
            distance_p95_m: quantile(&self.distances_m, 0.95)?,
            distance_max_m: quantile(&self.distances_m, 1.0)?,
            speed_median_m_s: quantile(&self.speeds_m_s, 0.5)?,
            input_norm_median: quantile(&self.input_norms, 0.5)?,
        })
    }

    fn distance_m(&self, at: &Pose) -> f64 {
        let at_w = Vector2::new(at[pose::X], at[pose::Y]);
        let squared = self.path_w.iter().map(|point_w| (point_w - at_w).norm_squared());
        squared.fold(f64::INFINITY, f64::min).sqrt()
    }
}

/// Points on the polyline through `targets`, horizontal part, the last target included.
fn sample_path(targets: &[Pose]) -> Vec<Vector2<f64>> {
    let mut path_w = Vec::new();
    for side in targets.windows(2) {
        let [from, to] = side else { continue };
        let delta = to - from;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small, >= 0")]
        let count =
            (delta.fixed_rows::<3>(pose::X).norm() / PATH_SPACING_M).ceil().max(1.0) as usize;
        for i in 0..count {
            let at = from + delta * (i as f64 / count as f64);
            path_w.push(Vector2::new(at[pose::X], at[pose::Y]));
        }
    }
    path_w.extend(targets.last().map(|last| Vector2::new(last[pose::X], last[pose::Y])));
    path_w
}

/// The `share` quantile of `values`, linear between order statistics; `None` without values.
pub fn quantile(values: &[f64], share: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let place = share.clamp(0.0, 1.0) * sorted.len().checked_sub(1)? as f64;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0..len")]
    let below = place.floor() as usize;
    let above = (below + 1).min(sorted.len() - 1);
    Some(sorted[below] + (place - below as f64) * (sorted[above] - sorted[below]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> [Pose; 5] {
        [[0.0, 0.0], [1.5, 0.0], [1.5, 1.5], [0.0, 1.5], [0.0, 0.0]]
            .map(|[x, y]| Pose::new(x, y, 1.0, 0.0))
    }

    #[test]
    fn the_path_has_the_thesis_number_of_points() {
        // 75 points a side and the last target; the thesis counts 300 without it.
        assert_eq!(sample_path(&square()).len(), 301);
    }

    #[test]
    fn quantiles_interpolate() {
        let values = [4.0, 1.0, 3.0, 2.0];
        for (share, expected) in [(0.0, 1.0), (0.5, 2.5), (1.0, 4.0), (0.95, 3.85)] {
            let got = quantile(&values, share).unwrap();
            assert!((got - expected).abs() < 1e-12, "{share}: {got}");
        }
        assert_eq!(quantile(&[], 0.5), None);
    }

    #[test]
    fn only_the_ticks_between_first_and_last_target_count() {
        let mut track = Track::new(&square(), 0.02);
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
}
