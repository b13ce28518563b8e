//! Where tests find the real recordings, and what happens when they are missing.

use std::path::{Path, PathBuf};

/// Path of `file` among the real recordings and reference solutions, if it is there.
///
/// The folder is `TELLO_DATA`, or `../shared/data` beside the project. Where it is missing the test
/// says what it did not check; in CI a missing file is a failure, unless `TELLO_DATA` is `none`.
pub(crate) fn data(file: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("TELLO_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    let path = folder.join(file);
    if path.exists() {
        return Some(path);
    }
    let may_be_missing = std::env::var_os("CI").is_none() || folder == Path::new("none");
    assert!(may_be_missing, "{} is missing in CI; TELLO_DATA=none permits it", path.display());
    eprintln!(
        "NOT CHECKED: {} is missing; set TELLO_DATA to the folder that has it",
        path.display()
    );
    None
}
