//! Output of a mocap source: frames of one object, or a reason to refuse a message or to give the connection up.

use horizon_model::rows::Pose;
use thiserror::Error;

use crate::clock::SpanNs;

/// Report of the source on the vehicle in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SourceFrame {
    /// Number of the frame.
    pub number: i64,
    /// Frames per second, finite; 0 or less while it is not known. Hz
    pub rate_hz: f64,
    /// When it was measured by the source's own clock, if it reports that. ns
    pub stamp: Option<SpanNs>,
    /// Age of the frame when it was sent, as far as the source reports it. ns, >= 0
    pub latency: SpanNs,
    /// Pose in the world frame, heading in [-pi, pi]; `None` if the system does not see the vehicle. m, rad
    pub pose: Option<Pose>,
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
    #[error("a packet of {length} bytes exceeds the limit of {max}")]
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
    #[error("QTM reports: {text}")]
    Qtm {
        /// Its words.
        text: String,
    },
    /// Another axis points up than in the settings.
    #[error("the mocap system's {up} axis points up: set frame.axes so that its third is {up:?}")]
    Up {
        /// Axis that points up.
        up: String,
    },
    /// A connection begins with other bytes than a VRPN server's.
    #[error("this is no VRPN server of version 7")]
    NoVrpn,
}

/// Why a message was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum Refusal {
    /// It is cut off, or has other parts than a message of its kind.
    #[error("a message has another form than its protocol's")]
    Form,
    /// A line that has other fields behind the object's name than it may have.
    #[error(
        "fields behind the object's name are too many or in another order: has the name a space, or is the flag behind \
         it no whole number?"
    )]
    Fields,
    /// A frame number with a fraction, or beyond 64 bits.
    #[error("a frame number is not a whole number")]
    FrameNumber,
    /// Text in place of a number, NaN or infinity.
    #[error("a number is missing or not finite")]
    Number,
    /// A rotation that is none.
    #[error(
        "a rotation is none: a quaternion of another length than 1, or a matrix with rows that are not unit and orthogonal"
    )]
    Rotation,
    /// The object lies on its side or head.
    #[error(
        "the object's top is further than 60 degrees from up: are the axes right, and quaternions x y z w?"
    )]
    Top,
    /// A sender that was not described.
    #[error("a sender has no name")]
    Sender,
}
