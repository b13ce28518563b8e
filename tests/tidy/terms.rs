//! The field's words: no name, comment or document uses a word of our own where the literature has one.
//!
//! A text is read as a sequence of lower-case words, names in snake case and camel case taken apart, so that
//! `WayBack`, `way_back` and "way back" are the same. Phrases may span lines.

use std::collections::BTreeMap;
use std::io;

use super::repository::{File, files};

/// A word or phrase that must not be used.
struct Term {
    /// The words, separated by blanks.
    not: &'static str,
    /// The field's term.
    but: &'static str,
    /// Files and folders in which it has another meaning elsewhere; empty: everywhere.
    places: &'static [&'static str],
}

const SOLVERS: &[&str] = &["crates/estim/", "crates/control/"];
const EMERGENCY: &[&str] = &["crates/flight/src/supervisor/", "crates/io/src/tello/session/"];

const TERMS: [Term; 58] = [
    everywhere("valley", "positive definite, local minimum"),
    everywhere("valleys", "positive definite, local minima"),
    everywhere("ridge", "direction of negative curvature"),
    everywhere("bend", "second derivatives, Hessian; turn of a path"),
    everywhere("bends", "second derivatives, Hessian; turns of a path"),
    everywhere("bent", "with second derivatives"),
    everywhere("parted", "partition"),
    everywhere("level and height", "partition, decoupled subsystems"),
    everywhere("way back", "back substitution; return"),
    everywhere("one before the one before", "ring buffer of the last two"),
    everywhere("slope", "gradient, derivative, costate"),
    everywhere("slopes", "gradients, derivatives, costates"),
    everywhere("held row", "active bound"),
    everywhere("held rows", "active bounds"),
    everywhere("held input", "input at an active bound"),
    everywhere("held inputs", "inputs at active bounds"),
    everywhere("free row", "inactive bound"),
    everywhere("free rows", "inactive bounds"),
    everywhere("free inputs", "inputs at inactive bounds"),
    everywhere("sweep", "backward Riccati recursion, roll-out, iteration"),
    everywhere("sweeps", "backward Riccati recursions, roll-outs, iterations"),
    everywhere("last several periods", "move blocking, non-uniform grid"),
    everywhere("what the step promised", "sufficient decrease, gain ratio"),
    everywhere("promised", "predicted, nominal"),
    everywhere("under way", "in transit, committed, running"),
    everywhere("acted", "applied"),
    everywhere("acting", "applied"),
    everywhere("told", "received, ordered, reported"),
    everywhere("said", "sent, reported"),
    everywhere("telegram", "packet, datagram"),
    everywhere("telegrams", "packets, datagrams"),
    everywhere("foresee", "predict"),
    everywhere("foresees", "predicts"),
    everywhere("foreseen", "predicted, forecast"),
    everywhere("foresaw", "predicted"),
    everywhere("foresight", "forecast"),
    everywhere("outlook", "predicted trajectory"),
    everywhere("share", "fraction, ratio, contribution; have in common"),
    everywhere("shares", "fractions, ratios, contributions"),
    everywhere("beyond the dead zone", "excess over the dead zone"),
    everywhere("beyond its dead zone", "excess over the dead zone"),
    everywhere("course", "reference path"),
    everywhere("drawn near", "clipped to a distance"),
    everywhere("wild pose", "outlier"),
    everywhere("polite kill", "SIGTERM"),
    everywhere("whoever", "the person, client, caller or thread that"),
    everywhere("nobody asked for", "disturbance"),
    everywhere("unlearnt", "removed from the window"),
    everywhere("motors off", "emergency stop (motor cut-off)"),
    everywhere("campaign of faults", "fault-injection campaign"),
    everywhere("kink", "corner, nonsmooth point"),
    everywhere("kinks", "corners, nonsmooth points"),
    everywhere("tell anything", "determine"),
    within("corner", "reduced system (Schur complement), parameter block", &["crates/estim/"]),
    within("front of", "elimination front, previous block", SOLVERS),
    within("reached", "controllable", &["crates/model/src/model.rs", "crates/control/src/mpc.rs"]),
    within("cut", "emergency stop", EMERGENCY),
    within("cuts", "emergency stops", EMERGENCY),
];

/// Words that must stay, each with its reason.
const EXCEPTIONS: [(&str, &str, &str); 9] = [
    ("crates/eval/src/scene.rs", "course", "a log channel and its entity: old logs must load"),
    ("docs/install.md", "share", "the folder `/usr/share`"),
    ("docs/logs.md", "course", "the log channel `/scene/course`"),
    ("docs/notation.md", "course", "the log channel `/scene/course`"),
    ("crates/flight/src/supervisor/evidence.rs", "cut", "the name in old logs, which must load"),
    ("crates/flight/src/supervisor/evidence/tests.rs", "cut", "the name in old logs"),
    ("crates/flight/src/supervisor/fault.rs", "cut", "the name in old logs, which must load"),
    ("xtask/src/package.rs", "share", "the folder `/usr/share`"),
    ("xtask/src/package/deb.rs", "share", "the folder `/usr/share`"),
];

