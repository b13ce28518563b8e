//! What better means: one number for a batch of flights.

use std::str::FromStr;

use anyhow::{Context, Result, bail};
use serde::Serialize;
use tello_eval::metrics::VALID_DISTANCE_M;

use crate::batch::{Ending, Flown};

/// The penalties of a flight, in seconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Weights {
    /// For the median horizontal distance to the outline. s/m
    distance: f64,
    /// For its 95 % quantile. s/m
    distance_p95: f64,
    /// For the mean overshoot past corners. s/m
    overshoot: f64,
    /// For having been further than 0.3 m off. s
    outside: f64,
    /// In place of the time of a flight that does not finish; no time counts more. s
    unfinished: f64,
}

/// 0.025 m of median distance, 0.05 m of its 95 % quantile or 0.05 m of overshoot weigh a second.
const DEFAULT: Weights =
    Weights { distance: 40.0, distance_p95: 20.0, overshoot: 20.0, outside: 5.0, unfinished: 60.0 };

/// Distance or overshoot beyond which a flight is no worse. m
const FAR_M: f64 = 0.5;

/// A weight as written on the command line: `WHAT=NUMBER`.
#[derive(Debug, Clone)]
pub struct WeightArgument {
    of: WeightOf,
    weight: f64,
}

/// The weight of a key.
type WeightOf = fn(&mut Weights) -> &mut f64;

/// Keys of the command line.
const KEYS: [(&str, WeightOf); 5] = [
    ("distance", |weights| &mut weights.distance),
    ("distance_p95", |weights| &mut weights.distance_p95),
    ("overshoot", |weights| &mut weights.overshoot),
    ("outside", |weights| &mut weights.outside),
    ("unfinished", |weights| &mut weights.unfinished),
];

impl FromStr for WeightArgument {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let (name, weight) =
            text.split_once('=').with_context(|| format!("{text:?}: expected WHAT=NUMBER"))?;
        let Some((_, of)) = KEYS.into_iter().find(|(key, _)| *key == name) else {
            bail!("{name:?}: expected distance, distance_p95, overshoot, outside or unfinished")
        };
        let weight: f64 = weight.parse().with_context(|| format!("{weight:?} is no number"))?;
        if !(weight.is_finite() && weight >= 0.0) {
            bail!("{name} = {weight}: expected finite and >= 0");
        }
        Ok(Self { of, weight })
    }
}

impl Weights {
    /// The defaults with what `weigh` replaces.
    pub fn new(weigh: &[WeightArgument]) -> Self {
        let mut weights = DEFAULT;
        for WeightArgument { of, weight } in weigh {
            *of(&mut weights) = *weight;
        }
        weights
    }

    /// Mean cost of at least one flight, by the true pose. s
    ///
    /// The mean, not the median: a flight in a hundred that fails is worth avoiding.
    pub fn cost(&self, flown: &[Flown]) -> f64 {
        flown.iter().map(|flown| self.cost_of(flown)).sum::<f64>() / flown.len() as f64
    }

    /// Cost of one flight. A short one that a fault ended has had no time to go wrong: it and one
    /// that never began cost as much as any flight can.
    fn cost_of(&self, flown: &Flown) -> f64 {
        let begun = flown.row.by_truth.as_ref().filter(|_| flown.row.ending != Ending::Landed);
        let Some(score) = begun else {
            return self.sum(self.unfinished, [FAR_M; 3], true);
        };
        let metrics = &score.metrics;
        let corners = score.overshoots_m.len().max(1) as f64;
        let overshoot_m = score.overshoots_m.iter().sum::<f64>() / corners;
        self.sum(
            score.since_entry_s.unwrap_or(self.unfinished).min(self.unfinished),
            [metrics.distance_median_m, metrics.distance_p95_m, overshoot_m].map(|m| m.min(FAR_M)),
            metrics.distance_max_m > VALID_DISTANCE_M,
        )
    }

    fn sum(&self, time_s: f64, [median_m, p95_m, overshoot_m]: [f64; 3], is_outside: bool) -> f64 {
        time_s
            + self.distance * median_m
            + self.distance_p95 * p95_m
            + self.overshoot * overshoot_m
            + if is_outside { self.outside } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use tello_eval::metrics::{Metrics, Score};

    use super::*;
    use crate::batch::FlightRow;

    /// A flight with three corners that took `time_s` (s), at most `distance_max_m` off; without a time it did not
    /// finish.
    fn flown(time_s: Option<f64>, distance_max_m: f64) -> Flown {
        let metrics = Metrics {
            finish_s: time_s,
            distance_median_m: 0.05,
            distance_p95_m: 0.1,
            distance_max_m,
            speed_median_mps: 0.5,
            input_norm_median: 0.3,
        };
        let overshoots_m = vec![0.1, 0.0, 0.2];
        let score = Score { metrics, since_entry_s: time_s, overshoots_m, laps: Vec::new() };
        let ending = if time_s.is_some() { Ending::Finished } else { Ending::TimeLimit };
        let row = FlightRow { ending, by_truth: Some(score), ..FlightRow::default() };
        Flown { row, ..Flown::default() }
    }

    #[test]
    fn a_flight_costs_what_it_did() {
        // 40 * 0.05 + 20 * 0.1 + 20 * 0.1 beside the time.
        for (flight, expected) in [
            (flown(Some(10.0), 0.25), 16.0),
            (flown(Some(10.0), 0.35), 21.0),
            (flown(None, 0.25), 66.0),
        ] {
            let cost = Weights::new(&[]).cost(std::slice::from_ref(&flight));
            assert!((cost - expected).abs() < 1e-12, "{cost} instead of {expected}: {flight:?}");
        }
        let both = [Some(10.0), None].map(|time_s| flown(time_s, 0.25));
        let both = Weights::new(&[]).cost(&both);
        assert!((both - 41.0).abs() < 1e-12, "{both}");
    }

    #[test]
    fn no_flight_costs_more_than_one_that_never_begins_or_ends_with_a_fault() {
        let cost = |flight: &Flown| Weights::new(&[]).cost(std::slice::from_ref(flight));
        let mut unbegun = flown(None, 0.1);
        unbegun.row.by_truth = None;
        let mut landed = flown(None, 0.1);
        landed.row.ending = Ending::Landed;
        // 60 + (40 + 20 + 20) * 0.5 + 5.
        for flight in [&unbegun, &landed] {
            assert!((cost(flight) - 105.0).abs() < 1e-12, "{}: {flight:?}", cost(flight));
        }
        let mut worst = flown(Some(119.0), 9.0);
        if let Some(score) = &mut worst.row.by_truth {
            (score.metrics.distance_median_m, score.metrics.distance_p95_m) = (7.0, 8.0);
            score.overshoots_m = vec![6.0];
        }
        assert!(cost(&worst) <= cost(&unbegun), "{} above {}", cost(&worst), cost(&unbegun));
    }

    #[test]
    fn weights_of_the_command_line_replace_the_defaults() {
        let weigh: Vec<WeightArgument> =
            ["distance=0", "outside=7"].map(|text| text.parse().unwrap()).to_vec();
        let expected = Weights { distance: 0.0, outside: 7.0, ..DEFAULT };
        assert_eq!(Weights::new(&weigh), expected);
        for (text, reason) in [
            ("speed=1", "expected distance"),
            ("distance", "expected WHAT=NUMBER"),
            ("outside=-1", "finite and >= 0"),
        ] {
            let error = text.parse::<WeightArgument>().unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
    }
}
