//! The live status line.

use std::fmt::{self, Display, Formatter};
use std::io::{self, IsTerminal};
use std::thread;
use std::time::Duration;

use horizon_model::rows::{Pose, Sticks, pose, stick};
use rtrb::Consumer;
use tello_eval::flight_log::TickRecord;
use tello_flight::Phase;
use tello_flight::cycle::Timing;

use crate::stdio;

/// Lines of which one is shown where nothing can be renewed in place.
const LINES_SKIPPED: u32 = 10;

/// What the status line shows of a tick.
#[derive(Debug, Clone, Copy)]
pub(super) struct Status {
    phase: Phase,
    link_is_down: bool,
    is_by_hand: bool,
    pose_hat: Option<Pose>,
    target: Pose,
    target_number: usize,
    u_sent: Sticks,
    timing: Timing,
}

impl Status {
    pub(super) fn of(tick: &TickRecord) -> Self {
        let (out, timing) = (&tick.out, &tick.timing);
        Self {
            phase: out.phase(),
            is_by_hand: tick.inbox.manual.is_some(),
            link_is_down: out.link.is_some_and(|link| link.state.is_down()),
            pose_hat: out.pose_hat(),
            target: out.target,
            target_number: out.target_number,
            u_sent: out.u_sent,
            timing: *timing,
        }
    }
}

impl Display for Status {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{:<10}", self.phase.name())?;
        if self.is_by_hand {
            write!(f, " BY HAND")?;
        }
        if self.link_is_down {
            // In front: the end of the line may not fit the terminal.
            write!(f, " LINK DOWN")?;
        }
        match &self.pose_hat {
            Some(at) => write!(
                f,
                " at {:+.2} {:+.2} {:.2} m {:+4.0} deg",
                at[pose::X],
                at[pose::Y],
                at[pose::Z],
                at[pose::THETA].to_degrees()
            )?,
            None => write!(f, " waiting for a pose             ")?,
        }
        let (target, u) = (&self.target, &self.u_sent);
        write!(
            f,
            "  target {} {:+.2} {:+.2} {:.2}",
            self.target_number,
            target[pose::X],
            target[pose::Y],
            target[pose::Z]
        )?;
        write!(
            f,
            "  sticks {:+.2} {:+.2} {:+.2} {:+.2}",
            u[stick::ROLL],
            u[stick::PITCH],
            u[stick::YAW],
            u[stick::THROTTLE]
        )?;
        let ms = |ns: i64| ns as f64 * 1e-6;
        write!(
            f,
            "  mhe {:.2} mpc {:.2} late {:.2} ms",
            ms(self.timing.estimate_ns),
            ms(self.timing.plan_ns),
            ms(self.timing.late_ns)
        )
    }
}

/// Shows the newest status once per `period` until the control thread is gone. On a thread of its
/// own: a terminal that blocks must not hold up a link.
pub(super) fn show_statuses(mut statuses: Consumer<Status>, period: Duration) {
    let is_terminal = io::stderr().is_terminal();
    let mut shown = 0_u32;
    while !statuses.is_abandoned() {
        let mut newest = None;
        while let Ok(status) = statuses.pop() {
            newest = Some(status);
        }
        if let Some(status) = newest {
            if is_terminal {
                stdio::note_raw(format_args!("\r\x1b[2K{status}"));
            } else if shown.is_multiple_of(LINES_SKIPPED) {
                stdio::note(status);
            }
            shown += 1;
        }
        thread::sleep(period);
    }
    if is_terminal && shown > 0 {
        stdio::note("");
    }
}
