//! What to do: target lists, prediction over the dead time, model predictive control, supervision.
//!
//! Owns the decisions of a flight and nothing of its surroundings: no clock, socket, file,
//! environment, thread or randomness. Equal arguments give equal bits. Time limits come in as a
//! question that is asked once per iteration, so that a replay can repeat the answers.
//!
//! | file            | owns                                                                |
//! |-----------------|---------------------------------------------------------------------|
//! | `reference.rs`  | target list, reach test, clipping (thesis equation 4.20)            |
//! | `mission.rs`    | what to fly, and the reference over the horizon                      |
//! | `path.rs`       | curves through space and how fast they can be flown                 |
//! | `trajectory.rs` | poses over time                                                     |
//! | `predictor.rs`  | state after the inputs that are already sent (4.26)                 |
//! | `mpc.rs`        | inputs over the horizon (3.46-3.49) by sequential quadratic programming |
//! | `qp.rs`         | the quadratic subproblem, stage by stage or by Clarabel             |
//! | `monitor.rs`    | whether motion capture, drone and commands tell of one motion        |
//! | `supervisor.rs` | phases of a flight, faults and their reactions                      |
//!
//! Letters and units: `docs/notation.md`. Derivations: `docs/model.md`.

mod horizon;
mod mission;
mod monitor;
mod mpc;
mod path;
mod predictor;
pub mod qp;
mod reference;
mod supervisor;
mod trajectory;

pub use mission::{
    CircleTable, CsvError, Direction, FollowTable, LimitTable, Mission, MissionTable, PointsTable,
    Reference, SplineTable, StartTable, TIMED_COUNT, TrajectoryTable, WaitTable, WaypointTable,
    parse_csv,
};
pub use monitor::{
    Agreement, DroneMotion, Findings, MonitorSettings, MonitorTable, Monitors, Sample,
};
pub use mpc::{
    Ask, InputCost, Mpc, MpcSettings, MpcTable, QpKind, Report, SolveError, SolverSettings,
    SolverTable, Stop,
};
pub use path::Heading;
pub use predictor::predict;
pub use reference::{TargetTable, Targets, clip_target};
pub use supervisor::{
    DroneReport, Evidence, FailsafeTable, Fault, FaultSet, Motion, Operator, Order, Outage, Phase,
    Pilot, Reaction, Room, RoomTable, Ruling, Start, Supervisor, SupervisorSettings,
    SupervisorTable,
};
