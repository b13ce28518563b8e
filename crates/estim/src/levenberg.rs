//! Levenberg-Marquardt: the loop of thesis section 3.2.2.
//!
//! Owns damping, acceptance and termination. What is minimized, how it is linearized and how the
//! damped equations are factorized belongs to a [`LeastSquares`]; time enters only as the caller's answer
//! to "is it late?".

use horizon_model::setting::{SettingError, in_range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::cholesky::NotPositive;

/// Settings of a Levenberg-Marquardt solve, as written in a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LmTable {
    /// First damping over the largest diagonal entry of the normal matrix, tau of thesis equation
    /// 3.63: small where the start is trusted. 1, 0..=1
    pub damping_start: f64,
    /// Stop when a step lowers the cost by less than this fraction of it, thesis equation 3.65. 1, 0..=0.1
    pub cost_tolerance: f64,
    /// Stop when a step is shorter than this fraction of the iterate, thesis equation 3.66; both are norms over all
    /// states and the parameter, whatever their units. 1, 0..=0.1
    pub step_tolerance: f64,
    /// Most steps tried, rejected ones included. 1..=1000
    pub iterations_max: u32,
}

/// Checked [`LmTable`]: its fields in its units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LmSettings {
    damping_start: f64,
    cost_tolerance: f64,
    step_tolerance: f64,
    iterations_max: u32,
    /// Whether convergence of a damped step has to be confirmed by an undamped one.
    confirms_undamped: bool,
}

impl TryFrom<&LmTable> for LmSettings {
    type Error = SettingError;

    fn try_from(table: &LmTable) -> Result<Self, SettingError> {
        Ok(Self {
            damping_start: in_range("damping_start", table.damping_start, 0.0..=1.0)?,
            cost_tolerance: in_range("cost_tolerance", table.cost_tolerance, 0.0..=0.1)?,
            step_tolerance: in_range("step_tolerance", table.step_tolerance, 0.0..=0.1)?,
            iterations_max: in_range("iterations_max", table.iterations_max, 1..=1000)?,
            confirms_undamped: true,
        })
    }
}

impl LmSettings {
    /// These settings with a thousandth of the first damping, from a start that is trusted, and another cost tolerance.
    pub(crate) fn near(self, cost_tolerance: f64) -> Self {
        Self { damping_start: 1e-3 * self.damping_start, cost_tolerance, ..self }
    }

    /// Fraction of the cost: a step that lowers the cost by less is the last one. 1
    pub(crate) fn cost_tolerance(self) -> f64 {
        self.cost_tolerance
    }

    /// Settings for a part of a larger problem, whose damping is not in units of the part's diagonal. The damping of
    /// the whole keeps the part near its start, so no end of the part is confirmed without damping.
    pub(crate) fn of_part(damping_start: f64, cost_tolerance: f64, iterations_max: u32) -> Self {
        let (step_tolerance, confirms_undamped) = (0.0, false);
        Self { damping_start, cost_tolerance, step_tolerance, iterations_max, confirms_undamped }
    }
}

/// Why a solve stopped. Every variant leaves the best iterate to use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[must_use]
#[non_exhaustive]
pub enum LmStop {
    /// The last step lowered the cost by less than the tolerance, or no more than that is to be
    /// expected of another.
    CostTolerance,
    /// The next step is shorter than the tolerance.
    StepTolerance,
    /// The limit of iterations was reached.
    IterationLimit,
    /// The caller reported that it is late.
    Late,
    /// No damping gives a step that lowers the cost.
    DampingLimit,
}

impl LmStop {
    /// Name in logs, that of the variant in snake case.
    pub fn name(self) -> &'static str {
        match self {
            Self::CostTolerance => "cost_tolerance",
            Self::StepTolerance => "step_tolerance",
            Self::IterationLimit => "iteration_limit",
            Self::Late => "late",
            Self::DampingLimit => "damping_limit",
        }
    }
}

/// Outcome of a solve: why it stopped, its steps and its costs.
#[derive(Debug, Clone, Copy, PartialEq)]
#[must_use]
pub struct SolveReport {
    /// Why it stopped.
    pub stop: LmStop,
    /// Steps tried, rejected ones included; at most [`LmTable::iterations_max`].
    pub iterations: u32,
    /// Steps tried that did not lower the cost, part of `iterations`.
    pub rejected: u32,
    /// Cost of the start. 1
    pub cost_start: f64,
    /// Cost of the iterate that is left. 1
    pub cost: f64,
}

impl SolveReport {
    /// Whether the iterate is optimal within the tolerances, not only the best before a limit.
    pub fn is_converged(&self) -> bool {
        matches!(self.stop, LmStop::CostTolerance | LmStop::StepTolerance)
    }
}

