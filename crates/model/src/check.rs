//! Numeric check of a model: which entry disagrees most, a derivative with central differences, or a function with
//! another.

mod equalities;
mod structure;

use std::fmt;

use crate::differences;
use crate::model::{HessianKind, HessianRequest, Linearized, LinearizedByInput, Model};
use crate::row::Row;
use crate::{Matrix, Vector};

/// Arguments at which a model is checked.
#[derive(Debug, Clone, Copy)]
pub struct Point<const NS: usize, const NU: usize, const NP: usize> {
    /// State. Unit of each row
    pub s: Vector<NS>,
    /// Input. Unit of each row
    pub u: Vector<NU>,
    /// Parameter. Unit of each row
    pub p: Vector<NP>,
    /// Period. s
    pub dt_s: f64,
}

/// One entry of a derivative, or of a function, beside its numeric value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Entry {
    /// Row of the matrix, from 0.
    pub row: usize,
    /// Column of the matrix, from 0.
    pub column: usize,
    /// What the model returns. Unit of the row / unit of the column
    pub given: f64,
    /// What it should be, by central differences or by the function that must agree. Unit of the row / unit of the
    /// column
    pub numeric: f64,
    /// `|given - numeric| / max(1, |numeric|)`; NaN if either is. 1
    pub gap: f64,
}

impl Entry {
    /// Agreement: where a search for the largest gap begins.
    const NONE: Self = Self { row: 0, column: 0, given: 0.0, numeric: 0.0, gap: 0.0 };

    fn new((row, column): (usize, usize), given: f64, numeric: f64) -> Self {
        let gap = (given - numeric).abs() / numeric.abs().max(1.0);
        Self { row, column, given, numeric, gap }
    }

    /// The entry with the larger gap. A NaN is the largest: `f64::max` would drop it.
    fn or_worse(self, other: Self) -> Self {
        let is_worse = other.gap > self.gap || (other.gap.is_nan() && !self.gap.is_nan());
        if is_worse { other } else { self }
    }
}

/// The entry of a model that disagrees most with what it should be, see [`model_gap`].
///
/// Displayed as `step_by_state[y, theta] = 0.1, by differences -0.1: gap 2e-1`; rows without a name are shown
/// by their number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    /// Function or constant of [`Model`] that returns the entry, e.g. `"step_by_state"`; empty if every entry agrees
    /// to the last bit.
    pub derivative: &'static str,
    /// Name of the row of the entry.
    pub row_name: &'static str,
    /// Name of its column.
    pub column_name: &'static str,
    /// The entry. Entries of steps are divided by the period.
    pub entry: Entry,
    /// Largest relative gap, that of the entry; NaN if any is, infinite if [`Model::subsystems`] does not hold every
    /// row once. 1
    pub gap: f64,
}

impl fmt::Display for Gap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { derivative, row_name, column_name, entry, gap } = self;
        let Entry { row, column, given, numeric, .. } = entry;
        let label = |f: &mut fmt::Formatter<'_>, name: &str, index: usize| {
            if name == Row::UNNAMED.name { write!(f, "{index}") } else { f.write_str(name) }
        };
        if derivative.is_empty() {
            return f.write_str("every derivative agrees");
        }
        write!(f, "{derivative}[")?;
        label(f, row_name, *row)?;
        f.write_str(", ")?;
        label(f, column_name, *column)?;
        let source =
            if equalities::NAMES.contains(derivative) { "expected" } else { "by differences" };
        write!(f, "] = {given}, {source} {numeric}: gap {gap:e}")
    }
}

/// The larger number; NaN if either is: IEEE 754 `maximum`. `f64::max` returns the other number, so a comparison that
/// accumulates gaps with it accepts NaN.
///
/// ```
/// use horizon_model::check::maximum;
///
/// assert!([0.1, f64::NAN, 0.2].into_iter().fold(0.0, maximum).is_nan());
/// ```
pub fn maximum(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

/// The smaller number; NaN if either is: IEEE 754 `minimum`, as [`maximum`].
///
/// ```
/// use horizon_model::check::minimum;
///
/// assert!([0.1, f64::NAN, 0.2].into_iter().fold(f64::INFINITY, minimum).is_nan());
/// ```
pub fn minimum(a: f64, b: f64) -> f64 {
    -maximum(-a, -b)
}

/// Largest absolute value; NaN if any is. `nalgebra`'s function of this name returns a NaN only from the last entry.
///
/// ```
/// use horizon_model::check::amax;
/// use nalgebra::Vector3;
///
/// assert!(amax(&Vector3::new(f64::NAN, 1.0, -2.0)).is_nan());
/// assert_eq!(amax(&Vector3::new(0.0, 1.0, -2.0)), 2.0);
/// ```
pub fn amax<'a>(entries: impl IntoIterator<Item = &'a f64>) -> f64 {
    entries.into_iter().map(|entry| entry.abs()).fold(0.0, maximum)
}

