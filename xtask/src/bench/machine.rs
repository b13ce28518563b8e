//! On what machine, with what revision and under what load a run was measured.

use std::fmt::Write as _;
use std::fs;
use std::process::Command;

use anyhow::{Context, Result};

/// Processor, cores, load, revision and compilers, a line each.
pub(super) fn description() -> Result<String> {
    let cpuinfo = fs::read_to_string("/proc/cpuinfo").context("/proc/cpuinfo")?;
    let model = cpuinfo.lines().find_map(|line| line.strip_prefix("model name"));
    let model = model.map_or("unknown", |model| model.trim_start_matches([' ', '\t', ':']));
    let cores = cpuinfo.lines().filter(|line| line.starts_with("processor")).count();
    let mut text = String::new();
    writeln!(text, "Processor: {model}, {cores} cores. Load average: {}.", load()?)?;
    writeln!(text, "Revision: {}.", first_line("git", &["describe", "--always", "--dirty"]))?;
    writeln!(
        text,
        "Compilers: {}; {}.",
        first_line("rustc", &["--version"]),
        first_line("g++", &["--version"])
    )?;
    Ok(text)
}

/// Load averages over 1, 5 and 15 minutes.
pub(super) fn load() -> Result<String> {
    let text = fs::read_to_string("/proc/loadavg").context("/proc/loadavg")?;
    Ok(text.split_whitespace().take(3).collect::<Vec<_>>().join(" "))
}

fn first_line(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).output();
    let text = output.map_or_else(
        |_| String::new(),
        |output| String::from_utf8_lossy(&output.stdout).into_owned(),
    );
    text.lines().next().map_or_else(|| format!("no {program}"), str::to_owned)
}
