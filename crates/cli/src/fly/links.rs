//! The links of a flight before its threads run: motion capture, drone and guardian.

use std::sync::Arc;

use anyhow::Result;
use tello_io::clock::Clock;
use tello_io::config::FlyTable;
use tello_io::mocap::{MocapCounters, MocapFeed};
use tello_io::tello::{DroneClient, DroneLink, LinkCounters, TelloSettings};

use super::Arguments;
use super::guardian::Guardian;
use super::sources::Sources;

/// The links. If the flight does not begin, they are dropped in the order of the fields: the guardian first.
pub(super) struct Links {
    /// None in a dry run.
    pub(super) guardian: Option<Guardian>,
    /// The control thread's end of the link to the drone.
    pub(super) drone: DroneLink,
    /// The sender's end of the link to the drone.
    pub(super) tello: DroneClient,
    /// Places of the obstacle that moves, if one does.
    pub(super) moving_feed: Option<MocapFeed>,
    /// Poses of the vehicle.
    pub(super) feed: MocapFeed,
    /// The connections of both feeds.
    pub(super) sources: Sources,
}

/// Counters of the links, for the summary and for messages.
pub(super) struct Counters {
    pub(super) mocap: Arc<MocapCounters>,
    pub(super) drone: Arc<LinkCounters>,
}

impl Links {
    /// Binds the sockets of the drone and starts the guardian. The motion capture is not yet connected.
    ///
    /// # Errors
    /// A value that breaks its rule, a port that is taken, or a guardian that does not start.
    pub(super) fn open(arguments: &Arguments, table: &FlyTable, clock: Clock) -> Result<Self> {
        let (sources, feed, moving_feed) = Sources::new(table, clock)?;
        let settings =
            TelloSettings::try_from(&table.tello).map_err(|error| error.under("tello"))?;
        let (mut tello, drone) = DroneClient::bind(&settings, clock, arguments.dry_run)?;
        let guardian =
            if arguments.dry_run { None } else { Some(tello.start_guardian(Guardian::spawn)?) };
        Ok(Self { guardian, drone, tello, moving_feed, feed, sources })
    }

    /// The counters, which outlive the links.
    pub(super) fn counters(&self) -> Counters {
        Counters { mocap: Arc::clone(&self.feed.counters), drone: Arc::clone(&self.drone.counters) }
    }
}