/// Largest relative gap between `exact` and central differences of `f` at `x`; NaN if any is.
///
/// A gap is relative to the larger of 1 and the numeric derivative.
pub fn jacobian_gap<const M: usize, const N: usize>(
    f: impl Fn(&Vector<N>) -> Vector<M>,
    x: &Vector<N>,
    exact: &Matrix<M, N>,
) -> f64 {
    worst_entry(f, (x, &[Row::UNNAMED; N]), exact).gap
}

/// The entry of `exact` with the largest gap to central differences of `f` at `x`, whose rows are `rows`.
fn worst_entry<const M: usize, const N: usize>(
    f: impl Fn(&Vector<N>) -> Vector<M>,
    (x, rows): (&Vector<N>, &[Row; N]),
    exact: &Matrix<M, N>,
) -> Entry {
    worst_of(exact, &differences::jacobian_of_rows(f, x, rows))
}

/// The entry of `given` with the largest gap to `numeric`.
fn worst_of<const M: usize, const N: usize>(given: &Matrix<M, N>, numeric: &Matrix<M, N>) -> Entry {
    let entries = (0..N).flat_map(|col| (0..M).map(move |row| (row, col)));
    entries.map(|at| Entry::new(at, given[at], numeric[at])).fold(Entry::NONE, Entry::or_worse)
}

/// Entry of `model` that disagrees most with what it should be, at one point.
///
/// Checked are the four Jacobians, that of [`Model::coasting`], those of [`Model::linearize`] and
/// [`Model::linearize_by_input`], the Hessians if the model has them, the rows behind [`Model::CONTROLLABLE`], which
/// neither inputs nor controllable rows may move, and [`Model::subsystems`], which must not be coupled. Derivatives are
/// compared with central differences.
///
/// Functions that must agree with others are compared with these: [`Model::prepared`] with the model, `core` with the
/// step at the effective input, `effect` of `input_for` with the effect, and the observation of [`Model::at_rest`] with
/// that of `s`. A state that is not at rest may be observed as none at rest is, if velocities are observed and
/// `at_rest` is overridden: check such a model at rest.
///
/// Steps are divided by the period, so that an entry of order `dt_s` is checked as strictly as one of order 1. A
/// right first derivative has a gap of about 1e-10 to 1e-8 if rows are of order 1 or positive; elsewhere the
/// differences are wrong ([`crate::differences`]), and a right derivative has a large gap. A gap is relative to the
/// larger of 1 and the numeric derivative: a wrong sign of an entry of 1e-9 is a gap of 2e-9. Choose units that make
/// entries large.
pub fn model_gap<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
    model: &M,
    at: &Point<NS, NU, NP>,
) -> Gap
where
    M: Model<NS, NU, NO, NP>,
{
    let mut check = Check { worst: None };
    let Point { s, u, p, dt_s } = at;
    check_steps(&mut check, model, at);
    let observed = model.observe_by_state(s);
    let entry = worst_entry(|s| model.observe(s), (s, &M::STATE), &observed);
    check.observe("observe_by_state", entry, (&M::OBSERVATION, &M::STATE));
    let coasting = model.coasting_by_state(s, p);
    let entry = worst_entry(|s| model.coasting(s, p), (s, &M::STATE), &coasting);
    check.observe("coasting_by_state", entry, (&M::OBSERVATION, &M::STATE));
    check_hessians(&mut check, model, at);
    equalities::check(&mut check, model, at);

    let driven = model.linearize_by_input(s, u, p, *dt_s);
    let linearized = model.linearize(s, u, p, *dt_s);
    let entry = structure::uncontrollable_gap(&driven, M::CONTROLLABLE, *dt_s);
    check.observe("CONTROLLABLE", entry, (&M::STATE, &[]));
    let mut subsystems = Vec::new();
    M::subsystems(&mut subsystems);
    let entry = structure::joint(&driven, &linearized, &subsystems, *dt_s);
    check.observe("subsystems", entry, (&M::STATE, &[]));
    let entry = structure::joint_observation(&observed, &subsystems);
    check.observe("subsystems", entry, (&M::OBSERVATION, &M::STATE));
    check.worst.unwrap_or(Gap {
        derivative: "",
        row_name: "",
        column_name: "",
        entry: Entry::NONE,
        gap: 0.0,
    })
}

