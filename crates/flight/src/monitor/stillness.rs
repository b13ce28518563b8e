//! A pose that stands still to a millimetre is not that of a flying vehicle.
//!
//! Owns the recognition of a pose that goes on and says nothing: another object at rest, or one pose
//! repeated with noise. Means of short blocks are compared, so that noise does not hide it.

use horizon_model::rows::{Pose, pose};

/// Blocks whose means are compared.
const BLOCKS: usize = 4;
/// Length of all blocks of the short and of the long window. s
const WINDOWS_S: [f64; 2] = [0.8, 2.4];
/// Limit of the long window over that of the short one: noise is less in longer means, and a vehicle goes
/// further. The least range in 2.4 s of the real flights is 17 mm; the means of an object at rest under 5 mm
/// of noise have 2.5 mm.
const LONG_LIMIT: f64 = 2.5;

/// The rows that a flying vehicle cannot keep still.
const ROWS: [usize; 3] = [pose::X, pose::Y, pose::Z];

/// A short window that finds a pose at rest at once, and a long one that finds it through noise.
#[derive(Debug, Clone)]
pub(super) struct StillnessMonitor([Window; 2]);

impl StillnessMonitor {
    pub(super) fn new(still_m: f64, dt_s: f64) -> Self {
        let [short_s, long_s] = WINDOWS_S;
        let long = Window::new(LONG_LIMIT * still_m, long_s, dt_s);
        Self([Window::new(still_m, short_s, dt_s), long])
    }

    /// Forgets all poses.
    pub(super) fn restart(&mut self) {
        self.0.iter_mut().for_each(Window::restart);
    }

    /// Takes the pose of a tick; how long the poses have been still. A tick without a pose changes nothing
    /// but that time.
    pub(super) fn update(&mut self, pose: Option<&Pose>) -> Option<f64> {
        let [short_s, long_s] = self.0.each_mut().map(|window| window.update(pose));
        [short_s, long_s].into_iter().flatten().reduce(f64::max)
    }
}

/// The newest poses, and since when they have been still.
#[derive(Debug, Clone)]
struct Window {
    still_m: f64,
    length_s: f64,
    dt_s: f64,
    /// Ring of the newest poses, a whole number of blocks.
    poses: Vec<Pose>,
    newest: usize,
    count: usize,
    still_s: Option<f64>,
}

impl Window {
    fn new(still_m: f64, length_s: f64, dt_s: f64) -> Self {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "2..=120")]
        let block = (length_s / BLOCKS as f64 / dt_s).round().max(2.0) as usize;
        let poses = vec![Pose::zeros(); BLOCKS * block];
        Self { still_m, length_s, dt_s, poses, newest: 0, count: 0, still_s: None }
    }

    fn restart(&mut self) {
        self.count = 0;
        self.still_s = None;
    }

    fn update(&mut self, pose: Option<&Pose>) -> Option<f64> {
        if let Some(pose) = pose {
            self.newest = (self.newest + 1) % self.poses.len();
            self.poses[self.newest] = *pose;
            self.count = self.count.saturating_add(1);
            let is_still = self.count >= self.poses.len() && self.spread_m() < self.still_m;
            self.still_s = match self.still_s {
                _ if !is_still => None,
                Some(still_s) => Some(still_s),
                None => Some(self.length_s - self.dt_s),
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
