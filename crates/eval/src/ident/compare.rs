//! Which model predicts best on flights that it was not fitted to.
//!
//! Owns the division of the logs, the runners beside the models (standing still, constant velocity)
//! and the table. What an error is, is [`crate::forecast::prediction_errors`].

use std::fmt::{self, Display, Formatter};

use super::fit::fit;
use super::job::{FitResult, Job};
use super::table::IdentFileTable;
use crate::forecast::{
    ConstantVelocity, Forecast, ForecastErrors, HorizonErrors, StandStill, prediction_errors,
};
use crate::outage::{OutageSettings, lost_commands};
use crate::recordings::Loaded;
use crate::smooth::{MotionTrack, smooth, track};
use anyhow::{Context, Result, bail};
use horizon_estim::Recording;
use horizon_model::rows::{Sticks, pose, stick};
use horizon_model::setting::{SettingError, vector};
use horizon_model::{Kinematic, Model, steps};
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};
use schemars::JsonSchema;
use serde::Serialize;

/// Horizons of the table. s
pub(super) const HORIZONS_S: [f64; 3] = [0.2, 0.6, 1.0];

/// Horizon by which models are ranked, the second of [`HORIZONS_S`].
const RANKED: usize = 1;

/// Prediction errors on logs that were not used for the fit.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Comparison {
    /// Horizons of the errors. s
    pub horizons_s: [f64; 3],
    /// Parts into which the logs were divided; 0 if other logs were judged.
    pub folds: usize,
    /// Fraction of the judged steps in which commands were lost. 1
    pub lost: f64,
    /// Models, the best first.
    pub models: Vec<Ranked>,
}

/// Prediction errors of one model.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Ranked {
    /// Name of the settings, or of the rule that predicts without a model.
    pub name: String,
    /// From the smoothed motion, every sample counts.
    pub smoothed: Errors,
    /// From the smoothed motion, lost commands left out.
    pub smoothed_masked: Errors,
    /// From what was known at the start, every sample counts.
    pub causal: Errors,
    /// From what was known at the start, lost commands left out.
    pub causal_masked: Errors,
}

/// Errors at the horizons of a comparison.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Errors {
    /// Number of predictions at the longest horizon.
    pub count: usize,
    /// Root mean square distance in x and y. m
    pub xy_rmse_m: [f64; 3],
    /// Median distance in x and y. m
    pub xy_median_m: [f64; 3],
    /// Root mean square error of z. m
    pub z_rmse_m: [f64; 3],
    /// Root mean square error of theta. rad
    pub theta_rmse_rad: [f64; 3],
    /// At every step, for figures.
    #[serde(skip)]
    pub curve: Vec<HorizonErrors>,
}

/// A flight that predictions are held against.
pub(super) struct ValidationFlight {
    /// Recorded inputs and poses.
    pub(super) recording: Recording<{ stick::COUNT }, { pose::COUNT }>,
    /// Smoothed motion.
    pub(super) smoothed: MotionTrack,
    /// Motion from past observations alone.
    pub(super) causal: MotionTrack,
    /// Whether the applied commands were lost.
    pub(super) is_lost: Vec<bool>,
}

/// Errors of one rule on flights: both starts, all samples and without lost commands.
#[derive(Debug, Clone)]
pub(super) struct Tally([ForecastErrors; 4]);

impl Tally {
    pub(super) fn new(horizon_steps: usize) -> Self {
        Self(std::array::from_fn(|_| ForecastErrors::new(horizon_steps)))
    }

    /// Adds the errors of `rule`, which is made for each start of a flight.
    pub(super) fn add<F: Forecast>(
        &mut self,
        flight: &ValidationFlight,
        horizon_steps: usize,
        rule: impl Fn(&MotionTrack) -> F,
    ) {
        let none: &[bool] = &[];
        let cases = [
            (&flight.smoothed, none),
            (&flight.smoothed, flight.is_lost.as_slice()),
            (&flight.causal, none),
            (&flight.causal, flight.is_lost.as_slice()),
        ];
        for (errors, (known, is_excluded)) in self.0.iter_mut().zip(cases) {
            let truth = &flight.smoothed;
            errors.extend(&prediction_errors(
                &rule(known),
                known,
                truth,
                is_excluded,
                horizon_steps,
            ));
        }
    }

    fn ranked(&self, name: &str, dt_s: f64) -> Ranked {
        let [smoothed, smoothed_masked, causal, causal_masked] = &self.0;
        let errors = |errors| Errors::of(errors, dt_s);
        Ranked {
            name: name.to_owned(),
            smoothed: errors(smoothed),
            smoothed_masked: errors(smoothed_masked),
            causal: errors(causal),
            causal_masked: errors(causal_masked),
        }
    }
}

impl Errors {
    fn of(errors: &ForecastErrors, dt_s: f64) -> Self {
        let curve = errors.curve();
        let at = |horizon_s: f64, pick: fn(&HorizonErrors) -> f64| {
            errors.at(steps(horizon_s, dt_s)).as_ref().map_or(f64::NAN, pick)
        };
        let each = |pick: fn(&HorizonErrors) -> f64| HORIZONS_S.map(|s| at(s, pick));
        Self {
            count: curve.last().map_or(0, |last| last.horizontal.count),
            xy_rmse_m: each(|errors| errors.horizontal.rmse),
            xy_median_m: each(|errors| errors.horizontal.median),
            z_rmse_m: each(|errors| errors.vertical.rmse),
            theta_rmse_rad: each(|errors| errors.heading.rmse),
            curve,
        }
    }
}

