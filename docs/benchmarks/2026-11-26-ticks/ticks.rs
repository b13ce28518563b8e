//! Lateness of 750 ticks at 50 Hz: `ticks tokio|thread`. Prints median, 95 %, 99 % and the largest in us.

use std::time::{Duration, Instant};

use nix::sys::time::TimeSpec;
use nix::time::{ClockId, ClockNanosleepFlags, clock_gettime, clock_nanosleep};

const PERIOD: Duration = Duration::from_millis(20);
const TICKS: u32 = 750;

/// Lateness of each tick of tokio's interval on its runtime with several threads.
fn tokio_interval() -> Vec<Duration> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_time().build().unwrap();
    let task = runtime.spawn(async {
        let begin = Instant::now() + PERIOD;
        let mut interval = tokio::time::interval_at(begin.into(), PERIOD);
        let mut late = Vec::new();
        for k in 0..TICKS {
            interval.tick().await;
            late.push(begin.elapsed().saturating_sub(k * PERIOD));
        }
        late
    });
    runtime.block_on(task).unwrap()
}

/// Lateness of each tick of a thread that sleeps to absolute deadlines.
fn absolute_deadlines() -> Vec<Duration> {
    let now = || Duration::from(clock_gettime(ClockId::CLOCK_MONOTONIC).unwrap());
    let begin = now() + PERIOD;
    let thread = std::thread::spawn(move || {
        let mut late = Vec::new();
        for k in 0..TICKS {
            let due = begin + k * PERIOD;
            let flags = ClockNanosleepFlags::TIMER_ABSTIME;
            clock_nanosleep(ClockId::CLOCK_MONOTONIC, flags, &TimeSpec::from(due)).unwrap();
            late.push(now().saturating_sub(due));
        }
        late
    });
    thread.join().unwrap()
}

fn main() {
    let is_tokio = std::env::args().nth(1).is_some_and(|kind| kind == "tokio");
    let mut late = if is_tokio { tokio_interval() } else { absolute_deadlines() };
    late.sort();
    let at = |per_mille: usize| late[(late.len() - 1) * per_mille / 1000].as_micros();
    println!("{},{},{},{}", at(500), at(950), at(990), at(1000));
}
