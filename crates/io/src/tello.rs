//! The Tello: binary protocol, gate, link.
