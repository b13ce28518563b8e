//! A pose that stands still to a millimetre is hardly that of a flying vehicle, and never of one that is steered.
//!
//! Owns the recognition of a pose that goes on and says nothing: another object at rest, or one pose
//! repeated with noise. Means of short blocks are compared, so that noise does not hide it.

use horizon_model::rows::{Pose, Sticks, pose, stick};
use nalgebra::Vector3;

use super::{Agreement, Sample};

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

/// Lag of a typical vehicle. s
const LAG_S: f64 = 0.6;
/// Inputs, after the lag, that no dead zone swallows: a vehicle with half the nominal gain moves 5 cm in 0.4 s. 1
const INPUT_MIN: f64 = 0.2;
/// How long they must have been so large: longer than the dead time may be wrong. s
const ASKED_MIN_S: f64 = 0.4;
/// Time for which a pose may be still while nothing is asked for. s
const QUIET_S: f64 = 5.0;

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

/// Whether a still pose contradicts anything: a calm vehicle that nothing is asked of may stand still.
#[derive(Debug, Clone)]
pub(super) struct FrozenMonitor {
    dt_s: f64,
    /// Inputs after the lag: roll, pitch, throttle. 1
    u_lagged: Vector3<f64>,
    /// Since when they have been large. s
    asked_s: f64,
    /// Whether they were while the pose has been still.
    is_contradicted: bool,
}

impl FrozenMonitor {
    pub(super) fn new(dt_s: f64) -> Self {
        Self { dt_s, u_lagged: Vector3::zeros(), asked_s: 0.0, is_contradicted: false }
    }

    /// Takes a tick in which the pose had been still for `still_s`; for how long that has been no flying
    /// vehicle's.
    pub(super) fn update(
        &mut self,
        still_s: Option<f64>,
        sample: &Sample,
        velocity: Agreement,
    ) -> Option<f64> {
        let u = if sample.link_is_up { sample.u_applied } else { Sticks::zeros() };
        let u = Vector3::new(u[stick::ROLL], u[stick::PITCH], u[stick::THROTTLE]);
        self.u_lagged += (u - self.u_lagged) * (1.0 - (-self.dt_s / LAG_S).exp());
        let is_asked = self.u_lagged.norm() > INPUT_MIN;
        self.asked_s = if is_asked { self.asked_s + self.dt_s } else { 0.0 };
        // What the hold that follows does not ask for any more was asked for.
        self.is_contradicted =
            still_s.is_some() && (self.is_contradicted || self.asked_s >= ASKED_MIN_S);
        let still_s = still_s?;
        match velocity {
            _ if self.is_contradicted => Some(still_s),
            // The drone itself says that it hovers.
            Agreement::Agrees => None,
            _ => (still_s > QUIET_S).then_some(still_s),
        }
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
