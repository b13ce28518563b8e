use nalgebra::SVector;

use super::*;
use crate::check::{Point, model_gap};
use crate::model::Model;

fn leaked(program: Program) -> &'static Program {
    Box::leak(Box::new(program))
}

/// Every function once, in two states, one input and two parameters.
fn everything(size: Option<Dimensions>) -> Program {
    let mut graph = Graph::default();
    let [x, y] = [0, 1].map(|row| graph.variable(Variable::State(row)));
    let u = graph.variable(Variable::Input(0));
    let [a, b] = [0, 1].map(|row| graph.variable(Variable::Parameter(row)));
    let dt = graph.variable(Variable::Period);
    let mut sum = graph.binary(Binary::Mul, a, u);
    // Arguments in (0, 1) suit every function.
    for function in [
        Unary::Neg,
        Unary::Sin,
        Unary::Cos,
        Unary::Tan,
        Unary::Asin,
        Unary::Acos,
        Unary::Atan,
        Unary::Sinh,
        Unary::Cosh,
        Unary::Tanh,
        Unary::Exp,
        Unary::Ln,
        Unary::Sqrt,
        Unary::Abs,
        Unary::Sign,
    ] {
        let inner = graph.binary(Binary::Mul, x, b);
        let term = graph.unary(function, inner);
        sum = graph.binary(Binary::Add, sum, term);
    }
    let mut other = graph.binary(Binary::Div, x, y);
    for function in [
        Binary::Sub,
        Binary::Pow,
        Binary::Atan2,
        Binary::Min,
        Binary::Max,
        Binary::Above,
        Binary::Div,
    ] {
        let term = graph.binary(function, y, a);
        let term = graph.binary(Binary::Mul, term, u);
        other = graph.binary(Binary::Add, other, term);
    }
    let next = [(x, sum), (y, other)].map(|(s, rate)| {
        let change = graph.binary(Binary::Mul, dt, rate);
        graph.binary(Binary::Add, s, change)
    });
    let o = graph.binary(Binary::Mul, x, y);
    let given = Dimensions { states: 2, inputs: 1, observations: 1, parameters: 2 };
    Program::compile_padded(&mut graph, &next, &[o], [given, size.unwrap_or(given)]).unwrap()
}

#[test]
fn derivatives_of_every_function_agree_with_differences() {
    let model = Compiled::<2, 1, 1, 2>::new(leaked(everything(None))).unwrap();
    for (x, y) in [(0.3, 0.7), (0.6, 0.2), (0.8, 0.9)] {
        let (s, u, p) = (SVector::from([x, y]), SVector::from([0.4]), SVector::from([0.5, 0.9]));
        let gap = model_gap(&model, &Point { s, u, p, dt_s: 0.1 });
        assert!(gap.gap < 1e-8, "{gap}");
    }
}

#[test]
fn rows_beyond_those_of_the_program_are_zero() {
    let small = Compiled::<2, 1, 1, 2>::new(leaked(everything(None))).unwrap();
    let small = small.step(&[0.3, 0.7].into(), &[0.4].into(), &[0.5, 0.9].into(), 0.1);
    let size = Dimensions { states: 4, inputs: 2, observations: 3, parameters: 3 };
    let program = leaked(everything(Some(size)));
    let model = Compiled::<4, 2, 3, 3>::new(program).unwrap();
    let wide = model.linearize(
        &[0.3, 0.7, 5.0, 5.0].into(),
        &[0.4, 5.0].into(),
        &[0.5, 0.9, 5.0].into(),
        0.1,
    );
    assert_eq!(wide.s_next.as_slice(), [small[0], small[1], 0.0, 0.0]);
    assert!(
        wide.by_state
            .columns(2, 2)
            .iter()
            .chain(wide.by_parameter.column(2).iter())
            .all(|entry| *entry == 0.0)
    );
    let o = model.observe(&[0.3, 0.7, 5.0, 5.0].into());
    assert!(Compiled::<2, 1, 1, 2>::new(program).is_none(), "another size");
    assert_eq!(o.as_slice(), [0.3 * 0.7, 0.0, 0.0]);
}

