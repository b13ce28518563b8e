//! Keeps the repository honest: what no compiler checks and every reader relies on.
//!
//! A check is a function from text to complaints. A test of its own shows each of them a bad text.

#[cfg(test)]
#[path = "tidy/bad_texts.rs"]
mod bad_texts;
#[cfg(test)]
#[path = "tidy/book.rs"]
mod book;
#[cfg(test)]
#[path = "tidy/limits.rs"]
mod limits;
#[path = "tidy/repository.rs"]
mod repository;
#[path = "tidy/rows.rs"]
mod rows;
#[cfg(test)]
#[path = "tidy/terms.rs"]
mod terms;
#[path = "tidy/words.rs"]
mod words;

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;

use repository::{File, document, files, root};
use rows::KERNELS;
use serde_json::Value;
use words::{CATCH_ALL, comments, equation_numbers, has_word, keys, quoted_equations};

/// Longest source file, tests included. lines
const LINES_MAX: usize = 400;

/// Longest line of a comment that is no row of a table.
const COLUMNS_MAX: usize = 120;

/// Who may depend on whom; a new crate needs a line here.
const ARROWS: [(&str, &[&str]); 11] = [
    ("horizon-model", &[]),
    ("horizon-estim", &["horizon-model"]),
    ("horizon-control", &["horizon-model"]),
    ("horizon-examples", LIBRARY),
    ("tello-flight", LIBRARY),
    ("tello-io", &["horizon-model", "tello-flight"]),
    ("tello-eval", &["horizon-model", "horizon-estim", "tello-flight", "tello-io"]),
    ("tello-sim", BELOW_SIM),
    ("tello-ctl", APPLICATION),
    ("tello-python", APPLICATION),
    ("xtask", EVERY_CRATE),
];

/// For any system.
const LIBRARY: &[&str] = &["horizon-model", "horizon-estim", "horizon-control"];
/// A simulated flight is flown, logged and judged.
const BELOW_SIM: &[&str] =
    &["horizon-model", "horizon-estim", "tello-flight", "tello-io", "tello-eval"];
/// Crates of the program.
const APPLICATION: &[&str] = &[
    "horizon-model",
    "horizon-estim",
    "horizon-control",
    "tello-flight",
    "tello-io",
    "tello-eval",
    "tello-sim",
];
const EVERY_CRATE: &[&str] = &[
    "horizon-model",
    "horizon-estim",
    "horizon-control",
    "tello-flight",
    "tello-io",
    "tello-eval",
    "tello-sim",
    "tello-ctl",
];

/// Workspaces of their own, parts of no other crate: one is built by another compiler, in one we fly with other
/// people's client.
const OWN_WORKSPACES: [&str; 2] = ["fuzz/Cargo.toml", "tests/clients/tello_edu/Cargo.toml"];

/// Crates that the tick does not depend on, however indirectly: no runtime, socket, file or system call.
const NOT_BELOW_FLIGHT: [&str; 9] =
    ["tokio", "mcap", "socket2", "nix", "mio", "evdev", "rtrb", "thread-priority", "tello-io"];

/// Files and folders whose functions are functions of their arguments.
const PURE: [&str; 9] = [
    "crates/model/src/",
    "crates/estim/src/",
    "crates/control/src/",
    "crates/flight/src/",
    "crates/eval/src/bench/",
    "crates/io/src/manual/controls.rs",
    "crates/io/src/manual/keys.rs",
    "crates/io/src/mocap/",
    "crates/io/src/tello/",
];

/// Those among them that hold sockets, addresses or threads.
const NOT_PURE: [&str; 11] = [
    "crates/io/src/mocap/client.rs",
    "crates/io/src/mocap/client/",
    "crates/io/src/mocap/settings.rs",
    "crates/io/src/mocap/survey.rs",
    "crates/io/src/mocap/wire.rs",
    "crates/io/src/mocap/wire/",
    "crates/io/src/tello/bind.rs",
    "crates/io/src/tello/client.rs",
    "crates/io/src/tello/client/",
    "crates/io/src/tello/guardian.rs",
    "crates/io/src/tello/guardian/",
];

