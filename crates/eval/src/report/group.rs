//! Flights that are looked at together, and two such groups side by side.

use std::collections::BTreeSet;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::Serialize;

use super::assessment::{self, FaultTime, Judgement};
use super::flight::Flight;
use super::quantity::{Measured, Numbers, OF_FLIGHT, OfFlight, Quantity, Spreads, spreads};
use crate::metrics::{Outages, VALID_DISTANCE_M};
use crate::{Centre, interval, quantile};

/// Seed of the bootstrap of differences.
const SEED: u64 = 1;

/// Bad flights that the verdict names one by one.
const NAMED_MAX: usize = 4;

/// A flight with all that was found out about it.
#[derive(Debug, Clone)]
pub(super) struct EvaluatedFlight {
    pub flight: Flight,
    pub measured: Measured,
    pub row: FlightRow,
}

/// One flight in numbers and words.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub(super) struct FlightRow {
    /// Name of the file without folder and ending.
    pub name: String,
    pub file: PathBuf,
    pub judgement: Judgement,
    /// Why it is not good.
    pub reasons: Vec<String>,
    /// Other remarks.
    pub remarks: Vec<String>,
    pub targets_reached: usize,
    /// 0 without a line to follow.
    pub targets_count: usize,
    /// Quantiles over the flight's own samples.
    pub numbers: Spreads,
    /// Null without a link monitor.
    pub outages: Option<Outages>,
    pub faults: Vec<FaultTime>,
}

/// Flights of one kind.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub(super) struct Group {
    /// Name, as in the legend.
    pub name: String,
    /// Flights with a line to follow.
    pub judged_count: usize,
    /// Number of good flights among them.
    pub good_count: usize,
    /// Quantiles over the samples of all flights.
    pub numbers: Spreads,
    pub flights: Vec<FlightRow>,
    #[serde(skip)]
    pub looked: Vec<EvaluatedFlight>,
}

/// Differences of one number of a flight, first group minus second.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub(super) struct Paired {
    pub quantity: Quantity,
    /// Which number of a flight: its `median` or its `max`.
    pub of_flight: &'static str,
    /// Pairs in which both flights have it.
    pub pairs: usize,
    /// Median of the differences. In the unit of the quantity
    pub difference: f64,
    /// 95 % interval of that median by the bootstrap. In the unit of the quantity
    pub interval: [f64; 2],
}

/// Two groups flight by flight.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Comparison {
    /// Rule by which two flights are a pair: `name` or `order`.
    pub paired_by: &'static str,
    pub differences: Vec<Paired>,
}

impl EvaluatedFlight {
    pub(super) fn at(flight: Flight) -> Self {
        let measured = Measured::of(&flight);
        let numbers = spreads(&measured.numbers);
        let (judgement, reasons) = assessment::judge(&flight, &measured, &numbers);
        let (outages, faults) = (assessment::outages(&flight), assessment::faults(&flight));
        let [targets_reached, targets_count] = flight.reached;
        let row = FlightRow {
            name: flight.name.clone(),
            file: flight.path.clone(),
            judgement,
            reasons,
            remarks: assessment::remarks(&flight, &measured, outages, &faults),
            targets_reached,
            targets_count,
            numbers,
            outages,
            faults,
        };
        Self { flight, measured, row }
    }
}

impl Group {
    pub(super) fn of(name: String, looked: Vec<EvaluatedFlight>) -> Self {
        let mut pooled = Numbers::new();
        for (quantity, values) in counted(&looked).flat_map(|one| &one.measured.numbers) {
            pooled.entry(*quantity).or_default().extend(values);
        }
        let flights: Vec<FlightRow> = looked.iter().map(|one| one.row.clone()).collect();
        let count = |judgement| flights.iter().filter(|row| row.judgement == judgement).count();
        Self {
            name,
            judged_count: flights.len() - count(Judgement::NotJudged),
            good_count: count(Judgement::Good),
            numbers: spreads(&pooled),
            flights,
            looked,
        }
    }

    /// Whether the flights were good, and why not.
    pub(super) fn verdict(&self) -> String {
        match self.flights.as_slice() {
            [only] => self.verdict_on(only),
            _ => self.verdict_on_many(),
        }
    }

