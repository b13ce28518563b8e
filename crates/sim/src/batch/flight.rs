//! One flight of a batch, from its first tick to its end.

use std::borrow::Cow;

use anyhow::Result;
use horizon_model::rows::{Pose, pose};
use horizon_model::setting::SettingError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tello_eval::metrics::{
    Fence, Hover, HoverScore, Judge, LeastClearance, OutageCounter, Outages, ReferencePath, Score,
    Surroundings,
};
use tello_eval::part_file::Seeded;
use tello_flight::cycle::{FlightTable, Outcome, Solve};
use tello_flight::{Fault, Mission, Phase, Pilot};

use super::earlier_flights;
use crate::SimTable;
use crate::virtual_time::VirtualFlight;

/// Virtual time after which a flight of a short mission counts as unfinished, beside the time of a hover. s
pub(super) const TIME_LIMIT_S: f64 = 120.0;

/// Margin of the time limit of a long mission, beside twice the planned time. s
const TIME_MARGIN_S: f64 = 30.0;

/// A controller with what it is to fly.
#[derive(Debug, Clone)]
pub struct Contender {
    pub(super) flight: FlightTable,
    pub(crate) reference: ReferencePath,
    /// Virtual time after which a flight counts as unfinished, beside the time of a hover. s
    pub(super) time_limit_s: f64,
    /// Time to hover at the first target in place of the reference. s
    hover_s: Option<f64>,
    /// Flights of the vehicle before the judged one.
    earlier: u32,
}

impl Seeded for Flown {
    fn seed(&self) -> Option<u64> {
        Some(self.row.seed)
    }
}

/// Entries of [`Flown::distances_m`]: the poses by which the distances are measured.
pub(crate) mod source {
    /// The true poses.
    pub(crate) const TRUTH: usize = 0;
    /// The controller's own estimates.
    pub(crate) const ESTIMATE: usize = 1;
    /// Number of entries.
    pub(crate) const COUNT: usize = 2;
}

/// A flight, and of it what a table or picture of many flights needs.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Flown {
    /// Its row of the table.
    pub row: FlightRow,
    /// Horizontal distances to the outline from start to end: of the true poses, of the estimates. m
    pub distances_m: [Vec<f64>; source::COUNT],
    /// True x and y at each tick in flight; not in part files. m
    #[serde(skip)]
    pub track_w: Vec<(f64, f64)>,
}

/// One flight of a batch.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct FlightRow {
    /// Seed of the plant, its faults and the start.
    pub seed: u64,
    /// How it ended.
    pub ending: Ending,
    /// Virtual time after which it counts as unfinished, beside the time of a hover. s
    #[serde(default = "time_limit_s")]
    pub time_limit_s: f64,
    /// Targets that the controller counted as reached.
    #[serde(default)]
    pub targets_reached: usize,
    /// The faults that ended it, if it landed early.
    pub landed_by: Vec<Fault>,
    /// Figures by the true pose; null if the controller never reached its first target.
    pub by_truth: Option<Score>,
    /// Figures by the controller's own estimate, as a real log has them.
    pub by_estimate: Option<Score>,
    /// Largest true offset from the outline while flying.
    pub fence: Fence,
    /// Least true distance to walls and obstacles while flying.
    #[serde(default)]
    pub clearance: LeastClearance,
    /// Figures of a hover by the true pose; null if it was not asked for or did not last.
    pub hover: Option<HoverScore>,
    /// Commands lost in flight, as the link monitor saw it.
    pub outages: Outages,
    /// How near the flight came to the limits of the monitors.
    pub monitors: Largest,
    /// Failures of the solvers.
    pub solvers: SolverCounts,
}

/// Of rows that were written before long missions had more time. s
fn time_limit_s() -> f64 {
    TIME_LIMIT_S
}

/// Largest values that the monitors found in a flight.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Largest {
    /// Displacement by the poses against the drone's velocity. m
    pub displacement_error_m: f64,
    /// Height by the poses against the drone's. m
    pub height_error_m: f64,
    /// Angle between inputs and motion. rad
    pub direction_error_rad: f64,
    /// Time in which the poses were too still. s
    pub still_s: f64,
    /// By how much the estimate went away from the reference: its distance less the least one before. m
    pub tracking_m: f64,
    /// Inputs in one direction that moved nothing. s of full deflection
    #[serde(default)]
    pub pressed_s: f64,
    /// Speed by the estimate. m/s
    pub speed_mps: f64,
}

/// How a flight ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// The true pose reached the last target, or the hover lasted as long as asked.
    Finished,
    /// The controller was done and landed, but the true pose had not reached a target.
    Missed,
    /// It landed before the controller was done: a fault.
    Landed,
    /// The time was over before.
    #[default]
    TimeLimit,
}

/// Ticks in which something went wrong in the solvers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct SolverCounts {
    /// Ticks in flight.
    pub ticks: u64,
    /// The estimator had no result and started anew.
    pub estimator_failures: u64,
    /// The controller had no result.
    pub controller_failures: u64,
    /// An older plan was flown, because there was no new one.
    pub old_plans: u64,
}

