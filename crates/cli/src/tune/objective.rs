//! What better means: one number for a batch of flights.

use std::str::FromStr;

use anyhow::{Context, Result, bail};
use serde::Serialize;

use crate::batch::Flown;
use crate::metrics::VALID_DISTANCE_M;

/// What a flight is charged, in seconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Weights {
    /// For the median horizontal distance to the outline. s/m
    distance: f64,
    /// For its 95 % quantile. s/m
    distance_p95: f64,
    /// For the mean overshoot past corners. s/m
    overshoot: f64,
    /// For having been further than 0.3 m off. s
    outside: f64,
    /// In place of the time of a flight that does not finish. s
    unfinished: f64,
}

/// 0.025 m of median distance, 0.05 m of its 95 % quantile or 0.05 m of overshoot weigh a second.
const DEFAULT: Weights =
    Weights { distance: 40.0, distance_p95: 20.0, overshoot: 20.0, outside: 5.0, unfinished: 60.0 };

/// A weight of the command line.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Weigh {
    what: What,
    weight: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum What {
    Distance,
    DistanceP95,
    Overshoot,
    Outside,
    Unfinished,
}

impl FromStr for Weigh {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let (name, weight) = text.split_once('=').context("no `=`: WHAT=NUMBER")?;
        let what = match name {
            "distance" => What::Distance,
            "distance_p95" => What::DistanceP95,
            "overshoot" => What::Overshoot,
            "outside" => What::Outside,
            "unfinished" => What::Unfinished,
            _ => bail!(
                "{name:?} has no weight: distance, distance_p95, overshoot, outside or unfinished"
            ),
        };
        let weight: f64 = weight.parse().with_context(|| format!("{weight:?} is no number"))?;
        if !(weight.is_finite() && weight >= 0.0) {
            bail!("{name} = {weight} violates finite and >= 0");
        }
        Ok(Self { what, weight })
    }
}

impl Weights {
    /// The defaults with what `weigh` replaces.
    pub(super) fn new(weigh: &[Weigh]) -> Self {
        let mut weights = DEFAULT;
        for Weigh { what, weight } in weigh {
            *match what {
                What::Distance => &mut weights.distance,
                What::DistanceP95 => &mut weights.distance_p95,
                What::Overshoot => &mut weights.overshoot,
                What::Outside => &mut weights.outside,
                What::Unfinished => &mut weights.unfinished,
            } = *weight;
        }
        weights
    }

    /// Mean charge of at least one flight, by the true pose. s
    ///
    /// The mean, not the median: a flight in a hundred that fails is worth avoiding.
    pub(super) fn cost(&self, flown: &[Flown]) -> f64 {
        flown.iter().map(|flown| self.charge(flown)).sum::<f64>() / flown.len() as f64
    }

    fn charge(&self, flown: &Flown) -> f64 {
        let Some(score) = &flown.row.by_truth else { return self.unfinished };
        let metrics = &score.metrics;
        let corners = score.overshoots_m.len().max(1) as f64;
        let overshoot_m = score.overshoots_m.iter().sum::<f64>() / corners;
        let is_outside = metrics.distance_max_m > VALID_DISTANCE_M;
        score.since_entry_s.unwrap_or(self.unfinished)
            + self.distance * metrics.distance_median_m
            + self.distance_p95 * metrics.distance_p95_m
            + self.overshoot * overshoot_m
            + if is_outside { self.outside } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::{Ending, FlightRow, SolverCounts};
    use crate::metrics::{Fence, Metrics, Score};

    fn flown(since_entry_s: Option<f64>, distance_max_m: f64) -> Flown {
        let metrics = Metrics {
            finish_s: since_entry_s,
            distance_median_m: 0.05,
            distance_p95_m: 0.1,
            distance_max_m,
            speed_median_m_s: 0.5,
            input_norm_median: 0.3,
        };
        let score = Score { metrics, since_entry_s, overshoots_m: vec![0.1, 0.0, 0.2] };
        let row = FlightRow {
            seed: 1,
            ending: Ending::Finished,
            by_truth: Some(score),
            by_estimate: None,
            fence: Fence::default(),
            hover: None,
            solvers: SolverCounts::default(),
        };
        Flown { row, distances_m: [vec![], vec![]], track_w: vec![] }
    }

    #[test]
    fn a_flight_is_charged_for_what_it_did() {
        // 40 * 0.05 + 20 * 0.1 + 20 * 0.1 beside the time.
        for (flight, charge) in [
            (flown(Some(10.0), 0.25), 16.0),
            (flown(Some(10.0), 0.35), 21.0),
            (flown(None, 0.25), 66.0),
        ] {
            let cost = Weights::new(&[]).cost(&[flight.clone()]);
            assert!((cost - charge).abs() < 1e-12, "{cost} instead of {charge}: {flight:?}");
        }
        let both = Weights::new(&[]).cost(&[flown(Some(10.0), 0.25), flown(None, 0.25)]);
        assert!((both - 41.0).abs() < 1e-12, "{both}");
        let mut unbegun = flown(None, 0.1);
        unbegun.row.by_truth = None;
        assert!((Weights::new(&[]).cost(&[unbegun]) - 60.0).abs() < 1e-12);
    }

    #[test]
    fn weights_of_the_command_line_replace_the_defaults() {
        let weigh: Vec<Weigh> =
            ["distance=0", "outside=7"].map(|text| text.parse().unwrap()).to_vec();
        let expected = Weights { distance: 0.0, outside: 7.0, ..DEFAULT };
        assert_eq!(Weights::new(&weigh), expected);
        for (text, reason) in [
            ("speed=1", "has no weight"),
            ("distance", "no `=`"),
            ("outside=-1", "finite and >= 0"),
        ] {
            let error = text.parse::<Weigh>().unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
    }
}
