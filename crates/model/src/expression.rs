//! Models as graphs of expressions: written at run time, with exact derivatives.
//!
//! For systems that are not known when the program is built, as those of the Python package. A graph is
//! differentiated once, and compiled to a list of instructions that needs neither allocation nor a
//! foreign language. A model in Rust is faster ([`crate::Model`], or the scalar type of feature `dual`).

mod derivative;
mod graph;
mod tape;

use crate::{Matrix, Vector};
use nalgebra::ArrayStorage;

use crate::model::{Linearized, LinearizedByInput, Model};
use tape::{Arguments, Entries, Layout, Tape};

pub use graph::{Binary, Graph, Id, Node, Unary, Variable};
pub use tape::{CompileError, REGISTERS_MAX};

/// Step and observation of a system with their derivatives, compiled.
#[derive(Debug, Clone, PartialEq)]
pub struct Program {
    dimensions: Dimensions,
    /// Numbers of rows of the vectors with which the program is evaluated.
    size: Dimensions,
    step: Tape<1>,
    /// Step, then its Jacobians by state and by parameter.
    linearize: Tape<3>,
    /// Step, then its Jacobians by state and by input.
    drive: Tape<3>,
    observe: Tape<1>,
    observe_by_state: Tape<1>,
}

/// Numbers of rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Dimensions {
    /// Rows of the state.
    pub states: usize,
    /// Rows of the input.
    pub inputs: usize,
    /// Rows of the observation.
    pub observations: usize,
    /// Rows of the parameter.
    pub parameters: usize,
}

impl Program {
    /// The system `s' = step`, `o = observe` with `inputs` inputs and `parameters` parameters.
    ///
    /// # Errors
    /// [`CompileError`].
    pub fn compile(
        graph: &mut Graph,
        step: &[Id],
        observe: &[Id],
        (inputs, parameters): (usize, usize),
    ) -> Result<Self, CompileError> {
        let (states, observations) = (step.len(), observe.len());
        let size = Dimensions { states, inputs, observations, parameters };
        Self::compile_padded(graph, step, observe, [size, size])
    }

    /// The system of [`Program::compile`] with its `dimensions`, for a [`Compiled`] of a `size` that may have more
    /// rows.
    ///
    /// # Errors
    /// [`CompileError`].
    pub fn compile_padded(
        graph: &mut Graph,
        step: &[Id],
        observe: &[Id],
        [dimensions, size]: [Dimensions; 2],
    ) -> Result<Self, CompileError> {
        let Dimensions { states, inputs, parameters, .. } = dimensions;
        let mut jacobian = |of: &[Id], by: fn(usize) -> Variable, columns: usize| -> Vec<Id> {
            let columns: Vec<Vec<Id>> =
                (0..columns).map(|column| graph.derivatives(of, by(column))).collect();
            let row = |row: usize| columns.iter().map(move |column| column[row]);
            (0..of.len()).flat_map(row).collect()
        };
        let by_state = jacobian(step, Variable::State, states);
        let by_input = jacobian(step, Variable::Input, inputs);
        let by_parameter = jacobian(step, Variable::Parameter, parameters);
        let observe_by_state = jacobian(observe, Variable::State, states);
        let all = Layout { states: size.states, inputs: size.inputs, parameters: size.parameters };
        let seen = Layout { inputs: 0, parameters: 0, ..all };
        let next = Entries::new(step, 1, (size.states, 1));
        let by_state = Entries::new(&by_state, states, (size.states, size.states));
        let by_input = Entries::new(&by_input, inputs, (size.states, size.inputs));
        let by_parameter = Entries::new(&by_parameter, parameters, (size.states, size.parameters));
        let observation = Entries::new(observe, 1, (size.observations, 1));
        let observe_by_state =
            Entries::new(&observe_by_state, states, (size.observations, size.states));
        Ok(Self {
            dimensions,
            size,
            step: Tape::compile(graph, all, [next])?,
            linearize: Tape::compile(graph, all, [next, by_state, by_parameter])?,
            drive: Tape::compile(graph, all, [next, by_state, by_input])?,
            observe: Tape::compile(graph, seen, [observation])?,
            observe_by_state: Tape::compile(graph, seen, [observe_by_state])?,
        })
    }

