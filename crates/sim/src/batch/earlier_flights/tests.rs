use tello_flight::Start;
use tello_io::config;

use super::*;

/// The first two targets of a square flight.
const MISSION: &str =
    r#"{"targets": { "reach": 0.3, "targets": [[-0.5, 0.0, 1.2, 0.0], [0.5, 0.0, 1.2, 0.0]] }}"#;

fn flight() -> FlightTable {
    let (fly, _) = config::fly(None, None).unwrap();
    config::flight(&fly, serde_json::from_str(MISSION).unwrap(), Start::Airborne)
}

/// The settings after `count` flights, of which those are done that reach `targets_count` targets.
fn after(count: u32, targets_count: usize, seed: u64) -> FlightTable {
    let sim = crate::settings(None).unwrap();
    let mut contender = Contender::new(flight(), None).unwrap();
    contender.reference.targets_count = targets_count;
    super::after(count, &contender, &sim, seed).unwrap()
}

#[test]
fn a_vehicle_that_never_flew_is_flown_by_the_settings() {
    assert_eq!(after(0, 2, 1), flight());
}

#[test]
fn a_flight_changes_what_it_taught_of_its_vehicle_and_nothing_else() {
    let before = flight();
    let learnt = after(1, 2, 1);
    assert_ne!(learnt.cycle.mhe.p_prior, before.cycle.mhe.p_prior);
    let mut rest = learnt.clone();
    rest.cycle.mhe.p_prior.clone_from(&before.cycle.mhe.p_prior);
    rest.cycle.dead_time_s.clone_from(&before.cycle.dead_time_s);
    assert_eq!(rest, before);
    assert_eq!(after(1, 2, 1), learnt, "equal arguments, equal flights");
    assert_ne!(after(1, 2, 2), learnt, "another vehicle");
}

#[test]
fn a_flight_that_did_not_reach_all_targets_teaches_nothing() {
    assert_eq!(after(1, 3, 1), flight());
}
