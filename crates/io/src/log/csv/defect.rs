//! Defects of a CSV flight log, line by line and as a whole.

use std::fmt::{Display, Formatter};
use std::io;
use std::path::PathBuf;

use thiserror::Error;

use super::{STEPS_AHEAD_MAX, STEPS_BACK_MAX, VALUES};

/// Format of a line, for messages.
const LINE_FORMAT: &str = "a line is TAG,STEP and four values (docs/configuration.md, `ident`): pos x, y, z in m, \
                               theta in rad; input roll, pitch, yaw, throttle from -1 to 1; STEP counts periods of 0.02 s";

/// A line that was left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Skipped {
    /// Number of the line, from 1.
    pub line: usize,
    /// First characters of the line.
    pub text: String,
    /// Its mistake.
    pub why: SkipReason,
}

/// Mistake of a line.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum SkipReason {
    /// The file ends inside the line: even a readable last number may lack digits.
    #[error("cut off before its line break")]
    Torn,
    /// The line does not begin with a tag.
    #[error("unknown tag")]
    Tag,
    /// The second field is not a step number.
    #[error("no step number")]
    Step,
    /// The step number is of another recording, or damaged.
    #[error(
        "the step is more than {STEPS_BACK_MAX} before or {STEPS_AHEAD_MAX} after the newest one"
    )]
    Far,
    /// There are fewer or more than four values.
    #[error("{0} values instead of {VALUES}")]
    Count(usize),
    /// A value is not a finite number.
    #[error("value {0} is not a finite number")]
    Value(usize),
    /// A value is not in the unit of the format: m, rad, sticks from -1 to 1.
    #[error("value {0} is beyond {1}")]
    Beyond(usize, f64),
    /// The step has this line already.
    #[error("repeated step")]
    Repeated,
    /// The step has another line with this tag already; the first one counts.
    #[error("repeated step with other values")]
    OtherValues,
}

/// Why a CSV log cannot be used at all.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CsvError {
    /// The file could not be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file that was asked for.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The file is no flight log.
    #[error("{}: {defect}", path.display())]
    Defect {
        /// The file.
        path: PathBuf,
        /// Defect of the file.
        defect: CsvDefect,
    },
}

/// Why the bytes of a file are no flight log.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CsvDefect {
    /// Not one line is of the format.
    #[error("no line of a flight log: {}; {LINE_FORMAT}", first(.0))]
    NoRows(Vec<Skipped>),
    /// Of a tag more lines are out of range than can be used.
    #[error("most lines of one tag are out of range, as {0}: {LINE_FORMAT}")]
    OtherUnits(Skipped),
    /// Steps have several lines of one tag with other values.
    #[error(
        "steps have other values again, as {0}: two recordings in one file, or steps that are no periods"
    )]
    OtherValues(Skipped),
    /// Most lines are far from the newest step.
    #[error("most lines are out of order, as {0}: sort them by step")]
    Disordered(Skipped),
}

impl Display for Skipped {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        write!(f, "line {}, {}: {}", self.line, self.why, self.text)
    }
}

fn first(skipped: &[Skipped]) -> String {
    skipped.first().map_or_else(|| "it is empty".to_owned(), Skipped::to_string)
}
