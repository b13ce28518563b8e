//! Model predictive controller of any model.

use horizon_control::{InputCost, MpcProblem, MpcTable, SolverTable, SqpError};
use horizon_model::expression::Dimensions;
use horizon_model::setting::SettingError;
use nalgebra::SVector;
use numpy::{PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::model::{Model, padded};
use crate::settings::{self, Rows};
use crate::sizes::{AnyModel, visit};
use crate::{array, raised};

/// See `tello_ctl.Mpc`.
#[pyclass(module = "tello_ctl", subclass)]
pub(crate) struct Mpc {
    controller: Box<dyn AnyMpc>,
    dimensions: Dimensions,
    /// Stages of the horizon.
    stages: usize,
}

/// A controller of any dimensions; vectors may be shorter than those of the model.
trait AnyMpc: Send + Sync {
    fn solve(&mut self, ask: &AnyAsk<'_>) -> Result<Ended, SqpError>;
    fn shift(&mut self);
    fn plan(&self, inputs: usize) -> Vec<f64>;
    fn states(&self, states: usize) -> Vec<f64>;
}

/// Cost, iterations and whether the plan is new.
type Ended = (f64, u32, bool);

/// Arguments of a solve.
struct AnyAsk<'a> {
    s: &'a [f64],
    p: &'a [f64],
    u_before: &'a [f64],
    /// One row for every stage, or one for all.
    reference: &'a [Vec<f64>],
}

/// A controller with the memory of its references.
struct Planned<
    M,
    const NS: usize,
    const NU: usize,
    const NO: usize,
    const NP: usize,
    const NR: usize,
> where
    M: AnyModel<NS, NU, NO, NP>,
{
    mpc: horizon_control::Mpc<M, NS, NU, NO, NP, NR>,
    s_ref: Vec<SVector<f64, NS>>,
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize, const NR: usize> AnyMpc
    for Planned<M, NS, NU, NO, NP, NR>
where
    M: AnyModel<NS, NU, NO, NP>,
{
    fn solve(&mut self, ask: &AnyAsk<'_>) -> Result<Ended, SqpError> {
        self.s_ref.clear();
        self.s_ref.extend(ask.reference.iter().map(|row| padded::<NS>(row)));
        if let [all] = self.s_ref[..] {
            self.s_ref.resize(self.mpc.settings().stage_steps().len(), all);
        }
        let (s, p, u_before) = (padded(ask.s), padded(ask.p), padded(ask.u_before));
        let solved =
            self.mpc.solve(&MpcProblem::new(&s, &p, &u_before, &self.s_ref), &mut || false);
        solved.map(|report| (report.cost, report.iterations, report.has_new_plan()))
    }

    fn shift(&mut self) {
        self.mpc.shift();
    }

    fn plan(&self, inputs: usize) -> Vec<f64> {
        self.mpc.plan().iter().flat_map(|u| u.iter().take(inputs)).copied().collect()
    }

    fn states(&self, states: usize) -> Vec<f64> {
        self.mpc.planned_states().iter().flat_map(|s| s.iter().take(states)).copied().collect()
    }
}

#[pymethods]
#[expect(clippy::needless_pass_by_value, reason = "arguments come from Python by value")]
impl Mpc {
    #[new]
    #[pyo3(signature = (model, dt, settings))]
    fn new(model: &Model, dt: f64, settings: &str) -> PyResult<Self> {
        let dimensions = model.dimensions();
        let mut table: MpcTable = settings::merged("Mpc", &default_table(dimensions), settings)?;
        if table.c_s_end.is_empty() {
            table.c_s_end.clone_from(&table.c_s);
        }
        let rows = Rows { table: "Mpc", dimensions };
        rows.check_mpc(&table)?;
        settings::period(dt)?;
        rows.pad(model.handle, |size| {
            settings::fill(&mut table.c_s, size.states, 0.0);
            settings::fill(&mut table.c_s_end, size.states, 0.0);
            settings::fill(&mut table.c_u, size.inputs, 1.0);
            settings::fill(&mut table.u_lb, size.inputs, 0.0);
            settings::fill(&mut table.u_ub, size.inputs, 0.0);
        });
        let controller = model.handle.visit(Build { table: &table, dt_s: dt })?;
        let (controller, stages) = controller.map_err(raised)?;
        Ok(Self { controller, dimensions, stages })
    }

    /// Plans; cost and number of accepted steps come back.
    #[pyo3(signature = (s, p, reference, u_before))]
    fn solve(
        &mut self,
        py: Python<'_>,
        s: PyReadonlyArray1<'_, f64>,
        p: PyReadonlyArray1<'_, f64>,
        reference: PyReadonlyArray2<'_, f64>,
        u_before: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Ended> {
        let Dimensions { states, inputs, parameters, .. } = self.dimensions;
        let s = array::vector("state", &s, states)?;
        let p = array::vector("parameter", &p, parameters)?;
        let is_one = reference.shape()[0] == 1;
        let rows = if is_one { 1 } else { self.stages };
        let reference = array::matrix("reference", &reference, (Some(rows), states))?;
        let u_before = array::vector("u_before", &u_before, inputs)?;
        let ask = AnyAsk { s: &s, p: &p, u_before: &u_before, reference: &reference };
        let controller = &mut self.controller;
        py.detach(|| controller.solve(&ask)).map_err(raised)
    }

    /// Moves the plan on by one period, the start of the next solution.
    fn shift(&mut self) {
        self.controller.shift();
    }

    /// The inputs of the plan, one row per stage.
    #[getter]
    fn plan<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let inputs = self.dimensions.inputs;
        array::owned(py, inputs, self.controller.plan(inputs))
    }

    /// The states of the plan.
    #[getter]
    fn planned_states<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let states = self.dimensions.states;
        array::owned(py, states, self.controller.states(states))
    }
}

/// A controller of the model, and its number of stages.
struct Build<'a> {
    table: &'a MpcTable,
    dt_s: f64,
}

visit!(Build<'_> => Result<(Box<dyn AnyMpc>, usize), SettingError>, |visitor, model| {
    let settings = visitor.table.check::<M, NS, NU, NO, NP>()?;
    let stages = settings.stage_steps().len();
    let mpc = horizon_control::Mpc::<M, NS, NU, NO, NP, NR>::new(model, settings, visitor.dt_s)?;
    Ok((Box::new(Planned { mpc, s_ref: Vec::with_capacity(stages) }), stages))
});

/// Settings of the controller: weights of 1 on states and 0.1 on inputs, inputs between -1 and 1, 25 steps.
fn default_table(dimensions: Dimensions) -> MpcTable {
    MpcTable {
        horizon_steps: 25,
        stages: Vec::new(),
        input_cost: InputCost::Absolute,
        c_u: vec![0.1; dimensions.inputs],
        c_s: vec![1.0; dimensions.states],
        c_s_end: Vec::new(),
        u_lb: vec![-1.0; dimensions.inputs],
        u_ub: vec![1.0; dimensions.inputs],
        solver: SolverTable::default(),
    }
}
