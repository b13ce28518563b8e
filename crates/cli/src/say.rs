//! What the program says to its reader.
//!
//! Owns the standard output and the standard error. Nobody has to listen: a reader that is gone, as
//! `head` once it has its lines, ends no work, least of all a flight, and changes no exit code.

use std::fmt::Display;
use std::io::{self, ErrorKind, Write};

use anyhow::{Context, Result};
use serde::Serialize;

/// What a command was asked for, on the standard output: one JSON object, or a text for people.
///
/// # Errors
/// As [`line()`].
pub(crate) fn report(report: &(impl Display + Serialize), is_json: bool) -> Result<()> {
    if is_json { line(serde_json::to_string(report)?) } else { write(report) }
}

/// A line on the standard output.
///
/// # Errors
/// It cannot be written, e.g. to a disk that is full.
pub(crate) fn line(text: impl Display) -> Result<()> {
    write(format_args!("{text}\n"))
}

/// A line beside what was asked for, on the standard error.
pub(crate) fn note(text: impl Display) {
    writeln!(io::stderr(), "{text}").ok();
}

fn write(text: impl Display) -> Result<()> {
    let mut out = io::stdout().lock();
    match write!(out, "{text}").and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        result => result.context("cannot write to the standard output"),
    }
}
