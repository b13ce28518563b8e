//! What something costs over its size, with the straight line through the origin that a cost in
//! proportion would follow.

use super::axis::Axis;
use super::drawing::{BLUE, Figure, GREY, Stroke};
use super::legend::Mark;
use super::panel::{Below, Panel, Strip};

/// Height of a panel. px
const HEIGHT_PX: f64 = 230.0;

/// Most curves side by side.
const COLUMNS: usize = 2;

/// A cost over a size.
#[derive(Debug, Clone, Copy)]
pub struct GrowthCurve<'a> {
    /// What costs.
    pub name: &'a str,
    /// Sizes, ascending, > 0. In the unit of the name of the size
    pub sizes: &'a [f64],
    /// The cost of each. In the unit of the name of the cost
    pub values: &'a [f64],
    /// Exponent of the power of the size that fits, for the heading. 1
    pub exponent: f64,
}

/// A panel for each curve; `names` are those of size and cost, with their units.
pub fn growth(title: &str, (size, cost): (&str, &str), curves: &[GrowthCurve<'_>]) -> Figure {
    let line = Stroke::solid(BLUE, 1.5);
    let proportion = Stroke::dashed(GREY, 1.5, 4.0);
    let legend =
        [(Mark::Line(line), "measured"), (Mark::Line(proportion), "in proportion to the largest")];
    let mut figure = Figure::begin(title, &legend);
    let columns = curves.len().clamp(1, COLUMNS);
    let below = Below::Quantity(size);
    let strip = Strip { columns, height_px: HEIGHT_PX, heading_lines: 1, below };
    for side_by_side in curves.chunks(columns) {
        let areas = strip.place(&mut figure);
        for (curve, area) in side_by_side.iter().zip(areas) {
            let points: Vec<_> =
                curve.sizes.iter().copied().zip(curve.values.iter().copied()).collect();
            let axes = [curve.sizes, curve.values].map(|values| {
                Axis::over(values.iter().copied()).map(|axis| axis.with_zero().padded(0.04))
            });
            let heading = [format!("{}: exponent {:.2}", curve.name, curve.exponent)];
            let [x, y] = axes;
            let Some(panel) = Panel::open(&mut figure, area, (x, y), below, (&heading, cost))
            else {
                continue;
            };
            if let Some(&largest) = points.last() {
                panel.line(&mut figure, &[(0.0, 0.0), largest], proportion);
            }
            panel.line(&mut figure, &points, line);
            panel.dots(&mut figure, &points, 2.2, line.color);
        }
    }
    figure.end()
}