/// Checks the Jacobians of the step, and both linearizations, by differences.
fn check_steps<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
    check: &mut Check,
    model: &M,
    at: &Point<NS, NU, NP>,
) where
    M: Model<NS, NU, NO, NP>,
{
    let Point { s, u, p, dt_s } = at;
    let (states, inputs, parameters) = (&M::STATE[..], &M::INPUT[..], &M::PARAMETER[..]);
    let scaled_step = |s: &_, u: &_, p: &_| model.step(s, u, p, *dt_s) / *dt_s;
    let s_next = scaled_step(s, u, p);
    let by_state = differences::jacobian_of_rows(|s| scaled_step(s, u, p), s, &M::STATE);
    let by_input = differences::jacobian_of_rows(|u| scaled_step(s, u, p), u, &M::INPUT);
    let by_parameter = differences::jacobian_of_rows(|p| scaled_step(s, u, p), p, &M::PARAMETER);

    // What a user writes comes first: of equal gaps the first is reported, and the others follow from it.
    let given = model.step_by_state(s, u, p, *dt_s) / *dt_s;
    check.compare("step_by_state", (&given, &by_state), (states, states));
    let given = model.step_by_input(s, u, p, *dt_s) / *dt_s;
    check.compare("step_by_input", (&given, &by_input), (states, inputs));
    let given = model.step_by_parameter(s, u, p, *dt_s) / *dt_s;
    check.compare("step_by_parameter", (&given, &by_parameter), (states, parameters));

    let expected = LinearizedByInput { s_next, by_state, by_input };
    let given = driven_by_period(model, at);
    check.linearized_by_input("linearize_by_input", (&given, &expected), (states, inputs));
    let expected = Linearized { s_next, by_state, by_parameter };
    let given = linearized_by_period(model, at);
    check.linearized("linearize", (&given, &expected), (states, parameters));
}

/// [`Model::linearize`], each entry divided by the period.
fn linearized_by_period<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
    model: &M,
    Point { s, u, p, dt_s }: &Point<NS, NU, NP>,
) -> Linearized<NS, NP>
where
    M: Model<NS, NU, NO, NP>,
{
    let Linearized { s_next, by_state, by_parameter } = model.linearize(s, u, p, *dt_s);
    Linearized {
        s_next: s_next / *dt_s,
        by_state: by_state / *dt_s,
        by_parameter: by_parameter / *dt_s,
    }
}

/// [`Model::linearize_by_input`], each entry divided by the period.
fn driven_by_period<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
    model: &M,
    Point { s, u, p, dt_s }: &Point<NS, NU, NP>,
) -> LinearizedByInput<NS, NU>
where
    M: Model<NS, NU, NO, NP>,
{
    let LinearizedByInput { s_next, by_state, by_input } = model.linearize_by_input(s, u, p, *dt_s);
    LinearizedByInput {
        s_next: s_next / *dt_s,
        by_state: by_state / *dt_s,
        by_input: by_input / *dt_s,
    }
}

/// The worst entry so far.
struct Check {
    worst: Option<Gap>,
}

impl Check {
    /// Keeps the entry of `given` with the largest gap to `expected`, if it is worse.
    fn compare<const R: usize, const C: usize>(
        &mut self,
        derivative: &'static str,
        (given, expected): (&Matrix<R, C>, &Matrix<R, C>),
        names: (&[Row], &[Row]),
    ) {
        self.observe(derivative, worst_of(given, expected), names);
    }

