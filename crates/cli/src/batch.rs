//! `tello-ctl sim --batch`: seeded flights in virtual time, and what they were worth.

use std::fmt::{self, Display, Formatter};

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use schemars::JsonSchema;
use serde::Serialize;
use tello_control::Phase;
use tello_sim::SimTable;

use crate::cycle::FlightTable;
use crate::metrics::{Metrics, Track, VALID_DISTANCE_M, quantile};
use crate::virtual_time::VirtualFlight;

/// Virtual time after which a flight counts as unfinished. s
const TIME_LIMIT_S: f64 = 120.0;

/// One flight of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub(crate) struct BatchFlight {
    /// Seed of the plant, its faults and the start.
    pub seed: u64,
    /// Figures with the controller's own estimate, as a real log has them.
    pub by_estimate: Option<Metrics>,
    /// Figures with the true pose; start and end still as the controller saw them.
    pub by_truth: Option<Metrics>,
}

/// A batch of flights and its table.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(crate) struct Batch {
    /// Number of flights.
    pub flights_count: usize,
    /// Flights that reached their last target.
    pub finished_count: usize,
    /// Quartiles of the time from first to last target, of the finished flights. s
    pub finish_quartiles_s: Option<[f64; 3]>,
    /// Table with the controller's own estimate.
    pub by_estimate: Option<Spread>,
    /// Table with the true pose.
    pub by_truth: Option<Spread>,
    /// Each flight, in the order of the seeds.
    pub flights: Vec<BatchFlight>,
}

/// Medians over flights of the figures of [`Metrics`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub(crate) struct Spread {
    /// Median over flights of the median horizontal distance. m
    pub distance_median_m: f64,
    /// Median over flights of the 95 % quantile of the horizontal distance. m
    pub distance_p95_m: f64,
    /// Median over flights of the largest horizontal distance. m
    pub distance_max_m: f64,
    /// Share of all flights that finish and stay within 0.3 m of the path. 1
    pub within_valid_distance: f64,
    /// Median over flights of the median speed. m/s
    pub speed_median_m_s: f64,
    /// Median over flights of the median stick norm. 1
    pub input_norm_median: f64,
}

/// Flies seeds `first_seed`, `first_seed + 1`, .. on all cores; the result does not depend on them.
///
/// # Errors
/// A setting that breaks its rule.
pub(crate) fn fly_batch(
    flight: &FlightTable,
    sim: &SimTable,
    first_seed: u64,
    count: u64,
    shows_progress: bool,
) -> Result<Batch> {
    let bar = if shows_progress { ProgressBar::new(count) } else { ProgressBar::hidden() };
    bar.set_style(ProgressStyle::with_template(
        "{bar:40} {pos}/{len} flights, {per_sec}, {eta} left",
    )?);
    let flights: Result<Vec<BatchFlight>> = (first_seed..first_seed + count)
        .into_par_iter()
        .map(|seed| {
            let flown = fly_one(flight, sim, seed);
            bar.inc(1);
            flown
        })
        .collect();
    bar.finish_and_clear();
    Ok(Batch::of(flights?))
}

fn fly_one(flight: &FlightTable, sim: &SimTable, seed: u64) -> Result<BatchFlight> {
    let mut virtual_flight = VirtualFlight::new(flight, sim, seed)?;
    let dt_s = flight.cycle.dt_s;
    let targets = flight.targets.poses()?;
    let (mut by_estimate, mut by_truth) = (Track::new(&targets, dt_s), Track::new(&targets, dt_s));
    loop {
        let out = virtual_flight.tick()?;
        let is_finished = out.targets_reached == targets.len();
        let is_over = is_finished || matches!(out.phase(), Phase::Landed | Phase::Fault);
        let (reached, u_sent, step) = (out.targets_reached, out.u_sent, out.step);
        if let Some(pose_hat) = out.pose_hat() {
            let now_s = step as f64 * dt_s;
            by_estimate.add(now_s, &pose_hat, &u_sent, reached);
            by_truth.add(now_s, &virtual_flight.true_pose(), &u_sent, reached);
        }
        if is_over || step as f64 * dt_s >= TIME_LIMIT_S {
            break;
        }
    }
    Ok(BatchFlight { seed, by_estimate: by_estimate.metrics(), by_truth: by_truth.metrics() })
}

impl Batch {
    fn of(flights: Vec<BatchFlight>) -> Self {
        let finish_s: Vec<f64> = flights
            .iter()
            .filter_map(|flight| flight.by_estimate.and_then(|metrics| metrics.finish_s))
            .collect();
        let quartile = |share| quantile(&finish_s, share);
        let spread = |pick: fn(&BatchFlight) -> Option<Metrics>| {
            let metrics: Vec<Metrics> = flights.iter().filter_map(pick).collect();
            Spread::of(&metrics, flights.len())
        };
        Self {
            flights_count: flights.len(),
            finished_count: finish_s.len(),
            finish_quartiles_s: quartile(0.25)
                .zip(quartile(0.5))
                .zip(quartile(0.75))
                .map(|((low, median), high)| [low, median, high]),
            by_estimate: spread(|flight| flight.by_estimate),
            by_truth: spread(|flight| flight.by_truth),
            flights,
        }
    }
}

impl Spread {
    fn of(metrics: &[Metrics], flights_count: usize) -> Option<Self> {
        let median = |pick: fn(&Metrics) -> f64| {
            quantile(&metrics.iter().map(pick).collect::<Vec<f64>>(), 0.5)
        };
        let valid = metrics.iter().filter(|metrics| {
            metrics.finish_s.is_some() && metrics.distance_max_m <= VALID_DISTANCE_M
        });
        Some(Self {
            distance_median_m: median(|metrics| metrics.distance_median_m)?,
            distance_p95_m: median(|metrics| metrics.distance_p95_m)?,
            distance_max_m: median(|metrics| metrics.distance_max_m)?,
            within_valid_distance: valid.count() as f64 / flights_count as f64,
            speed_median_m_s: median(|metrics| metrics.speed_median_m_s)?,
            input_norm_median: median(|metrics| metrics.input_norm_median)?,
        })
    }
}

impl Display for Batch {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "flights            {}", self.flights_count)?;
        writeln!(f, "finished           {}", self.finished_count)?;
        if let Some([low, median, high]) = self.finish_quartiles_s {
            writeln!(f, "finish             {median:.1} s [{low:.1}, {high:.1}]")?;
        }
        writeln!(f, "                   by estimate  by truth")?;
        let (Some(estimate), Some(truth)) = (&self.by_estimate, &self.by_truth) else {
            return writeln!(f, "no flight reached its first target");
        };
        let mut row = |name: &str, pick: fn(&Spread) -> f64, unit: &str| {
            writeln!(f, "{name:<18} {:>11.3}  {:>8.3} {unit}", pick(estimate), pick(truth))
        };
        row("2-D distance", |spread| spread.distance_median_m, "m, median")?;
        row("", |spread| spread.distance_p95_m, "m, 95 %")?;
        row("", |spread| spread.distance_max_m, "m, largest (median flight)")?;
        row("within 0.3 m", |spread| spread.within_valid_distance, "of all flights")?;
        row("speed", |spread| spread.speed_median_m_s, "m/s, median")?;
        row("stick norm", |spread| spread.input_norm_median, "median")
    }
}