#[test]
fn equal_terms_are_one_and_constants_are_folded() {
    let mut graph = Graph::default();
    let x = graph.variable(Variable::State(0));
    let two = graph.constant(2.0);
    let (a, b) = (graph.binary(Binary::Mul, x, two), graph.binary(Binary::Mul, two, x));
    assert_eq!(a, b);
    let difference = graph.binary(Binary::Sub, a, b);
    assert_eq!(graph.number(difference), Some(0.0));
    let four = graph.binary(Binary::Pow, two, two);
    assert_eq!(graph.number(four), Some(4.0));
    let tape = compile(&graph, &[a, difference]).unwrap();
    assert_eq!(tape.registers(), 6, "x, the period, the zero, 2, 0 and 2x");
}

#[test]
fn a_model_that_is_too_long_is_refused() {
    let mut graph = Graph::default();
    let mut sum = graph.variable(Variable::State(0));
    for k in 0..REGISTERS_MAX {
        let constant = graph.constant(k as f64 + 0.5);
        let scaled = graph.binary(Binary::Mul, sum, constant);
        sum = graph.unary(Unary::Sin, scaled);
    }
    let error = compile(&graph, &[sum]).unwrap_err();
    assert_eq!(error.registers, 3 * REGISTERS_MAX + 3, "the state, the period and the zero, too");
}

/// The expressions of one state as a column.
fn compile(graph: &Graph, column: &[Id]) -> Result<Tape<1>, TooLong> {
    let layout = Layout { states: 1, inputs: 0, parameters: 0 };
    Tape::compile(graph, layout, [Entries::new(column, 1, (column.len(), 1))])
}

#[test]
fn two_functions_in_one_instruction_round_as_two() {
    use Binary::{Add, Div, Mul, Sub};
    let mut graph = Graph::default();
    let s = [0, 1, 2].map(|row| graph.variable(Variable::State(row)));
    let (product, ratio) = (graph.binary(Mul, s[0], s[1]), graph.binary(Div, s[0], s[1]));
    let (sin, cos) = (graph.unary(Unary::Sin, s[2]), graph.unary(Unary::Cos, s[2]));
    let pairs = [
        (Add, product, s[2]),
        (Add, s[2], product),
        (Sub, product, s[2]),
        (Sub, s[2], product),
        (Mul, product, s[2]),
        (Mul, s[2], ratio),
        (Div, ratio, s[2]),
        (Add, cos, sin),
    ];
    let layout = Layout { states: 3, inputs: 0, parameters: 0 };
    let s = SVector::from([0.1, 0.7, 1.3]);
    for (function, a, b) in pairs {
        let of = [graph.binary(function, a, b)];
        let tape = Tape::compile(&graph, layout, [Entries::new(&of, 1, (1, 1))]).unwrap();
        let expected = graph.value(of[0], &|variable| match variable {
            Variable::State(row) => s[row],
            _ => 0.0,
        });
        let nothing = SVector::zeros();
        let value: SVector<f64, 1> = tape.evaluate::<_, 3, 0, 0>((&s, &nothing, &nothing, 0.1));
        assert_eq!(value[0].to_bits(), expected.to_bits(), "{function:?} of {a:?} and {b:?}");
        // Three variables, the period, the zero, and one result or sine, cosine and their sum.
        let results = if function == Add && a == cos { 3 } else { 1 };
        let is_whole = function != Div;
        assert_eq!(tape.registers(), 5 + results + usize::from(!is_whole), "{function:?}");
    }
}

#[test]
fn a_sign_goes_into_the_sum() {
    use Binary::{Add, Div, Mul, Sub};
    let mut graph = Graph::default();
    let [x, y] = [0, 1].map(|row| graph.variable(Variable::State(row)));
    let minus = graph.unary(Unary::Neg, x);
    let (product, negated) = (graph.binary(Mul, x, y), graph.binary(Mul, minus, y));
    let (ratio, opposite) = (graph.binary(Div, y, x), graph.binary(Div, y, minus));
    for (term, opposite) in [(x, minus), (product, negated), (ratio, opposite)] {
        let (sum, difference) = (graph.binary(Add, y, term), graph.binary(Sub, y, term));
        assert_eq!(graph.binary(Sub, y, opposite), sum);
        assert_eq!(graph.binary(Add, y, opposite), difference);
        assert_eq!(graph.binary(Add, opposite, y), difference);
    }
}
