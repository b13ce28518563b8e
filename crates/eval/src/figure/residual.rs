//! Residuals: are they normal, and are they white?

use std::f64::consts::TAU;

use horizon_model::{Row, whole};

use super::axis::{Axis, is_drawable};
use super::drawing::{BLACK, BLUE, Color, Figure, SKY, Stroke, VERMILION};
use super::legend::Mark;
use super::panel::{Area, Below, Panel, Strip};
use super::quantity;

/// Height of a panel. px
const HEIGHT_PX: f64 = 110.0;

/// Reach of the histogram from the mean. standard deviations
const REACH_STD: f64 = 5.0;

/// White noise keeps 95 % of its autocorrelations within this over the root of the number of residuals. 1
const WHITE: f64 = 1.96;

const NORMAL: Stroke = Stroke::solid(VERMILION, 1.6);
const BARS: Color = SKY;
const BAND: Color = BLACK.faded(0.12);
const STEMS: Stroke = Stroke::solid(BLUE, 2.0);

/// Residuals of one row.
#[derive(Debug, Clone)]
pub(crate) struct ResidualRow<'a> {
    /// Name and unit.
    pub row: Row,
    /// Residuals of each piece over time, NaN where there is none. In the unit of its label, 1 if weighted
    pub pieces: Vec<&'a [f64]>,
}

