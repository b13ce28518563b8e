//! The socket of the relay: connect, read, connect again.
//!
//! Owns the connection and the queue to the control thread. A lost server is not an error here: the
//! sightings stop, and whoever drains the queue sees their age.

use std::sync::Arc;
use std::time::Duration;

use rtrb::{Consumer, Producer, RingBuffer};
use tokio::io::AsyncReadExt;
use tokio::net::TcpStream;
use tokio::time::{sleep, timeout};

use super::{RelayStream, Sighting, ViconCounters, ViconSettings};
use crate::Stop;
use crate::clock::Clock;

/// Room for 1.28 s at 100 Hz; the control thread drains it every 20 ms.
const QUEUE_SIGHTINGS: usize = 128;

/// A kernel gives up a connect after two minutes; a flight cannot wait for that.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(2);

/// A server that is silent for so long is connected anew: a host that vanished sends no end.
const SILENCE_TIMEOUT: Duration = Duration::from_secs(5);

const BACK_OFF_MIN: Duration = Duration::from_millis(100);
const BACK_OFF_MAX: Duration = Duration::from_secs(2);

const CHUNK_BYTES: usize = 4096;

/// What the control thread holds of the mocap link.
#[derive(Debug)]
pub struct ViconFeed {
    /// New sightings, oldest first. Never blocks.
    pub sightings: Consumer<Sighting>,
    /// Counts of the task that fills the queue.
    pub counters: Arc<ViconCounters>,
}

/// The task that reads the relay.
#[derive(Debug)]
pub struct ViconClient {
    settings: ViconSettings,
    clock: Clock,
    sightings: Producer<Sighting>,
    counters: Arc<ViconCounters>,
}

impl ViconClient {
    /// A client that is not yet connected, and the far end of its queue.
    pub fn new(settings: ViconSettings, clock: Clock) -> (Self, ViconFeed) {
        let (producer, consumer) = RingBuffer::new(QUEUE_SIGHTINGS);
        let counters = Arc::new(ViconCounters::default());
        let feed = ViconFeed { sightings: consumer, counters: Arc::clone(&counters) };
        (Self { settings, clock, sightings: producer, counters }, feed)
    }

    /// Connects and reads until it is stopped.
    ///
    /// After a failed or lost connection it waits 0.1 s, then twice as long each time up to 2 s;
    /// received bytes bring the wait back to 0.1 s.
    pub async fn run(mut self, mut stop: Stop) {
        tokio::select! {
            () = stop.ordered() => {}
            () = self.read_forever() => {}
        }
    }

    async fn read_forever(&mut self) {
        let mut stream = RelayStream::new(&self.settings.object);
        let mut back_off = BACK_OFF_MIN;
        loop {
            let connect = TcpStream::connect(self.settings.address.as_str());
            if let Ok(Ok(socket)) = timeout(CONNECT_TIMEOUT, connect).await {
                self.counters.connects.count();
                stream.restart();
                if self.read_connection(socket, &mut stream).await {
                    back_off = BACK_OFF_MIN;
                }
            }
            sleep(back_off).await;
            back_off = (2 * back_off).min(BACK_OFF_MAX);
        }
    }

    /// Reads until the connection ends; whether anything was received.
    async fn read_connection(&mut self, mut socket: TcpStream, stream: &mut RelayStream) -> bool {
        let mut chunk = [0; CHUNK_BYTES];
        let mut has_received = false;
        // Zero bytes are the end of the stream, as final as an error or silence.
        while let Ok(Ok(count @ 1..)) = timeout(SILENCE_TIMEOUT, socket.read(&mut chunk)).await {
            has_received = true;
            let received_at = self.clock.now();
            let bytes = chunk.get(..count).unwrap_or_default();
            stream.push(bytes, received_at, &self.counters, |sighting| {
                if self.sightings.push(sighting).is_err() {
                    self.counters.overflow.count();
                }
            });
        }
        has_received
    }
}
