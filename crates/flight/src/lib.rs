//! The pure flight core: the tick with filter, monitors, estimator, supervisor, controller and gate.
//!
//! Owns the tick and what it is composed of, its settings and its records. A function here is a function
//! of its arguments: no clock, socket, file, environment, thread or randomness, and no crate below it has
//! sockets, files or a runtime. `tello-io` uses its types, not the reverse.
//!
//! Cost: functions for a tick have a line *Real time* with their cost. A function without that line may allocate.
//!
//! | file            | owns                                                                |
//! |-----------------|---------------------------------------------------------------------|
//! | `cycle.rs`      | one tick of the control loop, its settings and its log records      |
//! | `filter.rs`     | outlier filter of the motion capture (thesis section 4.3.3)         |
//! | `commanded.rs`  | velocity that sticks command                                        |
//! | `link.rs`       | whether the sent sticks act                                         |
//! | `monitor.rs`    | whether motion capture, drone and commands show one motion          |
//! | `targets.rs`    | target list, reach test, clipping (thesis equation 4.20)            |
//! | `obstacle.rs`   | what stands in the room                                             |
//! | `mission.rs`    | what to fly, and the reference over the horizon                     |
//! | `path.rs`       | curves through space and how fast they can be flown                 |
//! | `trajectory.rs` | poses over time                                                     |
//! | `supervisor.rs` | phases of a flight, faults and their reactions                      |
//! | `forgetting.rs` | exponential decay, leaky sum                                        |
//! | `ring.rs`       | ring buffer                                                         |
//! | `gate.rs`       | limits of the sticks, the last code before the wire                 |
//! | `sighting.rs`   | what motion capture reports                                         |
//! | `drone.rs`      | what the drone reports, and what it is ordered                      |
//! | `time.rs`       | moments and lengths of time                                         |
//! | `jitter.rs`     | how punctual the ticks are                                          |
//!
//! Letters and units: `docs/notation.md`. Derivations: `docs/model.md`.

mod commanded;
pub mod cycle;
pub mod drone;
mod filter;
mod forgetting;
pub mod gate;
pub mod jitter;
mod link;
mod mission;
mod monitor;
mod obstacle;
mod path;
mod ring;
mod sighting;
mod supervisor;
mod targets;
pub mod time;
mod trajectory;

use serde::{Deserialize, Deserializer};

pub use commanded::commanded_w_mps;
pub use filter::{Acceptance, FilterSettings, FilterTable, Filtered, PoseFilter};
pub use link::{
    DeadTimeError, DeadTimeTable, HeightTable, LinkDecision, LinkMonitor, LinkSettings, LinkState,
    LinkTable, TurnTable,
};
pub use mission::{
    CircleTable, CsvError, CsvErrors, Direction, FollowTable, LimitTable, Mission, MissionTable,
    PathPoint, PointsTable, Reference, SPEED_AS_WRITTEN, SplineTable, StartTable, Survey,
    TIMED_COUNT, TrajectoryTable, WaitTable, WaypointTable, falling_times, parse_csv,
};
pub use monitor::{
    Agreement, DroneMotion, Findings, MonitorSettings, MonitorTable, Monitors, Sample,
};
pub use obstacle::{Obstacle, ObstacleTable, SignedDistance, obstacles};
pub use path::Heading;
pub use sighting::Sighting;
pub use supervisor::{
    CLIMB_MAX_M, Decision, DroneReport, EstimatedMotion, Evidence, FailsafeTable, Fault, FaultSet,
    GROUND_MAX_M, HandInput, Incidents, ObstacleApproach, ObstacleEvidence, Operator, Outage,
    Phase, Pilot, PlanClearance, PoseEvidence, Reaction, Room, RoomTable, Start, Supervisor,
    SupervisorSettings, SupervisorTable, TrackingEvidence,
};
pub use targets::{TargetTable, Targets, clip_target};

/// An optional value whose key is required: serde lets the key of an `Option` be missing.
///
/// # Errors
/// As those of the value.
pub fn present<'de, T: Deserialize<'de>, D: Deserializer<'de>>(
    from: D,
) -> Result<Option<T>, D::Error> {
    Option::deserialize(from)
}
