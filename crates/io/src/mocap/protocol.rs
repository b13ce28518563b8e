//! Interface of every mocap protocol: bytes in, bodies and frames out.
//!
//! Owns the interface: a protocol hands over each body of a frame by name, then the frame. [`SelectedProtocol`] takes
//! one body and turns it into our frame; a survey takes all. What a new protocol takes is listed in `ARCHITECTURE.md`.
//! Measurement times, repeated frames, statistics, queue and connections are shared by all.

use core::net::SocketAddrV4;
use std::fmt::Debug;
use std::ops::RangeInclusive;
use std::time::Duration;

use horizon_model::rows::Pose;

use super::MocapCounters;
use super::axes::{Axes, Placement};
use super::source::{Refusal, SourceError, SourceFrame};
use crate::clock::SpanNs;

/// Rates that a server may announce. Hz
pub(super) const RATE_HZ: RangeInclusive<f64> = 1.0..=10_000.0;

/// Most objects whose names are remembered.
pub(super) const OBJECTS_MAX: usize = 256;

/// Longest name that is remembered. bytes
pub(super) const OBJECT_NAME_BYTES_MAX: usize = 256;

/// Larger latencies are a mistake of the source, and refused. s
pub(super) const LATENCY_MAX_S: f64 = 1.0;

/// A frame without its bodies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Head {
    /// Number of the frame.
    pub(super) number: i64,
    /// Frames per second; 0 while it is not known. Hz
    pub(super) rate_hz: f64,
    /// When it was measured by the source's own clock, if it reports that. ns
    pub(super) stamp: Option<SpanNs>,
    /// Age of the frame when it was sent, as far as the source reports it. ns, >= 0
    pub(super) latency: SpanNs,
    /// Report on an object that is not among its bodies.
    pub(super) absence: Absence,
}

/// Report of a frame on an object that is not among its bodies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Absence {
    /// Nothing: the object may be in another message, or have no name yet.
    Unknown,
    /// The object is lost: the frame has all bodies.
    Lost,
    /// The frame ends here, and its number may have had messages before: the object is lost if none of them had it.
    LostUnlessBefore,
}

/// Identification of an object by its source.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Name<'a> {
    /// By name, if it has one. Any bytes: protocols promise no UTF-8.
    pub(super) text: Option<&'a [u8]>,
    /// By number, if it has one.
    pub(super) id: Option<i32>,
}

impl Name<'_> {
    /// Whether the settings mean this object: by its name, or by `#` and its number.
    pub(super) fn is(&self, wanted: &str) -> bool {
        let by_id = || wanted.strip_prefix('#').and_then(|id| id.parse().ok());
        self.text == Some(wanted.as_bytes()) || (self.id.is_some() && by_id() == self.id)
    }
}

/// Receiver of the messages, bodies and frames that a protocol reads.
pub(super) trait FrameVisitor {
    /// A message is complete.
    fn message(&mut self);

    /// The message is refused, and the bodies so far have no frame.
    fn refuse(&mut self, why: Refusal);

    /// A body of the frame; `None` if the source lost it. Axes and unit are those of the source.
    fn body(&mut self, name: Name<'_>, at: Option<&Placement>);

    /// The frame of these bodies, after them.
    fn frame(&mut self, head: Head);
}

/// One way in which frames of many bodies arrive. Pure: what it needs is in the bytes.
pub(super) trait BodyProtocol: Debug + Send {
    /// Takes in received bytes, a whole datagram or any piece of a stream, and hands over each frame that they
    /// complete. A message that is refused is reported, and the next one is read.
    ///
    /// # Errors
    /// The stream makes no sense from here on: only a new connection helps.
    fn push(&mut self, bytes: &[u8], visitor: &mut dyn FrameVisitor) -> Result<(), SourceError>;

    /// Forgets the connection.
    fn restart(&mut self);

    /// Prepares what is to be sent without having been asked for: once when a connection begins, then about
    /// every [`beat_period`](Self::beat_period).
    fn beat(&mut self) {}

