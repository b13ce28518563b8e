//! Bakes the git revision into the program, so that every log can name it. `TELLO_CTL_REVISION` in the environment
//! is used instead where it is set: for a build without git, or one that a commit is not to start anew.

use std::process::Command;

/// The first line that git prints, if it runs and succeeds.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

#[expect(clippy::disallowed_methods, reason = "a build has no file of settings")]
fn main() {
    println!("cargo::rerun-if-env-changed=TELLO_CTL_REVISION");
    let revision = std::env::var("TELLO_CTL_REVISION").unwrap_or_else(|_| {
        // In a work tree of its own, these do not lie in the folder .git.
        for path in ["HEAD", "refs/heads"] {
            if let Some(path) = git(&["rev-parse", "--git-path", path]) {
                println!("cargo::rerun-if-changed={path}");
            }
        }
        git(&["describe", "--always", "--dirty"]).unwrap_or_else(|| "unknown".to_owned())
    });
    println!("cargo::rustc-env=TELLO_CTL_REVISION={revision}");
}
