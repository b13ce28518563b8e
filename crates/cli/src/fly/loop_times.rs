//! Period and waiting times of the control loop.

use anyhow::Result;
use tello_flight::cycle::{FlightTable, StandingTable};
use tello_io::clock::SpanNs;
use tello_io::config::{self, FlyTable};

/// Longest wait on the ground for poses and for the drone.
pub(super) const GROUND_WAIT: SpanNs = SpanNs::from_ms(10_000);

/// Agreements of the poses that a take-off waits for: an outlier may break the first one. 1
const AGREEMENTS_MAX: f64 = 2.0;

/// Time beside the agreements, for poses that come late. s
const SETTLING_MARGIN_S: f64 = 1.0;

/// Least time that poses have to agree, however short the agreement. s
const SETTLING_MIN_S: f64 = 3.0;

/// Period and waiting times of the control loop.
#[derive(Debug, Clone, Copy)]
pub(super) struct LoopTimes {
    /// Period of the ticks.
    pub(super) period: SpanNs,
    /// Time for the solvers inside a period.
    pub(super) solver_time: SpanNs,
    /// Longest wait on the ground for mocap and drone.
    pub(super) ground_wait: SpanNs,
    /// Longest time until the poses of a standing drone agree.
    pub(super) settling_max: SpanNs,
    /// Longest wait of a tick for its frame.
    pub(super) frame_wait: SpanNs,
}

impl LoopTimes {
    /// The times of a flight.
    ///
    /// # Errors
    /// The wait for a frame is out of its range.
    pub(super) fn of(table: &FlyTable, flight: &FlightTable) -> Result<Self> {
        Ok(Self {
            period: SpanNs::from_seconds(flight.cycle.dt_s),
            solver_time: SpanNs::from_seconds(flight.cycle.deadline_s),
            ground_wait: GROUND_WAIT,
            settling_max: settling_max(&flight.cycle.standing),
            frame_wait: config::frame_wait(table)?,
        })
    }
}

/// Longest time until the poses of a standing drone agree.
fn settling_max(standing: &StandingTable) -> SpanNs {
    let agreements_s = AGREEMENTS_MAX * standing.for_s;
    SpanNs::from_seconds((agreements_s + SETTLING_MARGIN_S).max(SETTLING_MIN_S))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_have_two_agreements_and_a_second_to_settle_and_3_s_at_least() {
        for (for_s, settling_ms) in [(0.5, 3_000), (1.0, 3_000), (1.5, 4_000), (4.0, 9_000)] {
            let standing = StandingTable { for_s, ..StandingTable::default() };
            assert_eq!(settling_max(&standing), SpanNs::from_ms(settling_ms), "{for_s} s");
        }
    }
}
