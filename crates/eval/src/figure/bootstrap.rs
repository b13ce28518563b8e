//! Thesis figure 5.3: how the estimates of a bootstrap spread.

use horizon_estim::NORMAL_HALF_WIDTH;
use horizon_model::Row;

use super::axis::{Axis, is_drawable};
use super::drawing::{BLACK, BLUE, Color, Figure, SKY, Stroke, VERMILION};
use super::label;
use super::legend::Mark;
use super::panel::{Below, Panel, Strip};
use crate::quantile;

/// Panels side by side, and the height of each. px
const COLUMNS: usize = 4;
const HEIGHT_PX: f64 = 210.0;

/// Where the two columns of a panel stand on its x axis from 0 to 1.
const BOOTSTRAP_X: f64 = 0.31;
const LAPLACE_X: f64 = 0.8;

/// Half the width of violin, box, and end of a bar on that axis.
const VIOLIN_X: f64 = 0.27;
const BOX_X: f64 = 0.08;
const END_X: f64 = 0.05;

const ESTIMATE: Stroke = Stroke::dashed(VERMILION, 1.5, 4.0);
const EDGE: Stroke = Stroke::solid(BLACK, 1.2);
const MEDIAN: Stroke = Stroke::solid(BLACK, 2.4);
const LAPLACE: Stroke = Stroke::solid(BLUE, 2.0);
const VIOLIN: Color = SKY.faded(0.35);
const BOX: Color = SKY;
const OUTSIDE: Color = BLACK.faded(0.5);
const OUTSIDE_PX: f64 = 1.6;

/// One parameter.
#[derive(Debug, Clone)]
pub(crate) struct BootstrapRow {
    /// Name and unit.
    pub row: Row,
    /// The estimate from all data. In the unit of its label
    pub estimate: f64,
    /// The estimates from the resamples, in any order. In the unit of its label
    pub samples: Vec<f64>,
    /// Standard deviation by the Laplace approximation, if there is one. In the unit of its label
    pub laplace_std: Option<f64>,
}

/// A panel for each parameter in its own scale: violin and box of the resamples, the estimate from
/// all data, and the interval of the Laplace approximation.
///
/// The box holds the middle half, the whiskers 95 %; what lies outside is drawn as dots.
pub(crate) fn bootstrap(title: &str, rows: &[BootstrapRow]) -> Figure {
    let mut figure = Figure::begin(
        title,
        &[
            (Mark::Line(ESTIMATE), "estimate from all data"),
            (Mark::Patch(BOX), "middle half of the resamples, whiskers 95 %"),
            (Mark::Dots(OUTSIDE_PX, OUTSIDE), "resamples outside"),
            (Mark::Patch(VIOLIN), "their density"),
            (Mark::Line(LAPLACE), "Laplace, 95 %"),
        ],
    );
    let names = [(BOOTSTRAP_X, "bootstrap"), (LAPLACE_X, "Laplace")];
    let below = Below::Names(&names);
    let strip = Strip { columns: COLUMNS, height_px: HEIGHT_PX, heading_lines: 2, below };
    for side_by_side in rows.chunks(COLUMNS) {
        let areas = strip.place(&mut figure);
        for (row, area) in side_by_side.iter().zip(areas) {
            let laplace = laplace_interval(row);
            let values = row.samples.iter().copied().chain(laplace).chain([row.estimate]);
            let y = Axis::over(values).map(|axis| axis.padded(0.05));
            let axes = (Some(Axis { low: 0.0, high: 1.0 }), y);
            if let Some(panel) = Panel::open(&mut figure, area, axes, below, (&heading(row), "")) {
                spread(&mut figure, &panel, &row.samples);
                panel.horizontal(&mut figure, row.estimate, ESTIMATE);
                bar(&mut figure, &panel, laplace);
                let estimate = (LAPLACE_X, row.estimate);
                if row.laplace_std.is_some() {
                    panel.dots(&mut figure, &[estimate], 3.0, LAPLACE.color);
                }
            }
        }
    }
    figure.end()
}

/// The central 95 % of the normal distribution around the estimate, NaN without a standard deviation.
fn laplace_interval(row: &BootstrapRow) -> [f64; 2] {
    let half = NORMAL_HALF_WIDTH * row.laplace_std.unwrap_or(f64::NAN);
    [row.estimate - half, row.estimate + half]
}