/// Names that a pure file never has. `std::{` would hide the others from this search.
const IMPURE: [&str; 10] = [
    "tokio",
    "async",
    "Instant",
    "SystemTime",
    "std::net",
    "std::fs",
    "std::env",
    "std::thread",
    "std::process",
    "std::{",
];

/// No settings of ours: their keys are explained elsewhere.
const FOREIGN_SETTINGS: [&str; 3] =
    ["configs/viewers/foxglove.json", "xtask/advisories.json", "crates/eval/src/bench/checks.json"];

/// Roots of the paths that documents name.
const NAMED_ROOTS: [&str; 7] =
    ["crates/", "configs/", "docs/", "examples/", "tests/", ".ci/", ".github/"];

/// Checks every file with `ending`, and that there was something to check.
fn check(ending: &str, complaints_about: impl Fn(&File) -> Vec<String>) -> io::Result<()> {
    let files = files(ending)?;
    assert!(files.len() > 3, "only {} files end in {ending}", files.len());
    let complaints: Vec<String> = files.iter().flat_map(complaints_about).collect();
    assert!(complaints.is_empty(), "\n{}", complaints.join("\n"));
    Ok(())
}

/// Dependencies of a manifest against [`ARROWS`], and its lints against the workspace's.
fn manifest_complaints(manifest: &File) -> Vec<String> {
    let name = manifest.text.lines().find_map(|line| line.strip_prefix("name = "));
    let Some(name) = name.map(|name| name.trim_matches('"')) else {
        return Vec::new(); // the workspace itself
    };
    if OWN_WORKSPACES.contains(&manifest.path.as_str()) {
        return Vec::new();
    }
    let Some((_, allowed)) = ARROWS.iter().find(|(crate_name, _)| *crate_name == name) else {
        return vec![format!("{}: {name} has no place in ARROWS", manifest.path)];
    };
    let mut complaints = Vec::new();
    for line in manifest.text.lines().map(|line| line.split('#').next().unwrap_or_default()) {
        let is_prose = line.starts_with("name = ") || line.starts_with("description = ");
        for (other, _) in ARROWS {
            if !is_prose && line.contains(other) && !allowed.contains(&other) {
                complaints.push(format!("{}: {name} must not depend on {other}", manifest.path));
            }
        }
    }
    if !manifest.text.contains("[lints]\nworkspace = true") {
        complaints.push(format!("{}: does not take the lints of the workspace", manifest.path));
    }
    complaints
}

/// The lints that a manifest sets for its workspace, without reasons.
fn workspace_lints(manifest: &str) -> Vec<&str> {
    let mut is_inside = false;
    let lines = manifest.lines().filter(|line| {
        if line.starts_with('[') {
            is_inside = line.starts_with("[workspace.lints.");
        }
        is_inside && line.contains('=')
    });
    lines.map(|line| line.split('#').next().unwrap_or_default().trim_end()).collect()
}

fn purity_complaints(file: &File) -> Vec<String> {
    let is_pure = file.is_in(&PURE) && !file.is_in(&NOT_PURE);
    let lines = file.text.lines().enumerate().filter(|_| is_pure);
    let hits = lines.flat_map(|(i, line)| IMPURE.map(|word| (i + 1, line, word)));
    hits.filter(|(_, line, word)| has_word(line, word))
        .map(|(at, _, word)| format!("{}:{at}: a pure file names `{word}`", file.path))
        .collect()
}