/// What makes a solve impossible. No iterate is to be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum LmError {
    /// A residual or a derivative at the start is not finite.
    #[error("{block} is not finite at window step {k}")]
    NonFinite {
        /// What is not finite: a residual block as named in `docs/model.md`, or `derivative`.
        block: &'static str,
        /// Step inside the window, 0 is the oldest.
        k: usize,
    },
}

/// Cost of a problem at its current iterate, and the scale of its normal matrix there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct IterateScale {
    /// True cost. 1
    pub(crate) cost: f64,
    /// Largest diagonal entry of the normal matrix. Mixed, by its row
    pub(crate) diagonal_max: f64,
}

/// A damped step away from the current iterate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Step {
    /// How much the quadratic model of the cost expects to gain, without damping. 1, >= 0
    pub(crate) decrease: f64,
    /// Length of the step. Mixed, over all rows
    pub(crate) norm: f64,
    /// Length of the current iterate. Mixed, over all rows
    pub(crate) iterate_norm: f64,
}

/// Least-squares problem with a current iterate and a candidate.
pub(crate) trait LeastSquares {
    /// Lower bound of the decrease that is assumed to remain after an accepted step, as a fraction of the decrease that
    /// the quadratic model predicted for the step. 0 where the next solve continues from this iterate anyway. 1
    const REMAINING_DECREASE_MIN: f64 = 1e-3;

    /// Linearizes at the current iterate.
    ///
    /// # Errors
    /// Something is not finite there.
    fn linearize(&mut self) -> Result<IterateScale, LmError>;

    /// Sets the candidate to the minimum of the damped quadratic model of the last linearization.
    ///
    /// # Errors
    /// The damped matrix is not positive definite.
    fn try_step(&mut self, damping: f64) -> Result<Step, NotPositive>;

    /// True cost of the candidate; may be anything where the candidate is far off.
    fn candidate_cost(&mut self) -> f64;

    /// Makes the candidate the current iterate.
    fn accept(&mut self);
}

/// A step is accepted from this gain ratio on: a measurable fraction of what was expected. 1
const GAIN_ACCEPTED: f64 = 1e-3;

/// Below this gain ratio the model is poor and the damping grows (`eta_2` of the thesis). 1
const GAIN_POOR: f64 = 0.25;

/// Above this gain ratio the model is good and the damping shrinks (`eta_1` of the thesis). 1
const GAIN_GOOD: f64 = 0.75;

/// Damping in units of the largest diagonal entry beyond which no step is worth trying. Such a step is about
/// `-g / damping` and lowers the cost by `|g|^2 / damping`. For `n` unknowns and
/// `H = J' J`, `|g|^2 <= 2 n (max H_ii) cost`, so this is at most `2e-12 n` of the cost. 1
const DAMPING_LIMIT: f64 = 1e12;

/// Factor by which the damping shrinks after a good step. 1
const SHRINK: f64 = 4.0;

/// The damping and its growth.
///
/// The thesis prints the update the wrong way round (a large gain ratio would double the damping): a
/// large ratio means that the model is right and the damping may shrink. With each poor step
/// since the last good one the factor of growth doubles (Madsen, Nielsen, Tingleff 2004, algorithm
/// 3.16), so that a far too small start costs a few steps instead of dozens.
#[derive(Debug, Clone, Copy)]
struct Damping {
    /// `mu`. Unit of the normal matrix, mixed by its rows
    value: f64,
    /// Factor by which the next poor step raises it. 1
    growth: f64,
    /// Largest diagonal entry of the first normal matrix. Unit of the normal matrix, mixed by its rows
    unit: f64,
    /// Whether convergence of a damped step has still to be confirmed by an undamped one.
    has_to_confirm: bool,
}

impl Damping {
    fn new(settings: &LmSettings, unit: f64) -> Self {
        let value = settings.damping_start * unit;
        Self { value, growth: 2.0, unit, has_to_confirm: settings.confirms_undamped }
    }

    fn adapt(&mut self, gain_ratio: f64) {
        if gain_ratio > GAIN_GOOD {
            self.value /= SHRINK;
            self.growth = 2.0;
        } else if gain_ratio < GAIN_POOR {
            self.grow();
        }
    }

    fn grow(&mut self) {
        // A damping of zero cannot grow by a factor.
        self.value = (self.value * self.growth).max(f64::EPSILON * self.unit);
        self.growth *= 2.0;
    }

