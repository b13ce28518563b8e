//! What is tried before a person is asked to fly: memory, guardian, log and page.
//!
//! Owns refusals that would come after the question else.

use anyhow::{Result, ensure};
use nix::sys::resource::{Resource, getrlimit};
use tello_eval::flight_log;
use tello_io::atomic_file;
use tello_io::config::FlyTable;
use tello_io::log::LogError;
use tello_io::tello::TelloSettings;

use super::log_dir;
use crate::fly::{Arguments, Guardian, view};

/// Least limit of the addresses that this program may use: each thread takes 64 MB, and one in flight must find them.
/// bytes
const ADDRESSES_MIN: u64 = 1_500_000_000;

/// Tries what the flight needs of this machine.
///
/// # Errors
/// The memory is limited; the guardian of a real drone would end with this program; the log exists, or its folder
/// cannot be made or written; the address of the page is taken.
pub(in crate::fly) fn probe(arguments: &Arguments, table: &FlyTable) -> Result<()> {
    let (limit, _) = getrlimit(Resource::RLIMIT_AS)?;
    ensure!(
        limit >= ADDRESSES_MIN,
        "the memory is limited to {} MB of addresses (ulimit -v): a flight needs {} MB",
        limit / 1_000_000,
        ADDRESSES_MIN / 1_000_000
    );
    if !arguments.dry_run {
        let drone = TelloSettings::try_from(&table.tello).map_err(|error| error.under("tello"))?;
        Guardian::probe(drone.address())?;
    }
    let dir = log_dir(arguments, table);
    flight_log::make_folder(dir)?;
    let path = arguments.log.clone().unwrap_or_else(|| dir.join("flight.mcap"));
    if arguments.log.is_some() && atomic_file::is_there(&path) {
        return Err(LogError::Exists { path }.into());
    }
    atomic_file::probe(&path)?;
    arguments.view.map_or(Ok(()), view::probe)
}
