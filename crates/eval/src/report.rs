//! Recorded flights as one page, figures and numbers.
//!
//! The quantities are in `report/quantity.rs`, the judgement in `report/assessment.rs`, the layout in `report/page.rs`.

mod assessment;
mod flight;
mod group;
mod page;
mod pictures;
mod quantity;

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};
use std::fs;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use flight::Flight;
use group::{Comparison, EvaluatedFlight, Group};
use page::{GENERATOR, Shown};
use pictures::Picture;
use quantity::{Quantity, Spread};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use schemars::JsonSchema;
use serde::Serialize;
use sha2::{Digest, Sha256};
use tello_io::atomic_file;

use crate::REVISION;
use crate::recordings::known_flights::{self, Motions};
use crate::recordings::{self, FileSkipped};

/// The page, its figures and its numbers.
#[derive(Debug)]
pub struct Page {
    /// Numbers of all flights, as the page and `--json` show them.
    pub report: FlightsReport,
    /// HTML with every figure and script inside.
    pub html: String,
    /// Every figure of the page.
    pictures: Vec<Picture>,
}

/// The numbers of the page.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct FlightsReport {
    /// Was it good, and why not: a text for each group.
    verdicts: Vec<String>,
    /// The flights, and those of `--against`.
    groups: Vec<Group>,
    /// Their differences; null without `--against`.
    comparison: Option<Comparison>,
    /// Files that could not be used, and copies of others.
    pub unusable: Vec<Unusable>,
    /// Definition of each number.
    definitions: BTreeMap<&'static str, &'static str>,
    /// The page.
    page: PathBuf,
    /// Git revision of the program.
    revision: &'static str,
}

/// A file that could not be used.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct Unusable {
    /// Which.
    pub file: PathBuf,
    /// Why not.
    pub why: String,
}

impl Display for Unusable {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let file = self.file.display().to_string();
        // Some errors begin with their file.
        if self.why.starts_with(&file) {
            f.write_str(&self.why)
        } else {
            write!(f, "{file}: {}", self.why)
        }
    }
}

/// The page of the flights in `logs` and, beside them, in `against`, which may be empty; `page` is the path where the
/// page will be saved, for relative links.
///
/// # Errors
/// A path does not exist, or no flight of a group can be used.
pub fn page_of(logs: &[PathBuf], against: &[PathBuf], page: &Path) -> Result<Page> {
    let mut unusable = Vec::new();
    let mut groups = vec![read(logs, &mut unusable)?];
    if !against.is_empty() {
        groups.push(read(against, &mut unusable)?);
    }
    let comparison = match groups.as_slice() {
        [ours, theirs] => Some(Comparison::of(ours, theirs)),
        _ => None,
    };
    let report = FlightsReport {
        verdicts: groups.iter().map(Group::verdict).collect(),
        groups,
        comparison,
        unusable,
        definitions: Quantity::ALL
            .iter()
            .map(|quantity| (quantity.key(), quantity.definition()))
            .collect(),
        page: page.to_owned(),
        revision: REVISION,
    };
    let mut pictures = pictures::of_groups(&report.groups);
    let shown = shown(&report.groups);
    let html = page::page(&report, &pictures, &shown);
    pictures.extend(shown.into_iter().flat_map(|one| one.pictures));
    Ok(Page { report, html, pictures })
}

/// Refuses a page that could not be written, and one that would replace a file that is no page of this program: a log
/// may be the only one of its flight.
///
/// # Errors
/// The file is there and does not begin as our pages do, or cannot be read, or its folder cannot be written.
pub fn replaces_a_page(path: &Path) -> Result<()> {
    atomic_file::probe(path)?;
    if !path.is_file() {
        return Ok(());
    }
    let mut start = Vec::new();
    let at = || format!("cannot replace {}", path.display());
    let file = fs::File::open(path).with_context(at)?;
    file.take(HEAD_BYTES).read_to_end(&mut start).with_context(at)?;
    let is_page = start.is_empty() || String::from_utf8_lossy(&start).contains(GENERATOR);
    ensure!(is_page, "{} exists and is no page of tello-ctl: choose another name", path.display());
    Ok(())
}

/// Within which a page names the program that made it. bytes
const HEAD_BYTES: u64 = 1024;