/// Histogram with the normal density of the same mean and variance, and autocorrelation over lag
/// with the band in which 95 % of white noise stay, for each row.
///
/// `lags` steps of `dt_s` are shown, the lag 0 (always 1) is not.
pub(crate) fn residuals(title: &str, dt_s: f64, lags: usize, rows: &[ResidualRow<'_>]) -> Figure {
    let mut figure = Figure::begin(
        title,
        &[
            (Mark::Patch(BARS), "residuals"),
            (Mark::Line(NORMAL), "normal, same mean and variance"),
            (Mark::Line(STEMS), "autocorrelation"),
            (Mark::Patch(BAND), "95 % of white noise"),
        ],
    );
    for row in rows {
        let below = Below::Quantity("");
        let strip = Strip { columns: 2, height_px: HEIGHT_PX, heading_lines: 1, below };
        let mut areas = strip.place(&mut figure);
        if let (Some(left), Some(right)) = (areas.next(), areas.next()) {
            let moments = Moments::of(&row.pieces);
            histogram(&mut figure, left, row, moments.as_ref());
            correlogram(&mut figure, right, row, moments.as_ref(), (dt_s, lags));
        }
    }
    figure.end()
}

/// Autocorrelation of the residuals of all pieces together at each of `lags`, in steps.
///
/// Mean of `(r_k - m) (r_{k+lag} - m)` over that of `(r_k - m)^2`, products within a piece only, m the mean of
/// all. Absent values are left out; without a pair it is 0. Empty without two different values.
pub(crate) fn autocorrelation(
    pieces: &[&[f64]],
    lags: impl IntoIterator<Item = usize>,
) -> Vec<f64> {
    let Some(moments) = Moments::of(pieces) else { return Vec::new() };
    let mean = |lag: usize| {
        let pairs = pieces.iter().flat_map(|piece| piece.iter().zip(piece.iter().skip(lag)));
        let products = pairs.map(|(a, b)| (a - moments.mean) * (b - moments.mean));
        let (sum, count) = products
            .filter(|product| is_drawable(*product))
            .fold((0.0, 0.0), |(sum, count), product| (sum + product, count + 1.0));
        sum / f64::max(count, 1.0)
    };
    let variance = mean(0);
    lags.into_iter().map(|lag| mean(lag) / variance).collect()
}

/// Number, mean and standard deviation (> 0) of all residuals of a row, in its unit.
struct Moments {
    count: f64,
    mean: f64,
    std: f64,
}

impl Moments {
    /// `None` without two different values.
    fn of(pieces: &[&[f64]]) -> Option<Self> {
        let values =
            || pieces.iter().flat_map(|piece| piece.iter().copied()).filter(|&r| is_drawable(r));
        let count = values().count() as f64;
        let mean = values().sum::<f64>() / count;
        let std = (values().map(|r| (r - mean).powi(2)).sum::<f64>() / count).sqrt();
        (std > 0.0 && is_drawable(std)).then_some(Self { count, mean, std })
    }
}

fn histogram(figure: &mut Figure, area: Area, row: &ResidualRow<'_>, moments: Option<&Moments>) {
    let below_name = quantity(&format!("{} residual", row.row.name), row.row.unit);
    let below = Below::Quantity(&below_name);
    let y_name = match row.row.unit {
        "1" => "density".to_owned(),
        unit => format!("density [1/{unit}]"),
    };
    let Some(&Moments { count, mean, std }) = moments else {
        Panel::open(figure, area, (None, None), below, (&[], &y_name));
        return;
    };
    let normal = |r: f64| (-0.5 * ((r - mean) / std).powi(2)).exp() / (std * TAU.sqrt());
    let x = Axis { low: mean - REACH_STD * std, high: mean + REACH_STD * std };
    let (densities, outside) = densities(&row.pieces, x, count);
    let heights = densities.iter().copied().chain([normal(mean)]);
    let y = Axis::over(heights).map(|axis| Axis { high: 1.05 * axis.high, ..axis }.with_zero());
    let heading = [format!(
        "{}: mean {mean:.1e}, std {std:.1e}, {outside} beyond {REACH_STD} std",
        row.row.name
    )];
    let Some(panel) = Panel::open(figure, area, (Some(x), y), below, (&heading, &y_name)) else {
        return;
    };
    let width = (x.high - x.low) / densities.len() as f64;
    for (i, &density) in densities.iter().enumerate() {
        let left = x.low + i as f64 * width;
        panel.rectangle(figure, (left, 0.0), (left + width, density), BARS);
    }
    let places = (0..=200_u32).map(|i| x.low + (x.high - x.low) * f64::from(i) / 200.0);
    let curve: Vec<_> = places.map(|r| (r, normal(r))).collect();
    panel.line(figure, &curve, NORMAL);
}

/// Fraction of the `count` residuals per unit in each of the bins over `axis`, and how many lie outside.
fn densities(pieces: &[&[f64]], axis: Axis, count: f64) -> (Vec<f64>, usize) {
    let mut counts = vec![0_u32; whole(count.sqrt().clamp(10.0, 60.0))];
    let bins = counts.len() as f64;
    let mut outside = 0;
    for &r in pieces.iter().copied().flatten().filter(|r| is_drawable(**r)) {
        let bin = whole(axis.fraction(r) * bins);
        match counts.get_mut(bin) {
            Some(in_bin) if axis.contains(r) => *in_bin += 1,
            _ => outside += 1,
        }
    }
    let per_unit = bins / ((axis.high - axis.low) * count);
    (counts.into_iter().map(|in_bin| f64::from(in_bin) * per_unit).collect(), outside)
}

fn correlogram(
    figure: &mut Figure,
    area: Area,
    row: &ResidualRow<'_>,
    moments: Option<&Moments>,
    (dt_s, lags): (f64, usize),
) {
    let correlations = autocorrelation(&row.pieces, 1..=lags);
    let stems = (1..=lags).zip(correlations);
    let stems: Vec<_> = stems.map(|(lag, r)| (lag as f64 * dt_s, r)).collect();
    let white = moments.map_or(f64::NAN, |moments| WHITE / moments.count.sqrt());
    let x = stems.last().and_then(|(last_s, _)| Axis::over([0.0, *last_s]));
    let y = Axis::over(stems.iter().map(|(_, r)| *r).chain([0.0, white, -white]));
    let axes = (x.map(|x| x.padded(0.02)), y.map(|y| y.padded(0.06)));
    let heading = [format!("{}: autocorrelation", row.row.name)];
    let names = (&heading[..], "autocorrelation");
    let Some(panel) = Panel::open(figure, area, axes, Below::Quantity("lag [s]"), names) else {
        return;
    };
    panel.rectangle(figure, (panel.x.low, -white), (panel.x.high, white), BAND);
    for stem in &stems {
        panel.segment(figure, (stem.0, 0.0), *stem, STEMS);
    }
    panel.horizontal(figure, 0.0, Stroke::solid(BLACK, 1.0));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_histogram_is_a_density_of_all_residuals_but_those_it_counts_as_outside() {
        let inside: Vec<_> = (0..990).map(|k| f64::from(k) / 990.0).collect();
        let outside = [5.0; 10];
        let (bars, count) = densities(&[&inside, &outside], Axis { low: 0.0, high: 2.0 }, 1000.0);
        let sum = bars.iter().sum::<f64>() * 2.0 / bars.len() as f64;
        assert!((sum - 0.99).abs() < 1e-12, "the bars hold {sum} of the residuals");
        assert_eq!(count, 10);
    }

    #[test]
    fn autocorrelation_stays_within_the_pieces() {
        let (up, down) = ([1.0, -1.0, 1.0, -1.0], [-1.0, 1.0, f64::NAN]);
        let got = autocorrelation(&[&up, &down], 0..=2);
        // Sums of products: 6 of six at lag 0, -3 - 1 of four pairs at lag 1, 2 of two at lag 2.
        for (got, expected) in got.iter().zip([1.0, -1.0, 1.0]) {
            assert!((got - expected).abs() < 1e-12, "{got} for {expected}");
        }
        assert_eq!(got.len(), 3);
        assert!(
            autocorrelation(&[&[2.0, 2.0]], 0..=3).is_empty(),
            "equal values have no correlation"
        );
    }
}
