//! Moving horizon estimator, thesis sections 3.1.4 and 4.3.8.
//!
//! Owns the window: how it grows, shifts and is warm started. The problem over the window is
//! `window_problem.rs`, its solution `levenberg.rs`. Which observations are accepted and which inputs were
//! applied is the caller's.

mod builder;

use horizon_model::setting::{SettingError, in_range, positive, vector, weight, weight_or_zero};
use horizon_model::{Matrix, Model, Vector};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::arrival_cost::{ArrivalSettings, ArrivalTable};
use crate::cholesky::Cholesky;
use crate::levenberg::{LmError, LmSettings, LmTable, SolveReport};
use crate::loss::{Loss, LossTable};
use crate::residual::{Observed, Residuals};
use crate::window_problem::{Prior, WindowProblem};
pub use builder::MheBuilder;

/// Moving horizon estimator, as written in a file. Weights multiply residuals: the thesis' appendix D
/// prints their squares.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MheTable {
    /// Length of the window. steps, 2..=200
    pub window_steps: usize,
    /// Weights of the observation residuals, one per observation row. 1 / unit of the row, 0 or 1e-6..=1e6
    #[serde(rename = "C_o")]
    pub c_o: Vec<f64>,
    /// Weights of the transition residuals, which are divided by the period, one per state row.
    /// s / unit of the row, 1e-6..=1e6
    #[serde(rename = "C_s")]
    pub c_s: Vec<f64>,
    /// Weights of the prior on the parameter, one per parameter row. 1 / unit of the row, 0 or 1e-6..=1e6
    #[serde(rename = "C_p")]
    pub c_p: Vec<f64>,
    /// Expected parameter, where estimation starts. Between `p_lb` and `p_ub`. Unit of each row
    pub p_prior: Vec<f64>,
    /// Lower bounds of the parameter. Unit of each row
    pub p_lb: Vec<f64>,
    /// Upper bounds of the parameter, at least `p_lb`. Unit of each row
    pub p_ub: Vec<f64>,
    /// Loss of each observation.
    pub observation_loss: LossTable,
    /// Loss of each transition.
    pub transition_loss: LossTable,
    /// What becomes of a step that leaves the window.
    pub arrival: ArrivalTable,
    /// Whether each solution becomes the prior of the next window. This follows a drift of the
    /// parameter but lets an error walk away (thesis, remark 3.25). Not with a carried arrival, which
    /// remembers by itself.
    pub shift_prior: bool,
    /// Levenberg-Marquardt.
    pub solver: LmTable,
}

/// Checked [`MheTable`] for a model with `NS` states, `NO` observations and `NP` parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MheSettings<const NS: usize, const NO: usize, const NP: usize> {
    window_steps: usize,
    c_o: Vector<NO>,
    c_s: Vector<NS>,
    prior: Prior<NP>,
    observation_loss: Loss,
    transition_loss: Loss,
    arrival: ArrivalSettings<NS>,
    shift_prior: bool,
    solver: LmSettings,
}

impl MheTable {
    /// Length of the window, checked alone. steps
    ///
    /// # Errors
    /// It is not 2 to 200.
    pub fn window_steps(&self) -> Result<usize, SettingError> {
        in_range("window_steps", self.window_steps, 2..=200)
    }

    /// The settings of an estimator of the model `M`.
    ///
    /// # Errors
    /// The first key that breaks its rule.
    pub fn check<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
        &self,
    ) -> Result<MheSettings<NS, NO, NP>, SettingError>
    where
        M: Model<NS, NU, NO, NP>,
    {
        let Self { c_p, p_prior, p_lb, p_ub, .. } = self;
        let prior = Prior::check(&M::PARAMETER, c_p, p_prior, p_lb, p_ub)?;
        let arrival = self.arrival.check::<M, NS, NU, NO, NP>();
        let arrival = arrival.map_err(|error| error.under("carried").under("arrival"))?;
        if let ArrivalSettings::Carried { .. } = arrival {
            // Forgetting leaves nothing but the prior.
            vector("C_p", &self.c_p, &M::PARAMETER, weight)?;
            if self.shift_prior {
                return Err(SettingError::new("shift_prior", true, "false with a carried arrival"));
            }
        }
        Ok(MheSettings {
            window_steps: self.window_steps()?,
            c_o: vector("C_o", &self.c_o, &M::OBSERVATION, weight_or_zero)?,
            c_s: vector("C_s", &self.c_s, &M::STATE, weight)?,
            prior,
            observation_loss: self.observation_loss.check("observation_loss")?,
            transition_loss: self.transition_loss.check("transition_loss")?,
            arrival,
            shift_prior: self.shift_prior,
            solver: LmSettings::try_from(&self.solver).map_err(|error| error.under("solver"))?,
        })
    }
}

