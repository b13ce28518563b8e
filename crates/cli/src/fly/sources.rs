//! What is read of the motion capture: the vehicle, and the obstacle that moves if there is one.
//!
//! Owns the thread that it is read on, apart from the one of the drone's sockets: a source that floods must not hold up
//! the link.

use std::io;
use std::thread::{self, JoinHandle};

use horizon_model::setting::SettingError;
use tello_io::StopSignal;
use tello_io::clock::{Clock, Role, request_priority};
use tello_io::config::{self, FlyTable};
use tello_io::mocap::{MocapClient, MocapFeed};

use crate::interrupt;

/// Its connections, not yet opened.
pub(super) struct Sources {
    vehicle: MocapClient,
    moving: Option<MocapClient>,
}

impl Sources {
    /// Those of the settings, with the poses of the vehicle and of the obstacle.
    ///
    /// # Errors
    /// A value that breaks its rule.
    pub(super) fn new(
        table: &FlyTable,
        clock: Clock,
    ) -> Result<(Self, MocapFeed, Option<MocapFeed>), SettingError> {
        let (vehicle, feed) = MocapClient::new(config::mocap(table)?, clock);
        let moving = config::moving_object(table)?;
        let (moving, moving_feed) =
            moving.map(|settings| MocapClient::new(settings, clock)).unzip();
        Ok((Self { vehicle, moving }, feed, moving_feed))
    }

    /// Starts the thread, which reads until it is stopped.
    ///
    /// # Errors
    /// No thread, or nothing to wait for sockets with.
    pub(super) fn start(self, stop: StopSignal) -> io::Result<JoinHandle<()>> {
        let runtime = interrupt::runtime()?;
        thread::Builder::new().name("tello-mocap".into()).spawn(move || {
            // The control thread reports a refusal.
            request_priority(Role::Mocap).ok();
            runtime.block_on(self.run(stop));
            // Without waiting for the address of a host that is not found.
            runtime.shutdown_background();
        })
    }

    /// Reads until it is stopped.
    pub(super) async fn run(self, stop: StopSignal) {
        let Self { vehicle, moving } = self;
        let moving_stop = stop.clone();
        let read_moving = async {
            if let Some(moving) = moving {
                moving.run(moving_stop).await;
            }
        };
        tokio::join!(vehicle.run(stop), read_moving);
    }
}

#[cfg(test)]
mod tests {
    use tello_flight::ObstacleTable;
    use tello_io::Stopper;

    use super::*;

    /// The built-in settings, perhaps with an obstacle that moves and the object that it follows.
    fn table(has_obstacle: bool, object: Option<&str>) -> FlyTable {
        let (mut table, _) = config::fly(None, None).unwrap();
        if has_obstacle {
            table.cycle.obstacles.push(ObstacleTable::Moving { radius_m: 0.3 });
        }
        table.moving_object = object.map(str::to_owned);
        table
    }

    #[test]
    fn the_obstacle_has_a_source_of_its_own_exactly_if_it_moves() {
        for (table, has_moving) in
            [(table(false, None), false), (table(true, Some("person")), true)]
        {
            let (sources, _, moving) = Sources::new(&table, Clock::start()).unwrap();
            assert_eq!((sources.moving.is_some(), moving.is_some()), (has_moving, has_moving));
        }
        for table in [table(true, None), table(false, Some("person"))] {
            let refused = Sources::new(&table, Clock::start()).map(drop).unwrap_err();
            assert_eq!(refused.key, "moving_object");
        }
    }

    #[test]
    fn both_connections_end_when_they_are_stopped() {
        let (sources, ..) = Sources::new(&table(true, Some("person")), Clock::start()).unwrap();
        let (stopper, stop) = Stopper::new();
        stopper.stop();
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(sources.run(stop));
    }
}
