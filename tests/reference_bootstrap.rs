//! Uncertainty of the identification on the thesis' 89 pieces, against its reference.

use std::fs;

use horizon_estim::{Ident, IdentSettings, Laplace, LmTable, Observed, Piece, Spread, bootstrap};
use horizon_model::Kinematic;
use serde_json::Value;
use tello_io::log::csv;

use crate::support;

const DT_S: f64 = 0.02;

/// The weights and free bounds of the reference.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn settings() -> IdentSettings<4, 4, 4> {
    IdentSettings::builder([0.9, 0.6, 0.9, 0.0])
        .c_o([3.0, 3.0, 2.0, 0.3])
        .c_s([1.0, 1.0, 0.1, 0.3])
        .c_p([1.0; 4])
        .bounds([0.1, 0.1, 0.1, -3.0], [10.0, 10.0, 10.0, 3.0])
        .solver(LmTable { damping_start: 1e-8, step_tolerance: 1e-8, ..LmTable::default() })
        .build(&Kinematic)
        .unwrap()
}

/// The identification of the thesis' pieces, solved, if the data are there.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn solved() -> Option<Ident<Kinematic, 4, 4, 4, 4>> {
    let folder = support::data("thesis/pieces")?;
    let entries = fs::read_dir(folder).unwrap();
    let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let piece = |path: &std::path::PathBuf| {
        let rows = csv::read(path).unwrap().rows;
        let u = rows.iter().map(|row| row.input.unwrap()).collect();
        let o = rows.iter().map(|row| Observed::full(row.pos.unwrap())).collect();
        Piece { u, o }
    };
    let pieces = paths.iter().map(piece).collect();
    let mut ident = Ident::new(Kinematic, &settings(), DT_S, pieces).unwrap();
    let report = ident.solve(&mut || false).unwrap();
    assert!(report.iterations < 100, "{report:?}");
    Some(ident)
}

/// Standard deviations of the reference's bootstrap of 300.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn reference_std() -> Vec<f64> {
    let text = fs::read_to_string(support::data("reference.json").unwrap()).unwrap();
    let reference: Value = serde_json::from_str(&text).unwrap();
    let std = &reference["identification"]["bootstrap_300_equation_4_1"]["std"];
    std.as_array().unwrap().iter().map(|std| std.as_f64().unwrap()).collect()
}

#[test]
fn the_bootstrap_finds_the_deviations_of_the_reference() {
    let Some(ident) = solved() else { return };
    let resamples: Vec<u64> = (0..300).collect();
    let done = bootstrap(&ident, 1, &resamples, &|| false, &|_| ()).unwrap();
    let estimates: Vec<_> = done.iter().map(|resample| resample.p).collect();
    let spread = Spread::of(&estimates).unwrap();
    for (row, (std, expected)) in spread.std.iter().zip(reference_std()).enumerate() {
        // Each bootstrap of 300 knows a deviation to 4 %.
        assert!((std / expected - 1.0).abs() < 0.15, "row {row}: {std} instead of {expected}");
    }
}

#[test]
fn the_sandwich_over_pieces_agrees_where_white_residuals_would_not() {
    let Some(ident) = solved() else { return };
    let laplace = Laplace::of(&ident).unwrap();
    let std = |covariance| Spread::normal(ident.parameter(), covariance).std;
    let [scaled, clustered] = [&laplace.scaled, &laplace.clustered].map(std);
    for (row, expected) in reference_std().into_iter().enumerate() {
        let ratio = clustered[row] / expected;
        assert!((ratio - 1.0).abs() < 0.15, "row {row}: {ratio}");
    }
    // Real residuals are correlated over half a second: as if white they claim far too much.
    assert!(
        scaled[horizon_model::rows::gain::LAMBDA_H]
            < 0.1 * clustered[horizon_model::rows::gain::LAMBDA_H]
    );
}
