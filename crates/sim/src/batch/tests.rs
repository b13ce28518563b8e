//! Flights turned around and settings that are ignored; a flown flight, for the tests of what reads batches.

use tello_eval::metrics::{Metrics, Score};

use super::flight::TIME_LIMIT_S;
use super::{Ending, FlightRow, Flown, by_contender, ignored};

impl Flown {
    /// A flight with three corners that took `since_entry_s` (s), at most `distance_max_m` off; without a time it did
    /// not finish.
    pub(crate) fn example(since_entry_s: Option<f64>, distance_max_m: f64) -> Self {
        let metrics = Metrics {
            finish_s: since_entry_s,
            distance_median_m: 0.05,
            distance_p95_m: 0.1,
            distance_max_m,
            speed_median_mps: 0.5,
            input_norm_median: 0.3,
        };
        let score =
            Score { metrics, since_entry_s, overshoots_m: vec![0.1, 0.0, 0.2], laps: Vec::new() };
        let row = FlightRow {
            seed: 1,
            ending: if since_entry_s.is_some() { Ending::Finished } else { Ending::TimeLimit },
            time_limit_s: TIME_LIMIT_S,
            by_truth: Some(score),
            ..FlightRow::default()
        };
        Self { row, distances_m: [vec![0.05], vec![]], ..Self::default() }
    }
}

#[test]
fn what_counts_over_sockets_alone_is_named() {
    let mut sim = crate::settings(None).unwrap();
    assert_eq!(ignored(&sim).unwrap(), [""; 0]);
    sim.drone.air.loss = 0.5;
    sim.start = crate::SimStart::Ground { x: 9.0, y: 0.0, theta: 0.0 };
    assert_eq!(ignored(&sim).unwrap(), ["start", "drone.air"]);
}

#[test]
fn flights_by_seed_are_those_by_contender_turned_around() {
    let flown = |finish_s| Flown::example(Some(finish_s), 0.2);
    let by_seed = [10.0, 11.0, 12.0].map(|s| vec![flown(s), flown(s + 10.0)]).to_vec();
    let expected = [10.0, 20.0].map(|s| vec![flown(s), flown(s + 1.0), flown(s + 2.0)]);
    assert_eq!(by_contender(by_seed), expected);
    assert!(by_contender(Vec::new()).is_empty());
}
