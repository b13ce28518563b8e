//! Whether the commands act, decided in flight from the motion.
//!
//! Owns the sequential test between "the vehicle follows its commands", "it flies as if they were
//! released", as a real Tello does for seconds at a time, and "it goes on with an old command". Only what is
//! past is known here; outages of a recording are found by `tello-eval`. What is done about a lost link is
//! decided elsewhere. Equations: `docs/control.md`.

mod axis;
mod horizontal;
mod likelihood;
mod link_hypothesis;
mod table;

use axis::AxisFilter;
pub use axis::{HeightTable, TurnTable};
use horizon_estim::Observed;
use horizon_model::rows::{Sticks, lag, pose};
use link_hypothesis::{Commanded, LinkHypothesis};
use nalgebra::SVector;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
pub use table::{DeadTimeTable, LinkSettings, LinkTable};

/// Evidence for an outage, over that which the decision takes, from which on the motion shows no dead time. 1
const DOUBT_RATIO: f64 = 0.3;

/// Which commands the vehicle follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LinkState {
    /// The vehicle follows the commands that were sent.
    Up,
    /// The vehicle follows no command and levels out.
    Released,
    /// The vehicle follows the last command before the outage, again and again.
    Held,
}

impl LinkState {
    const ALL: [Self; 3] = [Self::Up, Self::Released, Self::Held];

    /// Whether the commands that are sent now are lost.
    pub fn is_down(self) -> bool {
        self != Self::Up
    }

    /// The two other states; `Up` first if the link is down.
    fn others(self) -> [Self; 2] {
        let [up, released, held] = Self::ALL;
        match self {
            Self::Up => [released, held],
            Self::Released => [up, held],
            Self::Held => [up, released],
        }
    }
}

/// Decision of the sequential test by the motion up to now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkDecision {
    /// Which commands the vehicle follows.
    pub state: LinkState,
    /// Log likelihood ratio, less the evidence that a change takes: it is positive exactly while the
    /// link is down, and its distance to zero is the evidence that is still missing: for an outage, while down for
    /// the return. 1
    pub score: f64,
    /// Whether `state` has changed in this step.
    pub has_changed: bool,
    /// After how many of the latest periods the change fits the motion best: in so many of them, this
    /// step's included, the new decision already held. 0 unless `has_changed`.
    pub onset_steps: u32,
}

/// Error of a dead time by the motion up to now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeadTimeError {
    /// Real dead time minus the assumed one. s
    pub mean_s: f64,
    /// Standard deviation of `mean_s`; [`LinkTable::sd_dead_time_s`] while no command has changed. s
    pub sd_s: f64,
}

impl DeadTimeError {
    /// The error with this mean (s) and variance (s^2).
    fn of(mean_s: f64, variance_s2: f64) -> Self {
        Self { mean_s, sd_s: variance_s2.max(0.0).sqrt() }
    }
}

/// Errors of the dead times by the motion up to now, for each axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DeadTimeErrors {
    /// Error of roll and pitch.
    pub horizontal: DeadTimeError,
    /// Error of the throttle; `None`: it is corrected as roll and pitch are.
    pub throttle: Option<DeadTimeError>,
    /// Error of yaw; `None`: it is corrected as roll and pitch are.
    pub yaw: Option<DeadTimeError>,
}

/// The sequential test: Page's CUSUM on the likelihoods of three Kalman filters.
#[derive(Debug, Clone)]
pub struct LinkMonitor {
    tables: Tables,
    dt_s: f64,
    /// `None` until a complete pose has been seen.
    test: Option<SequentialTest>,
}

/// Settings of the link's filter and of the dead time's.
#[derive(Debug, Clone)]
struct Tables {
    link: LinkTable,
    /// Settings of the dead time's own filter, with its noise. `None`: it has none.
    dead_time: Option<LinkTable>,
}

/// The test in progress.
#[derive(Debug, Clone)]
struct SequentialTest {
    /// The motion if the link stays as it is.
    present: LinkHypothesis,
    /// The motion if it changed, in the order of [`LinkState::others`].
    alternatives: [Alternative; 2],
    /// The newest heading. rad
    theta_rad: f64,
    /// What was commanded in the period before.
    commanded: Commanded,
}

/// The motion if the link changed some steps ago.
#[derive(Debug, Clone)]
struct Alternative {
    hypothesis: LinkHypothesis,
    /// Log likelihood ratio to the present state since then. 1, >= 0
    evidence: f64,
    steps: u32,
}

impl LinkMonitor {
    /// A monitor whose link is up. `dt_s` > 0 is the period.
    pub fn new(settings: &LinkSettings, dt_s: f64) -> Self {
        let link = settings.0.clone();
        let dead_time = link.dead_time.map(|own| own.of_filter(&link));
        Self { tables: Tables { link, dead_time }, dt_s, test: None }
    }

    /// What is known of the error of each axis's dead time; `None` before the first complete pose, while the
    /// link is down, and while the evidence for an outage exceeds `DOUBT_RATIO` of its threshold: an outage then
    /// looks like a delay.
    ///
    /// Real time: no allocation, constant cost.
    pub(crate) fn dead_time_errors(&self) -> Option<DeadTimeErrors> {
        let test = self.test.as_ref()?;
        let is_doubted = test
            .alternatives
            .iter()
            .any(|other| other.evidence > DOUBT_RATIO * self.tables.link.outage_evidence);
        let is_known = test.present.state == LinkState::Up && !is_doubted;
        let LinkHypothesis { horizontal, dead_time, turn, height, .. } = &test.present;
        is_known.then(|| DeadTimeErrors {
            horizontal: dead_time.as_ref().unwrap_or(horizontal).dead_time_error(),
            throttle: height.as_ref().map(AxisFilter::dead_time_error),
            yaw: height.as_ref().and(turn.as_ref()).map(AxisFilter::dead_time_error),
        })
    }