    /// [`Check::compare`] of a step and its Jacobians.
    fn linearized<const NS: usize, const NP: usize>(
        &mut self,
        derivative: &'static str,
        (given, expected): (&Linearized<NS, NP>, &Linearized<NS, NP>),
        (states, parameters): (&[Row], &[Row]),
    ) {
        self.compare(derivative, (&given.s_next, &expected.s_next), (states, &[]));
        self.compare(derivative, (&given.by_state, &expected.by_state), (states, states));
        let by_parameter = (&given.by_parameter, &expected.by_parameter);
        self.compare(derivative, by_parameter, (states, parameters));
    }

    /// [`Check::compare`] of a step and its Jacobians.
    fn linearized_by_input<const NS: usize, const NU: usize>(
        &mut self,
        derivative: &'static str,
        (given, expected): (&LinearizedByInput<NS, NU>, &LinearizedByInput<NS, NU>),
        (states, inputs): (&[Row], &[Row]),
    ) {
        self.compare(derivative, (&given.s_next, &expected.s_next), (states, &[]));
        self.compare(derivative, (&given.by_state, &expected.by_state), (states, states));
        self.compare(derivative, (&given.by_input, &expected.by_input), (states, inputs));
    }

    /// Keeps `entry` of `derivative` if it is worse; `rows` and `columns` are named by the model.
    fn observe(
        &mut self,
        derivative: &'static str,
        entry: Entry,
        (rows, columns): (&[Row], &[Row]),
    ) {
        let before = self.worst.map_or(Entry::NONE, |worst| worst.entry);
        if before.or_worse(entry) == before || before.gap.is_nan() {
            return;
        }
        let name = |rows: &[Row], index: usize| rows.get(index).unwrap_or(&Row::UNNAMED).name;
        self.worst = Some(Gap {
            derivative,
            row_name: name(rows, entry.row),
            column_name: name(columns, entry.column),
            entry,
            gap: entry.gap,
        });
    }
}

/// Checks [`Model::hessian_by_parameter`] and [`Model::hessian_by_input`] as derivatives of the Jacobians.
fn check_hessians<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
    check: &mut Check,
    model: &M,
    at: &Point<NS, NU, NP>,
) where
    M: Model<NS, NU, NO, NP>,
{
    let Point { s, u, p, dt_s } = at;
    let (states, inputs, parameters) = (&M::STATE[..], &M::INPUT[..], &M::PARAMETER[..]);
    // Different weights, none of them zero.
    let w = Vector::from_fn(|row, _| 1.0 / (row + 1) as f64) / *dt_s;
    let by_state = |s: &_, p: &_| model.step_by_state(s, u, p, *dt_s).tr_mul(&w);
    let by_input = |s: &_, u: &_| model.step_by_input(s, u, p, *dt_s).tr_mul(&w);
    let by_parameter = |p: &_| model.step_by_parameter(s, u, p, *dt_s).tr_mul(&w);
    if let Some(curvature) = model.hessian_by_parameter(s, u, p, *dt_s, &w) {
        let name = "hessian_by_parameter";
        let entry = worst_entry(|s| by_state(s, p), (s, &M::STATE), &curvature.by_state);
        check.observe(name, entry, (states, states));
        let entry =
            worst_entry(|p| by_state(s, p), (p, &M::PARAMETER), &curvature.by_state_parameter);
        check.observe(name, entry, (states, parameters));
        let entry = worst_entry(by_parameter, (p, &M::PARAMETER), &curvature.by_parameter);
        check.observe(name, entry, (parameters, parameters));
    }
    let step_by_input = model.step_by_input(s, u, p, *dt_s);
    let request = HessianRequest {
        s,
        u,
        p,
        dt_s: *dt_s,
        by_input: &step_by_input,
        w: &w,
        kind: HessianKind::Exact,
    };
    if let Some(curvature) = model.hessian_by_input(&request) {
        let name = "hessian_by_input";
        let entry = worst_entry(|s| by_state(s, p), (s, &M::STATE), &curvature.by_state);
        check.observe(name, entry, (states, states));
        let entry = worst_entry(|s| by_input(s, u), (s, &M::STATE), &curvature.by_input_state);
        check.observe(name, entry, (inputs, states));
        let entry = worst_entry(|u| by_input(s, u), (u, &M::INPUT), &curvature.by_input);
        check.observe(name, entry, (inputs, inputs));
    }
}

#[cfg(test)]
mod tests;
