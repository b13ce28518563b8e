//! A flight for the eyes: what viewers of the field draw without set-up, beside our own channels.
//!
//! Owns the channels under `/scene`, what they show and how often. It is written by the log's thread,
//! never in the tick; it says nothing that our own channels do not say, and nobody of ours reads it.

mod foxglove;

use std::collections::VecDeque;

use foxglove::{
    BLUE, FrameTransform, GREEN, GREY, Level, Log, ORANGE, Pose, PoseInFrame, SceneEntity,
    SceneUpdate, Time, VERMILION, Vector3,
};
use horizon_model::rows::Pose as Row;
use horizon_model::setting::SettingError;
use schemars::schema_for;
use tello_flight::cycle::{FlightTable, Outcome};
use tello_flight::{FaultSet, Phase};
use tello_io::log::{Channel, LogError, LogWriter};

use crate::flight_log::TickRecord;
use crate::metrics::ReferencePath;
use crate::predicted_trajectory::{Ahead, Place, TrajectoryPredictor, every, ticks};

const POSE: &str = "/scene/pose";
const TRANSFORM: &str = "/scene/transform";
const FLIGHT: &str = "/scene/flight";
const REFERENCE: &str = "/scene/course";
const LOG: &str = "/scene/log";

/// Frames: the room, and the vehicle in it.
const WORLD: &str = "world";
const VEHICLE: &str = "tello";

/// How often the flight is drawn, and how often its reference path, for viewers that begin in the middle. s
const FLIGHT_EVERY_S: f64 = 0.1;
const REFERENCE_EVERY_S: f64 = 1.0;

/// Most points of the trail and of the reference path.
const TRAIL_POINTS: usize = 100;
const REFERENCE_POINTS: usize = 200;

/// Sizes of the vehicle along x, y, z, and of the ball at a place to be. m
const VEHICLE_M: [f64; 3] = [0.18, 0.18, 0.05];
const PLACE_M: f64 = 0.08;

/// How long something that is drawn again and again may stay. ns
const LIFETIME_NS: u64 = 1_000_000_000;

/// Draws the ticks of one flight.
#[derive(Debug)]
pub struct Scene {
    started_unix_ns: u64,
    predictor: TrajectoryPredictor,
    /// Ticks between two drawings of flight and reference.
    flight_every: u64,
    reference_every: u64,
    reference: Vec<Vector3>,
    trail: VecDeque<Vector3>,
    last_logged: LastLogged,
}

/// State of the last log message.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct LastLogged {
    phase: Option<Phase>,
    faults: FaultSet,
    is_down: bool,
    targets_reached: usize,
}

/// The channels of a scene.
pub fn channels() -> [Channel; 5] {
    let scene = |topic| Channel {
        topic,
        schema_name: "foxglove.SceneUpdate",
        schema: schema_for!(SceneUpdate),
    };
    [
        Channel {
            topic: POSE,
            schema_name: "foxglove.PoseInFrame",
            schema: schema_for!(PoseInFrame),
        },
        Channel {
            topic: TRANSFORM,
            schema_name: "foxglove.FrameTransform",
            schema: schema_for!(FrameTransform),
        },
        scene(FLIGHT),
        scene(REFERENCE),
        Channel { topic: LOG, schema_name: "foxglove.Log", schema: schema_for!(Log) },
    ]
}

/// Names of the channels of a scene.
pub fn topics() -> [&'static str; 5] {
    [POSE, TRANSFORM, FLIGHT, REFERENCE, LOG]
}

impl Scene {
    /// The scene of a flight whose log's time 0 is `started_unix_ns` after 1970.
    ///
    /// # Errors
    /// A mission that breaks its rules.
    pub fn new(flight: &FlightTable, started_unix_ns: u64) -> Result<Self, SettingError> {
        let dt_s = flight.cycle.dt_s;
        let outline = ReferencePath::of(flight)?.outline;
        let reference = every(&outline, REFERENCE_POINTS).iter().map(Vector3::of).collect();
        Ok(Self {
            started_unix_ns,
            predictor: TrajectoryPredictor::new(&flight.cycle)?,
            flight_every: ticks(FLIGHT_EVERY_S, dt_s),
            reference_every: ticks(REFERENCE_EVERY_S, dt_s),
            reference,
            trail: VecDeque::with_capacity(TRAIL_POINTS),
            last_logged: LastLogged::default(),
        })
    }

