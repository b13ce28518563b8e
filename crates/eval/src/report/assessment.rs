//! Whether a flight was good, in words, and why not.
//!
//! Owns the rule: a flight is good if it reached every target and never was farther from its line than
//! the thesis counts as valid. Everything else that a reader should know is a remark and no reason.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Serialize;
use tello_flight::Phase;

use super::flight::Flight;
use super::quantity::{Measured, Quantity, Spread, Spreads};
use crate::metrics::{LATE_TICK_MS, OutageCounter, Outages, VALID_DISTANCE_M};
use crate::recordings::rows;
use crate::recordings::ticks::TickRow;

/// How a flight was.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum Judgement {
    /// Every target reached, never far from the line.
    Good,
    /// Not so.
    Bad,
    /// There was no line to follow, it is none that flew, or its log lacks a part of it.
    NotJudged,
}

/// A fault that was present for some time.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct FaultTime {
    pub name: String,
    /// When it was first present. s
    pub first_s: f64,
    /// In how many ticks.
    pub ticks: usize,
}

impl Judgement {
    /// In a word.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Bad => "not good",
            Self::NotJudged => "not judged",
        }
    }
}

/// The judgement of `flight`, and its reasons.
pub(super) fn judge(
    flight: &Flight,
    measured: &Measured,
    spreads: &Spreads,
) -> (Judgement, Vec<String>) {
    if let Some(what) = flight.unjudged {
        return (Judgement::NotJudged, vec![what.to_owned()]);
    }
    if flight.outline.is_empty() {
        return (Judgement::NotJudged, vec!["the recording names no line to follow".to_owned()]);
    }
    let mut reasons = Vec::new();
    let [reached, count] = flight.reached;
    let is_idle = |tick: &TickRow| tick.phase == Some(Phase::Idle);
    if !flight.ticks.is_empty() && flight.ticks.iter().all(is_idle) {
        let named = faults_of(flight, |tick| !tick.faults.is_empty());
        let named: Vec<String> = named.into_iter().map(|fault| fault.name).collect();
        let why = if named.is_empty() { String::new() } else { format!(": {}", named.join(", ")) };
        reasons.push(format!("never took off{why}"));
    } else if reached < count {
        let is_torn = flight.notes.iter().any(|note| rows::is_tear(note));
        // What came behind the tear is not known.
        let until = if is_torn { " before its log ends torn" } else { "" };
        reasons.push(format!("reached {reached} of {count} targets{until}"));
    }
    if let Some(Spread { max, .. }) = spreads.get(&Quantity::DistanceM)
        && (max.is_nan() || *max > VALID_DISTANCE_M)
    {
        reasons.push(format!(
            "was {max:.2} m from the line at {:.1} s, where {VALID_DISTANCE_M} m is valid",
            measured.farthest_s
        ));
    }
    if flight.ticks.last().is_some_and(|tick| tick.phase == Some(Phase::LandingUnconfirmed)) {
        reasons.push("was not confirmed to have landed".to_owned());
    }
    if !reasons.is_empty() {
        return (Judgement::Bad, reasons);
    }
    if !flight.gaps.is_empty() {
        // The rest may have been worse.
        let gaps = flight.gaps.join(" and ");
        return (Judgement::NotJudged, vec![format!("its log has {gaps}")]);
    }
    (Judgement::Good, reasons)
}

/// Outages of the commands in flight; `None` without a link monitor.
pub(super) fn outages(flight: &Flight) -> Option<Outages> {
    let ticks = flight.ticks.iter().filter(|tick| tick.phase == Some(Phase::Flying));
    let mut counter = None;
    for is_down in ticks.filter_map(|tick| tick.is_link_down) {
        counter.get_or_insert_with(OutageCounter::default).add_verdict(is_down, flight.dt_s);
    }
    counter.map(|counter| counter.outages())
}

/// Whether there is a fault between take-off and the end.
pub(super) fn is_faulty(tick: &TickRow) -> bool {
    !matches!(tick.phase, Some(Phase::Idle) | None) && !tick.faults.is_empty()
}

/// Faults between take-off and the end, by their first time.
pub(super) fn faults(flight: &Flight) -> Vec<FaultTime> {
    faults_of(flight, is_faulty)
}

