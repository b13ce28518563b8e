//! Flights matched to the path that they followed: thesis figures 5.6 to 5.8.

use super::axis::{Axis, is_drawable};
use super::drawing::{BLACK, BLUE, Color, Figure, ORANGE, Stroke};
use super::legend::Mark;
use super::panel::{Below, Panel, Strip};
use super::quantity;
use crate::quantile;

/// Height of a panel. px
const HEIGHT_PX: f64 = 220.0;

/// Parts of the path of which each has a median and a band of its own.
const PARTS: usize = 75;

/// Points of the density.
const PLACES: u32 = 300;

/// Fraction of the samples below the band, and above it. 1
const TAIL: f64 = 0.025;

const COLORS: [Color; 2] = [BLUE, ORANGE];
const MARKS: Stroke = Stroke::dashed(BLACK.faded(0.4), 1.0, 3.0);
const PROGRESS: &str = "progress along the line, 0 begin, 1 end";

/// Samples of flights with their places on the path.
#[derive(Debug, Clone)]
pub(crate) struct AlongPath<'a> {
    /// Name of the group of flights.
    pub name: &'a str,
    /// Progress of each sample, 0..=1. 1
    pub progress: Vec<f64>,
    /// Value of each sample. In the unit of the figure
    pub values: Vec<f64>,
}

