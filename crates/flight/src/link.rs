//! Whether the commands act, decided in flight from the motion.
//!
//! Owns the sequential test between "the vehicle follows its commands", "it flies as if they were
//! released", as a real Tello does for seconds at a time, and "it goes on with an old command". Only what is
//! past is known here; outages of a recording are found by `tello-eval`. What is done about a lost link is
//! decided elsewhere. Equations: `docs/control.md`.

mod hypothesis;

use horizon_estim::Observed;
use horizon_model::rows::{Sticks, lag, pose, stick};
use horizon_model::setting::{SettingError, in_range, positive};
use hypothesis::{Command, Hypothesis};
use nalgebra::{SVector, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Part of the evidence for a loss from which on the motion is in doubt.
const DOUBT: f64 = 0.3;

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
    /// Most by which a flight corrects the dead times, all alike, by what it shows of the horizontal one. Missing:
    /// 0, they stay. s, 0..=0.5
    #[serde(default)]
    pub dead_time_change_s: f64,
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
        in_range("dead_time_change_s", table.dead_time_change_s, 0.0..=0.5)?;
        Ok(Self(table.clone()))
    }
}

/// Which commands the vehicle follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LinkState {
    /// Those that were sent.
    Up,
    /// None: it levels out.
    Released,
    /// The last one before the outage, again and again.
    Held,
}

impl LinkState {
    const ALL: [Self; 3] = [Self::Up, Self::Released, Self::Held];

    /// Whether the commands that are sent now are lost.
    pub fn is_down(self) -> bool {
        self != Self::Up
    }

    /// The two others.
    fn others(self) -> [Self; 2] {
        let [up, released, held] = Self::ALL;
        match self {
            Self::Up => [released, held],
            Self::Released => [up, held],
            Self::Held => [up, released],
        }
    }
}

/// What the motion up to now says about the link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkVerdict {
    /// Which commands the vehicle follows.
    pub state: LinkState,
    /// Log likelihood ratio, less the evidence that a change takes: it is positive exactly while the
    /// link is down, and its distance to zero is the evidence that is still missing for a change.
    pub score: f64,
    /// Whether `state` has changed in this step.
    pub changed: bool,
    /// After how many of the latest periods the change fits the motion best: in so many of them, this
    /// step's included, the new verdict already held. 0 unless `changed`.
    pub onset_steps: u32,
}

/// What the motion up to now says about the error of the horizontal dead time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeadTimeError {
    /// Real dead time minus the assumed one. s
    pub mean_s: f64,
    /// Standard deviation of `mean_s`; [`LinkTable::sd_dead_time_s`] while no command has changed. s
    pub sd_s: f64,
}

/// The sequential test: Page's CUSUM on the likelihoods of three Kalman filters.
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
    /// The motion if the link stays as it is.
    present: Branch,
    /// The motion if it changed.
    others: [Other; 2],
    /// The newest heading. rad
    theta_rad: f64,
    /// Commanded velocity in the period before, world frame. m/s
    asked_mps: Vector2<f64>,
}

/// The motion under one state of the link.
#[derive(Debug, Clone)]
struct Branch {
    state: LinkState,
    hypothesis: Hypothesis,
    /// Commanded velocity while a command is held, world frame. m/s
    held_mps: Vector2<f64>,
}

/// The motion if the link changed some steps ago.
#[derive(Debug, Clone)]
struct Other {
    branch: Branch,
    /// Log likelihood ratio to the present state since then, >= 0.
    evidence: f64,
    steps: u32,
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

    /// What is known of the error of the horizontal dead time; `None` before the first complete pose, while the
    /// link is down, and while so much speaks for a loss that what looks like a delay may be one.
    pub fn dead_time_error(&self) -> Option<DeadTimeError> {
        let test = self.test.as_ref()?;
        let is_doubted =
            test.others.iter().any(|other| other.evidence > DOUBT * self.table.loss_evidence);
        let is_known = test.present.state == LinkState::Up && !is_doubted;
        is_known.then(|| test.present.hypothesis.dead_time_error())
    }

    /// From now on `u_applied` of [`LinkMonitor::update`] assumes a dead time that is longer by `longer_s`.
    pub fn correct_dead_time(&mut self, longer_s: f64) {
        let Some(test) = &mut self.test else { return };
        test.present.hypothesis.correct_dead_time(longer_s);
        for other in &mut test.others {
            other.branch.hypothesis.correct_dead_time(longer_s);
        }
    }

    /// The verdict after one period.
    ///
    /// `u_applied` are the applied sticks in the period that just ended if the link was up, dead time
    /// included; `observed` is the believed pose at its end, `p` the identified parameter of
    /// [`horizon_model::Lagged`]. Where both hypotheses expect the same motion, as with sticks inside the
    /// dead zone, the verdict stays; but a loss fades with `forget_s`. Nothing is decided before the
    /// first complete pose.
    ///
    /// Real time: no allocation, constant cost.
    pub fn update(
        &mut self,
        u_applied: &Sticks,
        observed: &Observed<{ pose::COUNT }>,
        p: &SVector<f64, { lag::COUNT }>,
    ) -> LinkVerdict {
        let Self { table, dt_s, test } = self;
        let Some(test) = test else {
            *test = Test::start(table, observed);
            return LinkVerdict {
                state: LinkState::Up,
                score: -table.loss_evidence,
                changed: false,
                onset_steps: 0,
            };
        };
        test.predict(table, u_applied, p, *dt_s);
        test.compare(table, observed, *dt_s);
        test.decide(table)
    }
}

