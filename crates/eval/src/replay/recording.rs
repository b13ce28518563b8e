//! CSV flights of the thesis, converted or not, through filter and estimator.

mod inboxes;

use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use horizon_estim::Observed;
use horizon_model::rows::pose;
use horizon_model::setting::SettingError;
use rayon::iter::{IndexedParallelIterator, IntoParallelRefIterator, ParallelIterator};
use schemars::JsonSchema;
use serde::Serialize;
use tello_flight::cycle::{self, FlightTable, Outcome, Unwatched};
use tello_flight::{Acceptance, Start};
use tello_io::config;
use tello_io::log::csv::CsvRow;

use super::Options;
use super::drawn_log::DrawnLog;
use super::forecast_errors::{self, AHEAD_STEPS, AIRBORNE_M, Forecast, ForecastRow};
use crate::flight_log::{self, TickRecord};
use crate::forecast::ForecastErrors;
use crate::recordings::rows::RowFlight;
use crate::recordings::{PERIOD_S, from_rows};
use crate::smooth::track;
use crate::{REVISION, parameter_file};

/// The forecast that needs no estimator.
const CONSTANT_VELOCITY: &str = "constant velocity";

/// Errors of filter and estimator on the recordings.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct ForecastReport {
    /// How far ahead the forecasts look. s
    ahead_s: [f64; 3],
    /// Each recording.
    flights: Vec<Flight>,
    /// Errors of the forecasts of all of them together.
    pooled: Vec<ForecastRow>,
    /// This revision.
    revision: &'static str,
}

/// Errors of filter and estimator on one recording.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
struct Flight {
    /// File name without its ending.
    name: String,
    #[serde(flatten)]
    counts: Counts,
    /// Errors of the forecasts, with --config, with --against and with constant velocity.
    forecasts: Vec<ForecastRow>,
    #[serde(skip)]
    errors: Vec<ForecastErrors>,
    /// Lines of the file that were skipped.
    lines_skipped: Vec<String>,
    /// The log that was written; null if none was.
    log: Option<PathBuf>,
}

/// How the ticks of a recording went.
#[derive(Debug, Clone, PartialEq, Default, Serialize, JsonSchema)]
struct Counts {
    /// Ticks repeated.
    ticks: u64,
    /// Ticks with a filtered height of a flight.
    ticks_airborne: u64,
    /// Ticks without a new pose: the stream stalled or the object was lost.
    ticks_missing: u64,
    /// New positions that the filter did not accept.
    positions_held: u64,
    /// New headings that the filter did not accept.
    headings_held: u64,
    /// Ticks in which the estimator gave no estimate.
    estimates_failed: u64,
    /// Ticks in which the link was judged to be down.
    ticks_link_down: u64,
    /// Root mean square distance of estimate and filtered pose, x, y and z. m
    rms_m: f64,
    /// Parameter estimate at the end. Units of the rows
    p_hat: Vec<f64>,
}

impl ForecastReport {
    pub(super) fn is_judged(&self) -> bool {
        self.flights.iter().all(|flight| flight.unjudged().is_none())
    }
}

impl Flight {
    /// Why it means nothing for the estimator, if so.
    fn unjudged(&self) -> Option<String> {
        if self.counts.ticks_airborne == 0 {
            Some(format!("never above {AIRBORNE_M} m: without flight it proves nothing"))
        } else if self.forecasts.iter().all(ForecastRow::is_empty) {
            Some("no forecast could be judged: too few poses that the filter accepts".into())
        } else {
            None
        }
    }
}

/// Settings that a recording runs through.
struct Setup {
    name: String,
    flight: FlightTable,
    log_dir: PathBuf,
}

impl Setup {
    fn read(path: Option<&Path>, params: Option<&Path>) -> Result<Self> {
        let (mut table, mission) = config::fly(path, None)?;
        parameter_file::apply(params, &mut table.cycle)?;
        let dt_s = table.cycle.dt_s;
        ensure!(
            (dt_s - PERIOD_S).abs() < 1e-9,
            "cycle.dt_s = {dt_s}: expected {PERIOD_S}: the period of the recordings"
        );
        Ok(Self {
            name: path.map_or_else(|| "built-in".into(), |path| path.display().to_string()),
            flight: config::flight(&table, mission, Start::Airborne),
            log_dir: table.log.dir,
        })
    }
}

