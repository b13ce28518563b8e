//! Poses that stand still to a millimetre: a hovering vehicle is seldom so still, a steered vehicle never.
//!
//! Owns the recognition of poses that do not show the vehicle: those of another object at rest, or a pose, or one axis
//! of it, that is repeated with noise. Means of short blocks are compared, so that noise does not hide the stillness.

use horizon_model::rows::{Pose, Sticks, pose, stick};
use nalgebra::Vector3;

use super::hidden_speed::HiddenSpeed;
use super::typical_vehicle::{DEAD_THROTTLE, lag_decay};
use super::{Agreement, Sample};
use crate::commanded::{excess, inputs_w};
use crate::forgetting::decay;
use crate::ring::Ring;

/// Blocks whose means are compared.
const BLOCKS: usize = 4;
/// Length of the short and of the long window, all blocks together. s
const WINDOWS_S: [f64; 2] = [0.8, 2.4];
/// Limit of the long window over that of the short one: longer means have less noise, and a vehicle moves further.
/// Means of real flights range over 11.7 mm at least in 2.4 s and 2.1 mm in 0.8 s (docs/benchmarks/2026-11-27-poses),
/// those of an object at rest under 5 mm of noise over 2.5 mm in 2.4 s. 1
const LONG_LIMIT: f64 = 2.5;

/// The rows that a flying vehicle cannot keep still.
const ROWS: [usize; 3] = [pose::X, pose::Y, pose::Z];

/// Least input, after the lag, that surely moves a vehicle: beyond every dead zone, of the throttle the excess over its
/// dead zone. With it a vehicle of half the nominal gain moves 5 cm in 0.4 s. 1
const INPUT_MIN: f64 = 0.2;
/// How long the inputs must have been so large: longer than the error of the dead time. s
const LARGE_MIN_S: f64 = 0.4;
/// Time for which a pose may be still without inputs. s
const QUIET_S: f64 = 5.0;
/// [`QUIET_S`] in an outage: if the poses become those of another object at rest, this looks like an outage. s
const QUIET_IN_OUTAGE_S: f64 = 2.4;
/// Hidden speed of the drone from which on inputs count as applied even in an outage: the poses of a vehicle that
/// coasts without commands show its speed. m/s
const FLOWN_MPS: f64 = 0.3;
/// Time constant of the low-pass filtered inputs that the inputs along one axis are compared with: constant inputs
/// along an axis that stands still may hold the vehicle against wind. s
const MEAN_INPUT_S: f64 = 4.0;
/// Least component of the inputs' change along an axis, over its length, with which that axis must move: heading and
/// direction of flight may be wrong by 0.3 rad each. 1
const ALONG_MIN: f64 = 0.6;

/// For how long the poses have been still, by a short window, which finds it soon, and a long one, which finds it under
/// noise.
#[derive(Debug, Clone)]
pub(super) struct StillnessMonitor([Window; 2]);

impl StillnessMonitor {
    pub(super) fn new(still_m: f64, dt_s: f64) -> Self {
        let [short_s, long_s] = WINDOWS_S;
        let long = Window::new(LONG_LIMIT * still_m, long_s, dt_s);
        Self([Window::new(still_m, short_s, dt_s), long])
    }

    /// Forgets all poses.
    pub(super) fn reset(&mut self) {
        self.0.iter_mut().for_each(Window::reset);
    }

    /// Takes a pose.
    pub(super) fn observe(&mut self, pose: &Pose) {
        self.0.iter_mut().for_each(|window| window.observe(pose));
    }

    /// Takes the pose of a tick; for how long the poses have been still. A tick without a pose lengthens that time
    /// only.
    pub(super) fn update(&mut self, pose: Option<&Pose>) -> Still {
        if let Some(pose) = pose {
            self.observe(pose);
        }
        let [short, long] = self.0.each_mut().map(Window::advance);
        Still {
            all_s: longest(all(&short), all(&long)),
            rows_s: std::array::from_fn(|row| longest(short[row], long[row])),
        }
    }
}

