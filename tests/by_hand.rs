//! A person at the terminal: the real program on a pseudo-terminal, judged by its log and by what it
//! leaves of the terminal.

#[path = "by_hand/person.rs"]
mod person;

use std::path::Path;
use std::thread::sleep;
use std::time::Duration;

use horizon_model::check::maximum;
use serde_json::Value;
use tello_io::clock::Clock;
use tello_io::log::LogReader;
use tello_sim::{InjectedFault, ScriptedFault};

use person::{PROGRAM, Person};

use crate::rig;

/// The records of one channel, in order.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn records(log: &Path, topic: &str) -> Vec<Value> {
    let mut log = LogReader::open(log).unwrap().select(&[topic]);
    let mut records = Vec::new();
    while let Some(message) = log.next_message().unwrap() {
        records.push(message.decode().unwrap());
    }
    assert!(!records.is_empty(), "nothing on {topic}");
    records
}

/// The phases in their order.
fn phases(log: &Path) -> Vec<String> {
    let mut phases: Vec<String> = records(log, "/supervisor/phase")
        .iter()
        .map(|record| record["phase"].as_str().unwrap_or_default().to_owned())
        .collect();
    phases.dedup();
    phases
}

#[test]
fn a_person_takes_over_steers_hands_back_and_lands() {
    let mut person = Person::start("steers");
    person.sees("Backspace EMERGENCY STOP");
    person.sees("flying");
    assert!(!person.has_echo(), "keys would be shown over the status line");
    person.holds(b'w', Duration::from_secs(1));
    person.holds(b'J', Duration::from_millis(500));
    person.sees("BY HAND");
    sleep(Duration::from_secs(1));
    person.types(b"c");
    sleep(Duration::from_secs(1));
    // Ctrl-C, which the kernel turns into a signal.
    person.types(b"\x03");
    let status = person.ends();
    assert_eq!(status.code(), Some(1), "landed early:\n{}", person.screen());
    assert!(person.has_echo(), "the terminal is not as it was");

    let by_hand = |record: &Value| record["manual"].as_array().cloned();
    let inboxes = records(&person.log, "/cycle/inbox");
    let steered: Vec<_> = inboxes.iter().filter_map(by_hand).collect();
    let first = inboxes.iter().position(|inbox| by_hand(inbox).is_some());
    let last = inboxes.iter().rposition(|inbox| by_hand(inbox).is_some());
    let ticks = last.zip(first).map_or(0, |(last, first)| last - first + 1);
    assert_eq!(ticks, steered.len(), "taken and given back once");
    assert!(last.is_some_and(|last| last + 25 < inboxes.len()), "given back in flight");
    assert!((100..400).contains(&ticks), "{ticks} ticks of 20 ms, about 2.6 s were meant");

    // Roll, pitch, yaw, throttle, as sent.
    let sent = records(&person.log, "/tello/command");
    let largest = |name: &str| {
        let of_tick = |tick: &Value| tick[name].as_f64().unwrap_or(f64::NAN);
        let by_hand = sent.iter().zip(&inboxes).filter(|(_, inbox)| by_hand(inbox).is_some());
        by_hand.map(|(tick, _)| of_tick(tick)).fold(0.0, maximum)
    };
    assert!(largest("pitch") > 0.4, "W for a second, full is 0.5: {}", largest("pitch"));
    assert!(largest("yaw") > 0.35, "J for half a second: {}", largest("yaw"));
    let phases = phases(&person.log);
    assert_eq!(phases, ["idle", "taking_off", "flying", "landing", "landed"]);
}

#[test]
fn backspace_stops_the_motors_in_flight() {
    let mut person = Person::start("cuts");
    person.sees("flying");
    person.types(b"\x7f");
    let status = person.ends();
    assert_ne!(status.code(), Some(0), "{}", person.screen());
    assert!(person.has_echo(), "the terminal is not as it was");
    let phases = phases(&person.log);
    assert_eq!(phases, ["idle", "taking_off", "flying", "motors_stopped"], "{}", person.screen());
}