impl Contender {
    /// A contender that flies `flight`, or hovers for `hover_s` at its first target.
    ///
    /// # Errors
    /// A mission that breaks its rules.
    pub fn new(flight: FlightTable, hover_s: Option<f64>) -> Result<Self, SettingError> {
        let flight = match hover_s {
            Some(hover_s) => ReferencePath::hold_first(&flight, Hover::hold_s(hover_s) + 1.0)?,
            None => flight,
        };
        let planned_s = Mission::new(&flight.mission, flight.cycle.dt_s)?.survey().duration_s;
        Ok(Self {
            reference: ReferencePath::of(&flight)?,
            flight,
            time_limit_s: TIME_LIMIT_S.max(2.0 * planned_s + TIME_MARGIN_S),
            hover_s,
            earlier: 0,
        })
    }

    /// The contender on the flight after `earlier` flights, starting from the vehicle file that these leave.
    #[must_use]
    pub fn after(self, earlier: u32) -> Self {
        Self { earlier, ..self }
    }

    /// Everything that its flights depend on beside the simulator and the seed.
    pub fn settings(&self) -> serde_json::Value {
        serde_json::json!({ "flight": self.flight, "hover_s": self.hover_s, "earlier": self.earlier })
    }

    /// Outlines of the obstacles from above. m
    ///
    /// # Errors
    /// An obstacle that breaks its rule.
    pub fn obstacles(&self) -> Result<Vec<Vec<(f64, f64)>>, SettingError> {
        Surroundings::of(&self.flight.cycle).map(|surroundings| surroundings.outlines())
    }

    /// x and y of the line that it follows. m
    pub fn outline(&self) -> Vec<(f64, f64)> {
        self.reference.outline.iter().map(|at| (at[pose::X], at[pose::Y])).collect()
    }

    /// The flight of `seed`.
    ///
    /// # Errors
    /// A setting that breaks its rule.
    pub(crate) fn fly(&self, sim: &SimTable, seed: u64) -> Result<Flown> {
        let flight = match self.earlier {
            0 => Cow::Borrowed(&self.flight),
            count => Cow::Owned(earlier_flights::after(count, self, sim, seed)?),
        };
        let mut virtual_flight = VirtualFlight::new(&flight, sim, seed)?.without_plan();
        let dt_s = self.flight.cycle.dt_s;
        let time_limit_s = self.time_limit_s + self.hover_s.unwrap_or(0.0);
        let mut measures = FlightMeasures::new(self)?;
        let mut row = FlightRow { seed, time_limit_s: self.time_limit_s, ..FlightRow::default() };
        row.ending = loop {
            let out = virtual_flight.tick()?;
            row.targets_reached = out.targets_reached;
            if out.phase() != Phase::Flying {
                let reached_all = row.targets_reached == self.reference.targets_count;
                let is_done = measures.hover.as_ref().map_or(reached_all, Hover::is_done);
                let faults = out.decision.map(|decision| decision.faults).filter(|_| !is_done);
                let faults = faults.unwrap_or_default().ending_flight(Pilot::Controller);
                row.landed_by.extend(faults.iter());
                break if is_done { Ending::Missed } else { Ending::Landed };
            }
            let now_s = out.step as f64 * dt_s;
            let u_sent = out.u_sent;
            measures.add_outcome(out, now_s, dt_s);
            let at = virtual_flight.true_pose();
            measures.truth.add(now_s, &at, &u_sent, row.targets_reached);
            measures.add_place(&at, virtual_flight.true_obstacle_w(), now_s);
            if measures.is_over() || now_s >= time_limit_s {
                break Ending::TimeLimit;
            }
        };
        Ok(measures.judged(row))
    }
}

/// Measurements of a flight while it lasts.
struct FlightMeasures {
    truth: Judge,
    estimate: Judge,
    hover: Option<Hover>,
    solvers: SolverCounts,
    outages: OutageCounter,
    monitors: Largest,
    surroundings: Surroundings,
    clearance: LeastClearance,
    track_w: Vec<(f64, f64)>,
}

impl FlightMeasures {
    fn new(contender: &Contender) -> Result<Self, SettingError> {
        let Contender { flight, reference, hover_s, .. } = contender;
        let judge = Judge::new(reference, flight.cycle.dt_s);
        let hover = hover_s.zip(reference.targets.first());
        Ok(Self {
            truth: judge.clone(),
            estimate: judge,
            hover: hover.map(|(hover_s, target)| Hover::new(target, hover_s)),
            solvers: SolverCounts::default(),
            outages: OutageCounter::default(),
            monitors: Largest::default(),
            surroundings: Surroundings::of(&flight.cycle)?,
            clearance: LeastClearance::default(),
            track_w: Vec::new(),
        })
    }

