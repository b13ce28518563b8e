//! Quantities of a flight, and their statistics over many flights.
//!
//! Owns the definitions, in words and in code. The definitions are those that give the thesis' published
//! numbers on the thesis' flights, where the text and the numbers agree.

use std::collections::BTreeMap;

use horizon_model::rows::pose;
use schemars::JsonSchema;
use serde::Serialize;
use strum::{IntoStaticStr, VariantArray};

use super::flight::Flight;
use crate::metrics::{Corner, PathProgress, horizontal, offset};
use crate::quantile;

/// One number per sample, corner or flight.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Serialize,
    JsonSchema,
    IntoStaticStr,
    VariantArray,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub(super) enum Quantity {
    FinishS,
    SpeedMps,
    DistanceM,
    #[serde(rename = "distance_4d")]
    #[strum(serialize = "distance_4d")]
    Distance4d,
    InputNorm,
    OvershootM,
    SolveMs,
    LateMs,
    MocapAgeMs,
}

/// Quantiles of a quantity in its unit, linear between order statistics.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub(super) struct Spread {
    /// How many numbers there are.
    pub count: usize,
    /// Lower quartile. Unit of the quantity
    pub q25: f64,
    /// Median. Unit of the quantity
    pub median: f64,
    /// Upper quartile. Unit of the quantity
    pub q75: f64,
    /// Quantile at 90 %. Unit of the quantity
    pub p90: f64,
    /// Quantile at 95 %. Unit of the quantity
    pub p95: f64,
    /// The largest. Unit of the quantity
    pub max: f64,
}

/// All numbers of one flight or of many.
pub(super) type Numbers = BTreeMap<Quantity, Vec<f64>>;

/// Quantiles of each quantity of which there is a number.
pub(super) type Spreads = BTreeMap<Quantity, Spread>;

/// A number that stands for a flight: of which quantity, which key of its [`Spread`].
pub(super) type OfFlight = (Quantity, &'static str, fn(&Spread) -> f64);

/// The numbers by which flights are distinguished.
pub(super) const OF_FLIGHT: [OfFlight; 7] = [
    (Quantity::FinishS, "median", |spread| spread.median),
    (Quantity::DistanceM, "median", |spread| spread.median),
    (Quantity::DistanceM, "max", |spread| spread.max),
    (Quantity::OvershootM, "max", |spread| spread.max),
    (Quantity::SpeedMps, "median", |spread| spread.median),
    (Quantity::InputNorm, "median", |spread| spread.median),
    (Quantity::SolveMs, "median", |spread| spread.median),
];

/// Measured quantities of one flight.
#[derive(Debug, Clone, Default)]
pub(super) struct Measured {
    pub numbers: Numbers,
    /// Progress along the line of each sample; empty without a line. 1, 0..=1
    pub progress: Vec<f64>,
    /// Norm of the sticks at each of these samples; NaN without any. 1
    pub input_norm: Vec<f64>,
    /// When the horizontal distance was largest. s
    pub farthest_s: f64,
}

impl Quantity {
    pub(super) const ALL: &[Self] = Self::VARIANTS;

    /// Its key in JSON.
    pub(super) fn key(self) -> &'static str {
        self.into()
    }

    /// Name, unit and digits behind the point.
    pub(super) fn label(self) -> (&'static str, &'static str, usize) {
        match self {
            Self::FinishS => ("time to finish", "s", 2),
            Self::SpeedMps => ("speed", "m/s", 3),
            Self::DistanceM => ("distance, horizontal", "m", 4),
            Self::Distance4d => ("distance, x y z theta", "m, rad", 4),
            Self::InputNorm => ("input norm", "1", 3),
            Self::OvershootM => ("overshoot at corners", "m", 3),
            Self::SolveMs => ("estimator and controller", "ms", 2),
            Self::LateMs => ("tick begins late", "ms", 2),
            Self::MocapAgeMs => ("age of the mocap sample", "ms", 1),
        }
    }

    /// Definition of the quantity.
    pub(super) fn definition(self) -> &'static str {
        match self {
            Self::FinishS => {
                "From the tick in which the first target is reached to the tick in which the last is, both \
                 included, one period each. Only flights that reached every target, none of it by hand, whose log lacks no \
                 tick; one number per flight."
            }
            Self::SpeedMps => {
                "Norm of the difference of two successive poses over x, y and z, by the time between them. All \
                 samples of all flights."
            }
            Self::DistanceM => {
                "Horizontal distance to the line, as `fly` prints it. All samples of all flights. The thesis took the \
                 nearest of points 0.02 m apart on the line: up to 0.01 m more on the line, 0.0005 m more beside it at \
                 0.1 m."
            }
            Self::Distance4d => {
                "Norm of the difference over x, y, z [m] and theta [rad] to the horizontally nearest of ceil(length / \
                 0.02 m) points on each side of the line. It is this number that the thesis quotes as its distance of \
                 0.14 m."
            }
            Self::InputNorm => {
                "Norm of the four sticks that were sent, each in -1..1. All samples of all flights. The thesis \
                 quotes 0.48, which is the median progress of its samples and no input."
            }
            Self::OvershootM => {
                "Longest way beyond a corner along the incoming side before the next target is 0.25 m away. One \
                 number per corner that turns by a right angle or more."
            }
            Self::SolveMs => "Time of estimator and controller together, each tick.",
            Self::LateMs => "From when a tick was due to when it began.",
            Self::MocapAgeMs => {
                "From when the newest mocap sample of a tick was measured to the begin of the tick."
            }
        }
    }
}

