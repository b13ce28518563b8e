//! `tello-ctl report`: recorded flights as one page, figures and numbers.
//!
//! Owns the command. What is measured is `report/quantity.rs`, when a flight was good `report/verdict.rs`,
//! how it looks `report/page.rs`.

mod flight;
mod group;
mod page;
mod pictures;
mod quantity;
mod verdict;

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;
use rayon::iter::{IntoParallelIterator, IntoParallelRefIterator, ParallelIterator};
use schemars::JsonSchema;
use serde::Serialize;

use crate::{REVISION, Verdict, recordings, say, whole_file};
use flight::Flight;
use group::{Comparison, Group, Looked};
use page::Shown;
use pictures::Picture;
use quantity::{Quantity, Spread};

/// Make a page of recorded flights: was it good, and why not; numbers and figures.
///
/// LOG is a log of tello-ctl (MCAP), a CSV flight of the thesis, or a folder of them. The page is one HTML
/// file with everything inside: it needs no network and opens from the disk, light or dark, and prints.
/// Numbers are those of section 5.2.3 of the thesis with the definitions that reproduce them, and are named
/// in the page. With --against a second group of flights stands beside the first, with the differences
/// flight by flight: of the same name, or else in their order.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  tello-ctl report logs/today.mcap                       one flight
  tello-ctl report flights --figures figures             a folder of flights, figures as SVG files too
  tello-ctl report new --against old --out compared.html
  tello-ctl report flights --json                        the numbers of the page

Exit codes: 0 done, 1 some files could not be used, 2 none could, or the page could not be written.")]
pub(crate) struct Arguments {
    /// Recordings or folders of recordings.
    #[arg(value_name = "LOG", required = true)]
    logs: Vec<PathBuf>,
    /// Where the page goes; an older one is replaced.
    #[arg(long, value_name = "FILE", default_value = "report.html")]
    out: PathBuf,
    /// Recordings or folders of recordings to compare with.
    #[arg(long, value_name = "LOG", num_args = 1..)]
    against: Vec<PathBuf>,
    /// Write every figure of the page as an SVG file to this folder, too, made if it does not exist.
    #[arg(long, value_name = "DIR")]
    figures: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// The numbers of the page.
#[derive(Debug, Clone, Serialize, JsonSchema)]
struct Report {
    /// Was it good, and why not: a text for each group.
    verdicts: Vec<String>,
    /// The flights, and those of `--against`.
    groups: Vec<Group>,
    /// Their differences; null without `--against`.
    comparison: Option<Comparison>,
    /// Files that could not be used.
    unusable: Vec<Unusable>,
    /// What each number means.
    definitions: BTreeMap<&'static str, &'static str>,
    /// The page.
    page: PathBuf,
    /// Git revision of the program.
    revision: &'static str,
}

/// A file that could not be used.
#[derive(Debug, Clone, Serialize, JsonSchema)]
struct Unusable {
    file: PathBuf,
    why: String,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    let mut unusable = Vec::new();
    let mut groups = vec![read(&arguments.logs, &mut unusable)?];
    if !arguments.against.is_empty() {
        groups.push(read(&arguments.against, &mut unusable)?);
    }
    let comparison = match groups.as_slice() {
        [ours, theirs] => Some(Comparison::of(ours, theirs)),
        _ => None,
    };
    let report = Report {
        verdicts: groups.iter().map(Group::verdict).collect(),
        groups,
        comparison,
        unusable,
        definitions: Quantity::ALL.map(|quantity| (quantity.key(), quantity.definition())).into(),
        page: arguments.out.clone(),
        revision: REVISION,
    };
    let pictures = pictures::of_groups(&report.groups);
    let shown = shown(&report.groups);
    let html = page::page(&report, &pictures, &shown);
    whole_file::write(&arguments.out, true, |part| Ok(fs::write(part, html)?))?;
    if let Some(dir) = &arguments.figures {
        save(dir, pictures.iter().chain(shown.iter().flat_map(|one| &one.pictures)))?;
    }
    say::report(&report, arguments.json)?;
    Ok(if report.unusable.is_empty() { Verdict::Good } else { Verdict::Bad })
}

/// The flights in `paths`; those that cannot be used go to `unusable`.
fn read(paths: &[PathBuf], unusable: &mut Vec<Unusable>) -> Result<Group> {
    let files = recordings::find(paths)?;
    let read = |file: &PathBuf| Flight::read(file).map(Looked::at);
    let results: Vec<Result<Looked>> = files.par_iter().map(read).collect();
    let mut looked = Vec::with_capacity(files.len());
    let known = unusable.len();
    for (file, result) in files.into_iter().zip(results) {
        match result {
            Ok(one) => looked.push(one),
            Err(error) => unusable.push(Unusable { file, why: format!("{error:#}") }),
        }
    }
    if looked.is_empty() {
        let why: Vec<&str> = unusable[known..].iter().map(|file| file.why.as_str()).collect();
        bail!("there is no flight to report: {}", why.join("; "));
    }
    Ok(Group::of(name_of(paths), looked))
}

/// What the flights in `paths` are called together.
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
    let chosen: Vec<(usize, &Looked)> = groups
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

/// Writes the figures as SVG files.
fn save<'a>(dir: &Path, pictures: impl Iterator<Item = &'a Picture>) -> Result<()> {
    fs::create_dir_all(dir).with_context(|| format!("cannot make the folder {}", dir.display()))?;
    for picture in pictures {
        let path = dir.join(format!("{}.svg", picture.name));
        fs::write(&path, picture.figure.svg())
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

impl Display for Report {
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
        for Unusable { file, why } in &self.unusable {
            writeln!(f, "not in the report: {}, {why}", file.display())?;
        }
        writeln!(f, "page  {}", self.page.display())
    }
}
