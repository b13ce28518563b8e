//! Where everything is in the picture, and its colours.
//!
//! Owns the head, the faults, messages and keys; the rest is `room` and `numbers`. What does not fit is cut off:
//! the most important stands first.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Paragraph, Wrap};
use tello_flight::{Fault, Operator, Phase, Pilot};
use tello_io::manual::KEYS_HELP;

use super::{View, numbers, room};
use crate::fly::status::WIDE;

/// Most messages that are shown.
pub(super) const MESSAGES_MAX: usize = 6;

/// Heights from which there are as many messages, in lines.
const HEIGHT_FOR_ALL: u16 = 34;
const MESSAGES_IN_SMALL: u16 = 2;

/// Width of the numbers, in columns.
const NUMBERS_COLUMNS: u16 = 38;

/// The colours of the figures, of middling brightness: readable on light and on dark. Without colours,
/// everything has that of the terminal.
#[derive(Debug, Clone, Copy)]
pub(super) struct Palette {
    pub(super) blue: Color,
    pub(super) orange: Color,
    pub(super) green: Color,
    pub(super) grey: Color,
    pub(super) vermilion: Color,
}

impl Palette {
    pub(super) fn new(has_colours: bool) -> Self {
        let [blue, orange, green, grey, vermilion] = [32, 172, 36, 244, 166]
            .map(|index| if has_colours { Color::Indexed(index) } else { Color::Reset });
        Self { blue, orange, green, grey, vermilion }
    }

    /// For what the operator must not miss.
    fn alarm(self) -> Style {
        Style::new().fg(self.vermilion).add_modifier(Modifier::BOLD | Modifier::REVERSED)
    }
}

/// Draws the whole picture.
pub(super) fn draw(frame: &mut Frame<'_>, view: &View) {
    let area = frame.area();
    let keys = Paragraph::new(KEYS_HELP).wrap(Wrap { trim: true });
    #[expect(clippy::cast_possible_truncation, reason = "two or three lines")]
    let keys_lines = KEYS_HELP.len().div_ceil(usize::from(area.width.max(1))).min(4) as u16;
    #[expect(clippy::cast_possible_truncation, reason = "MESSAGES_MAX is a handful of lines")]
    let messages_lines =
        if area.height < HEIGHT_FOR_ALL { MESSAGES_IN_SMALL } else { MESSAGES_MAX as u16 };
    let [head, wrong, middle, log, help] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Length(1),
        Constraint::Fill(1),
        Constraint::Length(messages_lines),
        Constraint::Length(keys_lines),
    ])
    .areas(area);
    let [map, list] =
        Layout::horizontal([Constraint::Fill(1), Constraint::Length(NUMBERS_COLUMNS)])
            .areas(middle);
    frame.render_widget(headline(view), head);
    frame.render_widget(wrongs(view), wrong);
    room::draw(frame, map, view);
    numbers::draw(frame, list, view);
    let skipped = view.messages.len().saturating_sub(usize::from(messages_lines));
    let messages: Vec<Line<'_>> =
        view.messages.iter().skip(skipped).map(|line| Line::raw(line.as_str())).collect();
    frame.render_widget(Paragraph::new(messages).style(Style::new().fg(view.palette.grey)), log);
    frame.render_widget(keys, help);
}

/// Phase, who steers, time, targets and what the operator asked for.
fn headline(view: &View) -> Line<'static> {
    let facts = &view.facts;
    let bold = Style::new().add_modifier(Modifier::BOLD);
    let phase = facts.phase.map_or("starting", Phase::name).to_uppercase();
    let steers = match (facts.is_by_hand, facts.pilot) {
        (true, _) => "BY HAND",
        (false, Some(Pilot::Person)) => "person",
        (false, Some(Pilot::Controller)) => "controller",
        (false, None) => "nobody steers",
    };
    let steers_style = if facts.is_by_hand { view.palette.alarm() } else { Style::new() };
    let mut spans = vec![
        Span::styled(format!(" {phase} "), bold.add_modifier(Modifier::REVERSED)),
        Span::raw(" "),
        Span::styled(steers, steers_style),
        Span::raw(format!("  {:.1} s", facts.t_s)),
    ];
    let asked = match facts.operator {
        Operator::Land => "  landing is asked for",
        Operator::EmergencyStop => "  EMERGENCY STOP requested",
        _ => "",
    };
    spans.push(Span::styled(asked, bold));
    if facts.link.is_some_and(|link| link.is_down) {
        spans.push(Span::raw("  "));
        spans.push(Span::styled(" STICKS DO NOT ACT ", view.palette.alarm()));
    }
    let count = view.briefing.targets_count;
    spans.push(Span::raw(format!("  {} of {count} targets", facts.targets_reached)));
    Line::from(spans)
}

/// What is wrong.
fn wrongs(view: &View) -> Line<'static> {
    if view.is_over && view.facts.phase == Some(Phase::Landed) {
        return Line::styled(" landed: the flight is over", Style::new().fg(view.palette.green));
    }
    if view.is_over {
        let text = " the control loop has ended: a drone that still flies is ordered to land ";
        return Line::styled(text, view.palette.alarm());
    }
    if view.is_old() {
        let status = view.status.as_ref().map(|status| status.line(WIDE)).unwrap_or_default();
        return Line::styled(format!(" NO NEWS from the log: {status}"), view.palette.alarm());
    }
    let faults: Vec<&str> = view.facts.faults.iter().copied().map(Fault::name).collect();
    if faults.is_empty() {
        return Line::styled(" no fault", Style::new().fg(view.palette.green));
    }
    Line::styled(format!(" {} ", faults.join(", ")), view.palette.alarm())
}

#[cfg(test)]
mod tests;
