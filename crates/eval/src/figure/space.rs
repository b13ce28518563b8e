//! A flight in space, as seen from in front, the right and above: thesis figures 5.4, 5.9 and 5.10.
//!
//! Owns the isometric view: a metre is as long along x, y and z. x leads to the right and down, y to the
//! right and up, z up.

use super::axis::Axis;
use super::drawing::{
    Anchor, BLACK, BLUE, Figure, GREY, NAME_PX, ORANGE, PALE, Stroke, TICK_PX, VERMILION,
};
use super::legend::Mark;
use super::overlay::Overlay;
use super::panel::{Below, Panel, Strip};
use super::tracks::to_scale;
use crate::display_rounding::PosW;

const REFERENCE: Stroke = Stroke::dashed(BLACK, 1.6, 6.0);
const TRACK: Stroke = Stroke::solid(BLUE, 1.6);
const SHADOW: Stroke = Stroke::solid(GREY.faded(0.5), 1.0);
const GRID: Stroke = Stroke::solid(PALE, 1.0);
const DOT_PX: f64 = 4.0;

/// Room around the flight. m
const MARGIN_M: f64 = 0.25;

/// Lines of the grid along an axis.
const GRID_LINES: f64 = 6.0;

/// A flight with what it was to follow, in world x, y, z. m
#[derive(Debug, Clone, Copy)]
pub(crate) struct SeenInSpace<'a> {
    /// Corners of the polyline to follow.
    pub outline: &'a [PosW],
    /// Where the flight was, tick by tick.
    pub track: &'a [PosW],
    /// When, a time for each place. s
    pub time_s: &'a [f64],
}

/// A flight over its shadow on the floor, with its reference.
pub(crate) fn space(title: &str, seen: &SeenInSpace<'_>) -> Figure {
    let legend = [
        (Mark::Line(TRACK), "flight"),
        (Mark::Line(SHADOW), "on the floor"),
        (Mark::Line(REFERENCE), "reference"),
        (Mark::Dots(DOT_PX, ORANGE), "begin"),
        (Mark::Dots(DOT_PX, VERMILION), "end"),
    ];
    let mut figure = Figure::begin(title, &legend);
    let places = || seen.outline.iter().chain(seen.track).copied();
    let over = |row: usize| Axis::over(places().map(move |place| place[row]));
    let room = over(0).zip(over(1)).zip(over(2)).map(|((x, y), z)| Room::around(x, y, z));
    let Some(room) = room else {
        let strip =
            Strip { columns: 1, height_px: 240.0, heading_lines: 0, below: Below::Quantity("") };
        if let Some(area) = strip.place(&mut figure).next() {
            Panel::open(&mut figure, area, (None, None), Below::Quantity(""), (&[], ""));
        }
        return figure.end();
    };
    let seen_as: Vec<_> = room.corners().map(view).into();
    let u = Axis::over(seen_as.iter().map(|(u, _)| *u));
    let v = Axis::over(seen_as.iter().map(|(_, v)| *v));
    let Some(((Some(u), Some(v)), height_px)) = u.zip(v).map(to_scale) else { return figure.end() };
    let below = Below::Quantity("");
    let strip = Strip { columns: 1, height_px, heading_lines: 0, below };
    let Some(area) = strip.place(&mut figure).next() else { return figure.end() };
    let panel = Panel::bare(area, u, v);
    room.draw(&mut figure, &panel);
    let line = |places: &[PosW]| -> Vec<_> { places.iter().map(|at| view(*at)).collect() };
    let floor: Vec<_> = seen.track.iter().map(|&[x, y, _]| [x, y, room.z.low]).collect();
    panel.line(&mut figure, &line(&floor), SHADOW);
    panel.line(&mut figure, &line(seen.outline), REFERENCE);
    panel.line(&mut figure, &line(seen.track), TRACK);
    for (end, color) in [(seen.track.first(), ORANGE), (seen.track.last(), VERMILION)] {
        let dots: Vec<_> = end.into_iter().map(|at| view(*at)).collect();
        panel.dots(&mut figure, &dots, DOT_PX, color);
    }
    let Room { x, y, z } = room;
    let seen_at = (seen.time_s, seen.track);
    figure.overlay = Some(Overlay::of_space(&panel, [x, y, z], seen_at, seen.outline));
    figure.end()
}

/// Where a place appears: to the right and up. m
fn view([x, y, z]: PosW) -> (f64, f64) {
    let right = (x + y) * std::f64::consts::FRAC_1_SQRT_2;
    let up = (2.0 * z + y - x) / 6.0_f64.sqrt();
    (right, up)
}

