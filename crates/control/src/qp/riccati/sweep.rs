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

use crate::qp::product::{add_mul, add_scaled, mul, tr_mul, transpose};
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
    let coupling = curvature.coupling.get(k);
    if coupling.is_some() {
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
    let by_before = coupling.map_or(SMatrix::zeros(), SMatrix::from_diagonal);

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
    if coupling.is_some() {
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
    if held.iter().all(Option::is_none) {
        // The common case: without a choice in it the loop unrolls.
        let mut is_valley = true;
        for i in 0..NU {
            is_valley &= is_pivot(by_input[(i, i)]);
            invert(&mut by_input, i);
        }
        return if is_valley { Ok(by_input) } else { Err(Reason::NotFinite) };
    }
    for i in (0..NU).filter(|i| held[*i].is_none()) {
        if !is_pivot(by_input[(i, i)]) {
            return Err(Reason::NotFinite);
        }
        invert(&mut by_input, i);
    }
    let mut transform = by_input;
    for i in (0..NU).filter(|i| held[*i].is_some()) {
        let scale = 1.0 / by_input[(i, i)];
        for j in 0..NU {
            // A held row moves no other one.
            transform[(j, i)] = 0.0;
            if held[j].is_none() {
                transform[(i, j)] *= scale;
            }
        }
        transform[(i, i)] = -scale;
    }
    Ok(transform)
}

/// Whether a row with this curvature has a lowest point.
#[inline]
fn is_pivot(pivot: f64) -> bool {
    pivot > 0.0 && pivot.is_finite()
}

/// Solves row `i` of `y = m x` for `x_i` and puts that into the others: `x_i` and `-y_i` change places
/// (the sweep operator of Beaton, 1964). Of symmetric `m` it leaves a symmetric matrix, `-m^-1` after
/// all rows.
#[inline]
fn invert<const NU: usize>(m: &mut SMatrix<f64, NU, NU>, i: usize) {
    let reciprocal = 1.0 / m[(i, i)];
    let column = m.data.0[i];
    let mut share = column.map(|entry| entry * reciprocal);
    for (j, entries) in m.data.0.iter_mut().enumerate() {
        if j != i {
            add_scaled(entries, -column[j], &share);
            entries[i] = share[j];
        }
    }
    share[i] = -reciprocal;
    m.data.0[i] = share;
}