impl Spread {
    /// `None` without values.
    pub(super) fn of(values: &[f64]) -> Option<Self> {
        let at = |fraction| quantile(values, fraction);
        Some(Self {
            count: values.len(),
            q25: at(0.25)?,
            median: at(0.5)?,
            q75: at(0.75)?,
            p90: at(0.9)?,
            p95: at(0.95)?,
            max: at(1.0)?,
        })
    }
}

/// The quantiles of `numbers`.
pub(super) fn spreads(numbers: &Numbers) -> Spreads {
    let spread =
        |(quantity, values): (&Quantity, &Vec<f64>)| Some((*quantity, Spread::of(values)?));
    numbers.iter().filter_map(spread).collect()
}

impl Measured {
    /// Measures the judged ticks of `flight`.
    pub(super) fn of(flight: &Flight) -> Self {
        let mut measured = Self::default();
        measured.motion(flight);
        measured.line(flight);
        measured.times(flight);
        let [_, targets_count] = flight.reached;
        // At its only target a flight begins and ends.
        if flight.is_finished() && flight.is_measurable() && targets_count > 1 {
            let ticks = flight.judged_ticks();
            if let (Some(first), Some(last)) = (ticks.first(), ticks.last()) {
                let finish_s = flight.time_s(last) - flight.time_s(first) + flight.dt_s;
                measured.numbers.insert(Quantity::FinishS, vec![finish_s]);
            }
        }
        measured
    }

    fn add(&mut self, quantity: Quantity, values: impl Iterator<Item = f64>) {
        self.numbers.entry(quantity).or_default().extend(values);
    }

    fn motion(&mut self, flight: &Flight) {
        let ticks = flight.judged_ticks();
        let poses: Vec<_> =
            ticks.iter().filter_map(|tick| Some((flight.time_s(tick), tick.estimate?))).collect();
        let speed = poses.windows(2).filter_map(|pair| {
            let [(before_s, from), (now_s, to)] = pair else { return None };
            Some((to - from).fixed_rows::<3>(pose::X).norm() / (now_s - before_s))
        });
        self.add(Quantity::SpeedMps, speed);
        let sticks = ticks.iter().filter_map(|tick| tick.u_sent);
        self.add(Quantity::InputNorm, sticks.map(|u| u.norm()));
    }

    fn line(&mut self, flight: &Flight) {
        if flight.outline.is_empty() {
            return;
        }
        // A hover has a place to be at and no path.
        let path = PathProgress::new(&flight.outline);
        let mut corners = flight.corners.clone();
        let (mut distances_m, mut distances_4d) = (Vec::new(), Vec::new());
        let mut farthest = (0.0, 0.0);
        for tick in flight.judged_ticks() {
            let Some(at) = tick.estimate else { continue };
            let distance_m = offset(&flight.outline, &at).distance_m;
            if distance_m > farthest.0 {
                farthest = (distance_m, flight.time_s(tick));
            }
            distances_m.push(distance_m);
            if let Some(place) = path.as_ref().map(|path| path.place(&at)) {
                self.progress.push(place.progress);
                self.input_norm.push(tick.u_sent.map_or(f64::NAN, |u| u.norm()));
                distances_4d.push(place.distance_4d);
            }
            for corner in &mut corners {
                corner.pass(&horizontal(&at), tick.targets_reached);
            }
        }
        let [reached, _] = flight.reached;
        let passed = corners.iter().filter(|corner| corner.is_reached(reached));
        self.add(Quantity::OvershootM, passed.map(Corner::overshoot_m));
        self.add(Quantity::DistanceM, distances_m.into_iter());
        self.add(Quantity::Distance4d, distances_4d.into_iter());
        self.farthest_s = farthest.1;
    }

    /// Times of the loop; a flight in virtual time has none.
    fn times(&mut self, flight: &Flight) {
        let ticks = flight.judged_ticks();
        let timings =
            ticks.iter().filter_map(|tick| tick.timing).filter(|timing| timing.tick_ns > 0);
        let timings: Vec<_> = timings.collect();
        if timings.is_empty() {
            return;
        }
        let ms = |ns: i64| ns as f64 * 1e-6;
        self.add(Quantity::SolveMs, timings.iter().map(|t| ms(t.estimate_ns + t.plan_ns)));
        self.add(Quantity::LateMs, timings.iter().map(|t| ms(t.late_ns)));
        let ages = ticks.iter().filter_map(|tick| tick.mocap_age_s);
        self.add(Quantity::MocapAgeMs, ages.map(|age_s| age_s * 1e3));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_key_of_a_quantity_is_its_name_in_json() {
        for &quantity in Quantity::ALL {
            let json = serde_json::to_value(quantity).unwrap();
            assert_eq!(json, quantity.key());
        }
    }
}