const fn everywhere(not: &'static str, but: &'static str) -> Term {
    Term { not, but, places: &[] }
}

const fn within(not: &'static str, but: &'static str, places: &'static [&'static str]) -> Term {
    Term { not, but, places }
}

/// Line numbers and lower-case words of `text`; `is_valley`, `isValley` and `IsValley` are two words each.
fn words(text: &str) -> Vec<(usize, String)> {
    let mut words = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let mut word = String::new();
        let mut was_lower = false;
        for letter in line.chars().chain([' ']) {
            let ends = !letter.is_ascii_alphabetic() || (was_lower && letter.is_ascii_uppercase());
            if ends && !word.is_empty() {
                words.push((i + 1, std::mem::take(&mut word)));
            }
            if letter.is_ascii_alphabetic() {
                word.push(letter.to_ascii_lowercase());
            }
            was_lower = letter.is_ascii_lowercase();
        }
    }
    words
}

fn complaints(file: &File) -> Vec<String> {
    // The list itself; and what released versions were called.
    if file.path.starts_with("tests/tidy/") {
        return Vec::new();
    }
    let text = if file.path == "CHANGELOG.md" { unreleased(&file.text) } else { &file.text };
    let words = words(text);
    let mut places_of: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (i, (_, word)) in words.iter().enumerate() {
        places_of.entry(word).or_default().push(i);
    }
    let mut complaints = Vec::new();
    for Term { not, but, places } in &TERMS {
        let is_kept = EXCEPTIONS.iter().any(|(path, word, _)| file.path == *path && word == not);
        if is_kept || !(places.is_empty() || file.is_in(places)) {
            continue;
        }
        let phrase: Vec<&str> = not.split(' ').collect();
        for i in phrase.first().and_then(|first| places_of.get(first)).into_iter().flatten() {
            let found = words.iter().skip(*i).take(phrase.len()).map(|(_, word)| word);
            if found.eq(&phrase) {
                let at = words[*i].0;
                complaints
                    .push(format!("{}:{at}: `{not}`: use the field's term: {but}", file.path));
            }
        }
    }
    complaints
}

/// The notes before the first release.
fn unreleased(changelog: &str) -> &str {
    let mut sections = changelog.match_indices("\n## ").map(|(at, _)| at);
    let end = sections.nth(1).unwrap_or(changelog.len());
    changelog.split_at(end).0
}

#[test]
fn names_comments_and_documents_use_the_fields_words() -> io::Result<()> {
    for ending in [".rs", ".md", ".js", ".html", ".css"] {
        let files = files(ending)?;
        assert!(!files.is_empty(), "no file ends in {ending}");
        let complaints: Vec<String> = files.iter().flat_map(complaints).collect();
        assert!(complaints.is_empty(), "\n{}", complaints.join("\n"));
    }
    Ok(())
}

#[test]
fn every_exception_is_needed() -> io::Result<()> {
    for (path, word, reason) in EXCEPTIONS {
        let text = super::document(path)?;
        assert!(words(&text).iter().any(|(_, found)| found == word), "{path}, {word}: {reason}");
    }
    Ok(())
}

#[test]
fn a_word_is_seen_in_every_spelling_and_a_phrase_across_lines() {
    let about = |text: &str| complaints(&File::new("crates/eval/src/x.rs", text)).len();
    for text in ["fn is_valley() {}", "struct WayBack;", "mod way_back;", "// the way\n// back"] {
        assert_eq!(about(text), 1, "{text}");
    }
    for text in ["let shared = 1;", "// foretold, and a subway back home", "// around the corner"] {
        assert_eq!(about(text), 0, "{text}");
    }
    for term in &TERMS {
        let place = term.places.first().copied().unwrap_or("docs/");
        let place = if place.ends_with('/') { format!("{place}x") } else { place.to_owned() };
        assert!(!complaints(&File::new(&place, term.not)).is_empty(), "{}", term.not);
    }
}

/// A further vehicle is a file and a line in two lists: everything else works with whichever model is named.
#[test]
fn a_vehicle_model_is_named_in_three_places() -> io::Result<()> {
    let is_named = |file: &&File| {
        let mut code = file.code().filter(|(_, line)| !line.trim_start().starts_with("//"));
        file.is_in(&["crates/", "python/"])
            && code.any(|(_, line)| line.contains("KinematicPublished"))
    };
    let files = files(".rs")?;
    let named: Vec<&str> = files.iter().filter(is_named).map(|file| file.path.as_str()).collect();
    let expected = [
        "crates/flight/src/cycle/vehicle.rs",
        "crates/model/src/vehicles.rs",
        "crates/model/src/vehicles/kinematic_published.rs",
    ];
    assert_eq!(named, expected);
    Ok(())
}