#[test]
fn a_terminal_that_tells_of_releases_is_asked_to_and_left_as_it_was() {
    let mut person = Person::start("kitty");
    person.speaks_kitty();
    person.sees("flying");
    // D is pressed, held, and released. The first repetition takes a while.
    person.moves(b'd', 1);
    sleep(Duration::from_millis(500));
    person.repeats(b'd', Duration::from_millis(500));
    person.moves(b'd', 3);
    sleep(Duration::from_secs(1));
    person.types(b"\x1b[113u");
    person.ends();
    assert!(person.screen().contains("\x1b[<u"), "the terminal still reports releases");
    assert!(person.screen().contains("\x1b[?1004l"), "the terminal still reports its focus");

    let sent = records(&person.log, "/tello/command");
    let inboxes = records(&person.log, "/cycle/inbox");
    let by_hand: Vec<f64> = sent
        .iter()
        .zip(&inboxes)
        .filter(|(_, inbox)| inbox["manual"].is_array())
        .filter_map(|(tick, _)| tick["roll"].as_f64())
        .collect();
    let high = by_hand.iter().filter(|roll| **roll > 0.4).count();
    // Of 50 ticks the first 16 lead to 0.4.
    assert!(high >= 30, "{high} ticks beyond 0.4 in a second of D");
    assert!(by_hand.last().is_some_and(|roll| roll.abs() < 0.05), "{:?}", by_hand.last());
}

/// A place in the world frame. m
fn place(state: &Value) -> [f64; 3] {
    ["x", "y", "z"].map(|row| state[row].as_f64().unwrap_or(f64::NAN))
}

#[test]
fn a_key_whose_release_is_lost_is_let_go_and_the_vehicle_levels() {
    let mut person = Person::start("lost-release");
    person.speaks_kitty();
    person.sees("flying");
    // The link to the terminal freezes while W is held.
    person.moves(b'w', 1);
    sleep(Duration::from_millis(300));
    person.repeats(b'w', Duration::from_millis(300));
    person.sees("counts as released");
    sleep(Duration::from_secs(1));
    // It thaws: what was typed meanwhile comes at once, and the key is still down.
    person.repeats(b'w', Duration::from_millis(300));
    sleep(Duration::from_millis(200));
    // A is held while another window takes the keyboard.
    person.moves(b'a', 1);
    sleep(Duration::from_millis(400));
    person.types(b"\x1b[O");
    sleep(Duration::from_millis(600));
    // D is held, the controller has the sticks, and the person takes them back: level.
    person.moves(b'd', 1);
    sleep(Duration::from_millis(200));
    person.moves(b'c', 1);
    sleep(Duration::from_millis(200));
    person.moves(b'e', 1);
    sleep(Duration::from_secs(2));
    person.types(b"\x1b[113u");
    person.ends();

    let faults = records(&person.log, "/supervisor/fault");
    let is_expired = |record: &Value| record["faults"].to_string().contains("input_expired");
    assert!(faults.iter().any(is_expired), "{} faults", faults.len());
    let sent = records(&person.log, "/tello/command");
    let inboxes = records(&person.log, "/cycle/inbox");
    let states = records(&person.log, "/estim/state");
    let is_manual: Vec<bool> = inboxes.iter().map(|inbox| inbox["manual"].is_array()).collect();
    let runs = |name: &str, sign: f64| {
        let is_pushed = sent.iter().zip(&is_manual).map(|(tick, is_manual)| {
            *is_manual && tick[name].as_f64().unwrap_or(f64::NAN) * sign > 0.25
        });
        let mut runs = Vec::new();
        for is_pushed in is_pushed {
            match (is_pushed, runs.last_mut()) {
                (true, Some(ticks)) => *ticks += 1,
                (true, None) => runs.push(1),
                (false, Some(0) | None) => {}
                (false, Some(_)) => runs.push(0),
            }
        }
        runs.retain(|ticks| *ticks > 0);
        runs
    };
    // 0.6 s of W, 0.9 s in which its repetitions are missed, and the time constant of 0.2 s.
    let forward = runs("pitch", 1.0);
    assert!(matches!(forward[..], [50..100]), "{forward:?} ticks forward");
    let left = runs("roll", -1.0);
    assert!(matches!(left[..], [5..35]), "{left:?} ticks to the left: 0.4 s until the focus went");
    // D pushed for 0.2 s before C, and E meant level.
    let last = is_manual.iter().rposition(|is_manual| *is_manual).unwrap_or_default();
    let level = sent.iter().take(last).skip(last - 75).all(|tick| {
        ["roll", "pitch", "yaw", "throttle"]
            .iter()
            .all(|u| tick[u].as_f64().is_some_and(|u| u.abs() < 0.02))
    });
    assert!(level, "by hand and nothing pushed: not level");
    let drift = |from: usize, to: usize| {
        let [a, b] = [from, to].map(|step| place(&states[step]));
        a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    };
    let drift_m = drift(last.min(states.len() - 1) - 40, last.min(states.len() - 1) - 10);
    assert!(drift_m < 0.15, "{drift_m:.2} m in 0.6 s with level sticks");
}

