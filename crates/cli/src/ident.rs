//! `tello-ctl ident`: from flight logs to a parameter file, with its uncertainty and its pictures.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::{Context, Result, bail};
use clap::Args;
use tello_eval::REVISION;
use tello_eval::ident::{
    self, Bootstrap, BootstrapPlan, Comparison, FileUsed, FitResult, IdentFileTable, IdentReport,
    Job, Observer,
};
use tello_eval::part_file::PartNumber;
use tello_eval::recordings::{FileSkipped, Loaded};
use tello_io::clock::Clock;
use tello_io::config;
use tello_sim::self_test;

use crate::interrupt::Interrupt;
use crate::progress::Shown;
use crate::{Verdict, stdio};

/// Identify a vehicle model from flight logs.
///
/// Reads thesis CSV logs and logs of this program (MCAP), files or folders of them. Writes the
/// parameter file that fly, sim and replay take with --params, the estimated states and figures (SVG
/// and PNG) to the folder --out. Logs that cannot be used are named and left out.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  tello-ctl ident logs/                               the lagged model, dead times searched
  tello-ctl ident logs/ --bootstrap 300               with uncertainty by resampling
  tello-ctl ident logs/ --bootstrap 300 --shard 2/8   one of eight parts, on any machine
  tello-ctl ident logs/ --bootstrap 300 --resume ident/*.part   all parts together
  tello-ctl ident logs/ --compare                     which model predicts best
  tello-ctl ident --self-test                         simulated flights with known truth

Exit codes: 0 done, 1 the self-test failed, the solver did not converge, fly would refuse the parameters or
Ctrl-C came first, 2 could not run.")]
#[expect(clippy::struct_excessive_bools, reason = "flags of the command line")]
pub(crate) struct Arguments {
    /// Flight logs (CSV, MCAP) or folders of them [default: those of the settings].
    #[arg(value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// Settings of the identification [default: the built-in configs/ident.json].
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Further settings to fit to the same logs and show beside.
    #[arg(long, value_name = "FILE")]
    against: Vec<PathBuf>,
    /// Rank the fits by prediction 0.2, 0.6 and 1.0 s ahead on logs not used for the fit.
    #[arg(long)]
    compare: bool,
    /// Parts into which --compare divides the logs.
    #[arg(long, value_name = "K", default_value_t = 5, requires = "compare")]
    #[arg(value_parser = clap::value_parser!(u16).range(2..))]
    folds: u16,
    /// Judge --compare by these logs, with the fits to all others.
    #[arg(long, value_name = "LOG", num_args = 1.., requires = "compare")]
    judge: Vec<PathBuf>,
    /// Add this to the yaw of the logs of --judge, e.g. if the object was defined the other way round.
    #[arg(long, value_name = "RAD", default_value_t = 0.0, requires = "judge")]
    #[arg(allow_negative_numbers = true)]
    judge_turn: f64,
    /// Add this to the yaw of the logs, in place of the settings', e.g. 3.1416 if the object was defined
    /// the other way round.
    #[arg(long, value_name = "RAD", allow_negative_numbers = true)]
    turn: Option<f64>,
    /// Search the dead times by their likelihood, whatever the settings are.
    #[arg(long)]
    search_dead_time: bool,
    /// Estimate again with this many resamples of the pieces.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(2..=1_000_000))]
    bootstrap: Option<u64>,
    /// Seed of the resampling and of the self-test.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Do part I of N of the bootstrap only, into the file of --part. `tello-ctl merge` joins the parts.
    #[arg(long, value_name = "I/N", requires = "bootstrap", conflicts_with_all = ["against", "compare"])]
    shard: Option<PartNumber>,
    /// The file of --shard [default: bootstrap-I-of-N.part in the folder --out]. It appears when all of its resamples
    /// are done; if it exists already, of the same logs, settings and revision, no resample is done. What Ctrl-C
    /// leaves is kept beside it, and continued by the same command.
    #[arg(long, value_name = "FILE", requires = "shard")]
    part: Option<PathBuf>,
    /// Bootstrap files of earlier runs and of other shards: what is in them is not done again.
    #[arg(long, value_name = "FILE", num_args = 1.., requires = "bootstrap")]
    resume: Vec<PathBuf>,
    /// Folder for the results. Files of an earlier run are replaced if this one writes them, too; a note counts the
    /// others [default: ident; with --json none, unless there is a bootstrap to keep].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Settings of the flight that shall take the parameters: what it would refuse is not written [default: the
    /// built-in configs/fly.json, for its model].
    #[arg(long, value_name = "FILE")]
    flight: Option<PathBuf>,
    /// Threads to use, in place of the settings'; 0 for all.
    #[arg(long, value_name = "N", value_parser = crate::thread_count())]
    threads: Option<usize>,
    /// Identify simulated flights whose truth is known, and compare.
    #[arg(long, conflicts_with_all = ["logs", "against", "compare", "bootstrap", "out", "flight", "turn",
        "folds", "judge", "judge_turn", "shard", "part", "resume"])]
    self_test: bool,
    /// Let the self-test identify a log of one automatic flight of the built-in mission, in place of flights by
    /// hand.
    #[arg(long, requires = "self_test", conflicts_with = "logs")]
    automatic: bool,
    /// The mission of --automatic, for instance one of `tello-ctl excite` [default: the built-in mission].
    #[arg(long, value_name = "FILE", requires = "automatic", conflicts_with = "logs")]
    mission: Option<PathBuf>,
    /// Simulated identifications of the self-test.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    #[arg(requires = "self_test", conflicts_with = "logs")]
    runs: u64,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    let clock = Clock::start();
    let mut tables = vec![load_table(arguments.config.as_deref(), arguments)?];
    for path in &arguments.against {
        let (name, table) = load_table(Some(path), arguments)?;
        let first = &tables[0].1;
        // The logs are loaded once for all.
        let of_logs = |table: &IdentFileTable| (table.dt_s, table.turn_rad, table.logs_max);
        if of_logs(&table) != of_logs(first) {
            bail!(
                "{name} has another dt_s, turn_rad or logs_max than the first settings: both use the same logs"
            );
        }
        tables.push((name, table));
    }
    let interrupt = Interrupt::listen()?;
    let threads = tables[0].1.threads;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).use_current_thread().build()?;
    pool.install(|| {
        if arguments.self_test {
            test_itself(arguments, &tables[0].1, &interrupt)
        } else {
            identify(arguments, &tables, &interrupt, &clock)
        }
    })
}

/// The settings of `path` or the built-in ones with the changes of the command line, and their name.
fn load_table(path: Option<&Path>, arguments: &Arguments) -> Result<(String, IdentFileTable)> {
    let mut table = ident::settings(path)?;
    if arguments.search_dead_time && table.delay.is_none() {
        table.delay = ident::settings(None)?.delay;
    }
    table.threads = arguments.threads.unwrap_or(table.threads);
    table.turn_rad = arguments.turn.unwrap_or(table.turn_rad);
    let name = path.map_or("built-in".into(), |path| path.with_extension("").display().to_string());
    table.check().with_context(|| format!("in the settings {name}"))?;
    Ok((name, table))
}

fn identify<'a>(
    arguments: &Arguments,
    tables: &'a [(String, IdentFileTable)],
    interrupt: &Interrupt,
    clock: &Clock,
) -> Result<Verdict> {
    let table = &tables[0].1;
    let recordings = Recordings::load(arguments, table)?;
    let observer = Shown::new(io::stderr().is_terminal() && !arguments.json, interrupt);
    let out = folder(arguments);
    let plan = bootstrap_plan(arguments, out);
    let flight = ident::flight_settings(table.model, arguments.flight.as_deref())?;
    let job = |(position, (name, table)): (usize, &'a (String, IdentFileTable))| Job {
        name,
        table,
        logs: &recordings.logs,
        bootstrap: plan.as_ref(),
        // The parameters of the first settings are written; those of the others are only compared.
        flight: flight.as_ref().filter(|_| position == 0),
        observer: &observer,
        keeps_estimates: out.is_some() && position == 0,
    };
    let jobs: Vec<Job<'_>> = tables.iter().enumerate().map(job).collect();
    let new_dir = out.filter(|dir| !dir.exists());
    if let Some(dir) = out.filter(|_| arguments.part.is_none()) {
        fs::create_dir_all(dir).with_context(|| format!("cannot make {}", dir.display()))?;
    }
    let before = out.map(ident::results).unwrap_or_default();
    let fits = Fits::all(arguments, &jobs, &recordings.judged, interrupt).inspect_err(|_| {
        // What holds a result stays.
        if let Some(dir) = new_dir {
            fs::remove_dir(dir).ok();
        }
    })?;
    note_left(out.filter(|_| arguments.shard.is_none()), &before);
    let are_good = fits.are_good(arguments);
    stdio::report(&fits.report(recordings, table.dt_s, clock), arguments.json)?;
    Ok(if are_good && !interrupt.is_asked() { Verdict::Good } else { Verdict::Bad })
}

/// The flights of the command line or the settings.
struct Recordings {
    logs: Vec<Loaded>,
    /// Flights of `--judge`, which are not fitted to.
    judged: Vec<Loaded>,
    skipped: Vec<FileSkipped>,
}

impl Recordings {
    fn load(arguments: &Arguments, table: &IdentFileTable) -> Result<Self> {
        let paths = if arguments.logs.is_empty() { &table.logs } else { &arguments.logs };
        let (logs, mut skipped) = ident::load_logs(paths, table)?;
        let (judged, unusable) =
            ident::load_judged(&arguments.judge, table.dt_s, arguments.judge_turn, &logs)?;
        skipped.extend(unusable);
        Ok(Self { logs, judged, skipped })
    }
}

/// The fits of all settings.
struct Fits {
    /// Of the first settings.
    main: FitResult,
    against: Vec<FitResult>,
    comparison: Option<Comparison>,
    written: Vec<PathBuf>,
}

impl Fits {
    /// Fits the first of `jobs`, writes its files, then fits and compares the others unless Ctrl-C came.
    fn all(
        arguments: &Arguments,
        jobs: &[Job<'_>],
        judged: &[Loaded],
        interrupt: &Interrupt,
    ) -> Result<Self> {
        let (out, first) = (folder(arguments), &jobs[0]);
        let main = ident::fit(first)?;
        let mut written = match out {
            Some(dir) => ident::write(dir, first, &main)?,
            None => Vec::new(),
        };
        note_kept(&main, &written);
        note_cut_short(&main, first.bootstrap.filter(|_| interrupt.is_asked()), &written);
        let mut fits = vec![main];
        let mut comparison = None;
        if !interrupt.is_asked() {
            for job in &jobs[1..] {
                fits.push(ident::fit(job)?);
            }
            if arguments.compare {
                let ranked = ident::compare(jobs, &fits, arguments.folds.into(), judged)?;
                if let Some(dir) = out {
                    written.extend(ident::save_prediction(dir, &ranked, first.table.dt_s)?);
                }
                comparison = Some(ranked);
            }
        }
        let main = fits.remove(0);
        Ok(Self { main, against: fits, comparison, written })
    }

    /// Whether the main fit converged, with all its resamples, and a flight would take its parameters.
    fn are_good(&self, arguments: &Arguments) -> bool {
        let FitResult { fit, has_converged, .. } = &self.main;
        // A part is complete when it is done.
        let is_complete =
            arguments.shard.is_some() || fit.bootstrap.as_ref().is_none_or(Bootstrap::is_whole);
        *has_converged && fit.refused.is_none() && is_complete
    }

    fn report(self, recordings: Recordings, dt_s: f64, clock: &Clock) -> IdentReport {
        IdentReport {
            fit: self.main.fit,
            against: self.against.into_iter().map(|result| result.fit).collect(),
            comparison: self.comparison,
            dt_s,
            files_used: recordings.logs.into_iter().map(FileUsed::from).collect(),
            files_skipped: recordings.skipped,
            seconds: clock.now().seconds(),
            written: self.written,
            revision: REVISION,
        }
    }
}

/// A note of a vehicle file that flights have taught and that is not replaced.
fn note_kept(main: &FitResult, written: &[PathBuf]) {
    if main.parameter_file.is_some()
        && let Some(earlier) = written.iter().find(|path| ident::is_earlier(path))
    {
        stdio::note(format_args!("note: what flights taught is kept as {}", earlier.display()));
    }
}

/// A note of results of earlier runs that stand beside those of this one.
fn note_left(dir: Option<&Path>, before: &BTreeMap<PathBuf, SystemTime>) {
    let Some(dir) = dir else { return };
    let after = ident::results(dir);
    let left: Vec<_> = before.iter().filter(|(path, at)| after.get(*path) == Some(at)).collect();
    if let Some((first, _)) = left.first() {
        stdio::note(format_args!(
            "note: {} files in {} are of an earlier run, e.g. {}; --out names another folder",
            left.len(),
            dir.display(),
            first.display()
        ));
    }
}

/// A note of resamples that Ctrl-C left out, and of how to go on with them.
fn note_cut_short(main: &FitResult, asked: Option<&BootstrapPlan>, written: &[PathBuf]) {
    let (Some(plan), Some(done)) = (asked, &main.resamples) else { return };
    if main.fit.bootstrap.is_some() {
        return;
    }
    let (count, resamples) = (done.file.count(), plan.resamples);
    let rest = match written.first() {
        Some(_) if plan.shard != PartNumber::ONLY => "; the same command continues".to_owned(),
        Some(file) => format!("; --resume {} continues", file.display()),
        None => String::new(),
    };
    stdio::note(format_args!(
        "note: stopped after {count} of {resamples} resamples: the deviations are those without a bootstrap{rest}"
    ));
}

/// Where files go: none are written where standard output holds all there is.
fn folder(arguments: &Arguments) -> Option<&Path> {
    match (&arguments.out, arguments.json && arguments.bootstrap.is_none()) {
        (Some(dir), _) => Some(dir),
        (None, true) => None,
        (None, false) => Some(Path::new("ident")),
    }
}

fn bootstrap_plan(arguments: &Arguments, out: Option<&Path>) -> Option<BootstrapPlan> {
    arguments.bootstrap.map(|resamples| BootstrapPlan {
        resamples,
        seed: arguments.seed,
        shard: arguments.shard.unwrap_or(PartNumber::ONLY),
        part: part_file(arguments, out.unwrap_or(Path::new(""))),
        earlier: arguments.resume.clone(),
    })
}

/// The file of `--shard`.
fn part_file(arguments: &Arguments, out: &Path) -> Option<PathBuf> {
    let [part, parts] = arguments.shard?.numbers();
    let named = || out.join(format!("bootstrap-{part}-of-{parts}.part"));
    Some(arguments.part.clone().unwrap_or_else(named))
}

fn test_itself(
    arguments: &Arguments,
    table: &IdentFileTable,
    interrupt: &Interrupt,
) -> Result<Verdict> {
    if (table.dt_s - tello_sim::DT_S).abs() > 1e-9 {
        bail!("dt_s is {}: simulated flights have {} s", table.dt_s, tello_sim::DT_S);
    }
    let observer = Shown::new(!arguments.json, interrupt);
    observer.begin("self-test", Some(arguments.runs));
    let mission = arguments.automatic.then(|| config::fly(None, arguments.mission.as_deref()));
    let mission = mission.transpose()?.map(|(_, mission)| mission);
    let test =
        self_test::run(table, mission.as_ref(), (arguments.runs, arguments.seed), &observer)?;
    observer.end();
    stdio::report(&test, arguments.json)?;
    Ok(if test.is_passed { Verdict::Good } else { Verdict::Bad })
}
