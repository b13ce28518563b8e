//! The summary of a flight that is over.

mod end;

use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

use horizon_model::setting::SettingError;
use schemars::JsonSchema;
use serde::Serialize;
use tello_flight::cycle::{FlightTable, Pipeline, Timing};
use tello_flight::jitter::{Jitter, RECORD_EVERY_TICKS};
use tello_flight::{Fault, Phase};
use tello_io::link_diagnosis::{RefusedHeadings, hidden};
use tello_io::mocap::{MocapCounters, Sighting, StreamReport};
use tello_io::tello::LinkCounters;

pub use self::end::{Links, LoopEnd};
use crate::flight_log::TickRecord;
use crate::metrics::{
    FlownTrack, LATE_TICK_MS, Lap, Metrics, OutageCounter, Outages, ReferencePath,
};
use crate::quantiles;

/// Fractions of the quantiles of a summary.
const SPREAD: [f64; 4] = [0.5, 0.95, 0.999, 1.0];

/// Gathers the figures of a flight record by record, on the logger's thread.
#[derive(Debug)]
pub struct Tally {
    track: FlownTrack,
    dt_s: f64,
    outages: OutageCounter,
    by_hand_s: f64,
    targets_count: usize,
    ticks: u64,
    late_ticks: u64,
    missed_periods: u64,
    solve_ms: Vec<f64>,
    /// Whether sticks answer the frames of their own tick.
    is_same_tick: bool,
    /// From the newest frame of the tick before to when its sticks set out. ms
    set_out_ms: Option<f64>,
    answer_ms: Vec<f64>,
    jitter: Jitter,
    headings: RefusedHeadings,
}

/// The summary of a flight; see [`Metrics`] for the definitions.
#[derive(Debug, Clone, PartialEq, Default, Serialize, JsonSchema)]
pub struct Summary {
    /// Whether it was a dry run.
    pub is_dry_run: bool,
    /// Phase at the end.
    pub phase: Phase,
    /// Targets reached.
    pub targets_reached: usize,
    /// Targets to reach.
    pub targets_count: usize,
    /// Figures along the path; null if the first target was not reached.
    pub metrics: Option<Metrics>,
    /// Figures of each lap that was begun; empty for a way that is flown once.
    pub laps: Vec<Lap>,
    /// Every fault that was present at some time after the take-off was ordered.
    pub faults: Vec<Fault>,
    /// Faults that ended the flight. After a finished mission at most `landed_by_pose` or `landed_by_drone`.
    pub ended_by: Vec<Fault>,
    /// Ticks of the loop.
    pub ticks: u64,
    /// Ticks that began more than 5 ms late.
    pub late_ticks: u64,
    /// Periods without a tick.
    pub missed_periods: u64,
    /// Time of estimator and controller together in ticks with both: 50, 95, 99.9 and 100 %. ms
    pub solve_ms: Option<[f64; 4]>,
    /// From the bytes of a frame at our socket to those of the sticks that answer it: 50, 95, 99.9 and 100 %.
    /// The wait for the tick is included. ms
    pub answer_ms: Option<[f64; 4]>,
    /// How punctual the ticks were.
    pub jitter: Jitter,
    /// Commands lost in flight, as the motion showed.
    pub outages: Outages,
    /// How long a person steered in flight: figures along the path are not the controller's alone. s
    pub by_hand_s: f64,
    /// State of the mocap stream.
    pub mocap: StreamReport,
    /// What frames had in place of a pose when poses were lost; null if they were not, or the frames do not show it.
    pub hidden: Option<String>,
    /// Version of the drone's firmware; null if it was not reported.
    pub firmware: Option<String>,
    /// Text of the newest refusal of the drone; null if it did not.
    pub refusal: Option<String>,
    /// Longest time between two turns of the thread that talks to the drone, in flight: 40 at rest. ms
    pub sender_pause_ms: f64,
    /// What the links lost, and what was landed in place of the control thread.
    pub links: Links,
    /// Ticks that the log could not take.
    pub records_dropped: u64,
    /// The log; null if it ends before the flight does.
    pub log: Option<PathBuf>,
    /// Why the log is incomplete; null if it is complete.
    pub log_error: Option<String>,
}

impl Tally {
    /// Nothing gathered of `flight` so far.
    ///
    /// # Errors
    /// The mission breaks its rule.
    pub fn new(flight: &FlightTable) -> Result<Self, SettingError> {
        let reference = ReferencePath::of(flight)?;
        Ok(Self {
            targets_count: reference.targets_count,
            dt_s: flight.cycle.dt_s,
            outages: OutageCounter::default(),
            by_hand_s: 0.0,
            track: FlownTrack::new(reference, flight.cycle.dt_s),
            ticks: 0,
            late_ticks: 0,
            missed_periods: 0,
            solve_ms: Vec::new(),
            is_same_tick: flight.cycle.pipeline == Pipeline::SameTick,
            set_out_ms: None,
            answer_ms: Vec::new(),
            jitter: Jitter::default(),
            headings: RefusedHeadings::default(),
        })
    }