/// Ranks the fits of `jobs` by prediction: on `others` if there are any, by `results` of all logs; else
/// each log is judged by a fit to the other `folds - 1` parts.
///
/// # Errors
/// There are fewer than two logs to divide, or a fit fails.
pub fn compare(
    jobs: &[Job<'_>],
    results: &[FitResult],
    folds: usize,
    others: &[Loaded],
) -> Result<Comparison> {
    let Some(first) = jobs.first() else { bail!("nothing to compare") };
    let (logs, dt_s) = (first.logs, first.table.dt_s);
    let folds = if others.is_empty() { folds.min(logs.len()) } else { 0 };
    if others.is_empty() && folds < 2 {
        bail!("--compare needs two logs: one to fit to and one to judge by (or --judge)");
    }
    let masker = LostCommandMask::new(first.table)?;
    let judged = if others.is_empty() { logs } else { others };
    let flights: Vec<ValidationFlight> = judged.par_iter().map(|log| masker.judged(log)).collect();
    let [.., longest_s] = HORIZONS_S;
    let horizon_steps = steps(longest_s, dt_s);
    let mut models = Vec::new();
    for (job, whole) in jobs.iter().zip(results) {
        let mut tally = Tally::new(horizon_steps);
        if folds == 0 {
            for flight in &flights {
                whole.predict.add_errors_to(flight, &mut tally, horizon_steps);
            }
        }
        for fold in 0..folds {
            let is_judged = |log: usize| log % folds == fold;
            let known: Vec<Loaded> = (0..logs.len())
                .filter(|log| !is_judged(*log))
                .map(|log| logs[log].clone())
                .collect();
            let part = Job { logs: &known, bootstrap: None, keeps_estimates: false, ..*job };
            let result =
                fit(&part).with_context(|| format!("in part {} of --compare", fold + 1))?;
            for (_, flight) in flights.iter().enumerate().filter(|(log, _)| is_judged(*log)) {
                result.predict.add_errors_to(flight, &mut tally, horizon_steps);
            }
        }
        models.push(tally.ranked(job.name, dt_s));
    }
    let (mut still, mut steady) = (Tally::new(horizon_steps), Tally::new(horizon_steps));
    for flight in &flights {
        still.add(flight, horizon_steps, |_| StandStill);
        steady.add(flight, horizon_steps, |_| ConstantVelocity { dt_s });
    }
    models.push(still.ranked("standing still", dt_s));
    models.push(steady.ranked("constant velocity", dt_s));
    let key = |model: &Ranked| model.smoothed.xy_rmse_m[RANKED];
    models.sort_by(|a, b| key(a).total_cmp(&key(b)));
    let steps: usize = flights.iter().map(|flight| flight.is_lost.len()).sum();
    let lost =
        flights.iter().flat_map(|flight| &flight.is_lost).filter(|is_lost| **is_lost).count();
    let lost = lost as f64 / steps.max(1) as f64;
    Ok(Comparison { horizons_s: HORIZONS_S, folds, lost, models })
}

/// Finds the lost commands of the judged flights, with the same eyes whatever model is judged.
struct LostCommandMask {
    settings: OutageSettings,
    dead_time_s: Sticks,
    dt_s: f64,
}

impl LostCommandMask {
    fn new(table: &IdentFileTable) -> Result<Self> {
        let built_in = super::settings(None)?;
        let table = if table.lost_commands.is_some() { table } else { &built_in };
        let Some(lost_commands) = &table.lost_commands else {
            bail!("the built-in settings do not state how lost commands are found")
        };
        let under = |error: SettingError| error.under("lost_commands");
        Ok(Self {
            settings: lost_commands.try_into().map_err(under)?,
            dead_time_s: vector("dead_time_s", &table.dead_time_s, &Kinematic::INPUT, |_, s| {
                Ok(s)
            })?,
            dt_s: table.dt_s,
        })
    }

    fn judged(&self, log: &Loaded) -> ValidationFlight {
        let recording = &log.recording;
        let smoothed = smooth(&recording.o, self.dt_s);
        let applied = recording.applied(&self.dead_time_s, self.dt_s);
        let is_lost = lost_commands(&self.settings, &applied, &smoothed, self.dt_s);
        ValidationFlight {
            recording: recording.clone(),
            causal: track(&recording.o, self.dt_s),
            smoothed,
            is_lost,
        }
    }
}

impl Display for Comparison {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let how = match self.folds {
            0 => "on the logs of --judge".to_owned(),
            folds => format!("on logs not fitted to, {folds} parts"),
        };
        let lost = 100.0 * self.lost;
        writeln!(f, "prediction    {how}; commands lost in {lost:.0} % of the steps")?;
        let [near_s, middle_s, far_s] = self.horizons_s;
        let errors = format!("x-y RMSE [m] at {near_s:.1} / {middle_s:.1} / {far_s:.1} s");
        writeln!(
            f,
            "  {errors:<33}   smoothed start      no lost commands    causal start        \
             no lost commands"
        )?;
        for model in &self.models {
            write!(f, "  {:<35}", model.name)?;
            for errors in
                [&model.smoothed, &model.smoothed_masked, &model.causal, &model.causal_masked]
            {
                let [near, middle, far] = errors.xy_rmse_m;
                write!(f, " {near:.3} {middle:.3} {far:.3}  ")?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
