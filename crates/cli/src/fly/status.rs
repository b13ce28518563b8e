//! The live status line.

use std::fmt::{self, Display, Formatter};
use std::io::{self, IsTerminal, Write};

use tello_control::Phase;
use tello_model::rows::{Pose, Sticks, pose, stick};

use crate::cycle::{Outcome, Timing};

/// What the status line shows of a tick.
#[derive(Debug, Clone, Copy)]
pub(super) struct Status {
    phase: Phase,
    pose_hat: Option<Pose>,
    target: Pose,
    target_number: usize,
    u_sent: Sticks,
    timing: Timing,
}

impl Status {
    pub(super) fn of(out: &Outcome, timing: &Timing) -> Self {
        Self {
            phase: out.phase(),
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

/// One line on a terminal that is renewed in place; a line now and then anywhere else.
pub(super) struct StatusLine {
    is_terminal: bool,
    shown: u32,
}

impl StatusLine {
    /// Lines that are left out between two where nothing can be renewed in place.
    const EVERY: u32 = 10;

    pub(super) fn new() -> Self {
        Self { is_terminal: io::stderr().is_terminal(), shown: 0 }
    }

    pub(super) fn show(&mut self, status: &Status) {
        if self.is_terminal {
            eprint!("\r\x1b[2K{status}");
        } else if self.shown.is_multiple_of(Self::EVERY) {
            eprintln!("{status}");
        }
        self.shown += 1;
        // A terminal that is gone is no reason to stop flying.
        io::stderr().flush().ok();
    }

    pub(super) fn note(&self, text: &str) {
        self.end();
        eprintln!("{text}");
    }

    pub(super) fn end(&self) {
        if self.is_terminal && self.shown > 0 {
            eprintln!();
        }
    }
}
