//! Expressions in the order in which they are computed, as a list of instructions.
//!
//! Owns registers, results and evaluation. What becomes an instruction is `tape/selection.rs`'s.

mod selection;

use super::graph::{Binary, Graph, Id, Node, Unary, Variable, taken};
use crate::model::{Linearized, LinearizedByInput};
use crate::{Matrix, Vector};
use selection::Selection;

/// Most registers of a tape.
pub const REGISTERS_MAX: usize = 4096;

/// Numbers of registers that a tape may have, powers of two.
const SIZES: [usize; 6] = [16, 32, 64, 256, 1024, REGISTERS_MAX];

/// Why expressions are no [`Program`](super::Program).
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum CompileError {
    /// They have more terms than [`REGISTERS_MAX`].
    #[error(
        "{registers} different terms, derivatives included; at most {REGISTERS_MAX} are possible"
    )]
    TooLong {
        /// Registers that it would take, one for each term and variable.
        registers: usize,
    },
    /// The program has no such row, or this is an observation, which depends on the state alone.
    #[error("{0:?} is no variable of the step, or the observation depends on more than the state")]
    Variable(Variable),
}

/// Numbers of variables of a tape, which are its first registers: states, inputs, parameters, then the period.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) states: usize,
    pub(super) inputs: usize,
    pub(super) parameters: usize,
}

/// What a tape is evaluated at: state, input, parameter (unit of each row) and period (s), as in its [`Layout`].
pub(super) type Arguments<'a, const NS: usize, const NU: usize, const NP: usize> =
    (&'a Vector<NS>, &'a Vector<NU>, &'a Vector<NP>, f64);

/// Compiled expressions of `M` matrices: every instruction writes the next register.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tape<const M: usize> {
    /// Registers before the first instruction: variables (zero), constants, results (zero). Their number is a power
    /// of two.
    initial: Vec<f64>,
    instructions: Vec<Instruction>,
    /// Register of the first result.
    first: usize,
    /// Number of registers in use.
    registers: usize,
    /// Register of every entry of each matrix, column by column.
    outputs: [Vec<u16>; M],
}

/// A matrix that is compiled, see [`Tape::compile`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Entries<'a> {
    ids: &'a [Id],
    columns: usize,
    size: (usize, usize),
}

/// An operation and the registers of its operands. Those that it does not need are any.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Instruction {
    operation: Operation,
    a: u16,
    b: u16,
    c: u16,
}

/// What an instruction computes. One that stands for two expressions rounds twice, as they do.
///
/// The frequent functions stand beside the groups of the others, so that one jump finds them.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Operation {
    /// `-a`
    Neg,
    /// `a + b`
    Add,
    /// `a - b`
    Sub,
    /// `a b`
    Mul,
    /// `a / b`
    Div,
    /// `(a b) + c`
    MulAdd,
    /// `(a b) - c`
    MulSub,
    /// `c - (a b)`
    SubMul,
    /// `(a b) c`
    MulMul,
    /// `(a / b) c`
    DivMul,
    /// `sin a`, and `cos a` in the register after it: with one reduction of the angle.
    SinCos,
    Unary(Unary),
    Binary(Binary),
    /// `b` where `a` is not 0, else `c`
    Select,
}

/// What a tape computes, made of its matrices in their order.
pub(super) trait Results {
    /// The results whose entries have the registers `outputs`; `of` is the value of a register.
    fn gather<const M: usize>(outputs: &[Vec<u16>; M], of: impl Fn(u16) -> f64) -> Self;
}

impl<const R: usize, const C: usize> Results for Matrix<R, C> {
    #[inline]
    fn gather<const M: usize>(outputs: &[Vec<u16>; M], of: impl Fn(u16) -> f64) -> Self {
        matrix(outputs, 0, of)
    }
}

impl<const NS: usize, const NP: usize> Results for Linearized<NS, NP> {
    #[inline]
    fn gather<const M: usize>(outputs: &[Vec<u16>; M], of: impl Fn(u16) -> f64) -> Self {
        Self {
            s_next: matrix(outputs, 0, &of),
            by_state: matrix(outputs, 1, &of),
            by_parameter: matrix(outputs, 2, &of),
        }
    }
}

