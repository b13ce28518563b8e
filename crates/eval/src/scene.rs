//! A flight for the eyes: what viewers of the field draw without set-up, beside our own channels.
//!
//! Owns the channels under `/scene`, what they show and how often: Foxglove's published kinds in Protocol Buffers,
//! and the plots as ROS 2 numbers with names. Thread in flight: the log's, not the
//! tick's; allocates. It holds nothing that our own channels do not hold, and of ours only `ros2` reads it.

mod shapes;

use std::collections::VecDeque;

use foxglove::Encode;
use foxglove::messages::log::Level;
use foxglove::messages::{FrameTransform, Log, Point3, PoseInFrame, PosesInFrame, SceneUpdate};
use horizon_model::rows::{Pose as Row, motion, pose, stick};
use horizon_model::setting::SettingError;
use tello_flight::cycle::{FlightTable, Outcome};
use tello_flight::{FaultSet, Phase};
use tello_io::clock::TimeNs;
use tello_io::log::{Channel, LogError, LogWriter, Schema};

use crate::display_rounding::{every, pos_w_of, ticks};
use crate::flight_log::TickRecord;
use crate::metrics::ReferencePath;
use crate::predicted_trajectory::{PredictedTrajectory, TrajectoryPredictor};
use crate::ros2::{Kind, VEHICLE, WORLD, numbers};
use shapes::{
    BLUE, GREEN, GREY, ORANGE, Shapes as _, VERMILION, at_place, entity, moment, point, pose_of,
    transform,
};

const POSE: &str = "/scene/pose";
const TRANSFORM: &str = "/scene/transform";
const NUMBERS: &str = "/scene/numbers";
pub(crate) const PLAN: &str = "/scene/plan";
const FLIGHT: &str = "/scene/flight";
const REFERENCE: &str = "/scene/course";
const LOG: &str = "/scene/log";

/// How often the flight is drawn, and how often its reference path, for viewers that begin in the middle. s
const FLIGHT_EVERY_S: f64 = 0.1;
const REFERENCE_EVERY_S: f64 = 1.0;

/// Most points of the trail and of the reference path.
const TRAIL_POINTS: usize = 100;
const REFERENCE_POINTS: usize = 200;

/// Sizes of the vehicle along x, y, z, and of the ball at a place to be. m
const VEHICLE_M: [f64; 3] = [0.18, 0.18, 0.05];
const PLACE_M: f64 = 0.08;

/// Names of poses and sticks in the plots, behind those of the state.
const POSE_ROWS: [&str; pose::COUNT] = ["x", "y", "z", "theta"];
const STICK_ROWS: [&str; stick::COUNT] = ["roll", "pitch", "yaw", "throttle"];

/// Most numbers of the plots: state, three poses, sticks.
const NUMBERS_MAX: usize = motion::COUNT + 3 * pose::COUNT + stick::COUNT;

/// Draws the ticks of one flight.
#[derive(Debug)]
pub struct Scene {
    started_unix_ns: u64,
    predictor: TrajectoryPredictor,
    /// Ticks between two drawings of flight and reference.
    flight_every: u64,
    reference_every: u64,
    reference: Vec<Point3>,
    trail: VecDeque<Point3>,
    last_logged: LastLogged,
    plots: Plots,
    /// Bytes of the latest message; kept for their memory.
    bytes: Vec<u8>,
}

/// Names and values of the plots of a tick.
#[derive(Debug)]
struct Plots {
    names: Vec<String>,
    values: Vec<f64>,
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
pub fn channels() -> [Channel; 7] {
    [
        of_foxglove::<PoseInFrame>(POSE, "foxglove.PoseInFrame"),
        of_foxglove::<FrameTransform>(TRANSFORM, "foxglove.FrameTransform"),
        Channel {
            topic: NUMBERS,
            schema_name: Kind::Numbers.name(),
            schema: Kind::Numbers.schema(),
        },
        of_foxglove::<PosesInFrame>(PLAN, "foxglove.PosesInFrame"),
        of_foxglove::<SceneUpdate>(FLIGHT, "foxglove.SceneUpdate"),
        of_foxglove::<SceneUpdate>(REFERENCE, "foxglove.SceneUpdate"),
        of_foxglove::<Log>(LOG, "foxglove.Log"),
    ]
}

fn of_foxglove<M: Encode>(topic: &'static str, schema_name: &'static str) -> Channel {
    let descriptors = M::get_schema().map(|schema| schema.data).unwrap_or_default();
    Channel { topic, schema_name, schema: Schema::Protobuf(descriptors) }
}

/// Names of the channels of a scene.
pub fn topics() -> [&'static str; 7] {
    [POSE, TRANSFORM, NUMBERS, PLAN, FLIGHT, REFERENCE, LOG]
}

impl Scene {
    /// The scene of a flight whose log's time 0 is `started_unix_ns` after 1970.
    ///
    /// # Errors
    /// A mission that breaks its rules.
    pub fn new(flight: &FlightTable, started_unix_ns: u64) -> Result<Self, SettingError> {
        let dt_s = flight.cycle.dt_s;
        let outline = ReferencePath::of(flight)?.outline;
        let reference = every(&outline, REFERENCE_POINTS);
        Ok(Self {
            started_unix_ns,
            predictor: TrajectoryPredictor::new(&flight.cycle)?,
            flight_every: ticks(FLIGHT_EVERY_S, dt_s),
            reference_every: ticks(REFERENCE_EVERY_S, dt_s),
            reference: reference.iter().map(|at| point(pos_w_of(at))).collect(),
            trail: VecDeque::with_capacity(TRAIL_POINTS),
            last_logged: LastLogged::default(),
            plots: Plots { names: Vec::new(), values: Vec::with_capacity(NUMBERS_MAX) },
            bytes: Vec::new(),
        })
    }

