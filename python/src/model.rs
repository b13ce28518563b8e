//! Models: the vehicles, and those that a user writes in Python.

use std::sync::{Mutex, PoisonError};

use horizon_estim::Observed;
use horizon_model::expression::{Dimensions, Program, Variable};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyList;
use tello_flight::cycle::ModelKind;

use crate::TelloError;
use crate::array;
use crate::expression::{Operand, Tracer};
use crate::sizes::{Handle, SIZES, too_large, visit};

/// Programs so far. Models are copied into solvers without a count of their users: equal programs are kept once,
/// and for ever.
static PROGRAMS: Mutex<Vec<&'static Program>> = Mutex::new(Vec::new());

/// A discrete-time system; see `tello_ctl.Model`.
#[pyclass(module = "tello_ctl", frozen, subclass)]
#[derive(Debug)]
pub(crate) struct Model {
    pub(crate) handle: Handle,
    /// Numbers of rows.
    #[pyo3(get)]
    states: usize,
    #[pyo3(get)]
    inputs: usize,
    #[pyo3(get)]
    observations: usize,
    #[pyo3(get)]
    parameters: usize,
}

impl Model {
    fn of(handle: Handle) -> Self {
        let Dimensions { states, inputs, observations, parameters } = handle.dimensions();
        Self { handle, states, inputs, observations, parameters }
    }

    /// Number of rows of each vector.
    pub(crate) fn dimensions(&self) -> Dimensions {
        self.handle.dimensions()
    }
}

#[pymethods]
impl Model {
    #[new]
    #[pyo3(signature = (step, observe, *, states, inputs, observations, parameters))]
    fn new(
        step: &Bound<'_, PyAny>,
        observe: &Bound<'_, PyAny>,
        states: usize,
        inputs: usize,
        observations: usize,
        parameters: usize,
    ) -> PyResult<Self> {
        let py = step.py();
        let given = Dimensions { states, inputs, observations, parameters };
        let size = SIZES.iter().find(|size| size.holds(given)).ok_or_else(too_large)?;
        let tracer = Tracer::default();
        let rows = |count, of: fn(usize) -> Variable| {
            let rows = PyList::new(py, tracer.variables(count, of))?;
            py.import("numpy")?.call_method1("array", (rows, "O"))
        };
        let s = rows(states, Variable::State)?;
        let u = rows(inputs, Variable::Input)?;
        let p = rows(parameters, Variable::Parameter)?;
        let s_next = step.call1((&s, u, p, tracer.variable(Variable::Period)))?;
        let s_next = ids(&tracer, "step", &s_next, states)?;
        let o = ids(&tracer, "observe", &observe.call1((s,))?, observations)?;
        let program =
            Program::compile_padded(&mut tracer.graph(), &s_next, &o, [given, size.dimensions()]);
        let program =
            program.map_err(|error| TelloError::new_err(format!("the model: {error}")))?;
        Ok(Self::of(Handle::Program(kept(program))))
    }

    /// A model of the vehicle: `lagged` (the default of flights), `kinematic` or `kinematic_published`.
    #[staticmethod]
    fn vehicle(name: &str) -> PyResult<Self> {
        Handle::vehicle(name).map(Self::of).ok_or_else(|| {
            let known = ModelKind::ALL.map(ModelKind::name).join(", ");
            TelloError::new_err(format!("name: expected one of {known}, given {name}"))
        })
    }

    /// The state one period of `dt` seconds later.
    fn step<'py>(
        &self,
        py: Python<'py>,
        s: Vec<f64>,
        u: Vec<f64>,
        p: Vec<f64>,
        dt: f64,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let s = array::checked("s", s, self.states)?;
        let u = array::checked("u", u, self.inputs)?;
        let p = array::checked("p", p, self.parameters)?;
        Ok(PyArray1::from_vec(py, self.handle.visit(Step { s: &s, u: &u, p: &p, dt_s: dt })?))
    }

    /// The expected observation of a state.
    fn observe<'py>(&self, py: Python<'py>, s: Vec<f64>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let s = array::checked("s", s, self.states)?;
        let o = self.handle.visit(Observe(&s))?;
        Ok(PyArray1::from_slice(py, o.get(..self.observations).unwrap_or(&o)))
    }

    fn __repr__(&self) -> String {
        format!(
            "<tello_ctl.Model {}: {} states, {} inputs, {} observations, {} parameters>",
            self.handle.name(),
            self.states,
            self.inputs,
            self.observations,
            self.parameters
        )
    }
}

/// The program, the same one for equal programs.
fn kept(program: Program) -> &'static Program {
    let mut programs = PROGRAMS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = programs.iter().find(|known| ***known == program) {
        return known;
    }
    let program: &'static Program = Box::leak(Box::new(program));
    programs.push(program);
    program
}

/// Result of a model's function, as expressions.
fn ids(
    tracer: &Tracer,
    function: &str,
    returned: &Bound<'_, PyAny>,
    count: usize,
) -> PyResult<Vec<horizon_model::expression::Id>> {
    let mut ids = Vec::with_capacity(count);
    for value in returned.try_iter()? {
        ids.push(tracer.id(&value?.extract::<Operand>()?)?);
    }
    if ids.len() == count {
        return Ok(ids);
    }
    Err(TelloError::new_err(format!("{function}: expected {count} values, returned {}", ids.len())))
}

/// [`horizon_model::Model::step`].
struct Step<'a> {
    s: &'a [f64],
    u: &'a [f64],
    p: &'a [f64],
    dt_s: f64,
}

/// An observation, of which the rows that are NaN are absent; zeros in the rows beyond.
pub(crate) fn observed<const N: usize>(values: &[f64]) -> Observed<N> {
    let o = padded(values);
    Observed { o, is_present: o.map(|o| !o.is_nan()).into() }
}

visit!(Step<'_> => Vec<f64>, |visitor, model| {
    let [s, u, p] = [visitor.s, visitor.u, visitor.p];
    let s_next = model.step(&padded(s), &padded(u), &padded(p), visitor.dt_s);
    s_next.as_slice().get(..s.len()).unwrap_or_default().to_vec()
});

/// [`horizon_model::Model::observe`].
struct Observe<'a>(&'a [f64]);

visit!(Observe<'_> => Vec<f64>, |visitor, model| {
    model.observe(&padded(visitor.0)).as_slice().to_vec()
});

/// `values` as the first rows of a longer vector; the others are zero.
pub(crate) fn padded<const N: usize>(values: &[f64]) -> nalgebra::SVector<f64, N> {
    nalgebra::SVector::from_fn(|row, _| values.get(row).copied().unwrap_or(0.0))
}