impl Branch {
    /// Moves through a period in which `sent` was asked for.
    fn predict(
        &mut self,
        table: &LinkTable,
        sent: &Command,
        p: &SVector<f64, { lag::COUNT }>,
        dt_s: f64,
    ) {
        let command = match self.state {
            LinkState::Up => *sent,
            LinkState::Released => Command::default(),
            LinkState::Held => Command { asked_mps: self.held_mps, ..Command::default() },
        };
        self.hypothesis.predict(table, &command, p, dt_s);
    }

    /// The change from this state to `state`, which begins now, `asked_mps` being asked for.
    fn change(&self, state: LinkState, asked_mps: Vector2<f64>) -> Other {
        let branch = Self { state, hypothesis: self.hypothesis.clone(), held_mps: asked_mps };
        Other { branch, evidence: 0.0, steps: 0 }
    }
}

impl Other {
    /// How much more the evidence is than a change from `present` takes.
    fn excess(&self, table: &LinkTable) -> f64 {
        let needed = match self.branch.state {
            LinkState::Up => table.return_evidence,
            LinkState::Released | LinkState::Held => table.loss_evidence,
        };
        self.evidence - needed
    }
}

impl Test {
    fn start(table: &LinkTable, observed: &Observed<{ pose::COUNT }>) -> Option<Self> {
        let rows = [pose::X, pose::Y, pose::THETA];
        let is_complete = rows.iter().all(|row| observed.is_present[*row]);
        let position_m = Vector2::new(observed.o[pose::X], observed.o[pose::Y]);
        let (state, held_mps) = (LinkState::Up, Vector2::zeros());
        let hypothesis = Hypothesis::new(table, position_m);
        let present = Branch { state, hypothesis, held_mps };
        is_complete.then(|| Self {
            others: state.others().map(|other| present.change(other, held_mps)),
            present,
            theta_rad: observed.o[pose::THETA],
            asked_mps: Vector2::zeros(),
        })
    }

    /// Moves all branches through a period.
    fn predict(
        &mut self,
        table: &LinkTable,
        u_applied: &Sticks,
        p: &SVector<f64, { lag::COUNT }>,
        dt_s: f64,
    ) {
        let psi_rad = self.theta_rad + p[lag::THETA_0];
        let asked_mps = commanded_mps(u_applied, psi_rad, p[lag::LAMBDA_H], p[lag::DEAD_H]);
        let sent = Command { asked_mps, rate_mps2: (asked_mps - self.asked_mps) / dt_s };
        self.asked_mps = asked_mps;
        self.present.predict(table, &sent, p, dt_s);
        for other in &mut self.others {
            other.branch.predict(table, &sent, p, dt_s);
            other.steps = other.steps.saturating_add(1);
        }
    }

    /// Weighs all branches by what was seen.
    fn compare(&mut self, table: &LinkTable, observed: &Observed<{ pose::COUNT }>, dt_s: f64) {
        let present = self.present.hypothesis.correct(table, observed);
        for other in &mut self.others {
            other.evidence += other.branch.hypothesis.correct(table, observed) - present;
            if other.branch.state == LinkState::Up {
                other.evidence += table.return_evidence * dt_s / table.forget_s;
            }
        }
        if observed.is_present[pose::THETA] {
            self.theta_rad = observed.o[pose::THETA];
        }
    }

    fn decide(&mut self, table: &LinkTable) -> LinkVerdict {
        let [first, second] = self.others.each_ref().map(|other| other.excess(table));
        let best = usize::from(second > first);
        let changed = first.max(second) > 0.0;
        let onset_steps = if changed { self.others[best].steps } else { 0 };
        if changed {
            self.present.clone_from(&self.others[best].branch);
        }
        let state = self.present.state;
        for (other, to) in self.others.iter_mut().zip(state.others()) {
            // A change that fits worse than none has not happened yet: it may begin now.
            if changed || other.evidence <= 0.0 {
                *other = self.present.change(to, self.asked_mps);
            }
        }
        let [first, second] = self.others.each_ref().map(|other| other.excess(table));
        // The first of a state that is down is the return.
        let score = if state.is_down() { -first } else { first.max(second) };
        LinkVerdict { state, score, changed, onset_steps }
    }
}

/// Velocity that the sticks ask for in the direction of flight `psi_rad`, world frame. m/s
pub fn commanded_mps(u: &Sticks, psi_rad: f64, lambda_h_mps: f64, dead_h: f64) -> Vector2<f64> {
    let excess = |u: f64| (u.abs() - dead_h).max(0.0).copysign(u);
    let forward = lambda_h_mps * excess(u[stick::PITCH]);
    let right = lambda_h_mps * excess(u[stick::ROLL]);
    let (sin, cos) = psi_rad.sin_cos();
    Vector2::new(cos * forward + sin * right, sin * forward - cos * right)
}

#[cfg(test)]
mod tests;
