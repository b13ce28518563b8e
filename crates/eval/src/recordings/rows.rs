//! A foreign recording as rows: the thesis' CSV, or the same rows in an MCAP file of ours.
//!
//! Owns how a CSV flight looks in MCAP. Four channels hold its four tags, unchanged; what the file does
//! not state, it does not state here: `pos` may be a raw, a filtered or an estimated pose.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use horizon_model::rows::gain;
use horizon_model::{Kinematic, Model};
use nalgebra::SVector;
use schemars::schema_for;
use serde::{Deserialize, Serialize};
use tello_flight::cycle::{PoseRecord, RowsRecord, SticksRecord, Topic};
use tello_io::clock::{SpanNs, TimeNs};
use tello_io::log::csv::{self, CsvFlight, CsvRow};
use tello_io::log::{Channel, Ending, Head, LogReader, LogWriter};

use super::PERIOD_S;
use crate::REVISION;

/// Channel of the tag `pos`.
pub const POSE: &str = "/recording/pose";

/// Document in the head of a converted recording, in place of the settings of a flight.
const DOCUMENT: &str = "recording.json";

/// Lines of a file that are shown one by one when they were left out.
const LINES_SHOWN: usize = 3;

/// A recording by rows.
#[derive(Debug, Clone, PartialEq)]
pub struct RowFlight {
    /// Rows by ascending step. Steps may be missing.
    pub rows: Vec<CsvRow>,
    /// Most digits behind the point of any value in the original.
    pub decimals: usize,
    /// Parts of the original that were left out, and why.
    pub notes: Vec<String>,
    /// Whether its log was closed, and lacks no record; so does a file of lines.
    pub is_complete: bool,
}

/// Facts about the original of a converted recording.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Document {
    /// Name of the file.
    source: String,
    decimals: usize,
    skipped: Vec<String>,
}

impl From<CsvFlight> for RowFlight {
    fn from(flight: CsvFlight) -> Self {
        let lines = flight.skipped.len();
        let mut notes: Vec<String> =
            flight.skipped.iter().take(LINES_SHOWN).map(ToString::to_string).collect();
        if lines > LINES_SHOWN {
            notes.push(format!("{} more lines", lines - LINES_SHOWN));
        }
        Self { rows: flight.rows, decimals: flight.decimals, notes, is_complete: true }
    }
}

/// The foreign recording in a CSV file, or in a log that `convert` made of one if `is_mcap`.
///
/// # Errors
/// The file cannot be read, or has no line of a recording in it.
pub fn read(path: &Path, is_mcap: bool) -> Result<RowFlight> {
    if is_mcap {
        of_log(&mut LogReader::open(path)?).with_context(|| format!("in {}", path.display()))
    } else {
        Ok(csv::read(path)?.into())
    }
}

/// Whether the log is a converted recording, not a flight of ours.
pub fn is_recording(log: &LogReader) -> bool {
    log.head().documents.contains_key(DOCUMENT)
}

/// The rows of a converted recording.
///
/// # Errors
/// The disk fails, or a record is not of its channel's type.
pub fn of_log(log: &mut LogReader) -> Result<RowFlight> {
    let document = log.head().documents.get(DOCUMENT).map_or("", String::as_str);
    let Document { decimals, skipped: mut notes, .. } =
        serde_json::from_str(document).with_context(|| format!("in its {DOCUMENT}"))?;
    let mut rows: BTreeMap<u64, CsvRow> = BTreeMap::new();
    while let Some(message) = log.next_message()? {
        let Step { step } = message.decode()?;
        let row = rows.entry(step).or_insert(CsvRow { step, ..CsvRow::default() });
        let pose = || message.decode::<PoseRecord>().map(|record| record.pose());
        match (message.topic, Topic::named(message.topic)) {
            (POSE, _) => row.pos = Some(pose()?),
            (_, Some(Topic::Target)) => row.target = Some(pose()?),
            (_, Some(Topic::Command)) => {
                row.input = Some(message.decode::<SticksRecord>()?.sticks());
            }
            (_, Some(Topic::Parameter)) => {
                row.param = Some(message.decode::<GainRecord>()?.param());
            }
            _ => {}
        }
    }
    notes.extend(loss(log));
    let rows = rows.into_values().collect();
    Ok(RowFlight { rows, decimals, notes, is_complete: is_complete(log) })
}

/// What is not in the log, by the way it ends.
pub(super) fn loss(log: &LogReader) -> Option<String> {
    match log.ending()? {
        Ending::Complete => None,
        Ending::Gaps { records } => Some(format!("{records} ticks that the disk was too slow for")),
        torn @ Ending::Torn { .. } => Some(torn.to_string()),
    }
}

