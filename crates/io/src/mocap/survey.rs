//! Survey of a mocap source: its objects, and how well their frames come.
//!
//! Reads a source for all of its objects, for people and for checks before a flight. A flight reads one object by
//! [`super::MocapClient`].

mod intervals;
mod track;

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::io;
use std::time::Duration;

use tokio::time::{sleep, timeout};

use super::axes::{Placement, Unit};
use super::protocol::{Absence, BodyProtocol, FrameVisitor, Head, Name, OBJECTS_MAX};
use super::wire::{CHUNK_BYTES, CONNECT_TIMEOUT, Connector, Wire};
use super::{MocapCounters, MocapSettings, Refusal, SourceError};
use crate::clock::{Clock, TimeNs};
pub use track::{SurveyTrack, TrackReport};

/// Time between two calls of `on_look`, and longest wait for bytes.
const LOOK: Duration = Duration::from_millis(100);
/// Pause before a new connection.
const BACK_OFF: Duration = Duration::from_millis(200);

/// Objects, frames and faults of a source.
#[derive(Debug, Clone, Default)]
pub struct Survey {
    /// Objects by name; `#` and the identity for one without a name.
    pub objects: BTreeMap<String, SurveyTrack>,
    /// Connections that were made.
    pub connects: u64,
    /// Complete messages received.
    pub messages: u64,
    /// Messages and places that were refused.
    pub malformed: u64,
    /// Why the newest of them was.
    pub refused: Option<Refusal>,
    /// Why the last connection was not made or given up.
    pub trouble: Option<String>,
    /// Frame rate that the source announces; 0 if it does not. Hz
    pub announced_hz: f64,
    /// Unit of the source's positions.
    unit: Unit,
}

/// Takes the bodies of a frame until the frame is there.
struct Collect<'a> {
    survey: &'a mut Survey,
    counters: &'a MocapCounters,
    bodies: Vec<(String, Option<Placement>)>,
    now: TimeNs,
}

impl FrameVisitor for Collect<'_> {
    fn message(&mut self) {
        self.counters.messages.count();
    }

    fn refuse(&mut self, why: Refusal) {
        self.counters.refuse(why);
        self.bodies.clear();
    }

    fn body(&mut self, name: Name<'_>, at: Option<&Placement>) {
        let name = match name {
            Name { text: Some(text), id } => {
                // What came before its name did.
                if let Some(id) = id {
                    self.survey.objects.remove(&format!("#{id}"));
                }
                String::from_utf8_lossy(text).into_owned()
            }
            Name { id: Some(id), .. } => format!("#{id}"),
            Name { .. } => return,
        };
        if self.bodies.len() < OBJECTS_MAX {
            let refusal = at.and_then(Placement::refusal);
            if let Some(why) = refusal {
                self.counters.refuse(why);
            }
            self.bodies.push((name, at.copied().filter(|_| refusal.is_none())));
        }
    }

    fn frame(&mut self, head: Head) {
        let Survey { objects, announced_hz, unit, .. } = &mut *self.survey;
        *announced_hz = head.rate_hz;
        if head.absence != Absence::Unknown {
            // What is known and not in the frame is not seen.
            let may_be_before = head.absence == Absence::LostUnlessBefore;
            let is_there = |name: &String, track: &SurveyTrack| {
                self.bodies.iter().any(|(body, _)| body == name)
                    || (may_be_before && track.had(head.number))
            };
            for (_, track) in objects.iter_mut().filter(|(name, track)| !is_there(name, track)) {
                track.take(self.now, None, head);
            }
        }
        for (name, at) in self.bodies.drain(..) {
            if objects.len() < OBJECTS_MAX || objects.contains_key(&name) {
                let track = objects.entry(name).or_insert_with(|| SurveyTrack::new(*unit));
                track.take(self.now, at, head);
            }
        }
    }
}

