use super::super::assessment::Judgement;
use super::super::group::FlightRow;
use super::super::quantity::{Measured, Spread, Spreads};
use super::*;

/// A flight of the file `name` that took `finish_s` and was `distance_m` off at most.
fn looked(name: &str, finish_s: Option<f64>, distance_m: f64) -> EvaluatedFlight {
    let flight = Flight {
        path: name.into(),
        name: name.to_owned(),
        dt_s: 0.02,
        ticks: vec![],
        outline: vec![],
        targets: vec![],
        corners: vec![],
        judged: 0..0,
        gaps: vec![],
        reached: [0, 0],
        notes: vec![],
        unjudged: None,
    };
    let spread = |value| Spread::of(&[value]).unwrap();
    let mut numbers = Spreads::from([(Quantity::DistanceM, spread(distance_m))]);
    numbers.extend(finish_s.map(|finish_s| (Quantity::FinishS, spread(finish_s))));
    let row = FlightRow {
        name: name.to_owned(),
        file: name.into(),
        judgement: Judgement::Good,
        reasons: vec![],
        remarks: vec![],
        targets_reached: 0,
        targets_count: 0,
        numbers,
        outages: None,
        faults: vec![],
    };
    EvaluatedFlight { flight, measured: Measured::default(), row }
}

fn group(looked: Vec<EvaluatedFlight>) -> Group {
    Group {
        name: "a".into(),
        judged_count: 0,
        good_count: 0,
        numbers: Spreads::new(),
        flights: vec![],
        looked,
    }
}

fn names(group: &Group) -> Vec<&str> {
    shown(group).iter().map(|looked| looked.row.name.as_str()).collect()
}

#[test]
fn few_flights_are_all_shown_in_their_order() {
    let flights = ["b", "a", "d", "c"].map(|name| looked(name, Some(9.0), 0.1));
    assert_eq!(names(&group(flights.to_vec())), ["b", "a", "d", "c"]);
}

#[test]
fn of_many_flights_the_fastest_the_middle_the_slowest_and_the_farthest_off_stand_for_all() {
    let times_s = [("a", 14.0), ("b", 10.0), ("c", 13.0), ("d", 11.0), ("e", 12.0)];
    let with_far = |far: &str| {
        let off_m = |name: &str| if name == far { 0.5 } else { 0.1 };
        group(times_s.map(|(name, s)| looked(name, Some(s), off_m(name))).to_vec())
    };
    assert_eq!(names(&with_far("c")), ["b", "e", "a", "c"]);
    assert_eq!(names(&with_far("a")), ["b", "e", "a"], "none stands twice");
}

#[test]
fn a_flight_without_an_end_is_shown_only_if_it_is_the_farthest_off() {
    let mut flights: Vec<EvaluatedFlight> =
        ["a", "b", "c", "d"].map(|name| looked(name, Some(9.0), 0.1)).into();
    flights.push(looked("lost", None, 0.9));
    assert!(names(&group(flights.clone())).contains(&"lost"));
    flights[4] = looked("near", None, 0.01);
    assert!(!names(&group(flights)).contains(&"near"));
}

#[test]
fn the_marks_are_the_inner_targets_of_the_first_flight_with_a_line() {
    let at = |x: f64| Pose::new(x, 0.0, 1.0, 0.0);
    let mut with_line = looked("line", None, 0.1);
    with_line.flight.outline = vec![at(0.0), at(4.0)];
    with_line.flight.targets = [0.0, 1.0, 3.0, 4.0].map(at).to_vec();
    let marks = targets(&[group(vec![looked("none", None, 0.1), with_line])]);
    assert_eq!(marks.len(), 2);
    // A progress is one of 200.
    assert!((marks[0] - 0.25).abs() < 0.005 && (marks[1] - 0.75).abs() < 0.005, "{marks:?}");
    assert!(targets(&[group(vec![looked("none", None, 0.1)])]).is_empty());
}

#[test]
fn a_flight_without_parameters_and_times_has_no_figures_of_them() {
    let mut one = looked("one", Some(12.5), 0.1);
    one.flight.ticks = vec![TickRow::default(); 3];
    let names = |one: &EvaluatedFlight| -> Vec<String> {
        of_flight(one, "flight-7").into_iter().map(|picture| picture.name).collect()
    };
    let always = ["space", "above", "state", "sticks"].map(|name| format!("flight-7-{name}"));
    assert_eq!(names(&one), always);
    one.flight.ticks[1].param = Some(nalgebra::SVector::zeros());
    one.flight.ticks[1].timing = Some(tello_flight::cycle::Timing::default());
    assert_eq!(names(&one)[4..], ["flight-7-parameters", "flight-7-loop"]);
}
