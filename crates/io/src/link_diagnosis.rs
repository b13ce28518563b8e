//! What is wrong with the links of motion capture and drone, by their counters.
//!
//! For the list before a flight, for a flight that does not begin, and for its summary.

use tello_flight::cycle::SIGHTING_AGE_MAX;
use tello_flight::{Acceptance, Filtered};

use crate::config::FlyTable;
use crate::mocap::{MocapCounters, MocapTable, SincePose, StreamReport};
use crate::tello::Protocol;

/// Fewer frames without a pose are those that any source has now and then.
const HIDDEN_MIN: u64 = 10;

/// Headings that are refused for less time end no flight: `lost_s` is 2 s. s
const REFUSED_MIN_S: f64 = 1.5;

/// Smaller differences of a counted rate are jitter. 1
const RATE_APART_MIN: f64 = 3e-3;
/// Smaller ones may be: delays that change by 0.1 s cause 0.6 %. 1
const RATE_APART_SURE: f64 = 8e-3;

/// Message on a mocap stream that shows no drone: the first of these that applies.
pub fn mocap_trouble(table: &FlyTable, counters: &MocapCounters) -> String {
    let report = counters.report();
    let messages = counters.messages.get();
    let (key, address) = table.mocap.address();
    let object = table.mocap.object();
    unintelligible(counters, address)
        .or_else(|| unconnected(counters, key, address))
        .or_else(|| misnumbered(&report, object))
        .or_else(|| wrong_rate(&report, counters.announced_hz(), &table.mocap))
        .or_else(|| too_old(&report))
        .or_else(|| silent(messages, address))
        .or_else(|| unnamed(counters, object))
        .or_else(|| empty(&report, messages, address))
        .or_else(|| undated(&report, object))
        .unwrap_or_else(|| unseen(table, counters, &report))
}

/// Message if the source sent something that is not of its protocol.
fn unintelligible(counters: &MocapCounters, address: &str) -> Option<String> {
    let error = counters.given_up()?;
    Some(format!("{address} cannot be understood: {error}"))
}

/// Message if there was no connection.
fn unconnected(counters: &MocapCounters, key: &str, address: &str) -> Option<String> {
    (counters.connects.get() == 0).then(|| match counters.unopened() {
        None => format!("no pose, nobody is at {address}: is the system running, is {key} right?"),
        Some(why) => format!("no pose, {address} cannot be opened: {why}; is {key} right?"),
    })
}

/// Message if no message came.
fn silent(messages: u64, address: &str) -> Option<String> {
    (messages == 0)
        .then(|| format!("no pose, nothing comes from {address}: is the mocap system live?"))
}

/// Message if messages come and none of them has an object.
fn empty(report: &StreamReport, messages: u64, address: &str) -> Option<String> {
    ([report.frames, report.other_object, report.malformed] == [0; 3]).then(|| {
        format!(
            "{address} answers, {messages} messages, but no frame with an object comes: is streaming on, is the drone \
             seen, does a firewall or a network without multicast keep frames back?"
        )
    })
}

/// Message for a stream in which the drone is seen, and nothing shows when.
pub fn undated(report: &StreamReport, object: &str) -> Option<String> {
    (report.frames > report.unseen && !report.has_clock).then(|| {
        format!(
            "{object:?} is seen, but its frame numbers and stamps do not keep pace with time: its poses cannot be dated"
        )
    })
}

/// Message for a stream that has objects, but not the drone.
fn unseen(table: &FlyTable, counters: &MocapCounters, report: &StreamReport) -> String {
    format!(
        "{} messages, {} of them of other objects, {} malformed{}: is the object's name ({:?}) right (tello-ctl mocap \
         list shows all), is the drone seen, is its z above cycle.filter.floor_m = {} m?",
        counters.messages.get(),
        report.other_object,
        report.malformed,
        counters.refused().map_or_else(String::new, |why| format!(" ({why})")),
        table.mocap.object(),
        table.cycle.filter.floor_m,
    )
}

/// Message if frames come at another rate than the source announces, or than the settings state for it.
pub fn wrong_rate(
    report: &StreamReport,
    announced_hz: Option<f64>,
    mocap: &MocapTable,
) -> Option<String> {
    let (count_hz, announced_hz) = report.count_hz.zip(announced_hz)?;
    let apart = (count_hz / announced_hz - 1.0).abs();
    if report.has_clock || apart < RATE_APART_MIN {
        return None;
    }
    let doubt = if apart < RATE_APART_SURE { " (or its network delays them unevenly)" } else { "" };
    let announced_hz = (announced_hz * 1e2).round() / 1e2;
    let kind = mocap.kind();
    let (who, what) = if kind.has_set_rate() {
        (format!("mocap.{}.rate_hz is", kind.name()), "write the rate that the system is set to")
    } else {
        ("its source announces".to_owned(), "set the rate of the system right")
    };
    Some(format!(
        "{who} {announced_hz} Hz, counted are {count_hz:.1} Hz{doubt}: {what}, or the frames come with a delay that grows"
    ))
}

