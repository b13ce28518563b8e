//! The turn about the vertical under one hypothesis about the link.
//!
//! Owns a Kalman filter of heading, driven rate and disturbance, with the errors of gain and dead time as states,
//! like the one of the horizontal motion. The yaw stick shows an outage, or its end, while roll and pitch rest.

use horizon_estim::Observed;
use horizon_model::angle::wrap;
use horizon_model::rows::{lag, pose};
use horizon_model::setting::{SettingError, positive};
use nalgebra::{SMatrix, SVector};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{LinkTable, likelihood};

/// Rows of the filter's state.
mod row {
    /// Heading. rad
    pub(super) const THETA: usize = 0;
    /// Rate that the yaw stick drives. rad/s
    pub(super) const OMEGA: usize = 1;
    /// Disturbance rate. rad/s
    pub(super) const D: usize = 2;
    /// Relative error of the gain. 1
    pub(super) const GAIN: usize = 3;
    /// Error of the dead time. s
    pub(super) const DEAD_TIME: usize = 4;
    /// Number of rows.
    pub(super) const COUNT: usize = 5;
}

type State = SVector<f64, { row::COUNT }>;

/// Rate before the first samples have shown it. rad/s
const SD_START_RADPS: f64 = 0.5;
/// Time of nothing but outliers after which they are the heading: it was turned, or had been wrong before. s
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
    /// # Errors
    /// An entry is not finite and positive.
    pub(super) fn check(&self) -> Result<(), SettingError> {
        positive("turn.sd_theta_rad", self.sd_theta_rad)?;
        positive("turn.sd_disturbance_radps", self.sd_disturbance_radps)?;
        positive("turn.decay_s", self.decay_s)?;
        Ok(())
    }
}

/// Turn that the yaw stick commands in one period.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct TurnCommand {
    /// Rate. rad/s
    pub(super) asked_radps: f64,
    /// Its rate. rad/s^2
    pub(super) rate_radps2: f64,
}

/// Mean and covariance under one hypothesis.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Turn {
    settings: TurnTable,
    s: State,
    covariance: SMatrix<f64, { row::COUNT }, { row::COUNT }>,
    /// Time of outliers since the last sample that was none. s
    outliers_s: f64,
}

impl Turn {
    /// The model is right, the heading `theta_rad`, and its rate unknown.
    pub(super) fn new(table: &LinkTable, settings: TurnTable, theta_rad: f64) -> Self {
        let mut s = State::zeros();
        s[row::THETA] = theta_rad;
        let mut sd = stationary_sd(table, &settings);
        (sd[row::THETA], sd[row::OMEGA]) = (settings.sd_theta_rad, SD_START_RADPS);
        let covariance = SMatrix::from_diagonal(&sd.component_mul(&sd));
        Self { settings, s, covariance, outliers_s: 0.0 }
    }

    /// Prediction step of the filter over a period with the applied `command`.
    ///
    /// With the errors `eps_lambda` of the gain and `eps_D` of the dead time (`docs/control.md`, section 5):
    ///
    /// | symbol | equation |
    /// |---|---|
    /// | `a` | `(1 + eps_lambda) c - eps_D dc/dt` |
    /// | `omega'` | `omega + (1 - exp(-dt / tau_a)) (a - omega)` |
    /// | `d'`, `theta'` | `exp(-dt / decay) d`, `theta + dt (omega' + d')` |
    pub(super) fn predict(
        &mut self,
        table: &LinkTable,
        command: TurnCommand,
        p: &SVector<f64, { lag::COUNT }>,
        dt_s: f64,
    ) {
        let TurnCommand { asked_radps, rate_radps2 } = command;
        let fraction = 1.0 - (-dt_s / p[lag::TAU_A]).exp();
        let keep = keep_factors(table, &self.settings, dt_s);
        let mut f = SMatrix::from_diagonal(&keep);
        f[(row::OMEGA, row::OMEGA)] = 1.0 - fraction;
        f[(row::OMEGA, row::GAIN)] = fraction * asked_radps;
        f[(row::OMEGA, row::DEAD_TIME)] = -fraction * rate_radps2;
        let by_rates = dt_s * (f.row(row::OMEGA) + f.row(row::D));
        f.set_row(row::THETA, &(f.row(row::THETA) + by_rates));
        self.s = f * self.s;
        self.s[row::OMEGA] += fraction * asked_radps;
        self.s[row::THETA] += dt_s * fraction * asked_radps;
        self.covariance = f * self.covariance * f.transpose();
        let sd = stationary_sd(table, &self.settings);
        for i in row::D..row::COUNT {
            self.covariance[(i, i)] += (1.0 - keep[i] * keep[i]) * sd[i] * sd[i];
        }
    }

