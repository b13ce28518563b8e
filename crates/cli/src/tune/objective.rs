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
