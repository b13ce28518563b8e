//! How the link to the drone did, as a record of the log.

use schemars::JsonSchema;
use serde::Serialize;

use super::LinkCounters;

/// Counts of [`LinkCounters`] since the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, JsonSchema)]
pub struct LinkReport {
    /// Whether the drone was heard in the last 2 s.
    pub is_connected: bool,
    /// Correct packets of the drone.
    pub packets: u64,
    /// Stick packets sent; not the neutral ones of an ending.
    pub sticks: u64,
    /// Stick packets made neutral because the control thread was silent.
    pub neutralised: u64,
    /// Landings begun because the control thread was silent.
    pub watchdog_landings: u64,
    /// Landings that the guardian began, or may have begun, because this program stood still.
    pub guardian_landings: u64,
    /// Guardians that ended before this program, or did not answer.
    pub guardians_lost: u64,
    /// Orders sent, repeated landings included.
    pub orders: u64,
    /// Acknowledgements of the newest order.
    pub acks: u64,
    /// Commands that the drone refused in words.
    pub refusals: u64,
    /// Datagrams that the socket did not take or could not read.
    pub socket_errors: u64,
    /// Datagrams of the drone that are no packet.
    pub malformed: u64,
    /// Statuses that found no room.
    pub overflow: u64,
    /// Longest time between two turns of the sender in flight. ns
    pub longest_pause_ns: i64,
}

impl LinkReport {
    /// Whether something was sent in place of what the control thread wants that `earlier` does not have.
    pub fn has_intervened_since(&self, earlier: &Self) -> bool {
        let of = |report: &Self| {
            [
                report.neutralised,
                report.watchdog_landings,
                report.guardian_landings,
                report.guardians_lost,
            ]
        };
        of(self) != of(earlier)
    }
}

impl LinkCounters {
    /// The counts up to now.
    pub fn report(&self) -> LinkReport {
        LinkReport {
            is_connected: self.is_connected(),
            packets: self.packets.get(),
            sticks: self.sticks.get(),
            neutralised: self.neutralised.get(),
            watchdog_landings: self.watchdog_landings.get(),
            guardian_landings: self.guardian_landings.get(),
            guardians_lost: self.guardians_lost.get(),
            orders: self.orders.get(),
            acks: self.acks.get(),
            refusals: self.refusals.get(),
            socket_errors: self.socket_errors.get(),
            malformed: self.malformed.get(),
            overflow: self.overflow.get(),
            longest_pause_ns: self.longest_pause().0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_sent_in_place_of_the_control_thread_is_an_intervention_and_nothing_else() {
        let before = LinkReport { neutralised: 3, guardians_lost: 1, ..LinkReport::default() };
        for now in [
            LinkReport { neutralised: 4, ..before },
            LinkReport { watchdog_landings: 1, ..before },
            LinkReport { guardian_landings: 1, ..before },
            LinkReport { guardians_lost: 2, ..before },
        ] {
            assert!(now.has_intervened_since(&before), "{now:?}");
        }
        let other = LinkReport {
            is_connected: true,
            packets: 9,
            sticks: 9,
            orders: 9,
            refusals: 9,
            ..before
        };
        assert!(!before.has_intervened_since(&before) && !other.has_intervened_since(&before));
    }

    #[test]
    fn each_count_is_reported_under_its_own_name() {
        let counters = LinkCounters::default();
        let all = [
            &counters.packets,
            &counters.sticks,
            &counters.neutralised,
            &counters.watchdog_landings,
            &counters.guardian_landings,
            &counters.guardians_lost,
            &counters.orders,
            &counters.acks,
            &counters.refusals,
            &counters.socket_errors,
            &counters.malformed,
            &counters.overflow,
        ];
        for (counter, value) in all.into_iter().zip(1..) {
            counter.add(value);
        }
        let expected = LinkReport {
            is_connected: false,
            packets: 1,
            sticks: 2,
            neutralised: 3,
            watchdog_landings: 4,
            guardian_landings: 5,
            guardians_lost: 6,
            orders: 7,
            acks: 8,
            refusals: 9,
            socket_errors: 10,
            malformed: 11,
            overflow: 12,
            longest_pause_ns: 0,
        };
        assert_eq!(counters.report(), expected);
    }
}
