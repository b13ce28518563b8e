//! Newest facts of a flight for its viewers, made by the log's thread; a newer one replaces one that was not read.
//!
//! Owns which facts there are, and how often. It refuses to know the viewers.

pub(super) mod facts;

use std::collections::VecDeque;
use std::sync::Arc;

use horizon_model::rows::Pose;
use horizon_model::setting::SettingError;
use serde::Serialize;
use tello_io::clock::TimeNs;
use tello_io::mocap::{Sighting, StreamReport};
use tello_io::tello::DroneStatus;
use tokio::sync::watch;

pub(super) use self::facts::Facts;
use self::facts::{DroneFact, MocapFact, Times};
use tello_eval::REVISION;
use tello_eval::flight_log::TickRecord;
use tello_eval::metrics::{LATE_TICK_MS, ReferencePath};
use tello_eval::predicted_trajectory::TrajectoryPredictor;
use tello_eval::view_numbers::{PosW, every, pos_w_of, ticks, to_thousandths};
use tello_flight::cycle::{FlightTable, Inbox, Outcome, Timing};

/// How often there are new facts. s
const EVERY_S: f64 = 0.04;

/// Window of the worst times and of the rate of the poses. s
const LATELY_S: f64 = 1.0;

/// How often a place is added to the trail, and how many it has: a minute. s
const TRAIL_EVERY_S: f64 = 0.1;
const TRAIL_POINTS: usize = 600;

/// Most points of the reference path.
const REFERENCE_POINTS: usize = 400;

/// Facts that stay the same in a flight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Briefing {
    /// Version and revision of the program.
    pub(super) program: String,
    /// The line to follow.
    pub(super) path: Vec<PosW>,
    /// Places to reach.
    pub(super) targets: Vec<PosW>,
    /// Number of targets that the mission counts.
    pub(super) targets_count: usize,
    /// Lower and upper corner of the room, if the settings have one. m
    pub(super) room: Option<[PosW; 2]>,
    /// Period of the loop, and the time of it that the solvers have. s
    pub(super) dt_s: f64,
    pub(super) deadline_s: f64,
    /// Age beyond which a pose is stale. s
    pub(super) stale_s: f64,
    /// Lateness beyond which a tick counts as late. ms
    pub(super) late_ms: f64,
}

/// Makes facts of the ticks of a flight.
#[derive(Debug)]
pub(super) struct Live {
    facts: watch::Sender<Arc<Facts>>,
    reference: ReferencePath,
    predictor: TrajectoryPredictor,
    /// Ticks from one [`Facts`] to the next.
    every: u64,
    /// Ticks from one position of the trail to the next.
    trail_every: u64,
    /// Ticks of the recent past, of which the facts give extremes.
    lately: usize,
    recent: VecDeque<Recent>,
    trail: VecDeque<PosW>,
    drone: Option<DroneStatus>,
    seen: Option<Sighting>,
    measured: Option<Pose>,
    missed_periods: u64,
    has_log_failed: bool,
}

/// Values of a recent tick.
#[derive(Debug, Clone, Copy)]
struct Recent {
    times: Times,
    poses: usize,
}

/// A viewer's end of the facts.
pub(super) type Watched = watch::Receiver<Arc<Facts>>;

impl Live {
    /// Facts of `flight`, what stays the same in it, and where to watch. The facts end with the flight: their sender
    /// is dropped then.
    ///
    /// # Errors
    /// The mission or a dead time breaks its rule.
    pub(super) fn new(flight: &FlightTable) -> Result<(Self, Briefing, Watched), SettingError> {
        let reference = ReferencePath::of(flight)?;
        let briefing = Briefing::of(flight, &reference);
        let (facts, watched) = watch::channel(Arc::new(Facts::default()));
        let ticks = |span_s| ticks(span_s, flight.cycle.dt_s);
        let lately = usize::try_from(ticks(LATELY_S)).unwrap_or(1);
        let live = Self {
            facts,
            reference,
            predictor: TrajectoryPredictor::new(&flight.cycle)?,
            every: ticks(EVERY_S),
            trail_every: ticks(TRAIL_EVERY_S),
            lately,
            recent: VecDeque::with_capacity(lately),
            trail: VecDeque::with_capacity(TRAIL_POINTS),
            drone: None,
            seen: None,
            measured: None,
            missed_periods: 0,
            has_log_failed: false,
        };
        Ok((live, briefing, watched))
    }

    /// From now on nothing is recorded.
    pub(super) fn note_failed_log(&mut self) {
        self.has_log_failed = true;
    }

    /// Takes note of a tick; called for every one. `mocap` says how the poses come.
    pub(super) fn observe(&mut self, tick: &TickRecord, mocap: impl FnOnce() -> StreamReport) {
        let TickRecord { inbox, out, timing } = tick;
        self.remember(inbox, out, timing);
        if out.step.is_multiple_of(self.every) {
            let facts = self.facts(tick, &mocap());
            self.facts.send_replace(Arc::new(facts));
        }
        self.predictor.note(out);
    }

