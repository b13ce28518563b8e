//! Whether the sent sticks act, and which ones did.
//!
//! Owns what the loop does with the link monitor's verdict: the sticks of the past that the estimator is
//! told of are corrected back to the moment when the link changed.

use nalgebra::SVector;
use tello_estim::{LinkMonitor, LinkVerdict, Observed};
use tello_model::rows::{Sticks, lag, pose};

/// Link monitor and the sticks that would have acted.
#[derive(Debug)]
pub(super) struct Link {
    monitor: LinkMonitor,
    /// Ring of the sticks that acted if the link was up.
    meant: Vec<Sticks>,
    newest: usize,
    is_up: bool,
}

impl Link {
    /// A link that is up, remembered over `window_steps`.
    pub(super) fn new(monitor: LinkMonitor, window_steps: usize) -> Self {
        Self { monitor, meant: vec![Sticks::zeros(); window_steps], newest: 0, is_up: true }
    }

    pub(super) fn is_up(&self) -> bool {
        self.is_up
    }

    /// The verdict after a period in which `u_meant` acted if the link was up, and if it is another one,
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
        self.is_up = !verdict.is_down;
        let since_steps = (verdict.onset_steps as usize).min(self.meant.len());
        (verdict, verdict.changed.then_some(since_steps))
    }

    /// The sticks that acted `back` steps before the newest, by the newest verdict.
    pub(super) fn acted(&self, back: usize) -> Sticks {
        let len = self.meant.len();
        if self.is_up {
            self.meant[(self.newest + len - back % len) % len]
        } else {
            Sticks::zeros()
        }
    }
}
