//! The beat of the control thread: absolute deadlines, lateness reported, missed periods skipped, in phase with
//! the frames of the mocap source.
//!
//! tokio's timer wheel is 1 ms coarse and its ticks come late under load; those of a thread with a real-time
//! priority that sleeps to absolute deadlines do not (`docs/benchmarks/2026-11-26-ticks/README.md`).

use std::sync::Arc;

use nix::errno::Errno;
use nix::sys::time::TimeSpec;
use nix::time::{ClockNanosleepFlags, clock_nanosleep};
use thiserror::Error;

use tello_flight::Sighting;

use super::phase::FramePhase;
use super::{Arrival, CLOCK, Clock, NS_PER_S, SpanNs, TimeNs};

/// The operating system refuses to sleep.
#[derive(Debug, Error)]
#[error("cannot sleep on the monotonic clock: {0}")]
pub struct TickerError(#[from] Errno);

/// One tick of a [`Ticker`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Beat {
    /// When the tick was due: at its place in the grid, or when its wait for a frame ended.
    pub due: TimeNs,
    /// How much later it came.
    pub lateness: SpanNs,
    /// Periods before this one that passed entirely without a tick.
    pub skipped: u64,
}

/// Wakes its thread once per period.
#[derive(Debug)]
pub struct Ticker {
    clock: Clock,
    schedule: Schedule,
    frames: Option<Frames>,
}

/// The frames that the ticks wait for.
#[derive(Debug)]
struct Frames {
    arrival: Arc<Arrival>,
    phase: FramePhase,
    /// Place of the present tick in the grid.
    due: TimeNs,
}

impl Ticker {
    /// A ticker whose first tick is due now.
    pub fn new(clock: Clock, period: SpanNs) -> Self {
        Self { clock, schedule: Schedule::new(clock.now(), period), frames: None }
    }

    /// A ticker whose ticks begin with the frames of `arrival` where these keep pace with it. A tick
    /// waits `wait` for its frame at most; its grid moves by at most 0.5 ms a period.
    #[must_use]
    pub fn with_frames(self, arrival: Arc<Arrival>, wait: SpanNs) -> Self {
        if wait <= SpanNs(0) {
            return self;
        }
        let phase = FramePhase::new(SpanNs(self.schedule.period_ns), wait);
        Self { frames: Some(Frames { arrival, phase, due: self.schedule.next }), ..self }
    }

    /// Sleeps until the next tick that is not yet missed.
    ///
    /// A tick that is less than one period late comes at once. Periods that have passed are counted and not made up
    /// for. No allocation, but for the first wait for a frame.
    ///
    /// # Errors
    /// The operating system refuses to sleep.
    pub fn wait(&mut self) -> Result<Beat, TickerError> {
        let (due, skipped) = self.schedule.advance(self.clock.now());
        let due_ns = self.clock.start_ns.saturating_add(due.0);
        let wake = TimeSpec::new(due_ns.div_euclid(NS_PER_S), due_ns.rem_euclid(NS_PER_S));
        loop {
            let flags = ClockNanosleepFlags::TIMER_ABSTIME;
            match clock_nanosleep(CLOCK, flags, &wake) {
                // A signal ends the sleep early; the deadline is absolute, so sleep again.
                Err(Errno::EINTR) => {}
                Err(errno) => return Err(errno.into()),
                Ok(_) => break,
            }
        }
        let due = self.frames.as_mut().map_or(due, |frames| frames.wait(self.clock, due));
        Ok(Beat { due, lateness: self.clock.now().since(due), skipped })
    }

    /// Moves the next tick towards the frames, by those that arrived since the tick before: by 0.5 ms at most. Does
    /// nothing without [`with_frames`](Self::with_frames).
    ///
    /// Real time: no allocation, one pass over `sightings`.
    pub fn follow(&mut self, sightings: &[Sighting]) {
        if let Some(Frames { phase, due, .. }) = &mut self.frames {
            self.schedule.next = self.schedule.next.after(phase.correction(*due, sightings));
        }
    }
}

impl Frames {
    /// Waits for the frame of the tick that is due at `due`; when that wait ended, `due` at the earliest.
    fn wait(&mut self, clock: Clock, due: TimeNs) -> TimeNs {
        self.due = due;
        let Some((from, until)) = self.phase.window(due) else { return due };
        self.arrival.wait(clock, from, until).unwrap_or(until).max(due)
    }
}

/// Which tick is next: the part of a ticker that needs no clock.
#[derive(Debug)]
struct Schedule {
    next: TimeNs,
    /// ns, at least 1
    period_ns: i64,
}