/// Faults in the ticks that `counts` lets through, by their first time.
fn faults_of(flight: &Flight, counts: impl Fn(&TickRow) -> bool) -> Vec<FaultTime> {
    let mut faults: BTreeMap<&str, FaultTime> = BTreeMap::new();
    for tick in flight.ticks.iter().filter(|tick| counts(tick)) {
        for name in &tick.faults {
            let first_s = flight.time_s(tick);
            let new = || FaultTime { name: name.replace('_', " "), first_s, ticks: 0 };
            faults.entry(name).or_insert_with(new).ticks += 1;
        }
    }
    let mut faults: Vec<_> = faults.into_values().collect();
    faults.sort_by(|a, b| a.first_s.total_cmp(&b.first_s));
    faults
}

/// Other remarks on `flight`.
pub(super) fn remarks(
    flight: &Flight,
    measured: &Measured,
    outages: Option<Outages>,
    faults: &[FaultTime],
) -> Vec<String> {
    let mut remarks = Vec::new();
    if let Some(Outages { count, down_s }) = outages.filter(|outages| outages.count > 0) {
        let times = if count == 1 { "once" } else { &format!("{count} times") };
        remarks.push(format!("commands did not act {times}, {down_s:.2} s together"));
    }
    let by_hand = |tick: &&TickRow| tick.is_by_hand && tick.phase == Some(Phase::Flying);
    if let Some(first) = flight.ticks.iter().find(by_hand) {
        let lasted_s = flight.ticks.iter().filter(by_hand).count() as f64 * flight.dt_s;
        let first_s = flight.time_s(first);
        remarks.push(format!("by hand for {lasted_s:.2} s, first at {first_s:.2} s"));
    }
    // The poses of a flight that begins in the air do not show where the ground is: they confirm no landing.
    let begins_in_air = flight.ticks.first().is_some_and(|tick| tick.phase == Some(Phase::Flying));
    for FaultTime { name, first_s, ticks } in faults {
        let lasted_s = *ticks as f64 * flight.dt_s;
        match name.as_str() {
            "landed by drone" if begins_in_air => {}
            "landed by drone" => remarks.push("the drone alone confirmed the landing".to_owned()),
            "landed by pose" => remarks.push("the poses alone confirmed the landing".to_owned()),
            _ => remarks.push(format!("fault {name} for {lasted_s:.2} s, first at {first_s:.2} s")),
        }
    }
    let late = measured.numbers.get(&Quantity::LateMs);
    let late = late.map_or(0, |ms| ms.iter().filter(|ms| **ms > LATE_TICK_MS).count());
    if late > 0 {
        remarks.push(format!("{late} ticks began more than {LATE_TICK_MS} ms late"));
    }
    remarks.extend(flight.notes.iter().cloned());
    remarks
}

#[cfg(test)]
mod tests {
    use horizon_model::rows::Pose;

    use super::*;
    use crate::recordings::ticks::TickRow;

    fn flight(reached: usize, is_down: &[bool]) -> Flight {
        let tick = |(period, is_down): (u64, &bool)| TickRow {
            period,
            phase: Some(Phase::Flying),
            is_link_down: Some(*is_down),
            faults: if *is_down { vec!["mocap_lost".to_owned()] } else { vec![] },
            ..TickRow::default()
        };
        Flight {
            path: "a.mcap".into(),
            name: "a".into(),
            dt_s: 0.02,
            ticks: (0..).zip(is_down).map(tick).collect(),
            outline: vec![Pose::zeros(), Pose::new(1.0, 0.0, 0.0, 0.0)],
            targets: vec![],
            corners: vec![],
            judged: 0..is_down.len(),
            gaps: vec![],
            reached: [reached, 2],
            notes: vec![],
            unjudged: None,
        }
    }

