use super::*;
use crate::clock::{SpanNs, TimeNs};
use crate::config;
use crate::mocap::natnet::encode;
use crate::mocap::natnet::packet::{FrameEnd, RigidBody, ServerInfo, Version};
use crate::mocap::{MocapSettings, MocapStream};

const RELAY: &str = r#"{ "relay": { "address": "a:1", "object": "tello" } }"#;

/// Settings with the source `mocap`, and its stream after one connection, without a message.
fn connected(mocap: &str) -> (FlyTable, MocapStream, MocapCounters) {
    let (mut fly, _) = config::fly(None, None).unwrap();
    fly.mocap = serde_json::from_str(mocap).unwrap();
    let stream = MocapStream::new(&MocapSettings::try_from(&fly.mocap).unwrap());
    let counters = MocapCounters::default();
    counters.connects.count();
    (fly, stream, counters)
}

#[test]
fn what_frames_had_in_place_of_the_object_is_the_reason_that_poses_ended() {
    let reason = |other_object, unnamed, doubled| {
        let since =
            SincePose { other_object, unnamed, doubled, frames: 1, repeated: 99, undated: 9 };
        hidden(since, "tello")
    };
    assert_eq!(reason(0, 0, 0), None);
    assert_eq!(reason(9, 9, 9), None);
    for (counts, expected) in [
        ([1, 2, 90], "90 frames with two objects that are called \"tello\""),
        ([1, 90, 2], "90 frames with bodies that have no name"),
        ([90, 1, 2], "90 frames with other objects only: was \"tello\" renamed"),
    ] {
        let [other_object, unnamed, doubled] = counts;
        let text = reason(other_object, unnamed, doubled).unwrap();
        assert!(text.starts_with(expected), "{text}");
    }
}

#[test]
fn frames_that_cannot_be_dated_are_the_reason_whatever_else_is_in_them() {
    let others = SincePose { other_object: 900, doubled: 90, ..SincePose::default() };
    let undated = SincePose { undated: 90, frames: 90, ..others };
    let text = hidden(undated, "tello").unwrap();
    assert!(text.starts_with("90 frames of unknown time: was the recording"), "{text}");
    let still = SincePose { repeated: 95, ..others };
    let text = hidden(still, "tello").unwrap();
    assert!(text.starts_with("95 frames with one number: frame numbers or"), "{text}");
}

#[test]
fn a_drone_that_is_seen_without_a_time_is_not_called_unseen() {
    let (fly, mut stream, counters) = connected(RELAY);
    for frame in 1..9 {
        let line = format!("{frame} 0 tello 0 1 2 3 0 0 0\n");
        stream.push(line.as_bytes(), TimeNs(frame), &counters, |_| ()).unwrap();
    }
    let text = mocap_trouble(&fly, &counters);
    assert!(text.starts_with("\"tello\" is seen, but its frame numbers and stamps"), "{text}");
}

#[test]
fn a_server_that_names_no_object_is_another_case_than_one_without_ours() {
    let (fly, mut stream, counters) =
        connected(r#"{ "natnet": { "address": "motive:1510", "object": "tello" } }"#);
    let version = Version { major: 4, minor: 1 };
    let mut push = |fill: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = Vec::new();
        fill(&mut bytes);
        stream.push(&bytes, TimeNs(0), &counters, |_| ()).unwrap();
    };
    let server = ServerInfo { version, ticks_per_s: 1, group: None };
    push(&|to| encode::server_info(&server, "Motive", to));
    let text = mocap_trouble(&fly, &counters);
    assert!(text.contains("answers, 1 messages, but no frame with an object comes"), "{text}");
    let body =
        RigidBody { id: 7, pos_v: [1.0; 3], quaternion: [0.0, 0.0, 0.0, 1.0], is_tracked: true };
    let end = FrameEnd::default();
    push(&|to| encode::frame(version, 1, &[body], &end, to));
    let text = mocap_trouble(&fly, &counters);
    assert!(text.contains("is \"tello\" among") && text.contains("\"#7\""), "{text}");
    push(&|to| encode::model_definitions(version, &[(7, "wand")], to));
    push(&|to| encode::frame(version, 2, &[body], &end, to));
    let text = mocap_trouble(&fly, &counters);
    assert!(text.contains("1 of them of other objects"), "now another one has a name: {text}");
}

