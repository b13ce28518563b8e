//! Identification of any model from recorded pieces.

use horizon_estim::{Curvature, Ident, IdentTable, LmTable, LossTable, Piece, standard_deviations};
use nalgebra::{SMatrix, SVector};
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

use crate::long_call::{self, Stop};
use crate::model::{Model, observed, padded};
use crate::settings::{self, Rows};
use crate::sizes::{Handle, visit};
use crate::{TelloError, array, raised};

/// Result of an identification.
pub(crate) struct Found {
    parameter: Vec<f64>,
    /// Standard deviation of each parameter by the Laplace approximation; NaN if it is not determined.
    deviation: Vec<f64>,
    cost: f64,
    iterations: u32,
    is_converged: bool,
}

/// Parameter, standard deviations, cost, iterations, whether it converged.
type Fitted = (Vec<f64>, Vec<f64>, f64, u32, bool);

/// Fits `model` to pieces of inputs and observations; see `tello_ctl.fit`.
///
#[pyfunction]
#[pyo3(signature = (model, pieces, dt, settings))]
#[expect(clippy::needless_pass_by_value, reason = "arguments come from Python by value")]
pub(crate) fn fit(
    py: Python<'_>,
    model: &Model,
    pieces: Vec<(PyReadonlyArray2<'_, f64>, PyReadonlyArray2<'_, f64>)>,
    dt: f64,
    settings: &str,
) -> PyResult<Fitted> {
    let dimensions = model.dimensions();
    let mut table: IdentTable = settings::merged("fit", &default_table(model.handle), settings)?;
    let rows = Rows { table: "fit", dimensions };
    rows.check_ident(&table)?;
    settings::period(dt)?;
    rows.pad(model.handle, |size| {
        settings::fill(&mut table.c_o, size.observations, 0.0);
        settings::fill(&mut table.c_s, size.states, 1.0);
        settings::fill(&mut table.c_0, size.states, 1.0);
        settings::fill_parameters(
            size.parameters,
            [&mut table.c_p, &mut table.p_prior, &mut table.p_lb, &mut table.p_ub],
        );
    });
    if pieces.is_empty() {
        return Err(TelloError::new_err(
            "pieces: expected at least one pair of inputs and observations",
        ));
    }
    let mut numbers = Vec::with_capacity(pieces.len());
    for (position, (u, o)) in pieces.iter().enumerate() {
        let name = |what: &str| format!("pieces[{position}]: {what}");
        let u = array::matrix(&name("inputs"), u, (None, dimensions.inputs))?;
        numbers.push((u, array::observations(&name("observations"), o, dimensions.observations)?));
    }
    let handle = model.handle;
    let parameters = dimensions.parameters;
    let visited = long_call::run(py, |stop| {
        Ok(handle.visit(Solve { table: &table, pieces: &numbers, dt_s: dt, parameters, stop }))
    })?;
    let found = visited?.map_err(raised)?;
    Ok((found.parameter, found.deviation, found.cost, found.iterations, found.is_converged))
}

/// Inputs and observations of a piece, row by row.
type Recorded = (Vec<Vec<f64>>, Vec<Vec<f64>>);

/// The problem.
struct Solve<'a> {
    table: &'a IdentTable,
    pieces: &'a [Recorded],
    dt_s: f64,
    parameters: usize,
    stop: &'a Stop,
}

visit!(Solve<'_> => anyhow::Result<Found>, |visitor, model| {
    let settings = visitor.table.check::<M, NS, NU, NO, NP>()?;
    let vectors = |(u, o): &Recorded| Piece::<NU, NO> {
        u: u.iter().map(|row| padded(row)).collect::<Vec<SVector<f64, NU>>>(),
        o: o.iter().map(|row| observed(row)).collect(),
    };
    let pieces = visitor.pieces.iter().map(vectors).collect();
    let mut ident = Ident::new(model, &settings, visitor.dt_s, pieces)?;
    let solved = ident.solve(&mut || visitor.stop.is_asked())?;
    // Without information where the data do not determine the states.
    let information = ident.information().unwrap_or_else(|_| SMatrix::zeros());
    let own = |rows: &SVector<f64, NP>| rows.iter().take(visitor.parameters).copied().collect();
    Ok(Found {
        parameter: own(ident.parameter()),
        deviation: own(&standard_deviations(&information)),
        cost: solved.cost,
        iterations: solved.iterations,
        is_converged: solved.is_converged(),
    })
});

/// Settings of an identification: weights of 1, the data alone.
fn default_table(model: Handle) -> IdentTable {
    let dimensions = model.dimensions();
    IdentTable {
        c_o: vec![1.0; dimensions.observations],
        c_s: vec![1.0; dimensions.states],
        c_p: vec![0.0; dimensions.parameters],
        c_0: vec![0.0; dimensions.states],
        p_prior: Vec::new(),
        p_lb: vec![-settings::WIDE; dimensions.parameters],
        p_ub: vec![settings::WIDE; dimensions.parameters],
        observation_loss: LossTable::None {},
        transition_loss: LossTable::None {},
        // Second derivatives of traced models are not compiled.
        curvature: match model {
            Handle::Vehicle(_) => Curvature::Exact,
            Handle::Program(_) => Curvature::GaussNewton,
        },
        solver: LmTable::default(),
    }
}
