//! Table of a batch: statistics of many flights.

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};

use horizon_model::check::maximum;
use schemars::JsonSchema;
use serde::Serialize;
use tello_eval::metrics::{HoverScore, LeastClearance, Outages, Score, VALID_DISTANCE_M};
use tello_eval::{quantile, quantiles, rate_interval};
use tello_flight::Fault;

use super::flight::{Ending, FlightRow, Flown, SolverCounts, TIME_LIMIT_S, source};
use super::laps::Laps;

/// Offset from the outline that a flight should never exceed. m
const FENCE_M: f64 = 0.5;

/// Distance to a wall or an obstacle from which on the table shows none. m
const CLEARANCE_M: f64 = 1.0;

/// Entries of quartiles.
mod quartile {
    pub(super) const LOWER: usize = 0;
    pub(super) const MEDIAN: usize = 1;
    pub(super) const UPPER: usize = 2;
}

/// Entries of the figures of a distance or overshoot: the quantiles of 0.5, of 0.95 (overshoot: 0.9), and of 1.
mod figure {
    pub(super) const MEDIAN: usize = 0;
    pub(super) const HIGH: usize = 1;
    pub(super) const LARGEST: usize = 2;
}

/// A batch of flights and its table.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Batch {
    /// Number of flights.
    pub flights_count: usize,
    /// Flights that finished.
    pub finished_count: usize,
    /// 95 % interval of the fraction that finishes (Wilson). 1
    pub finished_interval: [f64; 2],
    /// Flights whose controller was done while the true pose had missed a target.
    pub missed_count: usize,
    /// Flights that landed before the controller was done.
    pub landed_count: usize,
    /// How many of these each fault ended.
    pub landed_by: BTreeMap<Fault, usize>,
    /// Flights that were neither done nor landed within their time limit.
    pub unfinished_count: usize,
    /// Table by the true pose; null if no flight began.
    pub by_truth: Option<FlightSpread>,
    /// Table by the controller's own estimate.
    pub by_estimate: Option<FlightSpread>,
    /// Table of the laps by the true pose; empty for a path that is flown once.
    pub laps: Laps,
    /// Table of the hovers, if they were asked for and one lasted.
    pub hover: Option<HoverSpread>,
    /// Largest true horizontal offset from the outline while flying, of all flights. m
    pub fence_distance_m: f64,
    /// Largest true offset up or down. m
    pub fence_height_m: f64,
    /// Fraction of flights beyond 0.5 m in one of the two. 1
    #[serde(rename = "beyond_fence")]
    pub outside_fence: f64,
    /// Least true distance to walls and obstacles of all flights.
    pub clearance: LeastClearance,
    /// Outages of the commands per flight, as the link monitor saw them. 1
    pub outages_per_flight: f64,
    /// Time without link per flight, as the link monitor saw it. s
    pub down_s_per_flight: f64,
    /// Failures of the solvers, all flights together.
    pub solvers: SolverCounts,
    /// Each flight, in the order of the seeds.
    pub flights: Vec<FlightRow>,
}

/// Figures of many flights by one source of poses.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct FlightSpread {
    /// Quartiles of the time from first to last target over all flights; without finish it is the time limit, 120 s
    /// or of a long mission more. s
    pub finish_quartiles_s: [f64; 3],
    /// Quartiles over flights of the time from entering the reach of the first target. s
    pub since_entry_quartiles_s: [f64; 3],
    /// Horizontal distance to the outline, all samples of all flights: median, 95 %, largest. m
    pub pooled_distance_m: [f64; 3],
    /// Medians over flights of the flights' median, 95 % quantile and largest distance. m
    pub flight_distance_m: [f64; 3],
    /// Fraction of all flights that finish and stay within 0.3 m of the outline. 1
    pub within_valid_distance: f64,
    /// Overshoot over all corners of all flights: median, 90 %; null without corners. m
    pub overshoot_m: Option<[f64; 2]>,
    /// Median over flights of the median speed. m/s
    pub speed_median_mps: f64,
    /// Median over flights of the median stick norm. 1
    pub input_norm_median: f64,
}

