//! A panel: a rectangle of a figure with two axes, and what is drawn in it in units of the data.
//!
//! Owns frame, grid, numbers and names of the axes, and the gaps at absent values. What the lines
//! mean is the figures' business.

use super::axis::{Axis, Tick, is_drawable};
use super::drawing::{
    Anchor, Color, Figure, GREY, NAME_PX, PALE, Point, Stroke, TICK_PX, WIDTH_PX,
};
use super::{font, thin};

/// Room left of a panel for the numbers and the name of its y axis. px
const LEFT_PX: f64 = 64.0;

/// Room right of a panel. px
const RIGHT_PX: f64 = 14.0;

/// Room below a panel for the numbers of its x axis, and for numbers and name. px
const NUMBERS_PX: f64 = 18.0;
const NAMED_PX: f64 = 38.0;

/// Room above a panel, and for each line of its heading. px
const ABOVE_PX: f64 = 10.0;
const HEADING_PX: f64 = 16.0;

/// Least distance between the numbers of the x axis, and of the lines of the y axis. px
const NUMBER_GAP_PX: f64 = 14.0;
const GRID_Y_PX: f64 = 22.0;

/// Most lines of the x axis' grid.
const GRID_X_MAX: u32 = 12;

/// A rectangle of the figure. px
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Area {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

/// Labels below a panel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Below<'a> {
    /// Nothing: the panel below has the same x axis.
    Nothing,
    /// Numbers and what they are.
    Quantity(&'a str),
    /// Names at their x, no numbers.
    Names(&'a [(f64, &'a str)]),
}

/// Size and texts of the panels that stand side by side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Strip<'a> {
    /// How many panels fill the width.
    pub columns: usize,
    /// Height of their areas. px
    pub height_px: f64,
    /// Lines of text above each panel.
    pub heading_lines: usize,
    pub below: Below<'a>,
}

impl Strip<'_> {
    /// Makes the figure higher by this strip; the areas of its panels from left to right.
    pub(super) fn place(&self, figure: &mut Figure) -> impl Iterator<Item = Area> + use<> {
        let width = WIDTH_PX / self.columns as f64;
        let top = figure.height_px + ABOVE_PX + HEADING_PX * self.heading_lines as f64;
        let bottom = top + self.height_px;
        figure.height_px = bottom
            + match self.below {
                Below::Nothing => 0.0,
                Below::Quantity(_) => NAMED_PX,
                Below::Names(_) => NUMBERS_PX,
            };
        (0..self.columns).map(move |column| {
            let left = column as f64 * width;
            Area { left: left + LEFT_PX, top, right: left + width - RIGHT_PX, bottom }
        })
    }
}

/// Width of the area of each of `columns` panels side by side. px
pub(super) fn width_px(columns: usize) -> f64 {
    WIDTH_PX / columns as f64 - LEFT_PX - RIGHT_PX
}

/// An area with its axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Panel {
    area: Area,
    pub x: Axis,
    pub y: Axis,
}

impl Panel {
    /// Draws the frame of a panel with a `heading` and the name of its y axis.
    ///
    /// Without both axes it shows "no data" and returns `None`.
    pub(super) fn open(
        figure: &mut Figure,
        area: Area,
        axes: (Option<Axis>, Option<Axis>),
        below: Below<'_>,
        (heading, y_name): (&[String], &str),
    ) -> Option<Self> {
        let Area { left, top, right, bottom } = area;
        for (i, line) in heading.iter().rev().enumerate() {
            let at = (left, top - 6.0 - HEADING_PX * i as f64);
            figure.fitted_text(line, at, NAME_PX, right - left + RIGHT_PX);
        }
        figure.vertical_text(y_name, (left - 49.0, f64::midpoint(top, bottom)));
        if let Below::Quantity(name) = below {
            let at = (f64::midpoint(left, right), bottom + 33.0);
            figure.text(name, at, NAME_PX, Anchor::Middle);
        }
        let panel = match axes {
            (Some(x), Some(y)) => Some(Self { area, x, y }),
            _ => None,
        };
        if let Some(panel) = &panel {
            panel.grid(figure, below);
        } else {
            let at = (f64::midpoint(left, right), f64::midpoint(top, bottom));
            figure.text("no data", at, NAME_PX, Anchor::Middle);
        }
        let axis = vec![(left, top), (left, bottom), (right, bottom)];
        figure.lines(vec![axis], Stroke::solid(GREY, 1.0));
        panel
    }

    /// An area with axes of which nothing is drawn.
    pub(super) fn bare(area: Area, x: Axis, y: Axis) -> Self {
        Self { area, x, y }
    }

    fn grid(&self, figure: &mut Figure, below: Below<'_>) {
        let Area { left, top, right, bottom } = self.area;
        let thin = Stroke::solid(PALE, 1.0);
        for tick in self.y.ticks((bottom - top) / GRID_Y_PX) {
            let (_, y) = self.at((self.x.low, tick.value));
            figure.line((left, y), (right, y), thin);
            figure.text(&tick.label, (left - 5.0, y + 4.0), TICK_PX, Anchor::End);
        }
        if let Below::Names(names) = below {
            for &(value, name) in names {
                let (x, _) = self.at((value, self.y.low));
                figure.text(name, (x, bottom + 14.0), TICK_PX, Anchor::Middle);
            }
            return;
        }
        for tick in self.x_ticks() {
            let (x, _) = self.at((tick.value, self.y.low));
            figure.line((x, top), (x, bottom), thin);
            if below != Below::Nothing {
                figure.text(&tick.label, (x, bottom + 15.0), TICK_PX, Anchor::Middle);
            }
        }
    }

