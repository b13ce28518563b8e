//! `tello-ctl bench`: assumptions about the real drone that were not verified, one check after the other.
//!
//! Owns the dialogue and the report. Packets and their record are `bench/connection.rs`, the checks
//! `tello_eval::bench`. There is no controller here: each packet of a check is written in its table.

mod connection;
mod console;
mod guard;

use std::fs::{self, File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;
use serde_json::{Value, json};
use tello_eval::REVISION;
use tello_eval::bench::checks::{Check, checks};
use tello_eval::bench::evidence;
use tello_io::config;
use tello_io::tello::{Protocol, TelloSettings, TelloTable};
use tello_sim::{Emulator, MocapAddresses, Profile, SdkVersion, World};

use self::connection::{Armed, BenchConnection};
use self::console::Console;
use crate::fly::Lock;
use crate::{Verdict, sim, stdio};

/// Layout of the report's lines.
const FORMAT: &str = "tello-ctl bench 1";

/// Verify on your drone what this program assumes of it.
///
/// Each check prints what to do, waits for Enter, sends its packets, writes down every packet and status with
/// its time, asks what only eyes can see, and appends one line to the report. A check that runs the motors starts
/// when you type YES, and ends with LAND and, if need be, with the emergency stop; a guardian process lands if the
/// bench dies. While it runs, Enter or Ctrl-C ends it.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  tello-ctl bench --list                        what each check does
  tello-ctl bench status sequence               two checks
  tello-ctl bench 8 --protocol text             the eighth check in the text SDK; restart the drone before

How to do all of them in half an hour: docs/bench-test.md. Exit codes: 0 done, 1 stopped, or the drone did not report \
that it is down, 2 could not run.")]
pub(crate) struct Arguments {
    /// Names or numbers of checks.
    #[arg(value_name = "CHECK", required_unless_present = "list")]
    checks: Vec<String>,
    /// Print the checks with what to do, what is sent and what is expected.
    #[arg(long)]
    list: bool,
    /// Settings of a flight, of which `tello` is used [default: the built-in configs/fly.json].
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// How to talk to the drone, in place of the settings' `tello.protocol`: `binary` or `text`. A drone
    /// keeps the one that it hears first until it is switched off.
    #[arg(long, value_name = "PROTOCOL")]
    protocol: Option<Protocol>,
    /// Append the results to this file, one JSON object a line.
    #[arg(long, value_name = "FILE", default_value = "bench-report.json")]
    report: PathBuf,
    /// Check the built-in simulator, started anew for each check.
    #[arg(long)]
    sim: bool,
    /// Settings of the simulator [default: the built-in configs/sim.json].
    #[arg(long, value_name = "FILE", requires = "sim")]
    sim_config: Option<PathBuf>,
    /// Ask nothing. The motors start at once.
    #[arg(long)]
    yes: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    let all = checks()?;
    if arguments.list {
        for (number, check) in (1..).zip(&all) {
            stdio::line(described(number, check))?;
        }
        return Ok(Verdict::Good);
    }
    let names = arguments.checks.iter();
    let checks = names.map(|name| find(&all, name)).collect::<Result<Vec<_>>>()?;
    let (fly, _) = config::fly(arguments.config.as_deref(), None)?;
    let mut table = fly.tello;
    table.protocol = arguments.protocol.unwrap_or(table.protocol);
    let is_refused = |(_, check): &&(usize, &Check)| match table.protocol {
        Protocol::Binary => false,
        Protocol::Text => check.is_binary_only(),
    };
    if let Some((_, check)) = checks.iter().find(is_refused) {
        bail!(
            "{} is a check of the binary protocol: switch the drone off and on, then run it with \
             --protocol binary",
            check.name
        );
    }
    probe(&arguments.report)?;
    let console = Console::open(arguments.yes)?;
    for (number, check) in checks {
        // A drone of its own for each check, as if it had been switched off and on.
        let emulator = arguments.sim.then(|| simulate(arguments, &mut table)).transpose()?;
        let settings = TelloSettings::try_from(&table).map_err(|error| error.under("tello"))?;
        let _lock = Lock::drone(&table)?;
        let mut link = BenchConnection::bind(&settings, check.site)?;
        stdio::note(described(number, check));
        let verdict = run_check(check, &mut link, &console, &table, &arguments.report)?;
        drop(emulator);
        if verdict == Verdict::Bad {
            return Ok(verdict);
        }
    }
    Ok(Verdict::Good)
}

/// A check by its name or number, with its number.
fn find<'a>(all: &'a [Check], name: &str) -> Result<(usize, &'a Check)> {
    let by_number = name.parse().ok();
    (1..)
        .zip(all)
        .find(|(number, check)| Some(*number) == by_number || check.name == name)
        .with_context(|| format!("no check {name:?}: `tello-ctl bench --list` shows them"))
}

