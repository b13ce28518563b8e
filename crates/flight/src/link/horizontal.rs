//! The horizontal motion under one hypothesis about the link.
//!
//! Owns a Kalman filter of position, driven velocity and disturbance, together with what the vehicle
//! model may have wrong: the errors of gain, heading, dead time and lag are states that scale known
//! directions of the command. This distinguishes a wrong model from a lost command, which no plausible error
//! explains. Which hypothesis is accepted is decided in `link.rs`.

use horizon_estim::Observed;
use horizon_model::rows::{lag, pose};
use nalgebra::{SMatrix, SVector, Vector2};

use super::{DeadTimeError, LinkTable, likelihood};
use crate::forgetting::decay;

/// Rows of the filter's state.
mod row {
    /// World position. m
    pub(super) const X: usize = 0;
    pub(super) const Y: usize = 1;
    /// Velocity that the sticks drive. m/s
    pub(super) const V_X: usize = 2;
    pub(super) const V_Y: usize = 3;
    /// Disturbance velocity. m/s
    pub(super) const D_X: usize = 4;
    pub(super) const D_Y: usize = 5;
    /// Relative error of the gain. 1
    pub(super) const GAIN: usize = 6;
    /// Error of the direction of flight. rad
    pub(super) const HEADING: usize = 7;
    /// Error of the dead time. s
    pub(super) const DEAD_TIME: usize = 8;
    /// Relative error of the rate at which the velocity follows. 1
    pub(super) const RATE: usize = 9;
    /// Number of rows.
    pub(super) const COUNT: usize = 10;
    /// Rows that wander: their variance grows towards that of [`super::stationary_sd`].
    pub(super) const WANDERING: [usize; 6] = [D_X, D_Y, GAIN, HEADING, DEAD_TIME, RATE];
}

type State = SVector<f64, { row::COUNT }>;

/// Standard deviation of the velocity before the first samples have shown it. m/s
const SD_START_MPS: f64 = 0.5;

/// Horizontal velocity that the sticks command in one period, world frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct HorizontalCommand {
    /// Velocity. m/s
    pub(super) commanded_w_mps: Vector2<f64>,
    /// Derivative of the velocity by time. m/s^2
    pub(super) rate_w_mps2: Vector2<f64>,
}

/// Mean and covariance under one hypothesis.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Horizontal {
    s: State,
    covariance: SMatrix<f64, { row::COUNT }, { row::COUNT }>,
}

impl Horizontal {
    /// The model is right, the vehicle at `pos_w`, and its velocity unknown.
    pub(super) fn new(table: &LinkTable, pos_w: Vector2<f64>) -> Self {
        let mut s = State::zeros();
        (s[row::X], s[row::Y]) = (pos_w.x, pos_w.y);
        let mut sd = stationary_sd(table);
        (sd[row::X], sd[row::Y]) = (table.sd_position_m, table.sd_position_m);
        (sd[row::V_X], sd[row::V_Y]) = (SD_START_MPS, SD_START_MPS);
        Self { s, covariance: SMatrix::from_diagonal(&sd.component_mul(&sd)) }
    }

    /// Prediction step of the filter over a period with the applied `command`.
    ///
    /// With the errors `eps_lambda` of the gain, `eps_psi` of the direction of flight, `eps_D` of the dead time and
    /// `eps_k` of the rate (`docs/control.md`, section 5):
    ///
    /// | symbol | equation |
    /// |---|---|
    /// | `a` | `(1 + eps_lambda) c + eps_psi turned(c) - eps_D dc/dt` |
    /// | `dv` | `(1 + eps_k) (1 - exp(-dt / tau_h)) (a - v)`, shortened to `a_max dt` |
    /// | `v'`, `d'`, `x'` | `v + dv`, `exp(-dt / decay) d`, `x + dt (v' + d')` |
    pub(super) fn predict(
        &mut self,
        table: &LinkTable,
        command: &HorizontalCommand,
        p: &SVector<f64, { lag::COUNT }>,
        dt_s: f64,
    ) {
        let HorizontalCommand { commanded_w_mps, rate_w_mps2 } = *command;
        let turned_w_mps = Vector2::new(-commanded_w_mps.y, commanded_w_mps.x);
        let v_w_mps = Vector2::new(self.s[row::V_X], self.s[row::V_Y]);
        let missing_w_mps = commanded_w_mps * (1.0 + self.s[row::GAIN])
            + turned_w_mps * self.s[row::HEADING]
            - rate_w_mps2 * self.s[row::DEAD_TIME]
            - v_w_mps;
        let fraction = 1.0 - decay(dt_s, p[lag::TAU_H]);
        let free = fraction * (1.0 + self.s[row::RATE]);
        let limit = (p[lag::A_MAX] * dt_s / (free * missing_w_mps).norm()).min(1.0);
        // The limit counts as a known factor: exact enough for a variance.
        let (free, fraction) = (limit * free, limit * fraction);
        let drive = |column: &State| {
            let by_errors = commanded_w_mps * column[row::GAIN]
                + turned_w_mps * column[row::HEADING]
                - rate_w_mps2 * column[row::DEAD_TIME];
            let v = Vector2::new(column[row::V_X], column[row::V_Y]);
            v + free * (by_errors - v) + fraction * missing_w_mps * column[row::RATE]
        };
        let keep = keep_factors(table, dt_s);
        let advance = |column: &State, v_w_mps: Vector2<f64>| {
            let mut next = column.component_mul(&keep);
            (next[row::V_X], next[row::V_Y]) = (v_w_mps.x, v_w_mps.y);
            next[row::X] += dt_s * (v_w_mps.x + next[row::D_X]);
            next[row::Y] += dt_s * (v_w_mps.y + next[row::D_Y]);
            next
        };
        self.s = advance(&self.s, v_w_mps + free * missing_w_mps);
        // F (F P)' is F P F', since P is symmetric.
        for _ in 0..2 {
            for mut column in self.covariance.column_iter_mut() {
                let before = column.clone_owned();
                column.copy_from(&advance(&before, drive(&before)));
            }
            self.covariance.transpose_mut();
        }
        let sd = stationary_sd(table);
        for i in row::WANDERING {
            self.covariance[(i, i)] += (1.0 - keep[i] * keep[i]) * sd[i] * sd[i];
        }
    }

