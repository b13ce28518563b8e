//! Thesis figure 5.2: the estimate over the observations, with the open-loop simulation, which a wrong parameter shows
//! in.

use std::ops::Range;

use horizon_model::{Row, angle};

use super::axis::Axis;
use super::drawing::{BLACK, BLUE, Figure, GREEN, ORANGE, Stroke};
use super::label;
use super::legend::Mark;
use super::panel::{Below, Panel, Strip};

/// Height of a row's panel. px
const HEIGHT_PX: f64 = 132.0;

/// One row of the state over time.
#[derive(Debug, Clone)]
pub(crate) struct FitRow {
    /// Name and unit; observations of an angle are drawn on the turn of the estimate.
    pub row: Row,
    /// Observation at each sample, NaN where there is none. In the unit of its label
    pub observed: Vec<f64>,
    /// Estimate at each sample, NaN where there is none. In the unit of its label
    pub estimated: Vec<f64>,
    /// Open-loop simulation of each piece, NaN where there is none. In the unit of its label
    pub simulated: Vec<f64>,
}

/// Observations as dots and the estimate as a line, a panel for each row.
///
/// `time_s` has the time of each sample, `pieces` the ranges of samples that were fitted together.
/// They are shaded in turns, and the line breaks between them; what was left out of the fit stays
/// white. The heading of a panel is the distance of both lines from the observations: the estimate follows them
/// whatever the parameters are, the simulation does not.
pub(crate) fn fit(title: &str, time_s: &[f64], pieces: &[Range<usize>], rows: &[FitRow]) -> Figure {
    let line = Stroke::solid(BLUE, 1.5);
    let open_loop = Stroke::dashed(GREEN, 1.2, 4.0);
    let (dot_px, dot) = (2.3, ORANGE.faded(0.6));
    let shades = [BLACK.faded(0.05), BLACK.faded(0.13)];
    let mut figure = Figure::begin(
        title,
        &[
            (Mark::Dots(dot_px, dot), "observation"),
            (Mark::Line(line), "estimate"),
            (Mark::Line(open_loop), "open-loop simulation of each piece"),
            (Mark::Patch(shades[1]), "fitted pieces, shaded in turns"),
        ],
    );
    let x = Axis::over(time_s.iter().copied());
    for (i, row) in rows.iter().enumerate() {
        let below = if i + 1 == rows.len() { Below::Quantity("time [s]") } else { Below::Nothing };
        let strip = Strip { columns: 1, height_px: HEIGHT_PX, heading_lines: 1, below };
        let [observed, estimated] = curves(time_s, row);
        let simulated: Vec<_> = time_s.iter().copied().zip(row.simulated.iter().copied()).collect();
        let values = observed.iter().chain(&estimated).chain(&simulated).map(|(_, value)| *value);
        let axes = (x, Axis::over(values).map(|axis| axis.padded(0.06)));
        let Some(area) = strip.place(&mut figure).next() else { continue };
        let heading = [distances(&observed, [&estimated, &simulated], row.row.unit)];
        let names = (&heading[..], &*label(&row.row));
        let Some(panel) = Panel::open(&mut figure, area, axes, below, names) else { continue };
        for (piece, shade) in pieces.iter().zip(shades.iter().cycle()) {
            if let Some([first, .., last]) = time_s.get(piece.clone()) {
                panel.shade(&mut figure, *first, *last, *shade);
            }
        }
        panel.dots(&mut figure, &observed, dot_px, dot);
        panel.runs(&mut figure, pieces.iter().filter_map(|p| simulated.get(p.clone())), open_loop);
        panel.runs(&mut figure, pieces.iter().filter_map(|p| estimated.get(p.clone())), line);
    }
    figure.end()
}

/// Observation and estimate of a row over time, observed angles on the turn of the estimate.
fn curves(time_s: &[f64], row: &FitRow) -> [Vec<(f64, f64)>; 2] {
    let estimated: Vec<_> = time_s.iter().copied().zip(row.estimated.iter().copied()).collect();
    let turned = |(k, &observed): (usize, &f64)| match row.estimated.get(k) {
        Some(&near) if row.row.is_angle && near.is_finite() => angle::unwrap_near(observed, near),
        _ => observed,
    };
    let observed = row.observed.iter().enumerate().map(turned);
    [time_s.iter().copied().zip(observed).collect(), estimated]
}

/// How far estimate and simulation are from the observations: root mean squares in `unit`, in words.
fn distances(observed: &[(f64, f64)], lines: [&[(f64, f64)]; 2], unit: &str) -> String {
    let [estimate, simulation] = lines.map(|line| {
        let pairs = observed.iter().zip(line).map(|((_, o), (_, value))| (value - o).powi(2));
        let squares: Vec<f64> = pairs.filter(|square| square.is_finite()).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    });
    if !estimate.is_finite() || !simulation.is_finite() {
        return String::new();
    }
    format!(
        "RMS from the observations: estimate {estimate:.3} {unit}, open-loop simulation {simulation:.3} {unit}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_simulation_of_a_wrong_gain_is_far_from_the_observations() {
        let time_s = [0.0, 1.0, 2.0, 3.0];
        let seen = [(0.0, 0.0), (1.0, f64::NAN), (2.0, 2.0), (3.0, 3.0)];
        let half: Vec<_> = time_s.map(|t| (t, 0.5 * t)).into();
        let exact: Vec<_> = time_s.map(|t| (t, t)).into();
        let text = distances(&seen, [&exact, &half], "m");
        // (1^2 + 1.5^2) / 3 = 1.041^2
        assert!(text.ends_with("estimate 0.000 m, open-loop simulation 1.041 m"), "{text}");
        assert_eq!(distances(&[], [&[], &[]], "m"), "");
    }
}
