//! Derivatives of expressions: the chain rule over the graph, node by node.

use super::graph::{Binary, Graph, Id, Node, Unary, Variable, children, index, same};

impl Graph {
    /// Derivatives of the expressions `of` by a variable, by the chain rule over the graph.
    ///
    /// At a corner of `min` and `max` it is the derivative of one side, of `abs` it is 0, and of `sign` it is 0
    /// everywhere. A function of what does not change at the point does not change: its derivative is 0 there, however
    /// steep it is itself, as that of `sqrt(max(x, 0))` for negative `x`; but that of `atan2` has none where both
    /// arguments are 0.
    pub fn derivatives(&mut self, of: &[Id], by: Variable) -> Vec<Id> {
        let end = of.iter().map(|id| id.position() + 1).max().unwrap_or(0);
        let mut needed = vec![false; end];
        for id in of {
            needed[id.position()] = true;
        }
        for at in (0..end).rev() {
            if !needed[at] {
                continue;
            }
            for child in children(self.node_at(at)).into_iter().flatten() {
                needed[child.position()] = true;
            }
        }
        let zero = self.constant(0.0);
        let mut derivatives = vec![zero; end];
        for at in 0..end {
            if needed[at] {
                let inner = |id: Id| derivatives[id.position()];
                let inner = children(self.node_at(at)).map(|child| child.map_or(zero, inner));
                derivatives[at] = self.chain_rule(index(at), by, inner);
            }
        }
        of.iter().map(|id| derivatives[id.position()]).collect()
    }

    /// Derivative of one node, given those of its children.
    fn chain_rule(&mut self, id: Id, by: Variable, [da, db, dc]: [Id; 3]) -> Id {
        match self.node(id) {
            Node::Constant(_) => self.constant(0.0),
            Node::Variable(variable) => self.constant(f64::from(u8::from(variable == by))),
            Node::Unary(function, a) => {
                if self.number(da).is_some_and(|da| same(da, 0.0)) {
                    return da;
                }
                let factor = self.factor(function, a, id);
                // The others are finite where their value is.
                let is_steep = matches!(function, Unary::Sqrt | Unary::Asin | Unary::Acos);
                self.binary(if is_steep { Binary::Chain } else { Binary::Mul }, factor, da)
            }
            Node::Binary(function, a, b) => self.binary_rule(function, [a, b, id], [da, db]),
            Node::Select(condition, ..) => self.select(condition, db, dc),
        }
    }

    /// Derivative of `value = function(a)` by `a`.
    fn factor(&mut self, function: Unary, a: Id, value: Id) -> Id {
        let one = self.constant(1.0);
        match function {
            Unary::Neg => self.constant(-1.0),
            Unary::Sin => self.unary(Unary::Cos, a),
            Unary::Cos => {
                let sin = self.unary(Unary::Sin, a);
                self.unary(Unary::Neg, sin)
            }
            Unary::Tan => {
                let square = self.binary(Binary::Mul, value, value);
                self.binary(Binary::Add, one, square)
            }
            Unary::Asin | Unary::Acos => {
                let square = self.binary(Binary::Mul, a, a);
                let rest = self.binary(Binary::Sub, one, square);
                let root = self.unary(Unary::Sqrt, rest);
                let sign = self.constant(if function == Unary::Asin { 1.0 } else { -1.0 });
                self.binary(Binary::Div, sign, root)
            }
            Unary::Atan => {
                let square = self.binary(Binary::Mul, a, a);
                let sum = self.binary(Binary::Add, one, square);
                self.binary(Binary::Div, one, sum)
            }
            Unary::Sinh => self.unary(Unary::Cosh, a),
            Unary::Cosh => self.unary(Unary::Sinh, a),
            Unary::Tanh => {
                let square = self.binary(Binary::Mul, value, value);
                self.binary(Binary::Sub, one, square)
            }
            Unary::Exp => value,
            Unary::Ln => self.binary(Binary::Div, one, a),
            Unary::Sqrt => {
                let half = self.constant(0.5);
                self.binary(Binary::Div, half, value)
            }
            Unary::Abs => self.unary(Unary::Sign, a),
            Unary::Sign => self.constant(0.0),
        }
    }

