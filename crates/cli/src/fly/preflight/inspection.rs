//! Looks at both links, the disk and the scheduler for a moment.

use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

use anyhow::{Result, anyhow};
use tello_io::Stopper;
use tello_io::clock::{Clock, request_real_time};
use tello_io::config::FlyTable;
use tello_io::link_diagnosis::{drone_trouble, mocap_trouble};
use tello_io::log::free_bytes;
use tello_io::mocap::{MocapSettings, survey};
use tello_io::tello::{DroneClient, TelloSettings};
use tokio::time::sleep;

use super::Found;
use crate::fly::signals;
use crate::fly::sources::Sources;
use crate::interrupt;

/// Enough to measure a rate. s
const LOOK_MIN_S: f64 = 1.0;
/// In the text SDK it takes 3 s to find whether the motors run. s
const LOOK_MAX_S: f64 = 5.0;

/// Most names of objects that a line of the list shows.
const NAMES_MAX: usize = 8;

const LOOK_PERIOD: Duration = Duration::from_millis(20);

/// What is there, within a second if all is and five if something is missing; at once if the drone flies. Nothing
/// moves.
///
/// # Errors
/// A port that is taken; settings that break a rule.
pub(super) fn inspect(table: &FlyTable, log_dir: &Path, has_keys: bool) -> Result<Found> {
    let looked = thread::scope(|scope| scope.spawn(|| look_unsignalled(table)).join());
    let mut found = looked.map_err(|_panic| anyhow!("the look at the links panicked"))??;
    found.disk_free = free_bytes(log_dir);
    found.log_dir = log_dir.into();
    let core = table.real_time.core;
    // On a thread of its own, which alone is moved; the memory that stays locked is the flight's, too.
    let asked = thread::spawn(move || request_real_time(core)).join().unwrap_or_default();
    found.refusals = asked.iter().map(ToString::to_string).collect();
    found.has_keys = has_keys;
    Ok(found)
}

/// Looks on a thread of its own, with signals blocked: what still resolves the name of a host is not waited for, and
/// a signal that ends in flight in its thread would end the program.
fn look_unsignalled(table: &FlyTable) -> Result<Found> {
    signals::block()?;
    let runtime = interrupt::runtime()?;
    let found = runtime.block_on(look_at_links(table));
    runtime.shutdown_background();
    found
}

async fn look_at_links(table: &FlyTable) -> Result<Found> {
    let clock = Clock::start();
    let (stopper, stop) = Stopper::new();
    let (sources, mut feed, mut moving_feed) = Sources::new(table, clock)?;
    let settings = TelloSettings::try_from(&table.tello).map_err(|error| error.under("tello"))?;
    // As in a dry run: neither sticks nor orders.
    let (tello, mut drone) = DroneClient::bind(&settings, clock, true)?;
    let (mocap, tello) = (tokio::spawn(sources.run(stop.clone())), tokio::spawn(tello.run(stop)));
    let (mut at, mut moving_at, mut status) = (None, None, None);
    let (mut is_flying, mut is_done) = (false, false);
    while !is_done {
        sleep(LOOK_PERIOD).await;
        while let Ok(sighting) = feed.sightings.pop() {
            at = sighting.pose.or(at);
        }
        while let Some(sighting) = moving_feed.as_mut().and_then(|feed| feed.sightings.pop().ok()) {
            moving_at = sighting.pose.or(moving_at);
        }
        status = drone.poll_status().or(status);
        let looked_s = clock.now().seconds();
        let has_poses = at.is_some() && (moving_feed.is_none() || moving_at.is_some());
        let has_all = has_poses && status.is_some() && feed.counters.report().has_clock;
        is_flying = status.is_some_and(|status| status.is_flying);
        is_done = is_flying || looked_s >= if has_all { LOOK_MIN_S } else { LOOK_MAX_S };
    }
    stopper.stop();
    mocap.await?;
    tello.await??;
    let mut mocap_trouble = mocap_trouble(table, &feed.counters);
    // A drone that flies is landed at once: nobody waits for names.
    if !is_flying && at.is_none() && feed.counters.report().other_object > 0 {
        mocap_trouble += &streamed(table, clock).await?;
    }
    Ok(Found {
        stream: feed.counters.report(),
        announced_hz: feed.counters.announced_hz(),
        mocap_trouble,
        at,
        moving_at,
        drone: status,
        drone_trouble: drone_trouble(table, drone.counters.packets.get()),
        facts: drone.counters.facts(),
        log_dir: PathBuf::new(),
        disk_free: None,
        refusals: Vec::new(),
        has_keys: false,
        device: table.manual.device.clone(),
        unfinished: None,
        is_unasked: false,
    })
}

/// The names that are streamed in place of the drone's, as the end of a sentence.
async fn streamed(table: &FlyTable, clock: Clock) -> Result<String> {
    let settings = MocapSettings::try_from(&table.mocap).map_err(|error| error.under("mocap"))?;
    let look = sleep(Duration::from_secs_f64(LOOK_MIN_S));
    let survey = survey(&settings, clock, look, |_, _| ()).await;
    let names = survey.objects.keys().take(NAMES_MAX).map(|name| format!("{name:?}"));
    let names: Vec<String> = names.collect();
    Ok(if names.is_empty() { String::new() } else { format!(" There are: {}", names.join(", ")) })
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;
    use tello_io::config;

    use super::*;
    use crate::fly::simulator::start_simulator;

    #[test]
    fn poses_and_status_of_what_is_there_are_found() {
        let arguments = crate::Arguments::parse_from(["tello-ctl", "fly", "--sim"]);
        let crate::Command::Fly(arguments) = &arguments.command else { panic!("another command") };
        let (mut table, _) = config::fly(None, None).unwrap();
        let _emulator = start_simulator(arguments, &mut table).unwrap();
        let found = inspect(&table, Path::new("."), true).unwrap();
        assert!(found.at.is_some(), "{}", found.mocap_trouble);
        assert!(found.moving_at.is_none());
        let drone = found.drone.unwrap();
        assert!(drone.is_on_ground && !drone.is_flying, "{drone:?}");
        assert!(found.stream.frames > 30, "{:?}", found.stream);
        assert!(found.has_keys && found.disk_free.is_some());
        let name = format!("{:?}", table.mocap.object());
        table.mocap = table.mocap.of_object("another");
        let found = inspect(&table, Path::new("."), true).unwrap();
        let text = found.mocap_trouble;
        assert!(found.at.is_none() && text.ends_with(&format!(" There are: {name}")), "{text}");
    }
}
