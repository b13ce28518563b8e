//! Recordings in, numbers and pictures out.
//!
//! | file          | owns                                                               |
//! |---------------|--------------------------------------------------------------------|
//! | `smooth.rs`   | the motion of a recorded flight, estimated without a vehicle model |
//! | `outage.rs`   | lost commands, found from both sides of a moment                   |
//! | `forecast.rs` | errors of forecasts of any maker                                   |

pub mod forecast;
pub mod outage;
pub mod smooth;
