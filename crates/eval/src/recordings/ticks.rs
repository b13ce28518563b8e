//! A log of a flight of ours, tick by tick: what identification, CSV and report need of it.

use anyhow::{Result, bail};
use horizon_estim::Observed;
use horizon_model::rows::{Pose, Sticks, gain, pose, stick};
use nalgebra::SVector;
use serde::Deserialize;
use serde::de::{DeserializeOwned, IgnoredAny};
use tello_flight::cycle::{
    FilteredRecord, LinkRecord, PhaseRecord, PoseRecord, SticksRecord, Timing, Topic,
};
use tello_flight::{Acceptance, Phase};
use tello_io::clock::TimeNs;
use tello_io::log::{CONFIG, LogReader, Message};

use super::from_rows::accepted;
use super::rows::{GainRecord, loss};
use super::{PERIOD_S, Sample, note};
use crate::flight_log::is_replay;

/// Record of one tick in the log.
#[derive(Debug, Clone, Default)]
pub struct TickRow {
    /// Periods since the start of the log, those without a tick included.
    pub period: u64,
    /// Ticks between the one before and this one that the log lacks.
    pub missing_before: u64,
    /// Whether a person steered.
    pub is_by_hand: bool,
    /// Raw pose that arrived in the tick. m, rad
    pub raw: Option<Pose>,
    /// Last accepted pose, and whether position and heading are new. m, rad
    pub filtered: Option<(Pose, [bool; 2])>,
    /// Estimated pose. m, rad
    pub estimate: Option<Pose>,
    /// Estimated parameter. Unit of each row
    pub param: Option<SVector<f64, { gain::COUNT }>>,
    /// Pose predicted over the dead time. m, rad
    pub prediction: Option<Pose>,
    /// Where the mission wants the vehicle to be at the prediction's time. m, rad
    pub reference: Option<Pose>,
    /// Present target. m, rad
    pub target: Option<Pose>,
    /// Number of targets reached so far.
    pub targets_reached: usize,
    /// Sticks that were sent. 1
    pub u_sent: Option<Sticks>,
    /// Phase after the tick.
    pub phase: Option<Phase>,
    /// Whether the sent sticks do not act; `None` without a link monitor.
    pub is_link_down: Option<bool>,
    /// Names of the present faults.
    pub faults: Vec<String>,
    /// How long the tick took.
    pub timing: Option<Timing>,
    /// Age of the newest mocap sample when the tick began. s
    pub mocap_age_s: Option<f64>,
    /// The obstacle that moves, if it was seen since the tick before. World frame. m
    pub obstacle_w: Option<[f64; 3]>,
}

/// Fields of an inbox that place its tick in time.
#[derive(Deserialize)]
struct InboxHead {
    step: u64,
    skipped: u64,
    now: TimeNs,
    sightings: Vec<SightingHead>,
    #[serde(rename = "obstacle", default)]
    obstacle_w: Option<[f64; 3]>,
    #[serde(default)]
    manual: Option<IgnoredAny>,
}

/// Field of a sighting that gives its age.
#[derive(Deserialize)]
struct SightingHead {
    measured_at: TimeNs,
}

/// Fields of a target beside its pose.
#[derive(Deserialize)]
struct TargetHead {
    targets_reached: usize,
}

/// Faults by their names, which may be those of another version.
#[derive(Deserialize)]
struct FaultNames {
    faults: Vec<String>,
}

impl InboxHead {
    fn mocap_age_s(&self) -> Option<f64> {
        Some(self.now.since(self.sightings.last()?.measured_at).0 as f64 * 1e-9)
    }
}

const REPEATED: &str = "repeated";

/// Whether a note on what is not in a log is that of ticks that came again: it may hold two flights.
pub(crate) fn is_repetition(note: &str) -> bool {
    note.ends_with(REPEATED)
}

