//! One model fitted to logs: pieces, estimate, dead times, uncertainty.
//!
//! Owns the order of the steps. What each of them computes is `horizon-estim`; here models become rows
//! of names and numbers.

use std::borrow::Cow;
use std::ops::Range;

use anyhow::{Context, Result, bail};
use horizon_estim::{
    DelayProfile, DelaySettings, Flights, Ident, Laplace, SolveReport, Span, Spread, Stop,
};
use horizon_model::rows::{pose, stick};
use horizon_model::setting::{SettingError, in_range, vector};
use horizon_model::{Kinematic, KinematicPublished, Lagged, Model, Row};
use indicatif::{ProgressBar, ProgressStyle};
use nalgebra::{SMatrix, SVector};
use rayon::iter::{IndexedParallelIterator, IntoParallelRefIterator, ParallelIterator};
use sha2::{Digest, Sha256};
use tello_eval::recordings::Loaded;
use tello_flight::cycle::ModelKind;
use tello_io::clock::Clock;

use super::flights::{Flight, cut_logs, prepare};
use super::predict::{Identified, Predict, residual_decay_s};
use super::report::{Bootstrap, DelayRow, Fit, ParameterRow};
use super::resamples::{BootstrapPlan, ResampleFile, ResampleRow};
use super::table::IdentFileTable;
use super::verdict::{Evidence, autocorrelation};
use crate::interrupt::Interrupt;

/// What is to be fitted to what.
pub(super) struct Job<'a> {
    /// Name of the settings.
    pub(super) name: &'a str,
    pub(super) table: &'a IdentFileTable,
    pub(super) logs: &'a [Loaded],
    pub(super) bootstrap: Option<&'a BootstrapPlan>,
    pub(super) interrupt: &'a Interrupt,
    pub(super) shows_progress: bool,
    /// Whether anything is made of the estimates along the pieces.
    pub(super) keeps_estimates: bool,
}

/// A fit with all that figures and files are made of; rows instead of types.
pub(super) struct Fitted {
    pub(super) fit: Fit,
    pub(super) state_rows: &'static [Row],
    pub(super) observation_rows: &'static [Row],
    pub(super) traces: Vec<Trace>,
    pub(super) resamples: Option<ResampleFile>,
    pub(super) delay: Vec<DelayCurve>,
    pub(super) has_converged: bool,
    pub(super) predict: Box<dyn Predict>,
}

/// The estimate along one piece: for each row its values over the steps.
pub(super) struct Trace {
    /// Position of its log.
    pub(super) log: usize,
    /// Steps of the log.
    pub(super) steps: Range<usize>,
    /// States, one value per step; no rows if they are not kept.
    pub(super) s: Vec<Vec<f64>>,
    /// Weighted residuals of the transitions, one value fewer than steps; no rows if they are not kept.
    pub(super) transition_residuals: Vec<Vec<f64>>,
    /// Weighted residuals of the observations, one value per step; NaN where nothing was observed.
    pub(super) observation_residuals: Vec<Vec<f64>>,
}

/// Cost over the dead time of a group of sticks.
pub(super) struct DelayCurve {
    pub(super) row: DelayRow,
    pub(super) dead_time_s: Vec<f64>,
    pub(super) cost: Vec<f64>,
}

/// Fits the model that the settings name.
///
/// # Errors
/// A setting breaks its rule, no piece is left, or the problem is not finite.
pub(super) fn fit(job: &Job<'_>) -> Result<Fitted> {
    match job.table.model {
        ModelKind::Kinematic => Fitter::new(Kinematic, job)?.run(),
        ModelKind::KinematicPublished => Fitter::new(KinematicPublished, job)?.run(),
        ModelKind::Lagged => Fitter::new(Lagged::default(), job)?.run(),
    }
    .with_context(|| format!("in the fit of {}", job.name))
}

/// Pieces per parameter from which their scatter is believed.
const PIECES_PER_PARAMETER: usize = 3;

type Inputs = SVector<f64, { stick::COUNT }>;

struct Fitter<'a, M, const NS: usize, const NP: usize> {
    job: &'a Job<'a>,
    model: M,
    ident: Ident<M, NS, { stick::COUNT }, { pose::COUNT }, NP>,
    dead_time_s: Inputs,
    recordings: Vec<Cow<'a, Flight>>,
    spans: Vec<Span>,
    steps_lost: usize,
    prior_std: Vec<f64>,
    bounds: [Vec<f64>; 2],
}