    /// Numbers of states, inputs, parameters and observations.
    pub fn dimensions(&self) -> Dimensions {
        self.dimensions
    }

    /// Number of registers of the compiled step with its Jacobians by state and parameter: variables, constants and
    /// results. 1
    pub fn terms(&self) -> usize {
        self.linearize.registers()
    }
}

/// A [`Program`] as [`Model`] of the size that it was compiled for: rows beyond its own stay zero.
///
/// It has no names of rows and no curvature (the solvers use Gauss-Newton).
#[derive(Debug, Clone, Copy)]
pub struct Compiled<const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
    &'static Program,
);

impl<const NS: usize, const NU: usize, const NO: usize, const NP: usize> Compiled<NS, NU, NO, NP> {
    /// The model, if the program was compiled for this size.
    pub fn new(program: &'static Program) -> Option<Self> {
        let size = Dimensions { states: NS, inputs: NU, observations: NO, parameters: NP };
        (program.size == size).then_some(Self(program))
    }
}

impl<const NS: usize, const NU: usize, const NO: usize, const NP: usize> Model<NS, NU, NO, NP>
    for Compiled<NS, NU, NO, NP>
{
    const NAME: &'static str = "compiled";

    fn step(&self, s: &Vector<NS>, u: &Vector<NU>, p: &Vector<NP>, dt_s: f64) -> Vector<NS> {
        self.0.step.evaluate((s, u, p, dt_s))
    }

    fn step_by_state(
        &self,
        s: &Vector<NS>,
        u: &Vector<NU>,
        p: &Vector<NP>,
        dt_s: f64,
    ) -> Matrix<NS, NS> {
        self.linearize(s, u, p, dt_s).by_state
    }

    fn step_by_input(
        &self,
        s: &Vector<NS>,
        u: &Vector<NU>,
        p: &Vector<NP>,
        dt_s: f64,
    ) -> Matrix<NS, NU> {
        self.linearize_by_input(s, u, p, dt_s).by_input
    }

    fn step_by_parameter(
        &self,
        s: &Vector<NS>,
        u: &Vector<NU>,
        p: &Vector<NP>,
        dt_s: f64,
    ) -> Matrix<NS, NP> {
        self.linearize(s, u, p, dt_s).by_parameter
    }

    fn linearize(
        &self,
        s: &Vector<NS>,
        u: &Vector<NU>,
        p: &Vector<NP>,
        dt_s: f64,
    ) -> Linearized<NS, NP> {
        self.0.linearize.evaluate((s, u, p, dt_s))
    }

    fn linearize_by_input(
        &self,
        s: &Vector<NS>,
        u: &Vector<NU>,
        p: &Vector<NP>,
        dt_s: f64,
    ) -> LinearizedByInput<NS, NU> {
        self.0.drive.evaluate((s, u, p, dt_s))
    }

    fn observe(&self, s: &Vector<NS>) -> Vector<NO> {
        self.0.observe.evaluate(seen(s))
    }

    fn observe_by_state(&self, s: &Vector<NS>) -> Matrix<NO, NS> {
        self.0.observe_by_state.evaluate(seen(s))
    }
}

/// What an observation is computed from.
fn seen<const NS: usize>(s: &Vector<NS>) -> Arguments<'_, NS, 0, 0> {
    (s, &NOTHING, &NOTHING, 0.0)
}

/// A vector without rows.
const NOTHING: Vector<0> = Vector::<0>::from_array_storage(ArrayStorage([[]]));

#[cfg(test)]
mod tests;
