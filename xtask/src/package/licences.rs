//! Licences of all that the program is linked from.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};
use serde::Deserialize;

/// Licences that permit to pass on the linked program under the terms of any other.
const PERMITTED: [&str; 11] = [
    "0BSD",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "ISC",
    "MIT",
    "Unicode-3.0",
    "Unlicense",
    "Zlib",
];

/// Packages that name no licence but have a file with its text, which was read.
const READ: [(&str, &str); 1] = [("cobyla", "MIT")];

/// How the names of files with licences begin, in capitals.
const LICENCE_FILES: [&str; 5] = ["LICENSE", "LICENCE", "COPYING", "NOTICE", "UNLICENSE"];

/// Folders with the sources of others inside of a package.
const BUNDLED: [&str; 1] = ["zstd"];

/// A package that the program is linked from.
#[derive(Debug, Deserialize)]
pub(super) struct Package {
    id: String,
    name: String,
    version: String,
    license: Option<String>,
    manifest_path: PathBuf,
    /// None: a package of this workspace.
    source: Option<String>,
}

#[derive(Deserialize)]
struct Metadata {
    packages: Vec<Package>,
    resolve: Resolve,
}

#[derive(Deserialize)]
struct Resolve {
    nodes: Vec<Node>,
}

#[derive(Deserialize)]
struct Node {
    id: String,
    deps: Vec<Edge>,
}

#[derive(Deserialize)]
struct Edge {
    pkg: String,
    dep_kinds: Vec<EdgeKind>,
}

/// Null is a normal dependency; the others are not linked.
#[derive(Deserialize)]
struct EdgeKind {
    kind: Option<String>,
}

/// Packages of others that the program is linked from, in the order of their names. Procedural macros, which only run
/// in the compiler, are among them.
pub(super) fn of_program(root: &Path) -> Result<Vec<Package>> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let host = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
    let metadata = super::output(
        Command::new(cargo)
            .args(["metadata", "--locked", "--format-version", "1", "--filter-platform", &host])
            .current_dir(root),
    )?;
    let metadata: Metadata = serde_json::from_str(&metadata)?;
    let program = metadata.packages.iter().find(|package| package.name == "tello-ctl");
    let mut open = vec![program.context("no package tello-ctl")?.id.clone()];
    let nodes: BTreeMap<_, _> =
        metadata.resolve.nodes.iter().map(|node| (&node.id, &node.deps)).collect();
    let mut linked = BTreeSet::new();
    while let Some(id) = open.pop() {
        let edges = nodes.get(&id).into_iter().flat_map(|edges| edges.iter());
        let normal = edges.filter(|edge| edge.dep_kinds.iter().any(|kind| kind.kind.is_none()));
        open.extend(normal.map(|edge| edge.pkg.clone()).filter(|id| !linked.contains(id)));
        linked.insert(id);
    }
    let is_foreign = |package: &Package| package.source.is_some() && linked.contains(&package.id);
    let mut packages: Vec<_> = metadata.packages.into_iter().filter(is_foreign).collect();
    for package in packages.iter_mut().filter(|package| package.license.is_none()) {
        let read = READ.iter().find(|(name, _)| package.name == *name);
        package.license = read.map(|(_, licence)| (*licence).into());
    }
    packages.sort_by(|a, b| (&a.name, &a.version).cmp(&(&b.name, &b.version)));
    Ok(packages)
}

/// Refuses a package whose licence offers no permitted choice.
pub(super) fn refuse_others(packages: &[Package]) -> Result<()> {
    let is_refused = |package: &&Package| !package.license.as_deref().is_some_and(is_permitted);
    let refused: Vec<_> = packages.iter().filter(is_refused).map(described).collect();
    if refused.is_empty() {
        return Ok(());
    }
    bail!("licences that are not in the list of permitted ones:\n{}", refused.join("\n"))
}

