//! A model of run-time dimensions as one of compile-time dimensions.
//!
//! The solvers have their dimensions as types. A traced model takes the smallest of [`SIZES`] that holds it;
//! its rows beyond those of the user are zero, weigh nothing and are bounded by zero.

use std::fmt;

use horizon_model::Model;
use horizon_model::expression::{Compiled, Dimensions, Program};
use horizon_model::rows::{pose, stick};
use pyo3::prelude::*;
use tello_flight::cycle::{ModelKind, WithModel};

use crate::TelloError;

/// Model for solvers that move between threads.
pub(crate) trait AnyModel<const NS: usize, const NU: usize, const NO: usize, const NP: usize>:
    Model<NS, NU, NO, NP> + Send + Sync + 'static
{
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> AnyModel<NS, NU, NO, NP>
    for M
where
    M: Model<NS, NU, NO, NP> + Send + Sync + 'static,
{
}

/// Something to do with a model once its dimensions are types. `NR`: controllable states.
pub(crate) trait Visit {
    /// Result.
    type Out;

    /// Does it.
    fn visit<
        M,
        const NS: usize,
        const NU: usize,
        const NO: usize,
        const NP: usize,
        const NR: usize,
    >(
        self,
        model: M,
    ) -> Self::Out
    where
        M: AnyModel<NS, NU, NO, NP>;
}

/// Implements [`Visit`] for `$visitor`: `$out` comes of it, by `$body`, in which `M` is the model's type and `NS`,
/// `NU`, `NO`, `NP` and `NR` are its dimensions.
macro_rules! visit {
    ($visitor:ty => $out:ty, |$this:ident, $model:ident| $body:block) => {
        impl $crate::sizes::Visit for $visitor {
            type Out = $out;

            fn visit<
                M,
                const NS: usize,
                const NU: usize,
                const NO: usize,
                const NP: usize,
                const NR: usize,
            >(
                self,
                $model: M,
            ) -> Self::Out
            where
                M: $crate::sizes::AnyModel<NS, NU, NO, NP>,
            {
                let $this = self;
                $body
            }
        }
    };
}
pub(crate) use visit;

/// Largest dimensions of a solver.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Size(Dimensions);

impl Size {
    const fn new(states: usize, inputs: usize, observations: usize, parameters: usize) -> Self {
        Self(Dimensions { states, inputs, observations, parameters })
    }

    /// Numbers of rows.
    pub(crate) fn dimensions(self) -> Dimensions {
        self.0
    }

    /// Whether a model of these dimensions fits.
    pub(crate) fn holds(&self, given: Dimensions) -> bool {
        let Dimensions { states, inputs, observations, parameters } = self.0;
        (1..=states).contains(&given.states)
            && given.inputs <= inputs
            && given.observations <= observations
            && given.parameters <= parameters
    }
}

impl fmt::Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Dimensions { states, inputs, observations, parameters } = self.0;
        write!(
            f,
            "{states} states, {inputs} inputs, {observations} observations and {parameters} parameters"
        )
    }
}

/// Which model.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Handle {
    /// A model of the vehicle.
    Vehicle(ModelKind),
    /// A traced model.
    Program(&'static Program),
}

impl Handle {
    /// The vehicle of this name.
    pub(crate) fn vehicle(name: &str) -> Option<Self> {
        ModelKind::ALL.into_iter().find(|known| known.name() == name).map(Self::Vehicle)
    }

    /// Name of a vehicle; traced models have none.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Vehicle(kind) => kind.name(),
            Self::Program(_) => "traced",
        }
    }

    /// Numbers of rows.
    pub(crate) fn dimensions(self) -> Dimensions {
        match self {
            Self::Vehicle(kind) => kind.with(RowCounts),
            Self::Program(program) => program.dimensions(),
        }
    }

    /// Calls `visit` with the model.
    ///
    /// # Errors
    /// A traced model that is larger than every size.
    pub(crate) fn visit<V: Visit>(self, visit: V) -> PyResult<V::Out> {
        match self {
            Self::Vehicle(kind) => Ok(kind.with(Visiting(visit))),
            Self::Program(program) => visit_program(program, visit),
        }
    }
}

/// Numbers of rows of a vehicle.
struct RowCounts;

impl WithModel for RowCounts {
    type Output = Dimensions;

    fn run<M, const NS: usize, const NP: usize, const NR: usize>(self, _model: M) -> Dimensions {
        let (inputs, observations) = (stick::COUNT, pose::COUNT);
        Dimensions { states: NS, inputs, observations, parameters: NP }
    }
}

/// [`Visit`] of a vehicle.
struct Visiting<V>(V);

impl<V: Visit> WithModel for Visiting<V> {
    type Output = V::Out;

    fn run<M, const NS: usize, const NP: usize, const NR: usize>(self, model: M) -> V::Out
    where
        M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP> + Send + Sync + 'static,
    {
        self.0.visit::<M, NS, { stick::COUNT }, { pose::COUNT }, NP, NR>(model)
    }
}

/// [`SIZES`] and the function that picks one of them, from one list.
macro_rules! sizes {
    ($(($ns:literal, $nu:literal, $no:literal, $np:literal)),+) => {
        /// Sizes that solvers are built for, the smallest first; the last one is the largest.
        pub(crate) const SIZES: &[Size] = &[$(Size::new($ns, $nu, $no, $np)),+];

        fn visit_program<V: Visit>(program: &'static Program, visit: V) -> PyResult<V::Out> {
            $(if let Some(model) = Compiled::<$ns, $nu, $no, $np>::new(program) {
                return Ok(visit.visit::<_, $ns, $nu, $no, $np, $ns>(model));
            })+
            Err(too_large())
        }
    };
}

sizes!((2, 1, 2, 2), (4, 1, 2, 1), (4, 2, 4, 4), (6, 2, 6, 6), (8, 4, 8, 8), (12, 4, 12, 12));

/// No size holds the model.
pub(crate) fn too_large() -> PyErr {
    let largest = SIZES.last().map(ToString::to_string).unwrap_or_default();
    TelloError::new_err(format!("a model has at least one state and at most {largest}"))
}