/// For how long x, y and z have been still; `None`: they move. s
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Still {
    /// All three together.
    pub(super) all_s: Option<f64>,
    /// Each alone, in the order of [`ROWS`].
    pub(super) rows_s: [Option<f64>; ROWS.len()],
}

/// The longer of two times; `None` if there is neither. s
fn longest(a_s: Option<f64>, b_s: Option<f64>) -> Option<f64> {
    [a_s, b_s].into_iter().flatten().max_by(f64::total_cmp)
}

/// The shortest of the times for which the rows have been still; `None` if one moves. s
fn all(rows_s: &[Option<f64>; ROWS.len()]) -> Option<f64> {
    rows_s.iter().copied().reduce(|a, b| Some(a?.min(b?))).flatten()
}

/// Whether a still pose contradicts the inputs or the drone: a vehicle in calm air without inputs may stand still.
#[derive(Debug, Clone, Default)]
pub(super) struct FrozenMonitor {
    dt_s: f64,
    hidden: HiddenSpeed,
    /// Newest heading. rad
    theta_rad: f64,
    /// Inputs after the lag, world frame: along x, y and z. 1
    u_lagged_w: Vector3<f64>,
    /// `u_lagged_w`, low-pass filtered with [`MEAN_INPUT_S`]. 1
    u_mean_w: Vector3<f64>,
    all: Contradiction,
    rows: [Contradiction; ROWS.len()],
}

/// Whether large inputs contradict a pose, or one axis of it, that is still.
#[derive(Debug, Clone, Copy, Default)]
struct Contradiction {
    /// For how long the inputs have been large. s
    large_s: f64,
    /// Whether the inputs were large for [`LARGE_MIN_S`] since the pose or axis has been still.
    is_found: bool,
}

/// Inputs, pose and report of the drone in a tick, for the pose or for one axis.
#[derive(Debug, Clone, Copy)]
struct Signs {
    has_large_input: bool,
    is_still: bool,
    /// The drone reports that it has not followed the inputs.
    reports_no_motion: bool,
}

impl Contradiction {
    /// Takes a period of `dt_s`. While the drone reports that it has not followed the inputs, no contradiction begins,
    /// and one that was found stays.
    fn update(&mut self, signs: Signs, dt_s: f64) {
        let Signs { has_large_input, is_still, reports_no_motion } = signs;
        self.large_s = if has_large_input { self.large_s + dt_s } else { 0.0 };
        let is_new = !reports_no_motion && self.large_s >= LARGE_MIN_S;
        // The contradiction stays found during the hold that follows, in which the sticks are neutral.
        self.is_found = is_still && (self.is_found || is_new);
    }
}

impl FrozenMonitor {
    pub(super) fn new(dt_s: f64) -> Self {
        Self { dt_s, hidden: HiddenSpeed::new(dt_s), ..Self::default() }
    }

