//! Multi-step prediction errors of recorded flights.
//!
//! Owns the prediction horizons, the judged moments and the table. The predictors are in `recording.rs`.

use std::fmt::{self, Display, Formatter};

use horizon_estim::Observed;
use horizon_model::rows::{Pose, pose};
use schemars::JsonSchema;
use serde::Serialize;

use crate::forecast::{ErrorSummary, ForecastErrors, HorizonErrors};
use crate::recordings::PERIOD_S;
use crate::smooth::MotionTrack;

/// Prediction horizons. steps of [`PERIOD_S`]
pub(super) const AHEAD_STEPS: [usize; 3] = [10, 30, 50];

/// Filtered height above which the vehicle flies. m
pub(super) const AIRBORNE_M: f64 = 0.3;

/// The poses [`AHEAD_STEPS`] after a step, as predicted there; `None`: no prediction.
pub(super) type Forecast = [Option<Pose>; AHEAD_STEPS.len()];

/// Errors of one rule's forecasts at [`AHEAD_STEPS`]; NaN (in JSON null) without a forecast.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct ForecastRow {
    /// Name of the predictor.
    by: String,
    /// Number of forecasts.
    count: [usize; 3],
    /// Distance in x and y, root mean square. m
    xy_rmse_m: [f64; 3],
    /// Its median. m
    xy_median_m: [f64; 3],
    /// Error of z, root mean square. m
    z_rmse_m: [f64; 3],
    /// Its median. m
    z_median_m: [f64; 3],
    /// Error of theta, root mean square. rad
    theta_rmse_rad: [f64; 3],
    /// Its median. rad
    theta_median_rad: [f64; 3],
}

/// Prediction horizons. s
pub(super) fn ahead_s() -> [f64; 3] {
    AHEAD_STEPS.map(|steps| steps as f64 * PERIOD_S)
}

/// No errors yet.
pub(super) fn no_errors() -> ForecastErrors {
    ForecastErrors::new(AHEAD_STEPS.into_iter().max().unwrap_or(0))
}

/// Errors of several rules, of which each predicted `forecasts[rule][step]`, at the moments that all of them
/// predicted and of which the complete pose in `o` is accepted and flies.
pub(super) fn judge(
    forecasts: &[Vec<Forecast>],
    o: &[Observed<{ pose::COUNT }>],
) -> Vec<ForecastErrors> {
    let mut errors = vec![no_errors(); forecasts.len()];
    for step in 0..o.len() {
        for (index, steps) in AHEAD_STEPS.into_iter().enumerate() {
            let Some(came) = o.get(step + steps) else { continue };
            let is_judged = came.is_present == [true; pose::COUNT] && came.o[pose::Z] > AIRBORNE_M;
            let poses: Option<Vec<Pose>> = forecasts
                .iter()
                .map(|rule| rule.get(step).and_then(|ahead| ahead[index]))
                .collect();
            if let (true, Some(poses)) = (is_judged, poses) {
                for (errors, pose) in errors.iter_mut().zip(poses) {
                    errors.push(steps - 1, &(pose - came.o));
                }
            }
        }
    }
    errors
}

/// Where each step leads with the velocity of `track`.
pub(super) fn constant_velocity(track: &MotionTrack) -> Vec<Forecast> {
    let states = track.pose.iter().zip(&track.velocity);
    states
        .map(|(pose, velocity)| ahead_s().map(|ahead_s| Some(pose + ahead_s * velocity)))
        .collect()
}

impl ForecastRow {
    /// The summary of `errors`, which `by` made.
    pub(super) fn new(by: &str, errors: &ForecastErrors) -> Self {
        const NONE: ErrorSummary = ErrorSummary { rmse: f64::NAN, median: f64::NAN, count: 0 };
        let at = |pick: fn(&HorizonErrors) -> ErrorSummary| {
            AHEAD_STEPS.map(|steps| errors.at(steps).map_or(NONE, |errors| pick(&errors)))
        };
        let xy = at(|errors| errors.horizontal);
        let z = at(|errors| errors.vertical);
        let theta = at(|errors| errors.heading);
        let rmse = |summary: [ErrorSummary; 3]| summary.map(|summary| summary.rmse);
        let median = |summary: [ErrorSummary; 3]| summary.map(|summary| summary.median);
        Self {
            by: by.to_owned(),
            count: xy.map(|summary| summary.count),
            xy_rmse_m: rmse(xy),
            xy_median_m: median(xy),
            z_rmse_m: rmse(z),
            z_median_m: median(z),
            theta_rmse_rad: rmse(theta),
            theta_median_rad: median(theta),
        }
    }

