//! The thesis' flight logs (section 4.3.4): lines of `tag,step,v1,v2,v3,v4`.
//!
//! Owns the text format, in and out. Real files have torn lines; [`parse`] survives any bytes and states
//! which lines it left out and why. What is missing stays missing: nothing is filled in here.
//!
//! | tag      | values                                                             |
//! |----------|--------------------------------------------------------------------|
//! | `pos`    | x, y, z (m), theta (rad)                                           |
//! | `input`  | roll, pitch, yaw, throttle (1)                                     |
//! | `target` | x, y, z (m), theta (rad)                                           |
//! | `param`  | `lambda_h`, `lambda_v` (m/s), `lambda_a` (rad/s), `theta_0` (rad)  |

#![deny(clippy::indexing_slicing)]

mod defect;
mod number;

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

use horizon_model::rows::{Pose, Sticks, gain};
use nalgebra::SVector;
use strum::{IntoStaticStr, VariantArray};

use crate::atomic_file::{self, RECORDING_BYTES_MAX};

pub use self::defect::{CsvDefect, CsvError, SkipReason, Skipped};
use self::number::{Plain, number, parsed};

/// Characters of a skipped line that are kept for the message.
const SKIPPED_TEXT_MAX: usize = 60;

/// Digits behind the point in the thesis' logs.
pub const THESIS_DECIMALS: usize = 4;

/// Values per line, whatever the tag.
const VALUES: usize = 4;

/// How far a step may lie from the newest one before it; real logs lack some seconds at most, and have their lines in
/// order but for neighbours.
const STEPS_AHEAD_MAX: u64 = 180_000;
const STEPS_BACK_MAX: u64 = 50;

/// Lines with other values than the first of their step, as a part of all rows, from which on steps are no periods:
/// real logs have none. 1
const REPEATED_PART_MAX: f64 = 0.1;

/// A recorded flight.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CsvFlight {
    /// Recorded rows by ascending step. Steps may be missing.
    pub rows: Vec<CsvRow>,
    /// Lines that were left out, in file order.
    pub skipped: Vec<Skipped>,
    /// Most digits behind the point of any value.
    pub decimals: usize,
}

/// Recorded values of one step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CsvRow {
    /// Periods since the start of the recording.
    pub step: u64,
    /// Pose, tag `pos`. m, rad
    pub pos: Option<Pose>,
    /// Sticks sent, tag `input`. 1
    pub input: Option<Sticks>,
    /// Target, tag `target`. m, rad
    pub target: Option<Pose>,
    /// Parameter estimate, tag `param`. Unit of each row
    pub param: Option<SVector<f64, { gain::COUNT }>>,
}

impl CsvFlight {
    /// The first line whose value is beyond its limit, if there are more such lines of its tag than lines that can be
    /// used: the file has other units.
    fn in_other_units(&self) -> Option<&Skipped> {
        Tag::VARIANTS.iter().copied().find_map(|tag| {
            let is_beyond = |line: &&Skipped| {
                let name = line.text.split(',').next().map(str::trim_end);
                matches!(line.why, SkipReason::Beyond(..)) && name == Some(tag.name())
            };
            let beyond = || self.skipped.iter().filter(is_beyond);
            let is_used = |row: &&CsvRow| tag.place(&mut CsvRow::clone(row)).is_some();
            let is_most = beyond().count() > self.rows.iter().filter(is_used).count();
            beyond().next().filter(|_| is_most)
        })
    }

    /// The first line that was left out for `why`, if there are more than `count` of them.
    fn more_than(&self, count: f64, why: SkipReason) -> Option<&Skipped> {
        let lines = || self.skipped.iter().filter(|line| line.why == why);
        lines().next().filter(|_| lines().count() as f64 > count)
    }
}

/// The flight in a file.
///
/// # Errors
/// [`CsvError::Read`]; [`CsvError::Defect`] for an empty file, something else than a log, other units, or steps that
/// contradict each other.
pub fn read(path: &Path) -> Result<CsvFlight, CsvError> {
    let bytes = atomic_file::read(path, RECORDING_BYTES_MAX)
        .map_err(|source| CsvError::Read { path: path.to_owned(), source })?;
    flight(&bytes).map_err(|defect| CsvError::Defect { path: path.to_owned(), defect })
}

