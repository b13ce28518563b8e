//! A recorded flight as the report sees it: its ticks, the line that it followed, and which ticks count.
//!
//! Owns when a flight begins and ends. A log of ours states which targets were reached and what the line
//! was. A recording of the thesis only states which target was wanted: a target is reached when the next one
//! takes its place, and targets that equal the pose mean that a pilot flies.

use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use horizon_model::rows::{Pose, pose};
use horizon_model::{Kinematic, Model};
use tello_flight::cycle::FlightTable;
use tello_flight::{Phase, Start};
use tello_io::log::LogReader;

use crate::flight_log;
use crate::metrics::{Corner, ReferencePath, Surroundings, corners};
use crate::recordings::rows::{self, RowFlight};
use crate::recordings::ticks::{self, TickRow};
use crate::recordings::{PERIOD_S, is_mcap, note};

/// A recording of the thesis is finished if it ends within this of its last target, no pilot having taken
/// over before: the larger of the thesis' required distances (section 5.2.4). m
const LAST_REACH_M: f64 = 0.3;

/// A list of more targets than this, each for less than a second on average, follows something: a person flew.
const TARGETS_FEW: usize = 20;
const TARGET_PERIODS_MIN: usize = 50;

/// Steps over which the thesis' controller predicts (section 5.2.1): 0.6 s.
const THESIS_DELAY_STEPS: usize = 30;

/// One recorded flight.
#[derive(Debug, Clone)]
pub(super) struct Flight {
    /// Path of the recording.
    pub path: PathBuf,
    /// Its name without folder and ending.
    pub name: String,
    /// Period of the loop. s
    pub dt_s: f64,
    /// Record of each tick.
    pub ticks: Vec<TickRow>,
    /// Corners of the line to follow, of one lap; empty if the recording names none. m, rad
    pub outline: Vec<Pose>,
    /// Poses to reach, in their order. m, rad
    pub targets: Vec<Pose>,
    /// Its corners, none of them passed; a curve has none.
    pub corners: Vec<Corner>,
    /// Ticks from the first target to the last; without targets, every tick in flight.
    pub judged: Range<usize>,
    /// What the ticks that count lack, in words: times and distances are not those of the whole flight.
    pub gaps: Vec<String>,
    /// Targets reached, and how many there are to reach.
    pub reached: [usize; 2],
    /// Skipped parts of the recording and other remarks.
    pub notes: Vec<String>,
    /// Kind of a log that is no flight and is not judged.
    pub unjudged: Option<&'static str>,
}

