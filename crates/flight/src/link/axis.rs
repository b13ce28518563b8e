//! The motion of one axis, heading or height, under one hypothesis about the link.
//!
//! Owns a Kalman filter of value, driven rate and disturbance, with the errors of gain and dead time as states, like
//! the one of the horizontal motion. The yaw stick shows an outage, or its end, while roll and pitch rest.

use horizon_model::angle::wrap;
use horizon_model::setting::{SettingError, positive};
use nalgebra::{SMatrix, SVector};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{DeadTimeError, LinkTable, likelihood};
use crate::forgetting::decay;

/// Rows of the filter's state. The unit of the axis is rad or m.
mod row {
    /// Heading or height. unit
    pub(super) const VALUE: usize = 0;
    /// Rate that the stick drives. unit/s
    pub(super) const RATE: usize = 1;
    /// Disturbance rate. unit/s
    pub(super) const D: usize = 2;
    /// Relative error of the gain. 1
    pub(super) const GAIN: usize = 3;
    /// Error of the dead time. s
    pub(super) const DEAD_TIME: usize = 4;
    /// Number of rows.
    pub(super) const COUNT: usize = 5;
}

type State = SVector<f64, { row::COUNT }>;

/// Standard deviation of the rate before the first samples have shown it. unit/s
const SD_START: f64 = 0.5;
/// Time after which consecutive outliers are accepted as the new value: it was turned, or had been wrong before. s
const OUTLIERS_MAX_S: f64 = 0.5;

/// What the heading shows of the link, as written in a file.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TurnTable {
    /// Standard deviation of a heading that the filter accepts. rad, > 0
    pub sd_theta_rad: f64,
    /// Standard deviation of the disturbance rate. rad/s, > 0
    pub sd_disturbance_radps: f64,
    /// Time in which that rate decays. s, > 0
    pub decay_s: f64,
}

impl TurnTable {
    /// Refuses what no filter can have.
    ///
    /// # Errors
    /// An entry is not finite and positive.
    pub(super) fn check(&self) -> Result<(), SettingError> {
        positive("turn.sd_theta_rad", self.sd_theta_rad)?;
        positive("turn.sd_disturbance_radps", self.sd_disturbance_radps)?;
        positive("turn.decay_s", self.decay_s)?;
        Ok(())
    }

    /// The filter of the heading.
    pub(super) fn noise(&self, link: &LinkTable) -> Noise {
        Noise {
            sd: self.sd_theta_rad,
            sd_disturbance: self.sd_disturbance_radps,
            decay_s: self.decay_s,
            dead_time_adapt_s: link.adapt_s,
            is_angle: true,
        }
    }
}

/// What the height shows of the throttle's dead time, as written in a file.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HeightTable {
    /// Standard deviation of a height that the filter accepts. m, > 0
    pub sd_z_m: f64,
    /// Standard deviation of the vertical disturbance velocity. m/s, > 0
    pub sd_disturbance_mps: f64,
    /// Time in which that velocity decays. s, > 0
    pub decay_s: f64,
    /// Time in which the dead time may change. s, > 0
    pub adapt_s: f64,
}

impl HeightTable {
    /// Refuses what no filter can have.
    ///
    /// # Errors
    /// An entry is not finite and positive.
    pub(super) fn check(&self) -> Result<(), SettingError> {
        positive("height.sd_z_m", self.sd_z_m)?;
        positive("height.sd_disturbance_mps", self.sd_disturbance_mps)?;
        positive("height.decay_s", self.decay_s)?;
        positive("height.adapt_s", self.adapt_s)?;
        Ok(())
    }

    /// The filter of the height.
    pub(super) fn noise(&self) -> Noise {
        Noise {
            sd: self.sd_z_m,
            sd_disturbance: self.sd_disturbance_mps,
            decay_s: self.decay_s,
            dead_time_adapt_s: self.adapt_s,
            is_angle: false,
        }
    }
}

/// What distinguishes the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Noise {
    /// Standard deviation of an accepted sample. unit
    sd: f64,
    /// Standard deviation of the disturbance rate. unit/s
    sd_disturbance: f64,
    /// Time in which that rate decays. s
    decay_s: f64,
    /// Time in which the dead time may change. s
    dead_time_adapt_s: f64,
    /// Whether values wrap at pi.
    is_angle: bool,
}

/// What the stick of the axis commands in one period.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct AxisCommand {
    /// Rate. unit/s
    pub(super) asked: f64,
    /// Derivative of `asked` by time. unit/s^2
    pub(super) rate: f64,
}

/// Mean and covariance under one hypothesis.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct AxisFilter {
    noise: Noise,
    s: State,
    covariance: SMatrix<f64, { row::COUNT }, { row::COUNT }>,
    /// Time of outliers since the last sample that was none. s
    outliers_s: f64,
}

