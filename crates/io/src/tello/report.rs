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
    /// Stick packets sent, neutral ones included.
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
            longest_pause_ns: self.longest_pause().0,
        }
    }
}
