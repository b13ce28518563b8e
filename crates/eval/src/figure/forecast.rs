//! Prediction error over the horizon, model by model.

use horizon_model::Row;

use super::axis::Axis;
use super::drawing::{BLACK, BLUE, Color, Figure, GREEN, ORANGE, PURPLE, SKY, Stroke, VERMILION};
use super::legend::Mark;
use super::panel::{Below, Panel, Strip};
use super::quantity;

/// Most panels side by side, and the height of each. px
const COLUMNS: usize = 3;
const HEIGHT_PX: f64 = 260.0;

/// Radius of the circles at the marked horizons. px
const MARK_PX: f64 = 3.5;

/// Prediction error of one model.
#[derive(Debug, Clone)]
pub(crate) struct ForecastLine<'a> {
    /// Name of the model; the same name has the same colour in each panel.
    pub model: &'a str,
    /// How far ahead, ascending (s), and the root mean square error there, in the unit of the panel's row.
    pub points: Vec<(f64, f64)>,
}

/// Panel of one predicted quantity.
#[derive(Debug, Clone)]
pub(crate) struct ForecastPanel<'a> {
    /// Name and unit.
    pub row: Row,
    /// A line for each model.
    pub lines: Vec<ForecastLine<'a>>,
}

/// Prediction error over horizon: a panel for each row, a line for each model, and circles at the
/// horizons `marks_s`.
pub(crate) fn forecast(title: &str, marks_s: &[f64], panels: &[ForecastPanel<'_>]) -> Figure {
    let models = models(panels);
    let strokes: Vec<_> = (0..models.len()).map(stroke).collect();
    let legend: Vec<_> =
        strokes.iter().zip(&models).map(|(stroke, model)| (Mark::Line(*stroke), *model)).collect();
    let mut figure = Figure::begin(title, &legend);
    let below = Below::Quantity("horizon [s]");
    let columns = panels.len().clamp(1, COLUMNS);
    let strip = Strip { columns, height_px: HEIGHT_PX, heading_lines: 0, below };
    for side_by_side in panels.chunks(columns) {
        let areas = strip.place(&mut figure);
        for (content, area) in side_by_side.iter().zip(areas) {
            let points = || content.lines.iter().flat_map(|line| &line.points);
            let x = Axis::over(points().map(|(horizon_s, _)| *horizon_s));
            let errors = Axis::over(points().map(|(_, error)| *error));
            let y = errors.map(|axis| Axis { high: 1.05 * axis.high, ..axis }.with_zero());
            let axes = (x.map(|x| x.padded(0.02)), y);
            let name = quantity(&format!("{} error, RMSE", content.row.name), content.row.unit);
            let Some(panel) = Panel::open(&mut figure, area, axes, below, (&[], &name)) else {
                continue;
            };
            for &mark_s in marks_s {
                panel.vertical(&mut figure, mark_s, Stroke::dashed(BLACK.faded(0.5), 1.0, 2.0));
            }
            for line in &content.lines {
                let model = models.iter().position(|model| *model == line.model);
                let stroke = stroke(model.unwrap_or_default());
                panel.line(&mut figure, &line.points, stroke);
                let marks: Vec<_> =
                    marks_s.iter().filter_map(|&mark_s| between(&line.points, mark_s)).collect();
                panel.dots(&mut figure, &marks, MARK_PX, stroke.color);
            }
        }
    }
    figure.end()
}

/// Names of the models in the order in which they appear first.
fn models<'a>(panels: &[ForecastPanel<'a>]) -> Vec<&'a str> {
    let mut names = Vec::new();
    for line in panels.iter().flat_map(|panel| &panel.lines) {
        if !names.contains(&line.model) {
            names.push(line.model);
        }
    }
    names
}

/// Colour of a model; from the seventh on, dashed.
fn stroke(model: usize) -> Stroke {
    const COLORS: [Color; 6] = [BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY];
    let color = COLORS[model % COLORS.len()];
    if model < COLORS.len() { Stroke::solid(color, 1.8) } else { Stroke::dashed(color, 1.8, 5.0) }
}

/// The point at `x` on the line through `points`; `None` beyond its ends.
fn between(points: &[(f64, f64)], x: f64) -> Option<(f64, f64)> {
    let sides = points.windows(2).filter_map(|side| Some((*side.first()?, *side.last()?)));
    let mut around = sides.filter(|((x0, _), (x1, _))| *x0 <= x && x <= *x1 && x0 < x1);
    around.next().map(|((x0, y0), (x1, y1))| (x, y0 + (y1 - y0) * (x - x0) / (x1 - x0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_lie_on_the_line_and_not_beyond_it() {
        let line = [(0.0, 0.0), (0.5, 1.0), (1.0, 3.0)];
        for (x, expected) in [(0.25, Some(0.5)), (0.75, Some(2.0)), (1.0, Some(3.0)), (1.1, None)] {
            let got = between(&line, x).map(|(_, y)| y);
            let is_near = |y: f64| expected.is_some_and(|e: f64| (y - e).abs() < 1e-12);
            assert!(got.map_or(expected.is_none(), is_near), "{got:?} at {x} for {expected:?}");
        }
    }
}
