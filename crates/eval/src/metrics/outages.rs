//! How often and how long commands were lost.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tello_flight::Phase;

use tello_flight::cycle::Outcome;

/// Outages of the commands while flying, as the link monitor sees them: zero without one.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Outages {
    /// Number of outages, whether commands were released or held.
    pub count: u64,
    /// Time from noticing an outage to noticing its end, all together. s
    pub down_s: f64,
}

/// Counts outages tick by tick.
#[derive(Debug, Clone, Copy, Default)]
pub struct OutageCounter {
    found: Outages,
    /// Whether commands were lost in the newest tick.
    is_down: bool,
}

impl OutageCounter {
    /// Adds the verdict of the link monitor in a tick of `dt_s` (s), if there is one.
    pub fn add(&mut self, out: &Outcome, dt_s: f64) {
        if out.phase() == Phase::Flying
            && let Some(link) = &out.link
        {
            self.add_verdict(link.state.is_down(), dt_s);
        }
    }

    /// Adds a tick of `dt_s` (s) in flight in which commands were lost or not.
    pub(crate) fn add_verdict(&mut self, is_down: bool, dt_s: f64) {
        self.found.count += u64::from(is_down && !self.is_down);
        self.found.down_s += if is_down { dt_s } else { 0.0 };
        self.is_down = is_down;
    }

    /// The outages so far.
    pub fn outages(&self) -> Outages {
        self.found
    }
}

#[cfg(test)]
mod tests {
    use tello_flight::{LinkDecision, LinkState};

    use super::*;
    use crate::scene::tests::out;

    const DT_S: f64 = 0.02;

    /// Outages, and how long they lasted. s
    fn of(ticks: &[(Phase, LinkState, bool)]) -> (u64, String) {
        let mut outages = OutageCounter::default();
        for (phase, state, has_changed) in ticks {
            let (state, has_changed) = (*state, *has_changed);
            let link = Some(LinkDecision { state, score: 0.0, has_changed, onset_steps: 0 });
            outages.add(&Outcome { link, ..out(0, *phase) }, DT_S);
        }
        let Outages { count, down_s } = outages.outages();
        (count, format!("{down_s:.2}"))
    }

    #[test]
    fn an_outage_counts_when_it_is_noticed_and_lasts_until_its_end_is() {
        use LinkState::{Held, Released, Up};
        let flying = Phase::Flying;
        let outage = [(flying, Up, false), (flying, Released, true), (flying, Released, false)];
        assert_eq!(of(&outage), (1, "0.04".into()));
        let twice = [outage.as_slice(), &[(flying, Up, true)], &outage].concat();
        assert_eq!(of(&twice), (2, "0.08".into()));
        let other = [outage.as_slice(), &[(flying, Held, true)]].concat();
        assert_eq!(of(&other), (1, "0.06".into()), "one outage of both kinds");
    }

    #[test]
    fn an_outage_that_is_older_than_the_flight_counts_once() {
        let old = |phase| (phase, LinkState::Released, false);
        assert_eq!(
            of(&[old(Phase::TakingOff), old(Phase::Flying), old(Phase::Flying)]),
            (1, "0.04".into())
        );
    }

    #[test]
    fn without_a_monitor_nothing_is_lost() {
        let mut outages = OutageCounter::default();
        outages.add(&Outcome { link: None, ..out(0, Phase::Flying) }, DT_S);
        assert_eq!(outages.outages(), Outages::default());
    }
}