/// The flight in the bytes of a file.
///
/// # Errors
/// The bytes are no flight log, or one whose units or steps are wrong.
pub fn flight(bytes: &[u8]) -> Result<CsvFlight, CsvDefect> {
    let flight = parse(bytes);
    if flight.rows.is_empty() {
        return Err(CsvDefect::NoRows(flight.skipped));
    }
    if let Some(line) = flight.in_other_units() {
        return Err(CsvDefect::OtherUnits(line.clone()));
    }
    let rows = flight.rows.len();
    if let Some(line) = flight.more_than(REPEATED_PART_MAX * rows as f64, SkipReason::OtherValues) {
        return Err(CsvDefect::OtherValues(line.clone()));
    }
    match flight.more_than(rows as f64, SkipReason::Far) {
        Some(line) => Err(CsvDefect::Disordered(line.clone())),
        None => Ok(flight),
    }
}

/// The lines in the bytes of a file, whatever they are. Blank lines are no lines.
pub fn parse(bytes: &[u8]) -> CsvFlight {
    // Some editors begin a file with a mark of its byte order.
    let bytes = bytes.strip_prefix("\u{feff}".as_bytes()).unwrap_or(bytes);
    let mut reading = Reading::default();
    let mut skipped = Vec::new();
    for (index, line) in bytes.split_inclusive(|byte| *byte == b'\n').enumerate() {
        if line.trim_ascii().is_empty() {
            continue;
        }
        if let Err(why) = reading.take(line) {
            let text = String::from_utf8_lossy(line);
            // Bytes of another format may be orders to a terminal.
            let shown = |sign: char| if sign.is_control() { '\u{fffd}' } else { sign };
            let text = text.trim_end().chars().take(SKIPPED_TEXT_MAX).map(shown).collect();
            skipped.push(Skipped { line: index + 1, text, why });
        }
    }
    let decimals = reading.decimals;
    CsvFlight { rows: reading.into_rows(), skipped, decimals }
}

/// The rows read so far.
#[derive(Default)]
struct Reading {
    /// By ascending step.
    rows: Vec<CsvRow>,
    /// Rows that came after one of a later step.
    late: BTreeMap<u64, CsvRow>,
    decimals: usize,
}

impl Reading {
    /// Enters one line, with its line break.
    fn take(&mut self, line: &[u8]) -> Result<(), SkipReason> {
        let line = line.strip_suffix(b"\n").ok_or(SkipReason::Torn)?;
        let (tag, step, values, decimals) = match plain_line(line) {
            Some(plain) => plain,
            None => any_line(line)?,
        };
        let limits = tag.limits();
        let amounts = values.iter().zip(&limits);
        if let Some((i, (_, limit))) =
            amounts.enumerate().find(|(_, (value, limit))| value.abs() > **limit)
        {
            return Err(SkipReason::Beyond(i + 1, *limit));
        }
        let newest = self.rows.last().map_or(step, |row| row.step);
        if step > newest.saturating_add(STEPS_AHEAD_MAX)
            || newest > step.saturating_add(STEPS_BACK_MAX)
        {
            return Err(SkipReason::Far);
        }
        let place = tag.place(self.row(step));
        match place {
            Some(first) if *first == values => return Err(SkipReason::Repeated),
            Some(_) => return Err(SkipReason::OtherValues),
            None => *place = Some(values),
        }
        self.decimals = self.decimals.max(decimals);
        Ok(())
    }

    /// The row of `step`, new or found again.
    fn row(&mut self, step: u64) -> &mut CsvRow {
        let new = || CsvRow { step, ..CsvRow::default() };
        if self.rows.last().is_none_or(|newest| newest.step < step) {
            self.rows.push(new());
        }
        // Most lines belong to the row of the line before.
        let is_newest = self.rows.last().is_some_and(|newest| newest.step == step);
        let place = if is_newest {
            Some(self.rows.len() - 1)
        } else {
            self.rows.binary_search_by_key(&step, |row| row.step).ok()
        };
        match place.and_then(|place| self.rows.get_mut(place)) {
            Some(row) => row,
            None => self.late.entry(step).or_insert_with(new),
        }
    }