    /// Correction step with the heading of a pose; returns its log likelihood up to a constant.
    pub(super) fn correct(
        &mut self,
        table: &LinkTable,
        observed: &Observed<{ pose::COUNT }>,
        dt_s: f64,
    ) -> f64 {
        if !observed.is_present[pose::THETA] {
            return 0.0;
        }
        let by_theta = self.covariance.column(row::THETA).clone_owned();
        let sd_rad = self.settings.sd_theta_rad;
        let variance = by_theta[row::THETA] + sd_rad * sd_rad;
        let error_rad = wrap(observed.o[pose::THETA] - self.s[row::THETA]);
        let (log_likelihood, weight) = likelihood::capped(error_rad, variance);
        self.s += by_theta * (weight * error_rad / variance);
        self.covariance -= by_theta * by_theta.transpose() * (weight / variance);
        self.outliers_s = if weight > 0.0 { 0.0 } else { self.outliers_s + dt_s };
        if self.outliers_s > OUTLIERS_MAX_S {
            *self = Self::new(table, self.settings, observed.o[pose::THETA]);
        }
        log_likelihood
    }

    /// The assumed dead time of yaw is longer by `longer_s`: its error is as much smaller.
    pub(super) fn correct_dead_time(&mut self, longer_s: f64) {
        self.s[row::DEAD_TIME] -= longer_s;
    }

    /// Error of the dead time of yaw. s
    #[cfg(test)]
    pub(super) fn dead_time_error_s(&self) -> f64 {
        self.s[row::DEAD_TIME]
    }
}

/// Standard deviations of what wanders, when nothing is observed.
fn stationary_sd(table: &LinkTable, settings: &TurnTable) -> State {
    let mut sd = State::zeros();
    sd[row::D] = settings.sd_disturbance_radps;
    sd[row::GAIN] = table.sd_gain;
    sd[row::DEAD_TIME] = table.sd_dead_time_s;
    sd
}

