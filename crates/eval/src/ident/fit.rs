//! One model fitted to logs: pieces, estimate, dead times, uncertainty.
//!
//! Owns the order of the steps. What each of them computes is `horizon-estim`; here models become rows
//! of names and numbers.

use std::borrow::Cow;

use anyhow::{Context, Result};
use horizon_estim::{
    DelayInfluence, DelayProfile, DelaySettings, Flights, Ident, LmStop, SolveReport, Span, Spread,
    UndecidedDelay,
};
use horizon_model::rows::{pose, stick};
use horizon_model::setting::{SettingError, in_range, vector};
use horizon_model::{Lagged, LaggedShape, Model};
use nalgebra::SVector;
use tello_flight::cycle::{ModelKind, WithModel};
use tello_io::clock::Clock;

use super::acceptance;
use super::flights::{Flight, cut_logs, prepare};
use super::job::{DelayResult, FitResult, Job, Trace};
use super::predict::{Identified, residual_decay_s};
use super::report::{Bootstrap, DelayRow, FitReport};
use super::warnings::{IdentFindings, autocorrelation, is_resampled, scatter};
use crate::Stopped;
use crate::parameter_file::ParameterFile;

mod bootstrap;
mod contradiction;
mod traces;
mod uncertainty;

pub(super) use contradiction::Contradiction;

/// Fits the model that the settings name.
///
/// # Errors
/// A setting breaks its rule, no piece is left, or the problem is not finite.
pub fn fit(job: &Job<'_>) -> Result<FitResult> {
    let lagged = || Identification::new(Lagged::new(sharp())?, job)?.run();
    let result = match job.table.model {
        ModelKind::Lagged => lagged(),
        model => model.with(FitVisitor(job)),
    };
    result.with_context(|| format!("in the fit of {}", job.name))
}

/// Fits the model that it is given.
struct FitVisitor<'a>(&'a Job<'a>);

impl WithModel for FitVisitor<'_> {
    type Output = Result<FitResult>;

    fn run<M, const NS: usize, const NP: usize, const NR: usize>(self, model: M) -> Self::Output
    where
        M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP> + Send + Sync + 'static,
    {
        Identification::new(model, self.0)?.run()
    }
}

/// The lagged model with sharper corners of the dead zones than a solver in flight needs: with those of the flight the
/// intervals of simulated flights are too narrow (`docs/benchmarks/2026-11-24-learning/README.md`).
fn sharp() -> LaggedShape {
    LaggedShape { dead_width: 0.002, ..LaggedShape::default() }
}

type Inputs = SVector<f64, { stick::COUNT }>;

struct Identification<'a, M, const NS: usize, const NP: usize> {
    job: &'a Job<'a>,
    model: M,
    ident: Ident<M, NS, { stick::COUNT }, { pose::COUNT }, NP>,
    dead_time_s: Inputs,
    recordings: Vec<Cow<'a, Flight>>,
    spans: Vec<Span>,
    /// Effect of errors of the searched dead times on the parameter.
    influences: Vec<DelayInfluence<NP>>,
    /// Effect of dead times that the search left open.
    undecided: Vec<UndecidedDelay<NP>>,
    /// Steps with lost commands, by log.
    steps_lost: Vec<usize>,
    /// Standard deviations of the prior. Units of the rows
    prior_std: Vec<f64>,
    /// Lower and upper bounds of the parameter. Units of the rows
    bounds: [Vec<f64>; 2],
}

