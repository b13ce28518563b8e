//! The application: one file per command, live views, and how the crates are wired.
//!
//! Owns what the user sees. The tick ([`tello_flight::cycle`]) is pure; clocks, sockets and files are
//! touched by the commands alone.
#![deny(clippy::print_stdout, clippy::print_stderr)] // they panic on a closed pipe: use `stdio`

mod bench;
mod check;
mod convert;
mod excite;
mod fly;
mod ident;
mod init;
mod install;
mod interrupt;
mod log;
mod merge;
mod mocap;
mod progress;
mod replay;
mod report;
#[cfg(feature = "ros2")]
mod ros2;
mod sim;
mod stdio;
mod tune;

use std::process::ExitCode;

use clap::builder::RangedU64ValueParser;
use clap::{Parser, Subcommand};
use tello_eval::Stopped;

/// Estimate and control a Ryze Tello with motion capture.
#[derive(Debug, Parser)]
#[command(version = tello_eval::VERSION)]
#[command(propagate_version = true, max_term_width = 100, after_help = EXIT_CODES)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

const EXIT_CODES: &str = "Exit codes: 0 done, 1 finished but the check failed (a replay differs, a \
flight did not reach its targets), 2 could not run.";

#[derive(Debug, Subcommand)]
enum Command {
    Fly(fly::Arguments),
    Sim(Box<sim::Arguments>),
    Ident(ident::Arguments),
    Excite(excite::Arguments),
    Replay(replay::Arguments),
    Report(report::Arguments),
    Log(log::Arguments),
    Tune(tune::Arguments),
    Convert(convert::Arguments),
    Check(check::Arguments),
    Guardian(fly::GuardianArguments),
    Bench(bench::Arguments),
    Mocap(mocap::Arguments),
    Merge(merge::Arguments),
    Init(init::Arguments),
    Completions(install::CompletionsArguments),
    Man(install::ManArguments),
}

/// Of `--threads`: as many as the settings of `ident` allow.
fn thread_count() -> RangedU64ValueParser<usize> {
    RangedU64ValueParser::new().range(0..=1024)
}

/// Result of a command that ran to its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Verdict {
    /// Done as asked.
    Good,
    /// Finished, but the check failed.
    Bad,
}

/// Runs the program with the arguments of the process.
pub fn run() -> ExitCode {
    // Reports and settings name files in JSON, which has no other texts.
    if let Some(name) = std::env::args_os().find(|argument| argument.to_str().is_none()) {
        stdio::note(format_args!("error: {} is not UTF-8: choose another name", name.display()));
        return ExitCode::from(2);
    }
    let result = match Arguments::parse().command {
        Command::Fly(arguments) => fly::run(&arguments),
        Command::Sim(arguments) => sim::run(&arguments),
        Command::Ident(arguments) => ident::run(&arguments),
        Command::Excite(arguments) => excite::run(&arguments),
        Command::Replay(arguments) => replay::run(&arguments),
        Command::Log(arguments) => log::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Tune(arguments) => tune::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::Guardian(arguments) => fly::guard(&arguments),
        Command::Bench(arguments) => bench::run(&arguments),
        Command::Mocap(arguments) => mocap::run(&arguments),
        Command::Merge(arguments) => merge::run(&arguments),
        Command::Init(arguments) => init::run(&arguments),
        Command::Completions(arguments) => install::complete(&arguments),
        Command::Man(arguments) => install::man(&arguments),
    };
    match result {
        Ok(Verdict::Good) => ExitCode::SUCCESS,
        Ok(Verdict::Bad) => ExitCode::from(1),
        Err(error) => {
            stdio::note(format_args!("error: {}", stdio::chain(&error)));
            ExitCode::from(if error.is::<Stopped>() { 1 } else { 2 })
        }
    }
}

#[cfg(test)]
mod tests;