/// Runs `flights`, which were read from `paths`, through the settings of `options`.
pub(super) fn run(
    paths: &[PathBuf],
    flights: &[RowFlight],
    options: &Options<'_>,
) -> Result<ForecastReport> {
    let ours = Setup::read(options.config, options.params)?;
    let against = options.against.map(|path| Setup::read(Some(path), None));
    let against = against.transpose()?;
    let log_of = |path: &Path| match (options.out, paths) {
        (Some(out), [_]) => Ok(Some(out.to_owned())),
        (None, [_]) => default_log(path, &ours.log_dir).map(Some),
        (Some(_), _) => bail!("--out is for one recording, not for {}", paths.len()),
        (None, _) => Ok(None),
    };
    let flights: Vec<Flight> = paths
        .par_iter()
        .zip(flights)
        .map(|(path, rows)| Flight::replay(path, rows, &ours, against.as_ref(), log_of(path)?))
        .collect::<Result<_>>()?;
    let rules = [Some(ours.name), against.map(|against| against.name)];
    let rules = rules.into_iter().flatten().chain([CONSTANT_VELOCITY.into()]);
    let pooled = rules.enumerate().map(|(rule, name)| {
        let mut errors = forecast_errors::no_errors();
        for flight in &flights {
            errors.extend(&flight.errors[rule]);
        }
        ForecastRow::new(&name, &errors)
    });
    Ok(ForecastReport {
        ahead_s: forecast_errors::ahead_s(),
        pooled: pooled.collect(),
        flights,
        revision: REVISION,
    })
}

fn name_of(path: &Path) -> String {
    path.file_stem().map_or_else(|| "flight".into(), |stem| stem.to_string_lossy().into_owned())
}

fn default_log(path: &Path, dir: &Path) -> Result<PathBuf> {
    flight_log::free_path(dir, &format!("{}-replay", name_of(path)))
}

impl Flight {
    fn replay(
        path: &Path,
        recording: &RowFlight,
        ours: &Setup,
        against: Option<&Setup>,
        log: Option<PathBuf>,
    ) -> Result<Self> {
        let rows = inboxes::longest_part(&recording.rows);
        if rows.is_empty() {
            bail!("{} has no flight in it: no line reads tag,step,v1,v2,v3,v4", path.display());
        }
        let mut lines_skipped = recording.notes.clone();
        if rows.len() < recording.rows.len() {
            let count = recording.rows.len() - rows.len();
            lines_skipped.push(format!("{count} steps beyond a gap of more than a second"));
        }
        let pass = Pass::fly(rows, &ours.flight, log.as_deref())?;
        let mut forecasts = vec![pass.forecasts];
        let mut names = vec![ours.name.as_str()];
        if let Some(against) = against {
            let in_settings = || format!("in {}", against.name);
            let pass = Pass::fly(rows, &against.flight, None).with_context(in_settings)?;
            forecasts.push(pass.forecasts);
            names.push(&against.name);
        }
        forecasts.push(forecast_errors::constant_velocity(&track(&pass.o, PERIOD_S)));
        names.push(CONSTANT_VELOCITY);
        let errors = forecast_errors::judge(&forecasts, &pass.o);
        let forecasts =
            names.iter().zip(&errors).map(|(name, errors)| ForecastRow::new(name, errors));
        Ok(Self {
            name: name_of(path),
            counts: pass.counts,
            forecasts: forecasts.collect(),
            errors,
            lines_skipped,
            log,
        })
    }
}

/// A recording after its way through one cycle; the rows are its steps, the skipped ones included.
struct Pass {
    counts: Counts,
    /// Observations that the filter accepted.
    o: Vec<Observed<{ pose::COUNT }>>,
    forecasts: Vec<Forecast>,
}