    /// Adds a tick to `log`, whose channels are those of [`flight_log::create`](crate::flight_log::create).
    ///
    /// # Errors
    /// As [`LogWriter::write`].
    pub fn write(&mut self, log: &mut LogWriter, tick: &TickRecord) -> Result<(), LogError> {
        let (t, out) = (tick.inbox.now, &tick.out);
        let now = Time::from_ns(self.started_unix_ns.saturating_add_signed(t.0));
        if let Some(at) = out.pose_hat() {
            let pose = Pose::of(&at);
            log.write(POSE, t, &PoseInFrame { timestamp: now, frame_id: WORLD, pose })?;
            log.write(TRANSFORM, t, &FrameTransform::new(now, WORLD, VEHICLE, &pose))?;
            if out.step % self.flight_every == 0 {
                log.write(FLIGHT, t, &self.flight(now, &at, out))?;
            }
        }
        self.predictor.note(out);
        if out.step % self.reference_every == 0 {
            let drawn = SceneEntity::new(now, WORLD, "course", Time::ZERO);
            let entities = vec![drawn.line(self.reference.clone(), GREY)];
            log.write(REFERENCE, t, &SceneUpdate { deletions: [], entities })?;
        }
        for (level, message) in self.last_logged.news(out) {
            let message =
                Log { timestamp: now, level, message, name: "tello-ctl", file: "", line: 0 };
            log.write(LOG, t, &message)?;
        }
        Ok(())
    }

    /// Trail, prediction over the dead time, plan, places to be, and the vehicle itself.
    fn flight(&mut self, now: Time, at: &Row, out: &Outcome) -> SceneUpdate {
        if self.trail.len() == TRAIL_POINTS {
            self.trail.pop_front();
        }
        self.trail.push_back(Vector3::of(at));
        let entity = |id| SceneEntity::new(now, WORLD, id, Time::from_ns(LIFETIME_NS));
        let vehicle = SceneEntity::new(now, VEHICLE, "vehicle", Time::from_ns(LIFETIME_NS));
        let mut entities = vec![
            entity("trail").line(self.trail.iter().copied().collect(), BLUE),
            entity("target").sphere(Pose::of(&out.target), PLACE_M, VERMILION),
            vehicle.cube(Pose::HERE, VEHICLE_M, BLUE),
        ];
        if let Some(reference) = &out.reference {
            entities.push(entity("reference").sphere(Pose::of(reference), PLACE_M, GREY));
        }
        let Ahead { committed, plan } = self.predictor.ahead(out);
        if !plan.is_empty() {
            let line = |way: Vec<Place>| way.into_iter().map(Vector3::from).collect();
            entities.push(entity("prediction").line(line(committed), ORANGE));
            entities.push(entity("plan").line(line(plan), GREEN));
        }
        SceneUpdate { deletions: [], entities }
    }
}

impl LastLogged {
    /// What is new since the tick before.
    fn news(&mut self, out: &Outcome) -> Vec<(Level, String)> {
        let mut news = Vec::new();
        let now = Self {
            phase: out.ruling.map(|ruling| ruling.phase),
            faults: out.ruling.map(|ruling| ruling.faults).unwrap_or_default(),
            is_down: out.link.is_some_and(|link| link.state.is_down()),
            targets_reached: out.targets_reached,
        };
        if let Some(phase) = now.phase.filter(|phase| Some(*phase) != self.phase) {
            news.push((Level::Info, format!("phase {}", phase.name())));
        }
        for fault in now.faults.iter().filter(|fault| !self.faults.iter().any(|old| old == *fault))
        {
            news.push((Level::Warning, format!("fault {}", fault.name())));
        }
        for fault in self.faults.iter().filter(|old| !now.faults.iter().any(|fault| fault == *old))
        {
            news.push((Level::Info, format!("fault {} is over", fault.name())));
        }
        if now.is_down != self.is_down {
            news.push(if now.is_down {
                (Level::Warning, "sticks do not act".to_owned())
            } else {
                (Level::Info, "sticks act again".to_owned())
            });
        }
        if now.targets_reached > self.targets_reached {
            news.push((Level::Info, format!("target {} reached", now.targets_reached)));
        }
        *self = now;
        news
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::{Kinematic, Model};
    use tello_flight::{Ruling, SupervisorOrder};

    use super::*;

    fn out(targets_reached: usize, phase: Phase) -> Outcome {
        let mut out = Outcome::with_buffers(&Kinematic::STATE, &Kinematic::PARAMETER, 3);
        out.targets_reached = targets_reached;
        out.ruling = Some(Ruling {
            phase,
            pilot: None,
            order: SupervisorOrder::None,
            faults: FaultSet::default(),
            pose_is_airborne: None,
        });
        out
    }

    #[test]
    fn only_news_is_logged() {
        let mut last_logged = LastLogged::default();
        let texts = |news: Vec<(Level, String)>| -> Vec<String> {
            news.into_iter().map(|(_, text)| text).collect()
        };
        assert_eq!(texts(last_logged.news(&out(0, Phase::Idle))), ["phase idle"]);
        assert!(last_logged.news(&out(0, Phase::Idle)).is_empty());
        let news = texts(last_logged.news(&out(1, Phase::Flying)));
        assert_eq!(news, ["phase flying", "target 1 reached"]);
    }
}