fn described(number: usize, check: &Check) -> String {
    let steps: Vec<String> = check.steps.iter().map(ToString::to_string).collect();
    let Check { name, site, assumption, todo, question, .. } = check;
    let asked = |question| format!("\n    asked     {question}");
    let question = question.as_ref().map_or_else(String::new, asked);
    format!(
        "{number:>2}  {name} ({site})\n    to do     {todo}\n    sent      {}\n    expected  {assumption}{question}",
        steps.join("; ")
    )
}

/// Asks the person, and refuses to start if the drone or the guardian is not as it must be.
fn is_confirmed(
    check: &Check,
    link: &mut BenchConnection,
    console: &Console,
    address: &str,
) -> Result<bool> {
    // Enter typed too early would end the connection.
    console.forget_lines();
    let Ok(found) = link.connect(console) else { return unconfirmed(link) };
    if found.is_none() {
        bail!(
            "no status from {address}: is this computer in the drone's Wi-Fi, and no other program connected?"
        );
    }
    let go = if check.site.spins() { "YES" } else { "" };
    let question = match go {
        "" => "Enter starts, anything else leaves.".into(),
        _ => format!("The motors will start ({}). YES starts, anything else leaves.", check.site),
    };
    if !console.is_unattended() && console.ask(&question, link).as_deref() != Some(go) {
        return Ok(false);
    }
    // The question may have stood there for long.
    let Ok(found) = link.connect(console) else { return unconfirmed(link) };
    let Some(status) = found else {
        bail!("the drone sends no status any more: is it still switched on and its Wi-Fi joined?");
    };
    if check.site.spins() && status.is_running {
        bail!("the drone reports that it flies, or that its motors run: land it, then begin anew");
    }
    Ok(true)
}

/// No confirmation, since the person has stopped the connection; an error if it ended for the guardian.
fn unconfirmed(link: &BenchConnection) -> Result<bool> {
    if link.has_lost_guardian() {
        bail!("the process tello-guardian was ended or stopped: no motor starts without it");
    }
    Ok(false)
}

/// Does one check. Good if it was done to its end, and the drone reports that it is down.
fn run_check(
    check: &Check,
    link: &mut BenchConnection,
    console: &Console,
    table: &TelloTable,
    report: &Path,
) -> Result<Verdict> {
    if !is_confirmed(check, link, console, &table.address)? {
        stdio::note("not started");
        return Ok(Verdict::Bad);
    }
    stdio::note("running; Enter or Ctrl-C ends it");
    console.forget_lines();
    link.begin();
    let is_whole = Armed::new(link, check.site, console).run(&check.steps).is_ok();
    if link.has_lost_guardian() {
        stdio::note("the guardian has ordered a landing or is lost: the check was ended");
    }
    let seen = evidence::seen(check, is_whole, link.events(), link.ending);
    let record = json!({
        "format": FORMAT,
        "revision": REVISION,
        "check": check.name,
        "assumption": check.assumption,
        "protocol": table.protocol,
        "address": table.address,
        "firmware": link.version(),
        "began_utc_ns": link.began_utc_ns(),
        "is_stopped": !is_whole,
        "seen": seen,
        "events": link.events(),
    });
    // Before anything is printed or asked: a terminal that was closed, or is then, loses nothing.
    let appended = append(report, &record);
    for line in evidence::lines(&seen) {
        // What cannot be printed is in the report; the last line makes it an error.
        stdio::line(line).ok();
    }
    make_sure(check, link, console);
    appended?;
    if !console.is_unattended() {
        append(report, &answers(check, link, console))?;
    }
    stdio::line(format_args!("{} is in {}\n", check.name, report.display()))?;
    let is_down = link.ending.is_none_or(|ending| ending.is_down);
    Ok(if is_whole && is_down { Verdict::Good } else { Verdict::Bad })
}

