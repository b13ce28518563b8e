//! What is read of the motion capture: the vehicle, and the obstacle that moves if there is one.

use horizon_model::setting::SettingError;
use tello_io::StopSignal;
use tello_io::clock::Clock;
use tello_io::config::{self, FlyTable};
use tello_io::mocap::{MocapClient, MocapFeed};

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
