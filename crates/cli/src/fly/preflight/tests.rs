use tello_eval::metrics::LeastClearance;
use tello_flight::{Fault, ObstacleTable, Start};
use tello_io::clock::TimeNs;
use tello_io::config;
use tello_io::tello::protocol::Version;

use super::log::LOG_BYTES;
use super::question::question;
use super::*;

/// All that a flight needs.
fn all_there() -> Found {
    let stream = StreamReport {
        frames: 101,
        rate_hz: Some(100.0),
        has_clock: true,
        ..StreamReport::default()
    };
    Found {
        stream,
        announced_hz: Some(100.0),
        mocap_trouble: "no pose, nobody is at 127.0.0.1:51602".into(),
        at: Some(Pose::new(-2.0, -3.0, 0.05, 0.0)),
        moving_at: None,
        drone: Some(DroneStatus {
            received_at: TimeNs(0),
            is_flying: false,
            is_on_ground: true,
            takes_sticks: true,
            is_battery_low: None,
            is_battery_critical: None,
            battery_pct: 87,
            battery_v: None,
            height_m: None,
            velocity_d_mps: None,
            heading_rad: None,
            flight_mode: None,
        }),
        drone_trouble: "it does not answer on 192.168.10.1:8889".into(),
        facts: DroneFacts {
            version: Version::read(b"01.04.91.01"),
            altitude_limit_m: Some(30),
            battery_threshold_pct: Some(10),
            tilt_limit_rad: Some(25.0_f64.to_radians()),
        },
        log_dir: "logs".into(),
        disk_free: Some(12_345_678_901),
        refusals: vec![],
        has_keys: true,
        device: None,
        unfinished: None,
        is_unasked: false,
    }
}

/// A mission whose way is closed.
fn unfinished() -> NominalFlight {
    NominalFlight {
        targets_reached: 3,
        targets_count: 4,
        finish_s: None,
        distance_p95_m: None,
        clearance: LeastClearance::default(),
        landed_by: vec![Fault::PlanBlocked],
    }
}

/// The list for the built-in settings after a change.
fn list(found: &Found, change: impl FnOnce(&mut FlyTable)) -> Vec<Check> {
    let (mut table, mission) = config::fly(None, None).unwrap();
    change(&mut table);
    let flight = config::flight(&table, mission, Start::Grounded);
    checks(found, &table, &flight).unwrap()
}

/// All there, but for this in the stream.
fn stream(change: impl FnOnce(&mut StreamReport)) -> Found {
    let mut found = all_there();
    change(&mut found.stream);
    found
}

fn drone(change: impl FnOnce(&mut DroneStatus)) -> Found {
    let mut found = all_there();
    if let Some(status) = &mut found.drone {
        change(status);
    }
    found
}

#[test]
fn what_is_ready_is_reported_line_by_line_and_the_question_is_asked() {
    let checks = list(&all_there(), |_| ());
    let lines: Vec<String> = checks.iter().map(ToString::to_string).collect();
    let expected = [
        "  ok    mission    5 targets, 1.50 m or more inside of the room x -5.0..5.0, y -5.0..5.0, z -0.2..3.0 m",
        "  ok    mocap      101 poses of \"tello\", 100 frames a second",
        "  ok    start      at -2.00 -3.00 +0.05 m, heading +0 degrees, 1.2 m from the first target",
        "  ok    drone      192.168.10.1:8889 answers and stands; firmware 01.04.91.01; climbs to 30 m; tilts to 25 degrees; \
         warns of its battery below 10 %",
        "  ok    battery    87 %; takes off from 15 % on and lands below 8 %",
        "  ok    log        logs: 12345 MB free",
        "  ok    real time  priority and memory are granted",
        "  ok    operator   this terminal: Backspace stops the motors, R or Q lands",
    ];
    assert_eq!(lines, expected);
    assert_eq!(
        question("192.168.10.1:8889", &checks),
        "The drone at 192.168.10.1:8889 will take off. Is the room clear? Enter starts, anything else leaves. "
    );
}

#[test]
fn a_battery_that_keeps_the_drone_down_says_why() {
    type Change = fn(&mut DroneStatus);
    let cases: [(Change, &str); 3] = [
        (|status| status.battery_pct = 14, "14 %; takes off from 15 %"),
        (|status| status.battery_pct = 101, "101 %, more than a battery holds"),
        (|status| status.is_battery_low = Some(true), "87 %, low by the drone's"),
    ];
    for (change, reason) in cases {
        let checks = list(&drone(change), |_| ());
        let check = checks.iter().find(|check| check.what == "battery").unwrap();
        assert_eq!(check.readiness, Readiness::Bad);
        assert!(check.reason.starts_with(reason), "{}", check.reason);
    }
}

