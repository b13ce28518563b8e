//! Settings of solvers as Python gives them: some keys of a table, with the lengths of the user's model.

use horizon_control::MpcTable;
use horizon_estim::{ArrivalTable, IdentTable, MheTable};
use horizon_model::expression::Dimensions;
use pyo3::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use tello_io::config;

use crate::sizes::{Handle, SIZES};
use crate::{TelloError, raised};

/// Bounds of a parameter that has none.
pub(crate) const WIDE: f64 = 1e6;

/// `default` with the keys of the JSON object `changes`, the argument `name`, in place of its own.
///
/// # Errors
/// An unknown key, or a value of another type.
pub(crate) fn merged<T: Serialize + DeserializeOwned>(
    name: &'static str,
    default: &T,
    changes: &str,
) -> PyResult<T> {
    let mut table = serde_json::to_value(default).map_err(raised)?;
    let changes: Value = serde_json::from_str(changes).map_err(raised)?;
    merge(&mut table, changes);
    config::parse(&table.to_string()).map_err(|error| raised(error.context(name)))
}

/// Objects key by key, unless the change is another variant of an enum; anything else as a whole.
fn merge(table: &mut Value, changes: Value) {
    match (table, changes) {
        (Value::Object(table), Value::Object(changes)) => {
            // Variants are named by their only key, or by `kind`.
            let is_outer = table.len() == 1 && changes.keys().all(|key| !table.contains_key(key));
            let is_kind = changes.get("kind").is_some_and(|kind| table.get("kind") != Some(kind));
            if is_kind || (is_outer && !changes.is_empty()) {
                table.clear();
            }
            for (key, change) in changes {
                merge(table.entry(key).or_insert(Value::Null), change);
            }
        }
        (table, changes) => *table = changes,
    }
}

/// # Errors
/// No positive number.
pub(crate) fn period(dt_s: f64) -> PyResult<()> {
    if dt_s > 0.0 && dt_s.is_finite() {
        return Ok(());
    }
    Err(TelloError::new_err(format!("dt: expected a period above 0 s, given {dt_s}")))
}

/// Fills `values` up to `count`.
pub(crate) fn fill(values: &mut Vec<f64>, count: usize, with: f64) {
    values.resize(count.max(values.len()), with);
}

/// Fills weights, prior and bounds of parameters that are held at zero.
pub(crate) fn fill_parameters(count: usize, [c_p, p_prior, p_lb, p_ub]: [&mut Vec<f64>; 4]) {
    fill(c_p, count, 1.0);
    for values in [p_prior, p_lb, p_ub] {
        fill(values, count, 0.0);
    }
}

/// The lengths that the vectors of a table must have.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rows {
    /// Whose settings they are.
    pub(crate) table: &'static str,
    /// Numbers of rows of the model.
    pub(crate) dimensions: Dimensions,
}

impl Rows {
    /// # Errors
    /// The first vector of another length.
    pub(crate) fn check_mhe(self, table: &MheTable) -> PyResult<()> {
        let Dimensions { states, observations, .. } = self.dimensions;
        self.length("C_o", &table.c_o, observations)?;
        self.length("C_s", &table.c_s, states)?;
        if let ArrivalTable::Carried { c_0, .. } = &table.arrival {
            self.length("arrival.carried.C_0", c_0, states)?;
        }
        self.parameters([&table.c_p, &table.p_prior, &table.p_lb, &table.p_ub])
    }

    /// # Errors
    /// The first vector of another length.
    pub(crate) fn check_ident(self, table: &IdentTable) -> PyResult<()> {
        let Dimensions { states, observations, .. } = self.dimensions;
        self.length("C_o", &table.c_o, observations)?;
        self.length("C_s", &table.c_s, states)?;
        self.length("C_0", &table.c_0, states)?;
        self.parameters([&table.c_p, &table.p_prior, &table.p_lb, &table.p_ub])
    }

    /// # Errors
    /// The first vector of another length.
    pub(crate) fn check_mpc(self, table: &MpcTable) -> PyResult<()> {
        let Dimensions { states, inputs, .. } = self.dimensions;
        self.length("C_s", &table.c_s, states)?;
        self.length("C_s_end", &table.c_s_end, states)?;
        self.length("C_u", &table.c_u, inputs)?;
        self.length("u_lb", &table.u_lb, inputs)?;
        self.length("u_ub", &table.u_ub, inputs)
    }

    fn parameters(self, [c_p, p_prior, p_lb, p_ub]: [&[f64]; 4]) -> PyResult<()> {
        for (key, values) in [("C_p", c_p), ("p_prior", p_prior), ("p_lb", p_lb), ("p_ub", p_ub)] {
            self.length(key, values, self.dimensions.parameters)?;
        }
        Ok(())
    }

    fn length(self, key: &str, values: &[f64], count: usize) -> PyResult<()> {
        if values.len() == count {
            return Ok(());
        }
        let Self { table, .. } = self;
        let given = values.len();
        Err(TelloError::new_err(format!("{table}: {key}: expected {count} values, given {given}")))
    }

    /// Calls `fill` with the dimensions of the solver that a traced model takes.
    pub(crate) fn pad(self, model: Handle, fill: impl FnOnce(Dimensions)) {
        let size = SIZES.iter().find(|size| size.holds(self.dimensions));
        if let (Handle::Program(_), Some(size)) = (model, size) {
            fill(size.dimensions());
        }
    }
}
