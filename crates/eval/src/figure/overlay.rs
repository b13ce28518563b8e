//! Data that make a figure interactive on a page: places of its panels, and their samples.
//!
//! Owns the shape of that data. The figure itself stays as it is; `report/page.js` draws on top of it.

use serde::Serialize;

use super::axis::Axis;
use super::drawing::{Color, Stroke};
use super::panel::Panel;
use crate::display_rounding::every;

/// Most places of a track in space.
const SPACE_POINTS: usize = 3_000;

/// Data of a figure for the page around it. Times and values are integers, in 1 ms and 1e-4, each less the one before
/// that is there: small numbers keep the page small.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Overlay {
    /// Times of all values.
    pub(super) time: Vec<Option<i64>>,
    /// Panels over time.
    pub(super) panels: Vec<OverTime>,
    /// Bands behind the lines of every panel.
    pub(super) bands: Vec<Band>,
    /// The panel that shows the track from above.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) map: Option<Map>,
    /// The panel that shows the track in space.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) space: Option<Space>,
}

impl Overlay {
    /// Whether the page listens to keys in the figure: for the time, or to turn it.
    pub(crate) fn takes_keys(&self) -> bool {
        !self.panels.is_empty() || self.space.is_some()
    }
}

/// A panel over time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct OverTime {
    pub frame: Frame,
    pub unit: String,
    pub lines: Vec<Line>,
    /// Bars: name and from when to when. s
    pub bars: Vec<(String, Vec<(f64, f64)>)>,
}

/// Intervals in which a condition held, and their look.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Band {
    /// Condition that held, as in the legend.
    pub name: String,
    /// Colour as CSS writes it.
    pub color: String,
    /// Opacity. 1, 0..=1
    pub opacity: f32,
    /// Begin and end of each time in which it held. s
    pub spans: Vec<(f64, f64)>,
}

/// A line and its look.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Line {
    /// Quantity and source, as in the legend.
    pub name: String,
    /// Colour as CSS writes it.
    pub color: String,
    /// Whether the line is dashed: a reference.
    pub is_dashed: bool,
    /// One for each time, as differences in 1e-4 of the unit; `None` without a value.
    pub values: Vec<Option<i64>>,
}

/// A track from above, a place for each time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Map {
    pub frame: Frame,
    pub x: Vec<Option<i64>>,
    pub y: Vec<Option<i64>>,
}

/// A track in space, a place for each time, in the box that is drawn around it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Space {
    /// Rectangle of the panel on the figure: left, top, right, bottom. px
    pub area: [f64; 4],
    /// Lower and upper end of the box along x, y, z. m
    pub ends: [[f64; 2]; 3],
    /// World x, y, z of the track; each a value for each time.
    pub track: [Vec<Option<i64>>; 3],
    /// World x, y, z of the corners of the reference. m
    pub outline: Vec<[f64; 3]>,
}

/// Rectangle of a panel on the figure (left, top, right, bottom; px) and the range of its axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Frame {
    /// Left, top, right, bottom. px
    pub area: [f64; 4],
    /// Range of the horizontal axis. Unit of its label
    pub x: [f64; 2],
    /// Range of the vertical axis. Unit of its label
    pub y: [f64; 2],
}

impl Band {
    pub(super) fn new(name: &str, color: Color, spans_s: &[(f64, f64)]) -> Self {
        let Color { opacity, .. } = color;
        Self { name: name.to_owned(), color: color.to_string(), opacity, spans: spans_s.to_vec() }
    }
}

impl Line {
    pub(super) fn new(name: &str, stroke: Stroke, values: &[f64]) -> Self {
        Self {
            name: name.to_owned(),
            color: stroke.color.to_string(),
            is_dashed: stroke.dash_px > 0.0,
            values: differences(values, 1e4),
        }
    }
}

impl Frame {
    pub(super) fn of(panel: &Panel) -> Self {
        let [low, high] =
            [(panel.x.low, panel.y.low), (panel.x.high, panel.y.high)].map(|at| panel.at(at));
        Self {
            area: [low.0, high.1, high.0, low.1],
            x: [panel.x.low, panel.x.high],
            y: [panel.y.low, panel.y.high],
        }
    }
}

impl Overlay {
    /// A map on which nothing has a time yet.
    pub(super) fn of_map(frame: Frame) -> Self {
        Self { map: Some(Map { frame, x: Vec::new(), y: Vec::new() }), ..Self::default() }
    }

    /// Adds when the vehicle was where on the map, if there is one.
    pub(super) fn set_track(&mut self, time_s: &[f64], track: &[(f64, f64)]) {
        let Some(map) = &mut self.map else { return };
        let (x, y): (Vec<f64>, Vec<f64>) = track.iter().copied().unzip();
        (map.x, map.y) = (differences(&x, 1e4), differences(&y, 1e4));
        self.time = times(time_s);
    }

    /// A track in space, at `time_s` each of its places, of which some are left out of a long one.
    pub(super) fn of_space(
        panel: &Panel,
        ends: [Axis; 3],
        (time_s, track): (&[f64], &[[f64; 3]]),
        outline: &[[f64; 3]],
    ) -> Self {
        let points: Vec<_> = time_s.iter().copied().zip(track.iter().copied()).collect();
        let points = every(&points, SPACE_POINTS);
        let row = |k: usize| points.iter().map(|(_, place)| place[k]).collect::<Vec<_>>();
        let space = Space {
            area: Frame::of(panel).area,
            ends: ends.map(|axis| [axis.low, axis.high]),
            track: [0, 1, 2].map(|k| differences(&row(k), 1e4)),
            outline: outline.to_vec(),
        };
        let time_s: Vec<f64> = points.iter().map(|(time_s, _)| *time_s).collect();
        Self { space: Some(space), time: times(&time_s), ..Self::default() }
    }

    pub(super) fn has_times(&self) -> bool {
        !self.time.is_empty()
    }
}

/// Times in 1 ms.
pub(super) fn times(time_s: &[f64]) -> Vec<Option<i64>> {
    differences(time_s, 1e3)
}

/// Each value as an integer less the one before; `None` for one that is not finite.
fn differences(values: &[f64], per_unit: f64) -> Vec<Option<i64>> {
    let mut before = 0;
    let difference = |value: &f64| {
        value.is_finite().then(|| {
            #[expect(clippy::cast_possible_truncation, reason = "a cast saturates at 9e14 units")]
            let now = (value * per_unit).round() as i64;
            now.saturating_sub(std::mem::replace(&mut before, now))
        })
    };
    values.iter().map(difference).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_add_up_to_the_values_over_gaps() {
        let found = differences(&[0.5, f64::NAN, -0.25, -0.250_04, 1.0], 1e4);
        assert_eq!(found, [Some(5000), None, Some(-7500), Some(0), Some(12_500)]);
    }
}
