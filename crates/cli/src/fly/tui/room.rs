//! The room in dots: from above, and from the side where there is space.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::Block;
use ratatui::widgets::canvas::{self, Canvas, Context, Rectangle};
use tello_eval::display_rounding::PosW;
use tello_eval::telemetry::Spot;

use super::View;

/// Around what is drawn. m
const MARGIN_M: f64 = 0.5;

/// Height from which there is a view from the side, in lines, and its fraction. %
const HEIGHT_FOR_SIDE: u16 = 26;
const SIDE_PCT: u16 = 30;

/// The vehicle, by the eighth of a turn that it looks along, counter-clockwise from x.
const ARROWS: [&str; 8] = [
    "\u{2192}", "\u{2197}", "\u{2191}", "\u{2196}", "\u{2190}", "\u{2199}", "\u{2193}", "\u{2198}",
];

/// Projection of the room: two of its axes, to the right and up. m
#[derive(Clone, Copy)]
enum Projection {
    Above,
    Side,
}

impl Projection {
    fn project(self, [x, y, z]: PosW) -> [f64; 2] {
        match self {
            Self::Above => [x, y],
            Self::Side => [x, z],
        }
    }
}

/// Draws the room into `area`.
pub(super) fn draw(frame: &mut Frame<'_>, area: Rect, view: &View) {
    if area.height < HEIGHT_FOR_SIDE {
        draw_seen(frame, area, view, Projection::Above);
        return;
    }
    let [above, side] =
        Layout::vertical([Constraint::Fill(1), Constraint::Percentage(SIDE_PCT)]).areas(area);
    draw_seen(frame, above, view, Projection::Above);
    draw_seen(frame, side, view, Projection::Side);
}

fn draw_seen(frame: &mut Frame<'_>, area: Rect, view: &View, seen: Projection) {
    let inner = Block::bordered().inner(area);
    let [x_m, y_m] = bounds(view, inner, seen);
    let [left, right] = x_m;
    let title = match seen {
        Projection::Above => format!(" from above, {:.1} m wide: x right, y up ", right - left),
        Projection::Side => " from the side: x right, z up ".to_owned(),
    };
    let mut block = Block::bordered().border_style(Style::new().fg(view.palette.grey)).title(title);
    if let Projection::Above = seen {
        block = block.title_bottom(legend(view));
    }
    let canvas = Canvas::default()
        .block(block)
        .marker(Marker::Braille)
        .x_bounds(x_m)
        .y_bounds(y_m)
        .paint(|context| paint(context, view, seen));
    frame.render_widget(canvas, area);
}

fn legend(view: &View) -> Line<'static> {
    let palette = &view.palette;
    let name = |text: &'static str, color| Span::styled(text, Style::new().fg(color));
    Line::from(vec![
        name(" reference path", palette.grey),
        name(" flown", palette.blue),
        name(" in transit", palette.orange),
        name(" plan", palette.green),
        name(" x target", palette.vermilion),
    ])
}

fn paint(context: &mut Context<'_>, view: &View, seen: Projection) {
    let (facts, palette) = (&view.facts, &view.palette);
    if let Some(room) = view.briefing.room {
        let [[x, y], [right, top]] = room.map(|corner| seen.project(corner));
        let (width, height) = (right - x, top - y);
        context.draw(&Rectangle { x, y, width, height, color: palette.grey });
    }
    line(context, &view.briefing.path, seen, palette.grey);
    context.layer();
    line(context, &facts.trail, seen, palette.blue);
    context.layer();
    line(context, &facts.committed, seen, palette.orange);
    line(context, &facts.plan, seen, palette.green);
    let mut print = |place: PosW, text: &'static str, color| {
        let [x, y] = seen.project(place);
        let style = Style::new().fg(color).add_modifier(Modifier::BOLD);
        context.print(x, y, Line::styled(text, style));
    };
    if facts.phase.is_some() {
        print(place(&facts.target), "x", palette.vermilion);
    }
    if let Some(at) = &facts.estimate {
        print(place(at), arrow(at, seen), Color::Reset);
    }
}

/// A line through `places`.
fn line(context: &mut Context<'_>, places: &[PosW], seen: Projection, color: Color) {
    for (begin, end) in places.iter().zip(places.iter().skip(1)) {
        let ([x1, y1], [x2, y2]) = (seen.project(*begin), seen.project(*end));
        context.draw(&canvas::Line { x1, y1, x2, y2, color });
    }
}

fn place(at: &Spot) -> PosW {
    [at.x, at.y, at.z]
}

/// The vehicle as a character: where it looks, seen from above.
fn arrow(at: &Spot, seen: Projection) -> &'static str {
    let eighths = (at.theta / std::f64::consts::FRAC_PI_4).round().rem_euclid(8.0);
    match seen {
        Projection::Above => ARROWS.get(horizon_model::whole(eighths)).copied().unwrap_or("o"),
        Projection::Side => "o",
    }
}

/// What is visible to the right and up, so that a metre is as long in both and all but far walls is
/// inside. m
fn bounds(view: &View, area: Rect, seen: Projection) -> [[f64; 2]; 2] {
    let (briefing, facts) = (&view.briefing, &view.facts);
    let target = facts.phase.map(|_| place(&facts.target));
    let estimate = facts.estimate.as_ref().map(place);
    // Beside a reference path, the whole height over the floor.
    let floor = briefing.path.first().map(|[x, y, _]| [*x, *y, 0.0]);
    let reference = briefing.path.iter().chain(&facts.trail).copied();
    let places = reference.chain(floor).chain(target).chain(estimate);
    let nothing = [(f64::INFINITY, f64::NEG_INFINITY); 2];
    let [across, up] = places.fold(nothing, |[across, up], place| {
        let [x, y] = seen.project(place);
        let wider = |(low, high): (f64, f64), value: f64| (low.min(value), high.max(value));
        [wider(across, x), wider(up, y)]
    });
    let length = |(low, high): (f64, f64)| high - low + 2.0 * MARGIN_M;
    // A character is two dots wide and four high, which makes dots square.
    let (columns, rows) = (2.0 * f64::from(area.width.max(1)), 4.0 * f64::from(area.height.max(1)));
    let metres_per_dot = (length(across) / columns).max(length(up) / rows);
    let around = |(low, high), dots: f64| {
        let (middle, reach) = (f64::midpoint(low, high), 0.5 * dots * metres_per_dot);
        if reach.is_finite() { [middle - reach, middle + reach] } else { [-1.0, 1.0] }
    };
    [around(across, columns), around(up, rows)]
}

#[cfg(test)]
mod tests;