    /// Adds a tick to `log`, whose channels are those of [`flight_log::create`](crate::flight_log::create).
    ///
    /// # Errors
    /// As [`LogWriter::write`].
    pub fn write(&mut self, log: &mut LogWriter, tick: &TickRecord) -> Result<(), LogError> {
        let (t, out) = (tick.inbox.now, &tick.out);
        let now = self.started_unix_ns.saturating_add_signed(t.0);
        if let Some(at) = out.pose_hat() {
            let pose = pose_of(&at);
            let moved = transform(now, WORLD, VEHICLE, pose);
            let in_frame =
                PoseInFrame { timestamp: moment(now), frame_id: WORLD.into(), pose: Some(pose) };
            self.put(log, POSE, t, &in_frame)?;
            self.put(log, TRANSFORM, t, &moved)?;
            log.write_bytes(NUMBERS, t, &self.plots.of(now, out))?;
            if out.step % self.flight_every == 0 {
                let (flight, plan) = self.flight(now, &at, out);
                self.put(log, FLIGHT, t, &flight)?;
                if let Some(plan) = plan {
                    self.put(log, PLAN, t, &plan)?;
                }
            }
        }
        self.predictor.note(out);
        if out.step % self.reference_every == 0 {
            let drawn = entity(now, WORLD, "course").staying();
            let entities = vec![drawn.line(self.reference.clone(), GREY)];
            self.put(log, REFERENCE, t, &SceneUpdate { deletions: Vec::new(), entities })?;
        }
        for (level, message) in self.last_logged.news(out) {
            let (timestamp, name) = (moment(now), "tello-ctl".to_owned());
            let message = Log { timestamp, level: level.into(), message, name, ..Log::default() };
            self.put(log, LOG, t, &message)?;
        }
        Ok(())
    }

    fn put<M>(
        &mut self,
        log: &mut LogWriter,
        topic: &'static str,
        t: TimeNs,
        message: &M,
    ) -> Result<(), LogError>
    where
        M: Encode,
        M::Error: Send + Sync + 'static,
    {
        self.bytes.clear();
        message
            .encode(&mut self.bytes)
            .map_err(|error| LogError::Encode { topic: topic.into(), source: error.into() })?;
        log.write_bytes(topic, t, &self.bytes)
    }

    /// Trail, prediction over the dead time, plan, places to be, and the vehicle itself; the plan once more as
    /// places, from here on, if there is one.
    fn flight(&mut self, now: u64, at: &Row, out: &Outcome) -> (SceneUpdate, Option<PosesInFrame>) {
        if self.trail.len() == TRAIL_POINTS {
            self.trail.pop_front();
        }
        self.trail.push_back(point(pos_w_of(at)));
        let world = |id| entity(now, WORLD, id);
        let mut entities = vec![
            world("trail").line(self.trail.iter().copied().collect(), BLUE),
            world("target").sphere(&out.target, PLACE_M, VERMILION),
            entity(now, VEHICLE, "vehicle").cube(VEHICLE_M, BLUE),
        ];
        if let Some(reference) = &out.reference {
            entities.push(world("reference").sphere(reference, PLACE_M, GREY));
        }
        let PredictedTrajectory { committed, plan } = self.predictor.ahead(out);
        let mut ahead = None;
        if !plan.is_empty() {
            let poses = committed.iter().chain(plan.iter().skip(1)).copied().map(at_place);
            ahead = Some(PosesInFrame {
                timestamp: moment(now),
                frame_id: WORLD.into(),
                poses: poses.collect(),
            });
            let line = |places: Vec<_>| places.into_iter().map(point).collect();
            entities.push(world("prediction").line(line(committed), ORANGE));
            entities.push(world("plan").line(line(plan), GREEN));
        }
        (SceneUpdate { deletions: Vec::new(), entities }, ahead)
    }
}

impl Plots {
    /// The numbers of a tick as a message: state, measurement, reference, target, sent sticks. NaN where one is
    /// missing.
    fn of(&mut self, stamp_ns: u64, out: &Outcome) -> Vec<u8> {
        if self.names.is_empty() {
            self.names.extend(out.state_rows.iter().map(|row| format!("state.{}", row.name)));
            for kind in ["measured", "reference", "target"] {
                self.names.extend(POSE_ROWS.iter().map(|row| format!("{kind}.{row}")));
            }
            self.names.extend(STICK_ROWS.iter().map(|row| format!("sticks.{row}")));
        }
        let missing = Row::repeat(f64::NAN);
        self.values.clear();
        self.values.extend(&out.s_hat);
        for pose in [&out.raw, &out.reference, &Some(out.target)] {
            self.values.extend(pose.as_ref().unwrap_or(&missing).iter());
        }
        self.values.extend(out.u_sent.iter());
        numbers(stamp_ns, &self.names, &self.values)
    }
}

impl LastLogged {
    /// Changes since the tick before, as messages.
    fn news(&mut self, out: &Outcome) -> Vec<(Level, String)> {
        let mut news = Vec::new();
        let now = Self {
            phase: out.decision.map(|decision| decision.phase),
            faults: out.decision.map(|decision| decision.faults).unwrap_or_default(),
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
pub(crate) mod tests {
    use horizon_model::{Kinematic, Model};
    use tello_flight::Decision;

    use super::*;

    pub(crate) fn out(targets_reached: usize, phase: Phase) -> Outcome {
        let mut out = Outcome::with_buffers(&Kinematic::STATE, &Kinematic::PARAMETER, 3);
        out.targets_reached = targets_reached;
        out.decision = Some(Decision {
            phase,
            pilot: None,
            is_braking: false,
            order: None,
            faults: FaultSet::default(),
            ended_by: FaultSet::default(),
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
