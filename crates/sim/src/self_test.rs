//! Identification of simulated flights whose truth is known.
//!
//! The simulated vehicle is not the model: its dead zones and its limit have sharp corners, its
//! disturbance is noise. What comes back is what a real identification can hope for.

mod display;
mod next_flight;

use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;

use anyhow::{Result, bail};
use horizon_estim::{Observed, Recording};
use horizon_model::angle::unwrap_near;
use horizon_model::rows::pose;
use schemars::JsonSchema;
use serde::Serialize;
use tello_eval::ident::{self, FitReport, IdentFileTable, Job, Observer};
use tello_eval::recordings::{self, Loaded};
use tello_flight::cycle::ModelKind;
use tello_flight::{MissionTable, Start};
use tello_io::config;

use crate::batch::Flown;
use crate::plant::{NOMINAL, PlantParams, PlantTable};
use crate::random::{Purpose, Random};
use crate::seeds::fly_each;
use crate::{ManualFlight, MocapReport, Profile, logged_flight};

pub use next_flight::FlownNext;

/// Flights of one run, each as long as one of the thesis.
const FLIGHTS: u64 = 4;
const FLIGHT_STEPS: usize = 4600;

/// A dead time that is so near has been found, however sure it claims to be. s
const DEAD_TIME_TOLERANCE_S: f64 = 0.005;

/// Mean error with which a parameter has been found, as a fraction of its truth: the model rounds the corners of the
/// vehicle. 1
const RELATIVE_TOLERANCE: f64 = 0.03;

/// Mean error that is none of chance, at least. Claimed deviations
const ERROR_MAX_STD: f64 = 4.0;

/// Where the logs of a run come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// Flights by hand, as those of the thesis.
    ByHand,
    /// The log of one automatic flight of a mission with the built-in settings, from take-off to landing, read from a
    /// file as any other.
    Automatic,
}

/// Fraction of the intervals of automatic flights that has to hold the truth. 1
const COVERAGE_MIN: f64 = 0.9;

/// Result of the self-test.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct SelfTest {
    /// Simulated identifications that were finished.
    pub runs: usize,
    /// Kind of the simulated flights: by hand, or automatic.
    pub source: Source,
    /// Fraction of all 95 % intervals that hold the truth, of the runs that are not refused. 1
    pub coverage: f64,
    /// Runs whose parameters the built-in flight would refuse, so that `ident` writes none.
    pub refused: usize,
    /// Each parameter and each dead time, of the runs that are not refused.
    pub rows: Vec<SelfTestRow>,
    /// Of automatic flights: the built-in mission flown by the vehicles of these runs with the built-in parameters, and
    /// with the identified ones.
    pub flown: Option<[FlownNext; 2]>,
    /// Whether everything was found.
    pub is_passed: bool,
}

/// How well one number was found.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct SelfTestRow {
    /// Name.
    pub name: String,
    #[serde(skip)]
    kind: FoundKind,
    /// Truth of the first of these runs. In the unit of the parameter
    pub truth: f64,
    /// Estimate of the first of these runs. In the unit of the parameter
    pub estimate: f64,
    /// Mean over runs of estimate minus truth. In the unit of the parameter
    pub error_mean: f64,
    /// Root mean square over runs of estimate minus truth. In the unit of the parameter
    pub error_rms: f64,
    /// Mean over runs of the standard deviation that was claimed; null if one claims none. In the unit of the parameter
    pub std_mean: Option<f64>,
    /// Fraction of the runs with a 95 % interval in which it holds the truth; null without any. 1
    pub coverage: Option<f64>,
}

/// Kind of an identified number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FoundKind {
    Parameter,
    DeadTime,
}

/// One number of one run: truth, estimate, claimed deviation and 95 % interval. Unit of the row; of a dead time s
struct Found {
    kind: FoundKind,
    name: String,
    truth: f64,
    estimate: f64,
    std: Option<f64>,
    interval: Option<[f64; 2]>,
}

/// The interval between these ends; `None` without an end.
fn interval(lower: f64, upper: f64) -> Option<[f64; 2]> {
    (lower <= upper).then_some([lower, upper])
}

