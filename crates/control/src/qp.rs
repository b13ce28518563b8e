//! The quadratic subproblem of the controller.
//!
//! Owns what the problem is and which solver gets it; the controlled system is not known here. The
//! problem over `du_0 .. du_{N-1}` and `ds_1 .. ds_N` is
//!
//! minimize `1/2 d' P d + q' d` subject to `ds_{k+1} = A_k ds_k + B_k du_k`, `ds_0 = 0`,
//! `lo_k <= u_k + du_k <= hi_k`. An input with equal bounds is given. The stage-wise solver also takes the
//! second derivatives of the dynamics that add to `P`, as long as the reduced Hessian is positive definite. Both take
//! one-sided quadratic penalties on the states (`penalty.rs`).

mod active_set;
mod clarabel;
pub(crate) mod penalty;
pub(crate) mod product;

use horizon_model::{Bounds, InputHessian, Matrix, Vector};
use thiserror::Error;

use self::active_set::ActiveSet;
use self::clarabel::Clarabel;
pub use self::penalty::Penalty;
use self::product::mul_sparse;
pub use crate::horizon::Horizon;
use ::clarabel::solver::{SolverError, SolverStatus};

/// Linear dynamics of one step: `ds_{k+1} = A_k ds_k + B_k du_k`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stage<const NS: usize, const NU: usize> {
    /// `A_k`. Unit of the row / unit of the column
    pub by_state: Matrix<NS, NS>,
    /// `B_k`. Unit of the row / unit of the column
    pub by_input: Matrix<NS, NU>,
}

impl<const NS: usize, const NU: usize> Stage<NS, NU> {
    /// A step that leads to zero.
    pub fn zeros() -> Self {
        Self { by_state: Matrix::zeros(), by_input: Matrix::zeros() }
    }

    /// `ds_{k+1} = A_k ds_k + B_k du_k`, in the unit of each row.
    ///
    /// Real time: no allocation, `2 NS (NS + NU)` operations.
    #[inline]
    pub fn next(&self, ds: &Vector<NS>, du: &Vector<NU>) -> Vector<NS> {
        mul_sparse(&self.by_state, ds) + mul_sparse(&self.by_input, du)
    }
}

/// The constant matrix `P`: a diagonal, and maybe a coupling of neighbouring inputs.
#[derive(Debug, Clone)]
pub struct CostHessian<const NS: usize, const NU: usize> {
    /// Diagonal of `P`. 1 / squared unit of the row
    pub diagonal: Horizon<NS, NU>,
    /// By step, the diagonal of the block between `du_{k-1}` and `du_k`; the first one has no effect,
    /// since no input is before. Empty if there are none. 1 / squared unit of the row
    pub coupling: Vec<Vector<NU>>,
}

/// What changes from one subproblem to the next.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a, const NS: usize, const NU: usize> {
    /// Dynamics.
    pub stages: &'a [Stage<NS, NU>],
    /// `q`. 1 / unit of the row
    pub gradient: &'a Horizon<NS, NU>,
    /// Present inputs `u_k`, inside their bounds. Unit of each row
    pub u: &'a [Vector<NU>],
    /// By step, finite bounds of the inputs `u_k`, not of the changes `du_k`. Unit of each row
    pub bounds: &'a [Bounds<NU>],
    /// By step, the second derivatives of the dynamics that add to `P`; empty if unknown.
    pub second_derivatives: &'a [InputHessian<NS, NU>],
    /// Soft constraints, in the order of their stages.
    pub penalties: &'a [Penalty<NS>],
}

/// When a solve ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Gap and feasibility tolerance of the interior point. 1
    pub tolerance: f64,
    /// Iterations: of the interior point, or Riccati recursions of the active-set method.
    pub iterations_max: u32,
    /// Penalties per stage, at most.
    pub penalties_max: usize,
}

/// Why there is no accurate step.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum Reason {
    /// The interior point ended early.
    #[error("{0}")]
    Clarabel(SolverStatus),
    /// The working set was not optimal within the iteration limit.
    #[error("the iteration limit")]
    IterationLimit,
    /// The caller reported that it is late, before the interior point began.
    #[error("lateness before the interior point")]
    Late,
    /// The Hessian with the second derivatives of the dynamics is indefinite, or not finite.
    #[error("an indefinite Hessian")]
    Indefinite,
    /// A pivot of the recursion is not positive, or not finite.
    #[error("a pivot that is not positive")]
    NotPositive,
    /// A step is not finite.
    #[error("a step that is not finite")]
    NotFinite,
}

/// The solver ended without an accurate step.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("the quadratic subproblem ended by {reason} after {iterations} iterations")]
pub struct Unsolved {
    reason: Reason,
    /// Iterations spent.
    pub iterations: u32,
}

impl Unsolved {
    /// Whether the solve was given up because the caller was late.
    pub fn is_late(self) -> bool {
        self.reason == Reason::Late
    }

