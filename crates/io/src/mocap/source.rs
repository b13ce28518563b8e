//! What every mocap source has in common: bytes in, frames out.
//!
//! Owns the interface. What a new source takes is listed in `ARCHITECTURE.md`; measurement times, repeated frames,
//! statistics, queue and connections are shared by all.

use core::net::SocketAddrV4;
use std::fmt::Debug;

use horizon_model::rows::Pose;
use thiserror::Error;

use super::MocapCounters;
use crate::clock::SpanNs;

/// What the source says about the vehicle in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Number of the frame.
    pub number: i64,
    /// Frames per second, finite; 0 or less while it is not known. Hz
    pub rate_hz: f64,
    /// When it was measured by the source's own clock, if it says so. ns
    pub stamp: Option<SpanNs>,
    /// Age of the frame when it was sent, as far as the source reports it. ns, >= 0
    pub latency: SpanNs,
    /// Pose in the world frame, heading in [-pi, pi]; `None` if the system does not see the vehicle. m, rad
    pub pose: Option<Pose>,
}

/// One connection to a source beside the bytes that it receives, whatever they are read for.
pub(super) trait Connection: Debug + Send {
    /// Forgets the connection.
    fn restart(&mut self);

    /// Prepares what is to be sent without having been asked for: once when a connection begins, then about
    /// once a second.
    fn beat(&mut self) {}

    /// Appends what is to be sent to the server now, once.
    fn take_requests(&mut self, _to: &mut Vec<u8>) {}

    /// The multicast group that frames come by, once the server named it.
    fn group(&self) -> Option<SocketAddrV4> {
        None
    }
}

/// One way in which poses arrive. Pure: what it needs is in the bytes.
pub(super) trait Source: Connection {
    /// Takes in received bytes, a whole datagram or any piece of a stream, and calls `on_frame` for
    /// each frame that they complete. What is refused is counted, and the next message is read.
    ///
    /// # Errors
    /// The stream makes no sense from here on: only a new connection helps.
    fn push(
        &mut self,
        bytes: &[u8],
        counters: &MocapCounters,
        on_frame: &mut dyn FnMut(Frame),
    ) -> Result<(), SourceError>;
}

/// What a source makes of the bytes, which come in these pieces: its frames, and the counters.
#[cfg(test)]
pub(super) fn read(
    source: &mut dyn Source,
    pieces: impl IntoIterator<Item: AsRef<[u8]>>,
) -> (Vec<Frame>, MocapCounters) {
    let counters = MocapCounters::default();
    let mut frames = Vec::new();
    for piece in pieces {
        source.push(piece.as_ref(), &counters, &mut |frame| frames.push(frame)).unwrap();
    }
    (frames, counters)
}

/// Why a connection is given up.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum SourceError {
    /// The bytes are of another protocol, or of another place in the stream.
    #[error("a packet begins with {found:#010x}: is this a DataStream server?")]
    Magic {
        /// The first four bytes, little-endian.
        found: u32,
    },
    /// A packet that would be kept is longer than any that makes sense.
    #[error("a packet of {length} bytes, at most {max} are read")]
    TooLong {
        /// Announced length.
        length: u32,
        /// Longest that is read.
        max: usize,
    },
    /// The server cannot send what a pose needs.
    #[error("the server does not offer object {id}, which a pose needs")]
    NotOffered {
        /// Identity of the object on the wire.
        id: u32,
    },
    /// The world's second axis points up.
    #[error("the mocap system counts y upwards: set its vertical axis to z")]
    UpIsY,
    /// The server speaks another protocol than is read.
    #[error("the server speaks NatNet {major}.{minor}; 3 and 4 are read")]
    NatnetVersion {
        /// First number of its version.
        major: u8,
        /// Second number.
        minor: u8,
    },
    /// A connection begins with other words than a QTM server's.
    #[error("this is no QTM server, or its big-endian port: the little-endian one is 22223")]
    NoQtm,
    /// The QTM server refused what was asked for.
    #[error("QTM says: {text}")]
    Qtm {
        /// Its words.
        text: String,
    },
    /// Another axis points up than the settings say.
    #[error("the mocap system's {up} axis points up: set frame.axes so that its third is {up:?}")]
    Up {
        /// Axis that points up.
        up: String,
    },
    /// A connection begins with other bytes than a VRPN server's.
    #[error("this is no VRPN server of version 7")]
    NoVrpn,
}
