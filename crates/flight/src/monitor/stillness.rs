//! A pose that stands still to a millimetre is not that of a flying vehicle.
//!
//! Owns the recognition of a pose that goes on and says nothing: another object at rest, or one pose
//! repeated with noise. Means of short blocks are compared, so that noise does not hide it.

use horizon_model::rows::{Pose, pose};

/// Blocks whose means are compared, and their length together. s
const BLOCKS: usize = 4;
const WINDOW_S: f64 = 0.8;

/// The rows that a flying vehicle cannot keep still.
const ROWS: [usize; 3] = [pose::X, pose::Y, pose::Z];

/// The newest poses, and since when they have been still.
#[derive(Debug, Clone)]
pub(super) struct StillnessMonitor {
    still_m: f64,
    dt_s: f64,
    /// Ring of the newest poses, a whole number of blocks.
    poses: Vec<Pose>,
    newest: usize,
    count: usize,
    still_s: Option<f64>,
}

impl StillnessMonitor {
    pub(super) fn new(still_m: f64, dt_s: f64) -> Self {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "2..=40")]
        let block = (WINDOW_S / BLOCKS as f64 / dt_s).round().max(2.0) as usize;
        let poses = vec![Pose::zeros(); BLOCKS * block];
        Self { still_m, dt_s, poses, newest: 0, count: 0, still_s: None }
    }

    /// Forgets all poses.
    pub(super) fn restart(&mut self) {
        self.count = 0;
        self.still_s = None;
    }

    /// Takes the pose of a tick; how long the poses have been still. A tick without a pose changes nothing
    /// but that time.
    pub(super) fn update(&mut self, pose: Option<&Pose>) -> Option<f64> {
        if let Some(pose) = pose {
            self.newest = (self.newest + 1) % self.poses.len();
            self.poses[self.newest] = *pose;
            self.count = self.count.saturating_add(1);
            let is_still = self.count >= self.poses.len() && self.spread_m() < self.still_m;
            self.still_s = match self.still_s {
                _ if !is_still => None,
                Some(still_s) => Some(still_s),
                None => Some(WINDOW_S - self.dt_s),
            };
        }
        self.still_s = self.still_s.map(|still_s| still_s + self.dt_s);
        self.still_s
    }

    /// Range of the means of the blocks, of the axis where it is largest. m
    fn spread_m(&self) -> f64 {
        let block = self.poses.len() / BLOCKS;
        let mean = |row: usize, at: usize| {
            let values = (0..block).map(|k| {
                let back = at * block + k;
                self.poses[(self.newest + self.poses.len() - back) % self.poses.len()][row]
            });
            values.sum::<f64>() / block as f64
        };
        let range = |row: usize| {
            let (low, high) = (0..BLOCKS)
                .map(|at| mean(row, at))
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), mean| {
                    (low.min(mean), high.max(mean))
                });
            high - low
        };
        ROWS.into_iter().map(range).fold(0.0, f64::max)
    }
}