    /// Time between two [`beat`](Self::beat)s: requests and signs of life for the server.
    fn beat_period(&self) -> Duration {
        Duration::from_secs(1)
    }

    /// Appends what is to be sent to the server now, once.
    fn take_requests(&mut self, _to: &mut Vec<u8>) {}

    /// The multicast group that frames come by, once the server named it.
    fn group(&self) -> Option<SocketAddrV4> {
        None
    }
}

/// A protocol, read for one object.
#[derive(Debug)]
pub(super) struct SelectedProtocol {
    pub(super) protocol: Box<dyn BodyProtocol>,
    object: String,
    axes: Axes,
    /// Number of the last frame that had the object.
    seen: Option<i64>,
}

impl SelectedProtocol {
    pub(super) fn new(protocol: Box<dyn BodyProtocol>, object: &str, axes: Axes) -> Self {
        Self { protocol, object: object.to_owned(), axes, seen: None }
    }

    /// Takes in received bytes as [`BodyProtocol::push`], and calls `on_frame` for each frame with the
    /// object, seen or lost. No allocation beyond that of the protocol.
    ///
    /// # Errors
    /// As [`BodyProtocol::push`].
    pub(super) fn push(
        &mut self,
        bytes: &[u8],
        counters: &MocapCounters,
        on_frame: &mut dyn FnMut(SourceFrame),
    ) -> Result<(), SourceError> {
        let Self { protocol, object, axes, seen } = self;
        let found = SelectedBody::default();
        protocol.push(bytes, &mut ObjectSelection { object, axes, seen, found, counters, on_frame })
    }

    pub(super) fn restart(&mut self) {
        self.protocol.restart();
        self.seen = None;
    }
}

/// Takes the bodies of a frame and keeps one.
struct ObjectSelection<'a> {
    object: &'a str,
    axes: &'a Axes,
    seen: &'a mut Option<i64>,
    found: SelectedBody,
    counters: &'a MocapCounters,
    on_frame: &'a mut dyn FnMut(SourceFrame),
}

/// Poses of the object in the frame so far.
#[derive(Default)]
struct SelectedBody {
    pose: Option<Pose>,
    /// Bodies of its name: of two it is not known which is which.
    named: u32,
    refused: Option<Refusal>,
    /// Whether another object has a name in it.
    has_others: bool,
    /// Whether there is one without a name.
    has_unnamed: bool,
}

impl FrameVisitor for ObjectSelection<'_> {
    fn message(&mut self) {
        self.counters.messages.count();
    }

    fn refuse(&mut self, why: Refusal) {
        self.counters.refuse(why);
        self.found = SelectedBody::default();
    }

    fn body(&mut self, name: Name<'_>, at: Option<&Placement>) {
        if !name.is(self.object) {
            self.found.has_others |= name.text.is_some();
            self.found.has_unnamed |= name.text.is_none();
            return;
        }
        self.found.named += 1;
        if self.found.named > 1 {
            return;
        }
        match at.map(|at| self.axes.checked_pose(at)) {
            Some(Ok(pose)) => self.found.pose = Some(pose),
            Some(Err(why)) => self.found.refused = Some(why),
            None => {}
        }
    }

    fn frame(&mut self, Head { number, rate_hz, stamp, latency, absence }: Head) {
        let found = std::mem::take(&mut self.found);
        let SelectedBody { mut pose, named, refused, has_others, has_unnamed } = found;
        if named > 0 {
            // Also if it is refused: that is no loss.
            *self.seen = Some(number);
        }
        if named == 0 {
            if has_others || absence == Absence::Lost {
                self.counters.other_object.count();
            }
            let is_lost = match absence {
                Absence::Unknown => false,
                Absence::Lost => true,
                Absence::LostUnlessBefore => *self.seen != Some(number),
            };
            if !is_lost {
                if has_unnamed {
                    self.counters.unnamed.count();
                }
                return;
            }
        } else if named > 1 {
            self.counters.doubled.count();
            pose = None;
        } else if let Some(why) = refused {
            self.counters.refuse(why);
            return;
        }
        (self.on_frame)(SourceFrame { number, rate_hz, stamp, latency, pose });
    }
}

