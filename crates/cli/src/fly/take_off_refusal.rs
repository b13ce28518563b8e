//! What to say when the drone never took off, or a dry run shows nothing.

use std::sync::Arc;
use std::time::Duration;

use tello_flight::cycle::SIGHTING_AGE_MAX;
use tello_flight::{Fault, FaultSet};
use tello_io::clock::SpanNs;
use tello_io::config::FlyTable;
use tello_io::mocap::{MocapCounters, MocapTable, SincePose, StreamReport};
use tello_io::tello::Protocol;

use super::Arguments;
use crate::stdio;

/// Why the drone never took off, by the faults of the last tick, and what to look at.
pub(super) fn take_off_refusal(
    table: &FlyTable,
    ground_wait: SpanNs,
    faults_last: FaultSet,
    counters: &MocapCounters,
    drone_packets: u64,
) -> String {
    let faults: Vec<&str> = faults_last.iter().map(Fault::name).collect();
    let is_any = |faults: &[Fault]| faults.iter().any(|fault| faults_last.contains(*fault));
    let faults = faults.join(", ");
    // The others are waited for.
    let is_ended = is_any(&[Fault::GuardianLost, Fault::ProgramStalled, Fault::OperatorStop]);
    let mut text = if faults_last.is_empty() {
        format!(
            "did not take off: an order lapses after {} s, or when the drone is moved",
            ground_wait.seconds()
        )
    } else if is_ended {
        format!("did not take off: {faults}")
    } else {
        format!("not ready to fly within {} s: {faults}", ground_wait.seconds())
    };
    if is_any(&[Fault::GuardianLost]) {
        text += "\n  guardian: the process tello-guardian was ended or stopped; nothing flies without it";
    }
    if is_any(&[Fault::MocapStale, Fault::MocapLost]) {
        text += "\n  mocap: ";
        text += &mocap_trouble(table, counters);
    }
    if is_any(&[Fault::ObstacleUnseen]) {
        text += "\n  obstacle: no pose of moving_object in the mocap stream: is its name right, is it seen?";
    }
    if is_any(&[Fault::DroneSilent]) && drone_packets > 0 {
        text += "\n  drone: it has fallen silent; its address is ";
        text += &table.tello.address;
    } else if is_any(&[Fault::DroneUnheard, Fault::DroneSilent]) {
        text += "\n  drone: ";
        text += &drone_trouble(table, drone_packets);
    }
    text
}

/// Fewer frames without a pose are those that any source has now and then.
const HIDDEN_MIN: u64 = 10;

/// Smaller differences of a counted rate are jitter. 1
const RATE_APART_MIN: f64 = 3e-3;

/// How long poses may take to come before a note says that there are none.
const UNSEEN: Duration = Duration::from_secs(2);

/// Lets a dry run note once why there is no pose, if none has come in time: it has no pre-flight list and ends
/// after 10 s only. The picture of a terminal shows no notes.
pub(super) fn note_unseen(arguments: &Arguments, table: &FlyTable, counters: &Arc<MocapCounters>) {
    if !arguments.dry_run || arguments.tui {
        return;
    }
    let (table, counters) = (table.clone(), Arc::clone(counters));
    tokio::spawn(async move {
        tokio::time::sleep(UNSEEN).await;
        if let Some(trouble) = unseen(&table, &counters) {
            // Behind the status line of a terminal, which has no end yet.
            stdio::note(format_args!("\n  note  mocap      {trouble}"));
        }
    });
}

/// Why there is no pose; `None` if there was one.
fn unseen(table: &FlyTable, counters: &MocapCounters) -> Option<String> {
    let report = counters.report();
    (report.frames <= report.unseen).then(|| mocap_trouble(table, counters))
}

