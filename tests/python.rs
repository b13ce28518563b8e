//! Where tests find a Python with other people's packages, and what happens when it is missing.

use std::ffi::OsString;
use std::process::Command;

/// A Python with `package`, if there is one: `TELLO_PYTHON`, or the system's.
///
/// Where it is missing the test says what it did not check; in CI that is a failure.
pub(crate) fn with(package: &str) -> Option<OsString> {
    let python = std::env::var_os("TELLO_PYTHON").unwrap_or_else(|| "python3".into());
    let imports = Command::new(&python).args(["-c", &format!("import {package}")]).output();
    if imports.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    assert!(std::env::var_os("CI").is_none(), "no Python with the package {package} in CI");
    eprintln!(
        "NOT CHECKED: no Python with the package {package}; set TELLO_PYTHON to one that has it"
    );
    None
}
