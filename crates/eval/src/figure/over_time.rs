//! Figures over the time of a flight: lines in panels, and intervals in which a condition held as bars in a panel of
//! their own, or as bands behind all lines.

use super::axis::Axis;
use super::drawing::{
    Anchor, BLACK, BLUE, Color, Figure, GREEN, GREY, ORANGE, PURPLE, SKY, Stroke, TICK_PX,
    VERMILION,
};
use super::legend::Mark;
use super::overlay::{self, Band, Frame, Line, OverTime, Overlay};
use super::panel::{Below, Panel, Strip};
use super::quantity;

/// Height of a panel with lines. px
const HEIGHT_PX: f64 = 120.0;

/// Height of a bar with its name, and the fraction of it that the bar fills. px, 1
const BAR_PX: f64 = 30.0;
const BAR_FRACTION: f64 = 0.4;

const TIME: &str = "time [s]";

/// A line over time; the same name has the same look in each panel.
#[derive(Debug, Clone)]
pub(crate) struct TimeLine<'a> {
    /// Quantity and source, as in the legend: `x estimated`.
    pub name: &'a str,
    /// A value for each time, NaN where there is none. In the unit of its panel
    pub values: Vec<f64>,
    /// Drawn dashed: what was wanted, not what was.
    pub is_reference: bool,
}

/// Lines of one quantity.
#[derive(Debug, Clone)]
pub(crate) struct TimePanel<'a> {
    /// Quantity of the vertical axis.
    pub name: &'a str,
    /// Unit of all values of the panel, 1 for a ratio.
    pub unit: &'a str,
    /// Lines of the panel, in the order of the legend.
    pub lines: Vec<TimeLine<'a>>,
}

/// Intervals in which a condition held.
#[derive(Debug, Clone)]
pub(crate) struct TimeBars {
    /// Condition that held, as in the label of the bar.
    pub name: String,
    /// Begin and end of each time in which it held, on the time axis of the figure. s
    pub spans_s: Vec<(f64, f64)>,
}

/// Intervals that are drawn over the time of a flight, besides the lines.
#[derive(Debug, Clone, Default)]
pub(crate) struct TimeSpans {
    /// Below the panels, a row of bars for each.
    pub bars: Vec<TimeBars>,
    /// Behind the lines of every panel, a colour for each.
    pub bands: Vec<TimeBars>,
}

/// Colours of the bands, all to be seen through.
const BANDS: [Color; 3] = [ORANGE.faded(0.35), VERMILION.faded(0.3), SKY.faded(0.35)];

/// A panel for each quantity with its lines over the same times `time_s`, and what was true from when to when.
pub(crate) fn over_time(
    title: &str,
    time_s: &[f64],
    panels: &[TimePanel<'_>],
    TimeSpans { bars, bands }: &TimeSpans,
) -> Figure {
    let looks = looks(panels);
    let look = |line: &TimeLine<'_>| {
        let look = looks.iter().find(|(name, _)| *name == line.name);
        look.map_or(REFERENCE, |(_, stroke)| *stroke)
    };
    let bands: Vec<_> = bands.iter().zip(BANDS.into_iter().cycle()).collect();
    let lines = looks.iter().map(|(name, stroke)| (Mark::Line(*stroke), *name));
    let marks = bands.iter().map(|(band, color)| (Mark::Patch(*color), band.name.as_str()));
    let legend: Vec<_> = lines.chain(marks).collect();
    let mut figure = Figure::begin(title, if legend.len() > 1 { &legend } else { &[] });
    let x = Axis::over(time_s.iter().copied());
    let mut overlay = Overlay { time: overlay::times(time_s), ..Overlay::default() };
    overlay.bands =
        bands.iter().map(|(band, color)| Band::new(&band.name, *color, &band.spans_s)).collect();
    for (i, content) in panels.iter().enumerate() {
        let is_last = i + 1 == panels.len() && bars.is_empty();
        let below = if is_last { Below::Quantity(TIME) } else { Below::Nothing };
        let strip = Strip { columns: 1, height_px: HEIGHT_PX, heading_lines: 0, below };
        let values = content.lines.iter().flat_map(|line| line.values.iter().copied());
        let axes = (x, Axis::over(values).map(|axis| axis.padded(0.06)));
        let Some(area) = strip.place(&mut figure).next() else { continue };
        let name = quantity(content.name, content.unit);
        let Some(panel) = Panel::open(&mut figure, area, axes, below, (&[], &name)) else {
            continue;
        };
        for (band, color) in &bands {
            panel.spans(&mut figure, &band.spans_s, (panel.y.low, panel.y.high), *color);
        }
        for line in &content.lines {
            let points: Vec<_> = time_s.iter().copied().zip(line.values.iter().copied()).collect();
            panel.line(&mut figure, &points, look(line));
        }
        let values = |line: &TimeLine<'_>| Line::new(line.name, look(line), &line.values);
        overlay.panels.push(OverTime {
            frame: Frame::of(&panel),
            unit: content.unit.to_owned(),
            lines: content.lines.iter().map(values).collect(),
            bars: Vec::new(),
        });
    }
    if !bars.is_empty() {
        overlay.panels.extend(open_bars(&mut figure, x, bars));
    }
    figure.overlay = Some(overlay);
    figure.end()
}

