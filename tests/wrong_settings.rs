//! Wrong missions and wrong settings: every mistake of a file is printed once, with file, line, key, value and rule.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::program::{folder, tello_ctl, text};

#[path = "wrong_settings/cases.rs"]
mod cases;

use cases::{MISSIONS, SETTINGS};

/// Asserts that `check` prints all of `expected` about `file` once, and as many mistakes.
fn refuses(folder: &Path, file: &str, expected: &[&str]) {
    let output = tello_ctl(folder, &["check", file]);
    let printed = text(&output);
    assert_eq!(output.status.code(), Some(1), "{printed}");
    for mistake in expected {
        assert_eq!(printed.matches(mistake).count(), 1, "{mistake} in {file}: {printed}");
    }
    let count = printed.trim_end().lines().count();
    let expected_lines = if expected.len() == 1 { 1 } else { expected.len() + 1 };
    assert_eq!(count, expected_lines, "{file}: {printed}");
}

#[test]
fn wrong_missions_print_all_of_their_mistakes_once() {
    let folder = folder("wrong-missions");
    fs::write(folder.join("points.csv"), "t,x,y,z,theta\n0,0,0,1,0\n\n2,0,0,1,0\n1,0,0,1,0\n")
        .unwrap();
    fs::write(folder.join("short.csv"), "t,x,y,z,theta\n0,0,0,1\n1,0,0,1,0\n0.5,north,0,1,0\n")
        .unwrap();
    for (name, mission, expected) in MISSIONS {
        let file = format!("{name}.json");
        fs::write(folder.join(&file), mission).unwrap();
        refuses(&folder, &file, expected);
        // `fly` says the same, and flies nothing.
        let flown = tello_ctl(&folder, &["fly", "--sim", "--mission", &file]);
        assert_eq!(flown.status.code(), Some(2), "{name}: {}", text(&flown));
        for mistake in expected {
            assert_eq!(text(&flown).matches(mistake).count(), 1, "{name}: {}", text(&flown));
        }
    }
}

#[test]
fn wrong_settings_print_all_of_their_mistakes_once() {
    let folder = folder("wrong-settings");
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    fs::create_dir_all(folder.join("missions")).unwrap();
    fs::copy(configs.join("missions/square.json"), folder.join("missions/square.json")).unwrap();
    let valid: Value =
        serde_json::from_slice(&fs::read(configs.join("fly.json")).unwrap()).unwrap();
    for (number, (changes, expected)) in SETTINGS.iter().enumerate() {
        let mut settings = valid.clone();
        for (pointer, new) in *changes {
            let new: Value = serde_json::from_str(new).unwrap();
            let (outside, key) = pointer.rsplit_once('/').unwrap();
            let place = settings.pointer_mut(outside).unwrap();
            match place {
                Value::Array(entries) => entries[key.parse::<usize>().unwrap()] = new,
                place if new.is_null() => drop(place.as_object_mut().unwrap().remove(key)),
                place => place[key] = new,
            }
        }
        let file = format!("settings-{number}.json");
        fs::write(folder.join(&file), serde_json::to_string_pretty(&settings).unwrap()).unwrap();
        refuses(&folder, &file, expected);
    }
}

#[test]
fn wrong_simulators_and_identifications_print_all_of_their_mistakes_once() {
    let folder = folder("wrong-simulators");
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let changed = |file: &str, changes: &[(&str, Value)]| {
        let text = fs::read(configs.join(file)).unwrap();
        let mut settings: Value = serde_json::from_slice(&text).unwrap();
        for (pointer, new) in changes {
            *settings.pointer_mut(pointer).unwrap() = new.clone();
        }
        fs::write(folder.join(file), settings.to_string()).unwrap();
    };
    let faults = json!([
        { "fault": "mocap_gone", "from_s": -1, "for_s": 0 },
        { "fault": { "mocap_heading": { "turn": 1 } }, "from_s": 1, "for_s": 1 }
    ]);
    let sim = [("/faults", faults), ("/drone/sdk", json!("4.0")), ("/battery_pct", json!(150))];
    changed("sim.json", &sim);
    changed("ident.json", &[("/model", json!("quadratic")), ("/map/C_o/3", json!(-4))]);
    for (file, command, expected) in [
        (
            "sim.json",
            &["fly", "--sim", "--sim-config", "sim.json"][..],
            &[
                "faults[0].fault: unknown variant `mocap_gone`",
                "faults[1].fault.mocap_heading",
                "drone.sdk: unknown variant `4.0`",
                "battery_pct = 150: expected",
            ][..],
        ),
        (
            "ident.json",
            &["ident", "--config", "ident.json", "no.mcap"],
            &["model: unknown variant `quadratic`", "map.C_o[3] = -4: expected"],
        ),
    ] {
        for arguments in [&["check", file][..], command] {
            let output = tello_ctl(&folder, arguments);
            let printed = text(&output);
            assert!(matches!(output.status.code(), Some(1 | 2)), "{printed}");
            for mistake in expected {
                assert_eq!(printed.matches(mistake).count(), 1, "{mistake}: {printed}");
            }
        }
    }
}

#[test]
fn a_simulation_of_a_wrong_mission_prints_all_of_its_mistakes_too() {
    let folder = folder("wrong-mission-in-sim");
    let circle = json!({ "circle": { "centre": [0, 0, 1, 0], "radius_m": 0.01, "turns": -1 } });
    fs::write(folder.join("circle.json"), circle.to_string()).unwrap();
    for flown in [["--log", "flight.mcap"], ["--batch", "2"]] {
        let output =
            tello_ctl(&folder, &[&["sim", "--mission", "circle.json"], &flown[..]].concat());
        let printed = text(&output);
        assert_eq!(output.status.code(), Some(2), "{printed}");
        for mistake in
            ["circle.json:1:", "circle.radius_m = 0.01: expected", "circle.turns = -1: expected"]
        {
            assert!(printed.contains(mistake), "{mistake}: {printed}");
        }
    }
}

