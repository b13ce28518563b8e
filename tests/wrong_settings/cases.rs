//! Wrong missions and settings, each with all of its mistakes.

/// A file, and the mistakes that must be printed, each with its place.
pub(super) type Case<'a> = (&'a str, &'a str, &'a [&'a str]);

pub(super) const MISSIONS: [Case<'_>; 23] = [
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
            ":2:14: circle.radius_m = 0.01: expected 0.05..=50",
            ":3:11: circle.turns = -1: expected",
            ":4:31: circle.limits.speed_max_mps = 0: expected",
        ],
    ),
    (
        "follow",
        "{ \"spline\": { \"waypoints\": [[0, 0, 1, 0], [1, 0, 1, 0], [1, 1, 1, 0]],\n \"follow\": { \"reach\": 0,\n \"wait\": { \"begin_m\": 0.5, \"stop_m\": 0.2 } } } }",
        &[
            ":2:23: spline.follow.reach = 0: expected",
            ":3:38: spline.follow.wait.stop_m = 0.2: expected",
        ],
    ),
    (
        "same_place",
        "{ \"waypoints\": { \"waypoints\": [[0, 0, 1, 0],\n [0, 0, 1, 0]] } }",
        &[":2:2: waypoints.waypoints[1] = [0.0, 0.0, 1.0, 0.0]: expected at least 0.01 m"],
    ),
    (
        "short_pose",
        "{ \"targets\": { \"reach\": 0.001,\n \"targets\": [[0, 0, 1]] } }",
        &[":2:14: targets.targets[0]: invalid length 3", ":1:25: targets.reach = 0.001: expected"],
    ),
    (
        "empty",
        "{ \"targets\": {\n \"targets\": [] } }",
        &[":2:13: targets.targets = []: expected at least one target"],
    ),
    (
        "heading_and_corner",
        "{ \"waypoints\": { \"waypoints\": [[0, 0, 1, 0], [1, 0, 1, 0]],\n \"heading\": \"north\",\n \"corner_m\": 0.5 } }",
        &[
            ":2:13: waypoints.heading: unknown variant `north`",
            ":3:14: waypoints.corner_m = 0.5: expected below",
        ],
    ),
    (
        "times_of_rows",
        "{ \"trajectory\": { \"accel_max_mps2\": 0,\n \"points\": { \"rows\": [[0, 0, 0, 1, 0], [2, 0, 0, 1, 0],\n [1, 0, 0, 1, 0]] } } }",
        &[
            ":3:3: trajectory.points[2][0] = 1: expected above the time before",
            ":1:37: trajectory.accel_max_mps2 = 0: expected",
        ],
    ),
    (
        "times_of_csv",
        "{ \"trajectory\": { \"points\": { \"csv\": \"points.csv\" } } }",
        &["points.csv:5:1: t = 1: expected above the time before, 2"],
    ),
    (
        "twice",
        "{ \"waypoints\": { \"waypoints\": [[0, 0, 1, 0], [1, 0, 1, 0]],\n \"corner_m\": 0.1, \"corner_m\": 0.15 } }",
        &[":2:31: waypoints.corner_m occurs twice"],
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
        &["circle.radius_m = 1e999: expected finite"],
    ),
    (
        "null_and_text",
        "{ \"waypoints\": { \"waypoints\": [[0, 0, 1, 0], [1, 0, 1, \"0\"]],\n \"laps\": 0,\n \"limits\": { \"speed_max_mps\": -1, \"climb_max_mps\": null } } }",
        &[
            ":3:52: waypoints.limits.climb_max_mps: invalid type: null",
            ":1:56: waypoints.waypoints[1][3]: invalid type: string",
            ":2:10: waypoints.laps = 0: expected 1..=100",
            ":3:31: waypoints.limits.speed_max_mps = -1: expected",
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
            "short.csv:4:1: t = 0.5: expected above the time before, 1",
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
            ":1:28: spline.waypoints = 1: expected 3..=300 poses",
        ],
    ),
    (
        "count_and_limits",
        "{ \"waypoints\": { \"waypoints\": [[0, 0, 1, 0]],\n \"limits\": { \"turn_max_radps\": 0, \"climb_max_mps\": -1 } } }",
        &[
            ":1:31: waypoints.waypoints = 1: expected 2..=300 poses",
            ":2:32: waypoints.limits.turn_max_radps = 0: expected",
            ":2:52: waypoints.limits.climb_max_mps = -1: expected",
        ],
    ),
    (
        "not_finite_and_more",
        "{ \"circle\": { \"centre\": [NaN, 0, 1, -Infinity],\n \"radius_m\": 60, \"turns\": \"two\" } }",
        &[
            ":1:26: circle.centre[0] = NaN: expected finite",
            ":1:37: circle.centre[3] = -Infinity: expected finite",
            ":2:14: circle.radius_m = 60: expected 0.05..=50",
            ":2:27: circle.turns: invalid type: string \"two\", expected a number",
        ],
    ),
    (
        "two_outside",
        "{ \"targets\": { \"targets\": [[0, 0, 1, 0],\n [0, 0, 9, 0], [0, 0, 1, 0],\n [9, 0, 1, 0]] } }",
        &[
            ":2:2: targets.targets[1] = (0.00, 0.00, 9.00) m: expected inside of cycle.supervisor.room",
            ":3:2: targets.targets[3] = (9.00, 0.00, 1.00) m: expected inside of cycle.supervisor.room",
        ],
    ),
    ("nothing", "", &["nothing.json:1:0: EOF while parsing a value"]),
];

