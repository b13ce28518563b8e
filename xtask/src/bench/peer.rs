//! Programs of others: built from `benches/peers/`, with problems in a text file and results as text.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

use anyhow::{Context, Result, bail, ensure};

use super::comparison::Solve;

/// Where peers are built and their problems written: `peers` in the target folder.
#[derive(Debug)]
pub(super) struct Workshop {
    folder: PathBuf,
}

/// A peer that is ready to run.
#[derive(Debug, Clone)]
pub(super) struct Peer {
    program: PathBuf,
    /// The script, where the program runs scripts.
    script: Option<PathBuf>,
}

/// Packages that the scripts of the peers import, as Python's package index names them.
const PACKAGES: [&str; 6] =
    ["numpy==2.2.6", "scipy==1.15.3", "osqp==1.0.4", "piqp==0.6.2", "daqp==0.7.2", "casadi==3.7.2"];

impl Workshop {
    /// The folder, made if it is missing.
    ///
    /// # Errors
    /// It cannot be made.
    pub(super) fn open() -> Result<Self> {
        let program = env::current_exe().context("where this program lies")?;
        let target = program.ancestors().nth(2).context("this program lies in no target folder")?;
        let folder = target.join("peers");
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        Ok(Self { folder })
    }

    /// Where a file of this name lies.
    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Writes a file of problems.
    ///
    /// # Errors
    /// It cannot be written.
    pub(super) fn write(&self, name: &str, text: &str) -> Result<PathBuf> {
        let path = self.path(name);
        fs::write(&path, text).with_context(|| path.display().to_string())?;
        Ok(path)
    }

    /// Builds the release of `tello-ctl`, beside this folder.
    ///
    /// # Errors
    /// Cargo refuses it.
    pub(super) fn tello_ctl(&self) -> Result<PathBuf> {
        let target = self.folder.parent().context("a folder for peers in no other")?;
        let status = Command::new("cargo")
            .args(["build", "--release", "--locked", "--quiet", "--package", "tello-ctl"])
            .arg("--target-dir")
            .arg(target)
            .status()
            .context("cargo")?;
        ensure!(status.success(), "cargo does not build tello-ctl");
        Ok(target.join("release/tello-ctl"))
    }

    /// Builds `benches/peers/NAME.cpp` with Ceres. `None`, with a line that says so, without Ceres.
    ///
    /// # Errors
    /// The compiler refuses it.
    pub(super) fn ceres(&self, name: &str) -> Result<Option<Peer>> {
        let headers = ["/usr/include/ceres/ceres.h", "/usr/include/glog/logging.h"];
        if !headers.iter().all(|header| Path::new(header).exists()) {
            eprintln!(
                "NOT MEASURED: no Ceres; apt-get install g++ libceres-dev libgoogle-glog-dev"
            );
            return Ok(None);
        }
        let program = self.folder.join(name);
        let status = Command::new("g++")
            .args(["-std=c++17", "-O3", "-march=native", "-DNDEBUG"])
            .args(["-isystem", "/usr/include/eigen3", "-o"])
            .arg(&program)
            .arg(format!("benches/peers/{name}.cpp"))
            .args(["-lceres", "-lglog"])
            .status()
            .context("g++")?;
        ensure!(status.success(), "g++ refuses benches/peers/{name}.cpp");
        Ok(Some(Peer { program, script: None }))
    }

    /// Readies `benches/peers/NAME.py` and what it imports. `None`, with a line that says so, without.
    ///
    /// # Errors
    /// The script is missing.
    pub(super) fn python(&self, name: &str) -> Result<Option<Peer>> {
        let venv = self.folder.join("venv");
        let program = venv.join("bin/python");
        let does = |command: &mut Command| command.output().is_ok_and(|out| out.status.success());
        let imports = ["-c", "import casadi, daqp, numpy, osqp, piqp, scipy"];
        let is_ready = does(Command::new(&program).args(imports))
            || does(Command::new("python3").args(["-m", "venv"]).arg(&venv))
                && does(Command::new(&program).args(["-m", "pip", "install"]).args(PACKAGES));
        if !is_ready {
            eprintln!("NOT MEASURED: no Python with venv and {}", PACKAGES.join(", "));
            return Ok(None);
        }
        let script = fs::canonicalize(format!("benches/peers/{name}.py")).context("the script")?;
        Ok(Some(Peer { program, script: Some(script) }))
    }
}

/// Answer of a peer to one problem: time, iterations and cost, then the solution if it gives one.
#[derive(Debug)]
pub(super) struct Answer {
    pub(super) solve: Solve,
    pub(super) solution: Vec<f64>,
}

impl Peer {
    /// The peer without arguments, its libraries held to this many threads.
    pub(super) fn command(&self, threads: &str) -> Command {
        let mut command = Command::new(&self.program);
        command.args(&self.script);
        command.envs(["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"].map(|name| (name, threads)));
        command
    }

    /// Runs the peer, on one core.
    ///
    /// # Errors
    /// It ends badly or says what nobody understands.
    pub(super) fn run(&self, file: &Path, arguments: &[&str]) -> Result<Vec<Answer>> {
        let output = self
            .command("1")
            .arg(file)
            .args(arguments)
            .output()
            .with_context(|| self.program.display().to_string())?;
        if !output.status.success() {
            bail!("{}: {}", self.program.display(), String::from_utf8_lossy(&output.stderr).trim());
        }
        String::from_utf8_lossy(&output.stdout).lines().map(answer).collect()
    }
}

fn answer(line: &str) -> Result<Answer> {
    let values: Result<Vec<f64>, _> = line.split_whitespace().map(str::parse).collect();
    let values = values.with_context(|| format!("a peer printed `{line}`"))?;
    let [ns, iterations, cost, ref solution @ ..] = *values.as_slice() else {
        bail!("a peer printed `{line}`");
    };
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a count below a few hundred; the cast saturates"
    )]
    let iterations = iterations as u32;
    let solve = Solve { us: ns * 1e-3, iterations, cost, kkt: f64::NAN };
    Ok(Answer { solve, solution: solution.to_vec() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_time_iterations_cost_and_solution_and_else_is_quoted() {
        for (line, solution) in [("2500 7 0.5", &[][..]), (" 2.5e3  7\t5e-1 1 -2.5 ", &[1.0, -2.5])]
        {
            let Answer { solve, solution: found } = answer(line).unwrap();
            assert_eq!((solve.iterations, found.as_slice()), (7, solution), "{line}");
            assert!(
                (solve.us - 2.5).abs() < 1e-12 && (solve.cost - 0.5).abs() < 1e-12,
                "{solve:?}"
            );
            assert!(solve.kkt.is_nan());
        }
        for line in ["", "2500 7", "2500 seven 0.5", "Segmentation fault"] {
            let refused = format!("{:#}", answer(line).unwrap_err());
            assert!(refused.starts_with(&format!("a peer printed `{line}`")), "{refused}");
        }
    }
}
