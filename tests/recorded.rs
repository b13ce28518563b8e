//! How tests read the real flights, with the built-in settings of the identification.

use std::fs;
use std::path::{Path, PathBuf};

use horizon_estim::{IdentTable, Observed, Recording};
use horizon_model::rows::{Pose, Sticks, lag};
use nalgebra::SVector;
use serde::de::DeserializeOwned;
use serde_json::Value;
use tello_io::log::csv;

pub(crate) const DT_S: f64 = 0.02;

/// One key of the built-in settings.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
pub(crate) fn setting<T: DeserializeOwned>(key: &str) -> T {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/ident.json");
    let settings: Value = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
    serde_json::from_value(settings[key].clone()).unwrap()
}

pub(crate) fn dead_time_s() -> Sticks {
    Sticks::from_column_slice(&setting::<Vec<f64>>("dead_time_s"))
}

/// The parameter that the identification expects.
pub(crate) fn p_prior() -> SVector<f64, { lag::COUNT }> {
    SVector::from_column_slice(&setting::<IdentTable>("map").p_prior)
}

/// A recorded flight; `turn_rad` is added to its headings.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
pub(crate) fn read(path: &Path, turn_rad: f64) -> Recording<4, 4> {
    let flight = csv::read(path).unwrap();
    let steps = flight.rows.last().map_or(0, |row| usize::try_from(row.step).unwrap() + 1);
    let mut o = vec![Observed::missing(); steps];
    let mut sticks = vec![None; steps];
    for row in &flight.rows {
        let step = usize::try_from(row.step).unwrap();
        if let Some(pos) = row.pos {
            o[step] = Observed::full(pos + Pose::new(0.0, 0.0, 0.0, turn_rad));
        }
        sticks[step] = row.input;
    }
    // A torn line leaves the sticks where they were.
    let mut held = Sticks::zeros();
    let u = sticks.into_iter().map(|sticks| {
        held = sticks.unwrap_or(held);
        held
    });
    Recording { u: u.collect(), o }
}

/// The flights of `folder` whose names begin with `prefix`, by name.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
pub(crate) fn logs(folder: &Path, prefix: &str) -> Vec<PathBuf> {
    let mut paths: Vec<PathBuf> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.file_name().unwrap().to_str().unwrap().starts_with(prefix))
        // Two flights ended before they began.
        .filter(|path| csv::read(path).unwrap().rows.len() > 120)
        .collect();
    paths.sort();
    paths
}
