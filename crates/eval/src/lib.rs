//! Evaluation of flights: recordings in; metrics, identified parameters, figures and reports out.
//!
//! | file                      | owns                                                                  |
//! |---------------------------|-----------------------------------------------------------------------|
//! | `bench.rs`                | checks of a real drone, and what their record shows                   |
//! | `flight_log.rs`           | which records a tick leaves in a log, and how a flight is found again |
//! | `excitation.rs`           | a flight for identification                                           |
//! | `recordings.rs`           | recorded flights from files and folders                               |
//! | `smooth.rs`               | the motion of a recorded flight, estimated without a vehicle model    |
//! | `outage.rs`               | lost commands, found from both sides of a moment                      |
//! | `forecast.rs`             | errors of forecasts of any maker                                      |
//! | `predicted_trajectory.rs` | predicted trajectory for viewers                                      |
//! | `display_rounding.rs`     | fewer points and digits for viewers                                   |
//! | `metrics.rs`              | metrics of a flight                                                   |
//! | `flight_summary.rs`       | the summary of a flight that is over                                  |
//! | `telemetry.rs`            | facts of a flight for its viewers                                     |
//! | `statistics.rs`           | quantiles and intervals                                               |
//! | `figure.rs`               | figures as SVG and PNG                                                |
//! | `scene.rs`                | the scene in a log, for viewers                                       |
//! | `ros2.rs`                 | a log as messages of ROS 2                                            |
//! | `log_tables.rs`           | a log as CSV tables                                                   |
//! | `replay.rs`               | recorded flights through the tick again                               |
//! | `ident.rs`                | identification from recordings, its files and figures                 |
//! | `parameter_file.rs`       | identified parameters on their way to settings                        |
//! | `part_file.rs`            | part files: rows of one process of many                               |
//! | `vehicle.rs`              | a parameter file that flights change                                  |
//! | `report.rs`               | flights as one page                                                   |
//!
//! It writes and reads files, and opens no socket.

pub mod bench;
pub mod display_rounding;
mod excitation;
pub mod figure;
pub mod flight_log;
pub mod flight_summary;
pub mod forecast;
pub mod ident;
pub mod log_tables;
pub mod metrics;
pub mod outage;
pub mod parameter_file;
pub mod part_file;
pub mod predicted_trajectory;
pub mod recordings;
pub mod replay;
pub mod report;
pub mod ros2;
pub mod scene;
pub mod smooth;
mod statistics;
pub mod telemetry;
pub mod vehicle;

pub use excitation::Excitation;
pub use statistics::{Centre, interval, quantile, quantiles, rate_interval};

/// The work was stopped by request before it was complete.
#[derive(Debug, thiserror::Error)]
#[error("stopped before {0}")]
pub struct Stopped(pub &'static str);

/// Git revision of the build, for logs and `--version`.
pub const REVISION: &str = env!("TELLO_CTL_REVISION");

/// Version of the program with its revision.
pub const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("TELLO_CTL_REVISION"), ")");
