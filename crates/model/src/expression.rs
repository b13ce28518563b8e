//! Models as graphs of expressions: written at run time, with exact derivatives.
//!
//! For systems that are not known when the program is built, as those of the Python package. A graph is
//! differentiated once, and compiled to a list of instructions that needs neither allocation nor a
//! foreign language. A model in Rust is faster ([`crate::Model`], or the scalar type of feature `dual`).

mod derivative;
mod graph;
mod tape;

use nalgebra::{SMatrix, SVector};

use crate::model::{Driven, Linearized, Model};

pub use graph::{Binary, Graph, Id, Node, Unary, Variable};
pub use tape::{Arguments, Place, REGISTERS_MAX, Tape, TooLong};

/// Step and observation of a system with their derivatives, compiled.
#[derive(Debug, Clone, PartialEq)]
pub struct Program {
    dimensions: Dimensions,
    step: Tape,
    /// Step, then its Jacobians by state and by parameter, row by row.
    linearize: Tape,
    /// Step, then its Jacobians by state and by input, row by row.
    drive: Tape,
    observe: Tape,
    observe_by_state: Tape,
}

/// Numbers of rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Dimensions {
    /// Of the state.
    pub states: usize,
    /// Of the input.
    pub inputs: usize,
    /// Of the observation.
    pub observations: usize,
    /// Of the parameter.
    pub parameters: usize,
}

impl Program {
    /// The system `s' = step`, `o = observe` with `inputs` inputs and `parameters` parameters.
    ///
    /// # Errors
    /// [`TooLong`].
    pub fn compile(
        graph: &mut Graph,
        step: &[Id],
        observe: &[Id],
        (inputs, parameters): (usize, usize),
    ) -> Result<Self, TooLong> {
        let states = step.len();
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
        Ok(Self {
            dimensions: Dimensions { states, inputs, observations: observe.len(), parameters },
            step: Tape::compile(graph, &[(step, 1)])?,
            linearize: Tape::compile(
                graph,
                &[(step, 1), (&by_state, states), (&by_parameter, parameters)],
            )?,
            drive: Tape::compile(graph, &[(step, 1), (&by_state, states), (&by_input, inputs)])?,
            observe: Tape::compile(graph, &[(observe, 1)])?,
            observe_by_state: Tape::compile(graph, &[(&observe_by_state, states)])?,
        })
    }

    /// Numbers of rows.
    pub fn dimensions(&self) -> Dimensions {
        self.dimensions
    }

    /// Number of terms of the step with its Jacobians by state and parameter.
    pub fn terms(&self) -> usize {
        self.linearize.registers()
    }
}

/// A [`Program`] as [`Model`] of its dimensions or larger ones: rows beyond its own stay zero.
///
/// It has no names of rows and no curvature (the solvers use Gauss-Newton).
#[derive(Debug, Clone, Copy)]
pub struct Compiled<const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
    &'static Program,
);

impl<const NS: usize, const NU: usize, const NO: usize, const NP: usize> Compiled<NS, NU, NO, NP> {
    /// The model, unless the program has more rows.
    pub fn new(program: &'static Program) -> Option<Self> {
        let Dimensions { states, inputs, observations, parameters } = program.dimensions;
        let fits = states <= NS && inputs <= NU && observations <= NO && parameters <= NP;
        fits.then_some(Self(program))
    }

    /// Evaluates `tape` into a vector and two matrices.
    #[inline]
    fn fill<const A: usize, const B: usize>(
        tape: &Tape,
        at: &Arguments<'_>,
    ) -> (SVector<f64, NS>, SMatrix<f64, NS, A>, SMatrix<f64, NS, B>) {
        let (mut value, mut a, mut b) = (SVector::zeros(), SMatrix::zeros(), SMatrix::zeros());
        tape.evaluate(at, |Place { matrix, row, column }, entry| match matrix {
            0 => value[row] = entry,
            1 => a[(row, column)] = entry,
            _ => b[(row, column)] = entry,
        });
        (value, a, b)
    }
}

impl<const NS: usize, const NU: usize, const NO: usize, const NP: usize> Model<NS, NU, NO, NP>
    for Compiled<NS, NU, NO, NP>
{
    const NAME: &'static str = "compiled";

    fn step(
        &self,
        s: &SVector<f64, NS>,
        u: &SVector<f64, NU>,
        p: &SVector<f64, NP>,
        dt_s: f64,
    ) -> SVector<f64, NS> {
        let mut s_next = SVector::zeros();
        let at = Arguments { s: s.as_slice(), u: u.as_slice(), p: p.as_slice(), dt_s };
        self.0.step.evaluate(&at, |place, value| s_next[place.row] = value);
        s_next
    }

    fn step_by_state(
        &self,
        s: &SVector<f64, NS>,
        u: &SVector<f64, NU>,
        p: &SVector<f64, NP>,
        dt_s: f64,
    ) -> SMatrix<f64, NS, NS> {
        self.linearize(s, u, p, dt_s).by_state
    }

    fn step_by_input(
        &self,
        s: &SVector<f64, NS>,
        u: &SVector<f64, NU>,
        p: &SVector<f64, NP>,
        dt_s: f64,
    ) -> SMatrix<f64, NS, NU> {
        self.linearize_drive(s, u, p, dt_s).by_input
    }

    fn step_by_parameter(
        &self,
        s: &SVector<f64, NS>,
        u: &SVector<f64, NU>,
        p: &SVector<f64, NP>,
        dt_s: f64,
    ) -> SMatrix<f64, NS, NP> {
        self.linearize(s, u, p, dt_s).by_parameter
    }

    fn linearize(
        &self,
        s: &SVector<f64, NS>,
        u: &SVector<f64, NU>,
        p: &SVector<f64, NP>,
        dt_s: f64,
    ) -> Linearized<NS, NP> {
        let at = Arguments { s: s.as_slice(), u: u.as_slice(), p: p.as_slice(), dt_s };
        let (s_next, by_state, by_parameter) = Self::fill(&self.0.linearize, &at);
        Linearized { s_next, by_state, by_parameter }
    }

    fn linearize_drive(
        &self,
        s: &SVector<f64, NS>,
        u: &SVector<f64, NU>,
        p: &SVector<f64, NP>,
        dt_s: f64,
    ) -> Driven<NS, NU> {
        let at = Arguments { s: s.as_slice(), u: u.as_slice(), p: p.as_slice(), dt_s };
        let (s_next, by_state, by_input) = Self::fill(&self.0.drive, &at);
        Driven { s_next, by_state, by_input }
    }

    fn observe(&self, s: &SVector<f64, NS>) -> SVector<f64, NO> {
        let mut o = SVector::zeros();
        let at = Arguments { s: s.as_slice(), u: &[], p: &[], dt_s: 0.0 };
        self.0.observe.evaluate(&at, |place, value| o[place.row] = value);
        o
    }

    fn observe_by_state(&self, s: &SVector<f64, NS>) -> SMatrix<f64, NO, NS> {
        let mut by_state = SMatrix::zeros();
        let at = Arguments { s: s.as_slice(), u: &[], p: &[], dt_s: 0.0 };
        self.0
            .observe_by_state
            .evaluate(&at, |place, value| by_state[(place.row, place.column)] = value);
        by_state
    }
}

#[cfg(test)]
mod tests;
