//! Lands the drone when the program that flies it is dead, stopped or blocked.
//!
//! Owns the guardian's side: a process of its own with a copy of the drone's socket and two packets. The
//! sender sends it heartbeats with its [`SenderState`], which the guardian answers: a sender whose heartbeats find
//! no answer lands, too. The sender's side is `guardian::heartbeat`. When heartbeats
//! stay away while a drone may be in the air, or the channel closes without the final message, the guardian sends
//! neutral sticks and the order to land until the sender takes the landing over, for 15 s at most. It
//! refuses to steer, and reads nothing that the drone sends.

mod heartbeat;

use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, UdpSocket};
use std::os::unix::net::UnixStream;
use std::thread;
use std::time::Duration;

use super::Protocol;
use super::session::landing_packets;
use crate::clock::{Clock, SpanNs, TimeNs};

pub(super) use heartbeat::BEAT_PERIOD;
pub use heartbeat::{GuardianReport, Heartbeat};

/// Silence after which a sender counts as dead or stopped.
const HEARTBEAT_TIMEOUT: SpanNs = SpanNs::from_ms(280);
/// A Tello ignores `land` for a while after a take-off, and any packet may be lost. Half of the sender's period: the
/// drone has been alone for a while.
const GUARDIAN_LAND_PERIOD: SpanNs = SpanNs::from_ms(250);
/// Landings in 15 s: after so long without a packet a Tello lands by itself.
const LANDINGS_MAX: u32 = 60;

/// The guardian runs.
const READY: u8 = b'r';
/// The guardian has ordered, or is about to order, a landing.
const LANDING_ORDERED: u8 = b'L';
/// The guardian has read heartbeats.
const HEARD: u8 = b'h';

/// Longest wait of the guardian for a sender that reads nothing.
const CHANNEL_WRITE_TIMEOUT: Duration = Duration::from_millis(10);

/// State of the sender: the byte of its heartbeat.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum SenderState {
    /// No drone depends on the sender.
    Idle = b'i',
    /// The drone may be in the air, and the sender steers it.
    Steering = b's',
    /// The drone may be in the air, and the sender repeats the order to land.
    Landing = b'l',
    /// The sender has ended as it should: the last byte.
    Over = b'o',
}

impl SenderState {
    fn of(byte: u8) -> Option<Self> {
        [Self::Idle, Self::Steering, Self::Landing, Self::Over]
            .into_iter()
            .find(|state| *state as u8 == byte)
    }

    /// Whether the drone has to be landed if the sender does not go on.
    fn is_guarded(self) -> bool {
        matches!(self, Self::Steering | Self::Landing)
    }
}

/// Sockets and address with which a guardian is started.
#[derive(Debug)]
pub struct GuardianSockets {
    /// A copy of the socket that the drone listens to.
    pub socket: UdpSocket,
    /// The guardian's end of the channel to the sender.
    pub channel: UnixStream,
    /// IP address and port of the drone.
    pub address: SocketAddr,
    /// Protocol that the drone speaks in this flight.
    pub protocol: Protocol,
}

/// How a watch ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WatchEnd {
    /// No drone depended on the sender when it left.
    Over,
    /// The sender is gone, and the drone may be in the air: it was ordered to land once.
    Abandoned,
    /// The sender is gone; the guardian has ordered landings in its place.
    OrderedLanding,
}

/// Watches one sender.
#[derive(Debug)]
pub struct Guardian {
    post: GuardianSockets,
    clock: Clock,
    state: SenderState,
    /// LANDs sent in the landing that goes on.
    landings: u32,
    /// LANDs sent so far.
    sent: u32,
    has_ordered_landing: bool,
}

/// Result of a read from the channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Received {
    Beat,
    Silence,
    Over,
    /// The channel is closed.
    End,
}

impl Guardian {
    /// A guardian that has reported to the sender that it watches.
    ///
    /// # Errors
    /// The channel is no channel, or closed.
    pub fn start(mut post: GuardianSockets) -> io::Result<Self> {
        post.channel.set_write_timeout(Some(CHANNEL_WRITE_TIMEOUT))?;
        post.channel.write_all(&[READY])?;
        Ok(Self {
            post,
            clock: Clock::start(),
            state: SenderState::Idle,
            landings: 0,
            sent: 0,
            has_ordered_landing: false,
        })
    }

