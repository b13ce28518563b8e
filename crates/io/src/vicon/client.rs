//! The sockets of the mocap sources: connect or listen, read, connect again.
//!
//! Owns the connection and the queue to the control thread. A lost server is not an error here: the
//! sightings stop, and whoever drains the queue sees their age.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use rtrb::{Consumer, Producer, RingBuffer};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpStream, UdpSocket};
use tokio::time::{sleep, timeout};

use super::settings::Transport;
use super::{Sighting, ViconCounters, ViconSettings, ViconStream};
use crate::Stop;
use crate::clock::Clock;

/// Room for 1.28 s at 100 Hz; the control thread drains it every 20 ms.
const QUEUE_SIGHTINGS: usize = 128;

/// A kernel gives up a connect after two minutes; a flight cannot wait for that.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(2);

/// A server that completes no message for so long is connected anew: a host that vanished sends no
/// end, and one that trickles never gets anywhere.
const SILENCE_TIMEOUT: Duration = Duration::from_secs(5);

const BACK_OFF_MIN: Duration = Duration::from_millis(100);
const BACK_OFF_MAX: Duration = Duration::from_secs(2);

/// More than the largest datagram of the object stream; a longer one is cut and refused.
const CHUNK_BYTES: usize = 4096;

/// What the control thread holds of the mocap link.
#[derive(Debug)]
pub struct ViconFeed {
    /// New sightings, oldest first. Never blocks.
    pub sightings: Consumer<Sighting>,
    /// Counts of the task that fills the queue.
    pub counters: Arc<ViconCounters>,
    /// Set by the control loop while the vehicle may be in the air: the source's clock is learned on the
    /// ground only. At first it is not.
    pub airborne: Arc<AtomicBool>,
}

/// The task that reads the source.
#[derive(Debug)]
pub struct ViconClient {
    settings: ViconSettings,
    clock: Clock,
    sightings: Producer<Sighting>,
    counters: Arc<ViconCounters>,
    airborne: Arc<AtomicBool>,
}

impl ViconClient {
    /// A client that is not yet connected, and the far end of its queue.
    pub fn new(settings: ViconSettings, clock: Clock) -> (Self, ViconFeed) {
        let (producer, consumer) = RingBuffer::new(QUEUE_SIGHTINGS);
        let counters = Arc::new(ViconCounters::default());
        let airborne = Arc::new(AtomicBool::new(false));
        let feed = ViconFeed {
            sightings: consumer,
            counters: Arc::clone(&counters),
            airborne: Arc::clone(&airborne),
        };
        (Self { settings, clock, sightings: producer, counters, airborne }, feed)
    }

    /// Connects and reads until it is stopped.
    ///
    /// After a failed or lost connection it waits 0.1 s, then twice as long each time up to 2 s; a
    /// received message brings the wait back to 0.1 s.
    pub async fn run(mut self, mut stop: Stop) {
        tokio::select! {
            () = stop.ordered() => {}
            () = self.read_forever() => {}
        }
    }

    async fn read_forever(&mut self) {
        let mut stream = ViconStream::new(&self.settings);
        let mut back_off = BACK_OFF_MIN;
        loop {
            if let Ok(Ok(wire)) = timeout(CONNECT_TIMEOUT, Wire::open(&self.settings)).await {
                self.counters.connects.count();
                stream.set_airborne(self.is_airborne());
                stream.restart();
                let messages = self.counters.messages.get();
                self.read_connection(wire, &mut stream).await;
                if self.counters.messages.get() > messages {
                    back_off = BACK_OFF_MIN;
                }
            }
            sleep(back_off).await;
            back_off = (2 * back_off).min(BACK_OFF_MAX);
        }
    }

    /// What the control loop says; no other memory depends on it, hence no ordering.
    fn is_airborne(&self) -> bool {
        self.airborne.load(Ordering::Relaxed)
    }

    /// Reads until the connection ends, falls silent or makes no sense.
    async fn read_connection(&mut self, mut wire: Wire, stream: &mut ViconStream) {
        let mut chunk = [0; CHUNK_BYTES];
        let mut requests = Vec::new();
        let mut heard_at = self.clock.now();
        loop {
            let patience =
                SILENCE_TIMEOUT.saturating_sub(self.clock.now().since(heard_at).duration());
            // The end of a stream is as final as an error or silence.
            let Ok(Ok(count)) = timeout(patience, wire.read(&mut chunk)).await else { return };
            let received_at = self.clock.now();
            let messages = self.counters.messages.get();
            let bytes = chunk.get(..count).unwrap_or_default();
            stream.set_airborne(self.is_airborne());
            let result = stream.push(bytes, received_at, &self.counters, |sighting| {
                if self.sightings.push(sighting).is_err() {
                    self.counters.overflow.count();
                }
            });
            if let Err(error) = result {
                self.counters.malformed.count();
                self.counters.give_up(error);
                return;
            }
            if self.counters.messages.get() > messages {
                heard_at = received_at;
            }
            requests.clear();
            stream.take_requests(&mut requests);
            let Ok(Ok(())) = timeout(SILENCE_TIMEOUT, wire.write(&requests)).await else { return };
        }
    }
}

/// What bytes come from.
#[derive(Debug)]
enum Wire {
    Tcp(TcpStream),
    Udp(UdpSocket),
}

impl Wire {
    async fn open(settings: &ViconSettings) -> io::Result<Self> {
        match settings.transport() {
            Transport::Tcp(address) => {
                let socket = TcpStream::connect(address.as_str()).await?;
                socket.set_nodelay(true)?;
                Ok(Self::Tcp(socket))
            }
            Transport::Udp(address) => Ok(Self::Udp(UdpSocket::bind(address).await?)),
        }
    }

    /// The next piece or datagram. Safe to cancel.
    async fn read(&mut self, chunk: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(socket) => match socket.read(chunk).await? {
                0 => Err(io::ErrorKind::UnexpectedEof.into()),
                count => Ok(count),
            },
            Self::Udp(socket) => socket.recv(chunk).await,
        }
    }

    /// Sends `bytes`, if there are any. Nobody listens at the other end of the object stream.
    async fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Tcp(socket) => socket.write_all(bytes).await,
            Self::Udp(_) => Ok(()),
        }
    }
}