/// Changes of the built-in settings: pointers and values; null removes.
pub(super) type Changes<'a> = &'a [(&'a str, &'a str)];

pub(super) const SETTINGS: [(Changes<'_>, &[&str]); 27] = [
    (
        &[("/cycle/dt_s", "-1"), ("/manual/rate", "3")],
        &["cycle.dt_s = -1: expected", "manual.rate: unknown field `rate`"],
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
        &["cycle.mhe.window_steps = 1: expected 2..=200", "manual.deflection = 7: expected"],
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
            "cycle.gate.stale_s = 0.5: expected at least cycle.supervisor.stale_s = 0.8",
            "cycle.mpc.C_u[1] = -1: expected",
            "cycle.supervisor.failsafe.speed_mps = 0: expected",
        ],
    ),
    (
        &[("/cycle/supervisor/stale_s", "0"), ("/cycle/mhe/C_o/1", "-1")],
        &["cycle.supervisor.stale_s = 0: expected", "cycle.mhe.C_o[1] = -1: expected"],
    ),
    (
        &[("/mission", "\"nowhere.json\""), ("/cycle/dt_s", "5")],
        &["cannot read", "cycle.dt_s = 5: expected"],
    ),
    (
        &[("/cycle/pipeline", "\"fast\""), ("/cycle/deadline_s", "1")],
        &["cycle.pipeline: unknown variant `fast`", "cycle.deadline_s = 1: expected"],
    ),
    (
        &[("/cycle/dead_time_s/0", "-1"), ("/cycle/mpc/u_lb/0", "0.5")],
        &["cycle.dead_time_s[0] = -1: expected", "cycle.mpc.u_lb[0]"],
    ),
    (
        &[("/cycle/mpc/solver/qp", "\"magic\""), ("/cycle/mpc/solver/iterations_max", "0")],
        &["cycle.mpc.solver.qp: unknown variant `magic`", "cycle.mpc.solver.iterations_max = 0"],
    ),
    (
        &[("/mocap", "{ \"datastream\": { \"address\": \"nowhere\", \"object\": \"\" } }")],
        &[
            "mocap.datastream.address = nowhere: expected",
            "mocap.datastream.object = \"\": expected a name",
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
            "tello.address = 192.168.10.1: expected",
        ],
    ),
    (
        &[("/mocap", "{}"), ("/tello/port", "8889")],
        &["mocap: one kind is expected, found none", "tello.port: unknown field `port`"],
    ),
    (
        &[("/mocap/vrpn", "{ \"address\": \"a:1\" }"), ("/cycle/deadline_s", "-1")],
        &["mocap: one kind is expected, found `relay`, `vrpn`", "cycle.deadline_s = -1: expected"],
    ),
    (
        &[("/cycle/supervisor/room/x_m", "[2, -2]"), ("/cycle/supervisor/room/floor", "0")],
        &[
            "cycle.supervisor.room.x_m = [2, -2]: expected the first number",
            "room.floor: unknown field `floor`",
        ],
    ),
    (
        &[("/cycle/supervisor/room", "[[-2, 2], [-3, 1], [-1, 2.5], 0.8]")],
        &["cycle.supervisor.room: invalid type: sequence, expected an object"],
    ),
    (
        &[("/cycle/supervisor/room/y_m", "[-3000, 1000]")],
        &["cycle.supervisor.room.y_m = -3000: expected -500..=500, in metres"],
    ),
    (
        &[("/cycle/mpc/horizon_steps", "10.5"), ("/cycle/dt_s", "\"0.02\"")],
        &["cycle.mpc.horizon_steps: invalid type", "cycle.dt_s: invalid type: string"],
    ),
    (
        &[("/cycle/mpc/C_u", "[1, 2]"), ("/real_time/core", "-1")],
        &["cycle.mpc.C_u = [1.0, 2.0]: expected 4 entries", "real_time.core: invalid value"],
    ),
    (
        &[("/cycle/mpc/stages/0", "1"), ("/real_time/frame_wait_s", "9")],
        &["cycle.mpc.stages[0]: invalid type", "real_time.frame_wait_s = 9: expected 0.0..=0.005"],
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
            "cycle.obstacles[0].radius_m = -1: expected",
            "cycle.obstacles[1].kind: unknown variant `sphere`",
            "cycle.obstacles[2]: missing field `z_m`",
            "cycle.obstacles[2].x_m = [1, 0]: expected the first number",
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
            "mocap.vrpn.frame.axes = x, y, -z: expected a right-handed mapping",
            "mocap.vrpn.rate_hz = 0: expected",
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
            "cycle.mpc.u_ub[2] = -0.5: expected",
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
            "cycle.supervisor.battery_critical_pct = 8: expected at most battery_low_pct = 5",
            "cycle.supervisor.failsafe.outage_alone_s = 60: expected 1.0..=20.0",
            "cycle.gate: invalid type: sequence, expected an object",
        ],
    ),
    (
        &[("/log", "[]"), ("/manual/deflection", "\"x\"")],
        &["log: invalid", "manual.deflection: invalid type"],
    ),
];