    /// Takes a tick in which the pose has been still as long as `still` shows; for how long this contradicts inputs or
    /// drone, as of [`Findings::frozen_s`](super::Findings::frozen_s). s
    ///
    /// One axis alone counts if the inputs along it have changed, unless the drone reports that it has not followed
    /// inputs along x and y: then these were lost. If it reports that in an outage, the throttle was lost, too.
    pub(super) fn update(
        &mut self,
        still: &Still,
        sample: &Sample,
        velocity: Agreement,
    ) -> Option<f64> {
        self.hidden.update(sample);
        self.follow_inputs(sample);
        let signs = Signs {
            has_large_input: self.u_lagged_w.norm() > INPUT_MIN,
            is_still: still.all_s.is_some(),
            reports_no_motion: false,
        };
        self.all.update(signs, self.dt_s);
        let reports_no_motion = self.hidden.reports_no_motion();
        let is_throttle_lost = reports_no_motion && !sample.link_is_up;
        let change = self.u_lagged_w - self.u_mean_w;
        let least = INPUT_MIN.max(ALONG_MIN * change.norm());
        let mut longest_s = None;
        for (row, contradiction) in self.rows.iter_mut().enumerate() {
            let still_s = still.rows_s[row];
            let is_height = ROWS[row] == pose::Z;
            let signs = Signs {
                has_large_input: change[row].abs() > least,
                is_still: still_s.is_some() && !(is_height && is_throttle_lost),
                reports_no_motion: reports_no_motion && !is_height,
            };
            contradiction.update(signs, self.dt_s);
            longest_s = longest(still_s.filter(|_| contradiction.is_found), longest_s);
        }
        let by_all_s = still.all_s.and_then(|still_s| match velocity {
            _ if self.all.is_found => Some(still_s),
            // The drone reports that it hovers.
            Agreement::Agrees => None,
            _ if sample.link_is_up => (still_s > QUIET_S).then_some(still_s),
            _ => (still_s > QUIET_IN_OUTAGE_S).then_some(still_s),
        });
        longest(by_all_s, longest_s)
    }

    /// Follows the inputs after the lag of a typical vehicle.
    fn follow_inputs(&mut self, sample: &Sample) {
        self.theta_rad = sample.pose.map_or(self.theta_rad, |pose| pose[pose::THETA]);
        let is_heard = sample.link_is_up || self.hidden.mps() >= FLOWN_MPS;
        let u = if is_heard { sample.u_applied } else { Sticks::zeros() };
        let u_w = inputs_w(&u, self.theta_rad).push(excess(u[stick::THROTTLE], DEAD_THROTTLE));
        self.u_lagged_w += (u_w - self.u_lagged_w) * (1.0 - lag_decay(self.dt_s));
        self.u_mean_w += (self.u_lagged_w - self.u_mean_w) * (1.0 - decay(self.dt_s, MEAN_INPUT_S));
    }
}

/// The newest poses, and for how long they have been still.
#[derive(Debug, Clone)]
struct Window {
    still_m: f64,
    length_s: f64,
    dt_s: f64,
    /// The newest poses, a whole number of blocks.
    poses: Ring<Pose>,
    count: usize,
    /// For how long each row has been still; `None`: it moves. s
    still_s: [Option<f64>; ROWS.len()],
}

impl Window {
    fn new(still_m: f64, length_s: f64, dt_s: f64) -> Self {
        let block = horizon_model::steps(length_s / BLOCKS as f64, dt_s).max(2);
        let poses = Ring::new(Pose::zeros(), BLOCKS * block);
        Self { still_m, length_s, dt_s, poses, count: 0, still_s: [None; ROWS.len()] }
    }

    fn reset(&mut self) {
        self.count = 0;
        self.still_s = [None; ROWS.len()];
    }

    fn observe(&mut self, pose: &Pose) {
        self.poses.push(*pose);
        self.count = self.count.saturating_add(1);
        let is_full = self.count >= self.poses.len();
        self.still_s = std::array::from_fn(|at| {
            let is_still = is_full && self.spread_m(ROWS[at]) < self.still_m;
            is_still.then(|| self.still_s[at].unwrap_or(self.length_s - self.dt_s))
        });
    }

    /// Takes the end of a period; for how long each row has been still. s
    fn advance(&mut self) -> [Option<f64>; ROWS.len()] {
        self.still_s = self.still_s.map(|still_s| Some(still_s? + self.dt_s));
        self.still_s
    }

    /// Range of the means of the blocks of `row`. m
    fn spread_m(&self, row: usize) -> f64 {
        let block = self.poses.len() / BLOCKS;
        let mean = |at: usize| {
            let values = (0..block).map(|k| self.poses.back(at * block + k)[row]);
            values.sum::<f64>() / block as f64
        };
        let (low, high) =
            (0..BLOCKS).map(mean).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), mean| {
                (low.min(mean), high.max(mean))
            });
        high - low
    }
}

#[cfg(test)]
mod tests;
