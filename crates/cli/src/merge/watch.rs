//! Waits for the parts of a folder, and prints how far they are.

use std::fmt::{self, Display, Formatter};
use std::fs;
use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressStyle};
use tello_eval::part_file::{Kind, PartSet};
use tello_io::clock::Clock;

use crate::interrupt::Interrupt;
use crate::stdio;

/// How often the folder is looked at.
const PERIOD: Duration = Duration::from_millis(250);

/// The parts in `folder`, in the order of their numbers, once all of them are there; `None` after Ctrl-C.
///
/// # Errors
/// A folder or part that cannot be read; a part that is torn, there twice, or of another whole.
pub(super) fn wait(folder: &Path) -> Result<Option<Vec<PathBuf>>> {
    let interrupt = Interrupt::listen()?;
    let is_terminal = io::stderr().is_terminal();
    let bar = if is_terminal { ProgressBar::no_length() } else { ProgressBar::hidden() };
    bar.set_style(ProgressStyle::with_template("{bar:40} {msg}")?);
    let clock = Clock::start();
    let mut parts = PartSet::default();
    let mut seeds_before = None;
    loop {
        let arrived = look(folder, &mut parts)?;
        let seeds_before = *seeds_before.get_or_insert(parts.seed_count());
        if let Some(progress) = Progress::of(&parts, seeds_before, clock.now().seconds()) {
            bar.set_length(progress.seeds_all);
            bar.set_position(progress.seeds);
            bar.set_message(progress.to_string());
            if arrived && !is_terminal {
                stdio::note(&progress);
            }
            if progress.parts == progress.parts_all {
                bar.finish_and_clear();
                return Ok(Some(parts.paths().map(Path::to_owned).collect()));
            }
        }
        if interrupt.is_asked() {
            bar.finish_and_clear();
            return Ok(None);
        }
        thread::sleep(PERIOD);
    }
}

/// Adds the parts in `folder` that came since the last look; whether there are any.
fn look(folder: &Path, parts: &mut PartSet) -> Result<bool> {
    let before = parts.count();
    for entry in fs::read_dir(folder).with_context(|| format!("{}", folder.display()))? {
        let path = entry?.path();
        // A name that begins with a dot is a part that is being written.
        let is_part = path.extension().is_some_and(|end| end == "part")
            && !path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
        if is_part && !parts.contains(&path) {
            parts.add(&path)?;
        }
    }
    Ok(parts.count() > before)
}

/// Progress of all parts together.
struct Progress {
    noun: &'static str,
    parts: u64,
    parts_all: u64,
    seeds: u64,
    seeds_all: u64,
    /// Mean since the watch began; `None` before a part arrived in it. 1/s
    rate: Option<f64>,
}

impl Progress {
    /// `None` before the first part.
    fn of(there: &PartSet, seeds_before: u64, elapsed_s: f64) -> Option<Self> {
        let header = there.first()?;
        let [_, parts_all] = header.numbers();
        let noun = if header.kind == Kind::Bootstrap { "resamples" } else { "flights" };
        let (parts, seeds, seeds_all) = (there.count(), there.seed_count(), header.count);
        let while_watching = (seeds - seeds_before) as f64;
        let rate = (while_watching > 0.0).then(|| while_watching / elapsed_s);
        Some(Self { noun, parts, parts_all, seeds, seeds_all, rate })
    }
}

impl Display for Progress {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self { noun, parts, parts_all, seeds, seeds_all, rate } = self;
        write!(f, "parts {parts}/{parts_all}, {noun} {seeds}/{seeds_all}")?;
        let Some(rate) = rate else { return Ok(()) };
        let left_s = (seeds_all - seeds) as f64 / rate;
        write!(f, ", {rate:.1}/s, ")?;
        let [hours, minutes] = [3600.0, 60.0].map(|unit_s| (left_s / unit_s).floor());
        if hours > 0.0 {
            write!(f, "{hours} h {:02} min left", minutes - 60.0 * hours)
        } else if minutes > 0.0 {
            write!(f, "{minutes} min {:02.0} s left", (left_s - 60.0 * minutes).floor())
        } else {
            write!(f, "{left_s:.0} s left")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_follows_the_rate() {
        let text = |seeds, rate| {
            let (noun, parts, parts_all) = ("flights", 2, 8);
            Progress { noun, parts, parts_all, seeds, seeds_all: 10_000, rate }.to_string()
        };
        assert_eq!(text(2500, None), "parts 2/8, flights 2500/10000");
        let of = |left: &str| format!("parts 2/8, flights 2500/10000, {left} left");
        assert_eq!(text(2500, Some(250.0)), of("250.0/s, 30 s"));
        assert_eq!(text(2500, Some(100.0)), of("100.0/s, 1 min 15 s"));
        assert_eq!(text(2500, Some(1.0)), of("1.0/s, 2 h 05 min"));
    }
}