    /// The flights that count: see [`counted`].
    pub(super) fn counted(&self) -> impl Iterator<Item = &EvaluatedFlight> {
        counted(&self.looked)
    }

    fn verdict_on(&self, row: &FlightRow) -> String {
        let distance = self.numbers.get(&Quantity::DistanceM);
        let finish = self.numbers.get(&Quantity::FinishS);
        let why = row.reasons.join("; it ");
        let mut sentences = vec![match (row.judgement, distance.zip(finish)) {
            (Judgement::Good, Some((distance, finish))) => format!(
                "The flight was good. It reached all {} targets in {:.2} s and was never more than {:.3} m from \
                 its line.",
                row.targets_count, finish.median, distance.max
            ),
            (Judgement::Good, None) => {
                let most = distance.map_or_else(String::new, |distance| {
                    format!(" It was never more than {:.3} m from its line.", distance.max)
                });
                format!("The flight was good.{most}")
            }
            (Judgement::NotJudged, _) => format!("The flight was not judged: {why}."),
            (judgement, _) => format!("The flight was {}: it {why}.", judgement.name()),
        }];
        if !row.remarks.is_empty() {
            sentences.push(format!("Also: {}.", row.remarks.join("; ")));
        }
        sentences.join(" ")
    }

    /// Each reason of the flights with this judgement once.
    fn reasons_of(&self, judgement: Judgement) -> String {
        let rows = self.flights.iter().filter(|row| row.judgement == judgement);
        let reasons: BTreeSet<&str> =
            rows.flat_map(|row| &row.reasons).map(String::as_str).collect();
        reasons.into_iter().collect::<Vec<_>>().join("; ")
    }

    fn verdict_on_many(&self) -> String {
        let (good, judged, all) = (self.good_count, self.judged_count, self.flights.len());
        if judged == 0 {
            let reasons = self.reasons_of(Judgement::NotJudged);
            return format!("None of the {all} flights was judged: {reasons}.");
        }
        let mut sentences = vec![if good == judged {
            let subject = match judged {
                1 => "The one flight that was judged was".to_owned(),
                _ => format!("All {judged} flights were"),
            };
            format!(
                "{subject} good: every target reached, never more than {VALID_DISTANCE_M} m from the line."
            )
        } else {
            format!("{good} of {judged} flights were good.")
        }];
        if judged < all {
            let rest = all - judged;
            let reasons = self.reasons_of(Judgement::NotJudged);
            sentences.push(format!("Not judged: {rest} more, {reasons}."));
        }
        let spreads = [Quantity::FinishS, Quantity::DistanceM].map(|q| self.numbers.get(&q));
        if let [Some(finish), Some(distance)] = spreads {
            sentences.push(format!(
                "Half of those that finished took less than {:.2} s; half of all samples are within {:.3} m of the \
                 line, 95 % within {:.3} m.",
                finish.median, distance.median, distance.p95
            ));
        }
        let bad = self.flights.iter().filter(|row| row.judgement == Judgement::Bad);
        let mut bad: Vec<String> =
            bad.map(|row| format!("{} {}", row.name, row.reasons.join(" and "))).collect();
        let more = bad.len().saturating_sub(NAMED_MAX);
        if more > 0 {
            bad.truncate(NAMED_MAX);
            bad.push(format!("{more} more, see the table of flights"));
        }
        if !bad.is_empty() {
            sentences.push(format!("Not good: {}.", bad.join("; ")));
        }
        sentences.join(" ")
    }
}

/// The flights of `looked` with the best rank: judged before unjudged (replays, dry runs), then measurable before not
/// (by hand, or with ticks missing in the part that counts).
fn counted(looked: &[EvaluatedFlight]) -> impl Iterator<Item = &EvaluatedFlight> {
    let rank = |one: &EvaluatedFlight| (one.flight.unjudged.is_none(), one.flight.is_measurable());
    let first = looked.iter().map(rank).max();
    looked.iter().filter(move |one| Some(rank(one)) == first)
}

