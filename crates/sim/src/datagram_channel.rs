//! Datagrams on their way: lost, late, doubled, out of order.
//!
//! Owns one direction of the radio, byte by byte; that a drone ignores what it received is
//! [`crate::command_link`]'s. One seed and one sequence of datagrams, one fate for each.

use horizon_model::setting::{SettingError, in_range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::random::{Purpose, Random};

/// Shape of the delays, an assumption: 95 % below 2.8 medians, one in 200 above 5. 1
const DELAY_SIGMA: f64 = 0.63;
/// Time for which a reordered datagram is held back, so that later ones pass it. s
const HELD_BACK_S: f64 = 0.1;
/// Datagrams in transit; what is sent beyond is lost.
const IN_TRANSIT_MAX: usize = 256;

/// Loss, delay and order of datagrams in each direction. Times are for one way: a round trip takes 0.044 s in
/// the median and 0.228 s at worst (TelloPy's documentation).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AirTable {
    /// Fraction that is lost. 1, 0..=1
    pub loss: f64,
    /// Fraction that arrives twice. 1, 0..=1
    pub duplicate: f64,
    /// Fraction that is held back for 0.1 s, so that later ones overtake it. 1, 0..=1
    pub reorder: f64,
    /// Median delay; each datagram has its own, so that they overtake each other. s, 0..=1
    pub delay_median_s: f64,
    /// Longest delay, being held back aside. s, 0..=1
    pub delay_max_s: f64,
}

/// Everything arrives at once.
#[cfg(test)]
pub(crate) const PERFECT: AirTable =
    AirTable { loss: 0.0, duplicate: 0.0, reorder: 0.0, delay_median_s: 0.0, delay_max_s: 0.0 };

impl AirTable {
    pub(crate) fn check(&self) -> Result<(), SettingError> {
        let Self { loss, duplicate, reorder, delay_median_s, delay_max_s } = *self;
        for (key, value) in [
            ("loss", loss),
            ("duplicate", duplicate),
            ("reorder", reorder),
            ("delay_median_s", delay_median_s),
            ("delay_max_s", delay_max_s),
        ] {
            in_range(key, value, 0.0..=1.0)?;
        }
        Ok(())
    }
}

/// One direction.
#[derive(Debug, Clone)]
pub(crate) struct Air<T> {
    table: AirTable,
    random: Random,
    /// When each arrives, in the order of sending. s
    in_transit: Vec<(f64, T)>,
}

impl<T: Clone> Air<T> {
    pub(crate) fn new(table: AirTable, seed: u64, purpose: Purpose) -> Self {
        Self { table, random: Random::new(seed, purpose), in_transit: Vec::new() }
    }

    /// Sends `datagram` at `now_s`.
    pub(crate) fn send(&mut self, datagram: T, now_s: f64) {
        // Every datagram draws all its chances: what becomes of one does not change the next one's.
        let is_lost = self.random.chance(self.table.loss);
        let is_double = self.random.chance(self.table.duplicate);
        for is_sent in [!is_lost, !is_lost && is_double] {
            let delay_s = self.delay_s();
            if is_sent && self.in_transit.len() < IN_TRANSIT_MAX {
                self.in_transit.push((now_s + delay_s, datagram.clone()));
            }
        }
    }

    /// Oldest datagram that arrived until `now_s` and was not taken yet.
    pub(crate) fn receive(&mut self, now_s: f64) -> Option<T> {
        let arrivals = self.in_transit.iter().enumerate().filter(|(_, (at_s, _))| *at_s <= now_s);
        let (first, _) = arrivals.min_by(|(_, (a_s, _)), (_, (b_s, _))| a_s.total_cmp(b_s))?;
        Some(self.in_transit.remove(first).1)
    }

    fn delay_s(&mut self) -> f64 {
        let AirTable { reorder, delay_median_s, delay_max_s, .. } = self.table;
        let is_held_back = self.random.chance(reorder);
        let delay_s = self.random.log_normal(delay_median_s, DELAY_SIGMA).min(delay_max_s);
        if is_held_back { delay_s + HELD_BACK_S } else { delay_s }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers 0.. sent every 20 ms through `table`, with the time from sending to arrival. s
    fn arrivals(table: AirTable, seed: u64, count: u32) -> Vec<(u32, f64)> {
        let mut air = Air::new(table, seed, Purpose::Uplink);
        let mut arrived = Vec::new();
        for k in 0..count + 100 {
            let now_s = f64::from(k) * 0.02;
            if k < count {
                air.send(k, now_s);
            }
            while let Some(number) = air.receive(now_s) {
                arrived.push((number, now_s - f64::from(number) * 0.02));
            }
        }
        arrived
    }

    #[test]
    fn perfect_air_delivers_everything_at_once_in_order() {
        let arrived = arrivals(PERFECT, 1, 500);
        assert!(arrived.iter().map(|(number, _)| *number).eq(0..500));
        assert!(arrived.iter().all(|(_, late_s)| late_s.abs() < 1e-9));
    }

    #[test]
    fn one_seed_is_one_fate() {
        let table = AirTable {
            loss: 0.1,
            duplicate: 0.1,
            delay_median_s: 0.03,
            delay_max_s: 0.2,
            ..PERFECT
        };
        assert_eq!(arrivals(table, 5, 500), arrivals(table, 5, 500));
        assert_ne!(arrivals(table, 5, 500), arrivals(table, 6, 500));
    }

    #[test]
    fn losses_and_doubles_are_as_frequent_as_set() {
        let count = 20_000;
        let table = AirTable { loss: 0.1, duplicate: 0.05, ..PERFECT };
        let arrived = arrivals(table, 2, count).len() as f64 / f64::from(count);
        // 0.9 * 1.05; three standard errors of 20 000 draws are 0.008.
        assert!((arrived - 0.945).abs() < 0.008, "{arrived}");
    }

    #[test]
    fn delays_have_their_median_and_their_limit() {
        let table = AirTable { delay_median_s: 0.022, delay_max_s: 0.114, ..PERFECT };
        let mut late_s: Vec<f64> =
            arrivals(table, 3, 20_000).into_iter().map(|(_, late_s)| late_s).collect();
        late_s.sort_by(f64::total_cmp);
        // Seen on a grid of 20 ms.
        assert!((late_s[late_s.len() / 2] - 0.04).abs() < 1e-9, "{}", late_s[late_s.len() / 2]);
        let longest_s = late_s[late_s.len() - 1];
        assert!((0.1..=0.12 + 1e-9).contains(&longest_s), "{longest_s} s");
    }

    #[test]
    fn what_is_held_back_is_overtaken() {
        let table = AirTable { reorder: 0.1, ..PERFECT };
        let arrived = arrivals(table, 4, 1_000);
        assert_eq!(arrived.len(), 1_000);
        let overtaken = arrived.windows(2).filter(|pair| pair[0].0 > pair[1].0).count();
        assert!((50..=110).contains(&overtaken), "{overtaken} of 1000");
    }

    #[test]
    fn a_loss_above_one_is_refused() {
        let table = AirTable { loss: 1.5, ..PERFECT };
        assert_eq!(table.check().unwrap_err().to_string(), "loss = 1.5: expected 0.0..=1.0");
    }
}
