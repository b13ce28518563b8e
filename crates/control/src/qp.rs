//! The quadratic subproblem of the controller, solved by Clarabel.
//!
//! Owns the shape of the problem and the only use of Clarabel; what is being controlled is not
//! known here. The problem over `du_0 .. du_{L-1}` and `ds_1 .. ds_L` is
//!
//! minimize `1/2 d' P d + q' d` subject to `ds_{k+1} = A_k ds_k + B_k du_k`, `ds_0 = 0` and
//! `lo <= u_k + du_k <= hi`.
//!
//! Variables are ordered by stage, `du_0, ds_1, du_1, ds_2, ..`. Blocks are stored full, zeros
//! included, so that the sparsity never changes: the symbolic factorization of [`Qp::new`] serves
//! every later solve.

use std::fmt::{self, Debug, Formatter};

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, SolverError, SolverStatus, SupportedConeT,
};
use nalgebra::{SMatrix, SVector};
use thiserror::Error;

use crate::horizon::Horizon;

/// Linear dynamics of one step: `ds_{k+1} = A_k ds_k + B_k du_k`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stage<const NS: usize, const NU: usize> {
    /// `A_k`.
    pub(crate) by_state: SMatrix<f64, NS, NS>,
    /// `B_k`.
    pub(crate) by_input: SMatrix<f64, NS, NU>,
}

impl<const NS: usize, const NU: usize> Stage<NS, NU> {
    /// A step that leads to zero.
    pub(crate) fn zeros() -> Self {
        Self { by_state: SMatrix::zeros(), by_input: SMatrix::zeros() }
    }
}

/// The constant matrix `P`: a diagonal, and maybe a coupling of neighbouring inputs.
#[derive(Debug, Clone)]
pub(crate) struct Curvature<const NS: usize, const NU: usize> {
    /// Diagonal of `P`.
    pub(crate) diagonal: Horizon<NS, NU>,
    /// Diagonal of each block between `du_{k-1}` and `du_k`.
    pub(crate) coupling: Option<SVector<f64, NU>>,
}

/// Where the box lies and how it is seen from the present inputs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct InputBox<'a, const NU: usize> {
    /// Present inputs `u_k`, inside the box.
    pub(crate) u: &'a [SVector<f64, NU>],
    /// Lower bounds of every input.
    pub(crate) lo: &'a SVector<f64, NU>,
    /// Upper bounds of every input.
    pub(crate) hi: &'a SVector<f64, NU>,
}

/// When a solve ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Limits {
    /// Gap and feasibility tolerance. 1
    pub(crate) tolerance: f64,
    /// Interior-point iterations.
    pub(crate) iterations_max: u32,
}

/// The solver ended without an accurate step.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("the quadratic subproblem ended as {status} after {iterations} iterations")]
pub(crate) struct Unsolved {
    status: SolverStatus,
    /// Interior-point iterations spent.
    pub(crate) iterations: u32,
}

/// A problem of fixed shape with its solver, reused for every linearization.
pub(crate) struct Qp<const NS: usize, const NU: usize> {
    solver: DefaultSolver<f64>,
    /// Nonzeros of the constraint matrix, column by column.
    constraint: Vec<f64>,
    /// `q` in the order of the variables.
    linear: Vec<f64>,
    /// Right-hand side of the constraints: zeros for the dynamics, then the box.
    bound: Vec<f64>,
}

impl<const NS: usize, const NU: usize> Qp<NS, NU> {
    /// A solver for every problem with this `curvature`. All of our allocation happens here.
    ///
    /// # Errors
    /// Clarabel refuses its settings; the dimensions agree by construction.
    pub(crate) fn new(curvature: &Curvature<NS, NU>, limits: Limits) -> Result<Self, SolverError> {
        let steps = curvature.diagonal.steps();
        // The values do not matter: the matrix is not equilibrated, and zeros are kept.
        let stages = vec![Stage::<NS, NU>::zeros(); steps];
        let shape = (steps * (NS + 2 * NU), steps * (NS + NU));
        let constraint = by_columns(shape, |entry| constraint_entries(&stages, entry));
        let linear = vec![0.0; shape.1];
        let bound = vec![0.0; shape.0];
        let solver = DefaultSolver::new(
            &by_columns((shape.1, shape.1), |entry| curvature_entries(curvature, entry)),
            &linear,
            &constraint,
            &bound,
            &[
                SupportedConeT::ZeroConeT(steps * NS),
                SupportedConeT::NonnegativeConeT(2 * steps * NU),
            ],
            clarabel_settings(limits),
        )?;
        Ok(Self { solver, constraint: constraint.nzval, linear, bound })
    }

