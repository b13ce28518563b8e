//! The links over real sockets, in real time. One program: its tests wait side by side.

#[path = "links/tello_client.rs"]
mod tello_client;
#[path = "links/tello_guardian.rs"]
mod tello_guardian;
#[path = "links/tello_landing.rs"]
mod tello_landing;
#[path = "links/tello_text_client.rs"]
mod tello_text_client;
#[path = "links/vicon_client.rs"]
mod vicon_client;
#[path = "links/vicon_sources.rs"]
mod vicon_sources;
