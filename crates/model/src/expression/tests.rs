use super::*;
use crate::Vector;
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
        Binary::Chain,
        Binary::Div,
    ] {
        let term = graph.binary(function, y, a);
        let term = graph.binary(Binary::Mul, term, u);
        other = graph.binary(Binary::Add, other, term);
    }
    let above = graph.binary(Binary::Above, y, x);
    let (left, right) = (graph.unary(Unary::Sqrt, sum), graph.binary(Binary::Mul, x, y));
    let taken = graph.select(above, left, right);
    other = graph.binary(Binary::Add, other, taken);
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
        let (s, u, p) = (Vector::from([x, y]), Vector::from([0.4]), Vector::from([0.5, 0.9]));
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