    /// Derivative of `value = function(a, b)`.
    fn binary_rule(&mut self, function: Binary, [a, b, value]: [Id; 3], [da, db]: [Id; 2]) -> Id {
        use Binary::{Above, Add, Atan2, Chain, Div, Max, Min, Mul, Pow, Sub};
        match function {
            Add | Sub => self.binary(function, da, db),
            Mul => {
                let (left, right) = (self.binary(Mul, da, b), self.binary(Mul, a, db));
                self.binary(Add, left, right)
            }
            Div => {
                let scaled = self.binary(Mul, value, db);
                let rest = self.binary(Sub, da, scaled);
                self.binary(Div, rest, b)
            }
            Pow => {
                let one = self.constant(1.0);
                let exponent = self.binary(Sub, b, one);
                let power = self.binary(Pow, a, exponent);
                let factor = self.binary(Mul, b, power);
                let is_smooth = self.number(b).is_some_and(|b| b >= 1.0);
                let by_base = self.binary(if is_smooth { Mul } else { Chain }, factor, da);
                if self.number(db).is_some_and(|db| same(db, 0.0)) {
                    return by_base;
                }
                let ln = self.unary(Unary::Ln, a);
                // `0^b` is 0 for every positive `b`.
                let growth = self.binary(Chain, ln, value);
                let by_exponent = self.binary(Chain, growth, db);
                self.binary(Add, by_base, by_exponent)
            }
            Atan2 => {
                let (left, right) = (self.binary(Mul, b, da), self.binary(Mul, a, db));
                let top = self.binary(Sub, left, right);
                let (aa, bb) = (self.binary(Mul, a, a), self.binary(Mul, b, b));
                let bottom = self.binary(Add, aa, bb);
                self.binary(Div, top, bottom)
            }
            Min | Max => {
                // Zero where `a` is the value; NaN where `a` is, and `b` is the value then.
                let is_b = self.binary(Sub, value, a);
                self.select(is_b, db, da)
            }
            Chain => {
                let (left, right) = (self.binary(Chain, da, b), self.binary(Chain, a, db));
                self.binary(Add, left, right)
            }
            Above => self.constant(0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::check::jacobian_gap;

    const X: Variable = Variable::State(0);
    const Y: Variable = Variable::State(1);

    /// Gap of the derivatives of `expression` of two variables at a point.
    fn gap(at: [f64; 2], expression: impl Fn(&mut Graph, Id, Id) -> Id) -> f64 {
        let mut graph = Graph::default();
        let (x, y) = (graph.variable(X), graph.variable(Y));
        let of = expression(&mut graph, x, y);
        let by = [X, Y].map(|by| graph.derivatives(&[of], by)[0]);
        let value = |id: Id, at: &Vector2<f64>| {
            graph.value(id, &|variable| if variable == X { at.x } else { at.y })
        };
        let at = Vector2::from(at);
        let exact = by.map(|by| value(by, &at));
        let numeric = |at: &Vector2<f64>| nalgebra::Vector1::new(value(of, at));
        jacobian_gap(numeric, &at, &nalgebra::RowVector2::from(exact))
    }

    #[test]
    fn functions_that_take_every_number_are_right_on_both_sides_of_zero() {
        use Unary::{Abs, Atan, Cos, Cosh, Exp, Neg, Sign, Sin, Sinh, Tan, Tanh};
        for function in [Neg, Sin, Cos, Tan, Atan, Sinh, Cosh, Tanh, Exp, Abs, Sign] {
            for x in [-1.3, -0.2, 0.4, 1.1] {
                // The chain rule: twice the argument, and a factor behind it.
                let gap = gap([x, 0.7], |graph, x, y| {
                    let twice = graph.binary(Binary::Add, x, x);
                    let inner = graph.unary(function, twice);
                    graph.binary(Binary::Mul, inner, y)
                });
                // Tan at 2.6 has a third derivative of 20.
                assert!(gap < 1e-8, "{function:?}: gap {gap:e} at {x}");
            }
        }
    }

    #[test]
    fn functions_of_two_numbers_are_right_in_every_quadrant() {
        use Binary::{Above, Add, Atan2, Div, Max, Min, Mul, Sub};
        for function in [Add, Sub, Mul, Div, Atan2, Min, Max, Above] {
            for at in [[0.3, 0.8], [-0.4, 0.9], [-0.7, -0.5], [1.2, -0.6]] {
                let gap = gap(at, |graph, x, y| graph.binary(function, x, y));
                assert!(gap < 1e-8, "{function:?}: gap {gap:e} at {at:?}");
            }
        }
    }

    #[test]
    fn a_power_of_a_negative_number_has_a_derivative_if_its_exponent_is_constant() {
        for exponent in [3.0, -2.0, 4.0] {
            let gap = gap([-0.8, 0.0], |graph, x, _| {
                let exponent = graph.constant(exponent);
                graph.binary(Binary::Pow, x, exponent)
            });
            assert!(gap < 1e-8, "gap {gap:e} of the power {exponent}");
        }
        let gap = gap([1.7, -0.6], |graph, x, y| graph.binary(Binary::Pow, x, y));
        assert!(gap < 1e-8, "gap {gap:e} of x^y");
    }

    /// Value and derivatives by both variables.
    fn at([x, y]: [f64; 2], expression: impl Fn(&mut Graph, [Id; 2]) -> Id) -> Vec<f64> {
        let mut graph = Graph::default();
        let variables = [X, Y].map(|variable| graph.variable(variable));
        let of = expression(&mut graph, variables);
        let [by_x, by_y] = [X, Y].map(|by| graph.derivatives(&[of], by)[0]);
        let value = |id| graph.value(id, &|variable| if variable == X { x } else { y });
        [of, by_x, by_y].map(value).to_vec()
    }

    #[test]
    fn a_steep_function_of_what_does_not_change_does_not_change() {
        let rectified = |graph: &mut Graph, x: Id| {
            let zero = graph.constant(0.0);
            graph.binary(Binary::Max, x, zero)
        };
        let root = |graph: &mut Graph, [x, _]: [Id; 2]| {
            let rectified = rectified(graph, x);
            graph.unary(Unary::Sqrt, rectified)
        };
        assert_eq!(at([-0.5, 0.0], root), [0.0; 3]);
        assert_eq!(at([0.25, 0.0], root), [0.5, 1.0, 0.0]);
        // The exponents 0.7 and y.
        let power = |graph: &mut Graph, [x, _]: [Id; 2]| {
            let (rectified, exponent) = (rectified(graph, x), graph.constant(0.7));
            graph.binary(Binary::Pow, rectified, exponent)
        };
        assert_eq!(at([-0.5, 0.0], power), [0.0; 3]);
        let power = |graph: &mut Graph, [x, y]: [Id; 2]| {
            let rectified = rectified(graph, x);
            graph.binary(Binary::Pow, rectified, y)
        };
        assert_eq!(at([-0.5, 1.5], power), [0.0; 3]);
        let norm = |graph: &mut Graph, variables: [Id; 2]| {
            let [xx, yy] = variables.map(|id| graph.binary(Binary::Mul, id, id));
            let sum = graph.binary(Binary::Add, xx, yy);
            graph.unary(Unary::Sqrt, sum)
        };
        assert_eq!(at([0.0, 0.0], norm), [0.0; 3]);
        assert_eq!(at([0.0, -2.0], norm), [2.0, 0.0, -1.0]);
        let held = |graph: &mut Graph, [x, _]: [Id; 2]| {
            let one = graph.constant(1.0);
            let held = graph.binary(Binary::Min, x, one);
            graph.unary(Unary::Asin, held)
        };
        assert_eq!(at([1.5, 0.0], held)[1..], [0.0; 2]);
    }

    #[test]
    fn what_is_not_taken_may_be_anything() {
        // sqrt(x) above zero, else y.
        let root = |graph: &mut Graph, [x, y]: [Id; 2]| {
            let zero = graph.constant(0.0);
            let (condition, root) =
                (graph.binary(Binary::Above, x, zero), graph.unary(Unary::Sqrt, x));
            graph.select(condition, root, y)
        };
        assert_eq!(at([-1.0, 2.0], root), [2.0, 0.0, 1.0]);
        assert_eq!(at([0.0, 2.0], root), [2.0, 0.0, 1.0]);
        assert_eq!(at([0.25, 2.0], root), [0.5, 1.0, 0.0]);
        for other in [1e20, f64::INFINITY, f64::NAN] {
            let small = |graph: &mut Graph, [x, _]: [Id; 2]| {
                let zero = graph.constant(0.0);
                let (condition, other) =
                    (graph.binary(Binary::Above, x, zero), graph.constant(other));
                graph.select(condition, x, other)
            };
            assert_eq!(at([1.0, 0.0], small), [1.0, 1.0, 0.0], "{other}");
        }
        // The root of a negative number is no reason for `max` to have no derivative.
        for function in [Binary::Max, Binary::Min] {
            let root_first = |graph: &mut Graph, [x, y]: [Id; 2]| {
                let root = graph.unary(Unary::Sqrt, x);
                graph.binary(function, root, y)
            };
            let root_last = |graph: &mut Graph, [x, y]: [Id; 2]| {
                let root = graph.unary(Unary::Sqrt, x);
                graph.binary(function, y, root)
            };
            assert_eq!(at([-1.0, 2.0], root_first), [2.0, 0.0, 1.0], "{function:?}");
            assert_eq!(at([-1.0, 2.0], root_last), [2.0, 0.0, 1.0], "{function:?}");
        }
        let mut graph = Graph::default();
        let (x, one) = (graph.variable(X), graph.constant(1.0));
        assert_eq!(graph.select(one, x, one), x, "the condition is constant");
        assert_eq!(graph.select(x, one, one), one, "there is no choice");
    }

    #[test]
    fn what_does_not_depend_on_a_variable_has_the_constant_zero_as_derivative() {
        let mut graph = Graph::default();
        let (x, period) = (graph.variable(X), graph.variable(Variable::Period));
        let sine = graph.unary(Unary::Sin, x);
        let product = graph.binary(Binary::Mul, sine, period);
        let of = [sine, product, period];
        let numbers = |graph: &mut Graph, by| {
            graph.derivatives(&of, by).into_iter().map(|id| graph.number(id)).collect::<Vec<_>>()
        };
        assert_eq!(numbers(&mut graph, Variable::Input(0)), [Some(0.0); 3]);
        assert_eq!(numbers(&mut graph, Variable::Period), [Some(0.0), None, Some(1.0)]);
        assert_eq!(numbers(&mut graph, X), [None, None, Some(0.0)]);
    }
}