/// Every tick of the log, the first one of each step; `skipped` gets the reasons of records that cannot be read.
///
/// # Errors
/// The disk fails.
pub fn read(log: &mut LogReader, skipped: &mut Vec<String>) -> Result<Vec<TickRow>> {
    let mut ticks: Vec<TickRow> = Vec::new();
    let (mut periods_skipped, mut unreadable, mut misplaced) = (0, 0, 0);
    let (mut missing, mut repeated, mut next_step) = (0, 0, 0);
    // Time of the tick whose records come, and whether they count.
    let mut open = None;
    while let Some(message) = log.next_message()? {
        let Some(topic) = Topic::named(message.topic) else { continue };
        if topic == Topic::Inbox {
            let before = open.take();
            let Some(inbox) = decode::<InboxHead>(&message, &mut unreadable) else { continue };
            if inbox.step < next_step {
                repeated += 1;
                open = before.filter(|(t, _)| *t == message.t).or(Some((message.t, false)));
                continue;
            }
            open = Some((message.t, true));
            let missing_before = inbox.step - next_step;
            missing += missing_before;
            next_step = inbox.step.saturating_add(1);
            periods_skipped += inbox.skipped;
            ticks.push(TickRow {
                period: inbox.step + periods_skipped,
                missing_before,
                is_by_hand: inbox.manual.is_some(),
                mocap_age_s: inbox.mocap_age_s(),
                obstacle_w: inbox.obstacle_w,
                ..TickRow::default()
            });
            continue;
        }
        // Without its inbox a tick has no place in time: it is missing.
        match (ticks.last_mut(), open.filter(|(t, _)| *t == message.t)) {
            (Some(tick), Some((_, true))) => tick.take(topic, &message, &mut unreadable),
            (_, Some((_, false))) => {}
            _ => misplaced += 1,
        }
    }
    note(skipped, usize::try_from(missing).unwrap_or(usize::MAX), "tick", "missing");
    note(skipped, repeated, "tick", REPEATED);
    note(skipped, unreadable, "record", "that cannot be read");
    note(skipped, misplaced, "record", "of missing ticks");
    skipped.extend(loss(log));
    Ok(ticks)
}

impl TickRow {
    /// Takes over a record of the tick.
    fn take(&mut self, topic: Topic, message: &Message<'_>, unreadable: &mut usize) {
        match topic {
            Topic::Raw => self.raw = pose(message, unreadable),
            Topic::State => self.estimate = pose(message, unreadable),
            Topic::Prediction => self.prediction = pose(message, unreadable),
            Topic::Reference => self.reference = pose(message, unreadable),
            Topic::Target => {
                self.target = pose(message, unreadable);
                let head = decode::<TargetHead>(message, unreadable);
                self.targets_reached = head.map_or(0, |head| head.targets_reached);
            }
            Topic::Link => {
                let record = decode::<LinkRecord>(message, unreadable);
                self.is_link_down = record.map(|record| record.is_down);
            }
            Topic::Fault => {
                let record = decode::<FaultNames>(message, unreadable);
                self.faults = record.map(|record| record.faults).unwrap_or_default();
            }
            Topic::Timing => self.timing = decode(message, unreadable),
            Topic::Filtered => {
                let record = decode::<FilteredRecord>(message, unreadable);
                self.filtered = record.map(|record| {
                    let is_new = |acceptance| acceptance == Acceptance::Accepted;
                    (record.pose.pose(), [is_new(record.position), is_new(record.heading)])
                });
            }
            Topic::Parameter => {
                let record = decode::<GainRecord>(message, unreadable);
                self.param = record.map(|record| record.param());
            }
            Topic::Command => {
                let record = decode::<SticksRecord>(message, unreadable);
                self.u_sent = record.map(|record| record.sticks());
            }
            Topic::Phase => {
                let record = decode::<PhaseRecord>(message, unreadable);
                self.phase = record.map(|record| record.phase);
            }
            _ => {}
        }
    }
}

fn decode<T: DeserializeOwned>(message: &Message<'_>, unreadable: &mut usize) -> Option<T> {
    let record = message.decode().ok();
    *unreadable += usize::from(record.is_none());
    record
}

