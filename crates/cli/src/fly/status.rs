//! The live status line.

use std::fmt::{self, Display, Formatter};

use tello_control::Phase;
use tello_model::rows::{Pose, Sticks, pose, stick};

use crate::cycle::{Outcome, Timing};

/// What the status line shows of a tick.
#[derive(Debug, Clone, Copy)]
pub(super) struct Status {
    phase: Phase,
    pose_hat: Option<Pose>,
    target: Pose,
    targets_reached: usize,
    u_sent: Sticks,
    timing: Timing,
}

impl Status {
    pub(super) fn of(out: &Outcome, timing: &Timing) -> Self {
        Self {
            phase: out.phase(),
            pose_hat: out.pose_hat(),
            target: out.target,
            targets_reached: out.targets_reached,
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
            self.targets_reached + 1,
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