/// Reads a source until `end`, and calls `on_look` about ten times a second with what there is so far.
///
/// A source that cannot be read is no error: [`Survey::trouble`] states why.
pub async fn survey(
    settings: &MocapSettings,
    clock: Clock,
    end: impl Future<Output = ()>,
    mut on_look: impl FnMut(&Survey, TimeNs),
) -> Survey {
    let mut survey = Survey { unit: settings.axes().unit, ..Survey::default() };
    tokio::select! {
        () = end => {}
        () = read(settings, clock, &mut survey, &mut on_look) => {}
    }
    survey
}

/// Connects and reads again and again.
async fn read(
    settings: &MocapSettings,
    clock: Clock,
    survey: &mut Survey,
    on_look: &mut impl FnMut(&Survey, TimeNs),
) {
    let mut reader = Reader {
        protocol: settings.protocol(),
        counters: MocapCounters::default(),
        chunk: vec![0; CHUNK_BYTES],
        clock,
    };
    let mut connector = Connector::new(settings);
    loop {
        let trouble = match connector.open().await {
            Err(error) => error.to_string(),
            Ok(wire) => {
                survey.connects += 1;
                let messages = reader.counters.messages.get();
                let ended = reader.read_connection(wire, survey, on_look).await;
                if reader.counters.messages.get() == messages {
                    connector.note_silence();
                }
                match ended {
                    Err(Ended::Wire(error)) => error.to_string(),
                    Err(Ended::Source(error)) => error.to_string(),
                    Ok(never) => match never {},
                }
            }
        };
        survey.trouble = Some(trouble);
        sleep(BACK_OFF).await;
    }
}

/// Reader of one connection after the other.
struct Reader {
    protocol: Box<dyn BodyProtocol>,
    counters: MocapCounters,
    chunk: Vec<u8>,
    clock: Clock,
}

/// Why a connection ended.
enum Ended {
    Wire(io::Error),
    Source(SourceError),
}

impl From<io::Error> for Ended {
    fn from(error: io::Error) -> Self {
        Self::Wire(error)
    }
}

impl Reader {
    /// Reads until the connection ends or makes no sense.
    async fn read_connection(
        &mut self,
        mut wire: Wire,
        survey: &mut Survey,
        on_look: &mut impl FnMut(&Survey, TimeNs),
    ) -> Result<Infallible, Ended> {
        let Self { protocol, counters, chunk, clock } = self;
        protocol.restart();
        let mut requests = Vec::new();
        let mut beat_at: Option<TimeNs> = None;
        let mut look_at = clock.now();
        loop {
            let now = clock.now();
            if beat_at.is_none_or(|at| now.since(at).duration() >= protocol.beat_period()) {
                beat_at = Some(now);
                protocol.beat();
            }
            requests.clear();
            protocol.take_requests(&mut requests);
            let Ok(written) = timeout(CONNECT_TIMEOUT, wire.write(&requests)).await else {
                return Err(io::Error::from(io::ErrorKind::TimedOut).into());
            };
            written?;
            let received = timeout(LOOK, wire.read(chunk)).await;
            let now = clock.now();
            if now.since(look_at).duration() >= LOOK {
                look_at = now;
                on_look(survey, now);
            }
            let Ok(count) = received else { continue };
            let bytes = chunk.get(..count?).unwrap_or_default();
            let mut collected = Collect { survey, counters, bodies: Vec::new(), now };
            let result = protocol.push(bytes, &mut collected);
            survey.messages = counters.messages.get();
            survey.malformed = counters.malformed.get();
            survey.refused = counters.refused();
            result.map_err(Ended::Source)?;
            wire.join(protocol.group())?;
        }
    }
}

#[cfg(test)]
impl Survey {
    /// Takes in bytes that came at `now`.
    pub(super) fn take_in(&mut self, protocol: &mut dyn BodyProtocol, bytes: &[u8], now: TimeNs) {
        let counters = MocapCounters::default();
        let mut collected = Collect { survey: self, counters: &counters, bodies: Vec::new(), now };
        protocol.push(bytes, &mut collected).unwrap();
    }
}

#[cfg(test)]
mod tests;