    /// Whether the problem may have a solution with other second derivatives of the dynamics.
    pub fn is_indefinite(self) -> bool {
        self.reason == Reason::Indefinite
    }

    /// With the iterations that were `spent` before.
    pub(crate) fn after(self, spent: u32) -> Self {
        Self { iterations: self.iterations + spent, ..self }
    }
}

/// A solver of problems with one curvature.
trait SolveQp<const NS: usize, const NU: usize> {
    /// Writes the minimizing inputs into `du`, zeros where they are given, and returns the number of
    /// iterations. `du` is left alone on an error.
    ///
    /// # Errors
    /// [`Unsolved`] when a limit is met or the problem is not finite.
    fn solve(
        &mut self,
        problem: &Problem<'_, NS, NU>,
        du: &mut [Vector<NU>],
    ) -> Result<u32, Unsolved>;
}

/// How a subproblem was solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Solved {
    /// Iterations spent, those of a solver that gave up included.
    pub iterations: u32,
    /// Whether the stage-wise solver gave up.
    pub has_fallen_back: bool,
    /// Whether the second derivatives were part of the problem that was solved.
    pub has_second_derivatives: bool,
}

impl Solved {
    /// With the iterations that were `spent` before.
    pub(crate) fn after(self, spent: u32) -> Self {
        Self { iterations: self.iterations + spent, ..self }
    }
}

/// The solvers of one curvature: maybe a fast one, and one that takes what that leaves.
#[derive(Debug)]
pub struct Qp<const NS: usize, const NU: usize> {
    active_set: Option<ActiveSet<NS, NU>>,
    clarabel: Clarabel<NS, NU>,
}

impl<const NS: usize, const NU: usize> Qp<NS, NU> {
    /// Solvers for every problem with this `curvature`. All of our allocation happens here.
    ///
    /// # Errors
    /// Clarabel refuses its settings; the dimensions agree by construction.
    pub fn new(
        curvature: &CostHessian<NS, NU>,
        limits: Limits,
        is_stage_wise: bool,
    ) -> Result<Self, SolverError> {
        Ok(Self {
            active_set: is_stage_wise.then(|| ActiveSet::new(curvature, limits)),
            clarabel: Clarabel::new(curvature, limits)?,
        })
    }

    /// Writes the minimizing inputs into `du`, zeros where they are given.
    ///
    /// `is_late` is asked before Clarabel takes what the stage-wise solver left.
    ///
    /// # Errors
    /// [`Unsolved`] when no solver ends within the limits of [`Qp::new`], late, or with second derivatives that make
    /// the Hessian indefinite; `du` is left alone.
    ///
    /// Real time: linear in the horizon; no allocation unless Clarabel is called, which makes one.
    pub fn solve(
        &mut self,
        problem: &Problem<'_, NS, NU>,
        du: &mut [Vector<NU>],
        is_late: &mut dyn FnMut() -> bool,
    ) -> Result<Solved, Unsolved> {
        let mut spent = 0;
        if let Some(active_set) = &mut self.active_set {
            let has_second_derivatives = !problem.second_derivatives.is_empty();
            match active_set.solve(problem, du) {
                Ok(iterations) => {
                    return Ok(Solved {
                        iterations,
                        has_fallen_back: false,
                        has_second_derivatives,
                    });
                }
                Err(Unsolved { reason: Reason::NotPositive | Reason::NotFinite, iterations })
                    if has_second_derivatives =>
                {
                    return Err(Unsolved { reason: Reason::Indefinite, iterations });
                }
                Err(unsolved) => spent = unsolved.iterations,
            }
            if is_late() {
                return Err(Unsolved { reason: Reason::Late, iterations: spent });
            }
        }
        let has_fallen_back = self.active_set.is_some();
        match self.clarabel.solve(problem, du) {
            Ok(iterations) => {
                self.active_set
                    .iter_mut()
                    .for_each(|active_set| active_set.warm_start(problem, du));
                Ok(Solved { iterations, has_fallen_back, has_second_derivatives: false }
                    .after(spent))
            }
            Err(unsolved) => Err(unsolved.after(spent)),
        }
    }

    /// Shifts the warm start by one stage: stage `k` takes the working set of stage `k + 1` where `is_moved(k)`.
    ///
    /// Real time: no allocation of ours; at most one call of `is_moved` per stage.
    pub fn shift(&mut self, is_moved: impl Fn(usize) -> bool) {
        self.active_set.iter_mut().for_each(|active_set| active_set.shift(&is_moved));
    }

    /// The next problem has nothing to do with the last one.
    ///
    /// Real time: no allocation, cost linear in the number of stages.
    pub fn reset(&mut self) {
        self.active_set.iter_mut().for_each(ActiveSet::reset);
    }
}

#[cfg(test)]
pub(crate) mod tests;