#[test]
fn each_thing_that_is_wrong_has_its_line_and_its_reason() {
    use Readiness::{Bad, Never, Note};
    let all = all_there;
    let cases: [(Found, &str, Readiness, &str); 16] = [
        (stream(|it| it.has_clock = false), "mocap", Bad, "do not keep pace with time"),
        (stream(|it| it.latency_mean_s = 0.12), "mocap", Bad, "poses are 0.12 s old when they"),
        (Found { at: None, ..all() }, "mocap", Bad, "nobody is at 127.0.0.1:51602"),
        (Found { at: None, ..all() }, "start", Bad, "unknown without a pose"),
        (
            stream(|it| it.unseen = 12),
            "mocap",
            Note,
            "89 poses of \"tello\", 100 frames a second; 12 of 101 frames do not see it",
        ),
        (
            stream(|it| it.rate_hz = Some(25.0)),
            "mocap",
            Note,
            "25 frames a second; the loop has 50 ticks a second",
        ),
        (
            stream(|it| it.rate_hz = Some(2.0)),
            "mocap",
            Never,
            "2.00 frames a second: poses are stale after 0.5 s (cycle.supervisor.stale_s), so that 4 are needed",
        ),
        (
            Found { at: Some(Pose::new(-2.0, -3.0, -0.1, 0.0)), ..all() },
            "start",
            Bad,
            "lower poses than 0.01 m (cycle.filter.floor_m) count as wrong",
        ),
        (
            Found { at: Some(Pose::new(-2000.0, -3000.0, 50.0, 0.0)), ..all() },
            "start",
            Bad,
            "at -2000.00 -3000.00 +50.00 m, heading +0 degrees: outside of the room",
        ),
        (Found { drone: None, ..all() }, "drone", Bad, "does not answer on 192.168.10.1"),
        (Found { drone: None, ..all() }, "battery", Bad, "unknown without a report"),
        (
            Found { unfinished: Some(unfinished()), ..all() },
            "mission",
            Never,
            "targets; simulated: NOT TO ITS END: 3 of 4 targets, landed: plan blocked",
        ),
        (Found { disk_free: Some(199_999_999), ..all() }, "log", Note, "199 MB free, which"),
        (Found { disk_free: None, ..all() }, "log", Note, "does not report how much"),
        (
            Found { refusals: vec!["no priority".into(), "no memory".into()], ..all() },
            "real time",
            Note,
            "no priority; no memory",
        ),
        (Found { has_keys: false, ..all() }, "operator", Note, "nobody can steer"),
    ];
    assert_found(cases);
}

/// Each of these findings has its line, with this readiness and reason.
fn assert_found<const N: usize>(cases: [(Found, &str, Readiness, &str); N]) {
    for (found, what, readiness, reason) in cases {
        let checks = list(&found, |_| ());
        let check = checks.iter().find(|check| check.what == what).unwrap();
        assert_eq!(check.readiness, readiness, "{check}");
        assert!(check.reason.contains(reason), "{check}: {reason:?} is missing");
    }
}

#[test]
fn a_start_beside_a_wall_is_noted_and_a_name_that_two_objects_have_fails() {
    let at = |x_m, theta_rad| Some(Pose::new(x_m, -3.0, 0.05, theta_rad));
    let beside = |x_m| Found { at: at(x_m, 0.0), ..all_there() };
    let turned = |theta_rad| Found { at: at(-2.0, theta_rad), ..all_there() };
    let raised = Found { at: Some(Pose::new(-2.0, -3.0, 0.81, 0.0)), ..all_there() };
    let all = all_there().stream;
    let stream = StreamReport { doubled: all.frames, ..all };
    let wall = "0.59 m from the wall at the upper x of the room";
    let still = StreamReport { frames: 1, repeated: 90, ..all_there().stream };
    let other_rate =
        StreamReport { has_clock: false, count_hz: Some(100.0), latency_mean_s: 0.17, ..all };
    let doubled = "two objects are called \"tello\", in 101 frames";
    assert_found([
        (beside(4.41), "start", Readiness::Note, wall),
        (beside(4.39), "start", Readiness::Good, "m from the first target"),
        (beside(5.1), "start", Readiness::Bad, "outside of the room, whose x is -5.00..5.00 m; is"),
        (
            raised,
            "start",
            Readiness::Bad,
            "more than 1 m above the floor of the room, z = -0.20 m;",
        ),
        (Found { at: at(4.41, 3.1), ..all_there() }, "start", Readiness::Note, wall),
        (Found { at: at(4.41, 3.1), ..all_there() }, "start", Readiness::Note, "; turned by"),
        (turned(0.59), "start", Readiness::Good, "m from the first target"),
        (turned(-0.61), "start", Readiness::Note, "turned by -35 degrees"),
        (turned(3.1), "start", Readiness::Note, "the nose of the object is wrong"),
        (Found { stream, ..all_there() }, "mocap", Readiness::Bad, doubled),
        (
            Found { stream: other_rate, announced_hz: Some(120.0), ..all_there() },
            "mocap",
            Readiness::Bad,
            "its source announces 120 Hz, counted are 100.0 Hz",
        ),
        (Found { stream: still, ..all_there() }, "mocap", Readiness::Bad, "stand still"),
    ]);
}

