//! Telemetry of a flight for its viewers, made of its ticks.
//!
//! Owns how often there are new facts. Does not know the viewers.

use std::collections::VecDeque;

use horizon_model::rows::Pose;
use horizon_model::setting::SettingError;
use serde::Serialize;
use tello_flight::cycle::{FlightTable, Inbox, Outcome, Timing};
use tello_io::clock::TimeNs;
use tello_io::mocap::{Sighting, StreamReport};
use tello_io::tello::DroneStatus;

use super::{DroneTelemetry, MocapTelemetry, Telemetry, Times};
use crate::VERSION;
use crate::display_rounding::{PosW, every, pos_w_of, ticks, to_thousandths};
use crate::flight_log::TickRecord;
use crate::metrics::{LATE_TICK_MS, ReferencePath};
use crate::predicted_trajectory::TrajectoryPredictor;

/// How often there are new facts. s
const EVERY_S: f64 = 0.04;

/// Window of the worst times and of the rate of the poses. s
const LATELY_S: f64 = 1.0;

/// How often a place is added to the trail, and how many it has: a minute. s
const TRAIL_EVERY_S: f64 = 0.1;
const TRAIL_POINTS: usize = 600;

/// Most points of the reference path.
const REFERENCE_POINTS: usize = 400;

/// What stays the same in a flight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FlightHeader {
    /// Version and revision of the program.
    pub program: String,
    /// The line to follow.
    pub path: Vec<PosW>,
    /// Places to reach.
    pub targets: Vec<PosW>,
    /// Number of targets that the mission counts.
    pub targets_count: usize,
    /// Lower and upper corner of the room, if the settings have one. m
    pub room: Option<[PosW; 2]>,
    /// Period of the loop. s
    pub dt_s: f64,
    /// Time of a tick that the solvers have. s
    pub deadline_s: f64,
    /// Age beyond which a pose is stale. s
    pub stale_s: f64,
    /// Lateness beyond which a tick counts as late. ms
    pub late_ms: f64,
}

/// Makes facts of the ticks of a flight.
#[derive(Debug)]
pub struct TelemetryBuilder {
    reference: ReferencePath,
    predictor: TrajectoryPredictor,
    /// Ticks from one [`Telemetry`] to the next.
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

impl TelemetryBuilder {
    /// For `flight`, with the facts that stay the same in it.
    ///
    /// # Errors
    /// The mission or a dead time breaks its rule.
    pub fn new(flight: &FlightTable) -> Result<(Self, FlightHeader), SettingError> {
        let reference = ReferencePath::of(flight)?;
        let header = FlightHeader::of(flight, &reference);
        let ticks = |span_s| ticks(span_s, flight.cycle.dt_s);
        let lately = usize::try_from(ticks(LATELY_S)).unwrap_or(1);
        let builder = Self {
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
        Ok((builder, header))
    }

    /// From now on nothing is recorded.
    pub fn note_failed_log(&mut self) {
        self.has_log_failed = true;
    }

    /// Takes note of a tick; called for every one. `mocap` gives the state of the stream. Returns new facts 25 times a
    /// second.
    pub fn observe(
        &mut self,
        tick: &TickRecord,
        mocap: impl FnOnce() -> StreamReport,
    ) -> Option<Telemetry> {
        let TickRecord { inbox, out, timing } = tick;
        self.remember(inbox, out, timing);
        let is_due = out.step.is_multiple_of(self.every);
        let facts = is_due.then(|| self.facts(tick, &mocap()));
        self.predictor.note(out);
        facts
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

    fn facts(&self, tick: &TickRecord, stream: &StreamReport) -> Telemetry {
        let TickRecord { inbox, out, timing } = tick;
        let offset = out.pose_hat().map(|at| self.reference.offset(&at));
        Telemetry {
            measured: self.measured.map(Into::into),
            offset: offset.map(|offset| [offset.distance_m, offset.height_m].map(to_thousandths)),
            drone: self.drone.map(|status| DroneTelemetry::of(&status, inbox.now)),
            mocap: self.mocap(inbox.now, stream),
            times: timing.into(),
            worst: self.recent.iter().fold(Times::default(), |worst, r| worst.sup(&r.times)),
            has_log_failed: self.has_log_failed,
            missed_periods: self.missed_periods,
            trail: self.trail.iter().copied().collect(),
            ..Telemetry::of(inbox, out, self.predictor.ahead(out))
        }
    }

    fn mocap(&self, now: TimeNs, stream: &StreamReport) -> MocapTelemetry {
        let poses: usize = self.recent.iter().map(|recent| recent.poses).sum();
        MocapTelemetry {
            age_s: self.seen.map(|seen| now.since(seen.measured_at).seconds()),
            rate_hz: poses as f64 / LATELY_S,
            unseen: stream.unseen,
            gaps: stream.gaps,
        }
    }
}

impl FlightHeader {
    fn of(flight: &FlightTable, reference: &ReferencePath) -> Self {
        let places = |at: &[Pose]| at.iter().map(pos_w_of).collect();
        let supervisor = &flight.cycle.supervisor;
        Self {
            program: format!("tello-ctl {VERSION}"),
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

    fn builder() -> (TelemetryBuilder, FlightHeader) {
        let (table, mission) = config::fly(None, None).unwrap();
        TelemetryBuilder::new(&config::flight(&table, mission, Start::Grounded)).unwrap()
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
    fn the_trail_of_the_newest_facts_stays_bounded() {
        let (mut builder, header) = builder();
        assert!(!header.path.is_empty() && header.targets_count > 0, "{header:?}");
        let facts =
            (0..5_000).filter_map(|step| builder.observe(&tick(step), StreamReport::default));
        let facts = facts.last().unwrap();
        assert_eq!((facts.step, facts.trail.len()), (4_998, TRAIL_POINTS));
        assert_eq!(facts.estimate.map(|at| [at.x, at.theta]), Some([4.998, 0.5]));
    }

    #[test]
    fn the_worst_of_the_last_second_is_forgotten_after_it() {
        let (mut builder, _) = builder();
        let mut late = tick(0);
        late.timing.late_ns = 7_000_000;
        let facts = builder.observe(&late, StreamReport::default).unwrap();
        assert!((facts.worst.late_ms - 7.0).abs() < 1e-9, "{} ms", facts.worst.late_ms);
        for (until, expected) in [(49, 7.0), (53, 0.0)] {
            let facts =
                (1..until).filter_map(|step| builder.observe(&tick(step), StreamReport::default));
            let worst_ms = facts.last().unwrap().worst.late_ms;
            assert!((worst_ms - expected).abs() < 1e-9, "{until}: {worst_ms} ms");
        }
    }
}
