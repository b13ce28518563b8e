//! The identification of the thesis' pieces, whole programs as seen from outside, beside Ceres.
//!
//! Owns the data, once and in copies, and the runs of both programs. What a program says of its
//! problem is compared with the data, so that none is quick because it read less.

use std::fmt::{self, Write as _};
use std::fs;
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};
use serde_json::Value;
use tello_io::clock::Clock;

use super::comparison::{quantile, sorted};
use super::peer::Peer;
use super::{Bench, Findings};

/// How many times the data are there.
pub(super) const SIZES: [usize; 3] = [1, 4, 16];

/// Sizes and threads that are compared, and whether the peer is slow enough there for one pass to do.
const PROBLEMS: [(usize, usize, bool); 4] =
    [(1, 1, false), (1, 2, false), (4, 1, false), (16, 1, true)];

/// Settings of ours, those of the peer: it has them in its source.
const SETTINGS: &str = "configs/thesis/ident.json";

/// Relative drop of the cost at which the peer ends: its default. Ours is compared at the same.
const TOLERANCE: f64 = 1e-6;

/// Relative drop of the cost at which ours ends for all digits of it.
pub(super) const TOLERANCE_LEAST: f64 = 1e-9;

/// Our time over that of Ceres that was aimed at, for the data as they are.
const GOAL: f64 = 0.05;

/// Logs of one size.
#[derive(Debug)]
pub(super) struct Pieces {
    folder: PathBuf,
    count: usize,
}

/// `tello-ctl ident`.
#[derive(Debug)]
pub(super) struct Ours {
    program: PathBuf,
    settings: PathBuf,
}

/// A run of a program.
#[derive(Debug, Clone, Copy)]
pub(super) struct Run {
    /// From its start to its end. s
    pub(super) seconds: f64,
    /// Steps of the pieces that it read.
    pub(super) steps: u64,
    iterations: u64,
    cost: f64,
}

impl Pieces {
    /// The thesis' pieces, `times` over: copies with names of their own, in a folder of their own.
    ///
    /// # Errors
    /// The recordings are missing, a copy cannot be written.
    pub(super) fn copied(bench: &Bench, times: usize) -> Result<Self> {
        let source = bench.data.join("thesis/pieces");
        let folder = bench.workshop.path(&format!("pieces-{times}x"));
        if folder.exists() {
            fs::remove_dir_all(&folder).with_context(|| folder.display().to_string())?;
        }
        fs::create_dir(&folder).with_context(|| folder.display().to_string())?;
        let mut count = 0;
        for entry in fs::read_dir(&source).with_context(|| source.display().to_string())? {
            let name = entry?.file_name();
            for copy in 0..times {
                let to = folder.join(format!("{copy}-{}", name.display()));
                fs::copy(source.join(&name), &to).with_context(|| to.display().to_string())?;
                count += 1;
            }
        }
        Ok(Self { folder, count })
    }
}

impl Ours {
    /// The program, built, and its settings, which allow as many logs as there are, with this tolerance.
    ///
    /// # Errors
    /// It cannot be built, the settings cannot be read or written.
    pub(super) fn build(bench: &Bench, cost_tolerance: f64) -> Result<Self> {
        let text = fs::read_to_string(SETTINGS).context(SETTINGS)?;
        let mut settings: Value = serde_json::from_str(&text).context(SETTINGS)?;
        settings["logs_max"] = 10_000.into();
        settings["map"]["solver"]["cost_tolerance"] = cost_tolerance.into();
        let name = format!("ident-{cost_tolerance:e}.json");
        let settings = bench.workshop.write(&name, &settings.to_string())?;
        Ok(Self { program: bench.workshop.tello_ctl()?, settings })
    }

    /// Identifies once.
    ///
    /// # Errors
    /// It ends badly, or did not use all of `pieces`.
    pub(super) fn run(&self, pieces: &Pieces, threads: usize) -> Result<Run> {
        let mut command = Command::new(&self.program);
        command.arg("ident").arg(&pieces.folder).arg("--config").arg(&self.settings);
        command.args(["--threads", &threads.to_string(), "--json"]);
        let (seconds, output) = heard(command)?;
        let used = number(&output, "pieces")?;
        ensure!(used == pieces.count as u64, "{used} pieces of {} were used", pieces.count);
        read(seconds, &output, number(&output, "steps")?)
    }
}

