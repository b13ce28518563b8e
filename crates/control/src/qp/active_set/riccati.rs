//! One step of the backward Riccati recursion: the inputs of a stage are eliminated.
//!
//! Owns the elimination. With `ds = ds_k`, `du = du_k` and `dv = du_{k-1}` the cost of everything after
//! `ds_k` is
//!
//! `V_k(ds, dv) = 1/2 ds' P ds + ds' W dv + 1/2 dv' Q dv + p' ds + q' dv + constant`,
//!
//! `V_N = 0`, and `V_k = min over the inactive du of 1/2 du' D du + dv' C du + g' du + (cost of ds_{k+1}) + V_{k+1}`
//! with `ds_{k+1} = A ds + B du`. `C`, `W`, `Q` and `q` are there only if neighbouring inputs are coupled.
//! The working set is chosen in `active_set.rs`.

use horizon_model::{Matrix, Vector, transpose};

use crate::qp::product::{add_mul, add_scaled, mul_sparse, tr_mul_vector};
use crate::qp::{CostHessian, Penalty, Problem, Reason, Stage};

/// Cost to go as a quadratic in the state and the previous input.
#[derive(Debug, Clone, Copy)]
pub(super) struct Value<const NS: usize, const NU: usize> {
    /// `P`.
    by_state: Matrix<NS, NS>,
    /// `p`, the costate.
    gradient: Vector<NS>,
    /// `W`.
    by_state_before: Matrix<NS, NU>,
    /// `Q`.
    by_before: Matrix<NU, NU>,
    /// `q`.
    gradient_before: Vector<NU>,
}

impl<const NS: usize, const NU: usize> Value<NS, NU> {
    /// Nothing follows.
    pub(super) fn zeros() -> Self {
        Self {
            by_state: Matrix::zeros(),
            gradient: Vector::zeros(),
            by_state_before: Matrix::zeros(),
            by_before: Matrix::zeros(),
            gradient_before: Vector::zeros(),
        }
    }
}

/// Affine feedback law of a stage: for an input at an inactive bound its minimizer, for an input at an active bound
/// the minimizer if this bound alone were removed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Policy<const NS: usize, const NU: usize> {
    /// `-H_ff^-1 S_f` in the rows `f`.
    by_state: Matrix<NU, NS>,
    /// `-H_ff^-1 C_f` in the rows `f`.
    by_before: Matrix<NU, NU>,
    /// `k_f` in the rows `f`.
    offset: Vector<NU>,
}

impl<const NS: usize, const NU: usize> Policy<NS, NU> {
    pub(super) fn zeros() -> Self {
        Self { by_state: Matrix::zeros(), by_before: Matrix::zeros(), offset: Vector::zeros() }
    }

    /// The minimizers at `ds` after `du_before`.
    #[inline]
    pub(super) fn minimizers(&self, ds: &Vector<NS>, du_before: &Vector<NU>) -> Vector<NU> {
        self.offset + mul_sparse(&self.by_state, ds) + mul_sparse(&self.by_before, du_before)
    }
}

/// The working set at a stage.
#[derive(Debug)]
pub(super) struct Working<'a, const NS: usize, const NU: usize> {
    /// The stage.
    pub(super) k: usize,
    /// The step of an input at an active bound, `None` for an input at inactive bounds. Unit of the row
    pub(super) active: [Option<f64>; NU],
    /// The penalties on `ds_{k+1}`.
    pub(super) penalties: &'a [Penalty<NS>],
    /// Whether each of them is in the working set.
    pub(super) penalized: &'a [bool],
}

