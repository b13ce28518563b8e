//! Newest facts of a flight for its viewers, made by the log's thread; a newer one replaces one that was not read.

use std::sync::Arc;

use horizon_model::setting::SettingError;
use tello_eval::flight_log::TickRecord;
use tello_eval::telemetry::{FlightHeader, Telemetry, TelemetryBuilder};
use tello_flight::cycle::FlightTable;
use tello_io::mocap::StreamReport;
use tokio::sync::watch;

/// Sends the facts of a flight.
#[derive(Debug)]
pub(super) struct Live {
    builder: TelemetryBuilder,
    facts: watch::Sender<Arc<Telemetry>>,
}

/// A viewer's end of the facts.
pub(super) type Watched = watch::Receiver<Arc<Telemetry>>;

impl Live {
    /// Builds the telemetry of `flight`; what stays the same in it, and where to watch. The facts end with the flight:
    /// their sender is dropped then.
    ///
    /// # Errors
    /// The mission or a dead time breaks its rule.
    pub(super) fn new(flight: &FlightTable) -> Result<(Self, FlightHeader, Watched), SettingError> {
        let (builder, briefing) = TelemetryBuilder::new(flight)?;
        let (facts, watched) = watch::channel(Arc::default());
        Ok((Self { builder, facts }, briefing, watched))
    }

    /// From now on nothing is recorded.
    pub(super) fn note_failed_log(&mut self) {
        self.builder.note_failed_log();
    }

    /// Takes note of a tick; called for every one. `mocap` gives the state of the stream.
    pub(super) fn observe(&mut self, tick: &TickRecord, mocap: impl FnOnce() -> StreamReport) {
        if let Some(facts) = self.builder.observe(tick, mocap) {
            self.facts.send_replace(Arc::new(facts));
        }
    }
}
