//! How well a flight could have been predicted: multi-step prediction errors of models on recordings.
//!
//! Owns the forecasts (a model driven by the sticks, constant velocity, standing still), which steps
//! are judged, and the errors by horizon. The track that is judged by: `smooth.rs`. Lost commands:
//! `outage.rs`. The fit of a model: `ident.rs`.

mod errors;

use horizon_model::Model;
use horizon_model::rows::{Pose, Sticks, pose, stick};
use nalgebra::SVector;

use crate::smooth::MotionTrack;
pub use errors::{ErrorSummary, ForecastErrors, HorizonErrors};

/// Steps between two starts of a forecast.
const START_EVERY_STEPS: usize = 10;

/// A forecast: poses after a start, from the track up to it and the sticks.
pub trait Forecast {
    /// Fills `ahead[h]` with the pose `h + 1` steps after step `start` of `track`.
    fn predict(&self, track: &MotionTrack, start: usize, ahead: &mut [Pose]);
}

/// The vehicle stays where it is.
#[derive(Debug, Clone, Copy)]
pub struct StandStill;

impl Forecast for StandStill {
    fn predict(&self, track: &MotionTrack, start: usize, ahead: &mut [Pose]) {
        ahead.fill(track.pose[start]);
    }
}

/// The vehicle keeps its velocity and yaw rate.
#[derive(Debug, Clone, Copy)]
pub struct ConstantVelocity {
    /// Period. s, > 0
    pub dt_s: f64,
}

impl Forecast for ConstantVelocity {
    fn predict(&self, track: &MotionTrack, start: usize, ahead: &mut [Pose]) {
        let mut s = track.pose[start];
        for ahead in ahead {
            s += self.dt_s * track.velocity[start];
            *ahead = s;
        }
    }
}

/// A model driven by the sticks since the start of the recording, plus a residual velocity that
/// decays.
///
/// Up to a start the observed rows of the state are those of the track and the hidden rows are rolled
/// out from rest. What the velocity of the track has beyond the model's at the start is the residual.
/// From there on nothing but the applied inputs is used. The poses `o` have the rows of
/// [`horizon_model::rows::pose`].
#[derive(Debug, Clone)]
pub struct Driven<'a, M, const NS: usize, const NP: usize> {
    model: M,
    p: SVector<f64, NP>,
    u_applied: &'a [Sticks],
    /// How much of the residual is left after a step; zero for a row that has none.
    keep: Pose,
    dt_s: f64,
    /// State at every step of the track.
    s: Vec<SVector<f64, NS>>,
}

impl<'a, M, const NS: usize, const NP: usize> Driven<'a, M, NS, NP>
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP>,
{
    /// The forecast of one flight.
    ///
    /// `u_applied[k]` acts from step `k` to `k + 1`; `residual_decay_s` is the time in which the residual
    /// velocity of each row decays, zero for a row without (as the thesis predicts). s, >= 0
    ///
    /// Allocates one state per step.
    pub fn new(
        model: M,
        p: &SVector<f64, NP>,
        residual_decay_s: &Pose,
        u_applied: &'a [Sticks],
        track: &MotionTrack,
        dt_s: f64,
    ) -> Self {
        let mut state = track.pose.first().map_or_else(SVector::zeros, |pose| model.at_rest(pose));
        let s = track
            .pose
            .iter()
            .zip(u_applied)
            .map(|(pose, u)| {
                let now = with_pose(&model, &state, pose);
                state = model.step(&now, u, p, dt_s);
                now
            })
            .collect();
        // exp(-inf) for a time of zero.
        let keep = residual_decay_s.map(|decay_s| (-dt_s / decay_s).exp());
        Self { model, p: *p, u_applied, keep, dt_s, s }
    }
}

impl<M, const NS: usize, const NP: usize> Forecast for Driven<'_, M, NS, NP>
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP>,
{
    fn predict(&self, track: &MotionTrack, start: usize, ahead: &mut [Pose]) {
        let mut s = self.s[start];
        let mut offset = Pose::zeros();
        let mut residual = None;
        for (ahead, u) in ahead.iter_mut().zip(&self.u_applied[start..]) {
            let s_next = self.model.step(&s, u, &self.p, self.dt_s);
            let step = residual.map_or_else(
                || {
                    let driven = self.model.observe(&s_next) - self.model.observe(&s);
                    let excess = track.velocity[start] * self.dt_s - driven;
                    Pose::from_fn(|row, _| if self.keep[row] > 0.0 { excess[row] } else { 0.0 })
                },
                |before: Pose| before.component_mul(&self.keep),
            );
            offset += step;
            residual = Some(step);
            *ahead = self.model.observe(&s_next) + offset;
            s = s_next;
        }
    }
}

/// `s` with its observed rows as in `pose`.
fn with_pose<M, const NS: usize, const NP: usize>(
    model: &M,
    s: &SVector<f64, NS>,
    pose: &Pose,
) -> SVector<f64, NS>
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP>,
{
    // Hidden rows of a state at rest do not depend on where it rests.
    s + model.at_rest(pose) - model.at_rest(&model.observe(s))
}

/// Errors of `forecast` on one flight, at every horizon of 1 to `horizon_steps` steps.
///
/// A forecast starts every 10 steps from `known`, which is `truth` for the smoothed start and the
/// causal track for the causal one. A start needs a sample that is not old (`is_current`): in a stall of the
/// stream nothing is known to start from. It is judged at a horizon if both ends are accepted in `truth` and
/// no step between them is excluded (`is_excluded`, e.g. because commands were lost; an empty slice
/// excludes nothing).
pub fn prediction_errors(
    forecast: &(impl Forecast + ?Sized),
    known: &MotionTrack,
    truth: &MotionTrack,
    is_excluded: &[bool],
    horizon_steps: usize,
) -> ForecastErrors {
    let mut errors = ForecastErrors::new(horizon_steps);
    let mut ahead = vec![Pose::zeros(); horizon_steps];
    let steps = truth.pose.len();
    for start in (0..steps).step_by(START_EVERY_STEPS) {
        let end = steps.min(start + horizon_steps + 1);
        let is_usable = |k: usize| !is_excluded.get(k).copied().unwrap_or(false);
        // Horizons reached without an excluded step on the way.
        let reach = (start..end).take_while(|k| is_usable(*k)).count().saturating_sub(1);
        if reach == 0 || !truth.is_trusted[start] || !truth.is_current[start] {
            continue;
        }
        let ahead = &mut ahead[..reach];
        forecast.predict(known, start, ahead);
        for (horizon, s_pred) in ahead.iter().enumerate() {
            let at = start + horizon + 1;
            if truth.is_trusted[at] {
                errors.push(horizon, &(s_pred - truth.pose[at]));
            }
        }
    }
    errors
}

#[cfg(test)]
mod tests;
