//! Results by family of faults.

use std::fmt::{self, Formatter};

use clap::ValueEnum;
use horizon_model::check::maximum;
use schemars::JsonSchema;
use serde::Serialize;
use tello_eval::quantile;

use super::CampaignRow;
use super::family::Family;
use super::judge::MeasuredReaction;

/// The flights with a family. With several families in a flight its reaction counts for each of them;
/// `--family` measures one alone.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct FamilyRow {
    family: Family,
    flights: usize,
    /// Flights in which the first fault could be observed while the vehicle flew.
    observable: usize,
    /// Observable flights in which the program reported a fault afterwards.
    detected: usize,
    /// Observable flights in which a landing was ordered before the mission was over.
    landed: usize,
    /// Until neutral sticks, for those detected: median and largest. s
    neutral_s: Option<[f64; 2]>,
    /// Until the order to land, for those landed: median and largest. s
    land_s: Option<[f64; 2]>,
    /// Way of the true vehicle from where the fault could be observed: median and largest. m
    travelled_m: Option<[f64; 2]>,
    /// Furthest outside of the room, whether the drone executed its orders or not. m
    outside_m: f64,
    /// Flights that did what none may do.
    violations: usize,
}

/// A row for each family that was drawn.
pub(super) fn rows(flights: &[CampaignRow]) -> Vec<FamilyRow> {
    let of = |family: &Family| -> Option<FamilyRow> {
        let with: Vec<&CampaignRow> =
            flights.iter().filter(|flight| flight.families.contains(family)).collect();
        (!with.is_empty()).then(|| row(*family, &with))
    };
    Family::value_variants().iter().filter_map(of).collect()
}

fn row(family: Family, flights: &[&CampaignRow]) -> FamilyRow {
    let reactions: Vec<&MeasuredReaction> =
        flights.iter().filter_map(|flight| flight.reaction.as_ref()).collect();
    let detected = || reactions.iter().filter(|reaction| reaction.detected_s.is_some());
    let landed: Vec<f64> = reactions
        .iter()
        .filter(|reaction| !reaction.is_mission_over)
        .filter_map(|reaction| reaction.land_s)
        .collect();
    let neutral: Vec<f64> = detected().filter_map(|reaction| reaction.neutral_s).collect();
    let travelled: Vec<f64> = reactions.iter().map(|reaction| reaction.travelled_m).collect();
    let outside = reactions.iter().map(|reaction| reaction.outside_m);
    FamilyRow {
        family,
        flights: flights.len(),
        observable: reactions.len(),
        detected: detected().count(),
        landed: landed.len(),
        neutral_s: middle_and_end(&neutral),
        land_s: middle_and_end(&landed),
        travelled_m: middle_and_end(&travelled),
        outside_m: outside.fold(0.0, maximum),
        violations: flights.iter().filter(|flight| !flight.violations.is_empty()).count(),
    }
}

fn middle_and_end(values: &[f64]) -> Option<[f64; 2]> {
    Some([quantile(values, 0.5)?, quantile(values, 1.0)?])
}

