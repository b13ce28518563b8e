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