    /// Whether there is no forecast at any horizon.
    pub(super) fn is_empty(&self) -> bool {
        self.count.iter().all(|count| *count == 0)
    }
}

/// The table: rows with the name of their flight.
pub(super) struct Table<'a>(pub(super) Vec<(&'a str, &'a ForecastRow)>);

impl Display for Table<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self(rows) = self;
        let width = |text: fn(&(&str, &ForecastRow)) -> usize, least| {
            rows.iter().map(text).fold(least, usize::max)
        };
        let name_width = width(|(name, _)| name.len(), "flight".len());
        let by_width = width(|(_, row)| row.by.len(), "predicted by".len());
        writeln!(f, "error of the predicted pose, RMSE/median; all figures in the JSON")?;
        write!(f, "{:name_width$}  {:by_width$}  {:>6}", "flight", "predicted by", "count")?;
        for ahead_s in ahead_s() {
            write!(f, "  {:>11}", format!("x-y {ahead_s:.1} s"))?;
        }
        let [.., last_s] = ahead_s();
        for row in ["z", "theta"] {
            write!(f, "  {:>11}", format!("{row} {last_s:.1} s"))?;
        }
        writeln!(f)?;
        for (name, row) in rows {
            let [.., count] = row.count;
            write!(f, "{name:name_width$}  {:by_width$}  {count:6}", row.by)?;
            for (rmse, median) in row.xy_rmse_m.iter().zip(&row.xy_median_m) {
                write!(f, "  {rmse:.3}/{median:.3}")?;
            }
            let ([.., z], [.., z_median]) = (row.z_rmse_m, row.z_median_m);
            let ([.., theta], [.., theta_median]) = (row.theta_rmse_rad, row.theta_median_rad);
            writeln!(f, "  {z:.3}/{z_median:.3}  {theta:.3}/{theta_median:.3}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A flight of 60 steps at 1 m that moves by 1 cm per step along x.
    fn seen() -> Vec<Observed<{ pose::COUNT }>> {
        (0..60).map(|k| Observed::full(Pose::new(0.01 * f64::from(k), 0.0, 1.0, 0.0))).collect()
    }

    fn count(errors: &ForecastErrors) -> [usize; 3] {
        ForecastRow::new("test", errors).count
    }

    #[test]
    fn an_error_is_that_of_the_pose_so_many_steps_later() {
        let o = seen();
        let stay: Vec<Forecast> = o.iter().map(|o| [Some(o.o); 3]).collect();
        let [errors] = judge(&[stay], &o).try_into().unwrap();
        let row = ForecastRow::new("stay", &errors);
        for (rmse_m, ahead_m) in row.xy_rmse_m.into_iter().zip([0.1, 0.3, 0.5]) {
            assert!((rmse_m - ahead_m).abs() < 1e-12, "{rmse_m} instead of {ahead_m}");
        }
        assert_eq!(row.count, [50, 30, 10]);
    }

    #[test]
    fn every_rule_is_judged_at_the_same_moments() {
        let mut o = seen();
        o[20] = Observed::missing();
        o[21].is_present[pose::THETA] = false;
        o[22].o[pose::Z] = 0.1;
        let all = vec![[Some(Pose::zeros()); 3]; o.len()];
        let mut some = all.clone();
        some[0] = [None; 3];
        let [errors, fewer] = judge(&[all, some], &o).try_into().unwrap();
        // Steps 10 to 12 cannot be judged at 10 steps ahead, step 0 was not predicted by all.
        assert_eq!((count(&errors), count(&fewer)), ([46, 29, 9], [46, 29, 9]));
    }
}
