//! The dead time: its profile likelihood, and thesis figure 5.1.

use horizon_model::Row;

use super::axis::{Axis, is_drawable};
use super::drawing::{BLUE, Figure, GREEN, ORANGE, Stroke, VERMILION};
use super::label;
use super::legend::Mark;
use super::panel::{Below, Panel, Strip};

/// Height of a profile's panel and of a row's panel over time. px
const PROFILE_PX: f64 = 230.0;
const SHIFT_PX: f64 = 120.0;

/// Most profiles side by side.
const COLUMNS: usize = 3;

/// Cost over dead time for the sticks of one group.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DelayCurve<'a> {
    /// Name of the group.
    pub name: &'a str,
    /// Dead times, ascending. s
    pub dead_time_s: &'a [f64],
    /// Cost with each of them, all groups shifted together; the figure subtracts the smallest. 1
    pub cost: &'a [f64],
    /// The dead time of least cost, NaN without one. s
    pub minimum_s: f64,
    /// Ends of its 95 % interval, infinite where it is open, NaN without one. s
    pub interval_s: [f64; 2],
}

/// Cost above its minimum over dead time, a panel for each group of sticks.
pub(crate) fn delay_profile(title: &str, curves: &[DelayCurve<'_>]) -> Figure {
    let line = Stroke::solid(BLUE, 1.5);
    let minimum = Stroke::dashed(VERMILION, 1.5, 4.0);
    let interval = VERMILION.faded(0.2);
    let mut figure = Figure::begin(
        title,
        &[
            (Mark::Line(line), "cost, all sticks shifted together"),
            (Mark::Line(minimum), "minimum"),
            (Mark::Patch(interval), "95 % interval"),
        ],
    );
    let below = Below::Quantity("dead time [s]");
    let columns = curves.len().clamp(1, COLUMNS);
    let strip = Strip { columns, height_px: PROFILE_PX, heading_lines: 2, below };
    for side_by_side in curves.chunks(columns) {
        let areas = strip.place(&mut figure);
        for (curve, area) in side_by_side.iter().zip(areas) {
            let points = above_least(curve);
            let [low_s, high_s] = curve.interval_s;
            let x = curve.dead_time_s.iter().copied().chain([low_s, high_s]);
            let x = if points.is_empty() { None } else { Axis::over(x) };
            let y = Axis::over(points.iter().map(|(_, cost)| *cost));
            let axes = (x.map(|x| x.padded(0.02)), y.map(|y| y.padded(0.04)));
            let heading = [curve.name.to_owned(), found(curve)];
            let names = (&heading[..], "cost above the minimum");
            let Some(panel) = Panel::open(&mut figure, area, axes, below, names) else {
                continue;
            };
            panel.shade(&mut figure, low_s, high_s, interval);
            panel.vertical(&mut figure, curve.minimum_s, minimum);
            panel.line(&mut figure, &points, line);
            panel.dots(&mut figure, &points, 2.2, line.color);
        }
    }
    figure.end()
}

/// The curve, its costs above the least of them. s, 1
fn above_least(DelayCurve { dead_time_s, cost, .. }: &DelayCurve<'_>) -> Vec<(f64, f64)> {
    let least = cost.iter().copied().fold(f64::INFINITY, f64::min);
    dead_time_s.iter().zip(*cost).map(|(at_s, cost)| (*at_s, cost - least)).collect()
}

/// The dead time in words, with its interval if there is one.
fn found(DelayCurve { minimum_s, interval_s: [low_s, high_s], .. }: &DelayCurve<'_>) -> String {
    if !is_drawable(*minimum_s) {
        return "no minimum".to_owned();
    }
    if low_s.is_nan() || high_s.is_nan() {
        return format!("{minimum_s:.3} s, no interval");
    }
    format!("{minimum_s:.3} s, 95 % [{low_s:.3}, {high_s:.3}]")
}

/// One axis of the vehicle over time.
#[derive(Debug, Clone)]
pub(crate) struct ShiftRow {
    /// Name and unit of the position or heading.
    pub row: Row,
    /// Change since the start at each sample, NaN where nothing was seen. In the unit of its label
    pub moved: Vec<f64>,
    /// Cumulative input, thesis equation 5.1, as sent. In the unit of `row`
    pub cumulative: Vec<f64>,
    /// Cumulative input, `dead_time_s` later. In the unit of `row`
    pub shifted: Vec<f64>,
    /// The dead time. s
    pub dead_time_s: f64,
}

/// Thesis figure 5.1: what the vehicle did, the commands, and the commands after the dead time.
pub(crate) fn delay_shift(title: &str, time_s: &[f64], rows: &[ShiftRow]) -> Figure {
    let strokes = [BLUE, ORANGE, GREEN].map(|color| Stroke::solid(color, 1.5));
    let names = ["change of the pose", "cumulative input", "cumulative input after the dead time"];
    let legend: Vec<_> =
        strokes.iter().zip(names).map(|(stroke, name)| (Mark::Line(*stroke), name)).collect();
    let mut figure = Figure::begin(title, &legend);
    let x = Axis::over(time_s.iter().copied());
    for (i, row) in rows.iter().enumerate() {
        let below = if i + 1 == rows.len() { Below::Quantity("time [s]") } else { Below::Nothing };
        let strip = Strip { columns: 1, height_px: SHIFT_PX, heading_lines: 1, below };
        let curves = [&row.moved, &row.cumulative, &row.shifted];
        let values = curves.iter().flat_map(|curve| curve.iter().copied());
        let axes = (x, Axis::over(values).map(|axis| axis.padded(0.06)));
        let heading = [format!("{}: dead time {:.3} s", row.row.name, row.dead_time_s)];
        let names = (&heading[..], &*label(&row.row));
        let Some(area) = strip.place(&mut figure).next() else { continue };
        let Some(panel) = Panel::open(&mut figure, area, axes, below, names) else { continue };
        for (curve, stroke) in curves.into_iter().zip(strokes) {
            let points: Vec<_> = time_s.iter().copied().zip(curve.iter().copied()).collect();
            panel.line(&mut figure, &points, stroke);
        }
    }
    figure.end()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flat_profile_lies_at_zero() {
        let (dead_time_s, cost) = (&[0.1, 0.2][..], &[7.0, 7.0][..]);
        let (minimum_s, interval_s) = (f64::NAN, [f64::NAN; 2]);
        let flat = DelayCurve { name: "yaw", dead_time_s, cost, minimum_s, interval_s };
        assert_eq!(above_least(&flat), [(0.1, 0.0), (0.2, 0.0)]);
    }

    #[test]
    fn a_dead_time_is_written_with_its_interval_as_far_as_there_is_one() {
        for (minimum_s, interval_s, expected) in [
            (0.32, [0.3, 0.3456], "0.320 s, 95 % [0.300, 0.346]"),
            (0.32, [f64::NEG_INFINITY, 0.4], "0.320 s, 95 % [-inf, 0.400]"),
            (0.32, [f64::NAN, 0.4], "0.320 s, no interval"),
            (0.32, [0.3, f64::NAN], "0.320 s, no interval"),
            (f64::NAN, [0.3, 0.4], "no minimum"),
        ] {
            let curve =
                DelayCurve { name: "yaw", dead_time_s: &[], cost: &[], minimum_s, interval_s };
            assert_eq!(found(&curve), expected);
        }
    }
}
