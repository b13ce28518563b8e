use super::super::compare::{Tally, ValidationFlight};
use super::super::predict::AddErrors;
use super::super::report::tests::fit;
use super::*;

/// A forecast of nothing.
struct Nothing;

impl AddErrors for Nothing {
    fn add_errors_to(&self, _: &ValidationFlight, _: &mut Tally, _: usize) {}
}

/// A fit with pieces of these logs and steps.
fn result(pieces: &[(usize, std::ops::Range<usize>)]) -> FitResult {
    let trace = |(log, steps): &(usize, std::ops::Range<usize>)| Trace {
        log: *log,
        steps: steps.clone(),
        s: Vec::new(),
        simulated: Vec::new(),
        transition_residuals: Vec::new(),
        observation_residuals: Vec::new(),
    };
    FitResult {
        fit: fit(),
        state_rows: &Kinematic::STATE,
        observation_rows: &Kinematic::OBSERVATION,
        traces: pieces.iter().map(trace).collect(),
        resamples: None,
        delay: Vec::new(),
        has_converged: true,
        parameter_file: None,
        predict: Box::new(Nothing),
    }
}

#[test]
fn the_log_that_is_drawn_has_the_most_steps_and_is_the_first_of_equals() {
    for (pieces, expected) in [
        (&[][..], None),
        (&[(0, 0..10)][..], Some((0, 1))),
        (&[(0, 0..10), (1, 0..6), (1, 8..14)], Some((1, 2))),
        (&[(0, 0..10), (1, 0..5), (1, 8..13)], Some((0, 1))),
        (&[(2, 0..10)], Some((2, 1))),
    ] {
        let result = result(pieces);
        let found = longest(&result).map(|(log, traces)| (log, traces.len()));
        assert_eq!(found, expected, "{pieces:?}");
    }
}

#[test]
fn the_scale_is_that_of_least_squares_over_what_is_known() {
    let scale = |values: &[f64], goal: &[f64]| scale_between(values.iter().copied(), goal);
    for (values, goal, expected) in [
        (&[1.0, 2.0][..], &[3.0, 6.0][..], 3.0),
        (&[1.0, 2.0], &[-0.5, -1.0], -0.5),
        (&[1.0, 1.0], &[1.0, 3.0], 2.0),
        (&[1.0, 9.0], &[3.0, f64::NAN], 3.0),
        // A vehicle that stands has no scale.
        (&[0.0, 0.0], &[1.0, 2.0], 1.0),
        (&[], &[], 1.0),
    ] {
        let found = scale(values, goal);
        assert!((found - expected).abs() < 1e-12, "{found} of {values:?} and {goal:?}");
    }
}

#[test]
fn a_minute_is_drawn() {
    assert_eq!((steps_shown(0.02), steps_shown(0.1)), (3000, 600));
}

#[test]
fn a_log_is_called_by_its_file() {
    assert_eq!(file_name(Path::new("logs/2026/a.log")), "a.log");
    assert_eq!(file_name(Path::new("/")), "");
}