/// Size, name, long comments and unfinished work.
fn shape_complaints(file: &File) -> Vec<String> {
    let mut complaints = Vec::new();
    let count = file.text.lines().count();
    if count > LINES_MAX {
        complaints.push(format!("{}: {count} lines, at most {LINES_MAX}", file.path));
    }
    for name in file.path.trim_end_matches(".rs").split('/') {
        if CATCH_ALL.contains(&name) {
            complaints.push(format!("{}: `{name}` says nothing", file.path));
        }
    }
    let marks = [concat!("TO", "DO"), concat!("FIX", "ME"), concat!("XX", "X")];
    for (i, line) in file.text.lines().enumerate() {
        let unfinished = marks.iter().find(|mark| has_word(line, mark));
        if unfinished.is_some_and(|mark| !line.contains(&format!("{mark}(#"))) {
            complaints.push(format!("{}:{}: unfinished, and no issue named", file.path, i + 1));
        }
        let comment = line.trim_start().strip_prefix("//");
        let is_prose =
            comment.is_some_and(|it| !it.trim_start_matches(['/', '!', ' ']).starts_with('|'));
        if is_prose && line.chars().count() > COLUMNS_MAX {
            let rule = format!("a comment has at most {COLUMNS_MAX} columns");
            complaints.push(format!("{}:{}: {rule}", file.path, i + 1));
        }
    }
    complaints
}

/// Paths that a document or a comment names in backticks, or a document as a link, and that do not
/// exist.
fn path_complaints(file: &File, exists: impl Fn(&Path) -> bool) -> Vec<String> {
    let is_document = Path::new(&file.path).extension().is_some_and(|ending| ending == "md");
    let text = if is_document { file.text.clone() } else { comments(&file.text) };
    let spans = text.split('`').skip(1).step_by(2).flat_map(str::split_whitespace);
    let is_path = |word: &&str| {
        NAMED_ROOTS.iter().any(|root| word.starts_with(root)) && !word.contains(['*', '<', '{'])
    };
    let named = spans.filter(is_path).map(|word| (word, PathBuf::from(word)));
    let folder = Path::new(&file.path).parent().unwrap_or(Path::new(""));
    let links = text.split("](").skip(1).filter_map(|rest| rest.split([')', '#']).next());
    let links = links.filter(|link| is_document && !link.is_empty() && !link.contains("://"));
    let linked = links.map(|link| (link, folder.join(link)));
    named
        .chain(linked)
        .filter(|(_, path)| !exists(path))
        .map(|(word, _)| format!("{}: names {word}, which does not exist", file.path))
        .collect()
}

#[test]
fn crates_depend_in_one_direction() -> io::Result<()> {
    check("Cargo.toml", manifest_complaints)
}

/// A workspace of its own cannot inherit them.
#[test]
fn workspaces_of_their_own_have_the_lints_of_the_workspace() -> io::Result<()> {
    let ours = document("Cargo.toml")?;
    let lints = workspace_lints(&ours);
    assert!(lints.len() > 20, "{lints:?}");
    for path in OWN_WORKSPACES {
        let manifest = document(path)?;
        assert_eq!(workspace_lints(&manifest), lints, "{path}");
        assert!(manifest.contains("[lints]\nworkspace = true"), "{path}");
    }
    Ok(())
}

/// `cargo run` of the README runs the program.
#[test]
fn the_program_is_the_only_binary_of_the_default_members() -> io::Result<()> {
    let arguments = ["metadata", "--no-deps", "--offline", "--format-version", "1"];
    let output = Command::new(env!("CARGO")).args(arguments).current_dir(root()).output()?;
    let metadata: Value = serde_json::from_slice(&output.stdout)?;
    let list = |value: &Value, key: &str| value[key].as_array().cloned().unwrap_or_default();
    let members = list(&metadata, "workspace_default_members");
    let packages = list(&metadata, "packages");
    let targets = packages.iter().filter(|package| members.contains(&package["id"]));
    let targets = targets.flat_map(|package| list(package, "targets"));
    let is_binary = |target: &Value| list(target, "kind").contains(&"bin".into());
    let names: Vec<_> = targets.filter(is_binary).map(|target| target["name"].clone()).collect();
    assert_eq!(names, ["tello-ctl"]);
    Ok(())
}

