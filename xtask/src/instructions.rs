//! `cargo run -p xtask -- instructions`: how many instructions the solvers take, whatever the machine is doing.
//!
//! Owns small fixed runs and the count of each under valgrind. A run is counted at one and at two times
//! its length: the difference leaves out the start of the program. The numbers are kept in
//! `benches/instructions.txt`, for the dev profile without incremental compilation, as CI builds.

mod work;

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;
use std::{env, fs};

use anyhow::{Context, Result, bail, ensure};

use work::Kind;
pub(crate) use work::{Arguments as WorkArguments, run as work};

/// Where the numbers are kept.
const KEPT: &str = "benches/instructions.txt";

/// Growth from which it is a regression.
const TOLERANCE: f64 = 0.05;

/// Count the instructions of the solvers and compare them with those that are kept.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Keep the numbers of this run in place of the old ones.
    #[arg(long)]
    bless: bool,
}

/// Counts and compares, or keeps.
///
/// # Errors
/// No valgrind, or a solver that takes more than it did by more than 5 %.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let (mut text, mut grown) = (String::new(), Vec::new());
    let kept = fs::read_to_string(KEPT).unwrap_or_default();
    for kind in Kind::ALL {
        let name = kind.name();
        let count = count(kind, 2)? - count(kind, 1)?;
        writeln!(text, "{name} {count}")?;
        let growth = growth(&kept, name, count);
        println!("{name}: {count} instructions, {:+.2} % of what is kept", 100.0 * growth);
        if is_regression(growth) {
            grown.push(name);
        }
    }
    if arguments.bless {
        return fs::write(KEPT, text).context(KEPT);
    }
    ensure!(
        grown.is_empty(),
        "{} grew by more than {} %; find out why, or keep the new numbers with --bless",
        grown.join(", "),
        100.0 * TOLERANCE
    );
    Ok(())
}

/// Growth of `count` over the number of `name` in `kept`; NaN without one. 1
fn growth(kept: &str, name: &str, count: i64) -> f64 {
    let before = kept.lines().find_map(|line| line.strip_prefix(name)?.trim().parse().ok());
    before.map_or(f64::NAN, |before: f64| count as f64 / before - 1.0)
}

/// Whether a growth is beyond the tolerance; that without a number to compare with is.
fn is_regression(growth: f64) -> bool {
    // False for NaN.
    let is_within = growth <= TOLERANCE;
    !is_within
}

/// Instructions of a run of `length`, the start of the program included.
fn count(kind: Kind, length: u32) -> Result<i64> {
    let program = env::current_exe().context("where this program lies")?;
    let out = Path::new("/dev/null").display();
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", &format!("--callgrind-out-file={out}")])
        .arg(program)
        .args(["work", kind.name(), &length.to_string()])
        .env("RAYON_NUM_THREADS", "1")
        .output()
        .context("valgrind; apt-get install valgrind")?;
    let stderr = String::from_utf8_lossy(&output.stderr);
    if !output.status.success() {
        bail!("valgrind: {stderr}");
    }
    let collected = stderr.lines().find_map(|line| line.split("Collected :").nth(1));
    collected
        .and_then(|count| count.trim().parse().ok())
        .with_context(|| format!("valgrind: {stderr}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_growth_by_more_than_five_percent_is_a_regression_and_so_is_one_of_nothing() {
        let kept = "mhe 2000\nmpc 1000\n";
        for (name, count, is_expected) in [
            ("mpc", 1049, false),
            ("mpc", 1051, true),
            ("mpc", 500, false),
            ("mhe", 2099, false),
            ("mhe", 2101, true),
            ("ident", 1, true),
        ] {
            let growth = growth(kept, name, count);
            assert_eq!(is_regression(growth), is_expected, "{name} {count}: {growth}");
        }
        assert!((growth(kept, "mpc", 1200) - 0.2).abs() < 1e-12);
    }
}