/// What may be wrong with a mocap stream that shows no drone.
pub(super) fn mocap_trouble(table: &FlyTable, counters: &MocapCounters) -> String {
    let report = counters.report();
    let messages = counters.messages.get();
    let (key, address) = table.mocap.address();
    let object = table.mocap.object();
    match (counters.connects.get(), messages, counters.given_up()) {
        (_, _, Some(error)) => format!("{address} cannot be understood: {error}"),
        (0, ..) => match counters.unopened() {
            None => {
                format!("no pose, nobody is at {address}: is the system running, is {key} right?")
            }
            Some(why) => format!("no pose, {address} cannot be opened: {why}; is {key} right?"),
        },
        _ if let Some(trouble) = misnumbered(&report, object) => trouble,
        _ if let Some(trouble) = wrong_rate(&report, counters.announced_hz(), &table.mocap) => {
            trouble
        }
        _ if let Some(trouble) = too_old(&report) => trouble,
        (_, 0, _) => format!("no pose, nothing comes from {address}: is the mocap system live?"),
        _ if let Some(trouble) = unnamed(counters, object) => trouble,
        _ if [report.frames, report.other_object, report.malformed] == [0; 3] => format!(
            "{address} answers, {messages} messages, but no frame with an object comes: is streaming on, is the drone \
             seen, does a firewall or a network without multicast keep frames back?"
        ),
        _ => format!(
            "{messages} messages, {} of them of other objects, {} malformed{}: is the object's name ({object:?}) right \
             (tello-ctl mocap list shows all), is the drone seen, is its z above cycle.filter.floor_m = {} m?",
            report.other_object,
            report.malformed,
            counters.refused().map_or_else(String::new, |why| format!(" ({why})")),
            table.cycle.filter.floor_m,
        ),
    }
}

/// Message if frames come at another rate than the source announces, or than the settings state for it.
pub(super) fn wrong_rate(
    report: &StreamReport,
    announced_hz: Option<f64>,
    mocap: &MocapTable,
) -> Option<String> {
    let (count_hz, announced_hz) = report.count_hz.zip(announced_hz)?;
    if report.has_clock || (count_hz / announced_hz - 1.0).abs() < RATE_APART_MIN {
        return None;
    }
    let announced_hz = (announced_hz * 1e2).round() / 1e2;
    let kind = mocap.kind();
    let (who, what) = if kind.has_set_rate() {
        (format!("mocap.{}.rate_hz is", kind.name()), "write the rate that the system is set to")
    } else {
        ("its source announces".to_owned(), "set the rate of the system right")
    };
    Some(format!(
        "{who} {announced_hz} Hz, counted are {count_hz:.1} Hz: {what}, or the frames come with a delay that grows"
    ))
}

