//! The flights after an identification: whether what was found flies as well.

use std::fmt::{self, Display, Formatter};

use anyhow::Result;
use schemars::JsonSchema;
use serde::Serialize;
use tello_eval::parameter_file::{ParameterFile, TakesParameters as _};
use tello_eval::quantile;
use tello_flight::Start;
use tello_flight::cycle::FlightTable;

use crate::batch::{Contender, Ending, Flown, source};

/// With identified parameters the distances may be so many times those without. 1
const DISTANCE_RATIO_MAX: f64 = 1.1;

/// Flights of all vehicles of a self-test.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct FlownNext {
    /// How many there are.
    pub flights: usize,
    /// How many finished.
    pub finished: usize,
    /// True horizontal distance to the outline, 95 % of all samples of all flights. m
    pub distance_p95_m: f64,
}

/// Flights of the vehicle of `seed` with the parameters of `flight` and with those of `file`.
///
/// # Errors
/// The flight refuses the parameters.
pub(super) fn fly(flight: &FlightTable, file: &ParameterFile, seed: u64) -> Result<[Flown; 2]> {
    let sim = crate::settings(None)?;
    let flight = FlightTable { start: Start::Airborne, ..flight.clone() };
    let mut identified = flight.clone();
    identified.cycle.take(file)?;
    let fly = |flight| Contender::new(flight, None)?.fly(&sim, seed);
    Ok([fly(flight)?, fly(identified)?])
}

impl FlownNext {
    /// The sum of `flown`; `None` without flights.
    pub(super) fn of<'a>(flown: impl Iterator<Item = &'a Flown> + Clone) -> Option<Self> {
        let distances_m: Vec<f64> = flown
            .clone()
            .flat_map(|flown| flown.distances_m[source::TRUTH].iter().copied())
            .collect();
        let is_finished = |flown: &&Flown| flown.row.ending == Ending::Finished;
        Some(Self {
            flights: flown.clone().count(),
            finished: flown.filter(is_finished).count(),
            distance_p95_m: quantile(&distances_m, 0.95)?,
        })
    }

    /// Whether these flights are as good as `others`.
    pub(super) fn is_as_good_as(&self, others: &Self) -> bool {
        self.finished >= others.finished
            && self.distance_p95_m <= DISTANCE_RATIO_MAX * others.distance_p95_m
    }
}

impl Display for FlownNext {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self { flights, finished, distance_p95_m } = self;
        write!(f, "{finished} of {flights} flights finished, 95 % within {distance_p95_m:.3} m")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flown(finish_s: Option<f64>, distances_m: &[f64]) -> Flown {
        let mut flown = Flown::example(finish_s, 0.2);
        flown.distances_m = [distances_m.to_vec(), vec![9.0]];
        flown
    }

    #[test]
    fn flights_are_summed_by_their_endings_and_true_distances() {
        let flown = [flown(Some(9.0), &[0.0, 0.1]), flown(None, &[0.2]), flown(Some(8.0), &[0.3])];
        let found = FlownNext::of(flown.iter()).unwrap();
        assert_eq!((found.flights, found.finished), (3, 2));
        let p95_m = quantile(&[0.0, 0.1, 0.2, 0.3], 0.95).unwrap();
        assert!((found.distance_p95_m - p95_m).abs() < 1e-12, "{found}");
        assert_eq!(FlownNext::of([].iter()), None);
    }

    #[test]
    fn as_good_means_no_fewer_finished_and_hardly_further_away() {
        let of = |finished, distance_p95_m| FlownNext { flights: 9, finished, distance_p95_m };
        let before = of(8, 0.1);
        for (after, is_as_good) in [
            (of(8, 0.1), true),
            (of(9, 0.109), true),
            (of(9, 0.111), false),
            (of(7, 0.05), false),
            (of(8, f64::NAN), false),
        ] {
            assert_eq!(after.is_as_good_as(&before), is_as_good, "{after}");
        }
    }
}
