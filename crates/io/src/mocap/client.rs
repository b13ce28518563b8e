//! The sockets of the mocap sources: connect or listen, read, connect again.
//!
//! Owns the connection and the queue to the control thread. A lost server is not an error here: the
//! sightings stop, and the reader of the queue sees their age.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use rtrb::{Consumer, Producer, RingBuffer};
use tokio::time::{sleep, timeout};

use super::wire::{CHUNK_BYTES, Connector, Wire};
use super::{MocapCounters, MocapSettings, MocapStream, Refusal, Sighting, SourceError};
use crate::StopSignal;
use crate::clock::{Arrival, Clock, TimeNs};

/// Room for 1.28 s at 500 Hz; the control thread drains it every 20 ms.
const QUEUE_SIGHTINGS: usize = 640;

/// A server that completes no message for so long is connected anew: a host that vanished sends no
/// end, and one that trickles never gets anywhere.
const SILENCE_TIMEOUT: Duration = Duration::from_secs(5);

/// A connection that had frames, and whose next message is still incomplete after bytes for so long, is made anew: a
/// damaged length makes the reader wait for what is no message. Short enough for `failsafe.lost_s`; a message of
/// 1 MB takes less on any network that carries 50 frames per second.
const INCOMPLETE_TIMEOUT: Duration = Duration::from_millis(500);

/// A pause in the bytes from which on the network itself was interrupted: the time for an incomplete message then
/// starts anew.
const PAUSE_MIN: Duration = Duration::from_millis(200);

const BACK_OFF_MIN: Duration = Duration::from_millis(100);
const BACK_OFF_MAX: Duration = Duration::from_secs(2);

/// Receiving end of the mocap link, for the control thread.
#[derive(Debug)]
pub struct MocapFeed {
    /// New sightings, oldest first. Never blocks.
    pub sightings: Consumer<Sighting>,
    /// When the newest of them arrived.
    pub arrival: Arc<Arrival>,
    /// Counts of the task that fills the queue.
    pub counters: Arc<MocapCounters>,
    /// Set by the control loop while the vehicle may be in the air: the source's clock is learned on the
    /// ground only. At first it is not.
    pub airborne: Arc<AtomicBool>,
}

/// The task that reads the source.
#[derive(Debug)]
pub struct MocapClient {
    settings: MocapSettings,
    clock: Clock,
    sightings: Producer<Sighting>,
    arrival: Arc<Arrival>,
    counters: Arc<MocapCounters>,
    airborne: Arc<AtomicBool>,
}

impl MocapClient {
    /// A client that is not yet connected, and the receiver of its sightings.
    ///
    /// The queue between them holds `QUEUE_SIGHTINGS`; a sighting that finds it full is dropped and counted.
    /// Allocates the queue.
    pub fn new(settings: MocapSettings, clock: Clock) -> (Self, MocapFeed) {
        let (producer, consumer) = RingBuffer::new(QUEUE_SIGHTINGS);
        let counters = Arc::new(MocapCounters::default());
        let airborne = Arc::new(AtomicBool::new(false));
        let arrival = Arc::new(Arrival::new());
        let feed = MocapFeed {
            sightings: consumer,
            arrival: Arc::clone(&arrival),
            counters: Arc::clone(&counters),
            airborne: Arc::clone(&airborne),
        };
        (Self { settings, clock, sightings: producer, arrival, counters, airborne }, feed)
    }

    /// Connects and reads until it is stopped.
    ///
    /// After a failed or lost connection it waits 0.1 s, then twice as long each time up to 2 s; a
    /// received frame brings the wait back to 0.1 s.
    pub async fn run(mut self, mut stop: StopSignal) {
        tokio::select! {
            () = stop.ordered() => {}
            () = self.read_forever() => {}
        }
    }

    async fn read_forever(&mut self) {
        let mut stream = MocapStream::new(&self.settings);
        let mut connector = Connector::new(&self.settings);
        let mut back_off = BACK_OFF_MIN;
        loop {
            let opened = connector.open().await;
            self.counters.note_opening(opened.as_ref().map(|_| ()));
            if let Ok(wire) = opened {
                self.counters.connects.count();
                stream.set_airborne(self.is_airborne());
                stream.restart();
                let sightings = self.counters.sightings.get();
                let messages = self.counters.messages.get();
                self.read_connection(wire, &mut stream).await;
                if self.counters.messages.get() == messages {
                    connector.note_silence();
                }
                if self.counters.sightings.get() > sightings {
                    back_off = BACK_OFF_MIN;
                }
            }
            sleep(back_off).await;
            back_off = (2 * back_off).min(BACK_OFF_MAX);
        }
    }

