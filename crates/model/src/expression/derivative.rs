//! Derivatives of expressions: the chain rule over the graph, node by node.

use super::graph::{Binary, Graph, Id, Node, Unary, Variable, children, index, same};

impl Graph {
    /// Derivatives of the expressions `of` by a variable, by the chain rule over the graph.
    ///
    /// At a kink (`abs`, `min`, `max`, `sign`) it is the derivative of one side.
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
                let [a, b] = children(self.node_at(at)).map(|child| child.map_or(zero, inner));
                derivatives[at] = self.chain_rule(index(at), by, [a, b]);
            }
        }
        of.iter().map(|id| derivatives[id.position()]).collect()
    }

    /// Derivative of one node, given those of its children.
    fn chain_rule(&mut self, id: Id, by: Variable, [da, db]: [Id; 2]) -> Id {
        match self.node(id) {
            Node::Constant(_) => self.constant(0.0),
            Node::Variable(variable) => self.constant(f64::from(u8::from(variable == by))),
            Node::Unary(function, a) => {
                if self.number(da).is_some_and(|da| same(da, 0.0)) {
                    return da;
                }
                let factor = self.factor(function, a, id);
                self.binary(Binary::Mul, factor, da)
            }
            Node::Binary(function, a, b) => self.binary_rule(function, [a, b, id], [da, db]),
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
        use Binary::{Above, Add, Atan2, Div, Max, Min, Mul, Pow, Sub};
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
                let by_base = self.binary(Mul, factor, da);
                if self.number(db).is_some_and(|db| same(db, 0.0)) {
                    return by_base;
                }
                let ln = self.unary(Unary::Ln, a);
                let growth = self.binary(Mul, value, ln);
                let by_exponent = self.binary(Mul, growth, db);
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
                let is_a = if function == Max {
                    self.binary(Above, a, b)
                } else {
                    self.binary(Above, b, a)
                };
                let gap = self.binary(Sub, da, db);
                let scaled = self.binary(Mul, is_a, gap);
                self.binary(Add, db, scaled)
            }
            Above => self.constant(0.0),
        }
    }
}
