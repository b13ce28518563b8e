//! The sender's side of its guardian: heartbeats out, their answers and the report of a landing in.
//!
//! The sender asks [`Heartbeat::report`] before it sends anything: a program that was stopped and goes on must not
//! steer a drone that the guardian has landed. It does not rely on the guardian's byte alone: whichever
//! process the system lets run first, a pause of nearly the guardian's timeout counts as a landing. A guardian that
//! does not answer cannot land: it counts as gone.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, UdpSocket};
use std::os::unix::net::UnixStream;
use std::time::Duration;

use super::super::Protocol;
use super::{GuardianSockets, HEARD, LANDING_ORDERED, READY, SenderState};
use crate::clock::{SpanNs, TimeNs};

/// Longest time between two heartbeats of a sender without other work.
pub(in crate::tello) const BEAT_PERIOD: SpanNs = SpanNs::from_ms(40);
/// Own silence after which the guardian may have landed the drone: less than its timeout, which begins when
/// the heartbeat arrives.
const PAUSE_MAX: SpanNs = SpanNs::from_ms(250);
/// Shortest time between two heartbeats with the same state.
const REPEAT_AFTER: SpanNs = SpanNs::from_ms(15);
/// Heartbeats without an answer after which the guardian counts as gone. Only the sender's own turns count, and
/// of the time between two of them at most [`BEAT_PERIOD`]: a machine that stalls both is no silence.
const SILENCE_MAX: SpanNs = SpanNs::from_ms(400);
/// How long the guardian may take to start on a busy machine.
const START_TIME: Duration = Duration::from_secs(10);
/// How long a guardian that does not read may hold up the end.
const END_TIME: Duration = Duration::from_millis(500);

/// Report of the guardian that the sender reads before it sends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GuardianReport {
    /// Nothing to report.
    Continue,
    /// The guardian has ordered a landing, or must be taken to have.
    LandingOrdered {
        /// Whether the sender steered until then.
        is_steered: bool,
    },
    /// The guardian has ended, or does not answer: it would not land the drone in the sender's place. Reported
    /// once.
    Gone,
}

/// The sender's end of the channel; without a guardian it sends and receives nothing.
#[derive(Debug, Default)]
pub struct Heartbeat {
    channel: Option<UnixStream>,
    last: Option<(SenderState, TimeNs)>,
    /// Time without an answer of the guardian while the sender had its turns.
    silence: SpanNs,
    /// Whether [`GuardianReport::Gone`] was reported.
    is_lost: bool,
}

impl Heartbeat {
    /// Starts a guardian by `start`, which runs [`super::Guardian`] where it outlives the sender: in another
    /// process, with the ends that it is given. Returns when it watches. To be called before anything moves.
    ///
    /// # Errors
    /// The system gives no second handle to `socket`; `start` fails; the guardian does not report within 10 s
    /// that it watches.
    pub fn start_guardian<T>(
        socket: &UdpSocket,
        address: SocketAddr,
        protocol: Protocol,
        start: impl FnOnce(GuardianSockets) -> io::Result<T>,
    ) -> io::Result<(Self, T)> {
        let (ours, channel) = UnixStream::pair()?;
        let started =
            start(GuardianSockets { socket: socket.try_clone()?, channel, address, protocol })?;
        Ok((Self::await_ready(ours)?, started))
    }

    /// The sender's end of the channel to a guardian that was started; returns when that watches.
    fn await_ready(mut channel: UnixStream) -> io::Result<Self> {
        channel.set_read_timeout(Some(START_TIME))?;
        let mut byte = [0];
        channel.read_exact(&mut byte)?;
        if byte != [READY] {
            return Err(ErrorKind::InvalidData.into());
        }
        channel.set_nonblocking(true)?;
        Ok(Self { channel: Some(channel), ..Self::default() })
    }

    /// Reports the state of the sender at `now`. To be called at least every 40 ms.
    pub fn beat(&mut self, state: SenderState, now: TimeNs) {
        let is_news =
            self.last.is_none_or(|(last, at)| last != state || now.since(at) >= REPEAT_AFTER);
        if !is_news {
            return;
        }
        if let Some(channel) = &mut self.channel {
            // A guardian that is gone shows in `report`; one that does not read has enough to read.
            channel.write_all(&[state as u8]).ok();
            let unanswered = self.last.map_or(SpanNs(0), |(_, at)| now.since(at).min(BEAT_PERIOD));
            self.silence = SpanNs(self.silence.0.saturating_add(unanswered.0));
        }
        self.last = Some((state, now));
    }

    /// Newest report of the guardian up to `now`.
    pub fn report(&mut self, now: TimeNs) -> GuardianReport {
        let Some(channel) = &mut self.channel else { return GuardianReport::Continue };
        let mut bytes = [0; 64];
        let (mut has_ordered_landing, mut has_ended) = (false, false);
        match channel.read(&mut bytes) {
            Ok(0) => has_ended = true,
            Ok(count) => {
                let heard = bytes.get(..count).unwrap_or_default();
                has_ordered_landing = heard.contains(&LANDING_ORDERED);
                if heard.contains(&HEARD) {
                    self.silence = SpanNs(0);
                }
            }
            Err(error) => {
                let kind = error.kind();
                has_ended = !matches!(kind, ErrorKind::WouldBlock | ErrorKind::Interrupted);
            }
        }
        if has_ended {
            self.channel = None;
        }
        // One that goes on later finds the channel open, and what the sender does: it has no reason to land.
        if (has_ended || self.silence >= SILENCE_MAX) && !self.is_lost {
            self.is_lost = true;
            return GuardianReport::Gone;
        }
        let has_paused =
            self.last.is_some_and(|(state, at)| state.is_guarded() && now.since(at) >= PAUSE_MAX);
        if has_ordered_landing || (has_paused && !has_ended) {
            let is_steered = matches!(self.last, Some((SenderState::Steering, _)));
            return GuardianReport::LandingOrdered { is_steered };
        }
        GuardianReport::Continue
    }

    /// How long ago the last heartbeat was, if a drone depended on it.
    pub(in crate::tello) fn pause(&self, now: TimeNs) -> Option<SpanNs> {
        self.last.and_then(|(state, at)| state.is_guarded().then(|| now.since(at)))
    }

    /// The sender has ended as it should.
    pub fn end(mut self) {
        let Some(channel) = &mut self.channel else { return };
        // A guardian that is gone, or stopped, cannot receive a message; its starter ends it.
        let sent = channel
            .set_nonblocking(false)
            .and_then(|()| channel.set_write_timeout(Some(END_TIME)))
            .and_then(|()| channel.write_all(&[SenderState::Over as u8]));
        sent.ok();
    }
}

#[cfg(test)]
mod tests;
