//! Motion capture: six protocols, and what all have in common.
//!
//! Owns what a frame is, its clock, its axes and its object. The protocols are pure, from bytes to frames, and
//! back for emulators: the thesis' text relay `relay`, Vicon's `object_stream` and `datastream`, OptiTrack's
//! `natnet`, Qualisys' `qtm`, and `vrpn`. Sockets are in `wire`. Whether a sample is accepted is decided by the
//! filter in `tello-flight`, not here.

mod axes;
mod body;
mod bytes;
mod client;
pub mod datastream;
mod frame_clock;
mod lines;
pub mod natnet;
pub mod object_stream;
mod protocol;
pub mod qtm;
mod relay;
mod settings;
mod source;
mod source_clock;
mod stamp_numbers;
mod statistics;
mod stream;
mod survey;
pub mod vrpn;
mod wire;

pub use axes::{Axes, FrameTable, Placement, SourceAxis, Unit, quaternion_of_matrix};
pub use body::{ABOUT_Z, Body, matrix_of_angles};
pub use client::{MocapClient, MocapFeed};
pub use lines::Lines;
pub use relay::{RelayPose, format_line, parse_line};
pub use settings::{
    MocapKind, MocapSettings, MocapTable, NatnetTable, QtmTable, ServerTable, UdpTable, VrpnTable,
};
pub use source::{Refusal, SourceError, SourceFrame};
pub use stamp_numbers::StampNumbers;
pub use statistics::{MocapCounters, SincePose, StreamReport};
pub use stream::MocapStream;
pub use survey::{Survey, SurveyTrack, TrackReport, survey};
pub use tello_flight::Sighting;

/// Metres per millimetre.
const M_PER_MM: f64 = 1e-3;