#[test]
fn a_rate_that_is_wrong_is_named_with_who_states_it() {
    let table = |text: &str| serde_json::from_str::<MocapTable>(text).unwrap();
    let udp = table(r#"{ "udp": { "listen": "0.0.0.0:1", "object": "a", "rate_hz": 120 } }"#);
    let vrpn = table(r#"{ "vrpn": { "address": "a:1", "object": "a", "rate_hz": 120 } }"#);
    let relay = table(r#"{ "relay": { "address": "a:1", "object": "a" } }"#);
    let report =
        |count_hz, has_clock| StreamReport { has_clock, count_hz, ..StreamReport::default() };
    let wrong = report(Some(100.04), false);
    let text = wrong_rate(&wrong, Some(120.0), &udp).unwrap();
    assert!(text.starts_with("mocap.udp.rate_hz is 120 Hz, counted are 100.0 Hz"), "{text}");
    assert!(!text.contains("stamps"), "it has frame numbers: {text}");
    let text = wrong_rate(&wrong, Some(120.0), &vrpn).unwrap();
    assert!(text.contains("the clock of its time stamps does not keep pace"), "{text}");
    let text = wrong_rate(&wrong, Some(100.600_007), &relay).unwrap();
    let expected = "its source announces 100.6 Hz, counted are 100.0 Hz (or its network delays";
    assert!(text.starts_with(expected), "{text}");
    for (report, announced_hz) in [
        (report(Some(100.0), true), Some(100.6)),
        (report(None, false), Some(120.0)),
        (report(Some(100.2), false), Some(100.0)),
        (wrong, None),
    ] {
        assert_eq!(wrong_rate(&report, announced_hz, &relay), None, "{report:?}");
    }
}

#[test]
fn a_drone_that_was_seen_for_a_moment_has_no_wrong_numbers() {
    let (fly, mut stream, counters) = connected(RELAY);
    let rate = 100.0;
    for frame in 1..9 {
        let at = TimeNs(0).after(SpanNs::from_seconds(f64::from(frame) / rate));
        let line = format!("{frame} {rate} tello 0 1 2 3 0 0 0\n");
        stream.push(line.as_bytes(), at, &counters, |_| ()).unwrap();
    }
    let report = counters.report();
    assert!(!report.has_clock && report.undated == 0, "{report:?}");
    let text = mocap_trouble(&fly, &counters);
    assert!(!text.contains("keep pace") && text.contains("is the drone seen"), "{text}");
}

#[test]
fn a_multicast_group_that_cannot_be_joined_is_the_reason_that_no_frame_comes() {
    let (fly, _, counters) = connected(RELAY);
    counters.messages.count();
    let no_device = std::io::Error::from_raw_os_error(19);
    counters.note_opening(Err(&no_device));
    let text = mocap_trouble(&fly, &counters);
    assert!(text.starts_with("a:1 answers, 1 messages, but No such device"), "{text}");
}

#[test]
fn headings_that_were_refused_before_others_were_accepted_are_no_reason() {
    let filtered = |heading| Some(Filtered { o: None, position: Acceptance::Accepted, heading });
    let mut headings = RefusedHeadings::default();
    headings.add(filtered(Acceptance::Held), 2.0);
    // Without a pose nothing changes.
    headings.add(None, 2.0);
    assert!(headings.reason().unwrap().starts_with("headings refused for 2.0 s"));
    headings.add(filtered(Acceptance::Accepted), 0.02);
    assert_eq!(headings.reason(), None);
}

#[test]
fn what_is_refused_has_its_reason() {
    let (fly, mut stream, counters) = connected(RELAY);
    for (line, reason) in [
        ("1000.0 100 tello 0 1 2 3 0 0 0\n", "(a frame number is not a whole number)"),
        (
            "1000 100 tello 0 1 2 3 0 0 0 1.05\n",
            "(a rotation is none: a quaternion of another length",
        ),
        (
            "1000 100 tello 0 1 2 3 1 0 0 0\n",
            "(the object's top is further than 60 degrees from up",
        ),
        ("1000 100 tello 0 1 2 nan 0 0 0\n", "(a number is missing or not finite)"),
    ] {
        stream.push(line.as_bytes(), TimeNs(0), &counters, |_| ()).unwrap();
        let text = mocap_trouble(&fly, &counters);
        assert!(text.contains(reason), "{text}");
    }
}