impl<'a, M, const NS: usize, const NP: usize> Fitter<'a, M, NS, NP>
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP> + Send + Sync + 'static,
{
    fn new(model: M, job: &'a Job<'a>) -> Result<Self> {
        let table = job.table;
        let settings = table.map.check::<M, NS, { stick::COUNT }, { pose::COUNT }, NP>();
        let settings = settings.map_err(|error: SettingError| error.under("map"))?;
        let dead_time_s = vector("dead_time_s", &table.dead_time_s, &M::INPUT, |key, value| {
            in_range(key, value, 0.0..=2.0)
        })?;
        let (recordings, is_lost) = prepare(job, &dead_time_s)?;
        let spans = cut_logs(&recordings, &is_lost, table.piece_steps_min)?;
        let steps_lost = is_lost.iter().flatten().filter(|is_lost| **is_lost).count();
        let flights = Flights { recordings: &recordings, spans: &spans, dt_s: table.dt_s };
        let ident = Ident::new(model, &settings, table.dt_s, flights.pieces(&dead_time_s))?;
        let prior_std = table.map.c_p.iter().map(|weight| 1.0 / weight).collect();
        let bounds = [table.map.p_lb.clone(), table.map.p_ub.clone()];
        Ok(Self {
            job,
            model,
            ident,
            dead_time_s,
            recordings,
            spans,
            steps_lost,
            prior_std,
            bounds,
        })
    }

    fn run(mut self) -> Result<Fitted> {
        let clock = Clock::start();
        let mut report = self.solve()?;
        let delay = self.search_dead_time()?;
        if !delay.is_empty() {
            let iterations = report.iterations;
            report = self.solve()?;
            report.iterations += iterations;
        }
        let solve_seconds = clock.now().seconds();
        let laplace = self.laplace();
        let (resamples, bootstrap) = match self.job.bootstrap {
            Some(plan) => self.bootstrap(plan).map(|(file, report)| (Some(file), report))?,
            None => (None, None),
        };
        let (bootstrap, spread) = bootstrap.unzip();
        let parameters = self.parameter_rows(spread.as_ref().unwrap_or(&laplace), &laplace);
        let traces = self.traces();
        let has_converged = !matches!(report.stop, Stop::IterationLimit | Stop::DampingLimit);
        let delay_rows: Vec<DelayRow> = delay.iter().map(|curve| curve.row.clone()).collect();
        let evidence = Evidence {
            delay: &delay_rows,
            parameters: &parameters,
            prior_std: self.prior_std.clone(),
            inputs: &M::INPUT,
            input_rms: self.input_rms(),
            observations: &M::OBSERVATION,
            autocorrelation: autocorrelation(&traces, self.job.table.dt_s),
            has_converged,
        };
        let verdict = evidence.sentences();
        let fit = Fit {
            settings: self.job.name.to_owned(),
            model: M::NAME,
            p: self.ident.parameter().iter().copied().collect(),
            std: parameters.iter().map(|row| row.std).collect(),
            verdict,
            parameters,
            dead_time_s: self.dead_time_s.iter().copied().collect(),
            delay: delay_rows,
            cost: report.cost,
            iterations: report.iterations,
            stop: report.stop.name(),
            solve_seconds,
            pieces: self.spans.len(),
            steps: self.spans.iter().map(|span| span.steps.len()).sum(),
            steps_lost: self.steps_lost,
            bootstrap,
        };
        Ok(Fitted {
            fit,
            state_rows: &M::STATE,
            observation_rows: &M::OBSERVATION,
            traces,
            resamples,
            delay,
            has_converged,
            predict: Box::new(Identified::<M, NS, NP> {
                model: self.model,
                p: *self.ident.parameter(),
                dead_time_s: self.dead_time_s,
                residual_decay_s: residual_decay_s(self.job.table.model),
                dt_s: self.job.table.dt_s,
            }),
        })
    }

    /// Minimizes; Ctrl-C ends the program, since half a minimum is none.
    fn solve(&mut self) -> Result<SolveReport> {
        let spinner = spinner(self.job, format!("{} on {} pieces", M::NAME, self.spans.len()))?;
        let report = self.ident.solve(&mut || {
            spinner.inc(1);
            self.job.interrupt.is_asked()
        })?;
        spinner.finish_and_clear();
        if report.stop == Stop::Late {
            bail!("stopped before the estimate was found");
        }
        Ok(report)
    }

    /// Dead times by their likelihood, if the settings ask for it; the estimate moves to them.
    fn search_dead_time(&mut self) -> Result<Vec<DelayCurve>> {
        let Some(table) = &self.job.table.delay else { return Ok(Vec::new()) };
        let settings = DelaySettings::try_from(table);
        let settings = settings.map_err(|error: SettingError| error.under("delay"))?;
        let Self { job, ident, recordings, spans, dead_time_s, .. } = self;
        let flights = Flights { recordings, spans, dt_s: job.table.dt_s };
        let spinner = spinner(job, format!("dead times of {}", M::NAME))?;
        let groups: Vec<Vec<usize>> = job
            .table
            .dead_time_groups
            .iter()
            .map(|group| group.iter().map(|stick| stick.row()).collect())
            .collect();
        let rows: Vec<&[usize]> = groups.iter().map(Vec::as_slice).collect();
        let profiles = flights.search(ident, &rows, dead_time_s, &settings, &mut || {
            spinner.inc(1);
            job.interrupt.is_asked()
        })?;
        spinner.finish_and_clear();
        let Some(profiles) = profiles else { bail!("stopped before the dead times were found") };
        let curve = |profile: DelayProfile| {
            let sticks: Vec<&str> = profile.rows.iter().map(|row| M::INPUT[*row].name).collect();
            let (dead_time_s, cost) = profile.curve.into_iter().unzip();
            let spread = profile.spread;
            let row = DelayRow {
                sticks: sticks.join(", "),
                dead_time_s: profile.dead_time_s,
                std_s: spread.map(|spread| spread.std_s),
                lower_s: spread.map(|spread| spread.lower_s),
                upper_s: spread.map(|spread| spread.upper_s),
            };
            DelayCurve { row, dead_time_s, cost }
        };
        Ok(profiles.into_iter().map(curve).collect())
    }

    /// The parameter's normal distribution around the estimate; NaN where there is none.
    fn laplace(&self) -> Spread<NP> {
        let laplace = Laplace::of(&self.ident);
        let p = self.ident.parameter();
        // Fewer pieces cannot tell how they vary.
        let is_clustered = self.spans.len() >= PIECES_PER_PARAMETER * NP;
        match laplace {
            Ok(laplace) if is_clustered => laplace.spread(p),
            Ok(laplace) => Spread::normal(p, &laplace.scaled),
            Err(_) => Spread::normal(p, &SMatrix::repeat(f64::NAN)),
        }
    }

    fn parameter_rows(&self, spread: &Spread<NP>, laplace: &Spread<NP>) -> Vec<ParameterRow> {
        let [lower, upper] = &self.bounds;
        let row = |row: usize| {
            let value = self.ident.parameter()[row];
            ParameterRow {
                name: M::PARAMETER[row].name,
                unit: M::PARAMETER[row].unit,
                value,
                std: spread.std[row],
                std_laplace: laplace.std[row],
                lower: spread.lower[row],
                upper: spread.upper[row],
                // A row that is stopped by its bound is equal to it.
                is_at_bound: value <= lower[row] || value >= upper[row],
            }
        };
        (0..NP).map(row).collect()
    }

    /// Estimates of the resamples that are not in files yet, and what all of them say.
    fn bootstrap(
        &self,
        plan: &BootstrapPlan,
    ) -> Result<(ResampleFile, Option<(Bootstrap, Spread<NP>)>)> {
        let clock = Clock::start();
        let names = M::PARAMETER.map(|row| row.name.to_owned()).to_vec();
        let mut file = ResampleFile::gather(self.problem()?, plan.seed, names, &plan.earlier)?;
        let missing = file.missing(plan);
        let bar = if self.job.shows_progress {
            ProgressBar::new(missing.len() as u64)
        } else {
            ProgressBar::hidden()
        };
        bar.set_style(ProgressStyle::with_template(
            "bootstrap {bar:40} {pos}/{len}, {per_sec}, {eta} left",
        )?);
        let interrupt = self.job.interrupt;
        let done = horizon_estim::bootstrap(
            &self.ident,
            plan.seed,
            &missing,
            &|| interrupt.is_asked(),
            &|_| bar.inc(1),
        )?;
        bar.finish_and_clear();
        let rows = done.iter().map(|resample| {
            ResampleRow::new(resample.index, resample.p.as_slice(), resample.cost, resample.stop)
        });
        file.add(rows);
        let asked = || file.resamples.iter().filter(|row| row.index < plan.resamples);
        let estimates: Vec<SVector<f64, NP>> =
            asked().map(|row| SVector::from_column_slice(&row.p)).collect();
        let limits = [Stop::IterationLimit.name(), Stop::DampingLimit.name()];
        let unconverged = asked().filter(|row| limits.contains(&row.stop.as_str())).count();
        let spread = Spread::of(&estimates);
        let report = spread.map(|spread| {
            let correlation = spread.correlation.row_iter();
            let report = Bootstrap {
                resamples: estimates.len(),
                unconverged,
                asked: plan.resamples,
                seed: plan.seed,
                seconds: clock.now().seconds(),
                mean: spread.mean.iter().copied().collect(),
                correlation: correlation.map(|row| row.iter().copied().collect()).collect(),
            };
            (report, spread)
        });
        Ok((file, report))
    }

    /// Hash of everything that a resample's estimate depends on beside its index and seed.
    fn problem(&self) -> Result<String> {
        let logs: Vec<&str> = self.job.logs.iter().map(|log| log.sha256.as_str()).collect();
        let dead_time_s: Vec<f64> = self.dead_time_s.iter().copied().collect();
        let mut table = self.job.table.clone();
        // What does not change an estimate.
        (table.threads, table.logs, table.logs_max) = (0, Vec::new(), 0);
        table.clear_estimates = false;
        let settings = (table, dead_time_s, logs);
        Ok(format!("{:x}", Sha256::digest(serde_json::to_vec(&settings)?)))
    }

    /// Root mean square of each applied input over the pieces.
    fn input_rms(&self) -> Vec<f64> {
        let used = self.spans.iter().flat_map(|Span { recording, steps }| {
            let flight = &self.recordings[*recording];
            flight.applied_during(steps.clone(), &self.dead_time_s, self.job.table.dt_s)
        });
        let square = used.fold(Inputs::zeros(), |sum, u| sum + u.component_mul(&u));
        let steps = self.spans.iter().map(|span| span.steps.len()).sum::<usize>();
        square.iter().map(|square| (square / steps.max(1) as f64).sqrt()).collect()
    }

    fn traces(&self) -> Vec<Trace> {
        let trace = |(piece, span): (usize, &Span)| {
            let observed = &self.recordings[span.recording].o[span.steps.clone()];
            let mut observation_residuals = columns(&self.ident.observation_residuals(piece));
            for (row, residuals) in observation_residuals.iter_mut().enumerate() {
                for (residual, observed) in residuals.iter_mut().zip(observed) {
                    if !observed.is_present[row] {
                        *residual = f64::NAN;
                    }
                }
            }
            let (s, transition_residuals) = if self.job.keeps_estimates {
                let transition_residuals = self.ident.transition_residuals(piece);
                (columns(self.ident.states(piece)), columns(&transition_residuals))
            } else {
                (Vec::new(), Vec::new())
            };
            let steps = span.steps.clone();
            Trace { log: span.recording, steps, s, transition_residuals, observation_residuals }
        };
        self.spans.par_iter().enumerate().map(trace).collect()
    }
}

/// Each row of vectors over time.
fn columns<const N: usize>(vectors: &[SVector<f64, N>]) -> Vec<Vec<f64>> {
    (0..N).map(|row| vectors.iter().map(|vector| vector[row]).collect()).collect()
}

/// Shows that work goes on, iteration by iteration.
fn spinner(job: &Job<'_>, work: String) -> Result<ProgressBar> {
    let spinner =
        if job.shows_progress { ProgressBar::new_spinner() } else { ProgressBar::hidden() };
    spinner.set_style(ProgressStyle::with_template("{msg}, iteration {pos}, {elapsed}")?);
    spinner.set_message(work);
    Ok(spinner)
}
