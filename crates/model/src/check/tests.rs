use crate::{Matrix, Vector};
use nalgebra::Matrix2;

use super::*;

fn turn(x: &Vector<2>) -> Vector<2> {
    Vector::from([x[0] * x[1].sin(), x[0].powi(2)])
}

fn turn_by_x(x: &Vector<2>) -> Matrix<2, 2> {
    Matrix::<2, 2>::new(x[1].sin(), x[0] * x[1].cos(), 2.0 * x[0], 0.0)
}

#[test]
fn the_least_and_the_greatest_keep_a_nan() {
    assert_eq!((minimum(-1.0, 2.0), minimum(2.0, -1.0)), (-1.0, -1.0));
    assert_eq!((maximum(-1.0, 2.0), maximum(2.0, -1.0)), (2.0, 2.0));
    for of in [minimum, maximum] {
        assert!(of(f64::NAN, 1.0).is_nan() && of(1.0, f64::NAN).is_nan());
    }
}

#[test]
fn a_right_jacobian_has_a_small_gap() {
    let x = Vector::from([1.5, 2.5]);
    assert!(jacobian_gap(turn, &x, &turn_by_x(&x)) < 1e-8);
}

#[test]
fn every_flipped_sign_is_seen() {
    let x = Vector::from([1.5, 2.5]);
    for entry in 0..3 {
        let mut wrong = turn_by_x(&x);
        wrong[entry] = -wrong[entry];
        assert!(jacobian_gap(turn, &x, &wrong) > 0.1, "entry {entry}");
    }
}

#[test]
fn a_nan_fails_wherever_it_stands() {
    let x = Vector::from([1.5, 2.5]);
    for entry in 0..4 {
        let mut wrong = turn_by_x(&x);
        wrong[entry] = f64::NAN;
        let gap = jacobian_gap(turn, &x, &wrong);
        assert!(gap.is_nan(), "entry {entry} gives {gap}");
    }
}

/// A pendulum with a switch for the entry of a derivative that is wrong.
#[derive(Debug, Clone, Copy)]
struct Pendulum {
    broken: Option<(usize, usize)>,
}

impl Model<2, 1, 1, 1> for Pendulum {
    const STATE: [Row; 2] = [Row::angle("angle"), Row::linear("rate", "rad/s")];

    fn step(&self, s: &Vector<2>, u: &Vector<1>, p: &Vector<1>, dt_s: f64) -> Vector<2> {
        let rate = s[1] + dt_s * (u[0] - p[0] * s[0].sin());
        Vector::from([s[0] + dt_s * rate, rate])
    }

    fn step_by_state(
        &self,
        s: &Vector<2>,
        _u: &Vector<1>,
        p: &Vector<1>,
        dt_s: f64,
    ) -> Matrix2<f64> {
        let pull = -dt_s * p[0] * s[0].cos();
        let mut j = Matrix2::new(1.0 + dt_s * pull, dt_s, pull, 1.0);
        if let Some(at) = self.broken {
            j[at] += 0.01 * dt_s;
        }
        j
    }

    fn observe(&self, s: &Vector<2>) -> Vector<1> {
        Vector::from([s[0].sin()])
    }
}

fn gap_of(model: &Pendulum) -> Gap {
    let (s, u, p) = ([0.7, -0.3].into(), [0.2].into(), [9.81].into());
    model_gap(model, &Point { s, u, p, dt_s: 0.02 })
}

#[test]
fn the_gap_names_derivative_row_and_column() {
    let right = gap_of(&Pendulum { broken: None });
    assert!(right.gap < 1e-8, "{right}");
    let names = ["angle", "rate"];
    for (row, row_name) in names.iter().enumerate() {
        for (column, column_name) in names.iter().enumerate() {
            let gap = gap_of(&Pendulum { broken: Some((row, column)) });
            // The function that is broken, not those that call it.
            assert_eq!(gap.derivative, "step_by_state");
            assert_eq!((gap.row_name, gap.column_name), (*row_name, *column_name));
            assert_eq!((gap.entry.row, gap.entry.column), (row, column));
            let relative = 0.01 / gap.entry.numeric.abs().max(1.0);
            assert!((gap.gap - relative).abs() < 1e-8, "{gap}");
            let text = gap.to_string();
            let start = format!("step_by_state[{row_name}, {column_name}] = ");
            assert!(text.starts_with(&start), "{text}");
        }
    }
}

/// `s' = s + dt u / p` with an inertia `p`; derivatives by default.
#[derive(Debug, Clone, Copy)]
struct Wheel;

impl Model<1, 1, 1, 1> for Wheel {
    const PARAMETER: [Row; 1] = [Row::positive("inertia", "kg m^2")];

    fn step(&self, s: &Vector<1>, u: &Vector<1>, p: &Vector<1>, dt_s: f64) -> Vector<1> {
        assert!(p[0] > 0.0, "an inertia of {}", p[0]);
        s + u * (dt_s / p[0])
    }

    fn observe(&self, s: &Vector<1>) -> Vector<1> {
        *s
    }
}

#[test]
fn a_positive_row_far_below_one_has_right_differences() {
    for inertia in [1e-2, 1.66e-5, 5e-6, 1e-9] {
        let at =
            Point { s: [0.3].into(), u: [20.0 * inertia].into(), p: [inertia].into(), dt_s: 0.02 };
        let exact = -at.u[0] * at.dt_s / at.p[0].powi(2);
        let given = Wheel.step_by_parameter(&at.s, &at.u, &at.p, at.dt_s)[0];
        assert!((given / exact - 1.0).abs() < 1e-8, "{given}, not {exact}");
        // By the same increments.
        let gap = model_gap(&Wheel, &at);
        assert!(gap.gap < 1e-10, "{inertia}: {gap}");
    }
}

#[test]
fn rows_without_names_are_shown_by_number_and_nan_is_worst() {
    let entry = Entry::new((1, 0), 2.0, 1.0);
    let unnamed = Row::UNNAMED.name;
    let gap = Gap {
        derivative: "step_by_input",
        row_name: unnamed,
        column_name: unnamed,
        entry,
        gap: entry.gap,
    };
    assert_eq!(gap.to_string(), "step_by_input[1, 0] = 2, by differences 1: gap 1e0");
    let broken = Entry::new((0, 0), f64::NAN, 1.0);
    assert!(entry.or_worse(broken).gap.is_nan());
    assert!(broken.or_worse(entry).gap.is_nan());
}

#[test]
fn a_nan_among_numbers_is_the_maximum_wherever_it_stands() {
    for at in 0..4 {
        let mut gaps = [1e-9, -3.0, 2.0, 0.0];
        assert_eq!(amax(&gaps).to_bits(), 3.0_f64.to_bits());
        assert_eq!(gaps.into_iter().fold(0.0, maximum).to_bits(), 2.0_f64.to_bits());
        gaps[at] = f64::NAN;
        assert!(amax(&gaps).is_nan() && gaps.into_iter().fold(0.0, maximum).is_nan(), "at {at}");
    }
}
