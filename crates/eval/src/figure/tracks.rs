//! Flights from above over what they were to follow.

use super::axis::Axis;
use super::drawing::{BLACK, BLUE, Color, Figure, GREY, ORANGE, Stroke};
use super::legend::Mark;
use super::overlay::{Frame, Overlay};
use super::panel::{Below, Panel, Strip, width_px};

/// Least and largest height of the panel. px
const HEIGHT_PX: (f64, f64) = (240.0, 660.0);

/// Room around the tracks, as a fraction of their extent.
const PADDING: f64 = 0.05;

/// Flights of one controller, in world x and y. m
#[derive(Debug, Clone)]
pub struct SeenFlights<'a> {
    /// Name of the controller.
    pub name: &'a str,
    /// Corners of the polyline to follow, x and y in the world frame. m
    pub outline: Vec<(f64, f64)>,
    /// Where each flight was, tick by tick, x and y in the world frame. m
    pub tracks: Vec<Vec<(f64, f64)>>,
}

/// Tracks over their outline, x to the right and y upwards in one scale; a colour for each controller, two
/// at most.
pub(crate) fn tracks(title: &str, seen: &[SeenFlights<'_>]) -> Figure {
    tracks_among(title, seen, &[])
}

/// `tracks` among obstacles, each a closed polyline of x and y in the world frame. m
pub fn tracks_among(
    title: &str,
    seen: &[SeenFlights<'_>],
    obstacles: &[Vec<(f64, f64)>],
) -> Figure {
    const COLORS: [Color; 2] = [BLUE, ORANGE];
    let outline = Stroke::dashed(BLACK, 1.6, 6.0);
    let start_px = 2.5;
    let strokes = COLORS.map(|color| Stroke::solid(color.faded(0.55), 1.0));
    let mut legend: Vec<_> =
        seen.iter().zip(strokes).map(|(seen, stroke)| (Mark::Line(stroke), seen.name)).collect();
    legend.push((Mark::Line(outline), "outline"));
    legend.push((Mark::Dots(start_px, GREY), "start"));
    let solid = Stroke::solid(GREY, 2.0);
    if !obstacles.is_empty() {
        legend.push((Mark::Line(solid), "obstacle"));
    }
    let mut figure = Figure::begin(title, &legend);
    let lines = || seen.iter().flat_map(|seen| seen.tracks.iter().chain([&seen.outline]));
    let corners = || obstacles.iter().flatten().copied();
    let points = || lines().flat_map(|line| line.iter().copied()).chain(corners());
    let below = Below::Quantity("x [m]");
    let x = Axis::over(points().map(|(x, _)| x));
    let y = Axis::over(points().map(|(_, y)| y));
    let (axes, height_px) = match x.zip(y) {
        Some(axes) => to_scale(axes),
        None => ((None, None), HEIGHT_PX.0),
    };
    let strip = Strip { columns: 1, height_px, heading_lines: 0, below };
    let area = strip.place(&mut figure).next();
    let panel = area.and_then(|area| Panel::open(&mut figure, area, axes, below, (&[], "y [m]")));
    if let Some(panel) = panel {
        for obstacle in obstacles {
            panel.line(&mut figure, obstacle, solid);
        }
        for (seen, stroke) in seen.iter().zip(strokes) {
            panel.runs(&mut figure, seen.tracks.iter().map(Vec::as_slice), stroke);
        }
        for seen in seen {
            panel.line(&mut figure, &seen.outline, outline);
            let starts: Vec<_> =
                seen.tracks.iter().filter_map(|track| track.first().copied()).collect();
            panel.dots(&mut figure, &starts, start_px, GREY);
        }
        figure.overlay = Some(Overlay::of_map(Frame::of(&panel)));
    }
    figure.end()
}

/// Both axes widened until a metre is as long on one as on the other, and the height of their panel. px
pub(super) fn to_scale((x, y): (Axis, Axis)) -> ((Option<Axis>, Option<Axis>), f64) {
    let width_px = width_px(1);
    let [x, y] = [x, y].map(|axis| axis.padded(PADDING));
    let [x_m, y_m] = [x, y].map(|axis| axis.high - axis.low);
    let (lowest_px, highest_px) = HEIGHT_PX;
    let height_px = (y_m / x_m * width_px).clamp(lowest_px, highest_px);
    let m_per_px = (x_m / width_px).max(y_m / height_px);
    let widened = |axis: Axis, range_px: f64| {
        let (middle, half) = (f64::midpoint(axis.low, axis.high), 0.5 * m_per_px * range_px);
        Some(Axis { low: middle - half, high: middle + half })
    };
    ((widened(x, width_px), widened(y, height_px)), height_px)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axes(x_m: f64, y_m: f64) -> [f64; 3] {
        let range = |axis: Option<Axis>| axis.map(|axis| axis.high - axis.low).unwrap();
        let axis = |high| Axis { low: 0.0, high };
        let ((x, y), height_px) = to_scale((axis(x_m), axis(y_m)));
        [range(x), range(y), height_px]
    }

    #[test]
    fn a_metre_is_as_long_upwards_as_to_the_right() {
        for (x_m, y_m) in [(1.5, 1.5), (5.0, 0.01), (0.01, 5.0), (3.0, 2.0)] {
            let [x_range, y_range, height_px] = axes(x_m, y_m);
            let scales = [width_px(1) / x_range, height_px / y_range];
            assert!((scales[0] / scales[1] - 1.0).abs() < 1e-9, "{x_m} x {y_m}: {scales:?}");
            assert!(x_range >= x_m && y_range >= y_m, "{x_m} x {y_m}: {x_range} x {y_range}");
        }
    }

    #[test]
    fn every_track_and_the_outline_are_drawn() {
        let square = vec![(0.0, 0.0), (1.5, 0.0), (1.5, 1.5)];
        let flown = vec![(0.0, 0.1), (0.7, 0.05), (f64::NAN, 0.0), (1.4, 0.1), (1.5, 1.4)];
        let (outline, tracks_w) = (square.clone(), vec![flown, square]);
        let seen = SeenFlights { name: "config", outline, tracks: tracks_w };
        let svg = tracks("Tracks", &[seen]).svg();
        let texts = ["config", "outline", "start", "x [m]", "y [m]"];
        assert!(texts.iter().all(|text| svg.contains(&format!(">{text}<"))), "{svg}");
        assert!(!svg.contains("NaN"), "{svg}");
        assert!(tracks("Nothing", &[]).svg().contains("no data"));
    }
}
