//! The CSV reader on every real recording of the thesis.

#[path = "../../../tests/support.rs"]
mod support;

use std::path::{Path, PathBuf};
use std::{fs, io};

use tello_io::log::csv::{self, SkipReason};

/// Every `.log` below `folder`, sorted.
fn logs(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            found.extend(logs(&path)?);
        } else if path.extension().is_some_and(|extension| extension == "log") {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

#[test]
fn every_recording_is_read_up_to_its_torn_lines() {
    let Some(folder) = support::data("thesis") else { return };
    let mut skipped = Vec::new();
    let (mut identification_steps, mut piece_steps) = (0, 0);
    let logs = logs(&folder).unwrap();
    for path in &logs {
        let flight = csv::read(path).unwrap();
        let name = path.strip_prefix(&folder).unwrap().display().to_string();
        let steps = flight.rows.len();
        if name.starts_with("ident/raw") {
            identification_steps += steps;
        } else if name.starts_with("pieces") {
            piece_steps += steps;
        }
        // Only the last step of a recording was ever torn.
        for (step, row) in flight.rows[..steps - 1].iter().enumerate() {
            assert_eq!(row.step, step as u64, "{name}");
            assert!(row.pos.is_some() && row.input.is_some(), "{name}, step {step}: {row:?}");
        }
        skipped.extend(flight.skipped.into_iter().map(|line| (name.clone(), line.line, line.why)));
    }
    let expected = [
        ("closed_loop/big_square1_4.log".to_owned(), 7521, SkipReason::Torn),
        ("closed_loop/big_square2_1.log".to_owned(), 7974, SkipReason::Torn),
    ];
    assert_eq!(skipped, expected);
    assert_eq!((logs.len(), identification_steps, piece_steps), (186, 27_832, 27_652));
}

#[test]
fn what_is_read_is_written_back_to_the_byte() {
    let Some(path) = support::data("thesis/ident/raw/1.log") else { return };
    let mut text = Vec::new();
    for row in csv::read(&path).unwrap().rows {
        row.write(&mut text, csv::THESIS_DECIMALS).unwrap();
    }
    assert!(text == fs::read(&path).unwrap(), "{} bytes written", text.len());
}
