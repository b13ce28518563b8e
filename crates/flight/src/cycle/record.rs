//! The log's channels: one table, used by the writer, the replay and the documentation.

mod rows;

use horizon_model::Row;
use horizon_model::rows::{Pose, Sticks, pose, stick};
use schemars::{JsonSchema, Schema, schema_for};
use serde::{Deserialize, Serialize};
use strum::VariantArray;

use super::outcome::SolveFigures;
use super::walls::Clearance;
use super::{DeadTimeChange, Inbox, Outcome, Solve, Timing};
use crate::jitter::Jitter;
use crate::{Acceptance, Fault, Findings, LinkDecision, Phase};

pub use rows::RowsRecord;
use rows::rows_schema;

/// A channel of the log: `/subject/what`, one JSON record per tick at most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, VariantArray)]
pub enum Topic {
    /// [`Inbox`]: all that a replay needs; the first record of each tick.
    Inbox,
    /// Newest raw pose of the tick.
    Raw,
    /// Pose after the outlier filter, and what it accepted.
    Filtered,
    /// State estimate.
    State,
    /// Parameter estimate.
    Parameter,
    /// Whether the sent sticks act.
    Link,
    /// How the estimator ended.
    Estimator,
    /// State predicted over the dead time.
    Prediction,
    /// Where the mission wants the vehicle to be at the prediction's time.
    Reference,
    /// Present target.
    Target,
    /// Planned sticks over the horizon.
    Plan,
    /// How the controller ended.
    Controller,
    /// Sticks that control asked for.
    Proposed,
    /// Sticks that were sent.
    Command,
    /// What the monitors found.
    Monitor,
    /// Phase of the flight.
    Phase,
    /// Present faults.
    Fault,
    /// Times of the tick, which a replay cannot repeat.
    Timing,
    /// How punctual the ticks were so far, once a second; a replay cannot repeat it either.
    Jitter,
}

impl Topic {
    /// Every channel, in the order in which a tick writes them.
    pub const ALL: &[Self] = Self::VARIANTS;

    /// Name of the channel in the log.
    pub fn name(self) -> &'static str {
        self.row().0
    }

    /// The channel whose [`Topic::name`] is `name`; `None` for a name that no tick writes.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|topic| topic.name() == name)
    }

    /// Name of the kind of record on the channel.
    pub fn schema_name(self) -> &'static str {
        self.row().1
    }

    /// JSON schema of the channel's records for a vehicle model with these rows.
    pub fn schema(self, state_rows: &[Row], parameter_rows: &[Row]) -> Schema {
        self.row().2(state_rows, parameter_rows)
    }

    /// Name of the channel, name of its kind of record, and [`Topic::schema`].
    fn row(self) -> (&'static str, &'static str, SchemaOf) {
        let state: SchemaOf = |state_rows, _| rows_schema(state_rows);
        match self {
            Self::Inbox => ("/cycle/inbox", "Inbox", of::<Inbox>),
            Self::Raw => ("/vicon/raw", "Pose", of::<PoseRecord>),
            Self::Filtered => ("/estim/filtered", "FilteredPose", of::<FilteredRecord>),
            Self::State => ("/estim/state", "State", state),
            Self::Parameter => ("/estim/parameter", "Parameter", |_, rows| rows_schema(rows)),
            Self::Link => ("/estim/link", "Link", of::<LinkRecord>),
            Self::Estimator => ("/estim/solve", "Solve", of::<SolveRecord>),
            Self::Prediction => ("/control/prediction", "State", state),
            Self::Reference => ("/control/reference", "Pose", of::<PoseRecord>),
            Self::Target => ("/control/target", "Target", of::<TargetRecord>),
            Self::Plan => ("/control/plan", "Plan", of::<PlanRecord<'_>>),
            Self::Controller => ("/control/solve", "Solve", of::<SolveRecord>),
            Self::Proposed => ("/control/input", "Sticks", of::<SticksRecord>),
            Self::Command => ("/tello/command", "Sticks", of::<SticksRecord>),
            Self::Monitor => ("/supervisor/monitor", "Monitor", of::<MonitorRecord>),
            Self::Phase => ("/supervisor/phase", "Phase", of::<PhaseRecord>),
            Self::Fault => ("/supervisor/fault", "Fault", of::<FaultRecord>),
            Self::Timing => ("/cycle/timing", "Timing", of::<Timing>),
            Self::Jitter => ("/cycle/jitter", "Jitter", of::<Jitter>),
        }
    }
}