    /// Adds a tick; called for every one.
    pub fn add(&mut self, tick: &TickRecord) {
        let Timing { late_ns, estimate_ns, plan_ns, sent_ns, socket_latency_ns, .. } = tick.timing;
        let (out, ms) = (&tick.out, |ns: i64| ns as f64 * 1e-6);
        self.ticks += 1;
        self.jitter.add(&tick.timing);
        self.late_ticks += u64::from(ms(late_ns) > LATE_TICK_MS);
        self.missed_periods += tick.inbox.skipped;
        // How long its sticks took is known a tick later.
        self.answer_ms
            .extend(self.set_out_ms.take().map(|set_out_ms| set_out_ms + ms(socket_latency_ns)));
        if out.controller.is_some() && out.estimator.is_some() {
            self.solve_ms.push(ms(estimate_ns + plan_ns));
            let newest = tick.inbox.sightings.last().filter(|_| self.is_same_tick);
            let waited = |seen: &Sighting| tick.inbox.now.since(seen.received_at);
            self.set_out_ms = newest.map(|seen| ms(waited(seen).0 + sent_ns));
        }
        self.outages.add(out, self.dt_s);
        self.headings.add(out.filtered, self.dt_s);
        // A landing is no part of the mission.
        self.add_hand(out.phase(), tick.inbox.manual.is_some());
        if out.phase() == Phase::Flying
            && let Some(pose_hat) = out.pose_hat()
        {
            let now_s = tick.inbox.now.seconds();
            self.track.add(now_s, &pose_hat, &out.u_sent, out.targets_reached);
        }
    }

    fn add_hand(&mut self, phase: Phase, is_by_hand: bool) {
        if is_by_hand && phase == Phase::Flying {
            self.by_hand_s += self.dt_s;
        }
    }

    /// How punctual the ticks were so far, when it is time to record it.
    pub fn jitter_due(&self) -> Option<&Jitter> {
        self.ticks.is_multiple_of(RECORD_EVERY_TICKS).then_some(&self.jitter)
    }

    /// The summary, but for what only the control thread knows.
    pub fn summary(&self) -> Summary {
        Summary {
            targets_count: self.targets_count,
            metrics: self.track.metrics(),
            laps: self.track.laps(),
            outages: self.outages.outages(),
            by_hand_s: self.by_hand_s,
            ticks: self.ticks,
            late_ticks: self.late_ticks,
            missed_periods: self.missed_periods,
            jitter: self.jitter,
            solve_ms: quantiles(&self.solve_ms, SPREAD),
            answer_ms: quantiles(&self.answer_ms, SPREAD),
            hidden: self.headings.reason(),
            ..Summary::default()
        }
    }
}

impl Summary {
    /// The same, with what the control thread and the links know.
    #[must_use]
    pub fn with_end(
        self,
        end: &LoopEnd,
        mocap: &MocapCounters,
        object: &str,
        drone: &LinkCounters,
    ) -> Self {
        let faults = &end.faults_last;
        let is_lost = faults.contains(Fault::MocapLost) || faults.contains(Fault::MocapStale);
        Self {
            mocap: mocap.report(),
            hidden: hidden(mocap.since_pose(), object).or(self.hidden).filter(|_| is_lost),
            firmware: drone.facts().version.map(|version| version.to_string()),
            refusal: drone.refusal(),
            sender_pause_ms: drone.longest_pause().seconds() * 1e3,
            links: Links::of(drone, end),
            phase: end.phase,
            targets_reached: end.targets_reached,
            faults: end.faults.iter().collect(),
            ended_by: end.ended_by.iter().collect(),
            records_dropped: end.records_dropped,
            ..self
        }
    }

    /// Behind "landed": the source that did not confirm it.
    fn missing_confirmation(&self) -> &'static str {
        if self.faults.contains(&Fault::LandedByPose) {
            " by the pose alone; the drone does not report that it stands"
        } else if self.faults.contains(&Fault::LandedByDrone) {
            " by the drone alone; there was no pose of it"
        } else {
            ""
        }
    }

    /// Whether the flight did what it was for, whatever became of the log. A dry run has no targets to reach, and a
    /// person ends it.
    pub fn is_success(&self) -> bool {
        if self.is_dry_run {
            return self.phase.is_success(0, 0, &self.ended_by);
        }
        self.phase.is_success(self.targets_reached, self.targets_count, &self.ended_by)
    }

    /// Whether it also left a log that commands behind it can use.
    pub fn is_complete(&self) -> bool {
        self.is_success() && self.log_error.is_none() && self.records_dropped == 0
    }
}

