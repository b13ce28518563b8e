//! Tests of the whole program in virtual time and of its files: `cargo test` runs them.
//!
//! One program, linked once. What waits for real time or computes for long is in `thorough.rs` or ignored here,
//! and `.ci/run all` runs it; what counts allocations has a program of its own.

mod batch;
mod campaign;
mod closed_loop;
mod convert;
mod faults;
mod filter_recordings;
mod golden;
mod logs;
mod older_log;
mod parameters;
mod parts;
mod program;
mod reference_ident;
mod reference_mhe;
mod reference_mpc;
mod replay;
mod replay_forecast;
mod report;
mod report_page;
mod support;
mod walls;
mod wrong_settings;
