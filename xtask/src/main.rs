//! Tasks around the project that are no part of the program: `cargo xtask TASK`.

mod advisories;
mod bench;
mod instructions;
mod package;
mod wheel;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Tasks around the project.
#[derive(Debug, Parser)]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

#[derive(Debug, Subcommand)]
enum Task {
    Advisories(advisories::Arguments),
    Bench(bench::Arguments),
    Instructions(instructions::Arguments),
    Package(package::Arguments),
    Wheel(wheel::Arguments),
    #[command(hide = true)]
    Work(instructions::WorkArguments),
}

fn main() -> ExitCode {
    let result = match Arguments::parse().task {
        Task::Advisories(arguments) => advisories::run(&arguments),
        Task::Bench(arguments) => bench::run(&arguments),
        Task::Instructions(arguments) => instructions::run(&arguments),
        Task::Package(arguments) => package::run(&arguments),
        Task::Wheel(arguments) => wheel::run(&arguments),
        Task::Work(arguments) => instructions::work(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}