/// `cargo tree` names what the crate is built from, itself first.
#[test]
fn nothing_below_the_tick_reaches_outside() -> io::Result<()> {
    let arguments = ["tree", "--offline", "--package", "tello-flight", "--edges", "normal"];
    let shape = ["--prefix", "none", "--format", "{lib}"];
    let cargo =
        Command::new(env!("CARGO")).args(arguments).args(shape).current_dir(root()).output()?;
    let tree = String::from_utf8_lossy(&cargo.stdout);
    let below: BTreeSet<&str> = tree.lines().collect();
    assert!(below.contains("horizon_control"), "{tree}");
    let found = NOT_BELOW_FLIGHT.map(|name| name.replace('-', "_"));
    let found: Vec<&String> = found.iter().filter(|name| below.contains(name.as_str())).collect();
    assert!(found.is_empty(), "{found:?} below tello-flight");
    Ok(())
}

#[test]
fn pure_files_know_no_clock_socket_or_file() -> io::Result<()> {
    for place in PURE.into_iter().chain(NOT_PURE) {
        assert!(root().join(place).exists(), "{place} is gone: what is pure now?");
    }
    check(".rs", purity_complaints)
}

#[test]
fn files_are_short_named_and_finished() -> io::Result<()> {
    check(".rs", shape_complaints)
}

#[test]
fn every_quoted_equation_stands_in_the_model_document() -> io::Result<()> {
    let model = document("docs/model.md")?;
    let derived: BTreeSet<_> = model.split_whitespace().flat_map(equation_numbers).collect();
    check(".rs", |file| {
        let quoted = if file.is_in(&KERNELS) { quoted_equations(file) } else { BTreeSet::new() };
        let missing = quoted.difference(&derived);
        missing.map(|(c, n)| format!("{}: {c}.{n} is not in docs/model.md", file.path)).collect()
    })
}

#[test]
fn documents_and_comments_name_only_what_exists() -> io::Result<()> {
    let complaints = |file: &File| path_complaints(file, |path| root().join(path).exists());
    check(".md", complaints)?;
    check(".rs", complaints)
}

#[test]
fn every_setting_is_explained() -> io::Result<()> {
    let configuration = document("docs/configuration.md")?;
    let is_missing = |key: &&str| !configuration.contains(&format!("`{key}`"));
    check(".json", |file| {
        let is_ours = !FOREIGN_SETTINGS.contains(&file.path.as_str());
        let missing = keys(&file.text).into_iter().filter(|key| is_ours && is_missing(key));
        missing
            .map(|key| format!("{}: `{key}` is not in docs/configuration.md", file.path))
            .collect()
    })
}

#[test]
fn every_log_channel_is_explained() -> io::Result<()> {
    let notation = document("docs/notation.md")?;
    let record = document("crates/flight/src/cycle/record.rs")?;
    let channels: Vec<&str> =
        record.split('"').skip(1).step_by(2).filter(|text| text.starts_with('/')).collect();
    assert!(channels.len() > 3, "{channels:?}");
    for channel in channels {
        assert!(notation.contains(&format!("`{channel}`")), "{channel} is not in docs/notation.md");
    }
    Ok(())
}

/// First columns of a table of tested failures that are no file.
fn failure_complaints(table: &str, exists: impl Fn(&str) -> bool) -> Vec<&str> {
    let tests: BTreeSet<_> =
        table.lines().skip(1).filter_map(|row| row.split(',').next()).collect();
    tests.into_iter().filter(|test| !exists(test)).collect()
}

#[test]
fn every_tested_failure_names_its_test() -> io::Result<()> {
    let table = document("docs/data/tested_failures.csv")?;
    let complaints = failure_complaints(&table, |test| root().join(test).is_file());
    assert!(complaints.is_empty() && table.lines().count() > 30, "{complaints:#?}");
    Ok(())
}