#[test]
fn a_terminal_that_is_closed_lands_the_drone() {
    let mut person = Person::start("closed");
    person.sees("flying");
    person.types(b"e");
    person.sees("BY HAND");
    person.closes();
    person.ends();
    let phases = phases(&person.log);
    assert_eq!(phases, ["idle", "taking_off", "flying", "landing", "landed"]);
}

#[test]
fn keys_that_follow_the_enter_of_the_question_at_once_count_and_earlier_ones_do_not() {
    let (folder, _emulator) = rig::start("by-hand-question", |relay| relay);
    let mut person = Person::fly_in(&folder, &["--config", "fly.json"]);
    person.types(b"no\n");
    person.sees("Enter starts");
    person.types(b"\nq");
    person.ends();
    assert_eq!(phases(&person.log), ["idle"], "{}", person.screen());
}

#[test]
fn a_job_in_the_background_has_no_keys() {
    let (folder, _emulator) = rig::start("by-hand-background", |relay| relay);
    let job = "set -m; $0 fly --config fly.json --yes & read line; kill %1; wait";
    let mut person = Person::run_in(&folder, &["sh", "-c", job, PROGRAM]);
    person.sees("operator");
    person.sees("no keys and no device");
    person.types(b"\n");
    person.ends();
}

#[test]
fn a_person_who_takes_off_with_the_sticks_in_hand_needs_no_cameras() {
    let dark = ScriptedFault { fault: InjectedFault::MocapSilent, from_s: 0.0, for_s: 1e3 };
    let mut person = Person::start_in("dark", &[], |sim| sim.faults.push(dark));
    person.sees("waiting for a pose");
    person.types(b"e");
    person.sees("BY HAND");
    person.types(b"t");
    person.sees("flying");
    person.holds(b'i', Duration::from_secs(1));
    person.types(b"q");
    person.ends();
    let sent = records(&person.log, "/tello/command");
    let up = sent.iter().filter_map(|tick| tick["throttle"].as_f64()).fold(0.0, maximum);
    assert!(up > 0.4, "I for a second: {up}");
    let phases = phases(&person.log);
    assert_eq!(phases, ["idle", "taking_off", "flying", "landing", "landed"]);
}

#[test]
fn a_picture_of_the_flight_is_drawn_and_the_terminal_is_as_it_was() {
    let mut person = Person::start_in("picture", &["--tui", "--foxglove", "127.0.0.1:0"], |_| {});
    let glass = person.sees_drawn(" FLYING  controller");
    assert!(glass.alternate_screen() && glass.hide_cursor(), "not on a screen of its own");
    assert!(!person.has_echo(), "keys would be drawn over the picture");
    let picture = glass.contents();
    for part in ["no fault", "from above", "roll", " %, flies", "MHE", "Backspace"] {
        assert!(picture.contains(part), "no `{part}`:\n{picture}");
    }
    // What would be written over it is in it, and is shown again afterwards.
    assert!(picture.contains("ws://127.0.0.1:"), "{picture}");
    // Room, path and plan are drawn in dots: without them the words above would be there all the same.
    let dots = picture.chars().filter(|c| ('\u{2801}'..='\u{28ff}').contains(c)).count();
    assert!(dots > 20, "{dots} characters of dots:\n{picture}");

    person.types(b"e");
    person.sees_drawn("BY HAND");
    person.types(b"q");
    person.sees_drawn(" LANDING ");
    let status = person.ends();
    assert_eq!(status.code(), Some(1), "landed early:\n{}", person.screen());
    let glass = person.glass();
    assert!(!glass.alternate_screen() && !glass.hide_cursor(), "the picture is still there");
    assert!(person.has_echo(), "the terminal is not as it was");
    let left = glass.contents();
    assert!(left.contains("ws://127.0.0.1:") && left.contains("landed"), "{left}");
    let phases = phases(&person.log);
    assert_eq!(phases, ["idle", "taking_off", "flying", "landing", "landed"]);
}

#[test]
fn a_terminal_that_hangs_holds_up_the_end_for_little() {
    let mut person = Person::start_in("hangs", &["--tui"], |_| {});
    person.sees_drawn(" FLYING  controller");
    person.hangs();
    person.types(b"q");
    // The log is closed before the terminal is waited for.
    let is_closed = || {
        let mut log = LogReader::open(&person.log).unwrap();
        while log.next_message().unwrap().is_some() {}
        log.ending().unwrap().is_complete()
    };
    let clock = Clock::start();
    while !is_closed() {
        assert!(clock.now().seconds() < 30.0, "the log is not closed");
        sleep(Duration::from_millis(20));
    }
    let clock = Clock::start();
    assert_eq!(person.ends().code(), Some(1));
    let after_s = clock.now().seconds();
    assert!(after_s < 2.5, "it ends {after_s} s after its log");
}