impl Schedule {
    fn new(first: TimeNs, period: SpanNs) -> Self {
        Self { next: first, period_ns: period.0.max(1) }
    }

    /// The tick to wait for at `now`, and the number of whole periods given up before it.
    fn advance(&mut self, now: TimeNs) -> (TimeNs, u64) {
        let missed = now.since(self.next).0.max(0) / self.period_ns;
        let due = self.next.after(SpanNs(missed * self.period_ns));
        self.next = due.after(SpanNs(self.period_ns));
        (due, missed.unsigned_abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: SpanNs = SpanNs::from_ms(20);

    fn ms(ms: i64) -> TimeNs {
        TimeNs(0).after(SpanNs::from_ms(ms))
    }

    #[test]
    fn ticks_in_time_are_one_period_apart() {
        let mut schedule = Schedule::new(ms(0), PERIOD);
        for k in 0..5 {
            assert_eq!(schedule.advance(ms(20 * k - 7)), (ms(20 * k), 0));
        }
    }

    #[test]
    fn a_late_tick_does_not_shift_the_grid() {
        let mut schedule = Schedule::new(ms(0), PERIOD);
        assert_eq!(schedule.advance(ms(0)), (ms(0), 0));
        assert_eq!(schedule.advance(ms(39)), (ms(20), 0), "late by less than a period: at once");
        assert_eq!(schedule.advance(ms(39)), (ms(40), 0));
    }

    #[test]
    fn missed_periods_are_skipped_and_counted() {
        let mut schedule = Schedule::new(ms(0), PERIOD);
        assert_eq!(schedule.advance(ms(0)), (ms(0), 0));
        assert_eq!(schedule.advance(ms(40)), (ms(40), 1), "20 is gone for a whole period");
        assert_eq!(schedule.advance(ms(139)), (ms(120), 3), "60, 80 and 100 are gone");
        assert_eq!(schedule.advance(ms(140)), (ms(140), 0), "no burst afterwards");
    }

    #[test]
    fn a_ticker_sleeps_until_its_deadlines() {
        let clock = Clock::start();
        let mut ticker = Ticker::new(clock, SpanNs::from_ms(5));
        let first = ticker.wait().unwrap();
        for k in 1..=4 {
            let beat = ticker.wait().unwrap();
            let whole_periods = beat.due.since(first.due).0 % SpanNs::from_ms(5).0;
            assert_eq!(whole_periods, 0, "tick {k} is off the grid: {beat:?}");
            assert!(beat.lateness >= SpanNs(0), "woken early: {beat:?}");
        }
    }

    /// How many do depends on the machine; without the frames none would.
    #[test]
    fn ticks_begin_when_their_frames_arrive() {
        const PERIOD: SpanNs = SpanNs::from_ms(5);
        let clock = Clock::start();
        let arrival = Arc::new(Arrival::new());
        let mut ticker =
            Ticker::new(clock, PERIOD).with_frames(Arc::clone(&arrival), SpanNs::from_ms(1));
        let (send, received) = std::sync::mpsc::channel();
        let source = std::thread::spawn(move || {
            let mut frames = Ticker::new(clock, PERIOD);
            for frame in 0..600 {
                let Ok(_) = frames.wait() else { return };
                let received_at = clock.now();
                let sighting =
                    Sighting { frame, measured_at: received_at, received_at, pose: None };
                send.send(sighting).ok();
                arrival.note(received_at);
            }
        });
        let mut with_frame = 0;
        while !source.is_finished() {
            let beat = ticker.wait().unwrap();
            let sightings: Vec<Sighting> = received.try_iter().collect();
            with_frame += u32::from(sightings.iter().any(|frame| frame.received_at == beat.due));
            ticker.follow(&sightings);
        }
        source.join().unwrap();
        // Equal to the nanosecond, so never by chance. How many are depends on the load of the machine.
        assert!(with_frame > 0, "no tick began with a frame");
    }

    /// To the ticker a suspended machine is a clock that has jumped ahead while it slept.
    #[test]
    fn an_hour_of_suspension_is_missed_ticks_and_no_burst() {
        let mut ticker = Ticker::new(Clock::start(), PERIOD);
        ticker.wait().unwrap();
        let hour = SpanNs::from_ms(3_600_000);
        ticker.clock.start_ns -= hour.0;
        let beat = ticker.wait().unwrap();
        assert!(beat.skipped >= 179_999, "{beat:?}");
        assert!(beat.lateness < PERIOD, "{beat:?}");
        assert_eq!(ticker.wait().unwrap().skipped, 0);
    }
}