/// Where on the path the time was spent: a Gaussian kernel density with Scott's bandwidth (`std n^(-1/5)`),
/// a colour for each group, two at most. `marks` are progresses of the targets.
pub(crate) fn density_over_progress(
    title: &str,
    marks: &[f64],
    groups: &[AlongPath<'_>],
) -> Figure {
    let curves: Vec<Vec<(f64, f64)>> =
        groups.iter().map(|group| density(&group.progress)).collect();
    let legend: Vec<_> = groups
        .iter()
        .zip(COLORS)
        .map(|(group, color)| (Mark::Line(Stroke::solid(color, 1.8)), group.name))
        .chain([(Mark::Line(MARKS), "targets")])
        .collect();
    let mut figure = Figure::begin(title, &legend);
    let y = Axis::over(curves.iter().flatten().map(|(_, density)| *density));
    let panel = open(&mut figure, y.map(Axis::with_zero), "density", marks);
    if let Some(panel) = panel {
        for (curve, color) in curves.iter().zip(COLORS) {
            panel.line(&mut figure, curve, Stroke::solid(color, 1.8));
        }
    }
    figure.end()
}

/// Median of a quantity over the progress, and the band that holds 95 % of its samples, a colour for
/// each group, two at most. `marks` are progresses of the targets.
pub(crate) fn band_over_progress(
    title: &str,
    (name, unit): (&str, &str),
    marks: &[f64],
    groups: &[AlongPath<'_>],
) -> Figure {
    let bands: Vec<Vec<Part>> = groups.iter().map(parts).collect();
    let labels: Vec<[String; 2]> = groups
        .iter()
        .map(|group| {
            ["median", "95 % of the samples"].map(|what| format!("{}: {what}", group.name))
        })
        .collect();
    let mut legend = Vec::new();
    for ([median, band], color) in labels.iter().zip(COLORS) {
        legend.push((Mark::Line(Stroke::solid(color, 1.8)), median.as_str()));
        legend.push((Mark::Patch(color.faded(0.25)), band.as_str()));
    }
    legend.push((Mark::Line(MARKS), "targets"));
    let mut figure = Figure::begin(title, &legend);
    let y = Axis::over(bands.iter().flatten().flat_map(|part| [part.low, part.high]));
    let panel = open(&mut figure, y.map(Axis::with_zero), &quantity(name, unit), marks);
    if let Some(panel) = panel {
        for (band, color) in bands.iter().zip(COLORS) {
            for run in band.chunk_by(|a, b| b.number == a.number + 1) {
                let lower = run.iter().map(|part| (part.at, part.low));
                let upper = run.iter().rev().map(|part| (part.at, part.high));
                let corners: Vec<_> = lower.chain(upper).collect();
                panel.polygon(&mut figure, &corners, color.faded(0.25));
                let median: Vec<_> = run.iter().map(|part| (part.at, part.median)).collect();
                panel.line(&mut figure, &median, Stroke::solid(color, 1.8));
            }
        }
    }
    figure.end()
}

fn open(figure: &mut Figure, y: Option<Axis>, name: &str, marks: &[f64]) -> Option<Panel> {
    let below = Below::Quantity(PROGRESS);
    let strip = Strip { columns: 1, height_px: HEIGHT_PX, heading_lines: 0, below };
    let area = strip.place(figure).next()?;
    let y = y.map(|axis| Axis { high: axis.high + 0.05 * (axis.high - axis.low), ..axis });
    let x = Some(Axis { low: 0.0, high: 1.0 });
    let panel = Panel::open(figure, area, (x, y), below, (&[], name))?;
    for &mark in marks {
        panel.vertical(figure, mark, MARKS);
    }
    Some(panel)
}

/// A part of the path with the quantiles of its samples, in the unit of the figure.
struct Part {
    number: usize,
    /// Progress at its middle. 1, 0..=1
    at: f64,
    low: f64,
    median: f64,
    high: f64,
}

/// The parts that have samples.
fn parts(group: &AlongPath<'_>) -> Vec<Part> {
    let mut samples = vec![Vec::new(); PARTS];
    for (progress, value) in group.progress.iter().zip(&group.values) {
        let part = horizon_model::whole(progress * PARTS as f64).min(PARTS - 1);
        if is_drawable(*progress) && is_drawable(*value) {
            samples[part].push(*value);
        }
    }
    let part = |(number, values): (usize, &Vec<f64>)| {
        Some(Part {
            number,
            at: (number as f64 + 0.5) / PARTS as f64,
            low: quantile(values, TAIL)?,
            median: quantile(values, 0.5)?,
            high: quantile(values, 1.0 - TAIL)?,
        })
    };
    samples.iter().enumerate().filter_map(part).collect()
}

/// The density of `samples` over 0..=1, the integral over all numbers being 1; empty without two
/// different samples.
fn density(samples: &[f64]) -> Vec<(f64, f64)> {
    let count = samples.len() as f64;
    let mean = samples.iter().sum::<f64>() / count;
    let squares = samples.iter().map(|sample| (sample - mean).powi(2)).sum::<f64>();
    let std = (squares / (count - 1.0)).sqrt();
    let bandwidth = std * count.powf(-0.2);
    if bandwidth.is_nan() || bandwidth <= 0.0 {
        return Vec::new();
    }
    let scale = 1.0 / (count * bandwidth * std::f64::consts::TAU.sqrt());
    let at = |i: u32| f64::from(i) / f64::from(PLACES);
    let density = |at: f64| {
        let kernels = samples.iter().map(|sample| (at - sample) / bandwidth);
        scale * kernels.map(|z| (-0.5 * z * z).exp()).sum::<f64>()
    };
    (0..=PLACES).map(|i| (at(i), density(at(i)))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_density_of_even_samples_is_one_away_from_the_ends() {
        let samples: Vec<f64> = (0..5000).map(|k| (f64::from(k) + 0.5) / 5000.0).collect();
        let (_, middle) = density(&samples)[150];
        assert!((middle - 1.0).abs() < 1e-3, "{middle}");
        assert!(density(&[0.3; 9]).is_empty(), "equal samples have no density");
    }

    #[test]
    fn a_part_of_the_way_has_the_quantiles_of_its_own_samples() {
        let values: Vec<f64> = (0..=40).map(f64::from).chain([1000.0]).collect();
        let progress = [vec![0.5; 41], vec![0.9]].concat();
        let parts = parts(&AlongPath { name: "a", progress, values });
        assert_eq!(parts.len(), 2);
        let Part { number, low, median, high, .. } = parts[0];
        assert_eq!(number, 37);
        for (got, expected) in [(low, 1.0), (median, 20.0), (high, 39.0)] {
            assert!((got - expected).abs() < 1e-9, "{got} for {expected}");
        }
    }

    #[test]
    fn figures_without_samples_say_so() {
        let none = [AlongPath { name: "a", progress: Vec::new(), values: Vec::new() }];
        assert!(density_over_progress("Density", &[], &none).svg().contains("no data"));
        assert!(band_over_progress("Band", ("d", "m"), &[], &none).svg().contains("no data"));
    }
}
