//! `tello-ctl mocap`: what a motion capture system sends, before anything flies by it.

mod list;
mod rate;
#[cfg(feature = "ros2")]
mod ros2;
mod source;
mod watch;

use anyhow::Result;
use clap::{Args, Subcommand};

pub(crate) use self::source::usual_address;

use crate::{Verdict, interrupt};

/// Look at a motion capture system: which objects it has and how well their poses come, or where one of them is.
///
/// The first commands of a new laboratory, before anything flies:
///
///   tello-ctl mocap list 192.168.1.5
///   tello-ctl mocap watch --source natnet=192.168.1.5:1510 --object tello
///
/// Both print what to write into the settings.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    List(list::Arguments),
    #[cfg(feature = "ros2")]
    Ros2(ros2::Arguments),
    Watch(watch::Arguments),
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    let runtime = interrupt::runtime()?;
    let verdict = match &arguments.command {
        Command::List(arguments) => runtime.block_on(list::run(arguments)),
        #[cfg(feature = "ros2")]
        Command::Ros2(arguments) => runtime.block_on(ros2::run(arguments)),
        Command::Watch(arguments) => runtime.block_on(watch::run(arguments)),
    };
    // Without waiting for the address of a host that is not found.
    runtime.shutdown_background();
    verdict
}