    #[test]
    fn a_flight_is_good_only_if_it_arrived_and_stayed_near() {
        let spreads =
            |max: f64| Spreads::from([(Quantity::DistanceM, Spread::of(&[max]).unwrap())]);
        let judged =
            |reached, max| judge(&flight(reached, &[]), &Measured::default(), &spreads(max));
        assert_eq!(judged(2, 0.3), (Judgement::Good, vec![]));
        assert_eq!(judged(1, 0.1), (Judgement::Bad, vec!["reached 1 of 2 targets".into()]));
        let mut torn = flight(1, &[]);
        torn.notes.push("torn 8.54 s after the start".to_owned());
        let (_, reasons) = judge(&torn, &Measured::default(), &spreads(0.1));
        assert_eq!(reasons, ["reached 1 of 2 targets before its log ends torn"]);
        let dry = Flight { unjudged: Some("it is a dry run"), ..flight(0, &[]) };
        let judged_dry = judge(&dry, &Measured::default(), &Spreads::default());
        assert_eq!(judged_dry, (Judgement::NotJudged, vec!["it is a dry run".to_owned()]));
        let (judgement, reasons) = judged(1, 0.31);
        assert_eq!((judgement, reasons.len()), (Judgement::Bad, 2), "{reasons:?}");
    }

    #[test]
    fn a_flight_that_stayed_on_the_ground_or_has_no_numbers_is_not_good() {
        let mut idle = flight(0, &[true, false]);
        for tick in &mut idle.ticks {
            tick.phase = Some(Phase::Idle);
        }
        let (judgement, reasons) = judge(&idle, &Measured::default(), &Spreads::default());
        assert_eq!(judgement, Judgement::Bad);
        assert_eq!(reasons, ["never took off: mocap lost"]);
        let mut spread = Spread::of(&[0.1]).unwrap();
        spread.max = f64::NAN;
        let spreads = Spreads::from([(Quantity::DistanceM, spread)]);
        let (judgement, _) = judge(&flight(2, &[]), &Measured::default(), &spreads);
        assert_eq!(judgement, Judgement::Bad);
    }

    #[test]
    fn a_landing_that_one_source_confirms_is_remarked_of_flights_from_the_ground() {
        let of_phases = |phases: &[Phase]| {
            let mut flight = flight(2, &vec![false; phases.len()]);
            for (tick, phase) in flight.ticks.iter_mut().zip(phases) {
                tick.phase = Some(*phase);
            }
            flight.ticks.last_mut().unwrap().faults = vec!["landed_by_drone".to_owned()];
            remarks(&flight, &Measured::default(), outages(&flight), &faults(&flight))
        };
        assert_eq!(of_phases(&[Phase::Flying, Phase::Landed]), Vec::<String>::new());
        let from_ground = of_phases(&[Phase::Idle, Phase::Flying, Phase::Landed]);
        assert_eq!(from_ground, ["the drone alone confirmed the landing"]);
    }

    #[test]
    fn a_flight_whose_log_lacks_a_part_is_not_called_good() {
        let gap = |reached| {
            let gaps = vec!["27 ticks missing".to_owned()];
            judge(
                &Flight { gaps, ..flight(reached, &[]) },
                &Measured::default(),
                &Spreads::default(),
            )
        };
        let why = "its log has 27 ticks missing";
        assert_eq!(gap(2), (Judgement::NotJudged, vec![why.to_owned()]));
        assert_eq!(gap(1).0, Judgement::Bad, "what is there is enough");
    }

    #[test]
    fn a_flight_by_hand_is_remarked_and_has_no_time() {
        let mut by_hand = flight(2, &[false; 4]);
        assert!(Measured::of(&by_hand).numbers.contains_key(&Quantity::FinishS));
        for tick in &mut by_hand.ticks[1..3] {
            tick.is_by_hand = true;
        }
        let measured = Measured::of(&by_hand);
        assert!(!measured.numbers.contains_key(&Quantity::FinishS) && !by_hand.is_measurable());
        let remarks = remarks(&by_hand, &measured, None, &[]);
        assert_eq!(remarks, ["by hand for 0.04 s, first at 0.02 s"]);
        by_hand.judged = 3..4;
        assert!(by_hand.is_measurable(), "the hand was before");
    }

    #[test]
    fn every_outage_and_fault_is_counted_once() {
        let flight = flight(2, &[true, true, false, true, false]);
        assert_eq!(outages(&flight), Some(Outages { count: 2, down_s: 0.06 }));
        let faults = faults(&flight);
        assert_eq!(faults, [FaultTime { name: "mocap lost".into(), first_s: 0.0, ticks: 3 }]);
        let remarks = remarks(&flight, &Measured::default(), outages(&flight), &faults);
        assert!(remarks[0].contains("2 times, 0.06 s"), "{remarks:?}");
    }
}
