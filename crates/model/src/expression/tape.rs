//! Expressions in the order in which they are computed, as a list of instructions.

use super::graph::{Binary, Graph, Id, Node, Unary, Variable, children};

/// Most registers of a tape.
pub const REGISTERS_MAX: usize = 4096;

/// A list of instructions has more registers than [`REGISTERS_MAX`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{registers} different terms, derivatives included; at most {REGISTERS_MAX} are possible")]
pub struct TooLong {
    /// Registers that it would take.
    pub registers: usize,
}

/// What a tape is evaluated at.
#[derive(Debug, Clone, Copy)]
pub struct Arguments<'a> {
    /// State. Unit of each row
    pub s: &'a [f64],
    /// Input. Unit of each row
    pub u: &'a [f64],
    /// Parameter. Unit of each row
    pub p: &'a [f64],
    /// Period. s
    pub dt_s: f64,
}

/// Compiled expressions: every instruction writes the next register.
#[derive(Debug, Clone, PartialEq)]
pub struct Tape {
    constants: Vec<f64>,
    variables: Vec<Variable>,
    instructions: Vec<Instruction>,
    /// Outputs that are not the constant zero.
    outputs: Vec<Output>,
}

/// Where an output of a tape belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// Position of its matrix in the list that was compiled.
    pub matrix: usize,
    /// Row of the matrix.
    pub row: usize,
    /// Column of the matrix.
    pub column: usize,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Output {
    place: Place,
    register: u16,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Instruction {
    Unary(Unary, u16),
    Binary(Binary, u16, u16),
}

impl Tape {
    /// The instructions that compute some matrices, each term once. A matrix is its entries row by row and its
    /// number of columns.
    ///
    /// # Errors
    /// More terms than [`REGISTERS_MAX`].
    pub fn compile(graph: &Graph, matrices: &[(&[Id], usize)]) -> Result<Self, TooLong> {
        let outputs: Vec<Id> =
            matrices.iter().flat_map(|(entries, _)| entries.iter().copied()).collect();
        let end = outputs.iter().map(|id| id.position() + 1).max().unwrap_or(0);
        let nodes: Vec<Node> = (0..end).map(|at| graph.node_at(at)).collect();
        let mut needed = vec![false; end];
        for id in &outputs {
            needed[id.position()] = true;
        }
        for at in (0..end).rev() {
            if needed[at] {
                for child in children(nodes[at]).into_iter().flatten() {
                    needed[child.position()] = true;
                }
            }
        }
        let registers = needed.iter().filter(|is_needed| **is_needed).count();
        if registers > REGISTERS_MAX {
            return Err(TooLong { registers });
        }
        let mut tape = Self {
            constants: Vec::new(),
            variables: Vec::new(),
            instructions: Vec::new(),
            outputs: Vec::new(),
        };
        let mut register = vec![0_u16; end];
        let mut next = 0_u16;
        // Constants, then variables, then terms in the order of the graph: children come first.
        for kind in 0..3 {
            for at in (0..end).filter(|at| needed[*at]) {
                let of = |id: Id| register[id.position()];
                match (kind, nodes[at]) {
                    (0, Node::Constant(bits)) => tape.constants.push(f64::from_bits(bits)),
                    (1, Node::Variable(variable)) => tape.variables.push(variable),
                    (2, Node::Unary(function, a)) => {
                        tape.instructions.push(Instruction::Unary(function, of(a)));
                    }
                    (2, Node::Binary(function, a, b)) => {
                        tape.instructions.push(Instruction::Binary(function, of(a), of(b)));
                    }
                    _ => continue,
                }
                register[at] = next;
                next += 1;
            }
        }
        for (matrix, (entries, columns)) in matrices.iter().enumerate() {
            for (position, id) in entries.iter().enumerate() {
                if !matches!(nodes[id.position()], Node::Constant(0)) {
                    let (row, column) = (position / columns, position % columns);
                    let place = Place { matrix, row, column };
                    tape.outputs.push(Output { place, register: register[id.position()] });
                }
            }
        }
        Ok(tape)
    }

    /// Number of registers: constants, variables and terms.
    pub fn registers(&self) -> usize {
        self.constants.len() + self.variables.len() + self.instructions.len()
    }

    /// The outputs at `at`, each given to `write` with its place; constant zeros are left out.
    ///
    /// No allocation. A variable that `at` does not have is zero.
    #[inline]
    pub fn evaluate(&self, at: &Arguments<'_>, write: impl FnMut(Place, f64)) {
        // Registers are on the stack, of the smallest size that holds them.
        match self.registers() {
            0..=64 => self.run::<64>(at, write),
            65..=256 => self.run::<256>(at, write),
            257..=1024 => self.run::<1024>(at, write),
            _ => self.run::<REGISTERS_MAX>(at, write),
        }
    }

    fn run<const N: usize>(&self, at: &Arguments<'_>, mut write: impl FnMut(Place, f64)) {
        let mut registers = [0.0; N];
        let mut next = self.constants.len().min(N);
        registers[..next].copy_from_slice(&self.constants[..next]);
        for variable in &self.variables {
            let row = |rows: &[f64], row: usize| rows.get(row).copied().unwrap_or(0.0);
            registers[next] = match *variable {
                Variable::State(of) => row(at.s, of),
                Variable::Input(of) => row(at.u, of),
                Variable::Parameter(of) => row(at.p, of),
                Variable::Period => at.dt_s,
            };
            next += 1;
        }
        // `N` is a power of two: a masked index needs no check.
        let at = |register: u16| usize::from(register) & (N - 1);
        for instruction in &self.instructions {
            let value = match *instruction {
                Instruction::Unary(function, a) => function.at(registers[at(a)]),
                Instruction::Binary(function, a, b) => {
                    function.at(registers[at(a)], registers[at(b)])
                }
            };
            registers[next & (N - 1)] = value;
            next += 1;
        }
        for output in &self.outputs {
            write(output.place, registers[at(output.register)]);
        }
    }
}
