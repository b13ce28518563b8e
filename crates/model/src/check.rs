//! Numeric check of hand-written derivatives. Every Jacobian in the project meets this twin.

use nalgebra::{SMatrix, SVector};

use crate::group::Group;
use crate::model::{Bend, Driven, Linearized, Model};

/// Arguments at which a model is checked.
#[derive(Debug, Clone, Copy)]
pub struct Point<const NS: usize, const NU: usize, const NP: usize> {
    /// State.
    pub s: SVector<f64, NS>,
    /// Input.
    pub u: SVector<f64, NU>,
    /// Parameter.
    pub p: SVector<f64, NP>,
    /// Period. s.
    pub dt_s: f64,
}

/// Largest relative gap between `exact` and central differences of `f` at `x`; NaN if any is.
///
/// A gap is relative to the larger of 1 and the numeric slope.
pub fn jacobian_gap<const M: usize, const N: usize>(
    f: impl Fn(&SVector<f64, N>) -> SVector<f64, M>,
    x: &SVector<f64, N>,
    exact: &SMatrix<f64, M, N>,
) -> f64 {
    let mut worst = 0.0_f64;
    for col in 0..N {
        let h = f64::EPSILON.cbrt() * x[col].abs().max(1.0);
        let (mut right, mut left) = (*x, *x);
        right[col] += h;
        left[col] -= h;
        // The difference actually taken: x +- h is rounded.
        let slope = (f(&right) - f(&left)) / (right[col] - left[col]);
        for row in 0..M {
            let gap = (exact[(row, col)] - slope[row]).abs() / slope[row].abs().max(1.0);
            worst = worse(worst, gap);
        }
    }
    worst
}

/// Largest [`jacobian_gap`] of the four Jacobians of `model` at one point, of what its
/// [`Model::linearize`] and [`Model::linearize_drive`] say instead, and of its second derivatives if it
/// has them; a slope by which an input or a reached row moves a row behind [`Model::REACHED`] counts, too, and one
/// that joins two of [`Model::GROUPS`]. NaN if any is.
pub fn model_gap<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
    model: &M,
    at: &Point<NS, NU, NP>,
) -> f64
where
    M: Model<NS, NU, NO, NP>,
{
    let Point { s, u, p, dt_s } = at;
    // In units of the period, so that an entry of order dt_s is checked as strictly as one of 1.
    let scaled_step = |s: &_, u: &_, p: &_| model.step(s, u, p, *dt_s) / *dt_s;
    let linearized = model.linearize(s, u, p, *dt_s);
    let driven = model.linearize_drive(s, u, p, *dt_s);
    [
        (driven.s_next - model.step(s, u, p, *dt_s)).norm() / *dt_s,
        jacobian_gap(|s| scaled_step(s, u, p), s, &(driven.by_state / *dt_s)),
        jacobian_gap(|u| scaled_step(s, u, p), u, &(driven.by_input / *dt_s)),
        (linearized.s_next - model.step(s, u, p, *dt_s)).norm() / *dt_s,
        jacobian_gap(|s| scaled_step(s, u, p), s, &(linearized.by_state / *dt_s)),
        jacobian_gap(|p| scaled_step(s, u, p), p, &(linearized.by_parameter / *dt_s)),
        jacobian_gap(|s| scaled_step(s, u, p), s, &(model.step_by_state(s, u, p, *dt_s) / *dt_s)),
        jacobian_gap(|u| scaled_step(s, u, p), u, &(model.step_by_input(s, u, p, *dt_s) / *dt_s)),
        jacobian_gap(
            |p| scaled_step(s, u, p),
            p,
            &(model.step_by_parameter(s, u, p, *dt_s) / *dt_s),
        ),
        jacobian_gap(|s| model.observe(s), s, &model.observe_by_state(s)),
        curvature_gap(model, at),
        reach(&driven, M::REACHED) / *dt_s,
        joint(&driven, &linearized, M::GROUPS) / *dt_s,
        joint_observation(&model.observe_by_state(s), M::GROUPS),
    ]
    .into_iter()
    .fold(0.0, worse)
}

/// How much the inputs and the first `reached` rows of the state move the rows behind these.
fn reach<const NS: usize, const NU: usize>(driven: &Driven<NS, NU>, reached: usize) -> f64 {
    let mut worst = 0.0;
    for row in reached..NS {
        let by_state = driven.by_state.row(row);
        let by_reached = by_state.iter().take(reached);
        for slope in by_reached.chain(driven.by_input.row(row).iter()) {
            worst = worse(worst, slope.abs());
        }
    }
    worst
}

