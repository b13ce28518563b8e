//! The Vicon system, in the three ways in which it sends poses.
//!
//! Owns what a mocap sample is and what all sources have in common. The thesis' text relay is `vicon::relay`,
//! Tracker's UDP object stream `vicon::object_stream`, the DataStream server `vicon::datastream`; each is
//! pure, from bytes to frames, and back for emulators. Sockets are `vicon::client`. Whether a sample is
//! believed is decided by the filter in `tello-flight`, not here.

mod all;
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
mod statistics;
mod stream;
mod survey;
pub mod vrpn;
mod wire;

pub use axes::{Axes, Axis, FrameTable, Placement, Unit, quaternion_of_matrix};
pub use body::{Body, matrix_of_angles};
pub use client::{ViconClient, ViconFeed};
pub use lines::{LINE_BYTES_MAX, Lines};
pub use protocol::{Head, Name, Taker};
pub use relay::{LineError, RelayPose, format_line, parse_line};
pub use settings::{
    NatnetTable, QtmTable, ServerTable, UdpTable, ViconSettings, ViconTable, VrpnTable,
};
pub use source::{Frame, SourceError};
pub use statistics::{StreamReport, ViconCounters};
pub use stream::ViconStream;
pub use survey::{Survey, Track, TrackReport, survey};
pub use tello_flight::Sighting;
