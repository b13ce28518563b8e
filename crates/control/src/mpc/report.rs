//! The problem of a solve, and the report beside the plan.

use horizon_model::Vector;
use thiserror::Error;

use super::settings::MpcSettings;

/// The problem of one solve: state, parameter, references and committed inputs.
///
/// | name       | shape  | meaning                                          |
/// |------------|--------|--------------------------------------------------|
/// | `s_0`      | NS     | state when `u_0` begins to act                   |
/// | `p`        | NP     | parameter of the model over the horizon          |
/// | `u_before` | NU     | input before `u_0`                               |
/// | `s_ref`    | N x NS | references of `s_1 .. s_N` at the ends of the stages, angles at the turn nearest to `s_0` |
/// | `u_given`  | n x NU | inputs of the first n steps of which some rows are sent already |
/// | `given_steps` | NU  | by row, in how many steps they are; a stage ends there |
///
/// Rows have the units of the model's states, inputs and parameters.
#[derive(Debug, Clone, Copy)]
pub struct MpcProblem<'a, const NS: usize, const NU: usize, const NP: usize> {
    /// State when `u_0` begins to act. Unit of each row
    pub s_0: &'a Vector<NS>,
    /// Parameter of the model over the horizon. Unit of each row
    pub p: &'a Vector<NP>,
    /// Input before `u_0`; matters to [`InputCost::Difference`](super::InputCost::Difference). Unit of each row
    pub u_before: &'a Vector<NU>,
    /// References of `s_1 .. s_N`. Unit of each row
    pub s_ref: &'a [Vector<NS>],
    /// Committed inputs: sent already, in transit. The bounds do not hold for them. Unit of each row
    pub u_given: &'a [Vector<NU>],
    /// Row `i` of the input of a stage is the mean of `u_given[..][i]` over its steps, up to `given_steps[i]`, and
    /// free after. Zeros leave all inputs free.
    pub given_steps: [usize; NU],
}

impl<const NS: usize, const NU: usize, const NP: usize> MpcProblem<'_, NS, NU, NP> {
    /// Checks that the problem fits the horizon of `settings` and is finite.
    ///
    /// # Errors
    /// The first entry that does not fit or is not finite.
    pub(super) fn check(&self, settings: &MpcSettings<NS, NU>) -> Result<(), SqpError> {
        let (given, stages) = (self.s_ref.len(), settings.stage_steps().len());
        if given != stages {
            return Err(SqpError::Horizon { given, stages });
        }
        let horizon_steps = settings.horizon_steps();
        let given_max = self.u_given.len().min(horizon_steps);
        if let Some(row) = self.given_steps.iter().position(|steps| *steps > given_max) {
            return Err(SqpError::Given {
                row,
                given_steps: self.given_steps[row],
                given: self.u_given.len(),
                horizon_steps,
            });
        }
        let is_inside = |steps: &usize| !settings.is_boundary(*steps);
        if let Some(row) = self.given_steps.iter().position(is_inside) {
            return Err(SqpError::Inside { row, given_steps: self.given_steps[row] });
        }
        all_finite("s_0", self.s_0)?;
        all_finite("p", self.p)?;
        all_finite("u_before", self.u_before)?;
        all_finite_of("s_ref", self.s_ref)?;
        all_finite_of("u_given", self.u_given)
    }
}

fn all_finite<const N: usize>(what: &'static str, v: &Vector<N>) -> Result<(), SqpError> {
    match v.iter().position(|value| !value.is_finite()) {
        None => Ok(()),
        Some(row) => Err(SqpError::NotFinite { what, at: None, row, value: v[row] }),
    }
}

pub(super) fn all_finite_of<const N: usize>(
    what: &'static str,
    vectors: &[Vector<N>],
) -> Result<(), SqpError> {
    for (k, v) in vectors.iter().enumerate() {
        if let Some(row) = v.iter().position(|value| !value.is_finite()) {
            return Err(SqpError::NotFinite { what, at: Some(k), row, value: v[row] });
        }
    }
    Ok(())
}

/// `at` as an index, nothing if there is none.
fn index(at: Option<usize>) -> String {
    at.map_or_else(String::new, |k| format!("[{k}]"))
}

/// Why a solve stopped. Every variant leaves a plan to use, never costlier than the first one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[must_use]
#[non_exhaustive]
pub enum SqpStop {
    /// The predicted relative decrease of the cost is below the tolerance, or lost in the rounding of the cost: the
    /// plan is optimal.
    CostTolerance,
    /// The iteration limit was reached.
    IterationLimit,
    /// The caller reported that it is late.
    Late,
    /// A quadratic subproblem was not solved to its tolerance, or a derivative or a constraint along the improved plan
    /// is not finite.
    QpUnsolved,
    /// No part of a step lowered the true cost as much as it should have.
    Stalled,
}

