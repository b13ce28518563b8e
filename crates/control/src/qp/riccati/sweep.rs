//! One step of the sweep: the inputs of a step leave the problem.
//!
//! Owns the elimination. With `ds = ds_k`, `du = du_k` and `dv = du_{k-1}` the cost of everything after
//! `ds_k` is
//!
//! `V_k(ds, dv) = 1/2 ds' P ds + ds' W dv + 1/2 dv' Q dv + p' ds + q' dv + constant`,
//!
//! `V_L = 0`, and `V_k = min over du of 1/2 du' D du + dv' C du + g' du + (cost of ds_{k+1}) + V_{k+1}`
//! with `ds_{k+1} = A ds + B du`. `C`, `W`, `Q` and `q` are there only if neighbouring inputs are coupled.
//! Which inputs are held is decided one file up.

use nalgebra::{SMatrix, SVector};

use super::product::{add_mul, add_scaled, mul, tr_mul, transpose};
use crate::qp::{Curvature, Problem, Reason, Stage};

/// Cost of what follows a state, as a function of the state and the input before it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Value<const NS: usize, const NU: usize> {
    /// `P`.
    by_state: SMatrix<f64, NS, NS>,
    /// `p`.
    slope: SVector<f64, NS>,
    /// `W`.
    by_state_before: SMatrix<f64, NS, NU>,
    /// `Q`.
    by_before: SMatrix<f64, NU, NU>,
    /// `q`.
    slope_before: SVector<f64, NU>,
}

impl<const NS: usize, const NU: usize> Value<NS, NU> {
    /// Nothing follows.
    pub(super) fn zeros() -> Self {
        Self {
            by_state: SMatrix::zeros(),
            slope: SVector::zeros(),
            by_state_before: SMatrix::zeros(),
            by_before: SMatrix::zeros(),
            slope_before: SVector::zeros(),
        }
    }
}

/// Where each input of a step would go if it alone were let go, as a function of the state and the
/// input before it. A free input does go there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Policy<const NS: usize, const NU: usize> {
    by_state: SMatrix<f64, NU, NS>,
    by_before: SMatrix<f64, NU, NU>,
    offset: SVector<f64, NU>,
}

impl<const NS: usize, const NU: usize> Policy<NS, NU> {
    pub(super) fn zeros() -> Self {
        Self { by_state: SMatrix::zeros(), by_before: SMatrix::zeros(), offset: SVector::zeros() }
    }

    /// The pull at `ds` after `du_before`.
    #[inline]
    pub(super) fn pull(
        &self,
        ds: &SVector<f64, NS>,
        du_before: &SVector<f64, NU>,
    ) -> SVector<f64, NU> {
        self.offset + mul(&self.by_state, ds) + mul(&self.by_before, du_before)
    }
}

/// Fills in the policy of step `k` and the value before it, from the value after it.
///
/// `held[i]` is the step that a held input takes, `None` for a free one. The gradient by `du` is
/// `H du + S ds + C dv + h`.
///
/// # Errors
/// A pivot is not positive, or not finite.
#[inline]
pub(super) fn eliminate<const NS: usize, const NU: usize>(
    k: usize,
    problem: &Problem<'_, NS, NU>,
    curvature: &Curvature<NS, NU>,
    held: &[Option<f64>; NU],
    (policy, value): (&mut Policy<NS, NU>, &mut Value<NS, NU>),
    next: &Value<NS, NU>,
) -> Result<(), Reason> {
    let Stage { by_state: a, by_input: b } = &problem.stages[k];
    // The cost of ds_{k+1} joins what follows it.
    let mut hessian = next.by_state;
    for i in 0..NS {
        hessian[(i, i)] += curvature.diagonal.s[k][i];
    }
    let slope = next.slope + problem.gradient.s[k];

    let mut through = mul(&hessian, b);
    let mut by_input = SMatrix::from_diagonal(&curvature.diagonal.u[k]);
    let mut offset = problem.gradient.u[k] + tr_mul(b, &slope);
    if curvature.coupling.is_some() {
        through += next.by_state_before;
        by_input += next.by_before + mul(&transpose(b), &next.by_state_before);
        offset += next.slope_before;
    }
    let through = transpose(&through);
    add_mul(&mut by_input, &through, b);
    let mut by_state = mul(&through, a);
    if let Some(bend) = problem.bends.get(k) {
        by_state += bend.by_input_state;
        by_input += bend.by_input;
    }
    let by_before = curvature.coupling.map_or(SMatrix::zeros(), |c| SMatrix::from_diagonal(&c));

    let mut taken = transpose(&by_state);
    let mut taken_before = by_before;
    value.slope = tr_mul(a, &slope);
    value.slope_before = SVector::zeros();
    for (i, held) in held.iter().enumerate() {
        let Some(du) = *held else { continue };
        // What a held input does it does; nothing of the rest is taken by it.
        offset += by_input.column(i) * du;
        value.slope += taken.column(i) * du;
        value.slope_before += taken_before.column(i) * du;
        taken.column_mut(i).fill(0.0);
        taken_before.column_mut(i).fill(0.0);
    }
    let transform = transform(by_input, held)?;
    policy.by_state = mul(&transform, &by_state);
    policy.offset = mul(&transform, &offset);
    add_mul(&mut value.slope, &taken, &policy.offset);
    value.by_state = mul(&transpose(&mul(&hessian, a)), a);
    if let Some(bend) = problem.bends.get(k) {
        value.by_state += bend.by_state;
    }
    add_mul(&mut value.by_state, &taken, &policy.by_state);
    if curvature.coupling.is_some() {
        policy.by_before = mul(&transform, &by_before);
        value.by_state_before = mul(&taken, &policy.by_before);
        value.by_before = mul(&taken_before, &policy.by_before);
        add_mul(&mut value.slope_before, &taken_before, &policy.offset);
    }
    for (i, held) in held.iter().enumerate() {
        policy.offset[i] += held.unwrap_or(0.0);
    }
    Ok(())
}

/// What turns the rest of a gradient into policies: `-H^-1` for the free rows; for a held row what the
/// free ones leave of it, over what they leave of its curvature.
#[inline]
fn transform<const NU: usize>(
    mut by_input: SMatrix<f64, NU, NU>,
    held: &[Option<f64>; NU],
) -> Result<SMatrix<f64, NU, NU>, Reason> {
    let mut transform = SMatrix::<f64, NU, NU>::identity();
    for i in (0..NU).filter(|i| held[*i].is_none()) {
        let pivot = by_input[(i, i)];
        let is_positive = pivot > 0.0 && pivot.is_finite();
        if !is_positive {
            return Err(Reason::NotFinite);
        }
        let reciprocal = 1.0 / pivot;
        let mut share = by_input.data.0[i].map(|entry| entry * reciprocal);
        share[i] = 0.0;
        for column in by_input.data.0.iter_mut().chain(&mut transform.data.0) {
            let entry = column[i];
            add_scaled(column, -entry, &share);
            column[i] = entry * reciprocal;
        }
    }
    for i in 0..NU {
        let scale = if held[i].is_none() { -1.0 } else { -1.0 / by_input[(i, i)] };
        for column in &mut transform.data.0 {
            column[i] *= scale;
        }
    }
    Ok(transform)
}
