//! Numbers of a configuration that fly better, found by batches of flights.
//!
//! What a number is and where it stands is `tuning/variable.rs`, what better means `tuning/objective.rs`, the
//! optimizer `tuning/search.rs`.

mod objective;
mod search;
mod variable;

use std::ops::Range;

use anyhow::Result;
use serde_json::Value;
use tello_flight::cycle::FlightTable;
use tello_io::config;

pub use self::objective::{WeightArgument, Weights};
pub use self::search::{Trial, best, minimize};
pub use self::variable::{Range as VariableRange, Scale, Variable};
use crate::SimTable;
use crate::batch::{self, Contender};

/// Setup of all trials.
#[derive(Debug)]
pub struct Setup {
    /// The flight's settings before.
    pub document: Value,
    /// The numbers to search.
    pub variables: Vec<Variable>,
    /// Weights of the cost.
    pub weights: Weights,
    /// The simulated world.
    pub sim: SimTable,
    /// Seeds of the flights of a trial.
    pub seeds: Range<u64>,
}

impl Setup {
    /// Where the search begins: the present numbers, as fractions of their ranges.
    ///
    /// # Errors
    /// A number that is missing or outside of its range.
    pub fn start(&self) -> Result<Vec<f64>> {
        self.variables.iter().map(|variable| variable.fraction(&self.document)).collect()
    }

    /// The flight's settings with the numbers at the fractions `x` of their ranges.
    ///
    /// # Errors
    /// A number that is missing.
    pub fn flight(&self, x: &[f64]) -> Result<Value> {
        let mut document = self.document.clone();
        for (variable, fraction) in self.variables.iter().zip(x) {
            variable.set(&mut document, *fraction)?;
        }
        Ok(document)
    }

    /// The cost at `x`; `None` if `is_interrupted` before its last flight. s
    ///
    /// # Errors
    /// Settings that break a rule.
    pub fn cost(
        &self,
        x: &[f64],
        is_interrupted: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<f64>> {
        let flight: FlightTable = config::from_value(&self.flight(x)?)?;
        let contender = Contender::new(flight, None)?;
        let flown =
            batch::fly(&[contender], &self.sim, self.seeds.clone(), is_interrupted, &|| {})?;
        let flown = flown.concat();
        let is_whole = flown.len() as u64 == self.seeds.end - self.seeds.start;
        Ok(is_whole.then(|| self.weights.cost(&flown)))
    }
}

#[cfg(test)]
mod tests;