/// Schema of a record for a vehicle model with these rows of state and parameter.
type SchemaOf = fn(&[Row], &[Row]) -> Schema;

/// [`SchemaOf`] a record that has the same fields for every vehicle model.
fn of<R: JsonSchema>(_state_rows: &[Row], _parameter_rows: &[Row]) -> Schema {
    schema_for!(R)
}

/// Takes the records of a tick one by one: a log, or a comparison with one.
pub trait Sink {
    /// Why a record could not be taken.
    type Error;

    /// Takes the next record.
    ///
    /// # Errors
    /// Whatever keeps the sink from taking it.
    fn put<R: Serialize>(&mut self, topic: Topic, record: &R) -> Result<(), Self::Error>;
}

impl Outcome {
    /// Hands every record of the tick to `sink`, in the order of [`Topic::ALL`].
    ///
    /// Real time: allocates what the sink does.
    ///
    /// # Errors
    /// The first error of the sink.
    pub fn records<S: Sink>(&self, sink: &mut S) -> Result<(), S::Error> {
        let step = self.step;
        if let Some(raw) = &self.raw {
            sink.put(Topic::Raw, &PoseRecord::new(step, raw))?;
        }
        if let Some(filtered) = &self.filtered
            && let Some(o) = &filtered.o
        {
            let pose = PoseRecord::new(step, o);
            let (position, heading) = (filtered.position, filtered.heading);
            sink.put(Topic::Filtered, &FilteredRecord { pose, position, heading })?;
        }
        put_rows(sink, Topic::State, step, self.state_rows, &self.s_hat)?;
        put_rows(sink, Topic::Parameter, step, self.parameter_rows, &self.p_hat)?;
        if let Some(link) = &self.link {
            let record = LinkRecord::new(step, link, self.dead_time);
            sink.put(Topic::Link, &record)?;
        }
        put_solve(sink, Topic::Estimator, step, (self.estimator.as_ref(), None))?;
        put_rows(sink, Topic::Prediction, step, self.state_rows, &self.s_pred)?;
        if let Some(reference) = &self.reference {
            sink.put(Topic::Reference, &PoseRecord::new(step, reference))?;
        }
        let target = TargetRecord {
            pose: PoseRecord::new(step, &self.target),
            targets_reached: self.targets_reached,
        };
        sink.put(Topic::Target, &target)?;
        if !self.plan.is_empty() {
            sink.put(Topic::Plan, &PlanRecord { step, lag: self.plan_lag, sticks: &self.plan })?;
        }
        put_solve(sink, Topic::Controller, step, (self.controller.as_ref(), self.clearance))?;
        sink.put(Topic::Proposed, &SticksRecord::new(step, &self.u_proposed))?;
        sink.put(Topic::Command, &SticksRecord::new(step, &self.u_sent))?;
        if let Some(findings) = self.findings {
            sink.put(Topic::Monitor, &MonitorRecord { step, findings })?;
        }
        if let Some(decision) = &self.decision {
            sink.put(Topic::Phase, &PhaseRecord { step, phase: decision.phase })?;
            if !decision.faults.is_empty() {
                let faults = decision.faults.iter().collect();
                sink.put(Topic::Fault, &FaultRecord { step, faults })?;
            }
        }
        Ok(())
    }
}

fn put_rows<S: Sink>(
    sink: &mut S,
    topic: Topic,
    step: u64,
    rows: &[Row],
    values: &[f64],
) -> Result<(), S::Error> {
    if values.is_empty() { Ok(()) } else { sink.put(topic, &RowsRecord { step, rows, values }) }
}

fn put_solve<S: Sink>(
    sink: &mut S,
    topic: Topic,
    step: u64,
    (solve, clearance): (Option<&Solve>, Option<Clearance>),
) -> Result<(), S::Error> {
    let (report, error) = match solve {
        None => return Ok(()),
        Some(Solve::Done(report)) => (Some(*report), None),
        Some(Solve::Failed(error)) => (None, Some(error.to_string())),
    };
    sink.put(topic, &SolveRecord { step, report, error, clearance })
}

/// A pose of a step.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub struct PoseRecord {
    step: u64,
    /// World x. m
    x: f64,
    /// World y. m
    y: f64,
    /// World z, up. m
    z: f64,
    /// Measured yaw. rad
    theta: f64,
}