/// How much of a group is moved by states, inputs and parameters outside of it; infinite if the groups do not hold
/// every row once.
fn joint<const NS: usize, const NU: usize, const NP: usize>(
    driven: &Driven<NS, NU>,
    linearized: &Linearized<NS, NP>,
    groups: &[Group],
) -> f64 {
    if groups.is_empty() {
        return 0.0;
    }
    let holds_all = |rows: fn(&Group) -> &'static [usize], count: usize| {
        let mut all: Vec<usize> = groups.iter().flat_map(rows).copied().collect();
        all.sort_unstable();
        all.into_iter().eq(0..count)
    };
    if !holds_all(|group| group.states, NS)
        || !holds_all(|group| group.inputs, NU)
        || !holds_all(|group| group.parameters, NP)
    {
        return f64::INFINITY;
    }
    let mut worst = 0.0;
    for group in groups {
        for row in group.states {
            let by_state = outside(driven.by_state.row(*row).iter(), group.states);
            let by_input = outside(driven.by_input.row(*row).iter(), group.inputs);
            let by_parameter = outside(linearized.by_parameter.row(*row).iter(), group.parameters);
            worst = [by_state, by_input, by_parameter].into_iter().fold(worst, worse);
        }
    }
    worst
}

/// How much rows of an observation depend on states of more than one group.
fn joint_observation<const NO: usize, const NS: usize>(
    by_state: &SMatrix<f64, NO, NS>,
    groups: &[Group],
) -> f64 {
    let best = |row: usize| {
        let by_group = groups.iter().map(|group| outside(by_state.row(row).iter(), group.states));
        by_group.reduce(f64::min).unwrap_or(0.0)
    };
    (0..NO).map(best).fold(0.0, worse)
}

/// The largest of `entries` that is none of `rows`.
fn outside<'a>(entries: impl Iterator<Item = &'a f64>, rows: &[usize]) -> f64 {
    let others = entries.enumerate().filter(|(row, _)| !rows.contains(row));
    others.map(|(_, entry)| entry.abs()).fold(0.0, worse)
}

/// Largest [`jacobian_gap`] of [`Model::step_curvature`] and [`Model::drive_curvature`] as derivatives of the
/// Jacobians; 0 if the model has none, NaN if any is.
fn curvature_gap<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
    model: &M,
    at: &Point<NS, NU, NP>,
) -> f64
where
    M: Model<NS, NU, NO, NP>,
{
    let Point { s, u, p, dt_s } = at;
    // No two rows weigh the same, none weighs nothing.
    let w = SVector::from_fn(|row, _| 1.0 / (row + 1) as f64) / *dt_s;
    let by_state = |s: &_, p: &_| model.step_by_state(s, u, p, *dt_s).tr_mul(&w);
    let by_input = |s: &_, u: &_| model.step_by_input(s, u, p, *dt_s).tr_mul(&w);
    let by_parameter = |p: &_| model.step_by_parameter(s, u, p, *dt_s).tr_mul(&w);
    let mut worst = 0.0;
    if let Some(curvature) = model.step_curvature(s, u, p, *dt_s, &w) {
        worst = worse(worst, jacobian_gap(|s| by_state(s, p), s, &curvature.by_state));
        worst = worse(worst, jacobian_gap(|p| by_state(s, p), p, &curvature.by_state_parameter));
        worst = worse(worst, jacobian_gap(by_parameter, p, &curvature.by_parameter));
    }
    let along_input = model.step_by_input(s, u, p, *dt_s);
    if let Some(curvature) =
        model.drive_curvature((s, u), p, *dt_s, &along_input, (&w, Bend::Exact))
    {
        worst = worse(worst, jacobian_gap(|s| by_state(s, p), s, &curvature.by_state));
        worst = worse(worst, jacobian_gap(|s| by_input(s, u), s, &curvature.by_input_state));
        worst = worse(worst, jacobian_gap(|u| by_input(s, u), u, &curvature.by_input));
    }
    worst
}