impl<const NS: usize, const NU: usize> Results for LinearizedByInput<NS, NU> {
    #[inline]
    fn gather<const M: usize>(outputs: &[Vec<u16>; M], of: impl Fn(u16) -> f64) -> Self {
        Self {
            s_next: matrix(outputs, 0, &of),
            by_state: matrix(outputs, 1, &of),
            by_input: matrix(outputs, 2, &of),
        }
    }
}

/// The matrix at this position of `outputs`; zero if its shape is another one.
///
/// Entry by entry, constant ones too: with a number of entries that the compiler knows that is faster than a list of
/// those that vary.
#[inline]
fn matrix<const R: usize, const C: usize>(
    outputs: &[Vec<u16>],
    position: usize,
    of: impl Fn(u16) -> f64,
) -> Matrix<R, C> {
    let registers = outputs.get(position).and_then(|registers| registers.get(..R * C));
    registers.map_or_else(Matrix::zeros, |registers| {
        Matrix::from_fn(|row, column| of(registers[row + R * column]))
    })
}

impl Layout {
    /// Number of variables.
    fn len(self) -> usize {
        self.states + self.inputs + self.parameters + 1
    }

    /// Register of a variable; none of one that the tape is not given.
    fn register(self, variable: Variable) -> Option<usize> {
        let Self { states, inputs, parameters } = self;
        match variable {
            Variable::State(row) => (row < states).then_some(row),
            Variable::Input(row) => (row < inputs).then_some(states + row),
            Variable::Parameter(row) => (row < parameters).then_some(states + inputs + row),
            Variable::Period => Some(states + inputs + parameters),
        }
    }
}