/// The table.
pub(super) fn write(rows: &[FamilyRow], f: &mut Formatter<'_>) -> fmt::Result {
    writeln!(
        f,
        "{:<20} {:>7} {:>7} {:>8} {:>7} {:>15} {:>15} {:>15} {:>9} {:>5}",
        "family",
        "flights",
        "seen",
        "detected",
        "landed",
        "neutral s",
        "LAND s",
        "way m",
        "outside m",
        "bad"
    )?;
    for row in rows {
        let name = row.family.to_possible_value();
        let pair = |pair: Option<[f64; 2]>| {
            pair.map_or("-".into(), |[middle, end]| format!("{middle:.2} {end:7.2}"))
        };
        writeln!(
            f,
            "{:<20} {:>7} {:>7} {:>8} {:>7} {:>15} {:>15} {:>15} {:>9.2} {:>5}",
            name.as_ref().map_or("", |name| name.get_name()),
            row.flights,
            row.observable,
            row.detected,
            row.landed,
            pair(row.neutral_s),
            pair(row.land_s),
            pair(row.travelled_m),
            row.outside_m,
            row.violations
        )?;
    }
    writeln!(
        f,
        "seen: the fault was there while the vehicle flew. Times from then on, median and largest: \
         neutral sticks of those detected, LAND of those landed before the mission was over"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::judge::{End, Violation};

    fn flown(families: &[Family], reaction: Option<MeasuredReaction>, is_bad: bool) -> CampaignRow {
        CampaignRow {
            seed: 1,
            families: families.to_vec(),
            faults: Vec::new(),
            drone: None,
            end: End::Landed,
            excess_m: 0.0,
            reaction,
            violations: if is_bad { vec![Violation::LeftRoom] } else { Vec::new() },
        }
    }

    fn reaction(detected_s: Option<f64>, neutral_s: f64, travelled_m: f64) -> MeasuredReaction {
        let outside_m = 0.1 * travelled_m;
        MeasuredReaction {
            detected_s,
            neutral_s: Some(neutral_s),
            travelled_m,
            outside_m,
            ..MeasuredReaction::default()
        }
    }

    #[test]
    fn a_flight_counts_for_each_of_its_families() {
        let flights = [
            flown(&[Family::Lost, Family::Frozen], Some(reaction(Some(0.1), 0.2, 1.0)), true),
            flown(&[Family::Lost], None, false),
        ];
        let rows = rows(&flights);
        let counts: Vec<_> = rows
            .iter()
            .map(|row| (row.family, row.flights, row.observable, row.detected, row.violations))
            .collect();
        // In the order of the families, those without a flight left out.
        assert_eq!(counts, [(Family::Lost, 2, 1, 1, 1), (Family::Frozen, 1, 1, 1, 1)]);
    }

    #[test]
    fn times_are_those_of_the_flights_that_they_belong_to() {
        let landed = MeasuredReaction { land_s: Some(4.0), ..reaction(Some(1.0), 2.0, 3.0) };
        let over = MeasuredReaction {
            land_s: Some(9.0),
            is_mission_over: true,
            ..reaction(None, 8.0, 5.0)
        };
        let late = MeasuredReaction { land_s: Some(6.0), ..reaction(Some(2.0), 3.0, 1.0) };
        let flights = [landed, over, late].map(|one| flown(&[Family::Drift], Some(one), false));
        let [row] = &rows(&flights)[..] else { panic!("{flights:?}") };
        assert_eq!((row.observable, row.detected, row.landed), (3, 2, 2));
        let bits = |pair: Option<[f64; 2]>| pair.map(|pair| pair.map(f64::to_bits));
        // Neutral sticks of an undetected fault do not count, nor does the landing after a mission.
        assert_eq!(bits(row.neutral_s), bits(Some([2.5, 3.0])));
        assert_eq!(bits(row.land_s), bits(Some([5.0, 6.0])));
        assert_eq!(bits(row.travelled_m), bits(Some([3.0, 5.0])));
        assert!((row.outside_m - 0.5).abs() < 1e-15, "{row:?}");
    }

    #[test]
    fn a_distance_that_is_not_a_number_is_not_hidden() {
        let flights = [f64::NAN, 1.0].map(|travelled_m| {
            flown(&[Family::Far], Some(reaction(None, 0.0, travelled_m)), false)
        });
        assert!(rows(&flights)[0].outside_m.is_nan());
    }

    #[test]
    fn families_without_times_show_a_dash() {
        struct Shown(Vec<FamilyRow>);

        impl fmt::Display for Shown {
            fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
                write(&self.0, f)
            }
        }

        let text = Shown(rows(&[flown(&[Family::OtherSubject], None, false)])).to_string();
        let line = text.lines().nth(1).unwrap();
        let words: Vec<&str> = line.split_whitespace().collect();
        assert_eq!(words, ["other_subject", "1", "0", "0", "0", "-", "-", "-", "0.00", "0"]);
    }
}