/// What is left of each row after a period by itself.
fn keep_factors(table: &LinkTable, settings: &TurnTable, dt_s: f64) -> State {
    let mut keep = State::repeat((-dt_s / table.adapt_s).exp());
    (keep[row::THETA], keep[row::OMEGA]) = (1.0, 1.0);
    keep[row::D] = (-dt_s / settings.decay_s).exp();
    keep
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use horizon_model::check::amax;
    use horizon_model::differences;
    use horizon_model::rows::Pose;

    use super::super::tests::{parameter, table};
    use super::*;

    const DT_S: f64 = 0.02;

    #[test]
    fn the_covariance_is_propagated_by_the_jacobian_of_the_mean() {
        let (table, p) = (table(), parameter());
        let settings = table.turn.unwrap();
        let root = SMatrix::<f64, { row::COUNT }, { row::COUNT }>::from_fn(|i, j| {
            (0.7 * i as f64 + 1.3 * j as f64).sin()
        });
        for theta_rad in [0.3, PI - 1e-9, -PI + 1e-9] {
            let mut start = Turn::new(&table, settings, theta_rad);
            start.covariance = root * root.transpose();
            start.s = State::from([theta_rad, 0.4, -0.2, 0.15, -0.03]);
            let command = TurnCommand { asked_radps: 0.8, rate_radps2: -3.0 };
            let predicted = |s: &State| {
                let mut turn = Turn { s: *s, ..start.clone() };
                turn.predict(&table, command, &p, DT_S);
                turn
            };
            let by_state = differences::jacobian(|s| predicted(s).s, &start.s);
            let (keep, sd) =
                (keep_factors(&table, &settings, DT_S), stationary_sd(&table, &settings));
            let noise = (State::repeat(1.0) - keep.component_mul(&keep))
                .component_mul(&sd)
                .component_mul(&sd);
            let expected =
                by_state * start.covariance * by_state.transpose() + SMatrix::from_diagonal(&noise);
            let gap = amax(&(predicted(&start.s).covariance - expected));
            assert!(gap < 1e-8, "{gap:e} at {theta_rad}");
        }
    }

    #[test]
    fn a_heading_that_stays_turned_is_taken_after_half_a_second() {
        let table = table();
        let mut turn = Turn::new(&table, table.turn.unwrap(), 0.2);
        let mut see = |turned_rad: f64, steps: u32| {
            for _ in 0..steps {
                turn.predict(&table, TurnCommand::default(), &parameter(), DT_S);
                let seen = Observed::full(Pose::new(0.0, 0.0, 0.0, wrap(0.2 + turned_rad)));
                turn.correct(&table, &seen, DT_S);
            }
            wrap(turn.s[row::THETA] - 0.2)
        };
        assert!(see(0.0, 50).abs() < 1e-9);
        assert!(see(2.5, 20).abs() < 1e-9);
        assert!(see(0.0, 1).abs() < 1e-9);
        assert!((see(2.5, 30) - 2.5).abs() < 1e-9);
    }

    #[test]
    fn a_vehicle_that_is_the_model_is_followed_over_the_wrap() {
        let (table, p) = (table(), parameter());
        let mut turn = Turn::new(&table, table.turn.unwrap(), 3.0);
        let (mut theta_rad, mut omega_radps, mut asked_radps) = (3.0, 0.0, 0.0);
        let fraction = 1.0 - (-DT_S / p[lag::TAU_A]).exp();
        for k in 0..500 {
            let now_radps = 1.2 * (f64::from(k) * DT_S).sin();
            let rate_radps2 = (now_radps - asked_radps) / DT_S;
            asked_radps = now_radps;
            turn.predict(&table, TurnCommand { asked_radps, rate_radps2 }, &p, DT_S);
            omega_radps += fraction * (asked_radps - omega_radps);
            theta_rad += DT_S * omega_radps;
            let mut observed = Observed::missing();
            observed.is_present[pose::THETA] = k % 3 != 0;
            observed.o[pose::THETA] = wrap(theta_rad);
            turn.correct(&table, &observed, DT_S);
            let gap_rad = wrap(turn.s[row::THETA] - theta_rad).abs();
            assert!(gap_rad < 1e-6, "{gap_rad} at {k}");
        }
    }

    #[test]
    fn each_error_moves_the_mean_to_its_side() {
        let (table, p) = (table(), parameter());
        let settings = table.turn.unwrap();
        let predicted = |row: usize, error: f64| {
            let mut turn = Turn::new(&table, settings, 0.0);
            turn.s[row] = error;
            let command = TurnCommand { asked_radps: 0.8, rate_radps2: 3.0 };
            turn.predict(&table, command, &p, DT_S);
            turn.s
        };
        let right = predicted(row::GAIN, 0.0);
        let change = |row, error| predicted(row, error) - right;
        assert!(change(row::GAIN, 0.1)[row::OMEGA] > 1e-3, "more gain is faster");
        assert!(change(row::DEAD_TIME, 0.1)[row::OMEGA] < -1e-3, "later is slower while it grows");
        let drift_rad = change(row::D, 0.2)[row::THETA];
        let expected_rad = DT_S * 0.2 * (-DT_S / settings.decay_s).exp();
        assert!((drift_rad - expected_rad).abs() < 1e-12, "{drift_rad}");
        let kept = predicted(row::GAIN, 0.1)[row::GAIN];
        assert!((kept - 0.1 * (-DT_S / table.adapt_s).exp()).abs() < 1e-12, "{kept}");
        let mut turn = Turn::new(&table, settings, 0.0);
        turn.s[row::DEAD_TIME] = 0.03;
        turn.correct_dead_time(0.02);
        assert!((turn.s[row::DEAD_TIME] - 0.01).abs() < 1e-12, "{turn:?}");
    }
}
