//! The folder of the log and the free space of its disk.

use std::path::Path;

use tello_io::config::FlyTable;

use super::{Check, Found, Readiness, check};
use crate::fly::Arguments;

/// Free space that a log needs: a flight of a quarter of an hour takes less. bytes
pub(super) const LOG_BYTES: u64 = 200_000_000;

/// Folder of the log.
pub(super) fn log_dir<'a>(arguments: &'a Arguments, table: &'a FlyTable) -> &'a Path {
    match arguments.log.as_deref().and_then(Path::parent) {
        None => &table.log.dir,
        Some(here) if here == Path::new("") => Path::new("."),
        Some(folder) => folder,
    }
}

pub(super) fn log_check(found: &Found) -> Check {
    let folder = found.log_dir.display();
    let Some(free) = found.disk_free else {
        let reason = format!("{folder}: the system does not report how much is free");
        return check("log", Readiness::Note, reason);
    };
    let reason = format!("{folder}: {} MB free", free / 1_000_000);
    if free < LOG_BYTES {
        check("log", Readiness::Note, reason + ", which a long flight may fill")
    } else {
        check("log", Readiness::Good, reason)
    }
}
