use super::*;
use crate::{Matrix, Vector};

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
    // The state, the period and the zero, too.
    assert_eq!(error, CompileError::TooLong { registers: 3 * REGISTERS_MAX + 3 });
}

/// The expressions of one state as a column.
fn compile(graph: &Graph, column: &[Id]) -> Result<Tape<1>, CompileError> {
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
    let s = Vector::from([0.1, 0.7, 1.3]);
    for (function, a, b) in pairs {
        let of = [graph.binary(function, a, b)];
        let tape = Tape::compile(&graph, layout, [Entries::new(&of, 1, (1, 1))]).unwrap();
        let expected = graph.value(of[0], &|variable| match variable {
            Variable::State(row) => s[row],
            _ => 0.0,
        });
        let nothing = Vector::zeros();
        let value: Vector<1> = tape.evaluate::<_, 3, 0, 0>((&s, &nothing, &nothing, 0.1));
        assert_eq!(value[0].to_bits(), expected.to_bits(), "{function:?} of {a:?} and {b:?}");
        // Three variables, the period, the zero, and one result or sine, cosine and their sum.
        let results = if function == Add && a == cos { 3 } else { 1 };
        let is_whole = function != Div;
        assert_eq!(tape.registers(), 5 + results + usize::from(!is_whole), "{function:?}");
    }
}

#[test]
fn every_number_of_registers_gives_the_value_of_the_graph() {
    for terms in [1_u32, 8, 20, 50, 200, 900, 2000] {
        let mut graph = Graph::default();
        let mut sum = graph.variable(Variable::State(0));
        for k in 0..terms {
            let constant = graph.constant(f64::from(k) + 0.5);
            let scaled = graph.binary(Binary::Mul, sum, constant);
            sum = graph.unary(Unary::Sin, scaled);
        }
        let expected = graph.value(sum, &|_| 0.3);
        let tape = match compile(&graph, &[sum]) {
            Ok(tape) => tape,
            Err(error) => {
                assert!(matches!(error, CompileError::TooLong { .. }), "{error}");
                continue;
            }
        };
        let nothing = Vector::zeros();
        let s = Vector::from([0.3]);
        let value: Vector<1> = tape.evaluate::<_, 1, 0, 0>((&s, &nothing, &nothing, 0.1));
        assert_eq!(value[0].to_bits(), expected.to_bits(), "{terms} terms");
    }
}

#[test]
fn variables_and_constants_alone_need_no_instruction() {
    let mut graph = Graph::default();
    let variables =
        [Variable::State(1), Variable::Input(0), Variable::Parameter(1), Variable::Period];
    let mut of: Vec<Id> = variables.into_iter().map(|variable| graph.variable(variable)).collect();
    of.push(graph.constant(7.0));
    let layout = Layout { states: 2, inputs: 1, parameters: 2 };
    let tape = Tape::compile(&graph, layout, [Entries::new(&of, 1, (5, 1))]).unwrap();
    let at = (&Vector::from([0.1, 0.2]), &Vector::from([0.3]), &Vector::from([0.4, 0.5]), 0.6);
    let value: Vector<5> = tape.evaluate::<_, 2, 1, 2>(at);
    assert_eq!(value.as_slice(), [0.2, 0.3, 0.5, 0.6, 7.0]);
}

#[test]
fn a_variable_that_the_program_does_not_have_is_refused() {
    let mut graph = Graph::default();
    for variable in [Variable::State(1), Variable::Input(0), Variable::Parameter(7)] {
        let id = graph.variable(variable);
        assert_eq!(compile(&graph, &[id]).unwrap_err(), CompileError::Variable(variable));
    }
}

#[test]
fn a_matrix_that_is_given_by_rows_is_kept_by_columns_and_filled_up_with_zeros() {
    let mut graph = Graph::default();
    let ids: Vec<Id> = (1..=6).map(|k| graph.constant(f64::from(k))).collect();
    let layout = Layout { states: 0, inputs: 0, parameters: 0 };
    let tape = Tape::compile(&graph, layout, [Entries::new(&ids, 3, (3, 4))]).unwrap();
    let nothing = Vector::zeros();
    let filled: Matrix<3, 4> = tape.evaluate::<_, 0, 0, 0>((&nothing, &nothing, &nothing, 0.1));
    let rows = [1.0, 2.0, 3.0, 0.0, 4.0, 5.0, 6.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(filled, Matrix::<3, 4>::from_row_slice(&rows));
}