/// Why the estimator takes nothing in, or leaves no estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum MheError {
    /// There is no first state yet.
    #[error("the estimator is not started")]
    NotStarted,
    /// An argument is not finite; what it would have changed is unchanged.
    #[error("{what} is not finite at window step {k}")]
    NonFinite {
        /// The argument: `input`, `observation`, `state`, or what the model makes of the state.
        what: &'static str,
        /// Step inside the window, 0 is the oldest.
        k: usize,
    },
    /// The problem over the window is not finite.
    #[error(transparent)]
    Solve(#[from] LmError),
}

/// Estimator of the states of the last `window_steps` steps and of the parameter.
#[derive(Debug, Clone)]
pub struct Mhe<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> {
    problem: WindowProblem<M, NS, NU, NO, NP>,
    settings: MheSettings<NS, NO, NP>,
    is_started: bool,
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> Mhe<M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP>,
{
    /// An estimator that has seen nothing. The only allocations. `dt_s` is the period. s, > 0
    ///
    /// # Errors
    /// `dt_s` is not positive.
    pub fn new(
        model: M,
        settings: MheSettings<NS, NO, NP>,
        dt_s: f64,
    ) -> Result<Self, SettingError> {
        let residuals = Residuals {
            model,
            dt_s: positive("dt_s", dt_s)?,
            c_o: settings.c_o,
            c_s: settings.c_s,
            observation_loss: settings.observation_loss,
            transition_loss: settings.transition_loss,
        };
        let MheSettings { prior, arrival, window_steps, .. } = settings;
        let problem = WindowProblem::new(residuals, prior, arrival, window_steps);
        Ok(Self { problem, settings, is_started: false })
    }

    /// Starts, or starts again, at rest where `o` was observed, with the prior parameter.
    ///
    /// That state is fixed, or held by the weights `C_0` of a carried arrival. Returns `o - g(s)`, what the state
    /// leaves of the observation, in the unit of each row: zero where [`Model::at_rest`] solves it. If a large part is
    /// left, write `at_rest` or use [`Mhe::start_at`].
    ///
    /// Real time: no allocation of ours, one call of [`Model::at_rest`].
    ///
    /// # Errors
    /// As [`Mhe::start_at`], and an `o` that is not finite; the estimator is not started.
    pub fn start(&mut self, o: &Vector<NO>) -> Result<Vector<NO>, MheError> {
        self.is_started = false;
        finite("observation", o)?;
        let s = self.problem.model().at_rest(o);
        self.start_at(&s)?;
        Ok(o - self.problem.model().observe(&s))
    }

    /// Starts at the state `s`, NS rows in the units of [`Model::STATE`]; [`Mhe::start`] finds one from an observation.
    ///
    /// Real time: no allocation, constant cost.
    ///
    /// # Errors
    /// [`MheError::NonFinite`]: the state, its observation or the derivative of that is not finite, as that of a
    /// distance at distance zero; the estimator is not started.
    pub fn start_at(&mut self, s: &Vector<NS>) -> Result<(), MheError> {
        self.is_started = false;
        finite("state", s)?;
        let model = self.problem.model();
        finite("observation of the state", &model.observe(s))?;
        finite("derivative", &model.observe_by_state(s))?;
        self.problem.set_prior(self.settings.prior.p_prior);
        self.problem.start(*s);
        self.is_started = true;
        Ok(())
    }

    /// Forgets the state: [`Mhe::start`] begins anew.
    ///
    /// Real time: no allocation, constant cost.
    pub fn restart(&mut self) {
        self.is_started = false;
    }

    /// Whether there is a first state.
    pub fn is_started(&self) -> bool {
        self.is_started
    }

    /// Moves the window on by one step and estimates.
    ///
    /// `u_applied` was applied during the period that just ended, `observed` was seen at its end; any row of
    /// it may be absent. Angle rows are continuous over time. The window grows until it is full; then
    /// its oldest step drops out: the estimate that follows it becomes the fixed state, or the arrival
    /// cost takes up the information of the step.
    ///
    /// Real time: no allocation; `is_late` is polled once per iteration. A late solve leaves the best
    /// iterate, at worst the model's prediction of one step.
    ///
    /// # Errors
    /// - [`MheError::NotStarted`]: call [`Mhe::start`], and look at what it returns.
    /// - [`MheError::NonFinite`]: the window did not move and the estimator remains usable.
    /// - [`MheError::Solve`]: the window is lost and the estimator no longer started.
    pub fn update(
        &mut self,
        u_applied: &Vector<NU>,
        observed: &Observed<NO>,
        is_late: &mut dyn FnMut() -> bool,
    ) -> Result<SolveReport, MheError> {
        if !self.is_started {
            return Err(MheError::NotStarted);
        }
        let k = self.window().len();
        if !u_applied.iter().all(|row| row.is_finite()) {
            return Err(MheError::NonFinite { what: "input", k: k - 1 });
        }
        if !observed.is_finite() {
            return Err(MheError::NonFinite { what: "observation", k });
        }
        if k > self.settings.window_steps {
            self.problem.pop();
        }
        self.problem.push(u_applied, observed);
        let solved = self.problem.solve(&self.settings.solver, is_late);
        self.is_started = solved.is_ok();
        if self.is_started && self.settings.shift_prior {
            self.problem.set_prior(*self.problem.parameter());
        }
        solved.map_err(MheError::from)
    }

    /// Adds what was seen late: `observed` is of the state `back` steps before the newest. Its present rows replace
    /// those of that state, or of the oldest while the window grows. What is older than a whole window is not used. The
    /// estimates move with the next update.
    ///
    /// Real time: no allocation, constant cost.
    ///
    /// # Errors
    /// [`MheError::NotStarted`], or [`MheError::NonFinite`]; nothing is added.
    pub fn observe_earlier(
        &mut self,
        back: usize,
        observed: &Observed<NO>,
    ) -> Result<(), MheError> {
        if !self.is_started {
            return Err(MheError::NotStarted);
        }
        let k = (self.window().len() - 1).saturating_sub(back);
        if !observed.is_finite() {
            return Err(MheError::NonFinite { what: "observation", k });
        }
        if back <= self.settings.window_steps {
            self.problem.observe(k, observed);
        }
        Ok(())
    }

    /// Replaces the inputs of the newest `steps` steps: those sent did not act after all.
    ///
    /// `u_applied(age)` was applied `age` steps before the newest. Steps that have left the window are not
    /// amended: the arrival cost keeps their information. The estimates move with the next update.
    ///
    /// Real time: no allocation of ours; at most two calls of `u_applied` per step of the window.
    ///
    /// # Errors
    /// [`MheError::NotStarted`], or [`MheError::NonFinite`]; nothing is amended.
    pub fn amend(
        &mut self,
        steps: usize,
        u_applied: impl Fn(usize) -> Vector<NU>,
    ) -> Result<(), MheError> {
        if !self.is_started {
            return Err(MheError::NotStarted);
        }
        let in_window = self.window().len() - 1;
        let steps = steps.min(in_window);
        let is_finite = |age: &usize| u_applied(*age).iter().all(|row| row.is_finite());
        if let Some(age) = (0..steps).find(|age| !is_finite(age)) {
            return Err(MheError::NonFinite { what: "input", k: in_window - 1 - age });
        }
        for age in 0..steps {
            self.problem.amend(in_window - 1 - age, &u_applied(age));
        }
        Ok(())
    }

    /// From now on keeps the parameter where it is (`true`), or estimates it again (`false`).
    ///
    /// Steps that leave the window meanwhile tell of the state only, as if the parameter were known;
    /// what a carried arrival knows of the parameter neither grows nor fades.
    ///
    /// Real time: no allocation, constant cost.
    pub fn hold_parameter(&mut self, is_held: bool) {
        self.problem.hold_parameter(is_held);
    }

    /// The newest state estimate, NS rows in the units of [`Model::STATE`]; the state at rest observed as zero before
    /// the start; not to be used after an error of [`Self::update`] that loses the window, when it may be NaN.
    pub fn s_hat(&self) -> &Vector<NS> {
        self.problem.newest()
    }

    /// The parameter estimate, NP rows in the units of [`Model::PARAMETER`]; the prior before the first update.
    pub fn p_hat(&self) -> &Vector<NP> {
        self.problem.parameter()
    }

    /// Covariance of the parameter by the carried arrival cost, in the units of its weights: what the steps before
    /// the window and the prior know. `None` with a fixed arrival, or where a factorization fails.
    ///
    /// Real time: no allocation, two factorizations.
    pub fn parameter_covariance(&self) -> Option<Matrix<NP, NP>> {
        let root = Cholesky::new(self.problem.information()?).ok()?.forward(Matrix::identity());
        Some(root.transpose() * root)
    }

    /// Covariance of the newest state estimate, the parameter unknown, in the units of the weights: NS x NS. `None`
    /// before the first update, or where a factorization fails.
    ///
    /// Exact without damping and off the bounds of the parameter; after a late solve that of the window before.
    ///
    /// Real time: no allocation, one factorization and two triangular solves per decoupled subsystem.
    pub fn state_covariance(&self) -> Option<Matrix<NS, NS>> {
        self.problem.newest_covariance().ok()
    }

    /// The states of the window, the oldest first and the newest last: at most `window_steps` + 1, in the units of
    /// [`Model::STATE`].
    pub fn window(&self) -> &[Vector<NS>] {
        self.problem.states()
    }
}

/// Checks that every entry of `what`, at the first state, is finite.
fn finite<'a>(
    what: &'static str,
    entries: impl IntoIterator<Item = &'a f64>,
) -> Result<(), MheError> {
    let is_finite = entries.into_iter().all(|entry| entry.is_finite());
    if is_finite { Ok(()) } else { Err(MheError::NonFinite { what, k: 0 }) }
}

#[cfg(test)]
mod tests;