fn pose(message: &Message<'_>, unreadable: &mut usize) -> Option<Pose> {
    decode::<PoseRecord>(message, unreadable).map(|record| record.pose())
}

/// Climb that is none of a vehicle which holds its height. m/s
const CLIMB_MPS: f64 = 0.1;

/// Ticks over which a climb is measured.
const CLIMB_TICKS: usize = 10;

/// The [`commanded`] ticks of a log whose period is that of every recording.
///
/// # Errors
/// As [`commanded`]; the log is none of a flight, or its period is another.
pub(super) fn of_recording(log: &mut LogReader, skipped: &mut Vec<String>) -> Result<Vec<TickRow>> {
    let config = log.head().documents.get(CONFIG).map_or("", String::as_str);
    let config: serde_json::Value = serde_json::from_str(config).unwrap_or_default();
    match config.pointer("/cycle/dt_s").and_then(serde_json::Value::as_f64) {
        Some(dt_s) if (dt_s - PERIOD_S).abs() < 1e-9 => {}
        Some(dt_s) => bail!("its period is {dt_s} s, not {PERIOD_S} s"),
        None => bail!("it carries no settings of a flight"),
    }
    commanded(log, skipped)
}

/// What a tick observed.
pub(super) fn sample(tick: &TickRow) -> Sample {
    Sample {
        step: tick.period,
        u: tick.u_sent,
        o: tick
            .filtered
            .map_or_else(Observed::missing, |(o, [is_position_new, is_heading_new])| {
                accepted(o, is_position_new, is_heading_new)
            }),
        // In flight the filter and the supervisor have judged it.
        has_jumped: false,
    }
}

/// The ticks of a log in which nothing but commands moves the vehicle: from the first command of the flying
/// phase on, or from the end of the climb that the firmware still flies then, to the last tick of that phase.
/// `skipped` names every other part.
///
/// # Errors
/// The disk fails, the log is a dry run or a replay, it never flew, or no command was sent.
pub fn commanded(log: &mut LogReader, skipped: &mut Vec<String>) -> Result<Vec<TickRow>> {
    let config = log.head().documents.get(CONFIG).map_or("", String::as_str);
    let config: serde_json::Value = serde_json::from_str(config).unwrap_or_default();
    if config.pointer("/start").and_then(serde_json::Value::as_str) == Some("carried") {
        bail!("it is a dry run: its sticks were never sent");
    }
    if is_replay(log) {
        bail!("it is a replay of another log, which counts");
    }
    let mut ticks = read(log, skipped)?;
    let is_flying = |tick: &TickRow| tick.phase == Some(Phase::Flying);
    let (Some(first), Some(last)) =
        (ticks.iter().position(is_flying), ticks.iter().rposition(is_flying))
    else {
        bail!("it never reached the flying phase");
    };
    let count = |phases: &[Phase]| {
        let is_in = |tick: &&TickRow| tick.phase.is_some_and(|phase| phases.contains(&phase));
        ticks.iter().filter(is_in).count()
    };
    note(skipped, count(&[Phase::Idle]), "tick", "before the take-off");
    note(skipped, count(&[Phase::TakingOff]), "tick", "of the take-off");
    note(skipped, count(&[Phase::Landing, Phase::Landed]), "tick", "of the landing");
    note(
        skipped,
        count(&[Phase::LandingUnconfirmed]),
        "tick",
        "of a landing that was not confirmed",
    );
    note(skipped, count(&[Phase::MotorsStopped]), "tick", "after an emergency stop");
    let Some(alone) = commands_act(&ticks[first..=last]) else {
        bail!("no command was sent while it flew");
    };
    note(skipped, alone, "tick", "in which the firmware flew by itself");
    ticks.truncate(last + 1);
    ticks.drain(..first + alone);
    Ok(ticks)
}

