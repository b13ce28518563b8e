//! Checks of a real drone at the bench: what is sent, what the packets mean, what their record shows.
//!
//! Pure. The dialogue and the sockets are the command's, `tello-ctl bench`.

pub mod checks;
pub mod evidence;
pub mod wire;
