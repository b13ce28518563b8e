//! Graphs of expressions: equal subexpressions once, constants folded, derivatives by the chain rule.

use std::collections::BTreeMap;

/// Products below which the sign of a term of a sum is looked for: at most 2 to the power of it are.
const SIGN_DEPTH: u8 = 8;

/// Index of a node in its [`Graph`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Id(u32);

/// What an expression may depend on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Variable {
    /// This row of the state.
    State(usize),
    /// This row of the input.
    Input(usize),
    /// This row of the parameter.
    Parameter(usize),
    /// The period. s
    Period,
}

/// Functions of one number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[expect(missing_docs, reason = "the functions of f64 by the same names")]
pub enum Unary {
    Neg,
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Sinh,
    Cosh,
    Tanh,
    Exp,
    Ln,
    Sqrt,
    Abs,
    /// -1, 0 or 1; its derivative is zero.
    Sign,
}

/// Functions of two numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[expect(missing_docs, reason = "the functions of f64 by the same names")]
pub enum Binary {
    Add,
    Sub,
    Mul,
    Div,
    Pow,
    Atan2,
    Min,
    Max,
    /// 1 where the first is above the second, else 0; its derivative is zero.
    Above,
    /// Outer times inner derivative: the product, but 0 where the second is 0, whatever the first is.
    Chain,
}

/// One expression. Its number is in the unit that the expression has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Node {
    /// A number, by its bits.
    Constant(u64),
    /// A variable.
    Variable(Variable),
    /// A function of one expression.
    Unary(Unary, Id),
    /// A function of two expressions.
    Binary(Binary, Id, Id),
    /// The second where the first is not 0, else the third; what is not taken may be infinite or NaN.
    Select(Id, Id, Id),
}

/// Expressions over [`Variable`]s. A node comes after the nodes that it depends on.
///
/// ```
/// use horizon_model::expression::{Binary, Graph, Unary, Variable};
///
/// let mut graph = Graph::default();
/// let x = graph.variable(Variable::State(0));
/// let sine = graph.unary(Unary::Sin, x);
/// let product = graph.binary(Binary::Mul, sine, x);
/// let derivative = graph.derivatives(&[product], Variable::State(0))[0];
/// assert_eq!(graph.value(derivative, &|_| 0.5), 0.5 * f64::cos(0.5) + f64::sin(0.5));
/// ```
#[derive(Debug, Clone, Default)]
pub struct Graph {
    nodes: Vec<Node>,
    known: BTreeMap<Node, Id>,
}

impl Unary {
    /// The function at `x`; NaN outside of its domain.
    #[inline]
    pub fn at(self, x: f64) -> f64 {
        match self {
            Self::Neg => -x,
            Self::Sin => x.sin(),
            Self::Cos => x.cos(),
            Self::Tan => x.tan(),
            Self::Asin => x.asin(),
            Self::Acos => x.acos(),
            Self::Atan => x.atan(),
            Self::Sinh => x.sinh(),
            Self::Cosh => x.cosh(),
            Self::Tanh => x.tanh(),
            Self::Exp => x.exp(),
            Self::Ln => x.ln(),
            Self::Sqrt => x.sqrt(),
            Self::Abs => x.abs(),
            Self::Sign => f64::from(i8::from(x > 0.0) - i8::from(x < 0.0)),
        }
    }
}

impl Binary {
    /// The function at `a` and `b`.
    #[inline]
    pub fn at(self, a: f64, b: f64) -> f64 {
        match self {
            Self::Add => a + b,
            Self::Sub => a - b,
            Self::Mul => a * b,
            Self::Div => a / b,
            Self::Pow => a.powf(b),
            Self::Atan2 => a.atan2(b),
            Self::Min => a.min(b),
            Self::Max => a.max(b),
            Self::Above => f64::from(u8::from(a > b)),
            Self::Chain => taken(b, a * b, 0.0),
        }
    }
}

impl Graph {
    /// The constant `value`, one node for equal values.
    pub fn constant(&mut self, value: f64) -> Id {
        // One zero: a negative one differs in nothing that a model does.
        self.put(Node::Constant((value + 0.0).to_bits()))
    }

    /// The variable, one node however often it is asked for.
    pub fn variable(&mut self, variable: Variable) -> Id {
        self.put(Node::Variable(variable))
    }

    /// `function(a)`; a constant where `a` is one, and the inner expression for a second negation.
    pub fn unary(&mut self, function: Unary, a: Id) -> Id {
        match (function, self.node(a)) {
            (_, Node::Constant(bits)) => self.constant(function.at(f64::from_bits(bits))),
            (Unary::Neg, Node::Unary(Unary::Neg, inner)) => inner,
            _ => self.put(Node::Unary(function, a)),
        }
    }

