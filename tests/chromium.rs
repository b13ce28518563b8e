//! Where tests find a browser, and what happens when it is missing.

use std::ffi::OsString;
use std::process::Command;

/// A Chromium, if there is one: `TELLO_CHROMIUM`, or the system's.
///
/// Where it is missing the test says what it did not check; in CI that is a failure.
pub(crate) fn find() -> Option<OsString> {
    let chromium = std::env::var_os("TELLO_CHROMIUM").unwrap_or_else(|| "chromium".into());
    if Command::new(&chromium).arg("--version").output().is_ok_and(|output| output.status.success())
    {
        return Some(chromium);
    }
    assert!(std::env::var_os("CI").is_none(), "no Chromium in CI");
    eprintln!("NOT CHECKED: no Chromium; set TELLO_CHROMIUM to one");
    None
}
