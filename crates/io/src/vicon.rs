//! The Vicon system: relay protocol and client.