/// Hovers, each figure as median over flights and worst flight.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct HoverSpread {
    /// Position error, RMS. m
    pub position_rms_m: [f64; 2],
    /// Its horizontal part. m
    pub horizontal_rms_m: [f64; 2],
    /// Mean height above the target; the worst is the one furthest from zero. m
    pub height_mean_m: [f64; 2],
    /// Height above the target, RMS. m
    pub height_rms_m: [f64; 2],
    /// Heading error, RMS. rad
    pub heading_rms_rad: [f64; 2],
}

impl Batch {
    /// The table of `flown`.
    pub fn of(flown: &[Flown]) -> Self {
        let flights: Vec<FlightRow> = flown.iter().map(|flown| flown.row.clone()).collect();
        let count = |ending| flights.iter().filter(|flight| flight.ending == ending).count();
        let fences = || flights.iter().map(|flight| flight.fence);
        let outside = fences().filter(|fence| fence.distance_m.max(fence.height_m) > FENCE_M);
        let per_flight = |figure: fn(&Outages) -> f64| {
            flights.iter().map(|flight| figure(&flight.outages)).sum::<f64>() / flights.len() as f64
        };
        let hovers: Vec<HoverScore> = flights.iter().filter_map(|flight| flight.hover).collect();
        Self {
            flights_count: flights.len(),
            finished_count: count(Ending::Finished),
            finished_interval: rate_interval(count(Ending::Finished), flights.len()),
            missed_count: count(Ending::Missed),
            landed_count: count(Ending::Landed),
            landed_by: faults_of(&flights),
            unfinished_count: count(Ending::TimeLimit),
            by_truth: FlightSpread::of(flown, |row| row.by_truth.as_ref(), source::TRUTH),
            by_estimate: FlightSpread::of(flown, |row| row.by_estimate.as_ref(), source::ESTIMATE),
            laps: Laps::of(flown),
            hover: HoverSpread::of(&hovers),
            fence_distance_m: fences().map(|fence| fence.distance_m).fold(0.0, maximum),
            fence_height_m: fences().map(|fence| fence.height_m).fold(0.0, maximum),
            outside_fence: outside.count() as f64 / flights.len() as f64,
            clearance: flights.iter().fold(LeastClearance::default(), |mut least, flight| {
                least.add(flight.clearance);
                least
            }),
            outages_per_flight: per_flight(|outages| outages.count as f64),
            down_s_per_flight: per_flight(|outages| outages.down_s),
            solvers: flights
                .iter()
                .fold(SolverCounts::default(), |sum, flight| sum.plus(flight.solvers)),
            flights,
        }
    }
}

impl FlightSpread {
    /// The figures of the poses that `pick` chooses, whose distances are the entry `from` of [`Flown::distances_m`].
    fn of(flown: &[Flown], pick: fn(&FlightRow) -> Option<&Score>, from: usize) -> Option<Self> {
        let scores = || flown.iter().filter_map(|flown| pick(&flown.row));
        let quartiles = |time_s: fn(&Score) -> Option<f64>| {
            let time_s = |row| pick(row).and_then(time_s).unwrap_or(row.time_limit_s);
            let times_s: Vec<f64> = flown.iter().map(|flown| time_s(&flown.row)).collect();
            quantiles(&times_s, [0.25, 0.5, 0.75])
        };
        let median =
            |figure: fn(&Score) -> f64| quantile(&scores().map(figure).collect::<Vec<f64>>(), 0.5);
        let pooled: Vec<f64> =
            flown.iter().flat_map(|flown| flown.distances_m[from].iter().copied()).collect();
        let overshoots: Vec<f64> =
            scores().flat_map(|score| score.overshoots_m.iter().copied()).collect();
        Some(Self {
            finish_quartiles_s: quartiles(|score| score.metrics.finish_s)?,
            since_entry_quartiles_s: quartiles(|score| score.since_entry_s)?,
            pooled_distance_m: quantiles(&pooled, [0.5, 0.95, 1.0])?,
            flight_distance_m: [
                median(|score| score.metrics.distance_median_m)?,
                median(|score| score.metrics.distance_p95_m)?,
                median(|score| score.metrics.distance_max_m)?,
            ],
            within_valid_distance: scores().filter(|score| is_valid(score)).count() as f64
                / flown.len() as f64,
            overshoot_m: quantiles(&overshoots, [0.5, 0.9]),
            speed_median_mps: median(|score| score.metrics.speed_median_mps)?,
            input_norm_median: median(|score| score.metrics.input_norm_median)?,
        })
    }
}