impl Display for Summary {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.write_result(f)?;
        for causes in self.ended_by.iter().filter_map(|fault| fault.likely_causes()) {
            writeln!(f, "likely causes {causes}")?;
        }
        self.write_accuracy(f)?;
        self.write_timing(f)?;
        self.write_events(f)?;
        if self.records_dropped > 0 {
            writeln!(f, "log gaps      {} ticks could not be recorded", self.records_dropped)?;
        }
        if let Some(path) = &self.log {
            writeln!(f, "log           {}", path.display())?;
        }
        if let Some(error) = &self.log_error {
            writeln!(f, "log           INCOMPLETE: {error}")?;
        }
        Ok(())
    }
}

impl Summary {
    /// How it ended.
    fn write_result(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let reason = Fault::ending_names(&self.ended_by);
        if self.is_dry_run {
            return writeln!(f, "result        dry run ended{reason}");
        }
        let (reached, count) = (self.targets_reached, self.targets_count);
        let (phase, missing) = (self.phase.name(), self.missing_confirmation());
        writeln!(f, "result        {phase}{missing}{reason}, {reached} of {count} targets")
    }

    /// How well the path was followed.
    fn write_accuracy(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if let Some(metrics) = &self.metrics {
            let reached = |finish_s| format!("{finish_s:.2} s from first to last target");
            let finish = metrics.finish_s.map_or_else(|| "not reached".into(), reached);
            writeln!(f, "finish        {finish}")?;
            writeln!(
                f,
                "2-D distance  {:.3} m median, {:.3} m 95 %, {:.3} m largest",
                metrics.distance_median_m, metrics.distance_p95_m, metrics.distance_max_m
            )?;
            writeln!(f, "speed         {:.2} m/s median", metrics.speed_median_mps)?;
            writeln!(f, "stick norm    {:.2} median", metrics.input_norm_median)?;
        }
        for (number, lap) in (1..).zip(&self.laps) {
            let Lap { lasted_s, distance_median_m, distance_p95_m, distance_max_m } = lap;
            writeln!(
                f,
                "{:<13} {lasted_s:.2} s; {distance_median_m:.3} m median, {distance_p95_m:.3} m 95 %, \
                 {distance_max_m:.3} m largest",
                format!("lap {number}")
            )?;
        }
        Ok(())
    }

    /// How long the solvers took, and how punctual the threads were.
    fn write_timing(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for (what, spread) in [("MHE + MPC", self.solve_ms), ("frame to UDP", self.answer_ms)] {
            let Some([p50, p95, p999, max]) = spread else { continue };
            writeln!(
                f,
                "{what:<13} {p50:.2} ms median, {p95:.2} 95 %, {p999:.2} 99.9 %, {max:.2} largest"
            )?;
        }
        writeln!(
            f,
            "ticks         {}, {} more than {LATE_TICK_MS} ms late, {} periods missed",
            self.ticks, self.late_ticks, self.missed_periods
        )?;
        for (what, histogram) in
            [("lateness", &self.jitter.lateness), ("tick length", &self.jitter.duration)]
        {
            let ms = |us: i64| us as f64 * 1e-3;
            let [p50, p99, p999] =
                [0.5, 0.99, 0.999].map(|fraction| ms(histogram.quantile_us(fraction)));
            writeln!(
                f,
                "{what:<13} up to {p50:.2} ms median, {p99:.2} 99 %, {p999:.2} 99.9 %, {:.2} largest",
                ms(histogram.max_us())
            )?;
        }
        writeln!(f, "sender        {:.0} ms longest pause in flight", self.sender_pause_ms)
    }

    /// Faults, outages and what the links counted.
    fn write_events(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if !self.faults.is_empty() {
            let names: Vec<&str> = self.faults.iter().copied().map(Fault::name).collect();
            writeln!(f, "faults        {}", names.join(", "))?;
        }
        let Outages { count, down_s } = self.outages;
        if count > 0 {
            writeln!(f, "link down     {count} times, {down_s:.2} s together")?;
        }
        if self.by_hand_s > 0.0 {
            writeln!(f, "by hand       {:.2} s in flight", self.by_hand_s)?;
        }
        writeln!(f, "mocap         {}", self.mocap)?;
        if let Some(hidden) = &self.hidden {
            writeln!(f, "no pose       {hidden}")?;
        }
        if let Some(firmware) = &self.firmware {
            writeln!(f, "firmware      {firmware}")?;
        }
        if let Some(refusal) = &self.refusal {
            writeln!(f, "refusal       {refusal}")?;
        }
        if self.links != Links::default() {
            writeln!(f, "links         {}", self.links)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