/// The larger of two gaps. `f64::max` would drop a NaN and call a broken Jacobian correct.
fn worse(worst: f64, gap: f64) -> f64 {
    if gap > worst || gap.is_nan() || worst.is_nan() { gap + 0.0 * worst } else { worst }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turn(x: &SVector<f64, 2>) -> SVector<f64, 2> {
        SVector::from([x[0] * x[1].sin(), x[0].powi(2)])
    }

    fn turn_by_x(x: &SVector<f64, 2>) -> SMatrix<f64, 2, 2> {
        SMatrix::<f64, 2, 2>::new(x[1].sin(), x[0] * x[1].cos(), 2.0 * x[0], 0.0)
    }

    #[test]
    fn a_right_jacobian_has_a_small_gap() {
        let x = SVector::from([1.5, 2.5]);
        assert!(jacobian_gap(turn, &x, &turn_by_x(&x)) < 1e-8);
    }

    #[test]
    fn every_flipped_sign_is_seen() {
        let x = SVector::from([1.5, 2.5]);
        for entry in 0..3 {
            let mut wrong = turn_by_x(&x);
            wrong[entry] = -wrong[entry];
            assert!(jacobian_gap(turn, &x, &wrong) > 0.1, "entry {entry}");
        }
    }

    #[test]
    fn a_row_that_is_reached_after_all_is_seen() {
        let mut right = Driven {
            s_next: SVector::zeros(),
            by_state: SMatrix::<f64, 3, 3>::identity(),
            by_input: SMatrix::<f64, 3, 1>::new(0.5, 0.0, 0.0),
        };
        // The row behind may move the reached ones, and itself.
        right.by_state[(0, 2)] = 0.3;
        assert_eq!(reach(&right, 2).to_bits(), 0.0_f64.to_bits());
        let (mut by_state, mut by_input) = (right, right);
        by_state.by_state[(2, 1)] = -0.2;
        by_input.by_input[2] = 0.2;
        for wrong in [by_state, by_input] {
            assert!((reach(&wrong, 2) - 0.2).abs() < 1e-15, "{wrong:?}");
            assert_eq!(reach(&wrong, 3).to_bits(), 0.0_f64.to_bits());
        }
        by_input.by_input[2] = f64::NAN;
        assert!(reach(&by_input, 2).is_nan());
    }

    #[test]
    fn groups_that_are_joined_or_lack_a_row_are_seen() {
        const FIRST: Group = Group { states: &[0, 2], inputs: &[0], parameters: &[1] };
        const SECOND: Group = Group { states: &[1], inputs: &[], parameters: &[0] };
        let driven = Driven {
            s_next: SVector::zeros(),
            by_state: SMatrix::<f64, 3, 3>::identity(),
            by_input: SMatrix::<f64, 3, 1>::new(0.5, 0.0, 0.1),
        };
        let by_parameter = SMatrix::<f64, 3, 2>::new(0.0, 1.0, 1.0, 0.0, 0.0, 1.0);
        let Driven { s_next, by_state, .. } = driven;
        let linearized = Linearized { s_next, by_state, by_parameter };
        assert_eq!(joint(&driven, &linearized, &[FIRST, SECOND]).to_bits(), 0.0_f64.to_bits());
        assert_eq!(joint(&driven, &linearized, &[]).to_bits(), 0.0_f64.to_bits());
        assert!(joint(&driven, &linearized, &[FIRST]).is_infinite());
        let (mut joined, mut driven_aside, mut shared) = (driven, driven, linearized);
        joined.by_state[(2, 1)] = -0.3;
        driven_aside.by_input[1] = 0.3;
        shared.by_parameter[(1, 1)] = 0.3;
        for gap in [
            joint(&joined, &linearized, &[FIRST, SECOND]),
            joint(&driven_aside, &linearized, &[FIRST, SECOND]),
            joint(&driven, &shared, &[FIRST, SECOND]),
            joint_observation(&SMatrix::<f64, 1, 3>::new(2.0, 0.3, 1.0), &[FIRST, SECOND]),
        ] {
            assert!((gap - 0.3).abs() < 1e-15, "{gap}");
        }
        let apart = SMatrix::<f64, 2, 3>::new(2.0, 0.0, 1.0, 0.0, 3.0, 0.0);
        assert_eq!(joint_observation(&apart, &[FIRST, SECOND]).to_bits(), 0.0_f64.to_bits());
    }

    #[test]
    fn a_nan_fails_wherever_it_stands() {
        let x = SVector::from([1.5, 2.5]);
        for entry in 0..4 {
            let mut wrong = turn_by_x(&x);
            wrong[entry] = f64::NAN;
            let gap = jacobian_gap(turn, &x, &wrong);
            assert!(gap.is_nan(), "entry {entry} gives {gap}");
        }
    }
}