/// Identifies `runs` vehicles of the simulator's spread with the settings `table`, from flights by hand or, with a
/// mission, from an automatic flight of it; `observer` is notified of each.
///
/// # Errors
/// The settings are of another model, or a fit fails.
pub fn run(
    table: &IdentFileTable,
    mission: Option<&MissionTable>,
    (runs, seed): (u64, u64),
    observer: &dyn Observer,
) -> Result<SelfTest> {
    if table.model != ModelKind::Lagged {
        bail!("the simulated vehicle is a lagged one: --self-test needs settings with that model");
    }
    let flight = ident::flight_settings(table.model, None)?;
    let one = |seed: u64| -> Result<Run> {
        let (truth, logs) = simulate(seed, mission)?;
        let job = Job {
            name: "self-test",
            table,
            logs: &logs,
            bootstrap: None,
            flight: flight.as_ref(),
            observer: &StopOnly(observer),
            keeps_estimates: false,
        };
        let result = ident::fit(&job)?;
        let Some(file) = &result.parameter_file else { return Ok(None) };
        let flown = match (&flight, mission) {
            (Some(flight), Some(_)) => Some(next_flight::fly(flight, file, seed)?),
            _ => None,
        };
        Ok(Some(Identified { found: found(&truth, &result.fit), flown }))
    };
    let seeds = seed..seed.saturating_add(runs);
    let all = fly_each(seeds, &|| observer.is_stopped(), &|| observer.advance(), one)?;
    let source = if mission.is_some() { Source::Automatic } else { Source::ByHand };
    Ok(SelfTest::of(&all, source))
}

/// Side by side, only the end of a run is progress.
struct StopOnly<'a>(&'a dyn Observer);

impl Observer for StopOnly<'_> {
    fn is_stopped(&self) -> bool {
        self.0.is_stopped()
    }
}

/// Flights of one vehicle of the simulator's spread.
fn simulate(seed: u64, mission: Option<&MissionTable>) -> Result<(PlantTable, Vec<Loaded>)> {
    let nominal = PlantParams::try_from(NOMINAL)?;
    let params = nominal.draw(&mut Random::new(seed, Purpose::Vehicle));
    let log = |flight: u64| -> Result<Loaded> {
        // Runs must have independent random flights.
        let flown = ManualFlight::fly(
            &params,
            Profile::GoodDay,
            seed.wrapping_mul(FLIGHTS).wrapping_add(flight),
            FLIGHT_STEPS,
        )?;
        let mut theta = 0.0;
        let observed = |report: &MocapReport| match report {
            MocapReport::Pose(pose) => {
                let mut o = *pose;
                theta = unwrap_near(o[pose::THETA], theta);
                o[pose::THETA] = theta;
                Observed::full(o)
            }
            MocapReport::Lost | MocapReport::Silent => Observed::missing(),
        };
        let o = flown.reports.iter().map(observed).collect();
        Ok(Loaded {
            path: PathBuf::from(format!("simulated-{seed}-{flight}")),
            sha256: String::new(),
            is_simulated: true,
            recording: Recording { u: flown.u_sent, o },
            skipped: Vec::new(),
            motions: BTreeSet::new(),
        })
    };
    let logs = match mission {
        None => (0..FLIGHTS).map(log).collect::<Result<_>>()?,
        Some(mission) => vec![automatic(seed, mission)?],
    };
    Ok((*params.table(), logs))
}

/// The log of the automatic flight of `seed`, whose vehicle is that of `simulate`.
fn automatic(seed: u64, mission: &MissionTable) -> Result<Loaded> {
    let (fly, _) = config::fly(None, None)?;
    let flight = config::flight(&fly, mission.clone(), Start::Grounded);
    let name = format!("tello-ctl-self-test-{}-{seed}.mcap", std::process::id());
    let path = std::env::temp_dir().join(name);
    fs::remove_file(&path).ok();
    logged_flight::fly(&flight, &crate::settings(None)?, seed, &path)?;
    let loaded = recordings::load(std::slice::from_ref(&path));
    fs::remove_file(&path)?;
    let (mut logs, unusable) = loaded?;
    match (logs.pop(), unusable.first()) {
        (Some(log), _) => Ok(log),
        (None, Some(file)) => bail!("the flight of seed {seed} cannot be used: {}", file.why),
        (None, None) => bail!("the flight of seed {seed} left no log"),
    }
}

/// Every number of a fit beside its truth.
fn found(truth: &PlantTable, fit: &FitReport) -> Vec<Found> {
    let parameters = fit.parameters.iter().map(|row| Found {
        kind: FoundKind::Parameter,
        name: row.name.to_owned(),
        truth: truth_of(truth, row.name),
        estimate: row.value,
        std: Some(row.std),
        interval: interval(row.lower, row.upper),
    });
    let axis = |sticks: &str| match sticks {
        "yaw" => &truth.yaw,
        "throttle" => &truth.vertical,
        _ => &truth.horizontal,
    };
    let delays = fit.delay.iter().map(|row| Found {
        kind: FoundKind::DeadTime,
        name: format!("dead time {}", row.sticks),
        truth: axis(&row.sticks).dead_time_s,
        estimate: row.dead_time_s,
        std: row.std_s,
        interval: row.lower_s.zip(row.upper_s).and_then(|(lower, upper)| interval(lower, upper)),
    });
    parameters.chain(delays).collect()
}

