//! The recordings of an identification, and the files that cannot be used.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use horizon_model::rows::pose;
use horizon_model::setting::{not_negative, vector};
use horizon_model::{Lagged, Model as _};

use super::inverted_sticks::inverted_axis;
use super::report::FileUsed;
use super::table::IdentFileTable;
use crate::recordings::known_flights::KnownFlights;
use crate::recordings::{self, FileSkipped, Loaded};

/// The usable logs in `paths`, which are files and folders, and those that are not with the reason.
///
/// # Errors
/// No log can be used, a folder cannot be read, or the period of a log is not that of the settings.
pub fn load_logs(
    paths: &[PathBuf],
    table: &IdentFileTable,
) -> Result<(Vec<Loaded>, Vec<FileSkipped>)> {
    if paths.is_empty() {
        bail!("no logs: name files or folders, e.g. `tello-ctl ident logs/`");
    }
    let (mut logs, mut files_skipped) = recordings::load(paths)?;
    turn(&mut logs, table.turn_rad);
    check_period(&logs, table.dt_s)?;
    let (mut logs, inverted) = without_inverted(logs, table)?;
    files_skipped.extend(inverted);
    let beyond = logs.split_off(table.logs_max.min(logs.len()));
    files_skipped.extend(beyond.into_iter().map(|log| FileSkipped {
        path: log.path,
        why: format!("beyond logs_max = {}", table.logs_max),
    }));
    refuse_none(&logs, &files_skipped)?;
    Ok((logs, files_skipped))
}

/// The logs that do not contradict their sticks, and the others with the reason.
fn without_inverted(
    logs: Vec<Loaded>,
    table: &IdentFileTable,
) -> Result<(Vec<Loaded>, Vec<FileSkipped>)> {
    let dead_time_s = vector("dead_time_s", &table.dead_time_s, &Lagged::INPUT, not_negative)?;
    let (mut kept, mut skipped) = (Vec::with_capacity(logs.len()), Vec::new());
    for log in logs {
        match inverted_axis(&log.recording, &dead_time_s, table.dt_s) {
            Some(why) => skipped.push(FileSkipped { path: log.path, why }),
            None => kept.push(log),
        }
    }
    Ok((kept, skipped))
}

/// The usable logs in `paths` by which fits with the period `dt_s` (s) are judged, and those that are not with the
/// reason. Their yaw is turned by `turn_rad`. None of them may be of `fitted`, to which the fits are made.
///
/// # Errors
/// No log can be used, a folder cannot be read, the period of a log is another, or it is one of `fitted`.
pub fn load_judged(
    paths: &[PathBuf],
    dt_s: f64,
    turn_rad: f64,
    fitted: &[Loaded],
) -> Result<(Vec<Loaded>, Vec<FileSkipped>)> {
    if paths.is_empty() {
        return Ok((Vec::new(), Vec::new()));
    }
    let (mut logs, files_skipped) = recordings::load(paths)?;
    let known = KnownFlights::of(fitted);
    for log in &logs {
        if let Some(same) = known.index_of_log(log).map(|place| &fitted[place]) {
            bail!(
                "{} of --judge has the flight of {}, to which is fitted: judge by other logs",
                log.path.display(),
                same.path.display()
            );
        }
    }
    turn(&mut logs, turn_rad);
    check_period(&logs, dt_s)?;
    refuse_none(&logs, &files_skipped)?;
    Ok((logs, files_skipped))
}

/// Refuses logs of this program for settings of another period than theirs.
fn check_period(logs: &[Loaded], dt_s: f64) -> Result<()> {
    let is_mcap = |log: &&Loaded| log.path.extension().is_some_and(|extension| extension == "mcap");
    let Some(log) = logs.iter().find(is_mcap) else { return Ok(()) };
    let (path, period_s) = (log.path.display(), recordings::PERIOD_S);
    if (dt_s - period_s).abs() > 1e-9 {
        bail!("{path} has a period of {period_s} s, the settings have dt_s = {dt_s}");
    }
    Ok(())
}

fn turn(logs: &mut [Loaded], by_rad: f64) {
    for o in logs.iter_mut().flat_map(|log| &mut log.recording.o) {
        o.o[pose::THETA] += by_rad;
    }
}

fn refuse_none(logs: &[Loaded], files_skipped: &[FileSkipped]) -> Result<()> {
    if logs.is_empty() {
        let reasons: Vec<String> = files_skipped
            .iter()
            .map(|file| format!("  {}: {}", Path::display(&file.path), file.why))
            .collect();
        bail!("no log can be used:\n{}", reasons.join("\n"));
    }
    Ok(())
}

impl From<Loaded> for FileUsed {
    fn from(log: Loaded) -> Self {
        let Loaded { path, sha256, recording, skipped, .. } = log;
        Self { path, sha256, steps: recording.o.len(), skipped }
    }
}

#[cfg(test)]
mod tests;