/// Name with unit, and the estimate with the standard deviation of the resamples, which has two
/// digits.
fn heading(row: &BootstrapRow) -> [String; 2] {
    let samples = finite(&row.samples);
    let mean = samples.iter().sum::<f64>() / samples.len() as f64;
    let squares = samples.iter().map(|sample| (sample - mean).powi(2)).sum::<f64>();
    let std = (squares / (samples.len() as f64 - 1.0)).sqrt();
    let value = if std > 0.0 {
        let digits = horizon_model::whole((1.0 - std.log10().floor()).clamp(0.0, 9.0));
        format!("{:.digits$} (std {std:.digits$})", row.estimate)
    } else {
        format!("{:.4}", row.estimate)
    };
    [label(&row.row), value]
}

fn finite(values: &[f64]) -> Vec<f64> {
    values.iter().copied().filter(|&value| is_drawable(value)).collect()
}

fn bar(figure: &mut Figure, panel: &Panel, [low, high]: [f64; 2]) {
    panel.segment(figure, (LAPLACE_X, low), (LAPLACE_X, high), LAPLACE);
    for end in [low, high] {
        panel.segment(figure, (LAPLACE_X - END_X, end), (LAPLACE_X + END_X, end), LAPLACE);
    }
}

fn spread(figure: &mut Figure, panel: &Panel, samples: &[f64]) {
    let samples = finite(samples);
    let fractions = [0.025, 0.25, 0.5, 0.75, 0.975].map(|fraction| quantile(&samples, fraction));
    let [Some(low), Some(lower), Some(median), Some(upper), Some(high)] = fractions else {
        return;
    };
    panel.polygon(figure, &violin(&samples, upper - lower), VIOLIN);
    for (from, to) in [(lower, low), (upper, high)] {
        panel.segment(figure, (BOOTSTRAP_X, from), (BOOTSTRAP_X, to), EDGE);
        panel.segment(figure, (BOOTSTRAP_X - END_X, to), (BOOTSTRAP_X + END_X, to), EDGE);
    }
    let (left, right) = (BOOTSTRAP_X - BOX_X, BOOTSTRAP_X + BOX_X);
    panel.rectangle(figure, (left, lower), (right, upper), BOX);
    let corners = [(left, lower), (right, lower), (right, upper), (left, upper), (left, lower)];
    panel.line(figure, &corners, EDGE);
    panel.segment(figure, (left, median), (right, median), MEDIAN);
    let is_outside = |sample: &&f64| **sample < low || **sample > high;
    let outside: Vec<_> =
        samples.iter().filter(is_outside).map(|&sample| (BOOTSTRAP_X, sample)).collect();
    panel.dots(figure, &outside, OUTSIDE_PX, OUTSIDE);
}

/// Outline of a Gaussian kernel density over the range of `samples`, as wide as [`VIOLIN_X`] allows.
///
/// Bandwidth from the quartiles, 0.79 IQR n^(-1/5) (Silverman, Density estimation, 1986, equation 3.29).
fn violin(samples: &[f64], quartile_range: f64) -> Vec<(f64, f64)> {
    const STEPS: u32 = 80;
    let Some(Axis { low, high }) = Axis::over(samples.iter().copied()) else {
        return Vec::new();
    };
    let bandwidth =
        (0.79 * quartile_range * (samples.len() as f64).powf(-0.2)).max(1e-3 * (high - low));
    let density = |at: f64| {
        let kernels = samples.iter().map(|sample| (at - sample) / bandwidth);
        kernels.map(|z| (-0.5 * z * z).exp()).sum::<f64>()
    };
    let places = (0..=STEPS).map(|i| low + (high - low) * f64::from(i) / f64::from(STEPS));
    let outline: Vec<_> = places.map(|at| (density(at), at)).collect();
    let widest = outline.iter().map(|(width, _)| *width).fold(f64::MIN_POSITIVE, f64::max);
    let side = |sign: f64| {
        move |&(width, at): &(f64, f64)| (BOOTSTRAP_X + sign * VIOLIN_X * width / widest, at)
    };
    outline.iter().map(side(-1.0)).chain(outline.iter().rev().map(side(1.0))).collect()
}

#[cfg(test)]
mod tests;