    /// Writes the minimizing inputs into `du` and returns the number of interior-point iterations.
    ///
    /// `du` meets the box up to the solver's tolerance. It is left alone on an error.
    ///
    /// # Errors
    /// [`Unsolved`] when the limits of [`Qp::new`] are not met.
    ///
    /// Real time: linear in the horizon; Clarabel's timers allocate once per solve.
    pub(crate) fn solve(
        &mut self,
        stages: &[Stage<NS, NU>],
        gradient: &Horizon<NS, NU>,
        input_box: &InputBox<'_, NU>,
        du: &mut [SVector<f64, NU>],
    ) -> Result<u32, Unsolved> {
        self.constraint.clear();
        constraint_entries(stages, |_, _, value| self.constraint.push(value));
        self.linear.clear();
        for (by_u, by_s) in gradient.u.iter().zip(&gradient.s) {
            self.linear.extend_from_slice(by_u.as_slice());
            self.linear.extend_from_slice(by_s.as_slice());
        }
        self.bound.truncate(stages.len() * NS);
        for u in input_box.u {
            self.bound.extend_from_slice((input_box.hi - u).as_slice());
            self.bound.extend_from_slice((u - input_box.lo).as_slice());
        }
        let updated = self
            .solver
            .update_A(&self.constraint)
            .and_then(|()| self.solver.update_q(&self.linear))
            .and_then(|()| self.solver.update_b(&self.bound));
        debug_assert!(updated.is_ok(), "the shape of the problem is fixed: {updated:?}");
        self.solver.solve();

        let solution = &self.solver.solution;
        let iterations = solution.iterations;
        match solution.status {
            SolverStatus::Solved | SolverStatus::AlmostSolved if updated.is_ok() => {
                for (du_k, x_k) in du.iter_mut().zip(solution.x.chunks_exact(NU + NS)) {
                    du_k.copy_from_slice(&x_k[..NU]);
                }
                Ok(iterations)
            }
            status => Err(Unsolved { status, iterations }),
        }
    }
}

impl<const NS: usize, const NU: usize> Debug for Qp<NS, NU> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.debug_struct("Qp").field("status", &self.solver.solution.status).finish_non_exhaustive()
    }
}

fn clarabel_settings(limits: Limits) -> DefaultSettings<f64> {
    DefaultSettings {
        verbose: false,
        max_iter: limits.iterations_max,
        tol_gap_abs: limits.tolerance,
        tol_gap_rel: limits.tolerance,
        tol_feas: limits.tolerance,
        direct_solve_method: "qdldl".into(),
        max_threads: 1,
        // Both would change the sparsity and forbid updates in place.
        presolve_enable: false,
        input_sparse_dropzeros: false,
        // Measured on the reference problems: neither changes the digits of the cost, together they
        // take half of the time. The outer iteration corrects what they would.
        equilibrate_enable: false,
        iterative_refinement_enable: false,
        ..DefaultSettings::default()
    }
}

/// Visits the upper triangle of `P` as `(row, column, value)`, column by column.
fn curvature_entries<const NS: usize, const NU: usize>(
    curvature: &Curvature<NS, NU>,
    mut visit: impl FnMut(usize, usize, f64),
) {
    let width = NU + NS;
    for (k, (by_u, by_s)) in curvature.diagonal.u.iter().zip(&curvature.diagonal.s).enumerate() {
        for i in 0..NU {
            let col = k * width + i;
            if let (Some(coupling), Some(row)) = (curvature.coupling, col.checked_sub(width)) {
                visit(row, col, coupling[i]);
            }
            visit(col, col, by_u[i]);
        }
        for i in 0..NS {
            let col = k * width + NU + i;
            visit(col, col, by_s[i]);
        }
    }
}

/// Visits the constraint matrix as `(row, column, value)`, column by column.
///
/// Rows: the dynamics `A_k ds_k + B_k du_k - ds_{k+1} = 0` of all steps, then for each step
/// `du_k <= hi - u_k` and `-du_k <= u_k - lo`.
fn constraint_entries<const NS: usize, const NU: usize>(
    stages: &[Stage<NS, NU>],
    mut visit: impl FnMut(usize, usize, f64),
) {
    let box_row = stages.len() * NS;
    for (k, stage) in stages.iter().enumerate() {
        let col_of_stage = k * (NU + NS);
        for (i, by_input) in stage.by_input.column_iter().enumerate() {
            let col = col_of_stage + i;
            for (row, value) in by_input.iter().enumerate() {
                visit(k * NS + row, col, *value);
            }
            visit(box_row + 2 * k * NU + i, col, 1.0);
            visit(box_row + (2 * k + 1) * NU + i, col, -1.0);
        }
        for i in 0..NS {
            let col = col_of_stage + NU + i;
            visit(k * NS + i, col, -1.0);
            let Some(next) = stages.get(k + 1) else { continue };
            for (row, value) in next.by_state.column(i).iter().enumerate() {
                visit((k + 1) * NS + row, col, *value);
            }
        }
    }
}

/// The sparse matrix whose entries `visit_all` visits column by column, rows ascending.
fn by_columns(
    (rows, cols): (usize, usize),
    visit_all: impl FnOnce(&mut dyn FnMut(usize, usize, f64)),
) -> CscMatrix<f64> {
    let mut starts = vec![0; cols + 1];
    let (mut row_indices, mut values) = (Vec::new(), Vec::new());
    visit_all(&mut |row, col, value| {
        row_indices.push(row);
        values.push(value);
        starts[col + 1] = values.len();
    });
    CscMatrix::new(rows, cols, starts, row_indices, values)
}

#[cfg(test)]
mod tests;
