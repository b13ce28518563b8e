//! Settings of the tick, as written in JSON.

use horizon_estim::MheTable;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::baseline::{HeldObservations, Pipeline};
use super::planning_table::PlanningTable;
pub use super::standing_start::StandingTable;
use super::vehicle::ModelKind;
use crate::drone::Protocol;
use crate::gate::GateTable;
use crate::{
    FilterTable, LinkTable, MissionTable, MonitorTable, ObstacleTable, Start, SupervisorTable,
};

/// Period of a tick. Limits of the monitors count ticks of this length. s
pub const DT_S: f64 = 0.02;

/// Everything that the outcome of a tick depends on beside its inbox. Each log carries one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FlightTable {
    /// Whether the flight starts on the ground, in the air or carried by hand.
    pub start: Start,
    /// What to fly.
    pub mission: MissionTable,
    /// How to fly it.
    pub cycle: CycleTable,
    /// How sticks are sent, which decides how finely they are rounded.
    pub protocol: Protocol,
}

/// Settings of filter, estimator, controller, supervisor and gate, and how they are wired.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CycleTable {
    /// The vehicle model.
    pub model: ModelKind,
    /// Period of the loop: 50 Hz. s, 0.02
    pub dt_s: f64,
    /// When an estimate and a plan are used.
    pub pipeline: Pipeline,
    /// From when a tick is due until its solvers must be done, live only. s, 0.0001..=0.9 `dt_s`
    pub deadline_s: f64,
    /// From sending sticks until they act: roll, pitch, yaw, throttle. s, 0..=2
    pub dead_time_s: Vec<f64>,
    /// What the estimator gets while the filter holds a value.
    pub held_observations: HeldObservations,
    /// Whether an observation is one of the state of its measurement time, less than a period moved at the estimated
    /// rate; else, as in older settings and logs, as if it were measured at the tick.
    #[serde(default)]
    pub uses_measurement_time: bool,
    /// When the poses of a vehicle on the ground agree; missing, as in older settings and logs: 0.5 s within 0.1 m and
    /// 0.3 rad.
    #[serde(default)]
    pub standing: StandingTable,
    /// Outlier filter of the motion capture, thesis section 4.3.3.
    pub filter: FilterTable,
    /// Moving horizon estimator, thesis section 3.1.4.
    pub mhe: MheTable,
    /// Link monitor; null: sent sticks are taken to act. For the model lagged.
    #[serde(deserialize_with = "crate::present")]
    pub link: Option<LinkTable>,
    /// Model predictive controller, thesis section 3.1.5.
    pub mpc: PlanningTable,
    /// What stands in the room.
    #[serde(default)]
    pub obstacles: Vec<ObstacleTable>,
    /// Phases, faults and their reactions.
    pub supervisor: SupervisorTable,
    /// Whether motion capture, drone and commands show one motion.
    #[serde(default)]
    pub monitors: MonitorTable,
    /// Last check before the wire.
    pub gate: GateTable,
}

impl CycleTable {
    /// Fraction of each dead time that a correction in flight leaves at least. 1, 0..=1
    pub fn dead_time_min_ratio(&self) -> f64 {
        self.link.as_ref().map_or(0.0, |link| link.dead_time_min_ratio)
    }
}
