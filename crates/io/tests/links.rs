//! The links over real sockets, in real time. One program: its tests wait side by side.

#[path = "links/mocap_client.rs"]
mod mocap_client;
#[path = "links/mocap_sources.rs"]
mod mocap_sources;
#[path = "links/tello_client.rs"]
mod tello_client;
#[path = "links/tello_guardian.rs"]
mod tello_guardian;
#[path = "links/tello_landing.rs"]
mod tello_landing;
#[path = "links/tello_text_client.rs"]
mod tello_text_client;
