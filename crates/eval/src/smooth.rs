//! The motion of a recorded flight, estimated without a vehicle model: what forecasts are judged by.
//!
//! Owns which samples of a recording count, the smoother (all samples) and the tracker (past samples
//! only). Both are robust: position by Student-t weights under white jerk, heading by the best path on
//! a circle first, so that flips of any length are left out. The definitions of a judged
//! figure are constants here and no settings.

mod circle;
mod jerk;

use horizon_model::angle::{unwrap_near, wrap};
use horizon_model::rows::{Pose, pose};

use horizon_estim::Observed;
use jerk::Noise;

/// Noise of a position. The jerk is that of a Tello between two sticks, the scale wide enough for a
/// shaking stand and a delayed sample.
const POSITION: Noise = Noise { jerk: 400.0, scale: 0.004 };
/// Noise of the heading. With a hundred times the jerk it follows the noise of the samples, and
/// headings predicted from the past alone are off by half as much again.
const HEADING: Noise = Noise { jerk: 20.0, scale: 0.02 };
/// A heading sample further than this from the best path is a flip. rad
const HEADING_TRUST_RAD: f64 = 0.12;
/// Nearest valid sample of an accepted step. steps
const SAMPLE_GAP_MAX: usize = 3;
/// Nearest trusted heading of an accepted step. steps
const HEADING_GAP_MAX: usize = 10;
/// An object nearer to the origin than this in x, y and z is not seen. m
pub(crate) const ORIGIN_M: f64 = 1e-3;

/// Pose, velocity and acceleration of a flight at every step; the heading is continuous.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionTrack {
    /// Pose. m, rad
    pub pose: Vec<Pose>,
    /// Its rate. m/s, rad/s
    pub velocity: Vec<Pose>,
    /// The rate of that. m/s^2, rad/s^2
    pub acceleration: Vec<Pose>,
    /// The samples that it follows, clean enough to identify from: what does not count is absent, a
    /// heading that is no flip is continuous.
    pub o: Vec<Observed<{ pose::COUNT }>>,
    /// Whether a valid sample is at most 3 steps and a trusted heading at most 10 steps away.
    pub is_trusted: Vec<bool>,
    /// Whether a valid sample is at most 3 steps and a trusted heading at most 10 steps old: from there on a
    /// forecast may begin. In a stall of the stream the causal track extrapolates.
    pub is_current: Vec<bool>,
}

/// Track of a flight from all its samples.
///
/// Position: robust fixed-interval smoother under white jerk (400 m^2/s^5, Student-t with 3 degrees
/// of freedom and scale 4 mm). Heading: best path on a circular grid,
/// then the same smoother (20 rad^2/s^5, 0.02 rad) on the samples within 0.12 rad of it. A sample counts if
/// its position is complete, is not "object lost" and differs from the one before.
///
/// Time and memory grow linearly with the steps.
pub fn smooth(o: &[Observed<{ pose::COUNT }>], dt_s: f64) -> MotionTrack {
    estimate(o, circle::best_path, |samples, noise| jerk::smooth(samples, noise, dt_s))
}

/// Track from the samples up to each step: what a controller could have known.
///
/// As [`smooth`], with a Kalman filter in place of the smoother and the end of the best path so far.
/// `is_trusted` and `is_current` are those of [`smooth`], so that the same steps are judged.
pub fn track(o: &[Observed<{ pose::COUNT }>], dt_s: f64) -> MotionTrack {
    estimate(o, circle::best_so_far, |samples, noise| jerk::track(samples, noise, dt_s))
}