impl AxisFilter {
    /// The model is right, the axis at `value`, and its rate unknown.
    pub(super) fn new(table: &LinkTable, noise: Noise, value: f64) -> Self {
        let mut s = State::zeros();
        s[row::VALUE] = value;
        let mut sd = stationary_sd(table, &noise);
        (sd[row::VALUE], sd[row::RATE]) = (noise.sd, SD_START);
        let covariance = SMatrix::from_diagonal(&sd.component_mul(&sd));
        Self { noise, s, covariance, outliers_s: 0.0 }
    }

    /// Prediction step of the filter over a period of `dt_s` with the applied `command`, of an axis with the time
    /// constant `tau_s`.
    ///
    /// With the errors `eps_lambda` of the gain and `eps_D` of the dead time (`docs/control.md`, section 5); of the
    /// height `omega` is `v_z` and `theta` is `z`:
    ///
    /// | symbol | equation |
    /// |---|---|
    /// | `a` | `(1 + eps_lambda) c - eps_D dc/dt` |
    /// | `omega'` | `omega + (1 - exp(-dt / tau)) (a - omega)` |
    /// | `d'`, `theta'` | `exp(-dt / decay) d`, `theta + dt (omega' + d')` |
    pub(super) fn predict(
        &mut self,
        table: &LinkTable,
        command: AxisCommand,
        tau_s: f64,
        dt_s: f64,
    ) {
        let AxisCommand { asked, rate } = command;
        let fraction = 1.0 - decay(dt_s, tau_s);
        let keep = keep_factors(table, &self.noise, dt_s);
        let mut f = SMatrix::from_diagonal(&keep);
        f[(row::RATE, row::RATE)] = 1.0 - fraction;
        f[(row::RATE, row::GAIN)] = fraction * asked;
        f[(row::RATE, row::DEAD_TIME)] = -fraction * rate;
        let by_rates = dt_s * (f.row(row::RATE) + f.row(row::D));
        f.set_row(row::VALUE, &(f.row(row::VALUE) + by_rates));
        self.s = f * self.s;
        self.s[row::RATE] += fraction * asked;
        self.s[row::VALUE] += dt_s * fraction * asked;
        self.covariance = f * self.covariance * f.transpose();
        let sd = stationary_sd(table, &self.noise);
        for i in row::D..row::COUNT {
            self.covariance[(i, i)] += (1.0 - keep[i] * keep[i]) * sd[i] * sd[i];
        }
    }

    /// Correction step with the value of a pose, `None` if it is missing; returns its log likelihood up to a constant.
    pub(super) fn correct(&mut self, table: &LinkTable, seen: Option<f64>, dt_s: f64) -> f64 {
        let Some(seen) = seen else { return 0.0 };
        let by_value = self.covariance.column(row::VALUE).clone_owned();
        let variance = by_value[row::VALUE] + self.noise.sd * self.noise.sd;
        let off = seen - self.s[row::VALUE];
        let error = if self.noise.is_angle { wrap(off) } else { off };
        let (log_likelihood, weight) = likelihood::capped(error, variance);
        self.s += by_value * (weight * error / variance);
        self.covariance -= by_value * by_value.transpose() * (weight / variance);
        self.outliers_s = if weight > 0.0 { 0.0 } else { self.outliers_s + dt_s };
        if self.outliers_s > OUTLIERS_MAX_S {
            *self = Self::new(table, self.noise, seen);
        }
        log_likelihood
    }

    /// The assumed dead time of the axis is longer by `longer_s`: its error is as much smaller.
    pub(super) fn correct_dead_time(&mut self, longer_s: f64) {
        self.s[row::DEAD_TIME] -= longer_s;
    }

    /// What is known of the error of the dead time.
    pub(super) fn dead_time_error(&self) -> DeadTimeError {
        let at = row::DEAD_TIME;
        DeadTimeError::of(self.s[at], self.covariance[(at, at)])
    }
}

/// Standard deviations of what wanders, when nothing is observed.
fn stationary_sd(table: &LinkTable, noise: &Noise) -> State {
    let mut sd = State::zeros();
    sd[row::D] = noise.sd_disturbance;
    sd[row::GAIN] = table.sd_gain;
    sd[row::DEAD_TIME] = table.sd_dead_time_s;
    sd
}

/// What is left of each row after a period by itself.
fn keep_factors(table: &LinkTable, noise: &Noise, dt_s: f64) -> State {
    let mut keep = State::repeat(decay(dt_s, table.adapt_s));
    (keep[row::VALUE], keep[row::RATE]) = (1.0, 1.0);
    keep[row::D] = decay(dt_s, noise.decay_s);
    keep[row::DEAD_TIME] = decay(dt_s, noise.dead_time_adapt_s);
    keep
}

#[cfg(test)]
mod tests;
