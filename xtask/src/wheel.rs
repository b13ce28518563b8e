//! The Python package as a wheel, tested in an environment of its own.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};

/// Build the Python package as a wheel and test it in a fresh environment.
///
/// The wheel goes to target/wheels. Needs Python 3.9 or newer with venv, and the network.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Do not run the tests of the package.
    #[arg(long)]
    untested: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().context("no workspace")?;
    let tools = environment(&root.join("target/wheel-tools"))?;
    call(Command::new(tools.join("pip")).args(["install", "--quiet", "maturin==1.16.0"]))?;
    let wheels = root.join("target/wheels");
    if wheels.exists() {
        fs::remove_dir_all(&wheels)?;
    }
    call(
        Command::new(tools.join("maturin"))
            .args(["build", "--release", "--locked", "--out"])
            .arg(&wheels)
            .current_dir(root.join("python")),
    )?;
    let wheel = only_file(&wheels)?;
    let bytes = fs::metadata(&wheel)?.len();
    println!("{} ({:.1} MB)", wheel.display(), bytes as f64 / 1e6);
    if arguments.untested {
        return Ok(());
    }
    let fresh = environment(&root.join("target/wheel-test"))?;
    call(Command::new(fresh.join("pip")).args(["install", "--quiet"]).arg(&wheel))?;
    let requirements = root.join("python/tests/requirements.txt");
    call(Command::new(fresh.join("pip")).args(["install", "--quiet", "-r"]).arg(requirements))?;
    // From another folder: the sources of the package must not stand in for the wheel.
    call(
        Command::new(fresh.join("python"))
            .args(["-m", "pytest", "-q", "-p", "no:cacheprovider"])
            .arg(root.join("python/tests"))
            // Needs torch, of which PyPI's takes 3 GB; .ci/run all has another.
            .arg("--ignore")
            .arg(root.join("python/tests/test_learning.py"))
            .current_dir(root.join("target")),
    )
}

/// A fresh virtual environment; where its programs are comes back.
fn environment(path: &Path) -> Result<PathBuf> {
    call(Command::new("python3").args(["-m", "venv", "--clear"]).arg(path))?;
    Ok(path.join("bin"))
}

/// Runs a program to its end.
fn call(command: &mut Command) -> Result<()> {
    let status = command.status().with_context(|| format!("cannot start {command:?}"))?;
    ensure!(status.success(), "{command:?} failed: {status}");
    Ok(())
}

fn only_file(folder: &Path) -> Result<PathBuf> {
    let mut files: Vec<PathBuf> =
        fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<Result<_>>()?;
    match (files.pop(), files.is_empty()) {
        (Some(file), true) => Ok(file),
        _ => bail!("expected one wheel in {}", folder.display()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_has_one_wheel_or_is_refused() {
        let folder = std::env::temp_dir().join(format!("wheel-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        assert!(only_file(&folder).is_err(), "none");
        let wheel = folder.join("tello_ctl.whl");
        fs::write(&wheel, "").unwrap();
        assert_eq!(only_file(&folder).unwrap(), wheel);
        fs::write(folder.join("other.whl"), "").unwrap();
        assert!(only_file(&folder).is_err(), "two");
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_program_that_fails_or_is_missing_is_named() {
        call(&mut Command::new("true")).unwrap();
        for name in ["false", "no-such-program"] {
            let refused = format!("{:#}", call(&mut Command::new(name)).unwrap_err());
            assert!(refused.contains(name), "{refused}");
        }
    }
}