/// Repeats the end of the check until the person confirms that the drone is down.
fn make_sure(check: &Check, link: &mut BenchConnection, console: &Console) {
    if !check.site.spins() {
        return;
    }
    if link.ending.is_none_or(|ending| !ending.is_down) {
        stdio::note(
            "THE DRONE DID NOT CONFIRM THAT IT IS DOWN. Keep away from it; it lands when its battery is empty.",
        );
    }
    console.forget_lines();
    let question =
        "Is it down with standing motors? y: yes; anything else lands or stops it again.";
    while let Some(answer) = console.ask(question, link) {
        if answer.eq_ignore_ascii_case("y") {
            return;
        }
        link.end(check.site, console);
    }
}

/// What the person saw, as a line of its own behind the record: yes, no, or null for "not sure".
fn answers(check: &Check, link: &mut BenchConnection, console: &Console) -> Value {
    let asked = check.question.as_ref().and_then(|question| {
        console.ask(&format!("{question} y, n, or Enter if you are not sure."), link)
    });
    let answer = match asked.as_deref() {
        Some("y" | "Y") => Some(true),
        Some("n" | "N") => Some(false),
        _ => None,
    };
    let remark = console.ask("Anything else to report? One line, or Enter.", link);
    json!({ "format": FORMAT, "answers_to": check.name, "question": check.question, "answer": answer, "remark": remark })
}

/// Appends one line, which is on the disk when this returns.
fn append(path: &Path, record: &Value) -> Result<()> {
    let mut file = open(path)?;
    file.write_all(format!("{record}\n").as_bytes())
        .and_then(|()| file.sync_all())
        .with_context(|| format!("cannot append to {}", path.display()))
}

/// Tries to open the report before a motor runs: what a check has shown would be lost. Leaves no empty one behind.
fn probe(path: &Path) -> Result<()> {
    let is_there = path.exists();
    open(path)?;
    if !is_there {
        // A link to a file that was not there is the user's: it stays.
        fs::canonicalize(path)
            .and_then(fs::remove_file)
            .with_context(|| format!("cannot remove {}", path.display()))?;
    }
    Ok(())
}

/// The report, made if it does not exist, to append to.
fn open(path: &Path) -> Result<File> {
    let file = OpenOptions::new().create(true).append(true).open(path);
    file.with_context(|| format!("cannot append to {}", path.display()))
}

/// Starts the simulator with a drone on its floor, and points the settings at it.
fn simulate(arguments: &Arguments, table: &mut TelloTable) -> Result<Emulator> {
    let mut sim = sim::resolve(arguments.sim_config.as_ref(), Some(Profile::Clean))?;
    // An older SDK sends its state line to port 8890 alone; here it shall come to any that is free.
    sim.drone.sdk = SdkVersion::V3_0;
    let any_port = ([127, 0, 0, 1], 0).into();
    let emulator = Emulator::start(World::new(&sim, 1)?, any_port, MocapAddresses::default())?;
    table.address = emulator.drone_address().to_string();
    table.interface = None;
    (table.local_port, table.state_port) = (0, 0);
    Ok(emulator)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_that_is_tried_leaves_nothing_and_a_link_of_the_user_stays() {
        let folder = std::env::temp_dir().join(format!("tello-bench-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let (link, report) = (folder.join("link"), folder.join("report.json"));
        std::os::unix::fs::symlink(&report, &link).unwrap();
        for path in [&link, &report] {
            probe(path).unwrap();
            assert!(fs::symlink_metadata(&link).is_ok() && !report.exists(), "{}", path.display());
        }
        fs::write(&report, "before").unwrap();
        probe(&link).unwrap();
        assert_eq!(fs::read_to_string(&link).unwrap(), "before");
        fs::remove_dir_all(folder).unwrap();
    }
}