    /// As many ticks as leave room between their numbers.
    fn x_ticks(&self) -> Vec<Tick> {
        let has_room = |ticks: &Vec<Tick>| {
            ticks.is_sorted_by(|a, b| {
                let widths = [a, b].map(|tick| font::width_px(&tick.label, TICK_PX));
                let [from, to] = [a, b].map(|tick| self.at((tick.value, self.y.low)).0);
                to - from >= 0.5 * (widths[0] + widths[1]) + NUMBER_GAP_PX
            })
        };
        let mut choices = (1..=GRID_X_MAX).rev().map(|count| self.x.ticks(f64::from(count)));
        choices.find(has_room).unwrap_or_default()
    }

    /// Where a point of the data lies on the figure. px
    pub(super) fn at(&self, (x, y): (f64, f64)) -> Point {
        let Area { left, top, right, bottom } = self.area;
        (left + self.x.fraction(x) * (right - left), bottom - self.y.fraction(y) * (bottom - top))
    }

    /// A line through `points`, broken where one cannot be drawn.
    pub(super) fn line(&self, figure: &mut Figure, points: &[(f64, f64)], stroke: Stroke) {
        self.runs(figure, [points], stroke);
    }

    /// A line through each of `runs`.
    pub(super) fn runs<'a>(
        &self,
        figure: &mut Figure,
        runs: impl IntoIterator<Item = &'a [(f64, f64)]>,
        stroke: Stroke,
    ) {
        let unbroken = runs.into_iter().flat_map(|run| run.split(|point| !is_point(point)));
        let places = |run: &[(f64, f64)]| -> Vec<_> { run.iter().map(|&at| self.at(at)).collect() };
        let long = unbroken.filter(|run| run.len() > 1);
        figure.lines(long.map(|run| thin::line(&places(run))).collect(), stroke);
    }

    /// A circle at each of `points` that can be drawn.
    pub(super) fn dots(
        &self,
        figure: &mut Figure,
        points: &[(f64, f64)],
        radius_px: f64,
        fill: Color,
    ) {
        let drawable = points.iter().copied().filter(is_point);
        let places = thin::dots(drawable.map(|point| self.at(point)));
        figure.dots(places, radius_px, fill);
    }

    /// A polygon.
    pub(super) fn polygon(&self, figure: &mut Figure, corners: &[(f64, f64)], fill: Color) {
        figure.area(corners.iter().map(|&corner| self.at(corner)).collect(), fill);
    }

    /// A rectangle between two opposite corners.
    pub(super) fn rectangle(
        &self,
        figure: &mut Figure,
        from: (f64, f64),
        to: (f64, f64),
        fill: Color,
    ) {
        figure.rectangle(self.at(from), self.at(to), fill);
    }

    /// Rectangles from begin to end of each span along x, cut to the axis, between two values `low` and `high` of y.
    pub(super) fn spans(
        &self,
        figure: &mut Figure,
        spans: &[(f64, f64)],
        (low, high): (f64, f64),
        fill: Color,
    ) {
        for &(from, to) in spans {
            let (from, to) = (from.max(self.x.low), to.min(self.x.high));
            if from < to {
                self.rectangle(figure, (from, low), (to, high), fill);
            }
        }
    }

    /// A straight line between two points; nothing if one cannot be drawn.
    pub(super) fn segment(
        &self,
        figure: &mut Figure,
        from: (f64, f64),
        to: (f64, f64),
        stroke: Stroke,
    ) {
        self.line(figure, &[from, to], stroke);
    }

    /// A line across the whole height at `x`; nothing off the axis.
    pub(super) fn vertical(&self, figure: &mut Figure, x: f64, stroke: Stroke) {
        if self.x.contains(x) {
            self.segment(figure, (x, self.y.low), (x, self.y.high), stroke);
        }
    }

    /// A line across the whole width at `y`; nothing off the axis.
    pub(super) fn horizontal(&self, figure: &mut Figure, y: f64, stroke: Stroke) {
        if self.y.contains(y) {
            self.segment(figure, (self.x.low, y), (self.x.high, y), stroke);
        }
    }

    /// Shades the whole height from `low` to `high`, as far as the axis goes; nothing for NaN.
    pub(super) fn shade(&self, figure: &mut Figure, low: f64, high: f64, fill: Color) {
        // Not `min` and `max`, which would take NaN for the end of the axis.
        let from = if low < self.x.low { self.x.low } else { low };
        let to = if high > self.x.high { self.x.high } else { high };
        if from < to {
            self.rectangle(figure, (from, self.y.low), (to, self.y.high), fill);
        }
    }
}

fn is_point(&(x, y): &(f64, f64)) -> bool {
    is_drawable(x) && is_drawable(y)
}

#[cfg(test)]
mod tests;
