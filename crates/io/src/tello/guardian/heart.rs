//! The sender's side of its guardian: heartbeats out, the word of a landing in.
//!
//! The sender asks [`Heart::word`] before it sends anything: a program that was stopped and goes on must not
//! steer a drone that the guardian has landed. It does not rely on the guardian's byte alone: whichever
//! process the system lets run first, a pause as long as the guardian's patience counts as a landing.

use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::time::Duration;

use super::{Duty, LANDED, READY};
use crate::clock::{SpanNs, TimeNs};

/// Between two heartbeats of a sender that has nothing else to say.
pub(in crate::tello) const BEAT_PERIOD: SpanNs = SpanNs::from_ms(40);
/// Own silence after which the guardian may have landed the drone: less than its patience, which begins when
/// the heartbeat arrives.
const PAUSE_MAX: SpanNs = SpanNs::from_ms(250);
/// A repeated state is not worth a heartbeat before.
const REPEAT_AFTER: SpanNs = SpanNs::from_ms(15);
/// How long the guardian may take to start on a busy machine.
const START_TIME: Duration = Duration::from_secs(10);
/// How long a guardian that does not read may hold up the end.
const END_TIME: Duration = Duration::from_millis(500);

/// What the sender has to know before it sends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::tello) enum Word {
    /// Go on.
    GoOn,
    /// The guardian has landed the drone, or must be taken to have.
    Landed {
        /// Whether the sender steered until then.
        is_steered: bool,
    },
    /// The guardian has ended: nobody would land the drone in the sender's place.
    Gone,
}

/// The sender's end of the channel; without a guardian it says and hears nothing.
#[derive(Debug, Default)]
pub(in crate::tello) struct Heart {
    channel: Option<UnixStream>,
    last: Option<(Duty, TimeNs)>,
}

impl Heart {
    /// The end of a guardian that has been started; returns when it watches.
    pub(in crate::tello) fn start(mut channel: UnixStream) -> io::Result<Self> {
        channel.set_read_timeout(Some(START_TIME))?;
        let mut byte = [0];
        channel.read_exact(&mut byte)?;
        if byte != [READY] {
            return Err(ErrorKind::InvalidData.into());
        }
        channel.set_nonblocking(true)?;
        Ok(Self { channel: Some(channel), last: None })
    }

    /// What the sender does at `now`. To be called at least every [`BEAT_PERIOD`].
    pub(in crate::tello) fn beat(&mut self, duty: Duty, now: TimeNs) {
        let is_news =
            self.last.is_none_or(|(last, at)| last != duty || now.since(at) >= REPEAT_AFTER);
        let Some(channel) = self.channel.as_mut().filter(|_| is_news) else { return };
        // A guardian that is gone shows in `word`; one that does not read has enough to read.
        channel.write_all(&[duty as u8]).ok();
        self.last = Some((duty, now));
    }

    /// What there is to know at `now`.
    pub(in crate::tello) fn word(&mut self, now: TimeNs) -> Word {
        let Some(channel) = &mut self.channel else { return Word::GoOn };
        let mut bytes = [0; 64];
        let is_steered = matches!(self.last, Some((Duty::Steering, _)));
        let landed = Word::Landed { is_steered };
        let word = match channel.read(&mut bytes) {
            Ok(0) => Word::Gone,
            Ok(count) if bytes.iter().take(count).any(|byte| *byte == LANDED) => landed,
            Ok(_) => Word::GoOn,
            Err(error)
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) =>
            {
                Word::GoOn
            }
            Err(_) => Word::Gone,
        };
        let has_paused =
            self.last.is_some_and(|(duty, at)| duty.is_guarded() && now.since(at) >= PAUSE_MAX);
        match word {
            Word::Gone => {
                self.channel = None;
                Word::Gone
            }
            _ if has_paused => landed,
            word => word,
        }
    }

    /// How long ago the last heartbeat was, if a drone depended on it.
    pub(in crate::tello) fn pause(&self, now: TimeNs) -> Option<SpanNs> {
        self.last.and_then(|(duty, at)| duty.is_guarded().then(|| now.since(at)))
    }

    /// The sender has ended as it should.
    pub(in crate::tello) fn end(mut self) {
        let Some(channel) = &mut self.channel else { return };
        // A guardian that is gone, or stopped, cannot be told; whoever started it ends it.
        let told = channel
            .set_nonblocking(false)
            .and_then(|()| channel.set_write_timeout(Some(END_TIME)))
            .and_then(|()| channel.write_all(&[Duty::Over as u8]));
        told.ok();
    }
}

#[cfg(test)]
mod tests;