impl SqpStop {
    /// Name in logs, that of the variant in snake case.
    pub fn name(self) -> &'static str {
        match self {
            Self::CostTolerance => "cost_tolerance",
            Self::IterationLimit => "iteration_limit",
            Self::Late => "late",
            Self::QpUnsolved => "qp_unsolved",
            Self::Stalled => "stalled",
        }
    }
}

/// How a solve went.
#[derive(Debug, Clone, Copy, PartialEq)]
#[must_use]
pub struct MpcReport {
    /// Why it stopped.
    pub stop: SqpStop,
    /// Accepted steps, at most one per quadratic subproblem.
    pub iterations: u32,
    /// Iterations of all quadratic subproblems, see [`QpKind`](super::QpKind).
    pub qp_iterations: u32,
    /// Subproblems that the stage-wise solver left to Clarabel.
    pub qp_fallbacks: u32,
    /// Cost of the plan before the solve, on this problem. 1
    pub cost_start: f64,
    /// Cost of the plan after it. 1
    pub cost: f64,
}

impl MpcReport {
    /// Whether the plan was improved for this problem or found optimal. Otherwise it is still the previous plan.
    pub fn has_new_plan(&self) -> bool {
        self.iterations > 0 || self.stop == SqpStop::CostTolerance
    }
}

/// What makes a solve impossible. The plan stays as it was.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum SqpError {
    /// An entry of the problem is infinite or NaN.
    #[error("{what}{}[{row}] = {value} is not finite", index(*at))]
    NotFinite {
        /// Field of [`MpcProblem`], or `u` of a plan.
        what: &'static str,
        /// Index of the vector in a field that has several.
        at: Option<usize>,
        /// Row of the vector.
        row: usize,
        /// The entry.
        value: f64,
    },
    /// The number of references is not the length of the horizon.
    #[error("{given} references for a horizon of {stages} stages")]
    Horizon {
        /// Number of references in the problem.
        given: usize,
        /// Number of stages.
        stages: usize,
    },
    /// The plan of [`Mpc::set_plan`](super::Mpc::set_plan) has not one input for each stage.
    #[error("a plan of {given} inputs for a horizon of {stages} stages")]
    Plan {
        /// Number of inputs.
        given: usize,
        /// Number of stages.
        stages: usize,
    },
    /// More inputs are declared as given than there are, or than the horizon has.
    #[error(
        "given_steps[{row}] = {given_steps} with {given} given inputs and a horizon of \
         {horizon_steps} steps"
    )]
    Given {
        /// Row of the input.
        row: usize,
        /// Number of given steps of that row.
        given_steps: usize,
        /// Number of given inputs in the problem.
        given: usize,
        /// Length of the horizon.
        horizon_steps: usize,
    },
    /// The given inputs of a row end inside a stage.
    #[error("given_steps[{row}] = {given_steps} lies inside a stage of the horizon")]
    Inside {
        /// Row of the input.
        row: usize,
        /// Number of given steps of that row.
        given_steps: usize,
    },
    /// More soft constraints than the settings have places for.
    #[error("{given} constraints, but the settings have places for {max}")]
    Constraints {
        /// Number of constraints.
        given: usize,
        /// Number of places.
        max: usize,
    },
    /// A soft constraint along the present plan is not finite, or its weight is negative.
    #[error(
        "{what} of constraint {constraint} after stage {stage}: {value} is {}",
        if value.is_finite() { "negative" } else { "not finite" }
    )]
    Constraint {
        /// Index of the constraint.
        constraint: usize,
        /// Stage after which it is evaluated.
        stage: usize,
        /// Field of [`Excess`](crate::Excess), or `squared weight`: the square of the weight times the steps of the
        /// stage, which may overflow.
        what: &'static str,
        /// Value of that field, or the first entry of a gradient that is not finite.
        value: f64,
    },
    /// A Jacobian of the model along the present plan is not finite.
    #[error("a derivative of the model is not finite in stage {stage}")]
    Derivative {
        /// The first such stage.
        stage: usize,
    },
    /// The present plan leads out of the range of numbers: entries of the problem are too large, or the model is not
    /// finite.
    #[error(
        "the present plan costs {cost}: state, reference or weights are too large, or the model is not finite"
    )]
    Cost {
        /// Cost of the present plan, not finite. 1
        cost: f64,
    },
}

#[cfg(test)]
mod tests;