/// The box around everything, on the floor if the flight is above it.
struct Room {
    x: Axis,
    y: Axis,
    z: Axis,
}

impl Room {
    fn around(x: Axis, y: Axis, z: Axis) -> Self {
        let wider = |axis: Axis| Axis { low: axis.low - MARGIN_M, high: axis.high + MARGIN_M };
        Self { x: wider(x), y: wider(y), z: z.with_zero() }
    }

    fn corners(&self) -> [PosW; 6] {
        let Self { x, y, z } = self;
        [
            [x.low, y.low, z.low],
            [x.high, y.low, z.low],
            [x.high, y.high, z.low],
            [x.low, y.high, z.low],
            [x.low, y.low, z.high],
            [x.low, y.high, z.high],
        ]
    }

    /// The floor with its grid, numbers at its front edges, and a ruler for z.
    fn draw(&self, figure: &mut Figure, panel: &Panel) {
        let Self { x, y, z } = self;
        let mut line = |from: PosW, to: PosW, stroke| {
            panel.segment(figure, view(from), view(to), stroke);
        };
        for tick in x.ticks(GRID_LINES) {
            line([tick.value, y.low, z.low], [tick.value, y.high, z.low], GRID);
        }
        for tick in y.ticks(GRID_LINES) {
            line([x.low, tick.value, z.low], [x.high, tick.value, z.low], GRID);
        }
        let edge = Stroke::solid(GREY, 1.0);
        line([x.low, y.low, z.low], [x.high, y.low, z.low], edge);
        line([x.high, y.low, z.low], [x.high, y.high, z.low], edge);
        line([x.low, y.low, z.low], [x.low, y.low, z.high], edge);
        let number = |figure: &mut Figure, at: PosW, text: &str, anchor, (right, down)| {
            let (x_px, y_px) = panel.at(view(at));
            figure.text(text, (x_px + right, y_px + down), TICK_PX, anchor);
        };
        for tick in x.ticks(GRID_LINES) {
            let at = [tick.value, y.low, z.low];
            number(figure, at, &tick.label, Anchor::End, (-6.0, 13.0));
        }
        for tick in y.ticks(GRID_LINES) {
            let at = [x.high, tick.value, z.low];
            number(figure, at, &tick.label, Anchor::Start, (6.0, 13.0));
        }
        for tick in z.ticks(4.0) {
            let at = [x.low, y.low, tick.value];
            number(figure, at, &tick.label, Anchor::End, (-6.0, 4.0));
        }
        let middle = |axis: &Axis| f64::midpoint(axis.low, axis.high);
        let mut name = |at: PosW, text: &str, anchor, (right, down)| {
            let (x_px, y_px) = panel.at(view(at));
            figure.text(text, (x_px + right, y_px + down), NAME_PX, anchor);
        };
        name([middle(x), y.low, z.low], "x [m]", Anchor::End, (-34.0, 24.0));
        name([x.high, middle(y), z.low], "y [m]", Anchor::Start, (34.0, 24.0));
        name([x.low, y.low, z.high], "z [m]", Anchor::Middle, (0.0, -10.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_metre_is_as_long_along_every_axis() {
        let origin = view([0.0; 3]);
        for at in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
            let (right, up) = view(at);
            let length = (right - origin.0).hypot(up - origin.1);
            assert!((length - (2.0_f64 / 3.0).sqrt()).abs() < 1e-12, "{at:?}: {length}");
        }
    }

    #[test]
    fn flight_shadow_reference_and_axes_are_drawn() {
        let outline = [[0.0, 0.0, 1.0], [1.5, 0.0, 1.0], [1.5, 1.5, 1.0]];
        let track = [[0.1, 0.0, 1.1], [f64::NAN, 0.0, 1.0], [1.4, 0.1, 0.9], [1.5, 1.4, 1.0]];
        let seen = SeenInSpace { outline: &outline, track: &track, time_s: &[0.0, 0.1, 0.2, 0.3] };
        let svg = space("Flight", &seen).svg();
        for text in ["flight", "on the floor", "reference", "x [m]", "y [m]", "z [m]", "1.5"] {
            assert!(svg.contains(&format!(">{text}<")), "{text}: {svg}");
        }
        assert!(!svg.contains("NaN"), "{svg}");
        let nothing = SeenInSpace { outline: &[], track: &[], time_s: &[] };
        assert!(space("Nothing", &nothing).svg().contains("no data"));
    }
}