/// Whether a note on what is not in a recording is that of a torn log.
pub(crate) fn is_tear(note: &str) -> bool {
    note.starts_with("torn ")
}

/// Whether the log, which was read, was closed and lacks no record.
pub fn is_complete(log: &LogReader) -> bool {
    log.ending().is_none_or(Ending::is_complete)
}

/// Writes `flight`, which was read from a file called `source`, as MCAP.
///
/// # Errors
/// The file exists, or the disk refuses.
pub fn write_log(path: &Path, source: String, flight: &RowFlight) -> Result<()> {
    let document = Document { source, decimals: flight.decimals, skipped: flight.notes.clone() };
    let head = Head {
        started_unix_ns: 0,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        revision: REVISION.to_owned(),
        documents: BTreeMap::from([(DOCUMENT.to_owned(), serde_json::to_string(&document)?)]),
    };
    let schema = schema_for!(PoseRecord);
    let pose = |topic| Channel { topic, schema_name: "Pose", schema: schema.clone().into() };
    let ours = |topic: Topic| Channel {
        topic: topic.name(),
        schema_name: topic.schema_name(),
        schema: topic.schema(&Kinematic::STATE, &Kinematic::PARAMETER).into(),
    };
    let channels =
        [pose(POSE), ours(Topic::Command), pose(Topic::Target.name()), ours(Topic::Parameter)];
    let mut log = LogWriter::create(path, &head, &channels)?;
    for row in &flight.rows {
        let (step, t) = (row.step, time_of(row.step));
        if let Some(pos) = &row.pos {
            log.write(POSE, t, &PoseRecord::new(step, pos))?;
        }
        if let Some(input) = &row.input {
            log.write(Topic::Command.name(), t, &SticksRecord::new(step, input))?;
        }
        if let Some(target) = &row.target {
            log.write(Topic::Target.name(), t, &PoseRecord::new(step, target))?;
        }
        if let Some(param) = &row.param {
            let record = RowsRecord { step, rows: &Kinematic::PARAMETER, values: param.as_slice() };
            log.write(Topic::Parameter.name(), t, &record)?;
        }
    }
    log.finish()?;
    Ok(())
}

/// When a step is due. A damaged step number may be any: time ends before it.
fn time_of(step: u64) -> TimeNs {
    TimeNs(0).after(SpanNs::from_seconds(step as f64 * PERIOD_S))
}

/// Step, which every record has.
#[derive(Deserialize)]
struct Step {
    step: u64,
}

/// The parameter of a CSV flight, by the names of its rows. m/s, m/s, rad/s, rad
#[derive(Deserialize)]
pub(super) struct GainRecord {
    lambda_h: f64,
    lambda_v: f64,
    lambda_a: f64,
    theta_0: f64,
}

impl GainRecord {
    pub(super) fn param(&self) -> SVector<f64, { gain::COUNT }> {
        let mut param = SVector::zeros();
        param[gain::LAMBDA_H] = self.lambda_h;
        param[gain::LAMBDA_V] = self.lambda_v;
        param[gain::LAMBDA_A] = self.lambda_a;
        param[gain::THETA_0] = self.theta_0;
        param
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_lines_are_shown_and_the_others_are_counted() {
        let notes = |lines: usize| {
            let text = "nonsense\n".repeat(lines) + "pos,0,1,2,3,4\n";
            RowFlight::from(csv::parse(text.as_bytes())).notes
        };
        assert!(notes(0).is_empty());
        assert_eq!(notes(3).len(), 3);
        assert!(notes(3)[2].starts_with("line 3, "), "{:?}", notes(3));
        assert_eq!(notes(5).len(), 4);
        assert_eq!(notes(5)[3], "2 more lines");
    }

    #[test]
    fn a_step_is_due_after_its_periods_and_time_does_not_overflow() {
        assert_eq!(time_of(0), TimeNs(0));
        assert_eq!(time_of(50), TimeNs(1_000_000_000));
        assert_eq!(time_of(u64::MAX), TimeNs(i64::MAX));
    }

    #[test]
    fn a_parameter_is_read_by_the_names_of_its_rows() {
        let json = r#"{"theta_0": 4, "lambda_a": 3, "lambda_h": 1, "lambda_v": 2, "step": 9}"#;
        let record: GainRecord = serde_json::from_str(json).unwrap();
        let param = record.param();
        let named = Kinematic::PARAMETER.iter().zip(&param);
        let found: Vec<_> = named.map(|(row, value)| (row.name, *value)).collect();
        let expected = [("lambda_h", 1.0), ("lambda_v", 2.0), ("lambda_a", 3.0), ("theta_0", 4.0)];
        assert_eq!(found, expected);
    }
}
