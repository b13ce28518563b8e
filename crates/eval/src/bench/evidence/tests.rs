use tello_io::tello::Protocol;
use tello_io::tello::protocol::{DronePacket, FlightStatus};

use super::super::checks::checks;
use super::super::wire;
use super::*;

fn at(t_s: f64, what: BenchEventKind) -> Event {
    Event { t_s, what }
}

fn sent(t_s: f64, packet: &'static str, sequence: Option<u16>) -> Event {
    at(t_s, BenchEventKind::Sent { packet, sequence, bytes: String::new(), error: None })
}

fn ack(t_s: f64, packet: &'static str, sequence: u16) -> Event {
    at(t_s, BenchEventKind::Ack { packet, sequence })
}

fn version(t_s: f64, sequence: u16) -> Event {
    at(t_s, BenchEventKind::Version { sequence, version: "01.04".to_owned() })
}

/// A status of a drone that flies or stands, with its speed to the north.
fn status(t_s: f64, is_flying: bool, north_dm_s: i16) -> Event {
    let status = FlightStatus { vel_north_dm_s: north_dm_s, ..FlightStatus::new(is_flying) };
    let mut bytes = Vec::new();
    DronePacket::Status { sequence: 0, status }.encode(&mut bytes);
    at(t_s, wire::read(&bytes, Protocol::Binary))
}

/// A check with this proof.
fn check(proof: DroneEvidence) -> Check {
    checks().unwrap().into_iter().find(|check| check.proof == proof).unwrap()
}

fn ended(began_s: f64) -> EndingReport {
    EndingReport { began_s, is_down: true }
}

#[test]
fn a_change_follows_the_first_order_of_the_newest_kind() {
    let events = [
        sent(1.0, "take_off", Some(1)),
        status(2.0, true, 0),
        sent(3.0, "land", Some(2)),
        sent(3.5, "land", Some(3)),
        sent(3.75, "sticks", None),
        status(4.0, false, 0),
    ];
    let change = |what: &str| json!({ "what": what, "to": false, "t_s": 4.0, "after": "land", "after_s": 1.0 });
    assert_eq!(changes(&events), [change("is_flying"), change("is_running")]);
    // What the drone reports first is no change.
    assert!(changes(&events[..3]).is_empty());
}

#[test]
fn all_that_follows_the_ending_is_explained_by_the_ending() {
    let events = [
        status(1.0, true, 0),
        at(2.0, BenchEventKind::Step(ENDING.to_owned())),
        sent(2.5, "emergency", None),
        status(3.0, false, 0),
    ];
    let changes = changes(&events);
    assert_eq!(changes.len(), 2);
    assert!(changes.iter().all(|it| it["after"] == ENDING && it["after_s"] == 1.0), "{changes:?}");
}

#[test]
fn an_answer_is_taken_once_and_comes_after_its_question() {
    let events = [
        ack(0.5, "land", 8),
        sent(1.0, "land", Some(8)),
        sent(1.5, "land", Some(8)),
        sent(1.75, "version", Some(8)),
        ack(2.0, "land", 9),
        ack(2.25, "take_off", 8),
        ack(2.5, "land", 8),
        version(2.75, 8),
        sent(3.0, "sticks", None),
    ];
    let delays: Vec<Value> = answers(&events).iter().map(|it| it["after_s"].clone()).collect();
    assert_eq!(delays, [json!(1.5), json!(null), json!(1.0)]);
}

#[test]
fn the_distance_counts_half_a_second_of_a_gap_at_most() {
    // 10 dm/s for 0.25 s, then for a gap of 3 s, then -5 dm/s for 0.5 s.
    let events = [
        status(0.0, true, 10),
        status(0.25, true, 10),
        status(3.25, true, -5),
        status(3.75, true, 0),
    ];
    let velocity = velocity(&events);
    // 0.25 m + 0.5 m - 0.25 m.
    assert_eq!(velocity["travelled_m"], json!([0.5, 0.0, 0.0]));
    assert_eq!(velocity["extremes_mps"][0], json!([-0.5, 1.0]));
    assert_eq!(velocity["is_present"], true);
}

#[test]
fn turns_add_up_across_half_a_turn_in_either_protocol() {
    let log = |t_s, yaw_rad: f64| {
        let mut bytes = Vec::new();
        DronePacket::LogData { sequence: 0, tick: 5, yaw_rad }.encode(&mut bytes);
        at(t_s, wire::read(&bytes, Protocol::Binary))
    };
    let binary = [log(0.0, 3.0), status(0.05, false, 0), log(0.1, 3.5), log(0.2, 4.0)];
    let turned = turned_rad(&binary).unwrap();
    assert!((turned - 1.0).abs() < 3e-5, "{turned} rad");
    let mut motor = wire::Motor::default();
    let text = [170, -170, -100].map(|yaw_deg| {
        let line = format!("yaw:{yaw_deg};tof:80;bat:83;");
        at(1.0, wire::read_state(line.as_bytes(), &mut motor, tello_io::clock::TimeNs(0)))
    });
    let turned_deg = |events: &[Event]| {
        seen(&check(DroneEvidence::None), true, events, None)["turned_deg"].clone()
    };
    assert_eq!(turned_deg(&text), json!(90.0));
    assert_eq!(turned_deg(&[status(1.0, true, 0)]), json!(null));
}

