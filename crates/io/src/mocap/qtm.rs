//! Qualisys' real-time protocol of QTM, as far as the poses of 6DOF bodies need it.
//!
//! The server greets; the client names its version, asks for the parameters (names of the bodies,
//! frame rate, axis that points up) and then for every frame. Bodies come in the order of the parameters, without
//! names. Pure: bytes to values and back. Packets are [`packet`]'s and [`encode`]'s; this file owns the client's
//! part of the conversation.

#![deny(clippy::indexing_slicing)]

pub mod encode;
pub mod packet;

use packet::{Packets, kind};

use super::axes::{Placement, SourceAxis};
use super::protocol::{
    Absence, BodyProtocol, FrameVisitor, Head, Name, OBJECT_NAME_BYTES_MAX, OBJECTS_MAX, RATE_HZ,
};
use super::source::{Refusal, SourceError};
use crate::clock::SpanNs;

/// Greeting of a server.
pub const GREETING: &str = "QTM RT Interface connected";

/// The version that is spoken. Later ones add nothing to 6DOF bodies.
const VERSION: &str = "Version 1.19";
const GET_PARAMETERS: &str = "GetParameters General 3D 6D";
const STREAM: &str = "StreamFrames AllFrames 6D";

/// The packets of a server.
#[derive(Debug)]
pub(super) struct QtmProtocol {
    packets: Packets,
    reader: Reader,
}

/// Content of the packets so far.
#[derive(Debug, Default)]
struct Reader {
    /// Which axis the settings take for up.
    up: Option<SourceAxis>,
    has_greeted: bool,
    /// Whether a frame came since the last beat.
    has_frames: bool,
    parameters: Option<Parameters>,
    /// Whether bodies may have changed since.
    is_outdated: bool,
    requests: Vec<u8>,
}

/// Parameters in the server's XML.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Parameters {
    /// Frame rate; 0 if it is not there. Hz
    pub rate_hz: f64,
    /// Axis that points up, with its sign, as written.
    pub up: Option<String>,
    /// Names of the bodies, and whether each is enabled.
    pub bodies: Vec<(String, bool)>,
}

impl Parameters {
    /// The parameters in a document; `None` if it is no such document.
    pub fn parse(text: &str) -> Option<Self> {
        let options = roxmltree::ParsingOptions { nodes_limit: 100_000, ..Default::default() };
        let document = roxmltree::Document::parse_with_options(text, options).ok()?;
        let root = document.root_element();
        let child = |node: roxmltree::Node<'_, '_>, name: &str| -> Option<String> {
            let child = node.children().find(|child| child.has_tag_name(name))?;
            child.text().map(|text| text.trim().to_owned())
        };
        let section = |name: &str| root.children().find(|child| child.has_tag_name(name));
        let rate_hz = section("General").and_then(|general| child(general, "Frequency"));
        let rate_hz = rate_hz.and_then(|text| text.parse().ok()).filter(|hz| RATE_HZ.contains(hz));
        let up = section("The_3D").and_then(|three| child(three, "AxisUpwards"));
        let bodies = section("The_6D").into_iter().flat_map(|six| six.children());
        let bodies = bodies.filter(|body| body.has_tag_name("Body")).map(|body| {
            let name = child(body, "Name").filter(|name| name.len() <= OBJECT_NAME_BYTES_MAX);
            let is_enabled =
                child(body, "Enabled").is_none_or(|text| text.eq_ignore_ascii_case("true"));
            (name.unwrap_or_default(), is_enabled)
        });
        let bodies = bodies.take(OBJECTS_MAX).collect();
        Some(Self { rate_hz: rate_hz.unwrap_or(0.0), up, bodies })
    }

    /// Name of a body of a frame that has `count`: of all that there are, or of the enabled ones.
    fn name(&self, index: usize, count: usize) -> Option<&str> {
        let (name, _) = if count == self.bodies.len() {
            self.bodies.get(index)?
        } else {
            let mut enabled = self.bodies.iter().filter(|(_, is_enabled)| *is_enabled);
            if enabled.clone().count() != count {
                return None;
            }
            enabled.nth(index)?
        };
        Some(name)
    }
}