/// All comparisons of this part.
///
/// # Errors
/// Missing data, a program that fails, two that do not solve the same problem.
pub(super) fn run(bench: &Bench) -> Result<Findings> {
    let ours = Ours::build(bench, TOLERANCE)?;
    let ours_least = Ours::build(bench, TOLERANCE_LEAST)?;
    let peer = bench.workshop.ceres("ident_ceres")?;
    let mut table =
        "| problem | program | median s | least s | ours / this | goal | iterations | cost | cost gap \
                     |\n|---|---|---|---|---|---|---|---|---|\n"
            .to_owned();
    let mut raw = String::new();
    for (times, threads, is_long) in PROBLEMS {
        let pieces = Pieces::copied(bench, times)?;
        let (mut mine, mut least, mut theirs) = (Vec::new(), Vec::new(), Vec::new());
        for i in 0..bench.repetitions {
            mine.push(ours.run(&pieces, threads)?);
            least.push(ours_least.run(&pieces, threads)?);
            if let Some(peer) = peer.as_ref().filter(|_| i == 0 || !is_long) {
                theirs.push(run_peer(peer, &pieces, threads)?);
            }
        }
        for (ours, peer) in mine.iter().chain(&least).zip(theirs.iter().cycle()) {
            let read = [ours.steps, peer.steps];
            ensure!(read[0] == read[1], "ours and the peer read {read:?} steps");
        }
        let problem = format!("{} pieces ({times}x), threads: {threads}", pieces.count);
        let goal = (times == 1).then_some(GOAL);
        let last_digits = "ours, to the last digits";
        let programs =
            [("ours", None, &mine), (last_digits, None, &least), ("Ceres", goal, &theirs)];
        table.push_str(&rows(&problem, &programs)?);
        for (name, _, runs) in programs {
            for (i, us) in runs.iter().map(|run| run.seconds * 1e6).enumerate() {
                writeln!(raw, "\"{problem}\",\"{name}\",{i},1,{us:.0},{us:.0},{us:.0}")?;
            }
        }
    }
    Ok(Findings { table, raw })
}

/// Lines of the table, ours first, the others with a goal for our time over theirs, if there is one; of a
/// program without a run none.
fn rows(problem: &str, programs: &[(&str, Option<f64>, &Vec<Run>)]) -> Result<String, fmt::Error> {
    let all = || programs.iter().flat_map(|(_, _, runs)| runs.iter());
    let best = all().map(|run| run.cost).fold(f64::INFINITY, f64::min);
    let (mut text, mut ours) = (String::new(), None);
    for (name, goal, runs) in programs {
        let Some(last) = runs.last() else { continue };
        let seconds = sorted(runs.iter().map(|run| run.seconds));
        let [median, least] = [0.5, 0.0].map(|fraction| quantile(&seconds, fraction));
        let (problem, ratio, goal) = match ours {
            None => (problem, String::new(), String::new()),
            Some(ours) => {
                let ratio = ours / median;
                let verdict = |goal| if ratio <= goal { "met" } else { "**missed**" };
                let goal = goal.map(|goal| format!("{goal} {}", verdict(goal)));
                ("", format!("{ratio:.4}"), goal.unwrap_or_default())
            }
        };
        ours = ours.or(Some(median));
        let Run { iterations, cost, .. } = last;
        writeln!(
            text,
            "| {problem} | {name} | {median:.4} | {least:.4} | {ratio} | {goal} | {iterations} \
             | {cost:.6} | {:.1e} |",
            cost / best - 1.0
        )?;
    }
    Ok(text)
}

/// The peer identifies once.
fn run_peer(peer: &Peer, pieces: &Pieces, threads: usize) -> Result<Run> {
    let threads = threads.to_string();
    let mut command = peer.command(&threads);
    command.arg(&pieces.folder).args([&threads, &format!("{TOLERANCE:e}")]);
    let (seconds, output) = heard(command)?;
    // unknowns = 4 (steps + 1): four rows for each state, and four of the parameter.
    read(seconds, &output, number(&output, "unknowns")? / 4 - 1)
}

/// Runs a program to its end: the time that took, in s, and the object that it printed.
fn heard(mut command: Command) -> Result<(f64, Value)> {
    let clock = Clock::start();
    let output = command.output().with_context(|| format!("{command:?}"))?;
    let seconds = clock.now().seconds();
    if !output.status.success() {
        bail!("{command:?}: {}", String::from_utf8_lossy(&output.stderr).trim());
    }
    let output = serde_json::from_slice(&output.stdout).with_context(|| format!("{command:?}"))?;
    Ok((seconds, output))
}

/// Reads the keys that both programs have.
fn read(seconds: f64, output: &Value, steps: u64) -> Result<Run> {
    let cost = output["cost"].as_f64().context("a program that names no cost")?;
    Ok(Run { seconds, steps, iterations: number(output, "iterations")?, cost })
}

fn number(output: &Value, key: &str) -> Result<u64> {
    output[key].as_u64().with_context(|| format!("a program that names no {key}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_medians_are_compared_and_the_best_cost_counts() {
        let run = |seconds, cost| Run { seconds, steps: 10, iterations: 3, cost };
        let ours = vec![run(2.0, 1.0), run(1.0, 1.0), run(9.0, 1.0)];
        let theirs = vec![run(30.0, 1.5), run(10.0, 1.5), run(20.0, 1.5)];
        let text = rows("p", &[("ours", None, &ours), ("Ceres", Some(0.1), &theirs)]).unwrap();
        let expected = [
            "| p | ours | 2.0000 | 1.0000 |  |  | 3 | 1.000000 | 0.0e0 |",
            "|  | Ceres | 20.0000 | 10.0000 | 0.1000 | 0.1 met | 3 | 1.500000 | 5.0e-1 |",
        ];
        assert_eq!(text.lines().collect::<Vec<_>>(), expected);
        let missed = rows("p", &[("ours", None, &ours), ("Ceres", Some(0.09), &theirs)]).unwrap();
        assert!(missed.contains("0.09 **missed**"), "{missed}");
        let alone = rows("p", &[("ours", None, &ours), ("Ceres", Some(0.1), &Vec::new())]).unwrap();
        assert_eq!(alone.lines().count(), 1, "a peer that is not there has no line");
    }
}
