//! Whether the commands act, decided in flight from the motion.
//!
//! Owns the sequential test between "the vehicle follows its sticks" and "it flies as if they were
//! released", as a real Tello does for seconds at a time. Only what is past is known here; what is
//! found in a recording afterwards is `outage.rs`'s. What is done about a lost link is decided
//! elsewhere.

mod hypothesis;

use nalgebra::{SVector, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tello_model::rows::{Sticks, lag, pose};
use tello_model::setting::{SettingError, positive};

use crate::outage::commanded_mps;
use crate::residual::Observed;
use hypothesis::{Command, Hypothesis};

/// How a lost link is recognized in flight, as written in a file.
///
/// The errors of the model are those that the identified parameter may have in this flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LinkTable {
    /// Standard deviation of a position that the filter believes. It stands for all motion that is too
    /// quick to be the sticks', not only for the noise of the motion capture. m, > 0
    pub sd_position_m: f64,
    /// Standard deviation of the horizontal velocity that nobody asked for. m/s, > 0
    pub sd_disturbance_mps: f64,
    /// Time in which that velocity decays. s, > 0
    pub decay_s: f64,
    /// Standard deviation of the relative error of the horizontal gain. 1, > 0
    pub sd_gain: f64,
    /// Standard deviation of the error of the direction of flight. rad, > 0
    pub sd_heading_rad: f64,
    /// Standard deviation of the error of the horizontal dead time. s, > 0
    pub sd_dead_time_s: f64,
    /// Standard deviation of the relative error of the horizontal lag. 1, > 0
    pub sd_rate: f64,
    /// Time in which the errors of the model may change. s, > 0
    pub adapt_s: f64,
    /// Evidence for a loss that is believed. Log likelihood ratio, > 0
    pub loss_evidence: f64,
    /// Evidence for the end of a loss that is believed. Log likelihood ratio, > 0
    pub return_evidence: f64,
    /// Time after which a loss is no longer believed if no motion speaks for or against it. s, > 0
    pub forget_s: f64,
}

/// Checked [`LinkTable`].
#[derive(Debug, Clone, PartialEq)]
pub struct LinkSettings(LinkTable);

impl TryFrom<&LinkTable> for LinkSettings {
    type Error = SettingError;

    fn try_from(table: &LinkTable) -> Result<Self, SettingError> {
        positive("sd_position_m", table.sd_position_m)?;
        positive("sd_disturbance_mps", table.sd_disturbance_mps)?;
        positive("decay_s", table.decay_s)?;
        positive("sd_gain", table.sd_gain)?;
        positive("sd_heading_rad", table.sd_heading_rad)?;
        positive("sd_dead_time_s", table.sd_dead_time_s)?;
        positive("sd_rate", table.sd_rate)?;
        positive("adapt_s", table.adapt_s)?;
        positive("loss_evidence", table.loss_evidence)?;
        positive("return_evidence", table.return_evidence)?;
        positive("forget_s", table.forget_s)?;
        Ok(Self(table.clone()))
    }
}

/// What the motion up to now says about the link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkVerdict {
    /// Whether the commands that act now are lost.
    pub is_down: bool,
    /// Log likelihood ratio, less the evidence that a change takes: it is positive exactly while the
    /// link is down, and its distance to zero is the evidence that is still missing for a change.
    pub score: f64,
    /// Whether `is_down` has changed in this step.
    pub changed: bool,
    /// After how many of the latest periods the change fits the motion best: in so many of them, this
    /// step's included, the new verdict already held. 0 unless `changed`.
    pub onset_steps: u32,
}

/// The sequential test: Page's CUSUM on the likelihoods of two Kalman filters.
#[derive(Debug, Clone)]
pub struct LinkMonitor {
    table: LinkTable,
    dt_s: f64,
    /// `None` until a complete pose has been seen.
    test: Option<Test>,
}

/// The test in progress.
#[derive(Debug, Clone)]
struct Test {
    is_down: bool,
    /// The motion if the link stays as it is, and if it changed `other_steps` ago.
    present: Hypothesis,
    other: Hypothesis,
    /// Log likelihood ratio of `other` to `present` since then, >= 0.
    evidence: f64,
    other_steps: u32,
    /// The newest heading. rad
    theta_rad: f64,
    /// What the sticks asked for in the period before. m/s
    asked_mps: Vector2<f64>,
}