/// The plant's number that the model calls `name`; NaN if it has none.
fn truth_of(truth: &PlantTable, name: &str) -> f64 {
    match name {
        "lambda_h" => truth.horizontal.gain,
        "lambda_v" => truth.vertical.gain,
        "lambda_a" => truth.yaw.gain,
        "theta_0" => truth.theta_0,
        "tau_h" => truth.horizontal.tau_s,
        "tau_v" => truth.vertical.tau_s,
        "tau_a" => truth.yaw.tau_s,
        "dead_h" => truth.horizontal.dead_zone,
        "dead_v" => truth.vertical.dead_zone,
        "dead_a" => truth.yaw.dead_zone,
        "a_max" => truth.accel_max_mps2,
        _ => f64::NAN,
    }
}

/// One run; `None` if the flight would refuse its numbers, so that `ident` writes none.
type Run = Option<Identified>;

/// The numbers of one run, and flights without and with them.
struct Identified {
    found: Vec<Found>,
    flown: Option<[Flown; 2]>,
}

impl Found {
    /// Whether the interval holds the truth; `None` without an interval.
    fn holds(&self) -> Option<bool> {
        self.interval.map(|[lower, upper]| (lower..=upper).contains(&self.truth))
    }
}

/// Fraction of what is true; `None` of nothing.
fn fraction(are_true: impl Iterator<Item = bool>) -> Option<f64> {
    let (mut count, mut sum) = (0_u32, 0_u32);
    for is_true in are_true {
        count += 1;
        sum += u32::from(is_true);
    }
    (count > 0).then(|| f64::from(sum) / f64::from(count))
}

impl SelfTest {
    fn of(runs: &[Run], source: Source) -> Self {
        let identified: Vec<&Identified> = runs.iter().flatten().collect();
        let accepted: Vec<&[Found]> = identified.iter().map(|run| run.found.as_slice()).collect();
        let refused = runs.len() - accepted.len();
        let rows_count = accepted.first().map_or(0, |run| run.len());
        let rows: Vec<SelfTestRow> = (0..rows_count)
            .filter_map(|row| {
                let column: Vec<&Found> = accepted.iter().filter_map(|run| run.get(row)).collect();
                SelfTestRow::of(&column)
            })
            .collect();
        let doubt = ERROR_MAX_STD / (accepted.len().max(1) as f64).sqrt();
        let is_found = |row: &SelfTestRow| {
            let enough = match row.kind {
                FoundKind::Parameter => 0.0,
                FoundKind::DeadTime => DEAD_TIME_TOLERANCE_S,
            };
            let enough = enough.max(RELATIVE_TOLERANCE * row.truth.abs());
            row.error_mean.abs() <= enough.max(doubt * row.std_mean.unwrap_or(0.0))
        };
        let coverage =
            fraction(accepted.iter().copied().flatten().filter_map(Found::holds)).unwrap_or(0.0);
        let pairs = || identified.iter().filter_map(|run| run.flown.as_ref());
        let flown = FlownNext::of(pairs().map(|[before, _]| before))
            .zip(FlownNext::of(pairs().map(|[_, after]| after)));
        let flown = flown.map(|(before, after)| [before, after]);
        let is_passed = match source {
            Source::ByHand => refused == 0 && !rows.is_empty() && rows.iter().all(is_found),
            Source::Automatic => {
                let is_as_good = flown.is_some_and(|[before, after]| after.is_as_good_as(&before));
                coverage >= COVERAGE_MIN && refused == 0 && is_as_good
            }
        };
        Self { runs: runs.len(), source, coverage, refused, is_passed, rows, flown }
    }
}

impl SelfTestRow {
    fn of(column: &[&Found]) -> Option<Self> {
        let first = column.first()?;
        let count = column.len() as f64;
        let mean =
            |of: &dyn Fn(&Found) -> f64| column.iter().map(|found| of(found)).sum::<f64>() / count;
        let std_mean = mean(&|found| found.std.unwrap_or(f64::NAN));
        Some(Self {
            name: first.name.clone(),
            kind: first.kind,
            truth: first.truth,
            estimate: first.estimate,
            error_mean: mean(&|found| found.estimate - found.truth),
            error_rms: mean(&|found| (found.estimate - found.truth).powi(2)).sqrt(),
            std_mean: std_mean.is_finite().then_some(std_mean),
            coverage: fraction(column.iter().filter_map(|found| found.holds())),
        })
    }
}

#[cfg(test)]
mod tests;