impl<const M: usize> Tape<M> {
    /// The instructions that compute some matrices, each term once. A matrix is given by its entries row by row and
    /// their shape, and by the larger shape that it is filled up to with zeros.
    ///
    /// # Errors
    /// [`CompileError`].
    pub(super) fn compile(
        graph: &Graph,
        layout: Layout,
        matrices: [Entries<'_>; M],
    ) -> Result<Self, CompileError> {
        let selection = Selection::new(graph, matrices.iter().flat_map(|matrix| matrix.ids));
        // One more is the zero.
        let registers = layout.len() + 1 + selection.terms();
        if registers > REGISTERS_MAX {
            return Err(CompileError::TooLong { registers });
        }
        let mut initial = vec![0.0; layout.len() + 1];
        let zero = layout.len();
        let mut register = vec![zero; selection.len()];
        for (at, node) in selection.computed() {
            match node {
                Node::Variable(variable) => {
                    register[at] =
                        layout.register(variable).ok_or(CompileError::Variable(variable))?;
                }
                Node::Constant(bits) => {
                    register[at] = initial.len();
                    initial.push(f64::from_bits(bits));
                }
                Node::Unary(..) | Node::Binary(..) | Node::Select(..) => {}
            }
        }
        let first = initial.len();
        let mut next = first;
        let mut instructions = Vec::new();
        // In the order of the graph: operands come first.
        for (at, _) in selection.computed() {
            let Some((operation, operands)) = selection.instruction(at) else { continue };
            let [a, b, c] = operands.map(|id| narrow(register[id.position()]));
            instructions.push(Instruction { operation, a, b, c });
            for result in selection.results(at).into_iter().flatten() {
                register[result] = next;
                next += 1;
            }
        }
        let size = SIZES.into_iter().find(|size| next <= *size).unwrap_or(REGISTERS_MAX);
        initial.resize(size, 0.0);
        let outputs = matrices.map(|matrix| {
            let of = |id: Option<Id>| narrow(id.map_or(zero, |id| register[id.position()]));
            matrix.by_column().map(of).collect()
        });
        Ok(Self { initial, instructions, first, registers: next, outputs })
    }

    /// Number of registers in use: variables, constants and results.
    pub(super) fn registers(&self) -> usize {
        self.registers
    }

    /// The results at `at`. No allocation.
    #[inline]
    pub(super) fn evaluate<V: Results, const NS: usize, const NU: usize, const NP: usize>(
        &self,
        at: Arguments<'_, NS, NU, NP>,
    ) -> V {
        if self.instructions.is_empty() {
            // An observation that is a part of the state, or a constant Jacobian.
            return V::gather(&self.outputs, |register| self.given(at, register.into()));
        }
        // Registers are on the stack.
        match self.initial.len() {
            16 => self.at::<V, 16, NS, NU, NP>(at),
            32 => self.at::<V, 32, NS, NU, NP>(at),
            64 => self.at::<V, 64, NS, NU, NP>(at),
            256 => self.at::<V, 256, NS, NU, NP>(at),
            1024 => self.at::<V, 1024, NS, NU, NP>(at),
            _ => self.at::<V, REGISTERS_MAX, NS, NU, NP>(at),
        }
    }

    /// A variable or a constant.
    #[inline]
    fn given<const NS: usize, const NU: usize, const NP: usize>(
        &self,
        (s, u, p, dt_s): Arguments<'_, NS, NU, NP>,
        register: usize,
    ) -> f64 {
        let [inputs, parameters, period] = [NS, NS + NU, NS + NU + NP];
        match register {
            _ if register < inputs => s[register],
            _ if register < parameters => u[register - inputs],
            _ if register < period => p[register - parameters],
            _ if register == period => dt_s,
            _ => self.initial.get(register).copied().unwrap_or_default(),
        }
    }

    /// The results, with `N` registers.
    ///
    /// Not inlined: the largest number of registers would make every number of them reserve its stack.
    #[inline(never)]
    fn at<V: Results, const N: usize, const NS: usize, const NU: usize, const NP: usize>(
        &self,
        (s, u, p, dt_s): Arguments<'_, NS, NU, NP>,
    ) -> V {
        let mut registers = [0.0; N];
        if let Some(initial) = self.initial.first_chunk::<N>() {
            registers = *initial;
        }
        registers[..NS].copy_from_slice(s.as_slice());
        registers[NS..NS + NU].copy_from_slice(u.as_slice());
        registers[NS + NU..NS + NU + NP].copy_from_slice(p.as_slice());
        registers[NS + NU + NP] = dt_s;
        run(&self.instructions, self.first, &mut registers);
        V::gather(&self.outputs, |register| registers[usize::from(register) & (N - 1)])
    }
}

/// Computes the registers from the `next` one on.
#[inline]
fn run<const N: usize>(instructions: &[Instruction], mut next: usize, registers: &mut [f64; N]) {
    // `N` is a power of two: a masked index needs no check.
    let mask = N - 1;
    for &Instruction { operation, a, b, c } in instructions {
        let of = |register: u16| registers[usize::from(register) & mask];
        let value = match operation {
            Operation::Neg => -of(a),
            Operation::Add => of(a) + of(b),
            Operation::Sub => of(a) - of(b),
            Operation::Mul => of(a) * of(b),
            Operation::Div => of(a) / of(b),
            Operation::MulAdd => of(a) * of(b) + of(c),
            Operation::MulSub => of(a) * of(b) - of(c),
            Operation::SubMul => of(c) - of(a) * of(b),
            Operation::MulMul => of(a) * of(b) * of(c),
            Operation::DivMul => of(a) / of(b) * of(c),
            Operation::SinCos => {
                let (sin, cos) = of(a).sin_cos();
                registers[next & mask] = sin;
                next += 1;
                cos
            }
            Operation::Unary(function) => function.at(of(a)),
            Operation::Binary(function) => function.at(of(a), of(b)),
            Operation::Select => taken(of(a), of(b), of(c)),
        };
        registers[next & mask] = value;
        next += 1;
    }
}

impl<'a> Entries<'a> {
    /// Entries of a matrix of `columns` columns, filled up to the shape `size`.
    pub(super) fn new(ids: &'a [Id], columns: usize, size: (usize, usize)) -> Self {
        Self { ids, columns, size }
    }

    /// The entries of the larger matrix, column by column; none where it is filled up.
    fn by_column(self) -> impl Iterator<Item = Option<Id>> {
        let Self { ids, columns, size: (rows, larger) } = self;
        (0..rows * larger).map(move |at| {
            let (row, column) = (at % rows, at / rows);
            let id = ids.get(row * columns + column).filter(|_| column < columns);
            id.copied()
        })
    }
}

/// A register; there are at most [`REGISTERS_MAX`].
fn narrow(register: usize) -> u16 {
    u16::try_from(register).unwrap_or(u16::MAX)
}

#[cfg(test)]
mod tests;