/// Whether the thesis counts the flight: finished and never further than 0.3 m from the path.
pub(super) fn is_valid(score: &Score) -> bool {
    score.metrics.finish_s.is_some() && score.metrics.distance_max_m <= VALID_DISTANCE_M
}

impl HoverSpread {
    fn of(scores: &[HoverScore]) -> Option<Self> {
        let spread = |figure: fn(&HoverScore) -> f64| {
            let values: Vec<f64> = scores.iter().map(figure).collect();
            let worst = values.iter().copied().max_by(|a, b| a.abs().total_cmp(&b.abs()))?;
            Some([quantile(&values, 0.5)?, worst])
        };
        Some(Self {
            position_rms_m: spread(|score| score.position_rms_m)?,
            horizontal_rms_m: spread(|score| score.horizontal_rms_m)?,
            height_mean_m: spread(|score| score.height_mean_m)?,
            height_rms_m: spread(|score| score.height_rms_m)?,
            heading_rms_rad: spread(|score| score.heading_rms_rad)?,
        })
    }
}

/// A line of the table: name, unit, digits, figure.
pub(super) type Line = (&'static str, &'static str, usize, fn(&FlightSpread) -> Option<f64>);

/// The table, line by line.
pub(super) const LINES: [Line; 15] = [
    ("finish", "s, median", 2, |spread| Some(spread.finish_quartiles_s[quartile::MEDIAN])),
    ("", "s, lower quartile", 2, |spread| Some(spread.finish_quartiles_s[quartile::LOWER])),
    ("", "s, upper quartile", 2, |spread| Some(spread.finish_quartiles_s[quartile::UPPER])),
    ("since entry", "s, median", 2, |spread| {
        Some(spread.since_entry_quartiles_s[quartile::MEDIAN])
    }),
    ("2-D distance", "m, median of all samples", 3, |spread| {
        Some(spread.pooled_distance_m[figure::MEDIAN])
    }),
    ("", "m, 95 %", 3, |spread| Some(spread.pooled_distance_m[figure::HIGH])),
    ("", "m, largest", 3, |spread| Some(spread.pooled_distance_m[figure::LARGEST])),
    ("  median flight", "m, median", 3, |spread| Some(spread.flight_distance_m[figure::MEDIAN])),
    ("", "m, 95 %", 3, |spread| Some(spread.flight_distance_m[figure::HIGH])),
    ("", "m, largest", 3, |spread| Some(spread.flight_distance_m[figure::LARGEST])),
    ("within 0.3 m", "of all flights", 3, |spread| Some(spread.within_valid_distance)),
    ("overshoot", "m, median", 3, |spread| Some(spread.overshoot_m?[figure::MEDIAN])),
    ("", "m, 90 %", 3, |spread| Some(spread.overshoot_m?[figure::HIGH])),
    ("speed", "m/s, median", 3, |spread| Some(spread.speed_median_mps)),
    ("stick norm", "median", 3, |spread| Some(spread.input_norm_median)),
];