impl<'a, M, const NS: usize, const NP: usize> Identification<'a, M, NS, NP>
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
        let lost = |is_lost: &Vec<bool>| is_lost.iter().filter(|is_lost| **is_lost).count();
        let steps_lost = is_lost.iter().map(lost).collect();
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
            influences: Vec::new(),
            undecided: Vec::new(),
            steps_lost,
            prior_std,
            bounds,
        })
    }

    fn run(mut self) -> Result<FitResult> {
        let clock = Clock::start();
        let mut solved = self.solve()?;
        let delay = self.search_dead_time()?;
        if !delay.is_empty() {
            let iterations = solved.iterations;
            solved = self.solve()?;
            solved.iterations += iterations;
        }
        let solve_seconds = clock.now().seconds();
        let (resamples, bootstrap) = match self.job.bootstrap {
            Some(plan) => self.bootstrap(plan).map(|(found, report)| (Some(found), report))?,
            None => (None, None),
        };
        let mut fit = self.assemble_fit(&solved, solve_seconds, &delay, bootstrap);
        let traces = self.traces();
        let has_converged = !matches!(solved.stop, LmStop::IterationLimit | LmStop::DampingLimit);
        Ok(FitResult {
            parameter_file: self.judge(&mut fit, &traces, has_converged)?,
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

    /// The report of the estimate, without verdict.
    fn assemble_fit(
        &self,
        solved: &SolveReport,
        solve_seconds: f64,
        delay: &[DelayResult],
        bootstrap: Option<(Bootstrap, Spread<NP>)>,
    ) -> FitReport {
        let (bootstrap, spread) = bootstrap.unzip();
        let decides = |found: &Bootstrap| is_resampled(found.distinct, self.spans.len(), NP);
        let is_resampled = bootstrap.as_ref().is_some_and(decides);
        let (parameters, covariance) = self.parameter_rows(spread.filter(|_| is_resampled));
        FitReport {
            settings: self.job.name.to_owned(),
            model: M::NAME,
            p: parameters.iter().map(|row| row.value).collect(),
            std: parameters.iter().map(|row| row.std).collect(),
            covariance,
            verdict: Vec::new(),
            parameters,
            dead_time_s: self.dead_time_s.iter().copied().collect(),
            delay: delay.iter().map(|curve| curve.row.clone()).collect(),
            cost: solved.cost,
            iterations: solved.iterations,
            stop: solved.stop.name(),
            solve_seconds,
            pieces: self.spans.len(),
            steps: self.spans.iter().map(|span| span.steps.len()).sum(),
            steps_lost: self.steps_lost.iter().sum(),
            bootstrap,
            is_resampled,
            refused: None,
        }
    }

    /// Fills in the verdict on `fit`, and why a flight would refuse the parameters. Returns the parameter file that a
    /// flight accepts.
    fn judge(
        &self,
        fit: &mut FitReport,
        traces: &[Trace],
        has_converged: bool,
    ) -> Result<Option<ParameterFile>> {
        let (rms, prior_std) = (self.input_rms(), &self.prior_std);
        let (values, moved) =
            acceptance::accepted_values(self.job, &fit.parameters, &rms, prior_std);
        let contradictions = self.contradictions()?;
        let file = acceptance::parameter_file(self.job, fit, &values)?;
        let accepted = acceptance::accept(self.job, fit, &contradictions, &file);
        fit.refused = accepted.err().map(|error| format!("{error:#}"));
        fit.verdict = self.evidence(fit, traces, has_converged, &contradictions).sentences();
        match &fit.refused {
            // Of a file that is not written there is nothing to report, and a reason is printed once.
            Some(why) => fit.verdict.retain(|sentence| !why.contains(sentence)),
            None => fit.verdict.extend(moved),
        }
        Ok(fit.refused.is_none().then_some(file))
    }

    /// The facts for the verdict on `fit`.
    fn evidence<'f>(
        &self,
        fit: &'f FitReport,
        traces: &[Trace],
        has_converged: bool,
        contradictions: &'f [Contradiction],
    ) -> IdentFindings<'f> {
        IdentFindings {
            delay: &fit.delay,
            parameters: &fit.parameters,
            prior_std: self.prior_std.clone(),
            inputs: &M::INPUT,
            input_rms: self.input_rms(),
            observations: &M::OBSERVATION,
            autocorrelation: autocorrelation(traces, self.job.table.dt_s),
            scatter: scatter(traces),
            has_converged,
            pieces: fit.pieces,
            resamples_distinct: fit.bootstrap.as_ref().map(|bootstrap| bootstrap.distinct),
            simulated_and_real: [true, false].map(|is_simulated| {
                self.job.logs.iter().filter(|log| log.is_simulated == is_simulated).count()
            }),
            mostly_lost: self.mostly_lost(),
            contradictions,
        }
    }

    /// Minimizes; Ctrl-C ends the program, since half a minimum is none.
    fn solve(&mut self) -> Result<SolveReport> {
        let observer = self.job.observer;
        observer.begin(&format!("{} on {} pieces", M::NAME, self.spans.len()), None);
        let report = self.ident.solve(&mut || {
            observer.advance();
            observer.is_stopped()
        })?;
        observer.end();
        if report.stop == LmStop::Late {
            return Err(Stopped("the estimate was found").into());
        }
        Ok(report)
    }

    /// Dead times by their likelihood, if the settings ask for it; the estimate moves to them.
    fn search_dead_time(&mut self) -> Result<Vec<DelayResult>> {
        let Some(table) = &self.job.table.delay else { return Ok(Vec::new()) };
        let settings = DelaySettings::try_from(table);
        let settings = settings.map_err(|error: SettingError| error.under("delay"))?;
        let Self { job, ident, recordings, spans, dead_time_s, .. } = self;
        let flights = Flights { recordings, spans, dt_s: job.table.dt_s };
        job.observer.begin(&format!("dead times of {}", M::NAME), None);
        let groups: Vec<Vec<usize>> = job
            .table
            .dead_time_groups
            .iter()
            .map(|group| group.iter().map(|stick| stick.row()).collect())
            .collect();
        let rows: Vec<&[usize]> = groups.iter().map(Vec::as_slice).collect();
        let profiles = flights.search(ident, &rows, dead_time_s, &settings, &mut || {
            job.observer.advance();
            job.observer.is_stopped()
        })?;
        job.observer.end();
        let Some(profiles) = profiles else {
            return Err(Stopped("the dead times were found").into());
        };
        self.influences = profiles.iter().filter_map(|profile| profile.influence.clone()).collect();
        self.undecided = profiles.iter().filter_map(|profile| profile.undecided).collect();
        let curve = |profile: DelayProfile<NP>| {
            let sticks: Vec<&str> = profile.rows.iter().map(|row| M::INPUT[*row].name).collect();
            let DelayProfile { curve, spread, .. } = profile;
            let (dead_time_s, cost) = curve.iter().map(|at| (at.dead_time_s, at.cost)).unzip();
            let row = DelayRow {
                sticks: sticks.join(", "),
                dead_time_s: profile.dead_time_s,
                verdict: profile.verdict.into(),
                std_s: spread.map(|spread| spread.std_s),
                lower_s: spread.map(|spread| spread.lower_s),
                upper_s: spread.map(|spread| spread.upper_s),
            };
            DelayResult { row, dead_time_s, cost }
        };
        Ok(profiles.into_iter().map(curve).collect())
    }

    /// Logs more than half of which was left out because commands were lost.
    fn mostly_lost(&self) -> Vec<String> {
        let logs = self.job.logs.iter().zip(&self.recordings).zip(&self.steps_lost);
        let is_mostly = |steps: usize, lost: usize| 2 * lost > steps;
        let most = logs.filter(|((_, flight), lost)| is_mostly(flight.o.len(), **lost));
        most.map(|((log, _), _)| log.path.display().to_string()).collect()
    }

    /// Root mean square of each applied input over the pieces.
    fn input_rms(&self) -> Vec<f64> {
        let used = self.spans.iter().flat_map(|Span { recording, steps }| {
            let flight = &self.recordings[*recording];
            flight.applied_during(steps.clone(), &self.dead_time_s, self.job.table.dt_s)
        });
        let square = used.fold(Inputs::zeros(), |sum, u| sum + u.component_mul(&u));
        let steps = self.spans.iter().map(|span| span.steps.len()).sum::<usize>().max(1) as f64;
        square.iter().map(|square| (square / steps).sqrt()).collect()
    }
}

#[cfg(test)]
mod tests;
