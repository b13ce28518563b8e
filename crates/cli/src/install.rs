//! Completions and manual pages: `tello-ctl completions` and `tello-ctl man`.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::{Args, CommandFactory};
use clap_complete::Shell;

use crate::{Verdict, stdio};

/// Print the completions of a shell.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  source <(tello-ctl completions bash)                in this shell
  tello-ctl completions zsh > ~/.zfunc/_tello-ctl
  tello-ctl completions fish > ~/.config/fish/completions/tello-ctl.fish")]
pub(crate) struct CompletionsArguments {
    /// The shell.
    shell: Shell,
}

/// Write the manual pages to a folder.
#[derive(Debug, Args)]
#[command(after_help = "Example:
  tello-ctl man pages && man -l pages/tello-ctl-fly.1")]
pub(crate) struct ManArguments {
    /// The folder; made if it does not exist.
    #[arg(value_name = "DIR")]
    dir: PathBuf,
}

pub(crate) fn complete(arguments: &CompletionsArguments) -> Result<Verdict> {
    let mut script = Vec::new();
    let mut command = crate::Arguments::command();
    clap_complete::generate(arguments.shell, &mut command, "tello-ctl", &mut script);
    stdio::line(String::from_utf8(script)?.trim_end())?;
    Ok(Verdict::Good)
}

pub(crate) fn man(arguments: &ManArguments) -> Result<Verdict> {
    let dir = &arguments.dir;
    fs::create_dir_all(dir).with_context(|| format!("cannot make {}", dir.display()))?;
    let command = crate::Arguments::command().name("tello-ctl");
    clap_mangen::generate_to(command, dir)
        .with_context(|| format!("cannot write manual pages to {}", dir.display()))?;
    let count = fs::read_dir(dir)?.count();
    stdio::line(format_args!("{count} files in {}", dir.display()))?;
    Ok(Verdict::Good)
}