    /// Watches, and lands the drone of a sender that falls silent, until the channel closes.
    pub fn watch(&mut self) -> WatchEnd {
        loop {
            let listen_until =
                self.state.is_guarded().then(|| self.clock.now().after(HEARTBEAT_TIMEOUT));
            let heard = match self.listen(listen_until) {
                Received::Silence => self.land(),
                heard => heard,
            };
            match heard {
                Received::Beat | Received::Silence => {}
                Received::End if self.state.is_guarded() => {
                    self.send_landing();
                    return WatchEnd::Abandoned;
                }
                Received::End if self.has_ordered_landing => return WatchEnd::OrderedLanding,
                Received::Over | Received::End => return WatchEnd::Over,
            }
        }
    }

    /// Goes on landing the drone of a sender that is gone; returns after 15 s of orders, with the
    /// number of landings.
    pub fn land_alone(mut self) -> u32 {
        while self.landings < LANDINGS_MAX {
            thread::sleep(GUARDIAN_LAND_PERIOD.duration());
            self.send_landing();
        }
        self.landings
    }

    /// Lands until the sender goes on with it.
    fn land(&mut self) -> Received {
        self.has_ordered_landing = true;
        while self.landings < LANDINGS_MAX {
            // Before the packets: a sender that goes on reads it before it sends anything.
            // A sender that is gone shows in the next reading.
            self.post.channel.write_all(&[LANDING_ORDERED]).ok();
            self.send_landing();
            let again_at = self.clock.now().after(GUARDIAN_LAND_PERIOD);
            loop {
                match self.listen(Some(again_at)) {
                    // What it sent before it learned of the landing, or it does not know of it yet.
                    Received::Beat if self.state == SenderState::Steering => {}
                    Received::Silence => break,
                    heard => {
                        self.landings = 0;
                        return heard;
                    }
                }
            }
        }
        // The drone has been on the ground for long, whatever the last message of the sender was.
        self.landings = 0;
        self.state = SenderState::Idle;
        Received::Silence
    }

    /// Waits for heartbeats until `until`, for ever without it.
    fn listen(&mut self, until: Option<TimeNs>) -> Received {
        loop {
            let left = until.map(|until| until.since(self.clock.now()).duration());
            // Zero would mean for ever.
            let left = left.map(|left| left.max(Duration::from_millis(1)));
            if self.post.channel.set_read_timeout(left).is_err() {
                return Received::End;
            }
            let mut bytes = [0; 64];
            match self.post.channel.read(&mut bytes) {
                Ok(0) => return Received::End,
                Ok(count) => {
                    let heard = bytes.iter().take(count).filter_map(|byte| SenderState::of(*byte));
                    let mut is_over = false;
                    for state in heard {
                        self.state = state;
                        is_over |= state == SenderState::Over;
                    }
                    // A sender that is gone shows in the next reading.
                    self.post.channel.write_all(&[HEARD]).ok();
                    return if is_over { Received::Over } else { Received::Beat };
                }
                Err(error) if is_timeout_or_signal(&error) => {
                    let is_early = until.is_none_or(|until| self.clock.now() < until);
                    // After a stop of this process heartbeats may wait in the channel: they are read first.
                    if !is_early && error.kind() != ErrorKind::Interrupted {
                        return Received::Silence;
                    }
                }
                Err(_) => return Received::End,
            }
        }
    }

    /// Levels the sticks, since a drone may keep the last ones while it lands, and orders the landing.
    fn send_landing(&mut self) {
        for packet in landing_packets(self.post.protocol, self.sent) {
            // A socket that takes nothing now may do so at the next repetition.
            self.post.socket.send_to(&packet, self.post.address).ok();
        }
        self.landings = self.landings.saturating_add(1);
        self.sent = self.sent.saturating_add(1);
    }
}

/// Whether a read ended without bytes for its timeout or for a signal.
fn is_timeout_or_signal(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

#[cfg(test)]
mod tests;