/// Whether an SPDX expression can be met by permitted licences. `OR` binds weaker than `AND`; a slash is an old `OR`.
fn is_permitted(expression: &str) -> bool {
    let expression = expression.replace('/', " OR ");
    if let Some((before, rest)) = expression.split_once('(') {
        let Some((inside, after)) = rest.split_once(')') else { return false };
        let inside = if is_permitted(inside) { PERMITTED[0] } else { "refused" };
        return is_permitted(&format!("{before}{inside}{after}"));
    }
    let is_met = |choice: &str| choice.split(" AND ").all(|name| PERMITTED.contains(&name.trim()));
    expression.split(" OR ").any(is_met)
}

fn described(package: &Package) -> String {
    let licence = package.license.as_deref().unwrap_or("no licence named");
    format!("{} {}: {licence}", package.name, package.version)
}

/// Packages by licence.
pub(super) fn table(packages: &[Package]) -> String {
    let mut by_licence: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for package in packages {
        let licence = package.license.as_deref().unwrap_or("none").replace('/', " OR ");
        by_licence.entry(licence).or_default().push(&package.name);
    }
    let rows = by_licence.into_iter().map(|(licence, names)| {
        format!("| {licence} | {} | {} |\n", names.len(), names.join(", "))
    });
    "| licence | packages | names |\n|---|---|---|\n".to_owned() + &rows.collect::<String>()
}

/// Every package with its licence, then the text of each licence with the packages that have it.
pub(super) fn texts(packages: &[Package]) -> Result<String> {
    let mut parts = vec![format!(
        "tello-ctl is linked from these {} packages and from Rust's standard library (MIT OR Apache-2.0).\n\
         The texts of their licences follow.\n",
        packages.len()
    )];
    parts.extend(packages.iter().map(described));
    let mut holders: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for package in packages {
        for licence in licence_files(package)? {
            let holder = format!("{} {}", package.name, package.version);
            holders.entry(licence).or_default().push(holder);
        }
    }
    let line = "-".repeat(80);
    for (licence, mut names) in holders {
        names.dedup();
        parts.push(format!("\n{line}\n{}\n\n{}", names.join(", "), licence.trim()));
    }
    Ok(parts.join("\n") + "\n")
}

/// Texts of the files with licences in a package, and in the sources that it bundles.
fn licence_files(package: &Package) -> Result<Vec<String>> {
    let folder = package.manifest_path.parent().context("a manifest without a folder")?;
    let bundled = BUNDLED.map(|name| folder.join(name)).into_iter().filter(|path| path.is_dir());
    let mut texts = Vec::new();
    for folder in std::iter::once(folder.to_owned()).chain(bundled) {
        for entry in fs::read_dir(&folder)? {
            let entry = entry?;
            let name = entry.file_name().to_string_lossy().to_uppercase();
            let is_licence = LICENCE_FILES.iter().any(|start| name.starts_with(start));
            if is_licence && entry.path().is_file() {
                texts.push(String::from_utf8_lossy(&fs::read(entry.path())?).into_owned());
            }
        }
    }
    texts.sort();
    Ok(texts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_choice_is_permitted_and_a_compulsion_is_not() {
        for expression in [
            "MIT",
            "MIT/Apache-2.0",
            "GPL-3.0 OR MIT",
            "(MIT OR Apache-2.0) AND Unicode-3.0",
            "Apache-2.0 WITH LLVM-exception OR MPL-2.0",
        ] {
            assert!(is_permitted(expression), "{expression}");
        }
        for expression in ["GPL-3.0", "MIT AND GPL-3.0", "(MIT OR ISC) AND MPL-2.0", "(MIT"] {
            assert!(!is_permitted(expression), "{expression}");
        }
    }

    #[test]
    fn all_that_the_program_is_linked_from_has_a_permitted_licence_and_its_text() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let packages = of_program(root).unwrap();
        let is_linked = |name: &str| packages.iter().any(|package| package.name == name);
        assert!(is_linked("mcap") && is_linked("zstd-sys"));
        assert!(!is_linked("proptest") && !is_linked("tello-io"));
        refuse_others(&packages).unwrap();
        let texts = texts(&packages).unwrap();
        assert!(texts.contains("Meta Platforms"), "the licence of zstd itself");
    }
}