    /// What is known of the error of the dead time.
    pub(super) fn dead_time_error(&self) -> DeadTimeError {
        let at = row::DEAD_TIME;
        DeadTimeError::of(self.s[at], self.covariance[(at, at)])
    }

    /// Starts again from `coarse` if the dead times of the two differ by more than its standard deviation.
    ///
    /// A filter that trusts positions takes the first motion of a vehicle with a much shorter dead time for a
    /// disturbance, and is soon sure of a wrong one.
    pub(super) fn keep_to(&mut self, coarse: &Self) {
        let right = coarse.dead_time_error();
        if (self.dead_time_error().mean_s - right.mean_s).abs() > right.sd_s {
            self.clone_from(coarse);
        }
    }

    /// The assumed dead time is longer by `longer_s`: its error is as much smaller.
    pub(super) fn correct_dead_time(&mut self, longer_s: f64) {
        self.s[row::DEAD_TIME] -= longer_s;
    }

    /// Correction step with the present rows of a pose; returns their log likelihood up to a constant.
    pub(super) fn correct(
        &mut self,
        table: &LinkTable,
        observed: &Observed<{ pose::COUNT }>,
    ) -> f64 {
        let mut log_likelihood = 0.0;
        for (row, seen) in [(row::X, pose::X), (row::Y, pose::Y)] {
            if !observed.is_present[seen] {
                continue;
            }
            let by_row = self.covariance.column(row).clone_owned();
            let variance = by_row[row] + table.sd_position_m * table.sd_position_m;
            let error = observed.o[seen] - self.s[row];
            let (by_sample, weight) = likelihood::huber(error, variance);
            log_likelihood += by_sample;
            self.s += by_row * (weight * error / variance);
            self.covariance -= by_row * by_row.transpose() * (weight / variance);
        }
        log_likelihood
    }
}

/// Standard deviations of what wanders, when nothing is observed.
fn stationary_sd(table: &LinkTable) -> State {
    let mut sd = State::zeros();
    (sd[row::D_X], sd[row::D_Y]) = (table.sd_disturbance_mps, table.sd_disturbance_mps);
    sd[row::GAIN] = table.sd_gain;
    sd[row::HEADING] = table.sd_heading_rad;
    sd[row::DEAD_TIME] = table.sd_dead_time_s;
    sd[row::RATE] = table.sd_rate;
    sd
}