    /// The newest report of the control loop; no other memory depends on it, hence no ordering.
    fn is_airborne(&self) -> bool {
        self.airborne.load(Ordering::Relaxed)
    }

    /// Reads until the connection ends, falls silent or makes no sense.
    async fn read_connection(&mut self, mut wire: Wire, stream: &mut MocapStream) {
        let mut chunk = vec![0; CHUNK_BYTES];
        let mut requests = Vec::new();
        let beat_period = stream.beat_period();
        let mut beat_at = None;
        let mut progress = Progress::begin(self.clock.now());
        let sightings_before = self.counters.sightings.get();
        loop {
            let now = self.clock.now();
            if beat_at.is_none_or(|beat_at| now.since(beat_at).duration() >= beat_period) {
                beat_at = Some(now);
                stream.beat();
            }
            requests.clear();
            stream.take_requests(&mut requests);
            let Ok(Ok(())) = timeout(SILENCE_TIMEOUT, wire.write(&requests)).await else { return };
            let silent = now.since(progress.heard_at).duration();
            if silent >= SILENCE_TIMEOUT {
                return;
            }
            let wait_max = beat_period.min(SILENCE_TIMEOUT.saturating_sub(silent));
            let count = match timeout(wait_max, wire.read(&mut chunk)).await {
                Ok(Ok(count)) => count,
                // The end of a stream is as final as an error or silence.
                Ok(Err(_)) => return,
                Err(_) => continue,
            };
            let received_at = self.clock.now();
            progress.note_bytes(received_at);
            let messages = self.counters.messages.get();
            let bytes = chunk.get(..count).unwrap_or_default();
            if let Err(error) = self.take(bytes, received_at, stream) {
                self.counters.refuse(Refusal::Form);
                self.counters.give_up(error);
                return;
            }
            let has_frames = self.counters.sightings.get() > sightings_before;
            if self.counters.messages.get() > messages {
                progress.note_message(received_at);
            } else if has_frames && progress.is_overdue(received_at) {
                return;
            }
            // A source that floods has always more to read: the other source and the end come between two chunks.
            tokio::task::yield_now().await;
            if let Err(error) = wire.join(stream.group()) {
                self.counters.note_opening(Err(&error));
                return;
            }
        }
    }

    /// Hands `bytes` to the stream, and its sightings to the control thread.
    ///
    /// # Errors
    /// Those of [`MocapStream::push`].
    fn take(
        &mut self,
        bytes: &[u8],
        received_at: TimeNs,
        stream: &mut MocapStream,
    ) -> Result<(), SourceError> {
        let sightings = self.counters.sightings.get();
        stream.set_airborne(self.is_airborne());
        let result = stream.push(bytes, received_at, &self.counters, |sighting| {
            if self.sightings.push(sighting).is_err() {
                self.counters.overflow.count();
            }
        });
        if self.counters.sightings.get() > sightings {
            self.arrival.note(received_at);
        }
        result
    }
}

/// When a connection brought bytes and messages.
#[derive(Debug)]
struct Progress {
    /// When the newest message was complete; before the first one, when the connection began.
    heard_at: TimeNs,
    /// When the newest bytes came; before the first ones, when the connection began.
    read_at: TimeNs,
    /// When the first bytes came of the message that is not complete, without a pause since.
    incomplete_since: Option<TimeNs>,
}

impl Progress {
    fn begin(now: TimeNs) -> Self {
        Self { heard_at: now, read_at: now, incomplete_since: None }
    }

    /// Bytes came. What was incomplete before a pause has not been waited for.
    fn note_bytes(&mut self, at: TimeNs) {
        let paused = at.since(self.read_at).duration();
        self.read_at = at;
        self.incomplete_since = self.incomplete_since.filter(|_| paused < PAUSE_MIN);
    }

    /// The bytes completed a message.
    fn note_message(&mut self, at: TimeNs) {
        self.heard_at = at;
        self.incomplete_since = None;
    }

    /// The bytes completed no message. Whether it is overdue.
    fn is_overdue(&mut self, at: TimeNs) -> bool {
        at.since(*self.incomplete_since.get_or_insert(at)).duration() >= INCOMPLETE_TIMEOUT
    }
}

#[cfg(test)]
mod tests;