    /// Forgets the motion so far: the link is up, and of the dead times nothing is known.
    pub fn restart(&mut self) {
        self.test = None;
    }

    /// From now on `u_applied` of [`LinkMonitor::update`] assumes dead times that are longer by `longer_s` (s, by
    /// stick), the horizontal ones both alike. An axis at its least dead time keeps it, and with it the error.
    ///
    /// Real time: no allocation, constant cost.
    pub(crate) fn correct_dead_time(&mut self, longer_s: &Sticks) {
        let Some(test) = &mut self.test else { return };
        test.present.correct_dead_time(longer_s);
        for other in &mut test.alternatives {
            other.hypothesis.correct_dead_time(longer_s);
        }
    }

    /// The decision after one period.
    ///
    /// `u_applied` are the applied sticks (1) in the period that just ended if the link was up, dead time
    /// included; `observed` is the accepted pose at its end (world frame, m and rad), `p` the identified parameter of
    /// [`horizon_model::Lagged`]. Where all hypotheses expect the same motion, as with sticks inside the
    /// dead zone, the decision stays; but an outage fades with `forget_s`. Nothing is decided before the
    /// first complete pose.
    ///
    /// Real time: no allocation, constant cost.
    pub fn update(
        &mut self,
        u_applied: &Sticks,
        observed: &Observed<{ pose::COUNT }>,
        p: &SVector<f64, { lag::COUNT }>,
    ) -> LinkDecision {
        let Self { tables, dt_s, test } = self;
        let Some(test) = test else {
            *test = SequentialTest::start(tables, observed);
            return LinkDecision {
                state: LinkState::Up,
                score: -tables.link.outage_evidence,
                has_changed: false,
                onset_steps: 0,
            };
        };
        test.predict(tables, u_applied, p, *dt_s);
        test.compare(tables, observed, *dt_s);
        test.decide(&tables.link)
    }
}

impl Alternative {
    /// The change from `present` to `state`, which begins now, with `commanded` in the period before.
    fn begin(present: &LinkHypothesis, state: LinkState, commanded: Commanded) -> Self {
        Self { hypothesis: present.changed_to(state, commanded), evidence: 0.0, steps: 0 }
    }

    /// How much more the evidence is than a change from `present` takes.
    fn excess(&self, table: &LinkTable) -> f64 {
        let needed = match self.hypothesis.state {
            LinkState::Up => table.return_evidence,
            LinkState::Released | LinkState::Held => table.outage_evidence,
        };
        self.evidence - needed
    }
}

impl SequentialTest {
    fn start(tables: &Tables, observed: &Observed<{ pose::COUNT }>) -> Option<Self> {
        let rows = [pose::X, pose::Y, pose::THETA];
        let is_complete = rows.iter().all(|row| observed.is_present[*row]);
        let (present, commanded) = (LinkHypothesis::start(tables, observed), Commanded::default());
        is_complete.then(|| Self {
            alternatives: LinkState::Up
                .others()
                .map(|state| Alternative::begin(&present, state, commanded)),
            present,
            theta_rad: observed.o[pose::THETA],
            commanded,
        })
    }

    /// Moves all hypotheses through a period.
    fn predict(
        &mut self,
        tables: &Tables,
        u_applied: &Sticks,
        p: &SVector<f64, { lag::COUNT }>,
        dt_s: f64,
    ) {
        let commanded = Commanded::of(u_applied, self.theta_rad, p);
        let sent = commanded.after(self.commanded, dt_s);
        self.commanded = commanded;
        self.present.predict(tables, &sent, p, dt_s);
        for other in &mut self.alternatives {
            other.hypothesis.predict(tables, &sent, p, dt_s);
            other.steps = other.steps.saturating_add(1);
        }
    }

    /// Adds the log likelihood ratios of what was observed.
    fn compare(&mut self, tables: &Tables, observed: &Observed<{ pose::COUNT }>, dt_s: f64) {
        let present = self.present.correct(tables, observed, dt_s);
        for other in &mut self.alternatives {
            other.evidence += other.hypothesis.correct(tables, observed, dt_s) - present;
            if other.hypothesis.state == LinkState::Up {
                other.evidence += tables.link.return_evidence * dt_s / tables.link.forget_s;
            }
        }
        if observed.is_present[pose::THETA] {
            self.theta_rad = observed.o[pose::THETA];
        }
    }

    /// Changes to the alternative with the largest evidence if that suffices, and begins anew each alternative that
    /// fits worse than the present hypothesis: it has not happened yet.
    fn decide(&mut self, table: &LinkTable) -> LinkDecision {
        let [first, second] = &self.alternatives;
        let best = if second.excess(table) > first.excess(table) { second } else { first };
        let change = (best.excess(table) > 0.0).then_some(best.steps);
        if change.is_some() {
            self.present.clone_from(&best.hypothesis);
        }
        let state = self.present.state;
        for (other, to) in self.alternatives.iter_mut().zip(state.others()) {
            if change.is_some() || other.evidence <= 0.0 {
                *other = Alternative::begin(&self.present, to, self.commanded);
            }
        }
        LinkDecision {
            state,
            score: self.score(table),
            has_changed: change.is_some(),
            onset_steps: change.unwrap_or(0),
        }
    }

    /// See [`LinkDecision::score`].
    fn score(&self, table: &LinkTable) -> f64 {
        let [first, second] = self.alternatives.each_ref().map(|other| other.excess(table));
        if self.present.state.is_down() { -first } else { first.max(second) }
    }
}

#[cfg(test)]
pub(crate) mod tests;
