//! Pictures of the documentation, made by the program and a browser.

mod browser;

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, ensure};

use browser::{Browser, View};

/// Largest picture. bytes
const BYTES_MAX: u64 = 150_000;

/// A desktop's window, low enough for a small picture.
const DESKTOP: View = View { width: 1280, height: 690, is_dark: false };

/// Scrolls a report to the figures over time of its first flight.
const TO_FIGURES: &str = "document.querySelector('figure[id$=\"state\"]').scrollIntoView()";

/// How long the live page watches the flight before its picture is taken. s
const LIVE_S: u64 = 13;

/// Draw the pictures of the documentation anew: docs/pictures.
///
/// Needs Chromium (`TELLO_CHROMIUM` or the system's). Builds the release program unless one is given; takes half a
/// minute beside.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Take pictures of this program instead of building one.
    #[arg(long, value_name = "FILE")]
    binary: Option<PathBuf>,
    /// The folder of the pictures.
    #[arg(long, value_name = "DIR", default_value = "docs/pictures")]
    out: PathBuf,
    /// Also draw pages in dark and on a phone, to look at: target/pictures.
    #[arg(long)]
    all: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().context("no workspace")?;
    let binary = match &arguments.binary {
        Some(binary) => binary.canonicalize()?,
        None => crate::package::build(root)?,
    };
    let out = root.join(&arguments.out);
    fs::create_dir_all(&out)?;
    let scratch = root.join("target/pictures");
    if scratch.exists() {
        fs::remove_dir_all(&scratch)?;
    }
    fs::create_dir_all(&scratch)?;
    let program = Program { binary, folder: scratch };

    program.run(&["init", "lab", "--room=-2,2,-3,1,2.5"])?;
    program.run(&["check", "lab/square.json", "--config", "lab/fly.json", "--figure", "square"])?;
    fs::copy(program.folder.join("square.svg"), out.join("square.svg"))?;
    program.run(&["sim", "--seed", "7", "--profile", "outages", "--log", "flight.mcap"])?;
    program.run(&["report", "flight.mcap"])?;
    let mut views = vec![(DESKTOP, String::new())];
    if arguments.all {
        let phone = View { width: 390, height: 844, is_dark: false };
        views.push((View { is_dark: true, ..DESKTOP }, "-dark".into()));
        views.push((phone, "-phone".into()));
        views.push((View { is_dark: true, ..phone }, "-phone-dark".into()));
    }
    for (view, name) in &views {
        let folder = if name.is_empty() { &out } else { &program.folder };
        let mut browser = Browser::start(&program.folder)?;
        let page = format!("file://{}#t=6", program.folder.join("report.html").display());
        let page = browser.open(&page, *view)?;
        thread::sleep(Duration::from_secs(1));
        browser.picture(&page, &folder.join(format!("report{name}.png")))?;
        browser.evaluate(&page, TO_FIGURES)?;
        browser.picture(&page, &folder.join(format!("report_figures{name}.png")))?;
        program.live(&mut browser, *view, &folder.join(format!("live{name}.png")))?;
    }
    for entry in fs::read_dir(&out)? {
        let path = entry?.path();
        let bytes = fs::metadata(&path)?.len();
        println!("{} {:.0} kB", path.display(), bytes as f64 / 1e3);
        ensure!(bytes <= BYTES_MAX, "{} is larger than {BYTES_MAX} bytes", path.display());
    }
    Ok(())
}

/// The program, in a folder for its files.
struct Program {
    binary: PathBuf,
    folder: PathBuf,
}

impl Program {
    /// Runs a command to its end.
    fn run(&self, arguments: &[&str]) -> Result<()> {
        let mut command = Command::new(&self.binary);
        crate::package::output(command.args(arguments).current_dir(&self.folder))?;
        Ok(())
    }

    /// A picture of the live page of a simulated flight.
    fn live(&self, browser: &mut Browser, view: View, to: &Path) -> Result<()> {
        let log = self.folder.join("live.mcap");
        if log.exists() {
            fs::remove_file(log)?;
        }
        let mut flight = Command::new(&self.binary)
            .args(["fly", "--sim", "--no-keys", "--view", "--log", "live.mcap"])
            .current_dir(&self.folder)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()?;
        let stderr = flight.stderr.take().context("no standard error")?;
        let mut lines = BufReader::new(stderr).lines().map_while(Result::ok);
        let address = lines.find_map(|line| Some(line.split_once("view ")?.1.trim().to_owned()));
        let reader = thread::spawn(move || lines.for_each(drop));
        let page = browser.open(&address.context("the flight has no page")?, view)?;
        thread::sleep(Duration::from_secs(LIVE_S));
        browser.picture(&page, to)?;
        let ended = flight.wait()?;
        ensure!(ended.success(), "the flight failed: {ended}");
        ensure!(reader.join().is_ok(), "the flight's messages could not be read");
        Ok(())
    }
}
