//! RustSec's database: a folder for each crate, a file for each advisory.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};
use semver::VersionReq;
use toml_edit::{DocumentMut, Item};

use super::{Advisory, Facts, Kind, Origin};
use crate::package::output;

const URL: &str = "https://github.com/rustsec/advisory-db";

/// How the names of advisories begin, and of those that have no number yet.
const PREFIX: &str = "RUSTSEC-";
const DRAFT: &str = "RUSTSEC-0000-";

/// A file of the database.
struct Entry {
    advisory: Advisory,
    date: String,
    is_withdrawn: bool,
}

/// Advisories of the clone in `folder` on the crates `names`.
///
/// # Errors
/// No advisories in the folder, or a file in an unknown format.
pub(super) fn read(folder: &Path, names: BTreeSet<String>) -> Result<Facts> {
    let (mut advisories, mut newest) = (Vec::new(), None);
    for file in files(&folder.join("crates"))? {
        let entry = entry(&fs::read_to_string(&file)?);
        let Entry { advisory, date, is_withdrawn } =
            entry.with_context(|| file.display().to_string())?;
        newest = newest.max(Some((advisory.id.clone(), date)));
        if !is_withdrawn && names.contains(&advisory.name) {
            advisories.push(advisory);
        }
    }
    let (newest, newest_date) =
        newest.with_context(|| format!("no advisories in {}", folder.display()))?;
    advisories.sort_by(|a, b| (&a.name, &a.id).cmp(&(&b.name, &b.id)));
    let is_free = |name: &String| !advisories.iter().any(|advisory| advisory.name == *name);
    let without = names.into_iter().filter(is_free).collect();
    let database = Origin {
        url: URL.into(),
        commit: last_commit(folder, "%H"),
        date: last_commit(folder, "%cs").unwrap_or(newest_date),
        newest,
        note: None,
    };
    Ok(Facts { database, advisories, without })
}

/// Files of advisories, in the order of crates and numbers.
fn files(crates: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for folder in children(crates)?.into_iter().filter(|folder| folder.is_dir()) {
        files.extend(children(&folder)?.into_iter().filter(|file| {
            let name = file.file_name().map(|name| name.to_string_lossy()).unwrap_or_default();
            name.starts_with(PREFIX) && !name.starts_with(DRAFT) && name.ends_with(".md")
        }));
    }
    Ok(files)
}

fn children(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut paths: Vec<_> = entries.map(|entry| Ok(entry?.path())).collect::<Result<_>>()?;
    paths.sort();
    Ok(paths)
}

/// Reads TOML between fences; the text behind it is not needed.
fn entry(text: &str) -> Result<Entry> {
    let toml = text.trim_start().strip_prefix("```toml").and_then(|rest| rest.split_once("\n```"));
    let document: DocumentMut = toml.context("no TOML between ```toml and ```")?.0.parse()?;
    let head = document.get("advisory").context("no table `advisory`")?;
    let field = |key: &str| head.get(key).and_then(Item::as_str).map(str::to_owned);
    let needed = |key: &str| field(key).with_context(|| format!("no `advisory.{key}`"));
    let kind = match field("informational").as_deref() {
        None => Kind::Vulnerability,
        Some("unmaintained") => Kind::Unmaintained,
        Some("unsound") => Kind::Unsound,
        Some("notice") => Kind::Notice,
        Some(other) => bail!("`informational` is {other}"),
    };
    let advisory = Advisory {
        name: needed("package")?,
        id: needed("id")?,
        kind,
        patched: ranges(&document, "patched")?,
        unaffected: ranges(&document, "unaffected")?,
        url: field("url"),
    };
    Ok(Entry { advisory, date: needed("date")?, is_withdrawn: field("withdrawn").is_some() })
}

/// Ranges of the table `versions`; a missing key has none.
fn ranges(document: &DocumentMut, key: &str) -> Result<Vec<VersionReq>> {
    let versions = document.get("versions").context("no table `versions`")?;
    let Some(ranges) = versions.get(key) else { return Ok(Vec::new()) };
    let ranges = ranges.as_array().with_context(|| format!("`versions.{key}` is no array"))?;
    let range = |value: &toml_edit::Value| -> Result<VersionReq> {
        let text = value.as_str().with_context(|| format!("`versions.{key}` has no text"))?;
        text.parse().with_context(|| format!("`versions.{key}`: {text}"))
    };
    ranges.iter().map(range).collect()
}

/// The last commit of a clone; None for any other folder, also for one inside of another repository.
fn last_commit(folder: &Path, format: &str) -> Option<String> {
    let format = format!("--format={format}");
    let mut git = Command::new("git");
    git.arg("-C").arg(folder).args(["log", "-1", &format]);
    let line = folder.join(".git").exists().then(|| output(&mut git))?.ok()?;
    Some(line.trim().to_owned())
}