    /// Confirms the convergence `stop` of a step with this damping. Returns it if the solve is at its end, and `None`
    /// if an undamped step has to confirm it first; the damping is then 0.
    ///
    /// Damping may hold back a single row with a unit far from those of the others, so a damped step alone proves no
    /// convergence. The undamped step is tried once per solve: after its failure the convergence of damped steps
    /// counts.
    fn confirm(&mut self, stop: LmStop) -> Option<LmStop> {
        if !(self.has_to_confirm && self.value > 0.0) {
            return Some(stop);
        }
        (self.value, self.growth, self.has_to_confirm) = (0.0, 2.0, false);
        None
    }

    fn is_at_limit(&self) -> bool {
        self.value >= DAMPING_LIMIT * self.unit
    }
}

/// Outcome of one step.
enum Attempt {
    Accepted {
        cost: f64,
        gain_ratio: f64,
        /// Estimate of the decrease that remains after the step. 1
        remaining: f64,
    },
    Rejected,
    Converged(LmStop),
}

/// Minimizes `problem` from its current iterate; the best iterate found is left in it.
///
/// A step counts only if it lowers the true cost; a failed factorization is a rejected step. `is_late`
/// is polled once per iteration, before the step: its answers are an input like any other, so a
/// replay that repeats them repeats the solve.
///
/// Real time: no allocation; at most `iterations_max` linearizations, factorizations and evaluations.
///
/// # Errors
/// The problem is not finite at the start, or has a derivative that is not finite where it leads.
pub(crate) fn solve<P: LeastSquares>(
    problem: &mut P,
    settings: &LmSettings,
    is_late: &mut dyn FnMut() -> bool,
) -> Result<SolveReport, LmError> {
    let start = problem.linearize()?;
    let mut damping = Damping::new(settings, start.diagonal_max);
    let mut report = SolveReport {
        stop: LmStop::IterationLimit,
        iterations: 0,
        rejected: 0,
        cost_start: start.cost,
        cost: start.cost,
    };
    let mut is_linearized = true;
    while report.iterations < settings.iterations_max {
        if is_late() {
            report.stop = LmStop::Late;
            break;
        }
        if !is_linearized {
            problem.linearize()?;
            is_linearized = true;
        }
        report.iterations += 1;
        let stop = match attempt(problem, settings, damping.value, report.cost) {
            Attempt::Accepted { cost, gain_ratio, remaining } => {
                let decrease = report.cost - cost;
                report.cost = cost;
                is_linearized = false;
                if decrease.min(remaining) > settings.cost_tolerance * cost {
                    damping.adapt(gain_ratio);
                    None
                } else {
                    damping.confirm(LmStop::CostTolerance)
                }
            }
            Attempt::Rejected => {
                report.rejected += 1;
                damping.grow();
                damping.is_at_limit().then_some(LmStop::DampingLimit)
            }
            Attempt::Converged(stop) => damping.confirm(stop),
        };
        if let Some(stop) = stop {
            report.stop = stop;
            break;
        }
    }
    Ok(report)
}

/// Tries one step from an iterate with the true cost `cost` and accepts it if it is good enough.
///
/// The decrease that remains after the step is estimated without another step. With the quadratic model's Hessian `H`,
/// the true one `H + E` and the step `d`, the error of the predicted decrease is `eta = d' E d / 2`, and the gradient
/// after the step is `E d`: the next step gains about `d' E H^-1 E d / 2 <= |eta|` if `E` is semidefinite and the
/// iteration contracts. If `E` is indefinite, `eta` may vanish by chance: [`LeastSquares::REMAINING_DECREASE_MIN`] is a
/// lower bound. Along a direction of curvature `l`, the damping `mu` holds back `mu^2 |d|^2 / (2 l)`, less than half of
/// `mu |d|^2` where `l` exceeds `mu`.
fn attempt<P: LeastSquares>(
    problem: &mut P,
    settings: &LmSettings,
    damping: f64,
    cost: f64,
) -> Attempt {
    let Ok(step) = problem.try_step(damping) else { return Attempt::Rejected };
    let damping_term = damping * step.norm * step.norm;
    if step.norm <= settings.step_tolerance * step.iterate_norm {
        return Attempt::Converged(LmStop::StepTolerance);
    }
    if step.decrease <= f64::EPSILON * cost {
        // The decrease is lost in the rounding of the cost.
        return Attempt::Converged(LmStop::CostTolerance);
    }
    let candidate = problem.candidate_cost();
    let gain_ratio = (cost - candidate) / step.decrease;
    // False for a NaN.
    if gain_ratio > GAIN_ACCEPTED {
        problem.accept();
        let model_error =
            (cost - candidate - step.decrease).abs().max(P::REMAINING_DECREASE_MIN * step.decrease);
        Attempt::Accepted {
            cost: candidate,
            gain_ratio,
            remaining: model_error + 0.5 * damping_term,
        }
    } else {
        Attempt::Rejected
    }
}

#[cfg(test)]
mod tests;
