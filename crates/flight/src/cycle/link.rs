//! Whether the sent sticks act, and which ones did.
//!
//! Owns what the loop does with the link monitor's verdict: the sticks of the past that the estimator is
//! informed of are corrected back to the moment when the link changed.

use horizon_estim::Observed;
use horizon_model::rows::{Sticks, lag, pose};
use nalgebra::SVector;

use super::dead_time::{DeadTime, DeadTimeChange};
use crate::{LinkMonitor, LinkState, LinkVerdict};

/// Sticks remembered to know which one is held: longer than the monitor takes to notice. steps
const HELD_STEPS: usize = 64;

/// Link monitor and the sticks that would have been applied.
#[derive(Debug)]
pub(super) struct Link {
    dt_s: f64,
    monitor: LinkMonitor,
    dead_time: DeadTime,
    /// Steps that the estimator can amend.
    window_steps: usize,
    /// Ring of the applied sticks if the link was up.
    meant: Vec<Sticks>,
    newest: usize,
    state: LinkState,
    /// The sticks that act while an old command is held.
    held: Sticks,
}

impl Link {
    /// A link that is up, remembered over `window_steps`.
    pub(super) fn new(
        monitor: LinkMonitor,
        dead_time: DeadTime,
        window_steps: usize,
        dt_s: f64,
    ) -> Self {
        let meant = vec![Sticks::zeros(); window_steps.max(HELD_STEPS)];
        Self {
            dt_s,
            monitor,
            dead_time,
            window_steps,
            meant,
            newest: 0,
            state: LinkState::Up,
            held: Sticks::zeros(),
        }
    }

    /// Corrects the dead times by what [`Link::judge`] saw; whether they change.
    pub(super) fn correct_dead_time(&mut self) -> bool {
        let longer = self.dead_time.follow(self.monitor.dead_time_error());
        self.monitor.correct_dead_time(f64::from(longer) * self.dt_s);
        longer != 0
    }

    /// The correction of the dead times; `None` if they stay as they are configured.
    pub(super) fn dead_time(&self) -> Option<DeadTimeChange> {
        self.dead_time.change()
    }

    /// Replaces what is remembered of the newest `steps` steps: `u_meant(back)` would have been applied.
    pub(super) fn recall(&mut self, steps: usize, u_meant: impl Fn(usize) -> Sticks) {
        let len = self.meant.len();
        for back in 0..steps.min(len) {
            self.meant[(self.newest + len - back) % len] = u_meant(back);
        }
    }

    /// Steps by which more of the sent sticks are asked for than without corrections.
    pub(super) fn room_steps(&self) -> usize {
        self.window_steps + self.dead_time.steps_max().unsigned_abs() as usize
    }

    pub(super) fn state(&self) -> LinkState {
        self.state
    }

    pub(super) fn is_up(&self) -> bool {
        !self.state.is_down()
    }

    /// The verdict after a period in which `u_meant` was applied if the link was up, and if it is another one,
    /// since how many steps it has been so.
    pub(super) fn judge(
        &mut self,
        u_meant: &Sticks,
        observed: &Observed<{ pose::COUNT }>,
        p: &SVector<f64, { lag::COUNT }>,
    ) -> (LinkVerdict, Option<usize>) {
        self.newest = (self.newest + 1) % self.meant.len();
        self.meant[self.newest] = *u_meant;
        let verdict = self.monitor.update(u_meant, observed, p);
        self.state = verdict.state;
        let since_steps = verdict.onset_steps as usize;
        if verdict.changed {
            self.held = self.meant(since_steps.min(self.meant.len() - 1));
        }
        (verdict, verdict.changed.then_some(since_steps.min(self.window_steps)))
    }

    /// The applied sticks `back` steps before the newest, by the newest verdict.
    pub(super) fn applied(&self, back: usize) -> Sticks {
        self.instead().unwrap_or_else(|| self.meant(back))
    }

    /// What acts in place of all that is sent; `None` while the link is up.
    pub(super) fn instead(&self) -> Option<Sticks> {
        match self.state {
            LinkState::Up => None,
            LinkState::Released => Some(Sticks::zeros()),
            LinkState::Held => Some(self.held),
        }
    }

    fn meant(&self, back: usize) -> Sticks {
        let len = self.meant.len();
        self.meant[(self.newest + len - back % len) % len]
    }
}