    /// `function(a, b)`, simplified.
    ///
    /// A product with the constant zero is zero: what would be infinite times zero is zero as well.
    pub fn binary(&mut self, function: Binary, a: Id, b: Id) -> Id {
        let (left, right) = (self.number(a), self.number(b));
        if let (Some(left), Some(right)) = (left, right) {
            return self.constant(function.at(left, right));
        }
        let is = |number: Option<f64>, value: f64| number.is_some_and(|number| same(number, value));
        match function {
            Binary::Add if is(left, 0.0) => b,
            Binary::Add | Binary::Sub if is(right, 0.0) => a,
            Binary::Sub if is(left, 0.0) => self.unary(Unary::Neg, b),
            Binary::Sub if a == b => self.constant(0.0),
            // Only an inner derivative that varies can be 0 at some points.
            Binary::Chain if left.is_some_and(f64::is_finite) || right.is_some() => {
                self.binary(Binary::Mul, a, b)
            }
            Binary::Mul if is(left, 0.0) || is(right, 0.0) => self.constant(0.0),
            Binary::Div if is(left, 0.0) => self.constant(0.0),
            Binary::Mul if is(left, 1.0) => b,
            Binary::Mul | Binary::Div | Binary::Pow if is(right, 1.0) => a,
            Binary::Mul if is(left, -1.0) => self.unary(Unary::Neg, b),
            Binary::Mul if is(right, -1.0) => self.unary(Unary::Neg, a),
            // `x - (-y)` is `x + y` in every bit, so is a product with one of its factors negated.
            Binary::Add | Binary::Sub if let Some(b) = self.opposite(b, SIGN_DEPTH) => {
                let function = if function == Binary::Add { Binary::Sub } else { Binary::Add };
                self.binary(function, a, b)
            }
            Binary::Add if let Some(a) = self.opposite(a, SIGN_DEPTH) => {
                self.binary(Binary::Sub, b, a)
            }
            Binary::Pow if is(right, 0.0) => self.constant(1.0),
            Binary::Pow if is(right, 2.0) => self.binary(Binary::Mul, a, a),
            Binary::Pow if is(right, 0.5) => self.unary(Unary::Sqrt, a),
            // The same sum or product, however it was written.
            Binary::Add | Binary::Mul if b < a => self.put(Node::Binary(function, b, a)),
            _ => self.put(Node::Binary(function, a, b)),
        }
    }

    /// `a` where `condition` is not 0, else `b`.
    pub fn select(&mut self, condition: Id, a: Id, b: Id) -> Id {
        match self.number(condition) {
            Some(condition) => taken(condition, a, b),
            None if a == b => a,
            None => self.put(Node::Select(condition, a, b)),
        }
    }

    /// The expression without its sign, if it has one below `depth` products: `x` of `-x`, `x y` of `(-x) y`.
    fn opposite(&mut self, id: Id, depth: u8) -> Option<Id> {
        match self.node(id) {
            Node::Unary(Unary::Neg, inner) => Some(inner),
            Node::Binary(function @ (Binary::Mul | Binary::Div), a, b) => {
                let depth = depth.checked_sub(1)?;
                if let Some(a) = self.opposite(a, depth) {
                    return Some(self.binary(function, a, b));
                }
                let b = self.opposite(b, depth)?;
                Some(self.binary(function, a, b))
            }
            _ => None,
        }
    }

    /// The node of an expression.
    ///
    /// # Panics
    /// An `id` of another graph may lie beyond the nodes of this one.
    pub fn node(&self, id: Id) -> Node {
        self.nodes[id.0 as usize]
    }

    /// The node at this position.
    pub(super) fn node_at(&self, position: usize) -> Node {
        self.nodes[position]
    }

