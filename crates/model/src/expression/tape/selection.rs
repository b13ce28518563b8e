//! Which instruction computes which nodes of a graph.
//!
//! A sum and its product, or a product and its factor, are one instruction where nothing else uses the inner one; so
//! are the sine and the cosine of one angle. The arithmetic stays that of the nodes, rounding included.

use super::Operation;
use crate::expression::graph::{Binary, Graph, Id, Node, Unary, children};

/// The nodes that some expressions use, and which of them are computed within the instruction of another.
pub(super) struct Selection {
    nodes: Vec<Node>,
    /// How often a node is an operand or an output.
    counts: Vec<usize>,
    /// The operand that is computed with the node.
    inner: Vec<Option<Id>>,
    is_inner: Vec<bool>,
}

impl Selection {
    /// The instructions for `outputs`.
    pub(super) fn new<'a>(graph: &Graph, outputs: impl Iterator<Item = &'a Id> + Clone) -> Self {
        let end = outputs.clone().map(|id| id.position() + 1).max().unwrap_or(0);
        let nodes: Vec<Node> = (0..end).map(|at| graph.node_at(at)).collect();
        let mut counts = vec![0; end];
        for id in outputs {
            counts[id.position()] += 1;
        }
        for at in (0..end).rev() {
            if counts[at] > 0 {
                for child in children(nodes[at]).into_iter().flatten() {
                    counts[child.position()] += 1;
                }
            }
        }
        let (inner, is_inner) = (vec![None; end], vec![false; end]);
        let mut selection = Self { nodes, counts, inner, is_inner };
        // Backwards: an outer node chooses first, and an inner one has no inner one itself.
        for at in (0..end).rev() {
            if selection.counts[at] > 0 && !selection.is_inner[at] {
                selection.inner[at] = selection.inner_of(at);
                if let Some(inner) = selection.inner[at] {
                    selection.is_inner[inner.position()] = true;
                }
            }
        }
        selection
    }

    /// Number of nodes, used or not.
    pub(super) fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Number of terms: constants and functions in use.
    pub(super) fn terms(&self) -> usize {
        let is_term =
            |(node, count): &(&Node, &usize)| **count > 0 && !matches!(node, Node::Variable(_));
        self.nodes.iter().zip(&self.counts).filter(is_term).count()
    }

    /// Positions and nodes that need a register, in the order of the graph.
    pub(super) fn computed(&self) -> impl Iterator<Item = (usize, Node)> {
        let is_computed = |(at, _): &(usize, Node)| self.counts[*at] > 0 && !self.is_inner[*at];
        self.nodes.iter().copied().enumerate().filter(is_computed)
    }

    /// The instruction of a node, and its operands; those that it does not need are any. None of constants and
    /// variables, and of the later one of a sine and its cosine.
    pub(super) fn instruction(&self, at: usize) -> Option<(Operation, [Id; 3])> {
        let inner = self.inner[at];
        match self.nodes[at] {
            Node::Constant(_) | Node::Variable(_) => None,
            Node::Unary(Unary::Neg, a) => Some((Operation::Neg, [a; 3])),
            Node::Unary(function, a) => match self.pair(at) {
                Some([first, _]) => (first == at).then_some((Operation::SinCos, [a; 3])),
                None => Some((Operation::Unary(function), [a; 3])),
            },
            Node::Select(condition, a, b) => Some((Operation::Select, [condition, a, b])),
            Node::Binary(function, a, b) => Some(match inner.map(|id| self.nodes[id.position()]) {
                Some(Node::Binary(part, left, right)) => {
                    let is_first = inner == Some(a);
                    let operation = match (function, part) {
                        (Binary::Mul, Binary::Div) => Operation::DivMul,
                        (Binary::Mul, _) => Operation::MulMul,
                        (Binary::Sub, _) if is_first => Operation::MulSub,
                        (Binary::Sub, _) => Operation::SubMul,
                        _ => Operation::MulAdd,
                    };
                    (operation, [left, right, if is_first { b } else { a }])
                }
                _ => (alone(function), [a, b, a]),
            }),
        }
    }

    /// Positions of what the instruction of a node computes, in the order of its registers.
    pub(super) fn results(&self, at: usize) -> [Option<usize>; 2] {
        let Node::Unary(Unary::Sin | Unary::Cos, angle) = self.nodes[at] else {
            return [Some(at), None];
        };
        match self.pair(at) {
            Some([first, second]) if self.nodes[first] == Node::Unary(Unary::Cos, angle) => {
                [Some(second), Some(first)]
            }
            Some(pair) => pair.map(Some),
            None => [Some(at), None],
        }
    }

    /// The sine and the cosine that are both in use, one of them at `at`, in the order of the graph.
    fn pair(&self, at: usize) -> Option<[usize; 2]> {
        let (function, angle) = match self.nodes[at] {
            Node::Unary(Unary::Sin, angle) => (Unary::Cos, angle),
            Node::Unary(Unary::Cos, angle) => (Unary::Sin, angle),
            _ => return None,
        };
        let is_other = |other: &usize| self.nodes[*other] == Node::Unary(function, angle);
        let other = (0..self.len()).find(is_other).filter(|other| self.counts[*other] > 0)?;
        Some([at.min(other), at.max(other)])
    }

    /// The operand that may be computed with the node: one that nothing else uses.
    fn inner_of(&self, at: usize) -> Option<Id> {
        let Node::Binary(function, a, b) = self.nodes[at] else { return None };
        [a, b].into_iter().find(|id| {
            let Node::Binary(part, ..) = self.nodes[id.position()] else { return false };
            self.counts[id.position()] == 1
                && matches!(
                    (function, part),
                    (Binary::Add | Binary::Sub, Binary::Mul)
                        | (Binary::Mul, Binary::Mul | Binary::Div)
                )
        })
    }
}

/// The instruction of a function by itself.
fn alone(function: Binary) -> Operation {
    match function {
        Binary::Add => Operation::Add,
        Binary::Sub => Operation::Sub,
        Binary::Mul => Operation::Mul,
        Binary::Div => Operation::Div,
        _ => Operation::Binary(function),
    }
}

#[cfg(test)]
mod tests;