fn estimate(
    o: &[Observed<{ pose::COUNT }>],
    path: impl Fn(&[Option<f64>]) -> Vec<f64>,
    follow: impl Fn(&[Option<f64>], Noise) -> Vec<jerk::Estimate>,
) -> MotionTrack {
    let valid = valid_samples(o);
    let heading = trusted_headings(&valid, path);
    let estimates: [Vec<jerk::Estimate>; pose::COUNT] = std::array::from_fn(|row| {
        if row == pose::THETA {
            return follow(&heading, HEADING);
        }
        let samples: Vec<_> = valid.iter().map(|sample| sample.map(|o| o[row])).collect();
        follow(&samples, POSITION)
    });
    let collect = |part: fn(&jerk::Estimate) -> f64| {
        (0..o.len()).map(|k| Pose::from_fn(|row, _| part(&estimates[row][k]))).collect()
    };
    let both = |a: Vec<bool>, b: Vec<bool>| a.iter().zip(&b).map(|(a, b)| *a && *b).collect();
    let near = (is_near(&valid, SAMPLE_GAP_MAX, true), is_near(&heading, HEADING_GAP_MAX, true));
    let current =
        (is_near(&valid, SAMPLE_GAP_MAX, false), is_near(&heading, HEADING_GAP_MAX, false));
    MotionTrack {
        pose: collect(|estimate| estimate.value),
        velocity: collect(|estimate| estimate.rate),
        acceleration: collect(|estimate| estimate.acceleration),
        o: valid.iter().zip(&heading).map(|(valid, heading)| clean(*valid, *heading)).collect(),
        is_trusted: both(near.0, near.1),
        is_current: both(current.0, current.1),
    }
}

/// The samples that count: position complete, not "object lost", not a repetition of the one before. A
/// heading that is absent is NaN.
fn valid_samples(o: &[Observed<{ pose::COUNT }>]) -> Vec<Option<Pose>> {
    let mut previous = None;
    let mut valid = |observed: &Observed<{ pose::COUNT }>| {
        let position = [pose::X, pose::Y, pose::Z];
        let is_complete = position.iter().all(|row| observed.is_present[*row]);
        let mut sample = (is_complete && observed.is_finite()).then_some(observed.o)?;
        let heading = observed.is_present[pose::THETA].then_some(sample[pose::THETA]);
        let seen = (position.map(|row| sample[row]), heading);
        let is_repeated = previous.replace(seen) == Some(seen);
        let is_lost = position.iter().all(|row| sample[*row].abs() < ORIGIN_M);
        sample[pose::THETA] = heading.unwrap_or(f64::NAN);
        (!is_repeated && !is_lost).then_some(sample)
    };
    o.iter().map(&mut valid).collect()
}

/// Headings near the best path, continuous.
fn trusted_headings(
    valid: &[Option<Pose>],
    path: impl Fn(&[Option<f64>]) -> Vec<f64>,
) -> Vec<Option<f64>> {
    let seen = |sample: &Option<Pose>| {
        let theta = (*sample)?[pose::THETA];
        theta.is_finite().then_some(theta)
    };
    let seen: Vec<Option<f64>> = valid.iter().map(seen).collect();
    let mut continuous = 0.0;
    path(&seen)
        .iter()
        .zip(&seen)
        .map(|(path, seen)| {
            continuous = unwrap_near(*path, continuous);
            let r = wrap((*seen)? - continuous);
            (r.abs() < HEADING_TRUST_RAD).then_some(continuous + r)
        })
        .collect()
}

/// A valid sample with the heading that is trusted, or without one.
fn clean(valid: Option<Pose>, heading: Option<f64>) -> Observed<{ pose::COUNT }> {
    let Some(mut o) = valid else { return Observed::missing() };
    o[pose::THETA] = heading.unwrap_or(0.0);
    let mut observed = Observed::full(o);
    observed.is_present[pose::THETA] = heading.is_some();
    observed
}

/// Whether a present entry is at most `gap` steps in the past, or in the future if that counts, too.
fn is_near<T>(samples: &[Option<T>], gap: usize, counts_future: bool) -> Vec<bool> {
    let after = if counts_future { gap + 1 } else { 1 };
    let near = |k: usize| {
        let window = &samples[k.saturating_sub(gap)..(k + after).min(samples.len())];
        window.iter().any(Option::is_some)
    };
    (0..samples.len()).map(near).collect()
}

#[cfg(test)]
mod tests;
