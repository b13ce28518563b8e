//! Reports of the drone on its motion, right or not.
//!
//! Owns the switches of [`StatusTable`]: what a real drone reports is not verified. The fields that carry
//! it are `wire`'s and `sdk`'s.

use std::collections::VecDeque;

use horizon_model::rows::pose;
use horizon_model::steps;

use crate::DT_S;
use crate::drone::{DronePhase, Truth};
use crate::firmware::{Axes, FlyingFlag, HeadingReport, Measured, StatusTable, VelocityReport};
use crate::plant::{STANDING_M, Velocity};

/// Quantities of one step that a report is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    velocity: Velocity,
    /// Error of the drone's own measurement of the velocity, world x and y. m/s
    own_error_w_mps: [f64; 2],
    /// Continuous. rad
    theta: f64,
    is_flying: bool,
    motor_s: f64,
}

/// The drone's view of itself.
#[derive(Debug, Clone)]
pub(crate) struct Reporter {
    table: StatusTable,
    /// The newest last; as many as the latest report needs.
    history: VecDeque<Sample>,
    steps_kept: usize,
    /// Drift of the height so far. m
    drift_m: f64,
    /// Heading at power-up. rad
    theta_start: f64,
    /// Drift of the heading so far. rad
    drift_rad: f64,
    /// Time for which it reports falsely that it flies. s
    claimed_s: f64,
}

impl Reporter {
    /// The reports of a drone that starts as `truth`.
    pub(crate) fn new(table: StatusTable, truth: &Truth) -> Self {
        let late_s = table.flying_late_s.max(table.velocity.late_s).max(table.heading.late_s);
        let steps_kept = 1 + steps(late_s, DT_S);
        let history = VecDeque::from([Sample::of(truth, [0.0; 2])]);
        Self {
            table,
            history,
            steps_kept,
            drift_m: 0.0,
            theta_start: truth.pose[pose::THETA],
            drift_rad: 0.0,
            claimed_s: 0.0,
        }
    }

    /// Advances by one step that ended with `truth`, from which the drone's own velocity differs by `own_error_w_mps`.
    pub(crate) fn advance(&mut self, truth: &Truth, own_error_w_mps: [f64; 2]) {
        if self.history.len() == self.steps_kept {
            self.history.pop_front();
        }
        self.history.push_back(Sample::of(truth, own_error_w_mps));
        self.drift_m += self.table.height_drift_mps * DT_S;
        self.drift_rad += self.table.heading.drift_radps * DT_S;
        self.claimed_s += if self.is_flying() { DT_S } else { 0.0 };
    }

    /// Whether it reports that it flies.
    pub(crate) fn is_flying(&self) -> bool {
        let is_so = self.sample(self.table.flying_late_s).is_some_and(|sample| sample.is_flying);
        match self.table.flying {
            FlyingFlag::Right => is_so,
            FlyingFlag::Inverted => !is_so,
            FlyingFlag::Standing => false,
            FlyingFlag::Flying => true,
        }
    }

    /// `truth` with the height, heading, velocity and motor time that are reported.
    pub(crate) fn reported(&self, truth: Truth) -> Truth {
        let StatusTable { flying, flying_late_s, velocity: report, has_height, heading, .. } =
            self.table;
        let mut reported = truth;
        if let Some(sample) = self.sample(report.late_s) {
            let velocity = match report.measured {
                Measured::True => sample.velocity,
                Measured::Own => sample.own(),
            };
            reported.velocity = seen(&report, velocity, truth.pose[pose::THETA]);
        }
        let height_m = truth.pose[pose::Z] + self.drift_m;
        reported.pose[pose::Z] = if has_height { height_m } else { 0.0 };
        let theta = self.sample(heading.late_s).map_or(truth.pose[pose::THETA], |late| late.theta);
        reported.pose[pose::THETA] = match heading {
            HeadingReport { is_present: false, .. } => self.theta_start,
            HeadingReport { is_mirrored: true, .. } => {
                2.0 * self.theta_start - theta + self.drift_rad
            }
            _ => theta + self.drift_rad,
        };
        reported.motor_s = match (flying, self.sample(flying_late_s)) {
            (FlyingFlag::Right, Some(sample)) => sample.motor_s,
            (FlyingFlag::Right, None) => truth.motor_s,
            _ => self.claimed_s,
        };
        reported
    }

    /// Quantities of `late_s` ago, or of the start.
    fn sample(&self, late_s: f64) -> Option<&Sample> {
        let newest = self.history.len().saturating_sub(1);
        self.history.get(newest.saturating_sub(steps(late_s, DT_S)))
    }
}

impl Sample {
    fn of(truth: &Truth, own_error_w_mps: [f64; 2]) -> Self {
        let is_flying = truth.phase != DronePhase::Grounded && truth.pose[pose::Z] > STANDING_M;
        let (velocity, theta) = (truth.velocity, truth.pose[pose::THETA]);
        Self { velocity, own_error_w_mps, theta, is_flying, motor_s: truth.motor_s }
    }

    /// Velocity by the drone's own measurement.
    fn own(&self) -> Velocity {
        let ([x_mps, y_mps], Velocity { x_mps: true_x_mps, y_mps: true_y_mps, .. }) =
            (self.own_error_w_mps, self.velocity);
        Velocity { x_mps: true_x_mps + x_mps, y_mps: true_y_mps + y_mps, ..self.velocity }
    }
}

/// `velocity` in the frame that is reported, of a vehicle with heading `theta`.
fn seen(report: &VelocityReport, velocity: Velocity, theta: f64) -> Velocity {
    if !report.is_present {
        return Velocity::default();
    }
    let mut seen = velocity;
    let turn_rad = report.turn_rad
        - match report.axes {
            Axes::World => 0.0,
            Axes::Body => theta,
        };
    let (sin, cos) = turn_rad.sin_cos();
    seen.x_mps = cos * velocity.x_mps - sin * velocity.y_mps;
    seen.y_mps = sin * velocity.x_mps + cos * velocity.y_mps;
    if report.is_mirrored {
        seen.y_mps = -seen.y_mps;
    }
    if report.is_upside_down {
        seen.z_mps = -seen.z_mps;
    }
    seen
}

#[cfg(test)]
mod tests;
