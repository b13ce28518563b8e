//! Time: monotonic stamps, the wall-clock start of a log, and the ticker of the loop.
//!
//! The only place of the project, but for benchmarks, that reads a clock. Code that needs a time gets a
//! [`TimeNs`] as an argument or a [`Clock`] to ask; decisions are made on stamps, never on a clock.

mod civil;
mod frame_arrival;
mod phase;
mod real_time;
mod ticker;

use std::time::SystemTime;

use nix::time::{ClockId, clock_gettime};

pub use civil::{CivilTime, TimeOfDay};
pub use frame_arrival::Arrival;
pub use real_time::{RealTimeWarning, Role, request_priority, request_real_time};
pub use tello_flight::time::{SpanNs, TimeNs};
pub use ticker::{Beat, Ticker, TickerError};

use tello_flight::time::NS_PER_S;

/// It goes on while the machine is suspended, where `CLOCK_MONOTONIC` stands still: after a laptop was closed
/// in flight, the ages of poses and reports are what they are.
const CLOCK: ClockId = ClockId::CLOCK_BOOTTIME;

/// Handle to the monotonic clock, copied to all that stamp. Time during which the machine was suspended
/// counts.
#[derive(Debug, Clone, Copy)]
pub struct Clock {
    /// [`CLOCK`] at time zero. ns
    start_ns: i64,
    utc_start_ns: i64,
}

impl Clock {
    /// A clock whose time zero is now.
    #[expect(clippy::disallowed_methods, reason = "the one clock")]
    pub fn start() -> Self {
        let utc_start_ns = SystemTime::now()
            .duration_since(SystemTime::UNIX_EPOCH)
            .map_or(0, |since| i64::try_from(since.as_nanos()).unwrap_or(i64::MAX));
        Self { start_ns: clock_ns(), utc_start_ns }
    }

    /// ns since the start of the clock, monotonic. Real time: one system call.
    pub fn now(&self) -> TimeNs {
        TimeNs(clock_ns().saturating_sub(self.start_ns))
    }

    /// Wall clock at time zero. ns since 1970-01-01 UTC; 0 on a machine set to before that.
    pub fn utc_start_ns(&self) -> i64 {
        self.utc_start_ns
    }
}

/// [`CLOCK`] now. ns
fn clock_ns() -> i64 {
    // The system refuses a clock that it does not have, and Linux has had this one since 2.6.39.
    let read = clock_gettime(CLOCK);
    read.map_or(0, |at| at.tv_sec().saturating_mul(NS_PER_S).saturating_add(at.tv_nsec()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_starts_at_zero_and_goes_forward() {
        let clock = Clock::start();
        let first = clock.now();
        let second = clock.now();
        assert!(TimeNs(0) <= first && first <= second, "{first:?}, {second:?}");
        // 2020-01-01: any machine this runs on is set to later.
        assert!(clock.utc_start_ns() > 1_577_836_800 * NS_PER_S, "{}", clock.utc_start_ns());
    }

    /// On a machine that was never suspended both clocks show the same.
    #[test]
    fn the_clock_is_the_one_that_counts_a_suspended_machine() {
        assert_eq!(CLOCK, ClockId::CLOCK_BOOTTIME);
        assert!(clock_ns() > 0);
    }
}
