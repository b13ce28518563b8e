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

use nalgebra::{ArrayStorage, SMatrix, SVector};

use super::product::{add_scaled, mul, tr_mul, transpose};
use crate::qp::{Curvature, Problem, Reason};

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

/// Gradient by the inputs of a step, `by_input du + by_state ds + by_before dv + offset`.
struct Slope<const NS: usize, const NU: usize> {
    by_input: SMatrix<f64, NU, NU>,
    by_state: SMatrix<f64, NU, NS>,
    by_before: SMatrix<f64, NU, NU>,
    offset: SVector<f64, NU>,
}

impl<const NS: usize, const NU: usize> Slope<NS, NU> {
    /// Solves row `i` for input `i` and puts the result into the other rows.
    #[inline]
    fn solve_row(&mut self, i: usize, reciprocal: f64) {
        let mut share = self.by_input.data.0[i].map(|entry| entry * reciprocal);
        share[i] = 0.0;
        let columns = self.by_input.data.0.iter_mut().chain(&mut self.by_state.data.0);
        for column in columns.chain(&mut self.by_before.data.0).chain(&mut self.offset.data.0) {
            let entry = column[i];
            add_scaled(column, -entry, &share);
            column[i] = entry * reciprocal;
        }
    }
}

/// Policy of step `k` and value before it, from the value after it.
///
/// `held[i]` is the step that a held input takes, `None` for a free one.
///
/// # Errors
/// A pivot is not positive, or not finite.
#[inline]
pub(super) fn eliminate<const NS: usize, const NU: usize>(
    k: usize,
    problem: &Problem<'_, NS, NU>,
    curvature: &Curvature<NS, NU>,
    held: &[Option<f64>; NU],
    next: &Value<NS, NU>,
) -> Result<(Policy<NS, NU>, Value<NS, NU>), Reason> {
    let stage = &problem.stages[k];
    let (a, b) = (&stage.by_state, &stage.by_input);
    let mut hessian = next.by_state;
    for i in 0..NS {
        hessian[(i, i)] += curvature.diagonal.s[k][i];
    }
    let slope_next = next.slope + problem.gradient.s[k];

    let mut by_input_next = mul(&hessian, b);
    if curvature.coupling.is_some() {
        by_input_next += next.by_state_before;
    }
    let by_input_next = transpose(&by_input_next);
    let mut slope = Slope {
        by_input: mul(&by_input_next, b),
        by_state: mul(&by_input_next, a),
        by_before: SMatrix::zeros(),
        offset: problem.gradient.u[k] + tr_mul(b, &slope_next),
    };
    for i in 0..NU {
        slope.by_input[(i, i)] += curvature.diagonal.u[k][i];
    }
    let mut value = Value {
        by_state: mul(&transpose(&mul(&hessian, a)), a),
        slope: tr_mul(a, &slope_next),
        ..Value::zeros()
    };
    if let Some(coupling) = &curvature.coupling {
        slope.by_input += mul(&transpose(b), &next.by_state_before) + next.by_before;
        slope.offset += next.slope_before;
        for i in 0..NU {
            slope.by_before[(i, i)] = coupling[i];
        }
    }

    for (i, held) in held.iter().enumerate() {
        let Some(du) = *held else { continue };
        add_scaled(&mut slope.offset.data.0[0], du, &slope.by_input.data.0[i]);
        for c in 0..NS {
            value.slope[c] += du * slope.by_state[(i, c)];
        }
        value.slope_before[i] += du * slope.by_before[(i, i)];
    }
    for (i, held) in held.iter().enumerate() {
        if held.is_some() {
            continue;
        }
        let pivot = slope.by_input[(i, i)];
        let is_positive = pivot > 0.0 && pivot.is_finite();
        if !is_positive {
            return Err(Reason::NotFinite);
        }
        let reciprocal = 1.0 / pivot;
        let row: [f64; NS] = std::array::from_fn(|c| slope.by_state[(i, c)]);
        let offset = slope.offset[i] * reciprocal;
        for (column, entry) in value.by_state.data.0.iter_mut().zip(row) {
            add_scaled(column, -entry * reciprocal, &row);
        }
        add_scaled(&mut value.slope.data.0[0], -offset, &row);
        if curvature.coupling.is_some() {
            let row_before: [f64; NU] = std::array::from_fn(|c| slope.by_before[(i, c)]);
            for (column, entry) in value.by_state_before.data.0.iter_mut().zip(row_before) {
                add_scaled(column, -entry * reciprocal, &row);
            }
            for (column, entry) in value.by_before.data.0.iter_mut().zip(row_before) {
                add_scaled(column, -entry * reciprocal, &row_before);
            }
            add_scaled(&mut value.slope_before.data.0[0], -offset, &row_before);
        }
        slope.solve_row(i, reciprocal);
    }
    for col in 1..NS {
        for row in 0..col {
            value.by_state[(row, col)] = value.by_state[(col, row)];
        }
    }
    Ok((policy(&slope, held), value))
}

/// The policy of a gradient whose free rows are solved.
#[inline]
fn policy<const NS: usize, const NU: usize>(
    slope: &Slope<NS, NU>,
    held: &[Option<f64>; NU],
) -> Policy<NS, NU> {
    let scale = SVector::<f64, NU>::from_fn(|i, _| match held[i] {
        Some(_) => -1.0 / slope.by_input[(i, i)],
        None => -1.0,
    });
    let held = SVector::from_fn(|i, _| held[i].unwrap_or(0.0));
    let scaled = |column: &[f64; NU]| std::array::from_fn(|i| scale[i] * column[i]);
    Policy {
        by_state: SMatrix::from_data(ArrayStorage(slope.by_state.data.0.map(|c| scaled(&c)))),
        by_before: SMatrix::from_data(ArrayStorage(slope.by_before.data.0.map(|c| scaled(&c)))),
        offset: held + slope.offset.component_mul(&scale),
    }
}