impl Pass {
    fn fly(rows: &[CsvRow], flight: &FlightTable, log: Option<&Path>) -> Result<Self> {
        let under_cycle = |error: SettingError| error.under("cycle");
        let inboxes = inboxes::of_rows(rows);
        let u_applied = inboxes::applied(&inboxes, &flight.cycle).map_err(under_cycle)?;
        let mut cycle = cycle::build(flight)?;
        let mut record = TickRecord::with_buffers(&cycle.new_outcome());
        let create = |path| DrawnLog::create(path, flight, 0, &record.out);
        let mut log = log.map(create).transpose()?;
        let mut pass = Self {
            counts: Counts::default(),
            o: vec![Observed::missing(); u_applied.len()],
            forecasts: vec![[None; AHEAD_STEPS.len()]; u_applied.len()],
        };
        let (mut square_sum_m2, mut estimates) = (0.0, 0_u64);
        let mut step = 0;
        for inbox in inboxes {
            step += usize::try_from(inbox.skipped)?;
            record.inbox = inbox;
            cycle.tick(&record.inbox, &mut Unwatched::default(), &mut record.out);
            if let Some(log) = &mut log {
                log.write(&record)?;
            }
            if let Some(distance_m2) = pass.counts.add(&record) {
                square_sum_m2 += distance_m2;
                estimates += 1;
            }
            pass.o[step] = accepted(&record.out);
            pass.forecasts[step] = AHEAD_STEPS.map(|steps| {
                u_applied.get(step..step + steps).and_then(|u_applied| cycle.forecast(u_applied))
            });
            step += 1;
        }
        pass.counts.rms_m = (square_sum_m2 / estimates.max(1) as f64).sqrt();
        pass.counts.p_hat = record.out.p_hat;
        if let Some(log) = log {
            log.finish()?;
        }
        Ok(pass)
    }
}

/// Observation that the filter accepted in a tick.
fn accepted(out: &Outcome) -> Observed<{ pose::COUNT }> {
    let Some((filtered, o)) = out.filtered.and_then(|filtered| Some((filtered, filtered.o?)))
    else {
        return Observed::missing();
    };
    let is_new = |acceptance| acceptance == Acceptance::Accepted;
    from_rows::accepted(o, is_new(filtered.position), is_new(filtered.heading))
}

impl Counts {
    /// Counts one tick; squared distance of estimate and filtered position, if there are both. m^2
    fn add(&mut self, record: &TickRecord) -> Option<f64> {
        let out = &record.out;
        self.ticks += 1;
        self.ticks_missing += u64::from(record.inbox.sightings.is_empty());
        self.estimates_failed += u64::from(matches!(out.estimator, Some(cycle::Solve::Failed(_))));
        self.ticks_link_down += u64::from(out.link.is_some_and(|link| link.state.is_down()));
        let filtered = out.filtered.as_ref()?;
        self.positions_held += u64::from(filtered.position == Acceptance::Held);
        self.headings_held += u64::from(filtered.heading == Acceptance::Held);
        let o = filtered.o?;
        self.ticks_airborne += u64::from(o[pose::Z] > AIRBORNE_M);
        let pose_hat = out.pose_hat()?;
        Some((o - pose_hat).fixed_rows::<3>(pose::X).norm_squared())
    }
}

impl Display for Flight {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let counts = &self.counts;
        writeln!(f, "ticks             {} ({} airborne)", counts.ticks, counts.ticks_airborne)?;
        writeln!(f, "without a pose    {}", counts.ticks_missing)?;
        writeln!(
            f,
            "held by filter    {} positions, {} headings",
            counts.positions_held, counts.headings_held
        )?;
        writeln!(f, "link down         {}", counts.ticks_link_down)?;
        writeln!(f, "estimates failed  {}", counts.estimates_failed)?;
        writeln!(f, "estimate          {:.4} m RMS from the filtered position", counts.rms_m)?;
        writeln!(f, "parameters        {:.4?}", counts.p_hat)?;
        if let Some(log) = &self.log {
            writeln!(f, "log               {}", log.display())?;
        }
        Ok(())
    }
}

impl Display for ForecastReport {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for flight in &self.flights {
            for line in &flight.lines_skipped {
                writeln!(f, "{}: skipped {line}", flight.name)?;
            }
            if let Some(why) = flight.unjudged() {
                writeln!(f, "{}: {why}", flight.name)?;
            }
        }
        if let [flight] = self.flights.as_slice() {
            writeln!(f, "{flight}")?;
        }
        let rows = self.flights.iter().flat_map(|flight| {
            flight.forecasts.iter().map(|forecast| (flight.name.as_str(), forecast))
        });
        let pooled = self.pooled.iter().map(|forecast| ("all", forecast));
        let pooled = pooled.take(if self.flights.len() > 1 { self.pooled.len() } else { 0 });
        write!(f, "{}", forecast_errors::Table(rows.chain(pooled).collect()))
    }
}

#[cfg(test)]
mod tests;