#[test]
fn a_drone_moves_from_two_decimetres_a_second_on() {
    for (north_dm_s, moved_at_s) in [(1, json!(null)), (2, json!(1.5)), (-2, json!(1.5))] {
        let events = [status(1.0, true, 0), status(1.5, true, north_dm_s), status(2.0, true, 9)];
        assert_eq!(velocity(&events[..2])["moved_at_s"], moved_at_s, "{north_dm_s} dm/s");
    }
    let silent = velocity(&[status(1.0, true, 0)]);
    assert_eq!((&silent["is_present"], &silent["moved_at_s"]), (&json!(false), &json!(null)));
}

#[test]
fn a_drone_that_never_ran_proves_nothing_about_its_stop() {
    let by = |proof, events: &[Event], is_whole, ending| {
        seen(&check(proof), is_whole, events, ending)["is_as_expected"].clone()
    };
    let expected =
        |events: &[Event], is_whole, ending| by(DroneEvidence::Down, events, is_whole, ending);
    let (ran, stopped) = (status(1.0, true, 0), status(2.0, false, 0));
    let whole = [ran.clone(), stopped.clone()];
    assert_eq!(expected(&whole, true, None), json!(true));
    assert_eq!(expected(&whole, false, None), json!(null), "a check that was stopped");
    assert_eq!(expected(&[stopped], true, None), json!(null));
    assert_eq!(expected(std::slice::from_ref(&ran), true, None), json!(false));
    assert_eq!(
        by(DroneEvidence::NotDown, &whole, true, None),
        json!(null),
        "the sticks may be inverted"
    );
    assert_eq!(by(DroneEvidence::NotDown, &[ran], true, None), json!(false));
    // It ran until the ending stopped it.
    assert_eq!(expected(&whole, true, Some(ended(2.0))), json!(false));
    assert_eq!(expected(&whole, true, Some(ended(2.5))), json!(true));
    assert_eq!(
        seen(&check(DroneEvidence::None), true, &whole, None)["is_as_expected"],
        json!(null)
    );
}

#[test]
fn every_question_has_to_be_answered() {
    let proof = |events: &[Event]| {
        seen(&check(DroneEvidence::Answered), true, events, None)["is_as_expected"].clone()
    };
    let questions = [sent(1.0, "version", Some(1)), sent(1.5, "land", Some(2))];
    assert_eq!(proof(&questions), json!(false));
    let [first, second] = questions;
    let half = [first.clone(), second.clone(), version(2.0, 1)];
    assert_eq!(proof(&half), json!(false));
    assert_eq!(proof(&[first, second, version(2.0, 1), ack(2.5, "land", 2)]), json!(true));
}

#[test]
fn the_record_counts_statuses_gaps_and_orders_before_the_ending() {
    let events = [
        status(0.0, true, 0),
        sent(0.5, "land", Some(1)),
        sent(0.5, "sticks", None),
        status(0.75, true, 0),
        status(2.0, true, 0),
        sent(2.25, "land", Some(2)),
        status(2.5, false, 0),
    ];
    let seen = seen(&check(DroneEvidence::None), true, &events, Some(ended(2.25)));
    assert_eq!((&seen["statuses"], &seen["longest_gap_s"]), (&json!(4), &json!(1.25)));
    assert_eq!(seen["orders_before_the_ending"], json!(1));
    assert_eq!(seen["ending"], json!({ "began_s": 2.25, "is_down": true, "lasted_s": 0.25 }));
    assert_eq!(seen["height_m"], json!([0.0, 0.0]));
    let lines = lines(&seen);
    assert!(lines[0].starts_with("4 statuses, longest gap 1.25 s"), "{lines:?}");
    assert!(!lines.iter().any(|line| line.starts_with("as expected")), "{lines:?}");
    assert_eq!(range([].into_iter()), None);
    assert_eq!(range([2.0, -1.0, 3.0].into_iter()), Some([-1.0, 3.0]));
}

#[test]
fn a_step_shows_the_status_before_it() {
    let step = |t_s| at(t_s, BenchEventKind::Step("LAND".to_owned()));
    let events = [step(0.5), status(1.0, true, 3), step(1.5), status(2.0, false, 0)];
    let steps = steps(&events);
    assert_eq!(steps[0]["is_flying"], json!(null));
    assert_eq!((&steps[1]["is_flying"], &steps[1]["velocity_mps"][0]), (&json!(true), &json!(0.3)));
}
