//! Moving horizon estimator of any model.

use horizon_estim::{ArrivalTable, LmTable, LossTable, MheError, MheTable, Observed};
use horizon_model::expression::Dimensions;
use horizon_model::setting::SettingError;
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use tello_flight::cycle::ModelKind;
use tello_io::config;

use crate::model::{Model, observed, padded};
use crate::settings::{self, Rows};
use crate::sizes::{AnyModel, Handle, visit};
use crate::{TelloError, array, raised};

/// See `tello_ctl.Mhe`.
#[pyclass(module = "tello_ctl", subclass)]
pub(crate) struct Mhe {
    estimator: Box<dyn AnyMhe>,
    dimensions: Dimensions,
}

/// An estimator of any dimensions; vectors may be shorter than those of the model.
trait AnyMhe: Send + Sync {
    fn start(&mut self, o: &[f64]) -> Result<(), MheError>;
    fn update(&mut self, u: &[f64], o: Option<&[f64]>) -> Result<(f64, u32, bool), MheError>;
    fn s_hat(&self) -> &[f64];
    fn p_hat(&self) -> &[f64];
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> AnyMhe
    for horizon_estim::Mhe<M, NS, NU, NO, NP>
where
    M: AnyModel<NS, NU, NO, NP>,
{
    fn start(&mut self, o: &[f64]) -> Result<(), MheError> {
        self.start(&padded(o)).map(|_| ())
    }

    fn update(&mut self, u: &[f64], o: Option<&[f64]>) -> Result<(f64, u32, bool), MheError> {
        let o = o.map_or_else(Observed::missing, observed);
        let solved = self.update(&padded(u), &o, &mut || false);
        solved.map(|report| (report.cost, report.iterations, report.is_converged()))
    }

    fn s_hat(&self) -> &[f64] {
        self.s_hat().as_slice()
    }

    fn p_hat(&self) -> &[f64] {
        self.p_hat().as_slice()
    }
}

#[pymethods]
#[expect(clippy::needless_pass_by_value, reason = "arguments come from Python by value")]
impl Mhe {
    #[new]
    #[pyo3(signature = (model, dt, settings))]
    fn new(model: &Model, dt: f64, settings: &str) -> PyResult<Self> {
        let dimensions = model.dimensions();
        let default = default_table(model.handle, dimensions)?;
        let mut table: MheTable = settings::merged("Mhe", &default, settings)?;
        let rows = Rows { table: "Mhe", dimensions };
        rows.check_mhe(&table)?;
        settings::period(dt)?;
        rows.pad(model.handle, |size| {
            settings::fill(&mut table.c_o, size.observations, 0.0);
            settings::fill(&mut table.c_s, size.states, 1.0);
            settings::fill_parameters(
                size.parameters,
                [&mut table.c_p, &mut table.p_prior, &mut table.p_lb, &mut table.p_ub],
            );
            if let ArrivalTable::Carried { c_0, .. } = &mut table.arrival {
                settings::fill(c_0, size.states, 1.0);
            }
        });
        let estimator = model.handle.visit(Build { table: &table, dt_s: dt })?;
        Ok(Self { estimator: estimator.map_err(raised)?, dimensions })
    }

    /// Starts, or starts again, at rest where `o` was observed.
    fn start(&mut self, o: PyReadonlyArray1<'_, f64>) -> PyResult<()> {
        let o = array::vector("o", &o, self.dimensions.observations)?;
        let started = self.estimator.start(&o);
        started.map_err(|error| TelloError::new_err(format!("o: no state is observed so: {error}")))
    }

    /// One period later: input, observation or None; cost and iterations come back.
    #[pyo3(signature = (u, o))]
    fn update(
        &mut self,
        py: Python<'_>,
        u: PyReadonlyArray1<'_, f64>,
        o: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<(f64, u32, bool)> {
        let u = array::vector("u", &u, self.dimensions.inputs)?;
        let observations = self.dimensions.observations;
        let o = o.map(|o| array::observation("o", &o, observations)).transpose()?;
        let estimator = &mut self.estimator;
        py.detach(|| estimator.update(&u, o.as_deref())).map_err(raised)
    }

    /// The newest state estimate.
    #[getter]
    fn state<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, first(self.estimator.s_hat(), self.dimensions.states))
    }

    /// The parameter estimate.
    #[getter]
    fn parameter<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, first(self.estimator.p_hat(), self.dimensions.parameters))
    }
}

fn first(values: &[f64], count: usize) -> &[f64] {
    values.get(..count).unwrap_or(values)
}

/// An estimator of the model.
struct Build<'a> {
    table: &'a MheTable,
    dt_s: f64,
}

visit!(Build<'_> => Result<Box<dyn AnyMhe>, SettingError>, |visitor, model| {
    let settings = visitor.table.check::<M, NS, NU, NO, NP>()?;
    Ok(Box::new(horizon_estim::Mhe::new(model, settings, visitor.dt_s)?))
});

/// Settings of the estimator: those of flights for their model, else least squares with weights of 1,
/// and 0.1 on the prior.
pub(crate) fn default_table(model: Handle, dimensions: Dimensions) -> PyResult<MheTable> {
    if matches!(model, Handle::Vehicle(ModelKind::Lagged)) {
        return Ok(config::fly(None, None).map_err(raised)?.0.cycle.mhe);
    }
    Ok(MheTable {
        window_steps: 30,
        c_o: vec![1.0; dimensions.observations],
        c_s: vec![1.0; dimensions.states],
        c_p: vec![0.1; dimensions.parameters],
        p_prior: Vec::new(),
        p_lb: vec![-settings::WIDE; dimensions.parameters],
        p_ub: vec![settings::WIDE; dimensions.parameters],
        observation_loss: LossTable::None {},
        transition_loss: LossTable::None {},
        arrival: ArrivalTable::Carried { c_0: vec![1.0; dimensions.states], forget_s: 60.0 },
        shift_prior: false,
        solver: LmTable { damping_start: 0.0, ..LmTable::default() },
    })
}