    /// Counts what the tick at `now_s` found.
    fn add_outcome(&mut self, out: &Outcome, now_s: f64, dt_s: f64) {
        self.solvers.count(out);
        self.monitors.raise(out);
        self.outages.add(out, dt_s);
        if let Some(pose_hat) = out.pose_hat() {
            self.estimate.add(now_s, &pose_hat, &out.u_sent, out.targets_reached);
        }
    }

    /// Adds the true pose at `now_s`, after `truth`, and the place of a moving obstacle.
    fn add_place(&mut self, at: &Pose, obstacle_w: Option<[f64; 3]>, now_s: f64) {
        self.clearance.add(self.surroundings.at(at, obstacle_w));
        self.track_w.push((at[pose::X], at[pose::Y]));
        if let Some(hover) = &mut self.hover {
            hover.add(now_s, at, self.truth.has_begun());
        }
    }

    /// Whether nothing more is to be measured.
    fn is_over(&self) -> bool {
        let has_finished = self.truth.is_finished() && self.estimate.is_finished();
        self.hover.as_ref().map_or(has_finished, Hover::is_done)
    }

    /// The flight of `row`, with its figures.
    fn judged(self, mut row: FlightRow) -> Flown {
        if self.hover.as_ref().map_or(self.truth.is_finished(), Hover::is_done) {
            (row.ending, row.landed_by) = (Ending::Finished, Vec::new());
        }
        let row = FlightRow {
            by_truth: self.truth.score(),
            by_estimate: self.estimate.score(),
            fence: self.truth.fence(),
            clearance: self.clearance,
            hover: self.hover.and_then(|hover| hover.score()),
            outages: self.outages.outages(),
            monitors: self.monitors,
            solvers: self.solvers,
            ..row
        };
        let distances_m = [&self.truth, &self.estimate].map(|judge| judge.distances_m().to_vec());
        Flown { row, distances_m, track_w: self.track_w }
    }
}

impl Largest {
    fn raise(&mut self, out: &Outcome) {
        let Some(findings) = out.findings else { return };
        let raise = |largest: &mut f64, value: f64| *largest = largest.max(value);
        raise(&mut self.displacement_error_m, findings.displacement_error_m);
        raise(&mut self.height_error_m, findings.height_error_m);
        raise(&mut self.direction_error_rad, findings.direction_error_rad.unwrap_or(0.0).abs());
        raise(&mut self.still_s, findings.still_s.unwrap_or(0.0));
        raise(&mut self.tracking_m, out.tracking_m.unwrap_or(0.0));
        raise(&mut self.pressed_s, out.pressed_s);
        raise(&mut self.speed_mps, out.speed_mps);
    }
}

impl SolverCounts {
    fn count(&mut self, out: &Outcome) {
        let has_failed = |solve: &Option<Solve>| u64::from(matches!(solve, Some(Solve::Failed(_))));
        self.ticks += 1;
        self.estimator_failures += has_failed(&out.estimator);
        self.controller_failures += has_failed(&out.controller);
        self.old_plans += u64::from(out.plan_lag.is_some_and(|lag| lag > 0));
    }

    /// Both together.
    pub(super) fn plus(self, other: Self) -> Self {
        Self {
            ticks: self.ticks + other.ticks,
            estimator_failures: self.estimator_failures + other.estimator_failures,
            controller_failures: self.controller_failures + other.controller_failures,
            old_plans: self.old_plans + other.old_plans,
        }
    }
}

#[cfg(test)]
mod tests {
    use tello_flight::Start;
    use tello_io::config;

    use super::*;

    /// A circle counts two targets, the judge five places on it.
    const CIRCLE: &str = r#"{"circle": {
        "centre": [0.0, 0.0, 1.2, 0.0], "radius_m": 0.6, "begin_rad": 0.0, "turns": 1.0,
        "direction": "counter_clockwise", "heading": "fixed",
        "limits": {
            "speed_max_mps": 0.6, "accel_max_mps2": 0.6, "climb_max_mps": 0.3,
            "turn_max_radps": 1.0
        },
        "follow": {
            "reach": 0.2, "start": { "within": 0.1, "settle_s": 1.0 },
            "wait": { "begin_m": 0.15, "stop_m": 0.4 }
        }
    }}"#;

    #[test]
    fn a_circle_that_only_the_controller_counts_as_flown_is_missed_and_no_fault() {
        let (fly, _) = config::fly(None, None).unwrap();
        let sim = crate::settings(None).unwrap();
        let circle = serde_json::from_str(CIRCLE).unwrap();
        let flight = config::flight(&fly, circle, Start::Airborne);
        let mut contender = Contender::new(flight, None).unwrap();
        let finished = contender.fly(&sim, 1).unwrap().row;
        assert_eq!(finished.ending, Ending::Finished, "{finished:?}");
        contender.reference.reach = 1e-9;
        let missed = contender.fly(&sim, 1).unwrap().row;
        assert_eq!(missed.ending, Ending::Missed, "{missed:?}");
        assert_eq!(missed.by_truth.unwrap().metrics.finish_s, None);
    }
}