/// What is left of each row after a period by itself.
fn keep_factors(table: &LinkTable, dt_s: f64) -> State {
    let mut keep = State::repeat(decay(dt_s, table.adapt_s));
    keep[row::DEAD_TIME] = decay(dt_s, table.dead_time_adapt_s.unwrap_or(table.adapt_s));
    (keep[row::X], keep[row::Y], keep[row::V_X], keep[row::V_Y]) = (1.0, 1.0, 1.0, 1.0);
    let kept = decay(dt_s, table.decay_s);
    (keep[row::D_X], keep[row::D_Y]) = (kept, kept);
    keep
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use horizon_model::check::amax;
    use horizon_model::differences;

    use super::super::tests::{parameter, table};
    use super::*;

    const DT_S: f64 = 0.02;

    /// Largest gap of the covariance after a period to that by differences of the mean, and of the velocity's
    /// derivative by the dead time.
    fn gap(start: &Horizontal, command: &HorizontalCommand) -> (f64, f64) {
        let (table, p) = (table(), parameter());
        let predicted = |s: &State| {
            let mut filter = Horizontal { s: *s, ..start.clone() };
            filter.predict(&table, command, &p, DT_S);
            filter
        };
        let by_state = differences::jacobian(|s| predicted(s).s, &start.s);
        let (keep, sd) = (keep_factors(&table, DT_S), stationary_sd(&table));
        let noise =
            (State::repeat(1.0) - keep.component_mul(&keep)).component_mul(&sd).component_mul(&sd);
        let expected =
            by_state * start.covariance * by_state.transpose() + SMatrix::from_diagonal(&noise);
        let by_dead_time =
            by_state[(row::V_X, row::DEAD_TIME)].hypot(by_state[(row::V_Y, row::DEAD_TIME)]);
        (amax(&(predicted(&start.s).covariance - expected)), by_dead_time)
    }

    #[test]
    fn the_covariance_is_propagated_by_the_jacobian_of_the_mean() {
        let mut start = Horizontal::new(&table(), Vector2::zeros());
        let root = SMatrix::<f64, { row::COUNT }, { row::COUNT }>::from_fn(|i, j| {
            (0.7 * i as f64 + 1.3 * j as f64).sin()
        });
        start.covariance = root * root.transpose();
        // No row is zero; errors of the heading to both sides of its wrap.
        let states = [
            [0.4, -0.7, 0.15, -0.05, 0.03, 0.02, 0.1, -0.2, 0.04, 0.15],
            [-3.0, 2.0, -0.2, 0.3, -0.1, 0.1, -0.3, PI - 1e-9, -0.1, -0.4],
            [1.0, 1.0, 0.05, 0.1, 0.2, -0.2, 0.1, -PI + 1e-9, 0.05, -0.4],
        ];
        for (s, direction_rad) in
            states.iter().flat_map(|s| [0.0, 2.0, PI - 1e-9, PI + 1e-9, -1.2].map(|rad| (s, rad)))
        {
            let direction_w = Vector2::new(f64::cos(direction_rad), f64::sin(direction_rad));
            let command = HorizontalCommand {
                commanded_w_mps: 0.22 * direction_w,
                rate_w_mps2: Vector2::new(0.5 * direction_w.y, 0.3 - direction_w.x),
            };
            start.s = State::from(*s);
            // The acceleration stays below its limit, which the filter takes for a known factor.
            let (gap, by_dead_time) = gap(&start, &command);
            assert!(gap < 1e-8, "gap {gap:e} at {s:?}, {direction_rad} rad");
            assert!(by_dead_time > 1e-3, "{by_dead_time}");
        }
    }

    #[test]
    fn each_error_moves_the_mean_to_its_side() {
        let (table, p) = (table(), parameter());
        // From rest; what is asked for grows.
        let command = HorizontalCommand {
            commanded_w_mps: Vector2::new(0.4, 0.0),
            rate_w_mps2: Vector2::new(2.0, 0.0),
        };
        let predicted = |row: usize, error: f64| {
            let mut filter = Horizontal::new(&table, Vector2::zeros());
            filter.s[row] = error;
            filter.predict(&table, &command, &p, DT_S);
            filter.s
        };
        let right = predicted(row::GAIN, 0.0);
        let change = |row, error| predicted(row, error) - right;
        assert!(change(row::GAIN, 0.1)[row::V_X] > 1e-4, "more gain is faster");
        assert!(change(row::RATE, 0.1)[row::V_X] > 1e-4, "a shorter lag is faster");
        assert!(change(row::DEAD_TIME, 0.1)[row::V_X] < -1e-4, "later is slower while it grows");
        let turned = change(row::HEADING, 0.1);
        assert!(turned[row::V_Y] > 1e-4, "counter-clockwise: {turned}");
        for (d, x) in [(row::D_X, row::X), (row::D_Y, row::Y)] {
            let drift_m = change(d, 0.2)[x];
            let expected_m = DT_S * 0.2 * (-DT_S / table.decay_s).exp();
            assert!((drift_m - expected_m).abs() < 1e-12, "{drift_m}");
        }
        let sideways = HorizontalCommand { commanded_w_mps: Vector2::new(0.0, 0.4), ..command };
        let mut filter = Horizontal::new(&table, Vector2::zeros());
        filter.s[row::HEADING] = 0.1;
        filter.predict(&table, &sideways, &p, DT_S);
        assert!(filter.s[row::V_X] < -1e-4, "counter-clockwise: {filter:?}");
    }

    #[test]
    fn a_longer_assumed_dead_time_leaves_a_smaller_error() {
        let mut filter = Horizontal::new(&table(), Vector2::zeros());
        filter.s[row::DEAD_TIME] = 0.03;
        filter.correct_dead_time(0.02);
        assert!((filter.dead_time_error().mean_s - 0.01).abs() < 1e-12);
    }

    #[test]
    fn a_finer_dead_time_is_kept_within_the_standard_deviation_of_the_coarse_one() {
        let coarse = Horizontal::new(&table(), Vector2::zeros());
        let mut fine = coarse.clone();
        fine.s[row::DEAD_TIME] = -0.9 * table().sd_dead_time_s;
        let kept = fine.clone();
        fine.keep_to(&coarse);
        assert_eq!(fine, kept);
        fine.s[row::DEAD_TIME] = -1.1 * table().sd_dead_time_s;
        fine.keep_to(&coarse);
        assert_eq!(fine, coarse);
    }
}
