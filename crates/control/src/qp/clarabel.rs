//! The quadratic subproblem, solved by Clarabel: an interior point in a general sparse form.
//!
//! Owns the only use of Clarabel. Variables are ordered by stage, `du_0, ds_1, du_1, ds_2, ..`. Blocks
//! are stored full, zeros included, so that the sparsity never changes: the symbolic factorization of
//! [`Clarabel::new`] serves every later solve. A given input is cut off from all the others, so that
//! zero is what it costs least at. Each penalty has a slack variable, after the state of its stage: the excess in units
//! of 1 / weight, so that a large weight does not spread the curvature. One that no penalty needs is cut off, too.

use std::fmt::{self, Debug, Formatter};

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DataUpdateError, DefaultSettings, DefaultSolver, IPSolver, SolverError, SolverStatus,
    SupportedConeT,
};
use horizon_model::{Bounds, Vector};

use super::penalty::{Penalty, of_stage};
use super::{CostHessian, Limits, Problem, Reason, SolveQp, Stage, Unsolved};

/// A problem of fixed shape with its solver, reused for every linearization.
pub(crate) struct Clarabel<const NS: usize, const NU: usize> {
    solver: DefaultSolver<f64>,
    curvature: CostHessian<NS, NU>,
    /// Penalties per stage, at most.
    penalties_max: usize,
    /// Whether `P` lacks couplings, because inputs were given.
    is_cut: bool,
    /// Nonzeros of `P`, column by column.
    quadratic: Vec<f64>,
    /// Nonzeros of the constraint matrix, column by column.
    constraint: Vec<f64>,
    /// `q` in the order of the variables.
    linear: Vec<f64>,
    /// Right-hand side of the constraints: zeros for the dynamics, then the box.
    bound: Vec<f64>,
}

impl<const NS: usize, const NU: usize> Clarabel<NS, NU> {
    /// A solver for every problem with this `curvature`. All of our allocation happens here.
    ///
    /// # Errors
    /// Clarabel refuses its settings; the dimensions agree by construction.
    pub(crate) fn new(
        curvature: &CostHessian<NS, NU>,
        limits: Limits,
    ) -> Result<Self, SolverError> {
        let steps = curvature.diagonal.steps();
        // The values do not matter: the matrix is not equilibrated, and zeros are kept.
        let stages = vec![Stage::<NS, NU>::zeros(); steps];
        let bounds = vec![Bounds { lo: Vector::zeros(), hi: Vector::from_element(1.0) }; steps];
        let slacks = limits.penalties_max;
        let shape = (steps * (NS + 2 * NU + slacks), steps * (NS + NU + slacks));
        let quadratic = by_columns(shape.1, shape.1, |entry| {
            curvature_entries(curvature, &bounds, slacks, entry);
        });
        let constraint = by_columns(shape.0, shape.1, |entry| {
            constraint_entries(&stages, &bounds, &[], slacks, entry);
        });
        let linear = vec![0.0; shape.1];
        let bound = vec![0.0; shape.0];
        let solver = DefaultSolver::new(
            &quadratic,
            &linear,
            &constraint,
            &bound,
            &[
                SupportedConeT::ZeroConeT(steps * NS),
                SupportedConeT::NonnegativeConeT(steps * (2 * NU + slacks)),
            ],
            clarabel_settings(limits),
        )?;
        Ok(Self {
            solver,
            curvature: curvature.clone(),
            penalties_max: slacks,
            is_cut: false,
            quadratic: quadratic.nzval,
            constraint: constraint.nzval,
            linear,
            bound,
        })
    }

    /// Tells the solver the problem. Only numbers change, never the sparsity.
    fn update(&mut self, problem: &Problem<'_, NS, NU>) -> Result<(), DataUpdateError> {
        let has_given = problem.bounds.iter().any(|bounds| (0..NU).any(|i| bounds.is_given(i)));
        let is_cut = has_given && !self.curvature.coupling.is_empty();
        if is_cut || self.is_cut {
            self.is_cut = is_cut;
            self.quadratic.clear();
            let slacks = self.penalties_max;
            curvature_entries(&self.curvature, problem.bounds, slacks, |_, _, value| {
                self.quadratic.push(value);
            });
            self.solver.update_P(&self.quadratic)?;
        }
        self.constraint.clear();
        let Problem { stages, bounds, penalties, .. } = *problem;
        constraint_entries(stages, bounds, penalties, self.penalties_max, |_, _, value| {
            self.constraint.push(value);
        });
        self.linear.clear();
        self.bound.truncate(problem.stages.len() * NS);
        for (k, (u, bounds)) in problem.u.iter().zip(problem.bounds).enumerate() {
            let is_given = |i: usize| bounds.is_given(i);
            let by_u = &problem.gradient.u[k];
            self.linear.extend((0..NU).map(|i| if is_given(i) { 0.0 } else { by_u[i] }));
            self.linear.extend_from_slice(problem.gradient.s[k].as_slice());
            self.linear.extend((0..self.penalties_max).map(|_| 0.0));
            // Any interior around zero does for what is given.
            let room = |i: usize, room: f64| if is_given(i) { 1.0 } else { room };
            self.bound.extend((0..NU).map(|i| room(i, bounds.hi[i] - u[i])));
            self.bound.extend((0..NU).map(|i| room(i, u[i] - bounds.lo[i])));
        }
        for k in 0..problem.stages.len() {
            let penalties = &problem.penalties[of_stage(problem.penalties, k)];
            for j in 0..self.penalties_max {
                let room = |penalty: &Penalty<NS>| -penalty.weight() * penalty.excess;
                self.bound.push(penalties.get(j).map_or(1.0, room));
            }
        }
        self.solver.update_A(&self.constraint)?;
        self.solver.update_q(&self.linear)?;
        self.solver.update_b(&self.bound)
    }
}

