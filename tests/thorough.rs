//! Tests that fly in real time over sockets, run programs that we did not write, or compute for long:
//! `cargo test --test thorough`, part of `.ci/run all`.
//!
//! One program: its flights go on side by side.

#[cfg(feature = "live")]
mod accessibility;
mod bench;
mod by_hand;
mod chromium;
mod commands;
mod drone_link;
mod drone_python;
mod excite;
mod faults_late;
mod faults_program;
mod flight_sources;
mod ident;
mod install;
#[cfg(feature = "live")]
mod keyboard;
mod link_recordings;
#[cfg(feature = "live")]
mod live_foxglove;
#[cfg(feature = "live")]
mod live_view;
mod log_python;
mod mocap_foreign;
mod mocap_python;
mod monitor_recordings;
mod pictures;
mod prediction;
mod program;
mod python;
mod readme;
mod recorded;
mod reference_bootstrap;
mod refusals;
mod report_browser;
mod report_page;
mod rig;
mod support;