impl Flight {
    /// The flight in a file.
    ///
    /// # Errors
    /// The file cannot be read, or there is no flight in it.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let is_mcap = is_mcap(path)?;
        let flight = if is_mcap {
            let mut log = LogReader::open(path)?;
            if rows::is_recording(&log) {
                Self::of_rows(rows::of_log(&mut log)?)
            } else {
                Self::of_log(&mut log, path)?
            }
        } else {
            Self::of_rows(rows::read(path, false)?)
        };
        ensure!(!flight.ticks.is_empty(), "there is no tick in {}", path.display());
        Ok(Self { path: path.to_owned(), name, ..flight })
    }

    /// Whether the last target was reached.
    pub(super) fn is_finished(&self) -> bool {
        let [reached, count] = self.reached;
        count > 0 && reached == count
    }

    /// Whether its numbers are those of the controller over all ticks that count.
    pub(super) fn is_measurable(&self) -> bool {
        self.unjudged.is_none()
            && self.gaps.is_empty()
            && !self.judged_ticks().iter().any(|tick| tick.is_by_hand)
    }

    /// Time of a tick since the start of the recording. s
    pub(super) fn time_s(&self, tick: &TickRow) -> f64 {
        tick.period as f64 * self.dt_s
    }

    /// The ticks that count.
    pub(super) fn judged_ticks(&self) -> &[TickRow] {
        self.ticks.get(self.judged.clone()).unwrap_or_default()
    }

    fn of_log(log: &mut LogReader, path: &Path) -> Result<Self> {
        let settings = flight_log::settings(log, path)?;
        let unjudged = if flight_log::is_replay(log) {
            Some("it is a replay of another log, which counts")
        } else if settings.start == Start::Carried {
            Some("it is a dry run: its sticks were never sent")
        } else {
            None
        };
        let reference = ReferencePath::of(&settings)?;
        let mut notes = Vec::new();
        let ticks = ticks::read(log, &mut notes)?;
        notes.extend(nearest_obstacle(&settings, &ticks)?);
        let is_flying = |tick: &TickRow| tick.phase == Some(Phase::Flying);
        let begin = ticks.iter().position(|tick| is_flying(tick) && tick.targets_reached > 0);
        // A flight to one place is judged to the end of its phase.
        let is_hover = reference.targets_count == 1;
        let end = ticks
            .iter()
            .position(|tick| !is_hover && tick.targets_reached == reference.targets_count)
            .or_else(|| ticks.iter().rposition(is_flying))
            .map_or(0, |last| last + 1);
        let reached = ticks.iter().map(|tick| tick.targets_reached).max().unwrap_or(0);
        let judged = begin.unwrap_or(end)..end;
        let behind = (end + usize::from(is_hover)).min(ticks.len());
        let mut gaps = gaps(&ticks, &(judged.start..behind));
        gaps.extend(notes.iter().filter(|note| ticks::is_repetition(note)).cloned());
        if judged.is_empty() && reached == reference.targets_count {
            gaps.push("no tick of the part that counts".to_owned());
        }
        Ok(Self {
            path: PathBuf::new(),
            name: String::new(),
            dt_s: settings.cycle.dt_s,
            gaps,
            judged,
            reached: [reached, reference.targets_count],
            ticks,
            corners: reference.corners(),
            outline: reference.lap_outline(),
            targets: reference.targets,
            notes,
            unjudged,
        })
    }

    fn of_rows(flight: RowFlight) -> Self {
        let RowFlight { rows, mut notes, .. } = flight;
        let mut ticks: Vec<TickRow> = rows
            .iter()
            .map(|row| TickRow {
                period: row.step,
                estimate: row.pos,
                u_sent: row.input,
                target: row.target,
                param: row.param,
                ..TickRow::default()
            })
            .collect();
        let is_piloted = |tick: &TickRow| tick.target.is_some() && tick.target == tick.estimate;
        // A target at the estimate in one tick alone may be chance.
        let taken_over = ticks.windows(2).position(|pair| pair.iter().all(is_piloted));
        let end = taken_over.unwrap_or(ticks.len());
        let is_alone = taken_over.is_none();
        if let Some(tick) = ticks.get(end) {
            let at_s = tick.period as f64 * PERIOD_S;
            notes.push(format!("from {at_s:.2} s on a pilot flies; what follows does not count"));
        }
        // Ticks after the last target are the landing.
        let end = ticks[..end]
            .iter()
            .rposition(|tick| tick.target.is_some())
            .map_or(end, |last| last + 1);
        let targets = count_targets(&mut ticks[..end]);
        let first = ticks[..end].iter().position(|tick| tick.targets_reached > 0);
        let follows = targets.len() > TARGETS_FEW && targets.len() * TARGET_PERIODS_MIN > end;
        let has_line = targets.len() > 1 && !follows;
        let last = ticks[..end].iter().rev().find_map(|tick| tick.estimate);
        let is_at_last = last.zip(targets.last()).is_some_and(|(at, target)| {
            is_alone && (at - target).fixed_rows::<2>(pose::X).norm() <= LAST_REACH_M
        });
        predict(&mut ticks[..end]);
        let judged = if has_line { first.unwrap_or(end)..end } else { 0..ticks.len() };
        let reached = [targets.len().saturating_sub(usize::from(!is_at_last)), targets.len()];
        Self {
            path: PathBuf::new(),
            name: String::new(),
            dt_s: PERIOD_S,
            gaps: Vec::new(),
            judged,
            reached: if has_line { reached } else { [0, 0] },
            outline: if has_line { targets.clone() } else { Vec::new() },
            corners: if has_line { corners(&targets) } else { Vec::new() },
            targets: if has_line { targets } else { Vec::new() },
            ticks,
            notes,
            unjudged: None,
        }
    }
}

/// What is missing of `ticks` in the range `judged` and before it begins, in words.
fn gaps(ticks: &[TickRow], judged: &Range<usize>) -> Vec<String> {
    let counted = ticks.get(judged.clone()).unwrap_or_default();
    let missing = counted.iter().fold(0, |sum: u64, tick| sum.saturating_add(tick.missing_before));
    let without_pose = counted.iter().filter(|tick| tick.estimate.is_none()).count();
    let mut gaps = Vec::new();
    let missing = usize::try_from(missing).unwrap_or(usize::MAX);
    note(&mut gaps, missing, "tick", "missing where it counts");
    note(&mut gaps, without_pose, "tick", "without an estimate where it counts");
    gaps
}

/// For how long the place of an obstacle that moves counts. periods
const OBSTACLE_PERIODS_MAX: u64 = 25;

