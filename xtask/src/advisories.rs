//! Known vulnerabilities of dependencies: `cargo xtask advisories`.
//!
//! Owns the comparison of `Cargo.lock` with the advisories of RustSec. The database is in no package registry, so what
//! it says of our dependencies is kept in `xtask/advisories.json`: identifiers, versions and addresses, no texts.

mod database;
#[cfg(test)]
mod tests;

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use semver::{Version, VersionReq};
use serde::{Deserialize, Serialize};
use toml_edit::DocumentMut;

/// Where the facts are kept.
const KEPT: &str = "xtask/advisories.json";

/// Lock files; that of the fuzz targets exists only where they were built.
const LOCKS: [&str; 2] = ["Cargo.lock", "fuzz/Cargo.lock"];

/// Longest row of names. characters
const ROW_MAX: usize = 116;

/// Compare the versions in Cargo.lock with the known vulnerabilities of RustSec.
///
/// A vulnerable version fails, and a crate that was never looked up. What is only informational (unmaintained, unsound,
/// notice) is a warning.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Read this clone of <https://github.com/rustsec/advisory-db> instead of xtask/advisories.json.
    #[arg(long, value_name = "DIR")]
    database: Option<PathBuf>,
    /// Keep what the database says of our dependencies in xtask/advisories.json.
    #[arg(long, requires = "database")]
    update: bool,
}

/// Advisories of a database on our dependencies.
#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Facts {
    database: Origin,
    advisories: Vec<Advisory>,
    /// Crates that were looked up and have no advisory.
    without: BTreeSet<String>,
}

/// Where facts come from.
#[derive(Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct Origin {
    url: String,
    /// None: not a clone.
    commit: Option<String>,
    /// Day of the commit, else what is known of it.
    date: String,
    /// The newest advisory of all.
    newest: String,
    note: Option<String>,
}

#[derive(Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct Advisory {
    #[serde(rename = "crate")]
    name: String,
    id: String,
    kind: Kind,
    patched: Vec<VersionReq>,
    unaffected: Vec<VersionReq>,
    url: Option<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Vulnerability,
    Unmaintained,
    Unsound,
    Notice,
}

/// A package of a registry in a lock file.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Locked {
    name: String,
    version: Version,
}

/// Findings about the packages of a lock file.
#[derive(Debug, Default, PartialEq)]
struct Findings {
    vulnerable: Vec<String>,
    informational: Vec<String>,
    /// Never looked up.
    unknown: BTreeSet<String>,
}

/// Compares, and keeps the facts of another database.
///
/// # Errors
/// A vulnerable version, a crate that was never looked up, a file that cannot be read.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().context("no workspace")?;
    let mut packages = BTreeSet::new();
    for file in LOCKS.map(|lock| root.join(lock)).iter().filter(|file| file.exists()) {
        let text = fs::read_to_string(file)?;
        packages.extend(locked(&text).with_context(|| file.display().to_string())?);
    }
    let facts = match &arguments.database {
        Some(folder) => {
            database::read(folder, packages.iter().map(|package| package.name.clone()).collect())?
        }
        None => kept(KEPT, &fs::read_to_string(root.join(KEPT)).context(KEPT)?)?,
    };
    if arguments.update {
        fs::write(root.join(KEPT), text(&facts)?)?;
        println!("wrote {KEPT}");
    }
    let findings = facts.compare(&packages);
    for line in &findings.informational {
        println!("warning: {line}");
    }
    let Origin { date, newest, .. } = &facts.database;
    println!("{} packages, database of {date}, newest advisory {newest}", packages.len());
    findings.judge()
}

/// The kept facts; an error names file, line and column.
fn kept(file: &str, text: &str) -> Result<Facts> {
    serde_json::from_str(text).with_context(|| format!("{file} is damaged"))
}

/// Packages of a lock file that come from elsewhere.
fn locked(text: &str) -> Result<Vec<Locked>> {
    let document: DocumentMut = text.parse()?;
    let packages = document.get("package").and_then(|item| item.as_array_of_tables());
    let mut locked = Vec::new();
    for package in packages.context("no packages")? {
        let field = |key| package.get(key).and_then(|item| item.as_str());
        if field("source").is_some() {
            let name = field("name").context("a package without a name")?.to_owned();
            let version = field("version").with_context(|| format!("{name} without version"))?;
            locked.push(Locked { version: version.parse()?, name });
        }
    }
    Ok(locked)
}

/// One row for each advisory, so that a change of the file can be read.
fn text(facts: &Facts) -> Result<String> {
    let mut text = format!("{{\n\"database\": {},\n", serde_json::to_string(&facts.database)?);
    let rows: Vec<_> =
        facts.advisories.iter().map(serde_json::to_string).collect::<Result<_, _>>()?;
    write!(text, "\"advisories\": [\n{}\n],\n\"without\": [\n", rows.join(",\n"))?;
    let mut row = String::new();
    for (index, name) in facts.without.iter().enumerate() {
        let comma = if index + 1 < facts.without.len() { "," } else { "" };
        let name = format!("\"{name}\"{comma}");
        if row.len() + name.len() >= ROW_MAX {
            writeln!(text, "{}", row.trim_end())?;
            row.clear();
        }
        write!(row, "{name} ")?;
    }
    writeln!(text, "{}\n]\n}}", row.trim_end())?;
    Ok(text)
}

impl Facts {
    fn compare(&self, packages: &BTreeSet<Locked>) -> Findings {
        let mut findings = Findings::default();
        for package in packages {
            let mut is_known = self.without.contains(&package.name);
            for advisory in self.advisories.iter().filter(|known| known.name == package.name) {
                is_known = true;
                if advisory.concerns(&package.version) {
                    let line = advisory.line(&package.version);
                    match advisory.kind {
                        Kind::Vulnerability => findings.vulnerable.push(line),
                        _ => findings.informational.push(line),
                    }
                }
            }
            if !is_known {
                findings.unknown.insert(package.name.clone());
            }
        }
        findings
    }
}

impl Advisory {
    /// A range leaves out pre-releases that it does not name: such a version is rather reported than missed.
    fn concerns(&self, version: &Version) -> bool {
        !self.patched.iter().chain(&self.unaffected).any(|range| range.matches(version))
    }

    fn line(&self, version: &Version) -> String {
        let Self { name, id, kind, patched, url, .. } = self;
        let kind = format!("{kind:?}").to_lowercase();
        let patched: Vec<_> = patched.iter().map(ToString::to_string).collect();
        let patched = if patched.is_empty() {
            "never".into()
        } else {
            format!("in {}", patched.join(" or "))
        };
        let url = url.as_deref().unwrap_or("no address");
        format!("{id}: {name} {version}: {kind}, patched {patched} ({url})")
    }
}

impl Findings {
    fn judge(&self) -> Result<()> {
        let unknown: Vec<_> = self.unknown.iter().map(String::as_str).collect();
        ensure!(
            unknown.is_empty(),
            "never looked up: {}; run `cargo xtask advisories --database DIR --update` with a clone of \
             https://github.com/rustsec/advisory-db, or add what https://rustsec.org/packages/NAME.html says to {KEPT}",
            unknown.join(", ")
        );
        ensure!(
            self.vulnerable.is_empty(),
            "vulnerable dependencies, to be updated (`cargo update --package NAME`):\n{}",
            self.vulnerable.join("\n")
        );
        Ok(())
    }
}
