//! When LAND is sent again, and when neutral sticks go before it.
//!
//! Owns a compromise between two unverified properties of a drone. It may keep its last sticks while it lands: neutral
//! sticks stop it. And any sticks may cancel its landing: on the floor it may need a while without them to stop its
//! motors, and a second program that steers it cancels each landing within milliseconds. So every other LAND comes
//! alone, and a landing that lasts too long has bursts of LAND, more of them than another program sends sticks.

use tello_flight::drone::LAND_PERIOD;

use crate::clock::{SpanNs, TimeNs};

/// Time after which a landing seems to be in vain: more than from 1.3 m at 0.3 m/s.
const IN_VAIN: SpanNs = SpanNs::from_ms(5000);
/// From then on a burst lasts so long, in each period of so long.
const BURST: SpanNs = SpanNs::from_ms(2000);
const BURST_PERIOD: SpanNs = SpanNs::from_ms(4000);
/// Time between two LANDs of a burst: other programs send sticks 20 to 50 times a second.
const BURST_LAND_PERIOD: SpanNs = SpanNs::from_ms(20);

/// The repetition of one landing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LandingRepetition {
    /// When the landing was ordered.
    since: TimeNs,
    /// LANDs so far, without those of bursts.
    count: u32,
    /// When the next LAND is due.
    pub(super) again_at: TimeNs,
}

impl LandingRepetition {
    /// A landing that is ordered at `now` and begins at `again_at`.
    pub(super) fn begin(now: TimeNs, again_at: TimeNs) -> Self {
        Self { since: now, count: 0, again_at }
    }

    /// Takes the LAND that is sent at `now`: whether neutral sticks go before it.
    ///
    /// Real time: no allocation, constant cost.
    pub(super) fn take(&mut self, now: TimeNs) -> bool {
        let in_vain_ns = now.since(self.since).0 - IN_VAIN.0;
        let is_burst = in_vain_ns >= 0 && in_vain_ns % BURST_PERIOD.0 < BURST.0;
        self.again_at = now.after(if is_burst { BURST_LAND_PERIOD } else { LAND_PERIOD });
        if is_burst {
            return false;
        }
        let count = self.count;
        self.count = count.saturating_add(1);
        count == 0 || !count.is_multiple_of(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Times of all LANDs in the first 20 s, and whether neutral sticks go before them. ms
    fn landings() -> Vec<(i64, bool)> {
        let start = TimeNs(7_000_000);
        let mut repetition = LandingRepetition::begin(start, start);
        let mut landings = Vec::new();
        for ms in 0..20_000 {
            let now = start.after(SpanNs::from_ms(ms));
            if now >= repetition.again_at {
                landings.push((ms, repetition.take(now)));
            }
        }
        landings
    }

    #[test]
    fn neutral_sticks_go_twice_at_first_and_then_every_second() {
        let landings = landings();
        let neutral = landings.iter().filter(|(_, is_neutral)| *is_neutral).map(|(ms, _)| *ms);
        let before: Vec<i64> = neutral.take_while(|ms| *ms < 5000).collect();
        assert_eq!(before, [0, 500, 1500, 2500, 3500, 4500]);
        let all = landings.iter().map(|(ms, _)| *ms).take_while(|ms| *ms < 5000);
        assert_eq!(all.collect::<Vec<_>>(), (0..10).map(|k| 500 * k).collect::<Vec<_>>());
    }

    #[test]
    fn a_landing_in_vain_has_bursts_without_sticks_and_times_without_bursts() {
        let landings = landings();
        let within = |from_ms: i64, until_ms: i64| {
            landings.iter().filter(move |(ms, _)| (from_ms..until_ms).contains(ms))
        };
        for from_ms in [5000, 9000, 13_000] {
            assert_eq!(within(from_ms, from_ms + 2000).count(), 100, "{from_ms} ms");
            assert!(within(from_ms, from_ms + 2000).all(|(_, is_neutral)| !is_neutral));
            assert_eq!(within(from_ms + 2000, from_ms + 4000).count(), 4, "{from_ms} ms");
            let neutral = within(from_ms + 2000, from_ms + 4000).filter(|(_, is_so)| *is_so);
            assert_eq!(neutral.count(), 2, "{from_ms} ms");
        }
    }
}