    fn remember(&mut self, inbox: &Inbox, out: &Outcome, timing: &Timing) {
        self.drone = inbox.drone.or(self.drone);
        let mut seen = inbox.sightings.iter().filter(|sighting| sighting.pose.is_some());
        if self.recent.len() == self.lately {
            self.recent.pop_front();
        }
        self.recent.push_back(Recent { times: timing.into(), poses: seen.clone().count() });
        self.seen = seen.next_back().copied().or(self.seen);
        self.measured = out.filtered.and_then(|filtered| filtered.o).or(self.measured);
        self.missed_periods += inbox.skipped;
        if out.step.is_multiple_of(self.trail_every)
            && let Some(at) = out.pose_hat()
        {
            if self.trail.len() == TRAIL_POINTS {
                self.trail.pop_front();
            }
            self.trail.push_back(pos_w_of(&at));
        }
    }

    fn facts(&self, tick: &TickRecord, stream: &StreamReport) -> Facts {
        let TickRecord { inbox, out, timing } = tick;
        let offset = out.pose_hat().map(|at| self.reference.offset(&at));
        Facts {
            measured: self.measured.map(Into::into),
            offset: offset.map(|offset| [offset.distance_m, offset.height_m].map(to_thousandths)),
            drone: self.drone.map(|status| DroneFact::of(&status, inbox.now)),
            mocap: self.mocap(inbox.now, stream),
            times: timing.into(),
            worst: self.recent.iter().fold(Times::default(), |worst, r| worst.sup(&r.times)),
            has_log_failed: self.has_log_failed,
            missed_periods: self.missed_periods,
            trail: self.trail.iter().copied().collect(),
            ..Facts::of(inbox, out, self.predictor.ahead(out))
        }
    }

    fn mocap(&self, now: TimeNs, stream: &StreamReport) -> MocapFact {
        let poses: usize = self.recent.iter().map(|recent| recent.poses).sum();
        MocapFact {
            age_s: self.seen.map(|seen| now.since(seen.measured_at).seconds()),
            rate_hz: poses as f64 / LATELY_S,
            unseen: stream.unseen,
            gaps: stream.gaps,
        }
    }
}

impl Briefing {
    fn of(flight: &FlightTable, reference: &ReferencePath) -> Self {
        let places = |at: &[Pose]| at.iter().map(pos_w_of).collect();
        let supervisor = &flight.cycle.supervisor;
        Self {
            program: format!("tello-ctl {} ({REVISION})", env!("CARGO_PKG_VERSION")),
            path: places(&every(&reference.outline, REFERENCE_POINTS)),
            targets: places(&reference.targets),
            targets_count: reference.targets_count,
            room: supervisor.room.as_ref().map(|room| {
                let ([x_lo, x_hi], [y_lo, y_hi], [z_lo, z_hi]) = (room.x_m, room.y_m, room.z_m);
                [[x_lo, y_lo, z_lo], [x_hi, y_hi, z_hi]]
            }),
            dt_s: flight.cycle.dt_s,
            deadline_s: flight.cycle.deadline_s,
            stale_s: supervisor.stale_s,
            late_ms: LATE_TICK_MS,
        }
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::{Kinematic, Model};
    use tello_flight::Start;
    use tello_io::config;

    use super::*;

    fn live() -> (Live, Briefing, Watched) {
        let (table, mission) = config::fly(None, None).unwrap();
        Live::new(&config::flight(&table, mission, Start::Grounded)).unwrap()
    }

    fn tick(step: u64) -> TickRecord {
        let out = Outcome::with_buffers(&Kinematic::STATE, &Kinematic::PARAMETER, 1);
        let mut tick = TickRecord::with_buffers(&out);
        tick.inbox.open(step, TimeNs(i64::try_from(step).unwrap() * 20_000_000));
        (tick.out.step, tick.timing.step) = (step, step);
        tick.out.s_hat = vec![0.001 * step as f64, 2.0, 1.0, 0.5];
        tick
    }

    #[test]
    fn the_newest_facts_replace_older_ones_and_the_trail_stays_bounded() {
        let (mut live, briefing, mut watched) = live();
        assert!(!briefing.path.is_empty() && briefing.targets_count > 0, "{briefing:?}");
        for step in 0..5_000 {
            live.observe(&tick(step), StreamReport::default);
        }
        let facts = Arc::clone(&watched.borrow_and_update());
        assert_eq!((facts.step, facts.trail.len()), (4_998, TRAIL_POINTS));
        assert_eq!(facts.estimate.map(|at| [at.x, at.theta]), Some([4.998, 0.5]));
        assert!(!watched.has_changed().unwrap(), "an older one was kept");
        drop(live);
        assert!(watched.has_changed().is_err(), "the facts end with the flight");
    }

    #[test]
    fn the_worst_of_the_last_second_is_forgotten_after_it() {
        let (mut live, _, watched) = live();
        let mut late = tick(0);
        late.timing.late_ns = 7_000_000;
        live.observe(&late, StreamReport::default);
        let worst = |watched: &Watched| watched.borrow().worst.late_ms;
        assert!((worst(&watched) - 7.0).abs() < 1e-9, "{} ms", worst(&watched));
        for (until, expected) in [(49, 7.0), (53, 0.0)] {
            for step in 1..until {
                live.observe(&tick(step), StreamReport::default);
            }
            assert!((worst(&watched) - expected).abs() < 1e-9, "{until}: {} ms", worst(&watched));
        }
    }
}