/// The first of the `ticks` of the flying phase from which on commands alone act: that of the first command, or
/// the first in which the throttle is given or the vehicle does not climb. `None` without a command.
fn commands_act(ticks: &[TickRow]) -> Option<usize> {
    let is_neutral = |u: Option<Sticks>| u.is_none_or(|u| u.amax() <= 0.0);
    let first = ticks.iter().position(|tick| !is_neutral(tick.u_sent))?;
    let throttle = |tick: &TickRow| tick.u_sent.map_or(0.0, |u| u[stick::THROTTLE].abs());
    let climbs = |k: usize| {
        let rise = k.checked_sub(CLIMB_TICKS).and_then(|before| {
            let height = |k: usize| ticks[k].filtered.map(|(o, _)| o[pose::Z]);
            Some(height(k)? - height(before)?)
        });
        rise.is_some_and(|rise_m| rise_m > CLIMB_MPS * CLIMB_TICKS as f64 * PERIOD_S)
    };
    let is_ordered = |k: &usize| throttle(&ticks[*k]) > 0.0;
    (first..ticks.len()).find(|k| is_ordered(k) || !climbs(*k))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tick at this height with these sticks: pitch and throttle.
    fn tick(height_m: Option<f64>, sticks: Option<[f64; 2]>) -> TickRow {
        let u_sent = sticks.map(|[pitch, throttle]| {
            let mut u = Sticks::zeros();
            (u[stick::PITCH], u[stick::THROTTLE]) = (pitch, throttle);
            u
        });
        let filtered = height_m.map(|z| (Pose::new(0.0, 0.0, z, 0.0), [true; 2]));
        TickRow { filtered, u_sent, ..TickRow::default() }
    }

    /// Ticks that climb at `climb_mps` and are sent pitch from tick 12 on.
    fn climbing(climb_mps: f64, ticks: usize) -> Vec<TickRow> {
        let sent = |k: usize| if k < 12 { [0.0, 0.0] } else { [0.2, 0.0] };
        let height = |k: usize| 1.0 + climb_mps * PERIOD_S * k as f64;
        (0..ticks).map(|k| tick(Some(height(k)), Some(sent(k)))).collect()
    }

    #[test]
    fn commands_act_from_the_first_one_on_if_the_height_is_held() {
        assert_eq!(commands_act(&climbing(0.0, 40)), Some(12));
        assert_eq!(commands_act(&climbing(0.09, 40)), Some(12));
        assert_eq!(commands_act(&climbing(0.11, 40)), None, "it climbs to the end");
        assert_eq!(commands_act(&climbing(0.0, 12)), None, "no command");
        assert_eq!(commands_act(&[tick(None, None), tick(None, Some([0.0, 0.1]))]), Some(1));
        assert_eq!(commands_act(&[]), None);
    }

    #[test]
    fn a_climb_of_the_firmware_ends_before_commands_act() {
        let mut ticks = climbing(0.5, 60);
        ticks.extend((0..20).map(|_| tick(Some(1.595), Some([0.2, 0.0]))));
        // At most 1.59 m up to tick 59, 1.595 m from then on: the rise over ten ticks falls to 1.5 cm.
        assert_eq!(commands_act(&ticks), Some(68));
        ticks[30].u_sent = tick(None, Some([0.0, -0.3])).u_sent;
        assert_eq!(commands_act(&ticks), Some(30), "from then on the throttle is given");
        // Before ten ticks a climb cannot be measured.
        ticks[3].u_sent = tick(None, Some([0.2, 0.0])).u_sent;
        assert_eq!(commands_act(&ticks), Some(3));
    }

    #[test]
    fn the_age_of_a_sample_is_that_of_the_newest_sighting() {
        let inbox = |sightings: &str| -> InboxHead {
            let json = format!(
                r#"{{"step": 1, "skipped": 0, "now": 50000000, "sightings": [{sightings}]}}"#
            );
            serde_json::from_str(&json).unwrap()
        };
        assert_eq!(inbox("").mocap_age_s(), None);
        let two = r#"{"measured_at": 10000000}, {"measured_at": 38000000}"#;
        assert!((inbox(two).mocap_age_s().unwrap() - 0.012).abs() < 1e-12);
    }
}