/// Fills in the policy of the stage of `working` and the value before it, from the value after it.
///
/// The gradient by `du` is `H du + S ds + C dv + h`. Letters as in `docs/model.md`, section 5: `f` for inputs at
/// inactive bounds, `c` for those of the working set, `+` for what is after the step.
///
/// # Errors
/// A pivot is not positive, or not finite.
#[inline]
pub(super) fn eliminate<const NS: usize, const NU: usize>(
    problem: &Problem<'_, NS, NU>,
    curvature: &CostHessian<NS, NU>,
    working: &Working<'_, NS, NU>,
    next: &Value<NS, NU>,
    policy: &mut Policy<NS, NU>,
    value: &mut Value<NS, NU>,
) -> Result<(), Reason> {
    let k = working.k;
    let Stage { by_state: a, by_input: b } = &problem.stages[k];
    let coupling = curvature.coupling.get(k);
    let (hessian_next, gradient_next) = at_next_state(problem, curvature, working, next); // P+ and p+
    // Sums: `P+ B + W`, `H` and `h`.
    let mut by_next_state_input = mul_sparse(&hessian_next, b);
    let mut by_input = Matrix::from_diagonal(&curvature.diagonal.u[k]);
    let mut gradient = problem.gradient.u[k] + tr_mul_vector(b, &gradient_next);
    if coupling.is_some() {
        by_next_state_input += next.by_state_before;
        by_input += next.by_before + mul_sparse(&transpose(b), &next.by_state_before);
        gradient += next.gradient_before;
    }
    let by_input_next_state = transpose(&by_next_state_input);
    add_mul(&mut by_input, &by_input_next_state, b);
    let mut by_input_state = mul_sparse(&by_input_next_state, a); // S
    if let Some(second) = problem.second_derivatives.get(k) {
        by_input_state += second.by_input_state;
        by_input += second.by_input;
    }
    let by_input_before = coupling.map_or(Matrix::zeros(), Matrix::from_diagonal); // C

    let mut inactive_gradient = gradient; // h_f + H_fc du_c in the rows f
    let mut inactive_by_state = transpose(&by_input_state); // S_f': the columns c become zero
    let mut inactive_by_before = by_input_before; // C_f', C being symmetric
    value.gradient = tr_mul_vector(a, &gradient_next);
    value.gradient_before = Vector::zeros();
    for (i, active) in working.active.iter().enumerate() {
        let Some(du) = *active else { continue };
        // An input at an active bound stays fixed; only the other inputs take a feedback gain.
        inactive_gradient += by_input.column(i) * du;
        value.gradient += inactive_by_state.column(i) * du;
        value.gradient_before += inactive_by_before.column(i) * du;
        inactive_by_state.column_mut(i).fill(0.0);
        inactive_by_before.column_mut(i).fill(0.0);
    }
    let transform = transform(by_input, &working.active)?; // -H_ff^-1 in the rows f
    policy.by_state = mul_sparse(&transform, &by_input_state);
    policy.offset = mul_sparse(&transform, &inactive_gradient);
    add_mul(&mut value.gradient, &inactive_by_state, &policy.offset);
    value.by_state = mul_sparse(&transpose(&mul_sparse(&hessian_next, a)), a);
    if let Some(second) = problem.second_derivatives.get(k) {
        value.by_state += second.by_state;
    }
    add_mul(&mut value.by_state, &inactive_by_state, &policy.by_state);
    if coupling.is_some() {
        policy.by_before = mul_sparse(&transform, &by_input_before);
        value.by_state_before = mul_sparse(&inactive_by_state, &policy.by_before);
        value.by_before = mul_sparse(&inactive_by_before, &policy.by_before);
        add_mul(&mut value.gradient_before, &inactive_by_before, &policy.offset);
    }
    for (i, active) in working.active.iter().enumerate() {
        policy.offset[i] += active.unwrap_or(0.0);
    }
    Ok(())
}

/// Hessian and gradient by `ds_{k+1}` of its own cost and all that follows.
#[inline]
fn at_next_state<const NS: usize, const NU: usize>(
    problem: &Problem<'_, NS, NU>,
    curvature: &CostHessian<NS, NU>,
    working: &Working<'_, NS, NU>,
    next: &Value<NS, NU>,
) -> (Matrix<NS, NS>, Vector<NS>) {
    let mut hessian = next.by_state;
    for i in 0..NS {
        hessian[(i, i)] += curvature.diagonal.s[working.k][i];
    }
    let mut gradient = next.gradient + problem.gradient.s[working.k];
    let penalties = working.penalties.iter().zip(working.penalized);
    for (penalty, _) in penalties.filter(|(_, is_active)| **is_active) {
        let weighted = penalty.gradient * penalty.squared_weight;
        add_mul(&mut hessian, &weighted, &transpose(&penalty.gradient));
        gradient += weighted * penalty.excess;
    }
    (hessian, gradient)
}

/// The matrix that maps a gradient to policies: the rows of inactive bounds are those of `-H^-1` over these inputs
/// alone. The row of an active bound is that of `-H^-1` over its input and the inactive ones.
#[inline]
fn transform<const NU: usize>(
    mut by_input: Matrix<NU, NU>,
    active: &[Option<f64>; NU],
) -> Result<Matrix<NU, NU>, Reason> {
    if active.iter().all(Option::is_none) {
        // The common case: without a branch the loop is unrolled.
        let mut is_positive = true;
        for i in 0..NU {
            is_positive &= is_pivot(by_input[(i, i)]);
            invert(&mut by_input, i);
        }
        return if is_positive { Ok(by_input) } else { Err(Reason::NotPositive) };
    }
    for i in (0..NU).filter(|i| active[*i].is_none()) {
        if !is_pivot(by_input[(i, i)]) {
            return Err(Reason::NotPositive);
        }
        invert(&mut by_input, i);
    }
    let mut transform = by_input;
    for i in (0..NU).filter(|i| active[*i].is_some()) {
        let scale = 1.0 / by_input[(i, i)];
        for j in 0..NU {
            // An active bound moves no other input.
            transform[(j, i)] = 0.0;
            if active[j].is_none() {
                transform[(i, j)] *= scale;
            }
        }
        transform[(i, i)] = -scale;
    }
    Ok(transform)
}

/// Whether the pivot is positive: the problem is convex in this row.
#[inline]
fn is_pivot(pivot: f64) -> bool {
    pivot > 0.0 && pivot.is_finite()
}

/// Solves row `i` of `y = m x` for `x_i` and puts that into the others: `y_i` takes the place of `x_i`, `-x_i`
/// that of `y_i` (the symmetric pivot operator of Beaton, 1964). Of symmetric `m` it leaves a symmetric matrix, `-m^-1`
/// after all rows.
#[inline]
fn invert<const NU: usize>(m: &mut Matrix<NU, NU>, i: usize) {
    let reciprocal = 1.0 / m[(i, i)];
    let column = m.data.0[i];
    let mut scaled = column.map(|entry| entry * reciprocal);
    for (j, entries) in m.data.0.iter_mut().enumerate() {
        if j != i {
            add_scaled(entries, -column[j], &scaled);
            entries[i] = scaled[j];
        }
    }
    scaled[i] = -reciprocal;
    m.data.0[i] = scaled;
}

#[cfg(test)]
mod tests;
