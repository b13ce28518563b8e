//! Where the vehicle would be if the link monitor is wrong.
//!
//! Owns the worst case of a command outage: while the commands are judged to be lost, a second state applies all of
//! them. The supervisor lands if that state leaves the room: the motion capture may see another object.

use horizon_model::Model;
use horizon_model::rows::{Sticks, pose, stick};
use nalgebra::SVector;

/// The state that follows all commands, since an outage began.
#[derive(Debug, Clone, Default)]
pub(super) struct WorstCase<const NS: usize> {
    s: Option<SVector<f64, NS>>,
    for_s: f64,
}

impl<const NS: usize> WorstCase<NS> {
    /// One period of `dt_s` with the link as judged; `u_meant` would have been applied in it.
    pub(super) fn follow<M, const NP: usize>(
        &mut self,
        model: &M,
        link_is_up: bool,
        (s_hat, p_hat): (&SVector<f64, NS>, &SVector<f64, NP>),
        u_meant: &Sticks,
        dt_s: f64,
    ) where
        M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP>,
    {
        if link_is_up {
            *self = Self::default();
            return;
        }
        let s = self.s.as_ref().unwrap_or(s_hat);
        self.s = Some(model.step(s, u_meant, p_hat, dt_s));
        self.for_s += dt_s;
    }

    /// The state and how long the outage has lasted. s
    pub(super) fn state(&self) -> Option<(&SVector<f64, NS>, f64)> {
        self.s.as_ref().map(|s| (s, self.for_s))
    }
}
