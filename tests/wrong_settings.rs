//! Wrong missions and wrong settings: every mistake of a file is printed once, with file, line, key, value and rule.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::program::{folder, tello_ctl, text};

/// A file, and the mistakes that must be printed, each with its place.
type Case<'a> = (&'a str, &'a str, &'a [&'a str]);

const MISSIONS: [Case<'_>; 23] = [
    (
        "unknown_key",
        "{\n \"waypoints\": {\n  \"waypoints\": [[0, 0, 1, 0], [1, 0, 1, 0]],\n  \"corner\": 0.1,\n  \"speed\": 1\n }\n}",
        &[
            ":4:13: waypoints.corner: unknown field `corner`",
            ":5:12: waypoints.speed: unknown field `speed`",
        ],
    ),
    (
        "missing_and_wrong_type",
        "{ \"circle\": {\n \"centre\": [0, 0, 1, 0],\n \"turns\": \"two\"\n} }",
        &[":3:11: circle.turns: invalid type", ":1:13: circle: missing field `radius_m`"],
    ),
    (
        "ranges",
        "{ \"circle\": { \"centre\": [0, 0, 1, 0],\n \"radius_m\": 0.01,\n \"turns\": -1,\n \"limits\": { \"speed_max_mps\": 0 } } }",
        &[
            ":2:14: circle.radius_m = 0.01 violates 0.05..=50",
            ":3:11: circle.turns = -1 violates",
            ":4:31: circle.limits.speed_max_mps = 0 violates",
        ],
    ),
    (
        "follow",
        "{ \"spline\": { \"waypoints\": [[0, 0, 1, 0], [1, 0, 1, 0], [1, 1, 1, 0]],\n \"follow\": { \"reach\": 0,\n \"wait\": { \"begin_m\": 0.5, \"stop_m\": 0.2 } } } }",
        &[
            ":2:23: spline.follow.reach = 0 violates",
            ":3:38: spline.follow.wait.stop_m = 0.2 violates",
        ],
    ),
    (
        "same_place",
        "{ \"waypoints\": { \"waypoints\": [[0, 0, 1, 0],\n [0, 0, 1, 0]] } }",
        &[":2:2: waypoints.waypoints[1] = [0.0, 0.0, 1.0, 0.0] violates at least 0.01 m"],
    ),
    (
        "short_pose",
        "{ \"targets\": { \"reach\": 0.001,\n \"targets\": [[0, 0, 1]] } }",
        &[":2:14: targets.targets[0]: invalid length 3", ":1:25: targets.reach = 0.001 violates"],
    ),
    (
        "empty",
        "{ \"targets\": {\n \"targets\": [] } }",
        &[":2:13: targets.targets = [] violates at least one target"],
    ),
    (
        "heading_and_corner",
        "{ \"waypoints\": { \"waypoints\": [[0, 0, 1, 0], [1, 0, 1, 0]],\n \"heading\": \"north\",\n \"corner_m\": 0.5 } }",
        &[
            ":2:13: waypoints.heading: unknown variant `north`",
            ":3:14: waypoints.corner_m = 0.5 violates below",
        ],
    ),
    (
        "times_of_rows",
        "{ \"trajectory\": { \"accel_max_mps2\": 0,\n \"points\": { \"rows\": [[0, 0, 0, 1, 0], [2, 0, 0, 1, 0],\n [1, 0, 0, 1, 0]] } } }",
        &[
            ":3:3: trajectory.points[2][0] = 1 violates above the time before",
            ":1:37: trajectory.accel_max_mps2 = 0 violates",
        ],
    ),
    (
        "times_of_csv",
        "{ \"trajectory\": { \"points\": { \"csv\": \"points.csv\" } } }",
        &["points.csv:5:1: t = 1 violates above the time before, 2"],
    ),
    (
        "twice",
        "{ \"waypoints\": { \"waypoints\": [[0, 0, 1, 0], [1, 0, 1, 0]],\n \"corner_m\": 0.1, \"corner_m\": 0.15 } }",
        &[":2:31: waypoints.corner_m is there twice"],
    ),
    (
        "two_kinds",
        "{ \"circle\": { \"centre\": [0, 0, 1, 0], \"radius_m\": 1 },\n \"targets\": { \"targets\": [[0, 0, 1, 0]] } }",
        &[":1:1: one kind is expected, found `circle`, `targets`"],
    ),
    (
        "bracket",
        "{ \"waypoints\": {\n \"waypoints\": [[0, 0, 1, 0], [1, 0, 1, 0] } }",
        &["expected `,` or `]`"],
    ),
    (
        "infinite",
        "{ \"circle\": { \"centre\": [0, 0, 1, 0], \"radius_m\": 1e999 } }",
        &["circle.radius_m = 1e999 violates finite"],
    ),
    (
        "null_and_text",
        "{ \"waypoints\": { \"waypoints\": [[0, 0, 1, 0], [1, 0, 1, \"0\"]],\n \"laps\": 0,\n \"limits\": { \"speed_max_mps\": -1, \"climb_max_mps\": null } } }",
        &[
            ":3:52: waypoints.limits.climb_max_mps: invalid type: null",
            ":1:56: waypoints.waypoints[1][3]: invalid type: string",
            ":2:10: waypoints.laps = 0 violates 1..=100",
            ":3:31: waypoints.limits.speed_max_mps = -1 violates",
        ],
    ),
    (
        "no_csv",
        "{ \"trajectory\": { \"points\": {\n \"csv\": \"nothing.csv\" } } }",
        &[":2:9: trajectory.points.csv: cannot read nothing.csv"],
    ),
    (
        "short_row_of_csv",
        "{ \"trajectory\": { \"points\": {\n \"csv\": \"short.csv\" } } }",
        &[
            "short.csv:2:1: 4 fields instead of 5",
            "short.csv:4:5: `north` is no finite number",
            "short.csv:4:1: t = 0.5 violates above the time before, 1",
        ],
    ),
    (
        "short_row",
        "{ \"trajectory\": { \"points\": { \"rows\": [[0, 0, 0, 1],\n [1, 0, 0, 1, 0]] } } }",
        &["invalid length 4"],
    ),
    (
        "few_and_wrong_type",
        "{ \"spline\": { \"waypoints\": [[0, 0, 1, 0]],\n \"closed\": \"yes\" } }",
        &[
            ":2:12: spline.closed: invalid type: string",
            ":1:28: spline.waypoints = 1 violates 3..=300 poses",
        ],
    ),
    (
        "count_and_limits",
        "{ \"waypoints\": { \"waypoints\": [[0, 0, 1, 0]],\n \"limits\": { \"turn_max_radps\": 0, \"climb_max_mps\": -1 } } }",
        &[
            ":1:31: waypoints.waypoints = 1 violates 2..=300 poses",
            ":2:32: waypoints.limits.turn_max_radps = 0 violates",
            ":2:52: waypoints.limits.climb_max_mps = -1 violates",
        ],
    ),
    (
        "not_finite_and_more",
        "{ \"circle\": { \"centre\": [NaN, 0, 1, -Infinity],\n \"radius_m\": 60, \"turns\": \"two\" } }",
        &[
            ":1:26: circle.centre[0] = NaN violates finite",
            ":1:37: circle.centre[3] = -Infinity violates finite",
            ":2:14: circle.radius_m = 60 violates 0.05..=50",
            ":2:27: circle.turns: invalid type: string \"two\", expected a number",
        ],
    ),
    (
        "two_outside",
        "{ \"targets\": { \"targets\": [[0, 0, 1, 0],\n [0, 0, 9, 0], [0, 0, 1, 0],\n [9, 0, 1, 0]] } }",
        &[
            ":2:2: targets.targets[1] = (0.00, 0.00, 9.00) m violates inside of cycle.supervisor.room",
            ":3:2: targets.targets[3] = (9.00, 0.00, 1.00) m violates inside of cycle.supervisor.room",
        ],
    ),
    ("nothing", "", &["nothing.json:1:0: EOF while parsing a value"]),
];

/// Changes of the built-in settings: pointers and values; null removes.
type Changes<'a> = &'a [(&'a str, &'a str)];

const SETTINGS: [(Changes<'_>, &[&str]); 25] = [
    (
        &[("/cycle/dt_s", "-1"), ("/manual/rate", "3")],
        &["cycle.dt_s = -1 violates", "manual.rate: unknown field `rate`"],
    ),
    (
        &[("/cycle/mpc/C_u", "\"high\""), ("/cycle/mpc/horizon_steps", "0"), ("/log/folder", "1")],
        &[
            "cycle.mpc.C_u: invalid type",
            "cycle.mpc.horizon_steps = 0",
            "log.folder: unknown field",
        ],
    ),
    (
        &[("/cycle/mhe/window_steps", "1"), ("/manual/deflection", "7")],
        &["cycle.mhe.window_steps = 1 violates 2..=200", "manual.deflection = 7 violates"],
    ),
    (
        &[("/cycle/mpc/C_u", "null"), ("/tello", "null")],
        &["cycle.mpc: missing field `C_u`", "missing field `tello`"],
    ),
    (
        &[("/cycle/filter/floor_m", "true"), ("/cycle/gate/stick_max", "2")],
        &["cycle.filter.floor_m: invalid type", "cycle.gate.stick_max = 2"],
    ),
    (
        &[
            ("/cycle/supervisor/stale_s", "0.8"),
            ("/cycle/mpc/C_u/1", "-1"),
            ("/cycle/supervisor/failsafe/speed_mps", "0"),
        ],
        &[
            "cycle.gate.stale_s = 0.5 violates at least cycle.supervisor.stale_s = 0.8",
            "cycle.mpc.C_u[1] = -1 violates",
            "cycle.supervisor.failsafe.speed_mps = 0 violates",
        ],
    ),
    (
        &[("/cycle/supervisor/stale_s", "0"), ("/cycle/mhe/C_o/1", "-1")],
        &["cycle.supervisor.stale_s = 0 violates", "cycle.mhe.C_o[1] = -1 violates"],
    ),
    (
        &[("/mission", "\"nowhere.json\""), ("/cycle/dt_s", "5")],
        &["cannot read", "cycle.dt_s = 5 violates"],
    ),
    (
        &[("/cycle/pipeline", "\"fast\""), ("/cycle/deadline_s", "1")],
        &["cycle.pipeline: unknown variant `fast`", "cycle.deadline_s = 1 violates"],
    ),
    (
        &[("/cycle/dead_time_s/0", "-1"), ("/cycle/mpc/u_lb/0", "0.5")],
        &["cycle.dead_time_s[0] = -1 violates", "cycle.mpc.u_lb[0]"],
    ),
    (
        &[("/cycle/mpc/solver/qp", "\"magic\""), ("/cycle/mpc/solver/iterations_max", "0")],
        &["cycle.mpc.solver.qp: unknown variant `magic`", "cycle.mpc.solver.iterations_max = 0"],
    ),
    (
        &[("/mocap", "{ \"datastream\": { \"address\": \"nowhere\", \"object\": \"\" } }")],
        &[
            "mocap.datastream.address = nowhere violates",
            "mocap.datastream.object = \"\" violates a name",
        ],
    ),
    (
        &[
            ("/mocap", "{ \"natnet\": { \"address\": \"a:1\", \"body\": \"b\" } }"),
            ("/tello/address", "\"192.168.10.1\""),
        ],
        &[
            "mocap.natnet.body: unknown field `body`",
            "mocap.natnet: missing field `object`",
            "tello.address = 192.168.10.1 violates",
        ],
    ),
    (
        &[("/mocap", "{}"), ("/tello/port", "8889")],
        &["mocap: one kind is expected, found none", "tello.port: unknown field `port`"],
    ),
    (
        &[("/mocap/vrpn", "{ \"address\": \"a:1\" }"), ("/cycle/deadline_s", "-1")],
        &["mocap: one kind is expected, found `relay`, `vrpn`", "cycle.deadline_s = -1 violates"],
    ),
    (
        &[("/cycle/supervisor/room/x_m", "[2, -2]"), ("/cycle/supervisor/room/floor", "0")],
        &["cycle.supervisor.room.x_m = -2 violates above 2", "room.floor: unknown field `floor`"],
    ),
    (
        &[("/cycle/mpc/horizon_steps", "10.5"), ("/cycle/dt_s", "\"0.02\"")],
        &["cycle.mpc.horizon_steps: invalid type", "cycle.dt_s: invalid type: string"],
    ),
    (
        &[("/cycle/mpc/C_u", "[1, 2]"), ("/real_time/core", "-1")],
        &["cycle.mpc.C_u = [1.0, 2.0] violates 4 entries", "real_time.core: invalid value"],
    ),
    (
        &[("/cycle/mpc/stages/0", "1"), ("/real_time/frame_wait_s", "9")],
        &["cycle.mpc.stages[0]: invalid type", "real_time.frame_wait_s = 9 violates 0.0..=0.005"],
    ),
    (
        &[("/cycle/obstacles", "[{ \"radius_m\": 1 }]"), ("/log/dir", "3")],
        &["cycle.obstacles[0]: missing field `kind`", "log.dir: invalid type: integer"],
    ),
    (
        &[(
            "/cycle/obstacles",
            "[{ \"kind\": \"cylinder\", \"centre_m\": [0, 0], \"radius_m\": -1, \"z_m\": [0, 1] }, \
             { \"kind\": \"sphere\", \"radius_m\": 1 }, { \"kind\": \"box\", \"x_m\": [1, 0], \"y_m\": [0, 1] }]",
        )],
        &[
            "cycle.obstacles[0].radius_m = -1 violates",
            "cycle.obstacles[1].kind: unknown variant `sphere`",
            "cycle.obstacles[2]: missing field `z_m`",
            "cycle.obstacles[2].x_m = 0 violates above 1",
        ],
    ),
    (
        &[(
            "/mocap",
            "{ \"vrpn\": { \"address\": \"a:1\", \"object\": \"b\", \"rate_hz\": 0, \
             \"frame\": { \"axes\": [\"x\", \"y\", \"-z\"], \"unit\": \"inch\" } } }",
        )],
        &[
            "mocap.vrpn.frame.unit: unknown variant `inch`",
            "mocap.vrpn.frame.axes = x, y, -z violates a right-handed mapping",
            "mocap.vrpn.rate_hz = 0 violates",
        ],
    ),
    (
        &[
            ("/cycle/mpc/stages/1/1", "-1"),
            ("/cycle/mpc/u_ub/2", "-0.5"),
            ("/cycle/mhe/observation_loss", "{ \"kind\": \"huber\" }"),
        ],
        &[
            "cycle.mpc.stages[1][1]: invalid value: integer `-1`, expected a whole number",
            "cycle.mpc.u_ub[2] = -0.5 violates",
            "cycle.mhe.observation_loss: missing field `scale`",
        ],
    ),
    (
        &[
            ("/cycle/supervisor/battery_low_pct", "5"),
            ("/cycle/supervisor/failsafe/outage_alone_s", "60"),
            ("/cycle/gate", "[]"),
        ],
        &[
            "cycle.supervisor.battery_critical_pct = 8 violates at most battery_low_pct = 5",
            "cycle.supervisor.failsafe.outage_alone_s = 60 violates 1.0..=20.0",
            "cycle.gate: invalid length 0, expected an object",
        ],
    ),
    (
        &[("/log", "[]"), ("/manual/deflection", "\"x\"")],
        &["log: invalid", "manual.deflection: invalid type"],
    ),
];

/// What `check` prints about `file`: all of `expected` once, and so many mistakes.
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
                "battery_pct = 150 violates",
            ][..],
        ),
        (
            "ident.json",
            &["ident", "--config", "ident.json", "no.mcap"],
            &["model: unknown variant `quadratic`", "map.C_o[3] = -4 violates"],
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
fn a_short_mission_with_its_schema_is_surveyed_drawn_and_judged_by_the_room() {
    let folder = folder("short-mission");
    let short = r#"{ "$schema": "mission.schema.json", "waypoints": { "waypoints": [[0, 0, 1, 0], [2, 0, 1, 0]] } }"#;
    fs::write(folder.join("short.json"), short).unwrap();
    let output = tello_ctl(&folder, &["check", "short.json", "--figure", "seen"]);
    let printed = text(&output);
    assert_eq!(output.status.code(), Some(0), "{printed}");
    for part in ["length   2.00 m", "box      x 0.00..2.00, y 0.00..0.00", "fastest  ", "slowest  "]
    {
        assert!(printed.contains(part), "{part}: {printed}");
    }
    // The built-in room reaches from -0.2 to 3 m.
    assert!(printed.contains("room     1.20 m or more to its walls"), "{printed}");
    assert!(folder.join("seen.svg").exists() && folder.join("seen.png").exists());
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
    let far = "far.json:1:80: waypoints.waypoints[1] = (9.00, 0.00, 1.00) m violates inside of cycle.supervisor.room: it is 4.00 m outside";
    refused("far.json", &short.replace("[2, 0, 1, 0]", "[9, 0, 1, 0]"), &[far]);
    let points =
        |points: &str| format!("{{ \"trajectory\": {{ \"points\": {{ \"rows\": {points} }} }} }}");
    let fast = [
        "(8.00, 0.00, 1.00) m violates inside of cycle.supervisor.room: it is 3.00 m outside",
        "m/s at (4.00, 0.00, 1.00) m after 0.5 s violates at most 3, cycle.supervisor.failsafe.speed_mps",
    ];
    refused("fast.json", &points("[[0, 0, 0, 1, 0], [1, 8, 0, 1, 0]]"), &fast);
    let turn = "rad/s at (0.00, 0.00, 1.00) m after 0.5 s violates at most 3, full sticks with cycle.mhe.p_ub[2]";
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