/// What one object's reader makes of the bytes, which come in these pieces: its frames, and the counters.
#[cfg(test)]
pub(super) fn read(
    source: &mut SelectedProtocol,
    pieces: impl IntoIterator<Item: AsRef<[u8]>>,
) -> (Vec<SourceFrame>, MocapCounters) {
    let counters = MocapCounters::default();
    let mut frames = Vec::new();
    for piece in pieces {
        source.push(piece.as_ref(), &counters, &mut |frame| frames.push(frame)).unwrap();
    }
    (frames, counters)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HERE: Placement =
        Placement { pos_v: [1.0, 2.0, 3.0], matrix: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] };

    fn named(text: &str) -> Name<'_> {
        Name { text: Some(text.as_bytes()), id: None }
    }

    /// What comes of a frame with these bodies that is read for `tello`: its poses, and the counts of malformed
    /// frames and of frames without the object.
    fn picked(
        bodies: &[(Name<'_>, Option<Placement>)],
        absence: Absence,
    ) -> (Vec<Option<Pose>>, u64, u64) {
        let (counters, mut frames) = (MocapCounters::default(), Vec::new());
        let mut on_frame = |frame: SourceFrame| frames.push(frame.pose);
        let mut pick = ObjectSelection {
            object: "tello",
            axes: &Axes::ours(),
            seen: &mut None,
            found: SelectedBody::default(),
            counters: &counters,
            on_frame: &mut on_frame,
        };
        for (name, at) in bodies {
            pick.body(*name, at.as_ref());
        }
        pick.frame(Head { number: 1, rate_hz: 100.0, stamp: None, latency: SpanNs(0), absence });
        (frames, counters.malformed.get(), counters.other_object.get())
    }

    #[test]
    fn an_object_is_meant_by_its_name_or_by_its_number() {
        let both = Name { text: Some(b"tello"), id: Some(-3) };
        assert!(both.is("tello") && both.is("#-3") && !both.is("#3") && !both.is("-3"));
        let unnamed = Name { text: None, id: None };
        assert!(!unnamed.is("#") && !unnamed.is("") && !unnamed.is("#x"));
        assert!(named("#3").is("#3"), "a name that looks like a number");
    }

    #[test]
    fn two_bodies_of_the_name_are_none() {
        let there = Placement { pos_v: [9.0; 3], ..HERE };
        let bodies = [
            (named("box"), Some(there)),
            (named("tello"), Some(HERE)),
            (named("tello"), Some(there)),
        ];
        let (poses, malformed, others) = picked(&bodies, Absence::Lost);
        assert_eq!((poses, malformed, others), (vec![None], 0, 0));
        let (poses, ..) = picked(&bodies[..2], Absence::Lost);
        assert_eq!(poses, [Some(Pose::new(1.0, 2.0, 3.0, 0.0))]);
        // Lost first: a second one of the name does not stand in for it.
        let bodies = [(named("tello"), None), (named("tello"), Some(there))];
        assert_eq!(picked(&bodies, Absence::Lost), (vec![None], 0, 0));
    }

    #[test]
    fn a_frame_without_the_object_reports_it_lost_only_if_it_is_whole() {
        let others = [(named("box"), Some(HERE))];
        assert_eq!(picked(&others, Absence::Lost), (vec![None], 0, 1));
        assert_eq!(picked(&others, Absence::Unknown), (vec![], 0, 1));
        assert_eq!(picked(&[], Absence::Lost), (vec![None], 0, 1));
        assert_eq!(picked(&[], Absence::Unknown), (vec![], 0, 0));
        let nameless = [(Name { text: None, id: Some(3) }, Some(HERE))];
        assert_eq!(picked(&nameless, Absence::Unknown), (vec![], 0, 0));
    }

    #[test]
    fn a_place_that_is_no_number_is_a_malformed_frame_and_no_loss() {
        let bodies = [(named("tello"), Some(Placement { pos_v: [f64::NAN, 0.0, 0.0], ..HERE }))];
        assert_eq!(picked(&bodies, Absence::Lost), (vec![], 1, 0));
    }
}
