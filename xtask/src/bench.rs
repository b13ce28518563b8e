//! `cargo xtask bench`: our solvers and their peers on the same problems, in turns, in one run.
//!
//! Owns which parts run and where the results go. A part is a file below: it makes problems, measures
//! and returns its [`Findings`]. Peers that this machine does not have are named and left out.

mod comparison;
mod flight;
mod growth;
mod ident;
mod lagged;
mod machine;
pub(crate) mod mhe;
pub(crate) mod mpc;
mod peer;
mod qp;
mod square;

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::ValueEnum;

use self::peer::Workshop;

/// Time our solvers beside their peers.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Folder for the table and the times of every pass.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Only this part, may be repeated.
    #[arg(long)]
    only: Vec<Part>,
    /// Passes of each program over each problem.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    repetitions: u32,
    /// Folder of the recordings and reference solutions.
    #[arg(long, default_value = "../shared/data")]
    data: PathBuf,
}

/// A part of the suite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Part {
    /// Moving horizon estimator.
    Mhe,
    /// Model predictive controller.
    Mpc,
    /// Both, of the vehicle that flies by default.
    Lagged,
    /// One quadratic subproblem of the controller.
    Qp,
    /// The whole tick, its log, flights in virtual time.
    Flight,
    /// The identification of the thesis' pieces, whole programs.
    Ident,
    /// Time of estimator, controller and identification over their sizes.
    Growth,
}

/// Context that is common to the parts.
#[derive(Debug)]
struct Bench {
    data: PathBuf,
    repetitions: u32,
    workshop: Workshop,
}

/// Result of a part: a table in markdown, and lines of the raw file.
#[derive(Debug)]
struct Findings {
    table: String,
    raw: String,
}

/// Measures, prints the table and writes it with the raw times.
///
/// # Errors
/// Missing data, a peer that fails, a folder that cannot be written.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let bench = Bench {
        data: arguments.data.clone(),
        repetitions: arguments.repetitions,
        workshop: Workshop::open()?,
    };
    if let Some(out) = &arguments.out {
        fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    }
    let mut report = machine::description()?;
    writeln!(report, "Passes: {}, in turns.", bench.repetitions)?;
    println!("{report}");
    let mut raw = comparison::RAW_HEAD.to_owned();
    for part in Part::value_variants() {
        if !arguments.only.is_empty() && !arguments.only.contains(part) {
            continue;
        }
        let found = match part {
            Part::Mhe => mhe::run(&bench)?,
            Part::Mpc => mpc::run(&bench)?,
            Part::Lagged => lagged::run(&bench)?,
            Part::Qp => qp::run(&bench)?,
            Part::Flight => flight::run(&bench)?,
            Part::Ident => ident::run(&bench)?,
            Part::Growth => growth::run(&bench)?,
        };
        println!("{}", found.table);
        writeln!(report, "\n{}", found.table)?;
        raw.push_str(&found.raw);
    }
    writeln!(report, "Load average at the end: {}", machine::load()?)?;
    if let Some(out) = &arguments.out {
        for (name, text) in [("table.txt", &report), ("passes.csv", &raw)] {
            let path = out.join(name);
            fs::write(&path, text).with_context(|| path.display().to_string())?;
        }
    }
    Ok(())
}