/// What is wrong with the numbers of poses: they stand still, or one has two places.
pub(super) fn misnumbered(report: &StreamReport, object: &str) -> Option<String> {
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

/// Why poses ended in a flight, if the frames since the newest one tell.
pub(super) fn hidden(since: SincePose, object: &str) -> Option<String> {
    let SincePose { other_object, unnamed, doubled } = since;
    let most = other_object.max(unnamed).max(doubled);
    Some(match most {
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
pub(super) fn too_old(report: &StreamReport) -> Option<String> {
    let limit_s = SIGHTING_AGE_MAX.seconds();
    (report.latency_mean_s > limit_s).then(|| {
        format!(
            "poses are {:.2} s old when they arrive, in the mean, by the delay that their source announces or by the \
             clock; older ones than {limit_s} s do not count",
            report.latency_mean_s
        )
    })
}

/// What may be wrong with a drone without a status that has sent so many packets.
pub(super) fn drone_trouble(table: &FlyTable, packets: u64) -> String {
    if packets > 0 {
        let address = &table.tello.address;
        return match table.tello.protocol {
            Protocol::Binary => format!("{address} answers, but sends no status of its flight"),
            Protocol::Text => format!(
                "{address} answers, but does not tell whether it flies: its state lines need `bat`, and `time` or \
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
    use tello_io::clock::TimeNs;
    use tello_io::config;
    use tello_io::mocap::natnet::encode;
    use tello_io::mocap::natnet::packet::{FrameEnd, RigidBody, ServerInfo, Version};
    use tello_io::mocap::{MocapSettings, MocapStream};

    use super::*;

    /// The message after `faults`, without any mocap.
    fn message(faults: &[Fault]) -> String {
        let (table, _) = config::fly(None, None).unwrap();
        let mut set = FaultSet::default();
        for fault in faults {
            set.set(*fault, true);
        }
        take_off_refusal(&table, SpanNs::from_seconds(10.0), set, &MocapCounters::default(), 0)
    }

    #[test]
    fn each_missing_part_is_named_with_what_to_look_at_and_no_other() {
        let parts = ["\n  guardian: ", "\n  mocap: ", "\n  obstacle: ", "\n  drone: "];
        for (fault, expected) in [
            (Fault::GuardianLost, Some(0)),
            (Fault::MocapStale, Some(1)),
            (Fault::MocapLost, Some(1)),
            (Fault::ObstacleUnseen, Some(2)),
            (Fault::DroneUnheard, Some(3)),
            (Fault::DroneSilent, Some(3)),
            (Fault::BatteryLow, None),
        ] {
            let text = message(&[fault]);
            assert!(text.contains(fault.name()), "{text}");
            for (k, part) in parts.into_iter().enumerate() {
                assert_eq!(text.contains(part), Some(k) == expected, "{fault:?}: {text}");
            }
        }
    }

    #[test]
    fn a_stream_that_shows_no_drone_is_explained() {
        let (table, _) = config::fly(None, None).unwrap();
        let counters = MocapCounters::default();
        let text = unseen(&table, &counters).unwrap();
        assert!(text.starts_with("no pose, nobody is at 127.0.0.1:51602"), "{text}");
    }

    #[test]
    fn what_frames_had_in_place_of_the_object_is_the_reason_that_poses_ended() {
        let reason = |other_object, unnamed, doubled| {
            hidden(SincePose { other_object, unnamed, doubled }, "tello")
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
    fn a_server_that_names_no_object_is_another_case_than_one_without_ours() {
        let text = r#"{ "natnet": { "address": "motive:1510", "object": "tello" } }"#;
        let table: MocapTable = serde_json::from_str(text).unwrap();
        let mut stream = MocapStream::new(&MocapSettings::try_from(&table).unwrap());
        let counters = MocapCounters::default();
        counters.connects.count();
        let (mut fly, _) = config::fly(None, None).unwrap();
        fly.mocap = table;
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
            |count_hz, has_clock| StreamReport { count_hz, has_clock, ..StreamReport::default() };
        let wrong = report(Some(100.04), false);
        let text = wrong_rate(&wrong, Some(120.0), &udp).unwrap();
        assert!(text.starts_with("mocap.udp.rate_hz is 120 Hz, counted are 100.0 Hz"), "{text}");
        let text = wrong_rate(&wrong, Some(100.600_007), &relay).unwrap();
        assert!(text.starts_with("its source announces 100.6 Hz, counted are 100.0 Hz"), "{text}");
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
        let (mut fly, _) = config::fly(None, None).unwrap();
        fly.mocap = serde_json::from_str(r#"{ "relay": { "address": "a:1", "object": "tello" } }"#)
            .unwrap();
        let mut stream = MocapStream::new(&MocapSettings::try_from(&fly.mocap).unwrap());
        let counters = MocapCounters::default();
        counters.connects.count();
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

    #[test]
    fn what_ends_the_wait_is_not_called_waited_for() {
        let text = message(&[Fault::GuardianLost, Fault::BatteryLow]);
        assert!(text.starts_with("did not take off: battery low, guardian lost"), "{text}");
        let text = message(&[Fault::BatteryLow]);
        assert_eq!(text, "not ready to fly within 10 s: battery low");
    }

    #[test]
    fn a_drone_that_answers_without_a_status_is_not_called_silent() {
        let (mut table, _) = config::fly(None, None).unwrap();
        assert!(drone_trouble(&table, 0).contains("does not answer"));
        assert!(drone_trouble(&table, 1).contains("sends no status"));
        table.tello.protocol = Protocol::Text;
        let text = drone_trouble(&table, 1);
        assert!(text.contains("answers, but") && text.contains("`time` or `tof`"), "{text}");
        let mut silent = FaultSet::default();
        silent.set(Fault::DroneSilent, true);
        let ground_wait = SpanNs::from_seconds(10.0);
        let text = take_off_refusal(&table, ground_wait, silent, &MocapCounters::default(), 9);
        assert!(text.contains("has fallen silent"), "{text}");
    }

    #[test]
    fn a_mocap_that_nobody_serves_is_named_with_its_key() {
        let text = message(&[Fault::MocapStale]);
        assert!(text.contains("nobody is at 127.0.0.1:51602"), "{text}");
        assert!(text.contains("is mocap.relay.address right?"), "{text}");
    }
}