/// The flights in `paths`; those that cannot be used go to `unusable`.
fn read(paths: &[PathBuf], unusable: &mut Vec<Unusable>) -> Result<Group> {
    let before = unusable.len();
    let read = |path: &Path| -> Result<(String, Motions, EvaluatedFlight)> {
        // Reading the flight refuses a file without end, of which the checksum would never be done.
        let looked = EvaluatedFlight::at(Flight::read(path)?);
        // A replay has the poses of its log and is no copy.
        let motions = match looked.flight.unjudged {
            None => known_flights::of_ticks(&looked.flight.ticks),
            Some(_) => Motions::new(),
        };
        Ok((checksum(path)?, motions, looked))
    };
    let (read, skipped) =
        recordings::read_once(paths, read, |(sum, motions, _)| (sum.as_str(), motions))?;
    let skipped = skipped.into_iter();
    unusable.extend(skipped.map(|FileSkipped { path: file, why }| Unusable { file, why }));
    let looked: Vec<EvaluatedFlight> = read.into_iter().map(|(_, _, one)| one).collect();
    if looked.is_empty() {
        let why: Vec<String> = unusable[before..].iter().map(Unusable::to_string).collect();
        bail!("there is no flight to report: {}", why.join("; "));
    }
    Ok(Group::of(name_of(paths), looked))
}

/// SHA-256 of the bytes of a file, hexadecimal.
fn checksum(path: &Path) -> Result<String> {
    let mut sum = Sha256::new();
    fs::File::open(path)
        .and_then(|mut file| io::copy(&mut file, &mut sum))
        .with_context(|| format!("cannot read {}", path.display()))?;
    Ok(format!("{:x}", sum.finalize()))
}

/// Common name of the flights in `paths`.
fn name_of(paths: &[PathBuf]) -> String {
    let name = |path: &Path| {
        let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        path.file_stem()
            .map_or_else(|| "flights".into(), |name| name.to_string_lossy().into_owned())
    };
    match paths {
        [] => String::new(),
        [only] => name(only),
        [first, .., last] => format!("{} .. {}", name(first), name(last)),
    }
}

/// Some flights of each group with their figures.
fn shown(groups: &[Group]) -> Vec<Shown<'_>> {
    let chosen: Vec<(usize, &EvaluatedFlight)> = groups
        .iter()
        .enumerate()
        .flat_map(|(number, group)| {
            pictures::shown(group).into_iter().map(move |one| (number, one))
        })
        .collect();
    let numbered: Vec<_> = chosen.into_iter().enumerate().collect();
    numbered
        .into_par_iter()
        .map(|(place, (_, looked))| Shown {
            row: &looked.row,
            pictures: pictures::of_flight(looked, &format!("flight-{}", place + 1)),
        })
        .collect()
}

impl Page {
    /// Writes every figure as an SVG file to the folder `dir`, made if it does not exist.
    ///
    /// # Errors
    /// The folder or a file cannot be written.
    pub fn save_figures(&self, dir: &Path) -> Result<()> {
        fs::create_dir_all(dir)
            .with_context(|| format!("cannot make the folder {}", dir.display()))?;
        for picture in &self.pictures {
            let path = dir.join(format!("{}.svg", picture.name));
            atomic_file::write_contents(&path, true, picture.figure.svg())?;
        }
        Ok(())
    }
}

impl Display for FlightsReport {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for (group, verdict) in self.groups.iter().zip(&self.verdicts) {
            writeln!(f, "{}: {verdict}\n", group.name)?;
            writeln!(
                f,
                "{:<26} {:>9} {:>9} {:>9} {:>9} {:>9}",
                "", "25 %", "median", "75 %", "95 %", "largest"
            )?;
            for (quantity, spread) in &group.numbers {
                let (name, unit, digits) = quantity.label();
                let Spread { q25, median, q75, p95, max, .. } = spread;
                writeln!(
                    f,
                    "{name:<26} {q25:>9.digits$} {median:>9.digits$} {q75:>9.digits$} {p95:>9.digits$} \
                     {max:>9.digits$}  {unit}"
                )?;
            }
            writeln!(f)?;
        }
        for unusable in &self.unusable {
            writeln!(f, "not in the report: {unusable}")?;
        }
        writeln!(f, "page  {}", self.page.display())
    }
}

#[cfg(test)]
mod tests;