impl Comparison {
    /// Pairs flights of the same name, those of one name in their order; if there are none, flights of the same place
    /// in their groups.
    pub(super) fn of(ours: &Group, theirs: &Group) -> Self {
        let rows = |group: &Group| -> Vec<FlightRow> {
            group.counted().map(|one| one.row.clone()).collect()
        };
        Self::of_rows(&rows(ours), &rows(theirs))
    }

    fn of_rows(ours: &[FlightRow], theirs: &[FlightRow]) -> Self {
        let by_name: Vec<(&FlightRow, &FlightRow)> = ours
            .iter()
            .enumerate()
            .filter_map(|(place, row)| {
                let before = ours[..place].iter().filter(|other| other.name == row.name).count();
                let mut namesakes = theirs.iter().filter(|other| other.name == row.name);
                Some((row, namesakes.nth(before)?))
            })
            .collect();
        let (paired_by, pairs) = if by_name.is_empty() {
            ("order", ours.iter().zip(theirs).collect())
        } else {
            ("name", by_name)
        };
        let difference = |(quantity, of_flight, pick): OfFlight| {
            let number = |row: &FlightRow| row.numbers.get(&quantity).map(pick);
            let differences: Vec<f64> =
                pairs.iter().filter_map(|(a, b)| Some(number(a)? - number(b)?)).collect();
            Some(Paired {
                quantity,
                of_flight,
                pairs: differences.len(),
                difference: quantile(&differences, 0.5)?,
                interval: interval(&differences, Centre::Median, SEED)?,
            })
        };
        Self { paired_by, differences: OF_FLIGHT.into_iter().filter_map(difference).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::quantity::Spread;

    fn group(flights: &[(&str, f64)]) -> Group {
        let flights = flights.iter().map(|(name, finish_s)| FlightRow {
            name: (*name).to_owned(),
            file: PathBuf::new(),
            judgement: if *finish_s < 20.0 { Judgement::Good } else { Judgement::Bad },
            reasons: vec!["was late".to_owned()],
            remarks: vec![],
            targets_reached: 5,
            targets_count: 5,
            numbers: Spreads::from([(Quantity::FinishS, Spread::of(&[*finish_s]).unwrap())]),
            outages: None,
            faults: vec![],
        });
        let flights: Vec<_> = flights.collect();
        let good_count = flights.iter().filter(|row| row.judgement == Judgement::Good).count();
        Group {
            name: "a".into(),
            judged_count: flights.len(),
            good_count,
            numbers: Spreads::new(),
            flights,
            looked: vec![],
        }
    }

    #[test]
    fn flights_of_one_name_are_a_pair_wherever_they_stand() {
        let ours = group(&[("1", 10.0), ("2", 12.0), ("3", 9.0)]);
        let theirs = group(&[("3", 10.0), ("1", 11.0), ("9", 50.0)]);
        let Comparison { paired_by, differences } =
            Comparison::of_rows(&ours.flights, &theirs.flights);
        let Paired { pairs, difference, interval, .. } = differences[0];
        assert_eq!((paired_by, pairs, interval), ("name", 2, [-1.0; 2]));
        assert!((difference + 1.0).abs() < 1e-12, "{difference}");
        let ours = group(&[("x", 8.0), ("x", 10.0), ("x", 30.0)]);
        let theirs = group(&[("x", 9.0), ("x", 11.0)]);
        let of_namesakes = Comparison::of_rows(&ours.flights, &theirs.flights).differences;
        assert_eq!((of_namesakes[0].pairs, of_namesakes[0].interval), (2, [-1.0; 2]));
        let ours = group(&[("1", 10.0), ("2", 12.0)]);
        let strangers = group(&[("x", 8.0), ("y", 10.0)]);
        let Comparison { paired_by, differences } =
            Comparison::of_rows(&ours.flights, &strangers.flights);
        assert_eq!((paired_by, differences[0].pairs), ("order", 2));
    }

    #[test]
    fn the_verdict_counts_and_names_the_bad() {
        let text = group(&[("1", 10.0), ("2", 30.0)]).verdict();
        assert!(text.contains("1 of 2 flights were good"), "{text}");
        assert!(text.contains("Not good: 2 was late."), "{text}");
    }
}
