//! What becomes of the ticks of a flight: the log, its scene, the tally of the summary, facts for viewers.
//!
//! Owns what the log's thread does with a record; how records get there is `io::log::Recorder`.

use std::sync::Arc;
use std::time::Duration;

use anyhow::Result;
use parking_lot::Mutex;
use tello_eval::flight_log::{self, Origin, TickRecord};
use tello_eval::flight_summary::Tally;
use tello_eval::scene::Scene;
use tello_flight::cycle::{FlightTable, Outcome, Tick, Topic};
use tello_io::clock::{CivilTime, Clock};
use tello_io::config::FlyTable;
use tello_io::log::{LogWriter, Recorder};
use tello_io::mocap::MocapCounters;
use tello_io::tello::{LinkCounters, LinkReport};

use super::Arguments;
#[cfg(feature = "live")]
use super::foxglove_server;
use super::live::Live;
#[cfg(feature = "ros2")]
use super::ros2_publisher;
use super::vehicle::is_on_this_machine;
use crate::stdio;

/// Records in transit between control thread and logger: five seconds at 50 Hz.
const RECORDS: usize = 250;

/// How often the log reaches the disk.
const FLUSH_PERIOD: Duration = Duration::from_secs(1);

/// Ticks between two records of the links: a second at 50 Hz.
const STREAM_EVERY_TICKS: u64 = 50;

/// Receivers of a record beside the log.
pub(super) struct Notes {
    pub(super) tally: Arc<Mutex<Tally>>,
    /// For viewers, if there shall be any.
    pub(super) live: Option<Live>,
    pub(super) mocap: Arc<MocapCounters>,
    pub(super) drone: Arc<LinkCounters>,
}

/// Starts the thread, with the log that the arguments and settings name.
///
/// # Errors
/// The log cannot be created; the mission breaks its rules; there is no thread left.
pub(super) fn start(
    arguments: &Arguments,
    table: &FlyTable,
    flight: &FlightTable,
    clock: Clock,
    cycle: &dyn Tick,
    notes: Notes,
) -> Result<Recorder<TickRecord>> {
    let shape = cycle.new_outcome();
    let log = open(arguments, table, flight, clock, &shape)?;
    let pool = (0..RECORDS).map(|_| TickRecord::with_buffers(&shape)).collect();
    let Notes { tally, mut live, mocap, drone } = notes;
    let mut link = WrittenLink(drone.report());
    let mut scene = Scene::new(flight, started_unix_ns(clock))?;
    let mut has_failed = false;
    Ok(Recorder::start(log, pool, FLUSH_PERIOD, move |log, tick| {
        if log.is_none() && !std::mem::replace(&mut has_failed, true) {
            stdio::note(
                "the log has failed: the flight goes on, nothing of it is recorded from here on",
            );
            live.iter_mut().for_each(Live::note_failed_log);
        }
        if let Some(live) = &mut live {
            live.observe(tick, || mocap.report());
        }
        // Free again before the disk is waited for.
        let jitter = {
            let mut tally = tally.lock();
            tally.add(tick);
            tally.jitter_due().copied()
        };
        let Some(log) = log else { return Ok(()) };
        let (now, is_due) = (tick.inbox.now, tick.inbox.step.is_multiple_of(STREAM_EVERY_TICKS));
        if is_due {
            log.write(flight_log::STREAM, now, &mocap.report())?;
        }
        let newest = drone.report();
        if link.takes(&newest, is_due) {
            log.write(flight_log::LINK, now, &newest)?;
        }
        flight_log::write_tick(log, tick)?;
        if let Some(jitter) = jitter {
            log.write(Topic::Jitter.name(), now, &jitter)?;
        }
        scene.write(log, tick)
    })?)
}

/// The record of the link with the drone that was written last, or with which the log began.
struct WrittenLink(LinkReport);

impl WrittenLink {
    /// Whether `newest` is written next: when it `is_due`, or something was sent in place of what the control thread
    /// wants.
    fn takes(&mut self, newest: &LinkReport, is_due: bool) -> bool {
        let is_written = is_due || newest.has_intervened_since(&self.0);
        if is_written {
            self.0 = *newest;
        }
        is_written
    }
}

/// The log of the flight, which goes to viewers as well if they were asked for.
fn open(
    arguments: &Arguments,
    table: &FlyTable,
    flight: &FlightTable,
    clock: Clock,
    shape: &Outcome,
) -> Result<LogWriter> {
    let path = match &arguments.log {
        Some(path) => path.clone(),
        None => flight_log::free_path(
            &table.log.dir,
            &CivilTime::from_unix_ns(clock.utc_start_ns()).to_string(),
        )?,
    };
    let origin = if is_on_this_machine(table) { Origin::Simulated } else { Origin::Flown };
    #[cfg_attr(
        not(any(feature = "live", feature = "ros2")),
        expect(unused_mut, reason = "this build has no viewer to add")
    )]
    let mut log = flight_log::create_of(origin, &path, flight, started_unix_ns(clock), shape)?;
    #[cfg(feature = "live")]
    foxglove_server::show_at(arguments.foxglove, &mut log, &flight_log::channels(shape));
    #[cfg(feature = "ros2")]
    if arguments.ros2 {
        ros2_publisher::publish(arguments.network, &mut log);
    }
    Ok(log)
}

/// When the clock showed zero. ns since 1970-01-01 UTC
fn started_unix_ns(clock: Clock) -> u64 {
    u64::try_from(clock.utc_start_ns()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_is_written_when_it_is_due_and_once_after_each_intervention() {
        let before = LinkReport::default();
        let sent = LinkReport { packets: 9, ..before };
        let neutralised = LinkReport { neutralised: 1, ..sent };
        let landed = LinkReport { watchdog_landings: 1, ..neutralised };
        let mut written = WrittenLink(before);
        for (newest, is_due, is_written) in [
            (sent, false, false),
            (sent, true, true),
            (neutralised, false, true),
            (neutralised, false, false),
            (landed, true, true),
            (landed, false, false),
        ] {
            assert_eq!(written.takes(&newest, is_due), is_written, "{newest:?}, due: {is_due}");
        }
    }
}