impl Display for Batch {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.write_counts(f)?;
        if let Some(hover) = &self.hover {
            write!(f, "{hover}")?;
        } else if let (Some(truth), Some(estimate)) = (&self.by_truth, &self.by_estimate) {
            writeln!(f, "{:<18} {:>9} {:>12}", "", "by truth", "by estimate")?;
            for (name, unit, digits, pick) in LINES {
                if let (Some(truth), Some(estimate)) = (pick(truth), pick(estimate)) {
                    writeln!(f, "{name:<18} {truth:>9.digits$} {estimate:>12.digits$}  {unit}")?;
                }
            }
        } else {
            writeln!(
                f,
                "no flight is judged: none reached its first target, or none hovered until its end"
            )?;
        }
        write!(f, "{}", self.laps)?;
        let Self { fence_distance_m, fence_height_m, outside_fence, .. } = self;
        self.write_clearance(f)?;
        let Self { outages_per_flight, down_s_per_flight, .. } = self;
        writeln!(
            f,
            "{:<18} {outside_fence:.3} of all flights beyond {FENCE_M} m; largest \
             {fence_distance_m:.3} m aside, {fence_height_m:.3} m up or down",
            "fence"
        )?;
        writeln!(
            f,
            "{:<18} noticed to be down {outages_per_flight:.2} times and {down_s_per_flight:.2} s per flight",
            "link"
        )?;
        let SolverCounts { ticks, estimator_failures, controller_failures, old_plans } =
            self.solvers;
        writeln!(
            f,
            "{:<18} in {ticks} ticks the estimator failed {estimator_failures}, the controller \
             {controller_failures} times; {old_plans} flew an older plan",
            "solvers"
        )
    }
}

/// The faults that ended flights, and how many.
fn faults_of(flights: &[FlightRow]) -> BTreeMap<Fault, usize> {
    let mut counts = BTreeMap::new();
    for fault in flights.iter().flat_map(|row| &row.landed_by) {
        *counts.entry(*fault).or_default() += 1;
    }
    counts
}

impl Batch {
    /// The least distances to walls and obstacles, of flights that come near one.
    fn write_clearance(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let LeastClearance { wall_m, obstacle_m } = self.clearance;
        let mut named = "clearance";
        for (what, least_m) in [("a wall", wall_m), ("an obstacle", obstacle_m)] {
            if let Some(least_m) = least_m.filter(|least_m| *least_m < CLEARANCE_M) {
                writeln!(f, "{named:<18} {least_m:.3} m to {what} at least, of all flights")?;
                named = "";
            }
        }
        Ok(())
    }

    /// How many flights there were and how they ended, in one line.
    pub(super) fn write_counts(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<18} {}: {} finished, {} missed a target, {} landed early, {} not done after \
             {} s",
            "flights",
            self.flights_count,
            self.finished_count,
            self.missed_count,
            self.landed_count,
            self.unfinished_count,
            self.flights.first().map_or(TIME_LIMIT_S, |row| row.time_limit_s)
        )?;
        let [low, high] = self.finished_interval;
        writeln!(f, "{:<18} {low:.4} to {high:.4} of such flights finish (95 %, Wilson)", "")?;
        for (fault, count) in &self.landed_by {
            writeln!(f, "{:<18} {count} landed early", fault.name())?;
        }
        Ok(())
    }
}

impl Display for HoverSpread {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<18} {:>9} {:>12}", "", "median", "worst")?;
        for (name, unit, [median, worst]) in [
            ("position error", "m, RMS", self.position_rms_m),
            ("  horizontal", "m, RMS", self.horizontal_rms_m),
            ("height", "m, mean", self.height_mean_m),
            ("", "m, RMS", self.height_rms_m),
            ("heading error", "rad, RMS", self.heading_rms_rad),
        ] {
            writeln!(f, "{name:<18} {median:>9.4} {worst:>12.4}  {unit}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