impl QtmProtocol {
    /// A client before its first packet. `up`: which axis the settings take for up, z if they name none.
    pub(super) fn new(up: Option<SourceAxis>) -> Self {
        let reader = Reader { up, is_outdated: true, ..Reader::default() };
        Self { packets: Packets::default(), reader }
    }
}

impl BodyProtocol for QtmProtocol {
    fn push(&mut self, bytes: &[u8], visitor: &mut dyn FrameVisitor) -> Result<(), SourceError> {
        let Self { packets, reader } = self;
        packets.push(bytes, |packet, body| {
            visitor.message();
            if reader.read(packet, body, visitor)?.is_none() {
                visitor.refuse(Refusal::Form);
            }
            Ok(())
        })
    }

    fn restart(&mut self) {
        *self = Self::new(self.reader.up);
    }

    fn beat(&mut self) {
        let reader = &mut self.reader;
        // A measurement may have ended and another one begun, with other bodies.
        let is_silent = !std::mem::take(&mut reader.has_frames);
        if reader.has_greeted && (is_silent || reader.is_outdated) {
            encode::text(kind::COMMAND, GET_PARAMETERS, &mut reader.requests);
        }
    }

    fn take_requests(&mut self, to: &mut Vec<u8>) {
        to.append(&mut self.reader.requests);
    }
}

impl Reader {
    /// Takes in a packet; `None` if it does not match its kind.
    fn read(
        &mut self,
        packet: u32,
        body: &[u8],
        visitor: &mut dyn FrameVisitor,
    ) -> Result<Option<()>, SourceError> {
        if !self.has_greeted {
            if packet != kind::COMMAND || !body.starts_with(GREETING.as_bytes()) {
                return Err(SourceError::NoQtm);
            }
            self.has_greeted = true;
            encode::text(kind::COMMAND, VERSION, &mut self.requests);
            encode::text(kind::COMMAND, GET_PARAMETERS, &mut self.requests);
            return Ok(Some(()));
        }
        match packet {
            kind::ERROR => {
                let text = packet::text(body);
                let text = text.chars().filter(|letter| !letter.is_control()).take(200);
                Err(SourceError::Qtm { text: text.collect() })
            }
            kind::XML => self.learn(&packet::text(body)),
            kind::DATA => Ok(self.read_frame(body, visitor)),
            kind::EVENT => {
                // Bodies may have changed; until the answer the old names stand, unless their count is another.
                self.is_outdated = true;
                encode::text(kind::COMMAND, GET_PARAMETERS, &mut self.requests);
                Ok(Some(()))
            }
            _ => Ok(Some(())),
        }
    }

    /// Takes in the parameters and asks for frames.
    fn learn(&mut self, text: &str) -> Result<Option<()>, SourceError> {
        let Some(parameters) = Parameters::parse(text) else { return Ok(None) };
        if let Some(up) = &parameters.up {
            let name = up.trim_start_matches('+').to_ascii_lowercase();
            if name != self.up.unwrap_or(SourceAxis::Z).name() {
                return Err(SourceError::Up { up: name });
            }
        }
        self.parameters = Some(parameters);
        self.is_outdated = false;
        if !self.has_frames {
            encode::text(kind::COMMAND, STREAM, &mut self.requests);
        }
        Ok(Some(()))
    }

    /// Takes in a frame; `None` if the packet ends before it does.
    fn read_frame(&mut self, body: &[u8], visitor: &mut dyn FrameVisitor) -> Option<()> {
        let Some(parameters) = &self.parameters else { return Some(()) };
        let mut is_unnamed = false;
        let (time_us, number) = packet::frame(body, |index, count, at: Option<Placement>| {
            let text = parameters.name(index, count).map(str::as_bytes);
            is_unnamed |= text.is_none();
            visitor.body(Name { text, id: None }, at.as_ref());
        })?;
        let rate_hz = parameters.rate_hz;
        self.has_frames = true;
        if is_unnamed {
            self.parameters = None;
            self.is_outdated = true;
        }
        let stamp = i64::try_from(u128::from(time_us) * 1000).ok().map(SpanNs);
        let (number, latency) = (number.into(), SpanNs(0));
        visitor.frame(Head { number, rate_hz, stamp, latency, absence: Absence::Lost });
        Some(())
    }
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