impl PoseRecord {
    /// The record of the pose `o` (rows `pose`, world, m and rad) in step `step`.
    pub fn new(step: u64, o: &Pose) -> Self {
        Self { step, x: o[pose::X], y: o[pose::Y], z: o[pose::Z], theta: o[pose::THETA] }
    }

    /// The pose, rows `pose`, in the world frame. m, rad
    pub fn pose(&self) -> Pose {
        Pose::new(self.x, self.y, self.z, self.theta)
    }
}

/// What the filter made of the raw poses of a step.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub struct FilteredRecord {
    /// What the filter lets through.
    #[serde(flatten)]
    pub pose: PoseRecord,
    /// Whether x, y and z were accepted.
    pub position: Acceptance,
    /// Whether theta was accepted.
    pub heading: Acceptance,
}

#[derive(Serialize, JsonSchema)]
struct TargetRecord {
    #[serde(flatten)]
    pose: PoseRecord,
    /// Number of targets reached so far.
    targets_reached: usize,
}

/// Sticks of a step.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub struct SticksRecord {
    step: u64,
    /// To the right. 1
    roll: f64,
    /// Forward. 1
    pitch: f64,
    /// Counter-clockwise from above. 1
    yaw: f64,
    /// Up. 1
    throttle: f64,
}

impl SticksRecord {
    /// The record of the sticks `u` (rows `stick`, -1..=1) in step `step`.
    pub fn new(step: u64, u: &Sticks) -> Self {
        Self {
            step,
            roll: u[stick::ROLL],
            pitch: u[stick::PITCH],
            yaw: u[stick::YAW],
            throttle: u[stick::THROTTLE],
        }
    }

    /// The sticks, rows `stick`, in -1..=1. 1
    pub fn sticks(&self) -> Sticks {
        // The order of the rows of `stick`.
        Sticks::new(self.roll, self.pitch, self.yaw, self.throttle)
    }
}

#[derive(Serialize, JsonSchema)]
struct PlanRecord<'a> {
    step: u64,
    /// Ticks since the plan was solved; null without a plan.
    lag: Option<u32>,
    /// Roll, pitch, yaw, throttle for each step of the horizon. 1
    sticks: &'a [[f64; stick::COUNT]],
}

#[derive(Serialize, JsonSchema)]
struct SolveRecord {
    step: u64,
    /// Null if the solve failed.
    report: Option<SolveFigures>,
    /// Null unless the solve failed.
    error: Option<String>,
    /// How near the plan comes to walls and obstacles; missing if it stays 1 m away or knows none.
    #[serde(skip_serializing_if = "Option::is_none")]
    clearance: Option<Clearance>,
}

/// What the monitors found in a step.
#[derive(Serialize, JsonSchema)]
struct MonitorRecord {
    step: u64,
    #[serde(flatten)]
    findings: Findings,
}

/// Whether the sent sticks of a step act.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub struct LinkRecord {
    step: u64,
    /// Whether the sent sticks do not act.
    pub is_down: bool,
    /// Log likelihood ratio, less the evidence that a change takes: positive exactly while the link is down. 1
    score: f64,
    /// Correction of the dead time of roll and pitch; missing where they stay as configured. s
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dead_time_change_s: Option<f64>,
    /// What is missing from that by the latest motion that shows it; missing before. s
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dead_time_error_s: Option<f64>,
    /// Correction of the dead time of the throttle. s
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub throttle_change_s: Option<f64>,
    /// Correction of the dead time of yaw. s
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub yaw_change_s: Option<f64>,
}

impl LinkRecord {
    /// The record of `decision` and of the corrections of the dead times in step `step`.
    fn new(step: u64, decision: &LinkDecision, change: Option<DeadTimeChange>) -> Self {
        let change_s = |axis: usize| change.map(|change| change.change_s[axis]);
        Self {
            step,
            is_down: decision.state.is_down(),
            score: decision.score,
            dead_time_change_s: change_s(stick::PITCH),
            dead_time_error_s: change.and_then(|change| change.error).map(|error| error.mean_s),
            throttle_change_s: change_s(stick::THROTTLE),
            yaw_change_s: change_s(stick::YAW),
        }
    }
}

/// Phase after a step.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub struct PhaseRecord {
    step: u64,
    /// Phase of the flight from this step on.
    pub phase: Phase,
}

#[derive(Serialize, JsonSchema)]
struct FaultRecord {
    step: u64,
    faults: Vec<Fault>,
}

#[cfg(test)]
mod tests;
