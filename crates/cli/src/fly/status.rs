//! The live status line.

use std::io::{self, IsTerminal};
use std::thread;
use std::time::Duration;

use horizon_model::rows::{Pose, Sticks, pose, stick};
use rtrb::Consumer;
use tello_eval::flight_log::TickRecord;
use tello_flight::cycle::Timing;
use tello_flight::{Fault, Phase, Pilot, Reaction};

use crate::stdio;

/// Period of the statuses, and of the status line.
pub(super) const STATUS_PERIOD: Duration = Duration::from_millis(200);

/// Lines of which one is shown where nothing can be renewed in place.
const LINES_SKIPPED: u32 = 10;

/// Columns of output that is no terminal, such as a file.
pub(super) const WIDE: usize = 200;

/// Values of a tick on the status line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Status {
    phase: Phase,
    /// The fault that keeps the vehicle from its mission.
    stopped_by: Option<Fault>,
    link_is_down: bool,
    is_by_hand: bool,
    pose_hat: Option<Pose>,
    target: Pose,
    target_number: usize,
    u_shown: Sticks,
    timing: Timing,
}

impl Status {
    pub(super) fn of(tick: &TickRecord) -> Self {
        let (out, timing) = (&tick.out, &tick.timing);
        let is_by_hand = tick.inbox.manual.is_some();
        let pilot = if is_by_hand { Pilot::Person } else { Pilot::Controller };
        let faults =
            out.decision.map(|decision| decision.faults).filter(|_| out.phase() == Phase::Flying);
        let strongest =
            faults.and_then(|faults| faults.iter().max_by_key(|fault| fault.reaction(pilot)));
        Self {
            phase: out.phase(),
            stopped_by: strongest.filter(|fault| fault.reaction(pilot) >= Reaction::Brake),
            is_by_hand,
            link_is_down: out.link.is_some_and(|link| link.state.is_down()),
            pose_hat: out.pose_hat(),
            target: out.target,
            target_number: out.target_number,
            u_shown: out.u_shown(&tick.inbox),
            timing: *timing,
        }
    }
}

impl Status {
    /// Text on `width` columns: parts in the order of their weight, up to the first that does not fit.
    pub(super) fn line(&self, width: usize) -> String {
        let mut line = format!("{:<9}", self.phase.name());
        for part in self.parts() {
            if line.chars().count() + part.chars().count() > width {
                break;
            }
            line.push_str(&part);
        }
        line.truncate(line.floor_char_boundary(width));
        line
    }

    /// Warnings first, then what 80 columns have room for, then times.
    fn parts(&self) -> Vec<String> {
        let (target, u) = (&self.target, &self.u_shown);
        let ms = |ns: i64| ns as f64 * 1e-6;
        let warnings =
            [(self.is_by_hand, " BY HAND"), (self.link_is_down, " LINK DOWN")].into_iter();
        let warnings = warnings.filter(|(is_so, _)| *is_so).map(|(_, text)| text.to_owned());
        let stopped = self.stopped_by.map(|fault| format!(" STOPPED {}", fault.name()));
        let warnings = warnings.chain(stopped);
        let place = self.pose_hat.as_ref().map_or(" waiting for a pose".to_owned(), |at| {
            let [x, y, z] = [at[pose::X], at[pose::Y], at[pose::Z]];
            format!(" {x:+.2} {y:+.2} {z:.2} m {:+4.0}\u{b0}", at[pose::THETA].to_degrees())
        });
        let [x, y, z] = [target[pose::X], target[pose::Y], target[pose::Z]];
        let target = format!(" > {} {x:+.2} {y:+.2} {z:.2}", self.target_number);
        let [roll, pitch] = [u[stick::ROLL], u[stick::PITCH]];
        let [yaw, throttle] = [u[stick::YAW], u[stick::THROTTLE]];
        let sticks = format!(" u {roll:+.1} {pitch:+.1} {yaw:+.1} {throttle:+.1}");
        let Timing { estimate_ns, plan_ns, late_ns, .. } = self.timing;
        let times = [("mhe", estimate_ns), ("mpc", plan_ns), ("late", late_ns)];
        let times = times.map(|(name, ns)| format!(" {name} {:.2} ms", ms(ns)));
        warnings.chain([place, target, sticks]).chain(times).collect()
    }
}

/// Columns of the terminal, but one: a line that fills all of them wraps on some.
fn width() -> usize {
    let columns = ratatui::crossterm::terminal::size().map_or(0, |(columns, _)| columns);
    let columns = if columns == 0 { 80 } else { columns };
    usize::from(columns.saturating_sub(1)).clamp(20, 200)
}

/// Shows the newest status once per [`STATUS_PERIOD`] until the control thread is gone. On a thread of its
/// own: a terminal that blocks must not hold up a link.
pub(super) fn show_statuses(mut statuses: Consumer<Status>) {
    let is_terminal = io::stderr().is_terminal();
    let (mut shown, mut stopped_by) = (0_u32, None);
    while !statuses.is_abandoned() {
        let mut newest = None;
        while let Ok(status) = statuses.pop() {
            newest = Some(status);
        }
        if let Some(status) = newest {
            if is_terminal {
                stdio::note_raw(format_args!("\r\x1b[2K{}", status.line(width())));
            } else if shown.is_multiple_of(LINES_SKIPPED) || stopped_by != status.stopped_by {
                stdio::note(status.line(WIDE));
            }
            stopped_by = status.stopped_by;
            shown += 1;
        }
        thread::sleep(STATUS_PERIOD);
    }
    if is_terminal && shown > 0 {
        stdio::note("");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_fits_every_width_and_keeps_place_target_and_sticks_on_80_columns() {
        let mut status = Status {
            phase: Phase::Flying,
            stopped_by: Some(Fault::ObstacleUnseen),
            link_is_down: true,
            is_by_hand: true,
            pose_hat: Some(Pose::new(-9.99, -9.99, 2.34, -3.1)),
            target: Pose::new(-9.99, -9.99, 2.34, 0.0),
            target_number: 10,
            u_shown: Sticks::repeat(-1.0),
            timing: Timing { estimate_ns: 12_340_000, ..Timing::default() },
        };
        for width in 0..200 {
            let line = status.line(width);
            assert!(line.chars().count() <= width, "{width}: {line}");
        }
        let line = status.line(79);
        assert!(line.contains("BY HAND LINK DOWN STOPPED obstacle unseen -9.99"), "{line}");
        (status.is_by_hand, status.link_is_down, status.stopped_by) = (false, false, None);
        let line = status.line(79);
        assert!(line.ends_with("u -1.0 -1.0 -1.0 -1.0"), "{line}");
        assert!(line.contains("> 10 -9.99 -9.99 2.34"), "{line}");
        assert!(status.line(WIDE).contains(" mhe 12.34 ms"));
    }
}