const REFERENCE: Stroke = Stroke::dashed(BLACK, 1.2, 5.0);

/// Every name once, and its look.
fn looks<'a>(panels: &[TimePanel<'a>]) -> Vec<(&'a str, Stroke)> {
    let mut colors = [BLUE, ORANGE, GREEN, PURPLE, VERMILION, GREY].into_iter().cycle();
    let mut looks: Vec<(&str, Stroke)> = Vec::new();
    for line in panels.iter().flat_map(|panel| &panel.lines) {
        if looks.iter().any(|(name, _)| *name == line.name) {
            continue;
        }
        let color = if line.is_reference { None } else { colors.next() };
        looks.push((line.name, color.map_or(REFERENCE, |color| Stroke::solid(color, 1.4))));
    }
    looks
}

/// A row for each of `bars`, the first at the top, its name above it.
fn open_bars(figure: &mut Figure, x: Option<Axis>, bars: &[TimeBars]) -> Option<OverTime> {
    let below = Below::Quantity(TIME);
    let height_px = BAR_PX * bars.len() as f64;
    let strip = Strip { columns: 1, height_px, heading_lines: 0, below };
    let (area, x) = strip.place(figure).next().zip(x)?;
    let y = Axis { low: 0.0, high: bars.len() as f64 };
    let panel = Panel::bare(area, x, y);
    for tick in x.ticks(10.0) {
        panel.vertical(figure, tick.value, Stroke::solid(GREY.faded(0.3), 1.0));
        let (at_px, bottom_px) = panel.at((tick.value, 0.0));
        figure.text(&tick.label, (at_px, bottom_px + 15.0), TICK_PX, Anchor::Middle);
    }
    panel.horizontal(figure, 0.0, Stroke::solid(GREY, 1.0));
    let (middle_px, bottom_px) = panel.at((f64::midpoint(x.low, x.high), 0.0));
    figure.text(TIME, (middle_px, bottom_px + 33.0), TICK_PX, Anchor::Middle);
    for (row, bar) in bars.iter().enumerate() {
        let low = y.high - row as f64 - 1.0 + 0.5 * (1.0 - BAR_FRACTION) * 0.4;
        panel.spans(figure, &bar.spans_s, (low, low + BAR_FRACTION), VERMILION);
        let (left_px, name_px) = panel.at((x.low, low + BAR_FRACTION));
        figure.text(&bar.name, (left_px + 4.0, name_px - 4.0), TICK_PX, Anchor::Start);
    }
    let named = |bar: &TimeBars| (bar.name.clone(), bar.spans_s.clone());
    Some(OverTime {
        frame: Frame::of(&panel),
        unit: String::new(),
        lines: Vec::new(),
        bars: bars.iter().map(named).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_bars_and_their_names_are_drawn() {
        let time_s = [0.0, 1.0, 2.0];
        let line = |name, is_reference| {
            let values = vec![0.0, f64::NAN, 1.0];
            TimeLine { name, values, is_reference }
        };
        let lines = vec![line("state", false), line("wanted", true)];
        let panels = [TimePanel { name: "x", unit: "m", lines }];
        let bars =
            vec![TimeBars { name: "link down".into(), spans_s: vec![(0.5, 1.5), (1.9, 9.0)] }];
        let bands = vec![TimeBars { name: "a fault".into(), spans_s: vec![(0.5, 1.0)] }];
        let svg = over_time("Flight", &time_s, &panels, &TimeSpans { bars, bands }).svg();
        for text in ["state", "wanted", "x [m]", "link down", "a fault", "time [s]"] {
            assert!(svg.contains(&format!(">{text}<")), "{text}: {svg}");
        }
        assert!(!svg.contains("NaN"), "{svg}");
        let bars = svg.matches(&format!("fill=\"{VERMILION}\"")).count();
        assert_eq!(bars, 2, "{svg}");
        // One in the panel, one in the legend.
        assert_eq!(svg.matches("fill-opacity=\"0.35\"").count(), 2, "{svg}");
        let nothing = over_time("Nothing", &[], &panels, &TimeSpans::default());
        assert!(nothing.svg().contains("no data"));
    }
}