#[test]
fn limits_that_are_kept_to_the_digit_are_good() {
    let found = Found {
        disk_free: Some(LOG_BYTES),
        device: Some("gamepad".into()),
        has_keys: false,
        stream: StreamReport { rate_hz: Some(49.6), ..all_there().stream },
        ..drone(|status| status.battery_pct = 15)
    };
    for check in list(&found, |_| ()) {
        assert_eq!(check.readiness, Readiness::Good, "{check}");
    }
}

#[test]
fn without_a_room_the_mission_has_a_note_and_any_start_is_good() {
    let far = Found { at: Some(Pose::new(40.0, 0.0, 9.0, 0.0)), ..all_there() };
    let checks = list(&far, |table| table.cycle.supervisor.room = None);
    assert_eq!(checks[0].readiness, Readiness::Note);
    assert!(checks[0].reason.contains("no room is set"), "{}", checks[0]);
    assert_eq!(checks[2].readiness, Readiness::Good, "{}", checks[2]);
}

#[test]
fn a_first_target_in_another_unit_is_never_flown_to() {
    let far = Found { at: Some(Pose::new(-70.0, 0.0, 0.05, 0.0)), ..all_there() };
    let checks = list(&far, |table| table.cycle.supervisor.room = None);
    let start = checks.iter().find(|check| check.what == "start").unwrap();
    assert_eq!(start.readiness, Readiness::Never, "{start}");
    assert!(start.reason.contains("more than 50 m: are mission, room"), "{start}");
}

#[test]
fn an_obstacle_that_moves_has_to_be_seen() {
    // The drone is at -2, -3; plans keep 0.12 m away from the person.
    let at = |x_m| Some(Pose::new(x_m, -3.0, 1.5, 0.0));
    for (moving_at, readiness, reason) in [
        (at(-1.2), Readiness::Good, "\"person\" at -1.20 -3.00 m"),
        (at(-1.3), Readiness::Bad, "\"person\" at -1.30 -3.00 m, 0.40 m from the drone"),
        (None, Readiness::Bad, "no pose of \"person\""),
    ] {
        let found = Found { moving_at, ..all_there() };
        let checks = list(&found, |table| {
            table.moving_object = Some("person".into());
            table.cycle.obstacles.push(ObstacleTable::Moving { radius_m: 0.3 });
        });
        let check = checks.iter().find(|check| check.what == "obstacle").unwrap();
        assert_eq!(check.readiness, readiness, "{check}");
        assert!(check.reason.contains(reason), "{check}");
    }
}

#[test]
fn the_question_tells_what_failed() {
    let checks = list(&Found { at: None, drone: None, ..all_there() }, |_| ());
    let text = question("drone", &checks);
    assert!(
        text.starts_with("4 of 8 failed. The drone at drone will take off once all checks"),
        "{text}"
    );
    assert!(text.contains("within 10 s"), "{text}");
}

#[test]
fn a_real_drone_flies_in_a_measured_room_only() {
    let (mut table, _) = config::fly(None, None).unwrap();
    let refused = refuse_unmeasured_room(&table).unwrap_err().to_string();
    assert!(refused.contains("cycle.supervisor.room"), "{refused}");
    table.cycle.supervisor.room.as_mut().unwrap().stop_s += 0.1;
    refuse_unmeasured_room(&table).expect_err("the same walls");
    table.tello.address = "127.0.0.1:8889".into();
    assert!(refuse_unmeasured_room(&table).is_ok(), "a simulated drone");
    table.tello.address = "192.168.10.1:8889".into();
    table.cycle.supervisor.room.as_mut().unwrap().x_m = [-2.0, 2.0];
    assert!(refuse_unmeasured_room(&table).is_ok(), "walls that were measured");
    table.cycle.supervisor.room = None;
    let refused = refuse_unmeasured_room(&table).unwrap_err().to_string();
    assert!(refused.starts_with("cycle.supervisor.room is null"), "{refused}");
}

#[test]
fn nobody_is_asked_about_a_mission_that_does_not_get_to_its_end() {
    let flight = || NominalFlight { landed_by: vec![Fault::TrackingLost], ..unfinished() };
    let all = |is_unasked| Found { unfinished: Some(flight()), is_unasked, ..all_there() };
    let [asked, unasked] = [false, true].map(|is_unasked| list(&all(is_unasked), |_| ()));
    let readiness = |list: &[Check]| {
        list.iter().find(|check| check.what == "mission").map(|check| check.readiness)
    };
    assert_eq!(
        [&asked, &unasked].map(|list| readiness(list)),
        [Some(Readiness::Note), Some(Readiness::Never)]
    );
    let others = |list: Vec<Check>| list.into_iter().filter(|check| check.what != "mission");
    assert!(others(asked).eq(others(unasked)));
}
