//! How tests run the program and read what it says.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

/// A fresh folder for one test; `name` is unique among all tests.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
pub(crate) fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    fs::remove_dir_all(&folder).ok();
    fs::create_dir_all(&folder).unwrap();
    folder
}

/// Output of the program, started in `folder`.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
pub(crate) fn tello_ctl(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_tello-ctl"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

/// All that it printed.
pub(crate) fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

/// The JSON document that it printed.
#[expect(clippy::panic, reason = "a test may panic")]
pub(crate) fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|error| panic!("{error}: {}", text(output)))
}

/// A file of `configs/`.
pub(crate) fn config_file(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs").join(name);
    path.display().to_string()
}