/// Message if frame numbers stand still, or if one has two places.
pub fn misnumbered(report: &StreamReport, object: &str) -> Option<String> {
    if report.frames <= 1 && report.repeated > 0 {
        let reason = "its frame numbers or time stamps stand still: its poses cannot be dated";
        return Some(reason.into());
    }
    // A server that starts anew may send one frame twice.
    (20 * report.doubled > report.frames + report.doubled).then(|| {
        format!(
            "two objects are called {object:?}, in {} frames: which of them is the drone?",
            report.doubled
        )
    })
}

/// Why poses ended in a flight, if the frames since the newest one show it.
pub fn hidden(since: SincePose, object: &str) -> Option<String> {
    let SincePose { other_object, unnamed, doubled, repeated, frames, undated } = since;
    let most = other_object.max(unnamed).max(doubled);
    Some(match most {
        // Other objects of an undated frame, or two places of one number, show nothing.
        _ if undated >= HIDDEN_MIN => format!(
            "{undated} frames of unknown time: was the recording begun anew, or the clock of the source set?"
        ),
        _ if frames == 0 && repeated >= HIDDEN_MIN => {
            format!("{repeated} frames with one number: frame numbers or time stamps stand still")
        }
        0..HIDDEN_MIN => return None,
        _ if most == doubled => {
            format!("{doubled} frames with two objects that are called {object:?}")
        }
        _ if most == unnamed => format!("{unnamed} frames with bodies that have no name"),
        _ => format!(
            "{other_object} frames with other objects only: was {object:?} renamed, or left out?"
        ),
    })
}

/// For how long headings were refused while positions were accepted.
#[derive(Debug, Default)]
pub struct RefusedHeadings {
    present_s: f64,
    longest_s: f64,
}

impl RefusedHeadings {
    /// Takes in the result of the filter in a tick of `dt_s`.
    pub fn add(&mut self, filtered: Option<Filtered>, dt_s: f64) {
        match filtered.map(|it| (it.position, it.heading)) {
            Some((Acceptance::Accepted, Acceptance::Held)) => self.present_s += dt_s,
            Some((_, Acceptance::Accepted)) => self.present_s = 0.0,
            _ => {}
        }
        self.longest_s = self.longest_s.max(self.present_s);
    }

    /// Why poses ended, if headings were refused for so long.
    pub fn reason(&self) -> Option<String> {
        (self.longest_s > REFUSED_MIN_S).then(|| {
            format!(
                "headings refused for {:.1} s beside good positions: is the pattern of the markers symmetric?",
                self.longest_s
            )
        })
    }
}

/// Message if a source sends bodies and has named none of them so far.
fn unnamed(counters: &MocapCounters, object: &str) -> Option<String> {
    (counters.sightings.get() == 0 && counters.unnamed.get() > 0).then(|| {
        format!(
            "no pose, the mocap system sends bodies and none that it names: is {object:?} among its rigid bodies? \
             object: \"#7\" means the one with the streaming identity 7 (tello-ctl mocap list shows all)"
        )
    })
}

/// Message if poses arrive older than those that count.
pub fn too_old(report: &StreamReport) -> Option<String> {
    let limit_s = SIGHTING_AGE_MAX.seconds();
    (report.latency_mean_s > limit_s).then(|| {
        format!(
            "poses are {:.2} s old when they arrive, in the mean, by the delay that their source announces or by the \
             clock; older ones than {limit_s} s do not count",
            report.latency_mean_s
        )
    })
}

/// Message on a drone without a status that has sent so many packets.
pub fn drone_trouble(table: &FlyTable, packets: u64) -> String {
    if packets > 0 {
        let address = &table.tello.address;
        return match table.tello.protocol {
            Protocol::Binary => format!("{address} answers, but sends no status of its flight"),
            Protocol::Text => format!(
                "{address} answers, but does not report whether it flies: its state lines need `bat`, and `time` or \
                 `tof`"
            ),
        };
    }
    format!(
        "it does not answer on {}: is it on, is this machine in its Wi-Fi, is no other program talking to \
         it? One that was spoken to in another protocol than tello.protocol has to be switched off and on.",
        table.tello.address
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::TimeNs;
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
        let body = RigidBody {
            id: 7,
            pos_v: [1.0; 3],
            quaternion: [0.0, 0.0, 0.0, 1.0],
            is_tracked: true,
        };
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
        let relay = table(r#"{ "relay": { "address": "a:1", "object": "a" } }"#);
        let report =
            |count_hz, has_clock| StreamReport { has_clock, count_hz, ..StreamReport::default() };
        let wrong = report(Some(100.04), false);
        let text = wrong_rate(&wrong, Some(120.0), &udp).unwrap();
        assert!(text.starts_with("mocap.udp.rate_hz is 120 Hz, counted are 100.0 Hz"), "{text}");
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
}
