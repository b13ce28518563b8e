use std::sync::Arc;

use tello_eval::telemetry::{LinkTelemetry, Telemetry};

use super::*;
use crate::fly::tui::tests::view;

/// The head and the line below it, of a flight that is changed.
fn heads(change: impl FnOnce(&mut Telemetry)) -> [String; 2] {
    let mut view = view(true);
    let mut facts = Telemetry::clone(&view.facts);
    change(&mut facts);
    view.facts = Arc::new(facts);
    [headline(&view).to_string(), wrongs(&view).to_string()]
}

#[test]
fn a_person_at_the_sticks_comes_before_who_steers_else() {
    for (is_by_hand, pilot, steers) in [
        (true, Some(Pilot::Controller), "BY HAND"),
        (false, Some(Pilot::Person), "person"),
        (false, Some(Pilot::Controller), "controller"),
        (false, None, "nobody steers"),
    ] {
        let [head, _] = heads(|facts| (facts.is_by_hand, facts.pilot) = (is_by_hand, pilot));
        assert_eq!(head, format!(" FLYING  {steers}  12.3 s  3 of 5 targets"));
    }
    let [head, _] = heads(|facts| facts.phase = None);
    assert!(head.starts_with(" STARTING "), "{head}");
}

#[test]
fn orders_and_sticks_that_do_not_act_are_in_the_head() {
    for (operator, text) in [
        (Operator::Land, "12.3 s  landing is asked for  3 of"),
        (Operator::EmergencyStop, "12.3 s  EMERGENCY STOP requested  3 of"),
    ] {
        let [head, _] = heads(|facts| facts.operator = operator);
        assert!(head.contains(text), "{head}");
    }
    for is_down in [false, true] {
        let [head, _] = heads(|facts| facts.link = Some(LinkTelemetry { is_down, score: 0.0 }));
        assert_eq!(head.contains(" STICKS DO NOT ACT "), is_down, "{head}");
    }
}

#[test]
fn every_fault_has_its_name_and_none_is_reported() {
    let [_, wrong] = heads(|facts| facts.faults = vec![Fault::MocapStale, Fault::BatteryLow]);
    assert_eq!(wrong, " mocap stale, battery low ");
    let [_, wrong] = heads(|facts| facts.faults.clear());
    assert_eq!(wrong, " no fault");
}

#[test]
fn an_alarm_stands_out_without_colours() {
    let alarm = Palette::new(false).alarm();
    assert_eq!(alarm.fg, Some(Color::Reset));
    assert!(alarm.add_modifier.contains(Modifier::REVERSED));
    assert_eq!(Palette::new(true).alarm().fg, Some(Color::Indexed(166)));
}
