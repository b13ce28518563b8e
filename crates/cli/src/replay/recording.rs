//! A CSV flight of the thesis, converted or not, through filter and estimator.

use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use schemars::JsonSchema;
use serde::Serialize;
use tello_control::Start;
use tello_estim::Verdict;
use tello_io::clock::TimeNs;
use tello_io::log::csv::CsvRow;
use tello_io::vicon::Sighting;
use tello_model::rows::{Pose, pose};

use super::Arguments;
use crate::cycle::{self, Inbox, Unwatched};
use crate::flight_log::{self, TickRecord};
use crate::recordings::rows::{self, RowFlight};
use crate::{REVISION, config, parameter_file};

/// Filtered height above which a recording counts as a flight. m
const AIRBORNE_M: f64 = 0.3;

/// What filter and estimator made of the recording.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Report {
    /// Ticks repeated.
    ticks: u64,
    /// Ticks with a filtered height of a flight.
    ticks_airborne: u64,
    /// Ticks without a new pose: the stream stalled or the object was lost.
    ticks_missing: u64,
    /// New positions that the filter did not believe.
    positions_held: u64,
    /// New headings that the filter did not believe.
    headings_held: u64,
    /// Ticks in which the estimator gave no estimate.
    estimates_failed: u64,
    /// Root mean square distance of estimate and filtered pose, x, y and z. m
    rms_m: f64,
    /// Parameter estimate at the end.
    p_hat: Vec<f64>,
    /// Lines of the file that were skipped.
    lines_skipped: Vec<String>,
    /// The log that was written.
    log: PathBuf,
    /// This revision.
    revision: &'static str,
}

impl Report {
    pub(super) fn is_airborne(&self) -> bool {
        self.ticks_airborne > 0
    }
}

pub(super) fn run(arguments: &Arguments, is_mcap: bool) -> Result<Report> {
    let recording = rows::read(&arguments.log, is_mcap)?;
    let (mut table, mission) = config::fly(arguments.config.as_deref(), None)?;
    parameter_file::apply(arguments.params.as_deref(), &mut table.cycle)?;
    let flight = config::flight(&table, mission, Start::Airborne);
    let mut cycle = cycle::build(&flight)?;
    let mut record = TickRecord::with_buffers(&cycle.new_outcome());
    let path = match &arguments.out {
        Some(path) => path.clone(),
        None => default_log(&arguments.log, &table.log.dir)?,
    };
    if recording.rows.is_empty() {
        bail!(
            "{} has no flight in it: no line reads tag,step,v1,v2,v3,v4",
            arguments.log.display()
        );
    }
    let mut log = flight_log::create(&path, &flight, 0, &record.out)?;
    let mut report = Report::new(&recording, path);
    let mut square_sum_m2 = 0.0;
    for inbox in Inboxes::new(&recording, flight.cycle.dt_s) {
        record.inbox = inbox;
        cycle.tick(&record.inbox, &mut Unwatched::default(), &mut record.out);
        flight_log::write_tick(&mut log, &record)?;
        square_sum_m2 += report.add(&record);
    }
    report.rms_m = (square_sum_m2 / report.ticks as f64).sqrt();
    report.p_hat.clone_from(&record.out.p_hat);
    log.finish()?;
    Ok(report)
}

fn default_log(csv: &Path, dir: &Path) -> Result<PathBuf> {
    let stem = csv.file_stem().map_or_else(|| "flight".into(), |stem| stem.to_string_lossy());
    flight_log::free_path(dir, &format!("{stem}-replay"))
}

impl Report {
    fn new(recording: &RowFlight, log: PathBuf) -> Self {
        Self {
            ticks: 0,
            ticks_airborne: 0,
            ticks_missing: 0,
            positions_held: 0,
            headings_held: 0,
            estimates_failed: 0,
            rms_m: 0.0,
            p_hat: Vec::new(),
            lines_skipped: recording.notes.clone(),
            log,
            revision: REVISION,
        }
    }

    /// Counts one tick; squared distance of estimate and filtered position. m^2
    fn add(&mut self, record: &TickRecord) -> f64 {
        let out = &record.out;
        self.ticks += 1;
        self.ticks_missing += u64::from(record.inbox.sightings.is_empty());
        self.estimates_failed += u64::from(matches!(out.estimator, Some(cycle::Solve::Failed(_))));
        let Some(filtered) = &out.filtered else { return 0.0 };
        self.positions_held += u64::from(filtered.position == Verdict::Held);
        self.headings_held += u64::from(filtered.heading == Verdict::Held);
        let (Some(o), Some(pose_hat)) = (filtered.o, out.pose_hat()) else { return 0.0 };
        self.ticks_airborne += u64::from(o[pose::Z] > AIRBORNE_M);
        (o - pose_hat).fixed_rows::<3>(pose::X).norm_squared()
    }
}

/// The inboxes of a recording: what a tick would have been told.
struct Inboxes<'a> {
    rows: std::slice::Iter<'a, CsvRow>,
    dt_ns: f64,
    first_step: u64,
    previous: Option<Pose>,
}

impl<'a> Inboxes<'a> {
    fn new(recording: &'a RowFlight, dt_s: f64) -> Self {
        let first_step = recording.rows.first().map_or(0, |row| row.step);
        Self { rows: recording.rows.iter(), dt_ns: dt_s * 1e9, first_step, previous: None }
    }
}

impl Iterator for Inboxes<'_> {
    type Item = Inbox;

    fn next(&mut self) -> Option<Inbox> {
        let row = self.rows.next()?;
        let mut inbox = Inbox::new();
        let step = row.step - self.first_step;
        #[expect(clippy::cast_possible_truncation, reason = "hours of ns fit 53 bits")]
        let now = TimeNs((step as f64 * self.dt_ns).round() as i64);
        inbox.open(step, now);
        // The recordings repeat the last pose while the stream stalls: that is no observation.
        if row.pos != self.previous
            && let Some(o) = row.pos
        {
            // An object that is not seen is reported at the origin.
            let is_seen = o.fixed_rows::<3>(pose::X).norm() > 0.0;
            let frame = i64::try_from(row.step).unwrap_or(i64::MAX);
            inbox.sightings.push(Sighting {
                frame,
                measured_at: now,
                received_at: now,
                pose: is_seen.then_some(o),
            });
        }
        self.previous = row.pos.or(self.previous);
        inbox.flown = Some(row.input.map_or([0.0; 4], Into::into));
        Some(inbox)
    }
}

impl Display for Report {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for line in &self.lines_skipped {
            writeln!(f, "skipped {line}")?;
        }
        writeln!(f, "ticks             {} ({} airborne)", self.ticks, self.ticks_airborne)?;
        writeln!(f, "without a pose    {}", self.ticks_missing)?;
        writeln!(
            f,
            "held by filter    {} positions, {} headings",
            self.positions_held, self.headings_held
        )?;
        writeln!(f, "estimates failed  {}", self.estimates_failed)?;
        writeln!(f, "estimate          {:.4} m RMS from the filtered position", self.rms_m)?;
        writeln!(f, "parameters        {:.4?}", self.p_hat)?;
        if !self.is_airborne() {
            writeln!(f, "never above {AIRBORNE_M} m: a recording without flight proves nothing")?;
        }
        writeln!(f, "log               {}", self.log.display())
    }
}