#[test]
fn schemas_among_the_files_are_passed_over() {
    let folder = folder("schemas");
    for kind in ["fly", "mission"] {
        let schema = tello_ctl(&folder, &["check", "--schema", kind]);
        fs::write(folder.join(format!("{kind}.schema.json")), schema.stdout).unwrap();
    }
    let output = tello_ctl(&folder, &["check", "fly.schema.json", "mission.schema.json"]);
    assert!(output.status.success(), "{}", text(&output));
}

#[test]
fn a_short_mission_with_its_schema_is_surveyed_drawn_and_judged_by_the_room() {
    let folder = folder("short-mission");
    let short = r#"{ "$schema": "mission.schema.json", "waypoints": { "waypoints": [[0, 0, 1, 0], [2, 0, 1, 0]] } }"#;
    fs::write(folder.join("short.json"), short).unwrap();
    let drawn = ["check", "short.json", "--figure", "seen"];
    let output = tello_ctl(&folder, &drawn);
    let printed = text(&output);
    assert_eq!(output.status.code(), Some(0), "{printed}");
    for part in ["length   2.00 m", "box      x 0.00..2.00, y 0.00..0.00", "fastest  ", "slowest  "]
    {
        assert!(printed.contains(part), "{part}: {printed}");
    }
    // The built-in room reaches from -0.2 to 3 m.
    assert!(printed.contains("room     1.20 m or more to its walls"), "{printed}");
    assert!(folder.join("seen.svg").exists() && folder.join("seen.png").exists());
    // Mistakes of the command line, not of the mission.
    for wrong in [
        &drawn[..],
        &["check", "short.json", "--figure", "short.json/seen"],
        &["check", "short.json", "--speed", "3"],
        &["check", "short.json", "--config", "none.json"],
    ] {
        let output = tello_ctl(&folder, wrong);
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        assert!(!text(&output).contains("refused"), "{}", text(&output));
    }
    let again = tello_ctl(&folder, &[&drawn[..], &["--force"]].concat());
    assert_eq!(again.status.code(), Some(0), "{}", text(&again));
    let refused = |name: &str, mission: &str, mistakes: &[&str]| {
        fs::write(folder.join(name), mission).unwrap();
        for arguments in [&["check", name][..], &["fly", "--sim", "--mission", name]] {
            let output = tello_ctl(&folder, arguments);
            let printed = text(&output);
            assert!(matches!(output.status.code(), Some(1 | 2)), "{printed}");
            for mistake in mistakes {
                assert_eq!(printed.matches(mistake).count(), 1, "{mistake}: {printed}");
            }
        }
    };
    let far = "far.json:1:80: waypoints.waypoints[1] = (9.00, 0.00, 1.00) m: expected inside of cycle.supervisor.room: it is 4.00 m outside";
    refused("far.json", &short.replace("[2, 0, 1, 0]", "[9, 0, 1, 0]"), &[far]);
    let points =
        |points: &str| format!("{{ \"trajectory\": {{ \"points\": {{ \"rows\": {points} }} }} }}");
    let fast = [
        "(8.00, 0.00, 1.00) m: expected inside of cycle.supervisor.room: it is 3.00 m outside",
        "m/s at (4.00, 0.00, 1.00) m after 0.5 s: expected at most 3, cycle.supervisor.failsafe.speed_mps",
    ];
    refused("fast.json", &points("[[0, 0, 0, 1, 0], [1, 8, 0, 1, 0]]"), &fast);
    let jump = "m/s at (2.00, 0.00, 1.00) m after 1.0 s: expected at most 3";
    let rows = "[[0, 0, 0, 1, 0], [1, 0, 0, 1, 0], [1.001, 4, 0, 1, 0], [10, 4, 0, 1, 0]]";
    refused("jump.json", &points(rows), &[jump]);
    let turn = "rad/s at (0.00, 0.00, 1.00) m after 0.5 s: expected at most 3, full sticks with cycle.mhe.p_ub[2]";
    refused("turn.json", &points("[[0, 0, 0, 1, 0], [1, 0, 0, 1, 3]]"), &[turn]);
    // What only this vehicle does not follow is flown with a note.
    fs::write(folder.join("late.json"), points("[[0, 0, 0, 1, 0], [3, 4.5, 0, 1, 0]]")).unwrap();
    let output = tello_ctl(&folder, &["check", "late.json"]);
    let printed = text(&output);
    assert_eq!(output.status.code(), Some(0), "{printed}");
    assert!(
        printed.contains("note     2.25 m/s horizontally at (2.25, 0.00, 1.00) m"),
        "{printed}"
    );
    assert!(printed.contains("the vehicle does 1.90 m/s"), "{printed}");
}

#[test]
fn settings_that_do_not_get_to_the_end_of_their_mission_are_valid_and_do_not_pass() {
    let folder = folder("not-to-its-end");
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let mut settings: Value =
        serde_json::from_slice(&fs::read(configs.join("fly.json")).unwrap()).unwrap();
    settings["mission"] = json!(configs.join("missions/square.json"));
    // Sticks that go to one side alone.
    settings["cycle"]["mpc"]["u_lb"] = json!([0, 0, 0, 0]);
    fs::write(folder.join("fly.json"), settings.to_string()).unwrap();
    let output = tello_ctl(&folder, &["check", "fly.json"]);
    let printed = text(&output);
    assert_eq!(output.status.code(), Some(1), "{printed}");
    assert!(printed.contains("fly.json: valid\n"), "{printed}");
    assert!(printed.contains("NOT TO ITS END: "), "{printed}");
}
