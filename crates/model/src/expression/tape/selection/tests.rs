use super::*;
use crate::expression::graph::Variable;

/// A graph with the states `x`, `y`, `z` and `w`.
fn graph() -> (Graph, [Id; 4]) {
    let mut graph = Graph::default();
    let s = [0, 1, 2, 3].map(|row| graph.variable(Variable::State(row)));
    (graph, s)
}

/// Instructions with their operands, in the order of the graph.
fn instructions(graph: &Graph, outputs: &[Id]) -> Vec<(Operation, [Id; 3])> {
    let selection = Selection::new(graph, outputs.iter());
    selection.computed().filter_map(|(at, _)| selection.instruction(at)).collect()
}

#[test]
fn a_product_that_nothing_else_uses_is_computed_with_its_sum() {
    use Binary::{Add, Div, Mul, Sub};
    let (mut graph, [x, y, z, _]) = graph();
    let (product, ratio) = (graph.binary(Mul, x, y), graph.binary(Div, x, y));
    for (function, a, b, operation) in [
        (Add, product, z, Operation::MulAdd),
        (Add, z, product, Operation::MulAdd),
        (Sub, product, z, Operation::MulSub),
        (Sub, z, product, Operation::SubMul),
        (Mul, product, z, Operation::MulMul),
        (Mul, ratio, z, Operation::DivMul),
    ] {
        let outer = graph.binary(function, a, b);
        assert_eq!(instructions(&graph, &[outer]), [(operation, [x, y, z])], "{operation:?}");
    }
    // There is no instruction for a sum of a ratio, nor for a ratio of a product.
    let sum = graph.binary(Add, ratio, z);
    assert_eq!(instructions(&graph, &[sum]).len(), 2);
    let divided = graph.binary(Div, product, z);
    assert_eq!(instructions(&graph, &[divided]).len(), 2);
}

#[test]
fn a_product_that_is_used_twice_or_is_an_output_is_computed_alone() {
    use Binary::{Add, Mul, Sub};
    let (mut graph, [x, y, z, w]) = graph();
    let product = graph.binary(Mul, x, y);
    let (sum, difference) = (graph.binary(Add, product, z), graph.binary(Sub, product, w));
    let both = [Operation::Mul, Operation::Add, Operation::Sub];
    let operations = |outputs: &[Id]| -> Vec<Operation> {
        instructions(&graph, outputs).into_iter().map(|(operation, _)| operation).collect()
    };
    assert_eq!(operations(&[sum, difference]), both);
    assert_eq!(operations(&[sum, product]), both[..2]);
    assert_eq!(operations(&[sum]), [Operation::MulAdd]);
    // Once for each of two equal outputs.
    assert_eq!(operations(&[product, product]), [Operation::Mul]);
}

#[test]
fn what_is_computed_within_another_has_nothing_within_itself() {
    let (mut graph, [x, y, z, w]) = graph();
    let first = graph.binary(Binary::Mul, x, y);
    let second = graph.binary(Binary::Mul, first, z);
    let third = graph.binary(Binary::Mul, second, w);
    let expected = [(Operation::Mul, [x, y, x]), (Operation::MulMul, [z, first, w])];
    let [alone, pair] = &instructions(&graph, &[third])[..] else { panic!("not two") };
    assert_eq!(alone, &expected[0]);
    // The factors of a product are in the order of the graph.
    let (operation, [a, b, c]) = pair;
    assert_eq!((*operation, [*a.min(b), *a.max(b), *c]), (Operation::MulMul, [z, first, w]));
}

#[test]
fn the_sine_and_the_cosine_of_one_angle_are_one_instruction() {
    for sine_first in [true, false] {
        let (mut graph, [x, y, ..]) = graph();
        let [first, second] =
            if sine_first { [Unary::Sin, Unary::Cos] } else { [Unary::Cos, Unary::Sin] };
        let (a, b) = (graph.unary(first, x), graph.unary(second, x));
        let other = graph.unary(Unary::Cos, y);
        let selection = Selection::new(&graph, [a, b, other].iter());
        assert_eq!(selection.instruction(a.position()), Some((Operation::SinCos, [x; 3])));
        assert_eq!(selection.instruction(b.position()), None);
        let cosine = Some((Operation::Unary(Unary::Cos), [y; 3]));
        assert_eq!(selection.instruction(other.position()), cosine);
        // The register of the sine stands before that of the cosine.
        let (sine, cosine) = if sine_first { (a, b) } else { (b, a) };
        let results = [Some(sine.position()), Some(cosine.position())];
        assert_eq!(selection.results(a.position()), results);
        assert_eq!(selection.results(other.position()), [Some(other.position()), None]);
        // Of one that is not in use nothing is computed.
        let selection = Selection::new(&graph, [b].iter());
        let alone = Some((Operation::Unary(second), [x; 3]));
        assert_eq!(selection.instruction(b.position()), alone);
        assert_eq!(selection.results(b.position()), [Some(b.position()), None]);
    }
}

#[test]
fn only_what_is_in_use_counts() {
    let (mut graph, [x, y, ..]) = graph();
    let two = graph.constant(2.0);
    let unused = graph.unary(Unary::Sqrt, y);
    let product = graph.binary(Binary::Mul, two, x);
    let selection = Selection::new(&graph, [product].iter());
    assert_eq!(selection.terms(), 2, "the constant and the product");
    let computed: Vec<usize> = selection.computed().map(|(at, _)| at).collect();
    assert_eq!(computed, [x, two, product].map(Id::position));
    assert!(unused.position() < selection.len());
    assert_eq!(Selection::new(&graph, [].iter()).len(), 0);
}
