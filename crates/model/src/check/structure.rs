//! Check of the structure that a model declares: controllable rows, decoupled subsystems.

use super::Entry;
use crate::Matrix;
use crate::model::{Linearized, LinearizedByInput};
use crate::subsystem::Subsystem;

/// The largest derivative by which inputs and the first `controllable` rows of the state move the rows behind these.
/// The column counts states, then inputs.
pub(super) fn uncontrollable_gap<const NS: usize, const NU: usize>(
    driven: &LinearizedByInput<NS, NU>,
    controllable: usize,
    dt_s: f64,
) -> Entry {
    let mut worst = Entry::NONE;
    for row in controllable..NS {
        let by_state = driven.by_state.row(row);
        let by_controllable = by_state.iter().take(controllable).enumerate();
        let by_input = driven.by_input.row(row);
        let by_input = by_input.iter().enumerate().map(|(col, entry)| (NS + col, entry));
        for (col, entry) in by_controllable.chain(by_input) {
            worst = worst.or_worse(size((row, col), entry.abs() / dt_s));
        }
    }
    worst
}

/// The largest derivative by which states, inputs and parameters outside of a subsystem move it; infinite if the
/// subsystems do not hold every row once.
pub(super) fn joint<const NS: usize, const NU: usize, const NP: usize>(
    driven: &LinearizedByInput<NS, NU>,
    linearized: &Linearized<NS, NP>,
    subsystems: &[Subsystem],
    dt_s: f64,
) -> Entry {
    if subsystems.is_empty() {
        return Entry::NONE;
    }
    let holds_all = |rows: fn(&Subsystem) -> &'static [usize], count: usize| {
        let mut all: Vec<usize> = subsystems.iter().flat_map(rows).copied().collect();
        all.sort_unstable();
        all.into_iter().eq(0..count)
    };
    if !holds_all(|subsystem| subsystem.states, NS)
        || !holds_all(|subsystem| subsystem.inputs, NU)
        || !holds_all(|subsystem| subsystem.parameters, NP)
    {
        return size((0, 0), f64::INFINITY);
    }
    let mut worst = Entry::NONE;
    for subsystem in subsystems {
        for row in subsystem.states {
            let by_state = outside(driven.by_state.row(*row).iter(), subsystem.states);
            let by_input = outside(driven.by_input.row(*row).iter(), subsystem.inputs);
            let by_parameter =
                outside(linearized.by_parameter.row(*row).iter(), subsystem.parameters);
            for (col, entry) in [by_state, by_input, by_parameter] {
                worst = worst.or_worse(size((*row, col), entry / dt_s));
            }
        }
    }
    worst
}

/// The largest derivative by which a row of an observation depends on more than one subsystem.
pub(super) fn joint_observation<const NO: usize, const NS: usize>(
    by_state: &Matrix<NO, NS>,
    subsystems: &[Subsystem],
) -> Entry {
    let best = |row: usize| {
        let by_subsystem =
            subsystems.iter().map(|subsystem| outside(by_state.row(row).iter(), subsystem.states));
        let (col, entry) =
            by_subsystem.reduce(|a, b| if b.1 < a.1 { b } else { a }).unwrap_or((0, 0.0));
        size((row, col), entry)
    };
    (0..NO).map(best).fold(Entry::NONE, Entry::or_worse)
}

/// Position and absolute value of the largest of `entries` that is none of `rows`.
fn outside<'a>(entries: impl Iterator<Item = &'a f64>, rows: &[usize]) -> (usize, f64) {
    let others = entries.enumerate().filter(|(row, _)| !rows.contains(row));
    let worst =
        others.map(|(col, entry)| size((0, col), entry.abs())).fold(Entry::NONE, Entry::or_worse);
    (worst.column, worst.gap)
}

/// An entry that should be zero.
fn size(at: (usize, usize), entry: f64) -> Entry {
    Entry::new(at, entry, 0.0)
}

#[cfg(test)]
mod tests {

    use super::*;
    use crate::{Matrix, Vector};

    #[test]
    fn a_row_that_is_controllable_after_all_is_seen() {
        let mut right = LinearizedByInput {
            s_next: Vector::zeros(),
            by_state: Matrix::<3, 3>::identity(),
            by_input: Matrix::<3, 2>::from_row_slice(&[0.5, 0.5, 0.0, 0.0, 0.0, 0.0]),
        };
        // The row behind may move the controllable ones, and itself.
        right.by_state[(0, 2)] = 0.3;
        assert_eq!(uncontrollable_gap(&right, 2, 1.0).gap.to_bits(), 0.0_f64.to_bits());
        let (mut by_state, mut by_input) = (right, right);
        by_state.by_state[(2, 1)] = -0.2;
        by_input.by_input[(2, 1)] = 0.2;
        // The columns of the inputs follow those of the state.
        for (wrong, column) in [(by_state, 1), (by_input, 4)] {
            let worst = uncontrollable_gap(&wrong, 2, 1.0);
            assert!((worst.gap - 0.2).abs() < 1e-15, "{wrong:?}");
            assert_eq!((worst.row, worst.column), (2, column));
            assert_eq!(uncontrollable_gap(&wrong, 3, 1.0).gap.to_bits(), 0.0_f64.to_bits());
        }
        by_input.by_input[(2, 1)] = f64::NAN;
        assert!(uncontrollable_gap(&by_input, 2, 1.0).gap.is_nan());
    }

    #[test]
    fn subsystems_that_are_joined_or_lack_a_row_are_seen() {
        const FIRST: Subsystem = Subsystem { states: &[0, 2], inputs: &[0], parameters: &[1] };
        const SECOND: Subsystem = Subsystem { states: &[1], inputs: &[], parameters: &[0] };
        let driven = LinearizedByInput {
            s_next: Vector::zeros(),
            by_state: Matrix::<3, 3>::identity(),
            by_input: Matrix::<3, 1>::new(0.5, 0.0, 0.1),
        };
        let by_parameter = Matrix::<3, 2>::new(0.0, 1.0, 1.0, 0.0, 0.0, 1.0);
        let LinearizedByInput { s_next, by_state, .. } = driven;
        let linearized = Linearized { s_next, by_state, by_parameter };
        assert_eq!(
            joint(&driven, &linearized, &[FIRST, SECOND], 1.0).gap.to_bits(),
            0.0_f64.to_bits()
        );
        assert_eq!(joint(&driven, &linearized, &[], 1.0).gap.to_bits(), 0.0_f64.to_bits());
        assert!(joint(&driven, &linearized, &[FIRST], 1.0).gap.is_infinite());
        let (mut joined, mut driven_aside, mut shared) = (driven, driven, linearized);
        joined.by_state[(2, 1)] = -0.3;
        driven_aside.by_input[1] = 0.3;
        shared.by_parameter[(1, 1)] = 0.3;
        for gap in [
            joint(&joined, &linearized, &[FIRST, SECOND], 1.0).gap,
            joint(&driven_aside, &linearized, &[FIRST, SECOND], 1.0).gap,
            joint(&driven, &shared, &[FIRST, SECOND], 1.0).gap,
            joint_observation(&Matrix::<1, 3>::new(2.0, 0.3, 1.0), &[FIRST, SECOND]).gap,
        ] {
            assert!((gap - 0.3).abs() < 1e-15, "{gap}");
        }
        let apart = Matrix::<2, 3>::new(2.0, 0.0, 1.0, 0.0, 3.0, 0.0);
        assert_eq!(joint_observation(&apart, &[FIRST, SECOND]).gap.to_bits(), 0.0_f64.to_bits());
    }
}