/// How near the vehicle came to an obstacle while it flew; `None` without obstacles.
fn nearest_obstacle(settings: &FlightTable, ticks: &[TickRow]) -> Result<Option<String>> {
    let surroundings = Surroundings::of(&settings.cycle)?;
    let mut seen: Option<([f64; 3], u64)> = None;
    let mut nearest: Option<(f64, u64)> = None;
    for tick in ticks {
        seen = tick.obstacle_w.map(|at_w| (at_w, tick.period)).or(seen);
        let moving_w = seen
            .filter(|(_, since)| tick.period - since <= OBSTACLE_PERIODS_MAX)
            .map(|(at_w, _)| at_w);
        let at = tick.estimate.filter(|_| tick.phase == Some(Phase::Flying));
        let distance_m = at.and_then(|at| surroundings.at(&at, moving_w).obstacle_m);
        if let Some(distance_m) = distance_m
            && nearest.is_none_or(|(least_m, _)| distance_m < least_m)
        {
            nearest = Some((distance_m, tick.period));
        }
    }
    Ok(nearest.map(|(distance_m, period)| {
        let at_s = period as f64 * settings.cycle.dt_s;
        if distance_m < 0.0 {
            format!("it was {:.2} m inside of an obstacle at {at_s:.2} s", -distance_m)
        } else {
            format!("nearest to an obstacle: {distance_m:.2} m at {at_s:.2} s")
        }
    }))
}

/// The targets in their order. A tick whose successor has another target has reached its own.
fn count_targets(ticks: &mut [TickRow]) -> Vec<Pose> {
    let mut targets: Vec<Pose> = Vec::new();
    let mut before: Option<usize> = None;
    for k in 0..ticks.len() {
        if let Some(target) = ticks[k].target
            && targets.last() != Some(&target)
        {
            targets.push(target);
            if let Some(before) = before {
                ticks[before].targets_reached = targets.len() - 1;
            }
        }
        ticks[k].targets_reached = targets.len().saturating_sub(1);
        before = Some(k);
    }
    targets
}

/// Adds the pose that the thesis' controller predicted: equation 4.1 over the sticks of the last 0.6 s,
/// with the recorded parameter.
fn predict(ticks: &mut [TickRow]) {
    for k in THESIS_DELAY_STEPS..ticks.len() {
        let (Some(at), Some(p)) = (ticks[k].estimate, ticks[k].param) else { continue };
        let sticks = ticks[k - THESIS_DELAY_STEPS..k].iter().filter_map(|tick| tick.u_sent);
        let predicted = sticks.fold(at, |s, u| Kinematic.step(&s, &u, &p, PERIOD_S));
        ticks[k].prediction = Some(predicted);
    }
}

#[cfg(test)]
mod tests {
    use tello_io::log::csv::CsvRow;

    use super::*;

    fn flight(rows: &[(f64, [f64; 2])]) -> Flight {
        let row = |(step, &(x, [x_target, y_target])): (u64, &(f64, [f64; 2]))| CsvRow {
            step,
            pos: Some(Pose::new(x, 0.0, 1.0, 0.0)),
            target: Some(Pose::new(x_target, y_target, 1.0, 0.0)),
            ..CsvRow::default()
        };
        let rows = (0..).zip(rows).map(row).collect();
        Flight::of_rows(RowFlight { rows, decimals: 4, notes: vec![], is_complete: true })
    }

    #[test]
    fn a_target_is_reached_when_the_next_one_takes_its_place() {
        let (first, second, third) = ([0.0, 0.0], [1.0, 0.0], [2.0, 0.0]);
        let flight =
            flight(&[(0.0, first), (0.1, first), (0.5, second), (0.9, second), (1.9, third)]);
        let reached: Vec<usize> = flight.ticks.iter().map(|tick| tick.targets_reached).collect();
        assert_eq!(reached, [0, 1, 1, 2, 2]);
        assert_eq!(flight.judged, 1..5);
        assert!(flight.is_finished(), "{:?}", flight.reached);
    }

    #[test]
    fn a_target_that_follows_the_pose_ends_the_flight() {
        let (first, second) = ([0.0, 0.0], [1.0, 0.0]);
        let flight = flight(&[(0.1, first), (0.4, second), (0.5, [0.5, 0.0]), (0.6, [0.6, 0.0])]);
        assert_eq!((flight.judged.clone(), flight.reached), (0..2, [1, 2]));
        assert!(!flight.is_finished() && flight.notes[0].contains("0.04 s"), "{:?}", flight.notes);
    }

    #[test]
    fn gaps_are_what_the_ticks_that_count_lack() {
        let tick = |missing_before: u64| TickRow {
            missing_before,
            estimate: (missing_before != 7).then(Pose::zeros),
            ..TickRow::default()
        };
        let ticks = [1, 0, 20, 7, 300].map(tick);
        assert_eq!(gaps(&ticks, &(1..2)), [""; 0]);
        assert_eq!(
            gaps(&ticks, &(1..4)),
            ["27 ticks missing where it counts", "1 tick without an estimate where it counts"]
        );
    }

    #[test]
    fn without_a_second_target_there_is_no_line() {
        let flight = flight(&[(0.1, [0.0, 0.0]), (0.4, [0.0, 0.0])]);
        assert!(flight.outline.is_empty() && !flight.is_finished());
        assert_eq!(flight.judged, 0..2);
    }
}
