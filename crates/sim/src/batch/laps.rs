//! Statistics of the laps of many flights, lap by lap: whether a flight's learning improves its later laps.

use std::fmt::{self, Display, Formatter};

use schemars::JsonSchema;
use serde::Serialize;
use tello_eval::metrics::{Score, VALID_DISTANCE_M};
use tello_eval::{quantile, quantiles};

use super::flight::{Flown, source};
use crate::DT_S;

/// One lap of all flights that began it, by the true pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct LapSpread {
    /// Flights that began the lap.
    pub flights_count: usize,
    /// Time in it, median. s
    pub lasted_s: f64,
    /// Horizontal distance to the outline, all samples of the lap: median, 95 %, largest. m
    pub pooled_distance_m: [f64; 3],
    /// Fraction of these flights that stay within 0.3 m of the outline in this lap. 1
    pub within_valid_distance: f64,
}

/// The laps of a batch; none of a way that is flown once.
#[derive(Debug, Clone, PartialEq, Default, Serialize, JsonSchema)]
#[serde(transparent)]
pub struct Laps(pub Vec<LapSpread>);

impl Laps {
    pub(super) fn of(flown: &[Flown]) -> Self {
        let count = flown.iter().filter_map(score).map(|score| score.laps.len()).max();
        Self((0..count.unwrap_or(0)).filter_map(|lap| LapSpread::of(flown, lap)).collect())
    }
}

fn score(flown: &Flown) -> Option<&Score> {
    flown.row.by_truth.as_ref()
}

impl LapSpread {
    /// Lap `lap`, from 0; `None` if no flight began it.
    fn of(flown: &[Flown], lap: usize) -> Option<Self> {
        let scores = flown.iter().filter_map(|flown| Some((flown, score(flown)?)));
        let begun = || {
            scores.clone().filter_map(|(flown, score)| Some((flown, score, score.laps.get(lap)?)))
        };
        let lasted_s: Vec<f64> = begun().map(|(.., lap)| lap.lasted_s).collect();
        let pooled: Vec<f64> = begun()
            .flat_map(|(flown, score, _)| {
                let ticks = |laps: &[tello_eval::metrics::Lap]| {
                    ticks(laps.iter().map(|lap| lap.lasted_s).sum())
                };
                let begin = ticks(&score.laps[..lap]);
                let end = ticks(&score.laps[..=lap]);
                flown.distances_m[source::TRUTH].get(begin..end).unwrap_or_default().iter().copied()
            })
            .collect();
        let valid = begun().filter(|(.., lap)| lap.distance_max_m <= VALID_DISTANCE_M).count();
        Some(Self {
            flights_count: lasted_s.len(),
            lasted_s: quantile(&lasted_s, 0.5)?,
            pooled_distance_m: quantiles(&pooled, [0.5, 0.95, 1.0])?,
            within_valid_distance: valid as f64 / lasted_s.len() as f64,
        })
    }
}

/// Ticks in `lasted_s`, a whole number of them.
fn ticks(lasted_s: f64) -> usize {
    horizon_model::steps(lasted_s, DT_S)
}

impl Display for Laps {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for (lap, spread) in (1..).zip(&self.0) {
            let LapSpread { lasted_s, pooled_distance_m: [p50, p95, max], .. } = spread;
            writeln!(
                f,
                "{:<18} {lasted_s:>9.2} s; 2-D distance {p50:.3} m median, {p95:.3} 95 %, {max:.3} \
                 largest; {:.3} of {} flights within {VALID_DISTANCE_M} m",
                format!("lap {lap}"),
                spread.within_valid_distance,
                spread.flights_count
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use tello_eval::metrics::Lap;

    use super::*;

    /// A flight whose laps last `lasted_s` each, `distance_m` from the outline throughout a lap.
    fn flown(lasted_s: f64, distances_m: &[f64]) -> Flown {
        let mut flown = Flown::example(Some(20.0), 0.2);
        let lap = |distance_m: &f64| Lap {
            lasted_s,
            distance_median_m: *distance_m,
            distance_p95_m: *distance_m,
            distance_max_m: *distance_m,
        };
        if let Some(score) = &mut flown.row.by_truth {
            score.laps = distances_m.iter().map(lap).collect();
        }
        let samples = |distance_m: &f64| vec![*distance_m; ticks(lasted_s)];
        flown.distances_m[source::TRUTH] = distances_m.iter().flat_map(samples).collect();
        flown
    }

    #[test]
    fn each_lap_pools_the_flights_that_began_it() {
        let mut lost = flown(1.0, &[]);
        lost.row.by_truth = None;
        let Laps(laps) = Laps::of(&[flown(1.0, &[0.1, 0.4]), flown(3.0, &[0.2]), lost]);
        let counts: Vec<usize> = laps.iter().map(|lap| lap.flights_count).collect();
        assert_eq!(counts, [2, 1]);
        assert!((laps[0].lasted_s - 2.0).abs() < 1e-12, "{:?}", laps[0]);
        // Three quarters of the samples of the first lap are those of the slower flight.
        for (lap, expected_m) in laps.iter().zip([0.2, 0.4]) {
            let is_near = |found_m: &f64| (found_m - expected_m).abs() < 1e-12;
            assert!(lap.pooled_distance_m.iter().all(is_near), "{lap:?}");
        }
        let within = laps.iter().map(|lap| lap.within_valid_distance);
        assert_eq!(within.collect::<Vec<f64>>(), [1.0, 0.0]);
        assert_eq!(Laps(laps).to_string().lines().count(), 2);
        assert_eq!(Laps::of(&[flown(1.0, &[])]), Laps::default());
    }
}