impl LinkMonitor {
    /// A monitor that believes in the link. `dt_s` > 0 is the period.
    pub fn new(settings: &LinkSettings, dt_s: f64) -> Self {
        Self { table: settings.0.clone(), dt_s, test: None }
    }

    /// Forgets the flight and believes in the link.
    pub fn reset(&mut self) {
        self.test = None;
    }

    /// The verdict after one period.
    ///
    /// `u_acted` are the sticks that acted in the period that just ended if the link was up, dead time
    /// included; `observed` is the believed pose at its end, `p` the identified parameter of
    /// [`tello_model::Lagged`]. Where both hypotheses expect the same motion, as with sticks inside the
    /// dead zone, the verdict stays; but a loss fades with `forget_s`. Nothing is decided before the
    /// first complete pose.
    ///
    /// Real time: no allocation, constant cost.
    pub fn update(
        &mut self,
        u_acted: &Sticks,
        observed: &Observed<{ pose::COUNT }>,
        p: &SVector<f64, { lag::COUNT }>,
    ) -> LinkVerdict {
        let Self { table, dt_s, test } = self;
        let Some(test) = test else {
            *test = Test::start(table, observed);
            return LinkVerdict {
                is_down: false,
                score: -table.loss_evidence,
                changed: false,
                onset_steps: 0,
            };
        };
        test.live(table, u_acted, p, *dt_s);
        test.compare(table, observed, *dt_s);
        test.decide(table)
    }
}

impl Test {
    fn start(table: &LinkTable, observed: &Observed<{ pose::COUNT }>) -> Option<Self> {
        let rows = [pose::X, pose::Y, pose::THETA];
        let is_complete = rows.iter().all(|row| observed.is_present[*row]);
        let present =
            Hypothesis::new(table, Vector2::new(observed.o[pose::X], observed.o[pose::Y]));
        is_complete.then(|| Self {
            is_down: false,
            other: present.clone(),
            present,
            evidence: 0.0,
            other_steps: 0,
            theta_rad: observed.o[pose::THETA],
            asked_mps: Vector2::zeros(),
        })
    }

    /// Moves both hypotheses through a period.
    fn live(
        &mut self,
        table: &LinkTable,
        u_acted: &Sticks,
        p: &SVector<f64, { lag::COUNT }>,
        dt_s: f64,
    ) {
        let psi_rad = self.theta_rad + p[lag::THETA_0];
        let asked_mps = commanded_mps(u_acted, psi_rad, p[lag::LAMBDA_H], p[lag::DEAD_H]);
        let up = Command { asked_mps, rate_mps2: (asked_mps - self.asked_mps) / dt_s };
        self.asked_mps = asked_mps;
        let down = Command::default();
        let (present, other) = if self.is_down { (down, up) } else { (up, down) };
        self.present.predict(table, &present, p, dt_s);
        self.other.predict(table, &other, p, dt_s);
        self.other_steps = self.other_steps.saturating_add(1);
    }

    /// Weighs both hypotheses by what was seen.
    fn compare(&mut self, table: &LinkTable, observed: &Observed<{ pose::COUNT }>, dt_s: f64) {
        self.evidence +=
            self.other.correct(table, observed) - self.present.correct(table, observed);
        if self.is_down {
            self.evidence += table.return_evidence * dt_s / table.forget_s;
        }
        if observed.is_present[pose::THETA] {
            self.theta_rad = observed.o[pose::THETA];
        }
    }

    fn decide(&mut self, table: &LinkTable) -> LinkVerdict {
        let needed = if self.is_down { table.return_evidence } else { table.loss_evidence };
        let changed = self.evidence > needed;
        let onset_steps = if changed { self.other_steps } else { 0 };
        if changed {
            self.is_down = !self.is_down;
            self.present.clone_from(&self.other);
        }
        // A change that fits worse than none has not happened yet: it may begin now.
        if changed || self.evidence <= 0.0 {
            self.other.clone_from(&self.present);
            self.evidence = 0.0;
            self.other_steps = 0;
        }
        let score = if self.is_down {
            table.return_evidence - self.evidence
        } else {
            self.evidence - table.loss_evidence
        };
        LinkVerdict { is_down: self.is_down, score, changed, onset_steps }
    }
}

#[cfg(test)]
mod tests;