    fn into_rows(self) -> Vec<CsvRow> {
        let mut rows = self.rows;
        if !self.late.is_empty() {
            rows.extend(self.late.into_values());
            rows.sort_by_key(|row| row.step);
        }
        rows
    }
}

/// Content of a line: tag, step, values, and most digits behind a point of a value.
type ParsedLine = (Tag, u64, SVector<f64, VALUES>, usize);

/// Content of a line of any kind.
fn any_line(line: &[u8]) -> Result<ParsedLine, SkipReason> {
    let mut fields = line.split(|byte| *byte == b',').map(<[u8]>::trim_ascii);
    let tag = Tag::named(fields.next().unwrap_or_default())?;
    let step = fields.next().and_then(parsed).ok_or(SkipReason::Step)?;
    let (values, decimals) = numbers(fields)?;
    Ok((tag, step, values, decimals))
}

/// Content of a line without spaces or faults, as nearly all of a log are: faster than [`any_line`].
fn plain_line(line: &[u8]) -> Option<ParsedLine> {
    let mut bytes = line.iter();
    let comma = bytes.position(|byte| *byte == b',')?;
    let tag = Tag::named(line.get(..comma)?).ok()?;
    let step = Plain::read(&mut bytes, Some(b','))?.step()?;
    let (mut values, mut decimals) = (SVector::<f64, VALUES>::zeros(), 0);
    for (i, value) in values.iter_mut().enumerate() {
        let end = (i + 1 < VALUES).then_some(b',');
        let (number, behind_point) = Plain::read(&mut bytes, end)?.number()?;
        *value = number;
        decimals = decimals.max(behind_point);
    }
    Some((tag, step, values, decimals))
}

/// The values of a line, and most digits behind a point.
fn numbers<'a>(
    fields: impl Iterator<Item = &'a [u8]> + Clone,
) -> Result<(SVector<f64, VALUES>, usize), SkipReason> {
    let mut values = SVector::<f64, VALUES>::zeros();
    let mut decimals = 0;
    let mut rest = fields.clone();
    for (i, value) in values.iter_mut().enumerate() {
        let Some((number, behind_point)) = rest.next().and_then(number) else {
            return Err(match fields.count() {
                VALUES => SkipReason::Value(i + 1),
                count => SkipReason::Count(count),
            });
        };
        *value = number;
        decimals = decimals.max(behind_point);
    }
    match rest.count() {
        0 => Ok((values, decimals)),
        more => Err(SkipReason::Count(VALUES + more)),
    }
}

impl CsvRow {
    /// Writes what there is of the step, in the thesis' order and with that many digits behind the
    /// point; the thesis has [`THESIS_DECIMALS`].
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write(&self, out: &mut impl Write, decimals: usize) -> io::Result<()> {
        let mut row = *self;
        for tag in Tag::VARIANTS.iter().copied() {
            if let Some(values) = tag.place(&mut row) {
                write!(out, "{},{}", tag.name(), self.step)?;
                for value in values.iter() {
                    write!(out, ",{value:.decimals$}")?;
                }
                writeln!(out)?;
            }
        }
        Ok(())
    }
}

/// Subject of a line.
#[derive(Clone, Copy, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "snake_case")]
enum Tag {
    Pos,
    Input,
    Target,
    Param,
}

impl Tag {
    fn name(self) -> &'static str {
        self.into()
    }

    fn named(name: &[u8]) -> Result<Self, SkipReason> {
        let is_named = |tag: &&Self| tag.name().as_bytes() == name;
        Self::VARIANTS.iter().find(is_named).copied().ok_or(SkipReason::Tag)
    }

    /// Largest amounts of the values. m, rad; 1; unit of each row
    fn limits(self) -> SVector<f64, VALUES> {
        match self {
            Self::Pos | Self::Target => SVector::from([100.0, 100.0, 100.0, 1000.0]),
            Self::Input => SVector::repeat(1.0),
            Self::Param => SVector::repeat(1000.0),
        }
    }

    fn place(self, row: &mut CsvRow) -> &mut Option<SVector<f64, VALUES>> {
        match self {
            Self::Pos => &mut row.pos,
            Self::Input => &mut row.input,
            Self::Target => &mut row.target,
            Self::Param => &mut row.param,
        }
    }
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
