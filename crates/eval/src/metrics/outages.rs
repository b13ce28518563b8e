//! How often and how long commands were lost.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tello_flight::Phase;

use tello_flight::cycle::Outcome;

/// Losses of the commands while flying, as the link monitor sees them: zero without one.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Outages {
    /// Number of losses; a change between released and held commands counts as another one.
    pub losses: u64,
    /// Time from noticing a loss to noticing its end, all losses together. s
    pub down_s: f64,
}

impl Outages {
    /// Adds a tick that lasts `dt_s`.
    pub fn add(&mut self, out: &Outcome, dt_s: f64) {
        if out.phase() != Phase::Flying {
            return;
        }
        let Some(link) = out.link.filter(|link| link.state.is_down()) else { return };
        // The first one may be older than the flight.
        self.losses += u64::from(link.changed || self.losses == 0);
        self.down_s += dt_s;
    }
}
