//! Rows of vectors are named, not numbered.

use std::io;

use super::check;
use super::repository::{File, files};

/// Where vectors are indexed by named rows and equations are quoted.
pub(crate) const KERNELS: [&str; 11] = [
    "crates/model/benches/",
    "crates/model/src/",
    "crates/estim/src/",
    "crates/control/src/",
    "crates/flight/src/",
    "crates/cli/src/",
    "crates/io/src/",
    "crates/eval/src/",
    "crates/sim/src/",
    "examples/",
    "python/src/",
];

/// Variables whose index is a place in time, along a path, in a list or in bytes, and no row.
const SEQUENCES: [&str; 25] = [
    "self.s",
    "self.s_candidate",
    "self.o",
    "iterate.s",
    "blocks",
    "after",
    "pair",
    "side",
    "ends",
    "ends_w",
    "second_derivatives_w",
    "nodes",
    "times_s",
    "poses",
    "waypoints",
    "plan",
    "shape",
    "tables",
    "jobs",
    "lines",
    "paths",
    "shades",
    "widths",
    "tick",
    "b",
];

/// Values that a literal index follows in `line`, up to the bracket: `v[0]`, `m[(0, 3)]`.
fn indexed(line: &str) -> impl Iterator<Item = &str> {
    line.match_indices('[').map(|(at, _)| line.split_at(at)).filter_map(|(value, rest)| {
        let is_value = value.ends_with(|c: char| c.is_alphanumeric() || "_)]".contains(c));
        let index = rest.trim_start_matches(['[', '(']);
        let is_literal = index.starts_with(|c: char| c.is_ascii_digit());
        (is_value && is_literal).then_some(value.trim_end_matches("()"))
    })
}

/// Whether `value` ends in the name of one of [`SEQUENCES`].
fn is_sequence(value: &str) -> bool {
    SEQUENCES
        .iter()
        .filter_map(|name| value.strip_suffix(name))
        .any(|before| !before.ends_with(|c: char| c.is_alphanumeric() || c == '_'))
}

/// Literal indices of anything but a sequence.
pub(crate) fn index_complaints(file: &File) -> Vec<String> {
    let unquoted = |line: &str| line.split('"').step_by(2).collect::<Vec<_>>().join(" ");
    file.code()
        .filter(|(_, line)| file.is_in(&KERNELS) && !line.trim_start().starts_with("//"))
        // Examples in a help text name keys.
        .filter(|(_, line)| !line.trim_start().starts_with("tello-ctl "))
        .filter(|(_, line)| !indexed(&unquoted(line)).all(is_sequence))
        .map(|(at, line)| format!("{}:{at}: a row has no name: {}", file.path, line.trim()))
        .collect()
}

#[test]
fn rows_have_names() -> io::Result<()> {
    let kernels: Vec<File> = files(".rs")?.into_iter().filter(|f| f.is_in(&KERNELS)).collect();
    for place in KERNELS {
        assert!(kernels.iter().any(|file| file.is_in(&[place])), "no file is in {place}");
    }
    for name in SEQUENCES {
        let is_used = |file: &File| {
            file.code().any(|(_, line)| indexed(line).any(|value| value.ends_with(name)))
        };
        assert!(kernels.iter().any(is_used), "nothing needs the exception `{name}`");
    }
    check(".rs", index_complaints)
}
