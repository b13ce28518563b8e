//! The ending of a check: which order is due, and whether the drone is down.

use tello_eval::bench::checks::TestSite;
use tello_flight::drone::LAND_PERIOD;

/// Time after which an ending that landed in vain stops the motors, too. s
const EMERGENCY_AFTER_S: f64 = 8.0;
/// Time after which an ending is given up. s
const ENDING_MAX_S: f64 = 25.0;

/// An ending in progress: when the next order is due, and whether the drone is down.
pub(super) struct Ending {
    pub(super) began_s: f64,
    site: TestSite,
    /// Ctrl-C before the ending.
    interrupts: u32,
    next_s: f64,
    is_stop_next: bool,
    down_since_s: Option<f64>,
    /// Whether the drone has reported for a second that its motors stopped.
    pub(super) is_down: bool,
}

/// Order of an ending.
pub(super) enum EndingOrder {
    Land,
    EmergencyStop,
}

impl Ending {
    pub(super) fn new(began_s: f64, site: TestSite, interrupts: u32) -> Self {
        let is_stop_next = site == TestSite::PropsOff;
        let (next_s, down_since_s, is_down) = (began_s, None, false);
        Self { began_s, site, interrupts, next_s, is_stop_next, down_since_s, is_down }
    }

    /// The order that is due at `t_s`, after so many `interrupts`.
    pub(super) fn advance(&mut self, t_s: f64, interrupts: u32) -> Option<EndingOrder> {
        if t_s < self.next_s {
            return None;
        }
        let is_late = t_s - self.began_s > EMERGENCY_AFTER_S;
        let stops = self.site == TestSite::PropsOff || is_late || interrupts > self.interrupts;
        let is_stop = stops && self.is_stop_next;
        self.is_stop_next = !self.is_stop_next;
        let period_s = LAND_PERIOD.seconds();
        self.next_s = t_s + if stops { period_s / 2.0 } else { period_s };
        Some(if is_stop { EndingOrder::EmergencyStop } else { EndingOrder::Land })
    }

    /// Whether the ending has taken so long that it is given up.
    pub(super) fn is_given_up(&self, t_s: f64) -> bool {
        t_s - self.began_s >= ENDING_MAX_S
    }

    pub(super) fn observe(&mut self, t_s: f64, is_over: bool) {
        self.down_since_s = is_over.then(|| self.down_since_s.unwrap_or(t_s));
        self.is_down = self.down_since_s.is_some_and(|since_s| t_s - since_s > 1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Times of the orders of an ending from 10 s on, polled for `for_s`, and which are emergency stops; from `asked_s`
    /// on the person has asked once more. Times from the beginning on. s
    fn orders(site: TestSite, for_s: f64, asked_s: f64) -> Vec<(f64, bool)> {
        // All times are sums of powers of two.
        const POLL_S: f64 = 1.0 / 128.0;
        let mut ending = Ending::new(10.0, site, 3);
        let polls = horizon_model::steps(for_s, POLL_S);
        let order = |poll: usize| {
            let t_s = POLL_S * poll as f64;
            let order = ending.advance(10.0 + t_s, if t_s < asked_s { 3 } else { 4 })?;
            Some((t_s, matches!(order, EndingOrder::EmergencyStop)))
        };
        (0..polls).filter_map(order).collect()
    }

    #[test]
    fn in_the_net_a_landing_in_vain_stops_the_motors_after_8_s() {
        let orders = orders(TestSite::Net, 9.25, f64::INFINITY);
        let (landings, late) = orders.split_at(17);
        for (k, order) in landings.iter().enumerate() {
            assert_eq!(*order, (0.5 * k as f64, false));
        }
        assert_eq!(late, [(8.5, true), (8.75, false), (9.0, true)]);
    }

    #[test]
    fn without_propellers_the_motors_stop_at_once_in_turn_with_landings() {
        let orders = orders(TestSite::PropsOff, 1.0, f64::INFINITY);
        assert_eq!(orders, [(0.0, true), (0.25, false), (0.5, true), (0.75, false)]);
    }

    #[test]
    fn a_person_who_asks_once_more_stops_the_motors() {
        let orders = orders(TestSite::Net, 1.25, 0.25);
        assert_eq!(orders, [(0.0, false), (0.5, true), (0.75, false), (1.0, true)]);
    }

    #[test]
    fn an_ending_is_over_after_a_second_down_and_given_up_after_25_s() {
        let mut ending = Ending::new(10.0, TestSite::Net, 0);
        for (t_s, is_over, is_down) in [
            (10.0, true, false),
            (10.9, true, false),
            (11.0, false, false),
            (11.1, true, false),
            (12.0, true, false),
            (12.2, true, true),
            (12.3, false, false),
        ] {
            ending.observe(t_s, is_over);
            assert_eq!(ending.is_down, is_down, "{t_s} s");
        }
        assert_eq!([34.9, 35.0].map(|t_s| ending.is_given_up(t_s)), [false, true]);
    }
}
