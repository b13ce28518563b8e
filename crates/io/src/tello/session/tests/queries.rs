//! What the drone is asked of itself, and what becomes of its answers.

use super::*;
use crate::tello::DroneFacts;
use crate::tello::protocol::{Answer, Query, Version};

/// What is asked when a drone that answers `answers` was connected at 0 ms: the time of each question.
fn asked(session: &mut Session, answers: &[Answer], until_ms: i64) -> Vec<(i64, Query)> {
    let mut asked = Vec::new();
    session.advance(ms(0));
    session.receive(&bytes(DronePacket::ConnAck { video_port: VIDEO_PORT }), ms(0));
    for now_ms in 0..=until_ms {
        if now_ms % 100 == 0 {
            session.receive(&status(false), ms(now_ms));
        }
        session.advance(ms(now_ms));
        let sent: Vec<Message> = session.drain().collect();
        for message in sent {
            let Message::Binary(HostPacket::Query { sequence, query }) = message else { continue };
            asked.push((now_ms, query));
            for answer in answers.iter().filter(|answer| answer.query() == query) {
                session
                    .receive(&bytes(DronePacket::Answer { sequence, answer: *answer }), ms(now_ms));
            }
        }
    }
    asked
}

fn session() -> Session {
    Session::binary(0, None, false, Arc::new(LinkCounters::default()))
}

#[test]
fn a_drone_is_asked_once_for_what_it_tells() {
    let version = Version::read(b"01.04.91.01").unwrap();
    let answers = [
        Answer::Version(version),
        Answer::AltitudeLimit(30),
        Answer::BatteryThreshold(10),
        Answer::TiltLimit(25.0_f64.to_radians()),
    ];
    let mut session = session();
    assert_eq!(session.counters.facts(), DroneFacts::default());
    assert_eq!(asked(&mut session, &answers, 9_000), Query::ALL.map(|query| (0, query)));
    let facts = DroneFacts {
        version: Some(version),
        altitude_limit_m: Some(30),
        battery_threshold_pct: Some(10),
        tilt_limit_rad: Some(25.0_f64.to_radians()),
    };
    assert_eq!(session.counters.facts(), facts);
}

#[test]
fn a_drone_that_does_not_answer_is_asked_three_times_and_then_left_alone() {
    let mut session = session();
    let answers = [
        Answer::AltitudeLimit(30),
        Answer::BatteryThreshold(10),
        Answer::TiltLimit(25.0_f64.to_radians()),
    ];
    let asked = asked(&mut session, &answers, 20_000);
    let for_version: Vec<i64> =
        asked.iter().filter(|(_, query)| *query == Query::Version).map(|(at, _)| *at).collect();
    assert_eq!(for_version, [0, 2_000, 4_000]);
    assert_eq!(asked.len(), 4 + 2, "{asked:?}");
    assert_eq!(session.counters.facts().version, None);
}

#[test]
fn nothing_is_asked_while_the_drone_lands() {
    let mut session = session();
    session.order(DroneOrder::Land, ms(0));
    assert_eq!(asked(&mut session, &[], 9_000), []);
}
