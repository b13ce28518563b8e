//! The numbers beside the room: pose and target, sticks, links, times of the ticks.

use std::collections::VecDeque;

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Paragraph, Sparkline};
use tello_eval::telemetry::{DroneTelemetry, MocapTelemetry, Spot, Telemetry};

use super::View;

/// Columns of a stick's gauge, to each side of its middle.
const STICK_COLUMNS: usize = 10;

/// Columns before the histories, for their names.
const NAME_COLUMNS: u16 = 13;

/// Smallest value that fills the height of a history. us
const HISTORY_US: u64 = 1_000;

/// Draws the numbers into `area`, the histories of the ticks below.
pub(super) fn draw(frame: &mut Frame<'_>, area: Rect, view: &View) {
    let mut lines = places(&view.facts);
    lines.extend(sticks(view));
    lines.extend(links(view));
    lines.extend(times(view));
    let lines_count = u16::try_from(lines.len()).unwrap_or(u16::MAX);
    let [list, late, solve] =
        Layout::vertical([Constraint::Length(lines_count), Constraint::Max(4), Constraint::Max(4)])
            .areas(area);
    frame.render_widget(Paragraph::new(lines), list);
    history(frame, late, "late", &view.late_us, view.palette.orange);
    history(frame, solve, "solve", &view.solve_us, view.palette.blue);
}

fn named(name: &'static str, rest: String) -> Line<'static> {
    let bold = Style::new().add_modifier(Modifier::BOLD);
    Line::from(vec![Span::styled(format!(" {name:<9}"), bold), Span::raw(rest)])
}

/// Pose, target and velocity, and how far it is off.
fn places(facts: &Telemetry) -> Vec<Line<'static>> {
    let spot = |at: &Spot| {
        let degrees = at.theta.to_degrees();
        format!("{:+7.2}{:+7.2}{:+7.2}{degrees:+6.0}", at.x, at.y, at.z)
    };
    let absent = || "      -      -      -     -".to_owned();
    let velocity = |v: &[f64; 3]| {
        let [x, y, z] = v;
        format!("{x:+7.2}{y:+7.2}{z:+7.2}  m/s")
    };
    let offset = facts.offset.map_or_else(
        || "-".to_owned(),
        |[distance, height]| format!("{distance:.2} m, height {height:+.2} m"),
    );
    vec![
        named("", "   x m    y m    z m   deg".to_owned()),
        named("at", facts.estimate.as_ref().map_or_else(absent, spot)),
        named("measured", facts.measured.as_ref().map_or_else(absent, spot)),
        named("target", spot(&facts.target)),
        named("speed", facts.velocity_w.as_ref().map_or_else(absent, velocity)),
        named("off path", offset),
    ]
}

/// The four sticks, neutral in the middle.
fn sticks(view: &View) -> Vec<Line<'static>> {
    let sent = &view.facts.sticks;
    [("roll", sent.roll), ("pitch", sent.pitch), ("yaw", sent.yaw), ("throttle", sent.throttle)]
        .map(|(name, u)| {
            let [left, right] = gauge(u);
            let bar = Style::new().fg(view.palette.blue);
            let mut line = named(name, String::new());
            line.push_span(Span::styled(left, bar));
            line.push_span(Span::raw("|"));
            line.push_span(Span::styled(right, bar));
            line.push_span(Span::raw(format!("{u:+6.2}")));
            line
        })
        .into()
}

/// What is left and right of the middle.
fn gauge(u: f64) -> [String; 2] {
    // NaN is none.
    let filled = horizon_model::whole((u.abs().clamp(0.0, 1.0) * STICK_COLUMNS as f64).round());
    let empty = "\u{b7}".repeat(STICK_COLUMNS - filled);
    let (bar, rest) = ("\u{2588}".repeat(filled), "\u{b7}".repeat(STICK_COLUMNS));
    if u < 0.0 { [empty + &bar, rest] } else { [rest, bar + &empty] }
}

/// Link, drone and mocap.
fn links(view: &View) -> Vec<Line<'static>> {
    let facts = &view.facts;
    let link = facts.link.map_or_else(
        || "not watched".to_owned(),
        |link| {
            let acts = if link.is_down { "does not act" } else { "acts" };
            format!("{acts}, score {:+.1}", link.score)
        },
    );
    vec![
        named("sticks", link),
        named("drone", facts.drone.as_ref().map_or_else(|| "not heard yet".to_owned(), of_drone)),
        named("mocap", of_mocap(&facts.mocap)),
    ]
}

fn of_drone(drone: &DroneTelemetry) -> String {
    let low = if drone.is_battery_low == Some(true) { " LOW" } else { "" };
    let flies = if drone.is_flying { "flies" } else { "stands" };
    let age = if drone.age_s > 1.0 { format!(", {:.0} s ago", drone.age_s) } else { String::new() };
    format!("{} %{low}, {flies}{age}", drone.battery_pct)
}

fn of_mocap(mocap: &MocapTelemetry) -> String {
    let Some(age_s) = mocap.age_s else { return "no pose yet".to_owned() };
    format!("{:.0} ms old, {:.0} Hz", age_s * 1e3, mocap.rate_hz)
}

/// Times of the ticks: now, and at worst lately.
fn times(view: &View) -> Vec<Line<'static>> {
    let (now, worst) = (&view.facts.times, &view.facts.worst);
    let row = |name, now: f64, worst: f64| named(name, format!("{now:6.2} ms, worst {worst:6.2}"));
    vec![
        row("late", now.late_ms, worst.late_ms),
        row("MHE", now.estimate_ms, worst.estimate_ms),
        row("MPC", now.plan_ms, worst.plan_ms),
    ]
}

/// The newest samples as far as there is space, with the largest of them.
fn history(
    frame: &mut Frame<'_>,
    area: Rect,
    name: &str,
    samples_us: &VecDeque<u64>,
    color: Color,
) {
    let [label, bars] =
        Layout::horizontal([Constraint::Length(NAME_COLUMNS), Constraint::Fill(1)]).areas(area);
    let skipped = samples_us.len().saturating_sub(usize::from(bars.width));
    let newest: Vec<u64> = samples_us.iter().skip(skipped).copied().collect();
    let most = newest.iter().copied().max().unwrap_or(0).max(HISTORY_US);
    let text = Paragraph::new(format!(" {name} {:.0} ms", most as f64 * 1e-3));
    frame.render_widget(text, label);
    let sparkline = Sparkline::default().data(newest).max(most).style(Style::new().fg(color));
    frame.render_widget(sparkline, bars);
}

#[cfg(test)]
mod tests;