    /// The number that an expression is, if it is constant.
    pub fn number(&self, id: Id) -> Option<f64> {
        match self.node(id) {
            Node::Constant(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }

    /// Number of different expressions so far.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether there is no expression yet.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Value of an expression. Slow: for constants and tests, models use a [`super::Program`].
    pub fn value(&self, id: Id, of: &dyn Fn(Variable) -> f64) -> f64 {
        let mut values: Vec<f64> = Vec::with_capacity(id.0 as usize + 1);
        for node in self.nodes.iter().take(id.0 as usize + 1) {
            let at = |id: Id| values[id.0 as usize];
            values.push(match *node {
                Node::Constant(bits) => f64::from_bits(bits),
                Node::Variable(variable) => of(variable),
                Node::Unary(function, a) => function.at(at(a)),
                Node::Binary(function, a, b) => function.at(at(a), at(b)),
                Node::Select(condition, a, b) => taken(at(condition), at(a), at(b)),
            });
        }
        values.last().copied().unwrap_or(f64::NAN)
    }

    /// The node, once.
    fn put(&mut self, node: Node) -> Id {
        if let Some(id) = self.known.get(&node) {
            return *id;
        }
        let id = index(self.nodes.len());
        self.nodes.push(node);
        self.known.insert(node, id);
        id
    }
}

/// The nodes that a node depends on.
pub(super) fn children(node: Node) -> [Option<Id>; 3] {
    match node {
        Node::Constant(_) | Node::Variable(_) => [None; 3],
        Node::Unary(_, a) => [Some(a), None, None],
        Node::Binary(_, a, b) => [Some(a), Some(b), None],
        Node::Select(condition, a, b) => [Some(condition), Some(a), Some(b)],
    }
}

/// What a [`Node::Select`] takes.
#[inline]
pub(super) fn taken<T>(condition: f64, a: T, b: T) -> T {
    if condition == 0.0 { b } else { a }
}

impl Id {
    /// Position in the graph.
    pub(super) fn position(self) -> usize {
        self.0 as usize
    }
}

/// The id of this position; graphs stay far below four billion nodes.
pub(super) fn index(position: usize) -> Id {
    Id(u32::try_from(position).unwrap_or(u32::MAX))
}

/// Equality by value, for constants that a person wrote.
pub(super) fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits()
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn a_sum_of_a_deep_product_is_built_in_a_moment() {
        let mut graph = Graph::default();
        let (x, one) = (graph.variable(Variable::State(0)), graph.constant(1.0));
        // It has 2^60 factors.
        let product = (0..60).fold(x, |y, _| graph.binary(Binary::Mul, y, y));
        let sum = graph.binary(Binary::Add, product, one);
        assert!(matches!(graph.node(sum), Node::Binary(Binary::Add, ..)));
    }

    #[test]
    fn no_simplification_changes_a_value() {
        use Binary::{Above, Add, Atan2, Chain, Div, Max, Min, Mul, Pow, Sub};
        let mut graph = Graph::default();
        let [x, y] = [0, 1].map(|row| graph.variable(Variable::State(row)));
        let of = |variable| if variable == Variable::State(0) { 0.7 } else { 1.9 };
        let mut terms =
            [0.0, -0.0, 1.0, -1.0, 2.0, 0.5, -3.0].map(|value| graph.constant(value)).to_vec();
        let minus = graph.unary(Unary::Neg, x);
        let (product, ratio) = (graph.binary(Mul, minus, y), graph.binary(Div, y, minus));
        terms.extend([x, y, minus, product, ratio]);
        for function in [Add, Sub, Mul, Div, Pow, Atan2, Min, Max, Above, Chain] {
            for (a, b) in terms.iter().flat_map(|a| terms.iter().map(move |b| (*a, *b))) {
                let [left, right] = [a, b].map(|id| graph.value(id, &of));
                let plain = function.at(left, right);
                let id = graph.binary(function, a, b);
                let value = graph.value(id, &of);
                // x^2 as a product and x^0.5 as a root may round otherwise than a power.
                let is_same = (value - plain).abs() <= 1e-15 * plain.abs()
                    || (value.is_nan() && plain.is_nan())
                    || (!plain.is_finite() && value.to_bits() == plain.to_bits());
                assert!(is_same, "{function:?} of {left} and {right}: {value} instead of {plain}");
            }
        }
    }

    #[test]
    fn a_sum_and_a_product_are_one_node_however_they_are_written() {
        let mut graph = Graph::default();
        let [x, y] = [0, 1].map(|row| graph.variable(Variable::State(row)));
        for function in [Binary::Add, Binary::Mul] {
            assert_eq!(graph.binary(function, x, y), graph.binary(function, y, x));
        }
        for function in [Binary::Sub, Binary::Div, Binary::Pow, Binary::Atan2, Binary::Above] {
            assert_ne!(graph.binary(function, x, y), graph.binary(function, y, x), "{function:?}");
        }
        let minus = graph.unary(Unary::Neg, x);
        assert_eq!(graph.unary(Unary::Neg, minus), x);
        assert_eq!(graph.constant(-0.0), graph.constant(0.0));
    }

    #[test]
    fn a_sign_is_that_of_the_number_and_zero_has_none() {
        for (x, sign) in [(-0.3, -1.0), (0.0, 0.0), (-0.0, 0.0), (5.0, 1.0)] {
            assert_eq!(Unary::Sign.at(x).to_bits(), f64::to_bits(sign), "{x}");
        }
        for (a, b, is_above) in [(0.2, 0.1, 1.0), (0.1, 0.1, 0.0), (0.1, 0.2, 0.0)] {
            assert_eq!(Binary::Above.at(a, b).to_bits(), f64::to_bits(is_above), "{a} above {b}");
        }
    }
}