impl<const NS: usize, const NU: usize> SolveQp<NS, NU> for Clarabel<NS, NU> {
    /// `du` meets the box up to the solver's tolerance.
    ///
    /// Real time: linear in the horizon; Clarabel's timers allocate once per solve.
    fn solve(
        &mut self,
        problem: &Problem<'_, NS, NU>,
        du: &mut [Vector<NU>],
    ) -> Result<u32, Unsolved> {
        let updated = self.update(problem);
        debug_assert!(updated.is_ok(), "the shape of the problem is fixed: {updated:?}");
        self.solver.solve();

        let solution = &self.solver.solution;
        let iterations = solution.iterations;
        match solution.status {
            SolverStatus::Solved | SolverStatus::AlmostSolved if updated.is_ok() => {
                let width = NU + NS + self.penalties_max;
                let steps = solution.x.chunks_exact(width).zip(problem.bounds);
                for (du, (x, bounds)) in du.iter_mut().zip(steps) {
                    *du = Vector::from_fn(|i, _| if bounds.is_given(i) { 0.0 } else { x[i] });
                }
                Ok(iterations)
            }
            status => Err(Unsolved { reason: Reason::Clarabel(status), iterations }),
        }
    }
}

impl<const NS: usize, const NU: usize> Debug for Clarabel<NS, NU> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.debug_struct("Clarabel")
            .field("status", &self.solver.solution.status)
            .finish_non_exhaustive()
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
        // Off: the line search of the outer iteration rejects a step that is not precise enough.
        equilibrate_enable: false,
        // The default, 1e-8, leaves penalties with a weight of 1e4 unsolved, 1e-13 problems without penalties.
        static_regularization_constant: 1e-11,
        ..DefaultSettings::default()
    }
}

/// Visits the upper triangle of `P` as `(row, column, value)`, column by column.
fn curvature_entries<const NS: usize, const NU: usize>(
    curvature: &CostHessian<NS, NU>,
    bounds: &[Bounds<NU>],
    slacks: usize,
    mut visit: impl FnMut(usize, usize, f64),
) {
    let width = NU + NS + slacks;
    for (k, (by_u, by_s)) in curvature.diagonal.u.iter().zip(&curvature.diagonal.s).enumerate() {
        for i in 0..NU {
            let col = k * width + i;
            if let (Some(coupling), Some(row)) = (curvature.coupling.get(k), col.checked_sub(width))
            {
                let is_given = bounds[k - 1].is_given(i) || bounds[k].is_given(i);
                visit(row, col, if is_given { 0.0 } else { coupling[i] });
            }
            visit(col, col, by_u[i]);
        }
        for i in 0..NS {
            let col = k * width + NU + i;
            visit(col, col, by_s[i]);
        }
        for col in (0..slacks).map(|j| k * width + NU + NS + j) {
            visit(col, col, 1.0);
        }
    }
}

/// Visits the constraint matrix as `(row, column, value)`, column by column.
///
/// Rows: the dynamics `A_k ds_k + B_k du_k - ds_{k+1} = 0` of all steps, then for each step
/// `du_k <= hi - u_k` and `-du_k <= u_k - lo`, then for each slack variable
/// `w g' ds - sigma <= -w c` with the weight `w`.
fn constraint_entries<const NS: usize, const NU: usize>(
    stages: &[Stage<NS, NU>],
    bounds: &[Bounds<NU>],
    penalties: &[Penalty<NS>],
    slacks: usize,
    mut visit: impl FnMut(usize, usize, f64),
) {
    let box_row = stages.len() * NS;
    let slack_row = box_row + 2 * stages.len() * NU;
    for (k, stage) in stages.iter().enumerate() {
        let col_of_stage = k * (NU + NS + slacks);
        let penalties = &penalties[of_stage(penalties, k)];
        let row_of_slack = |j: usize| slack_row + k * slacks + j;
        for (i, by_input) in stage.by_input.column_iter().enumerate() {
            let col = col_of_stage + i;
            let is_given = bounds[k].is_given(i);
            for (row, value) in by_input.iter().enumerate() {
                visit(k * NS + row, col, if is_given { 0.0 } else { *value });
            }
            visit(box_row + 2 * k * NU + i, col, 1.0);
            visit(box_row + (2 * k + 1) * NU + i, col, -1.0);
        }
        for i in 0..NS {
            let col = col_of_stage + NU + i;
            visit(k * NS + i, col, -1.0);
            if let Some(next) = stages.get(k + 1) {
                for (row, value) in next.by_state.column(i).iter().enumerate() {
                    visit((k + 1) * NS + row, col, *value);
                }
            }
            for j in 0..slacks {
                let weighted = |penalty: &Penalty<NS>| penalty.weight() * penalty.gradient[i];
                visit(row_of_slack(j), col, penalties.get(j).map_or(0.0, weighted));
            }
        }
        for j in 0..slacks {
            visit(row_of_slack(j), col_of_stage + NU + NS + j, -1.0);
        }
    }
}

/// The sparse matrix whose entries `visit_all` visits column by column, rows ascending.
fn by_columns(
    rows: usize,
    cols: usize,
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
