//! `tello-ctl excite` as its users meet it: a mission for their room, which `ident` learns from.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::program;
use program::{tello_ctl, text};

/// A fresh folder of a test.
fn folder(name: &str) -> PathBuf {
    program::folder(&format!("excite-{name}"))
}

/// The built-in flight settings in a room of other walls, and perhaps with obstacles, as a file.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn in_room(folder: &Path, [x_m, y_m]: [[f64; 2]; 2], obstacles: Value) {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let text = fs::read_to_string(configs.join("fly.json")).unwrap();
    let mut fly: Value = serde_json::from_str(&text).unwrap();
    fly["mission"] = configs.join("missions/square.json").display().to_string().into();
    fly["cycle"]["supervisor"]["room"]["x_m"] = json!(x_m);
    fly["cycle"]["supervisor"]["room"]["y_m"] = json!(y_m);
    fly["cycle"]["obstacles"] = obstacles;
    fs::write(folder.join("fly.json"), fly.to_string()).unwrap();
}

#[test]
fn one_minute_of_flight_tells_the_parameters_of_the_vehicle() {
    let folder = folder("minute");
    let made = tello_ctl(&folder, &["excite"]);
    assert_eq!(made.status.code(), Some(0), "{}", text(&made));
    assert!(text(&made).contains("1.5 m to each side"), "{}", text(&made));
    let arguments = ["ident", "--self-test", "--automatic", "--mission", "excite.json"];
    let output = tello_ctl(&folder, &[&arguments[..], &["--json"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(found["refused"], 0, "{found}");
    for (name, error_max, std_max) in [
        ("lambda_h", 0.08, 0.05),
        ("theta_0", 0.025, 0.015),
        ("tau_h", 0.05, 0.03),
        ("a_max", 0.06, 0.04),
        ("dead time roll, pitch", 0.012, 0.01),
        ("dead time yaw", 0.003, 0.005),
    ] {
        let rows = found["rows"].as_array().unwrap();
        let row = rows.iter().find(|row| row["name"] == name).unwrap();
        let [error, std] = ["error_rms", "std_mean"].map(|of| row[of].as_f64().unwrap());
        assert!(error < error_max && 0.0 < std && std < std_max, "{row}");
    }
}

#[test]
fn the_pattern_is_as_large_as_the_room_allows() {
    let folder = folder("room");
    in_room(&folder, [[-1.0, 4.0], [-2.0, 3.0]], json!([]));
    let made = tello_ctl(&folder, &["excite", "--config", "fly.json"]);
    assert_eq!(made.status.code(), Some(0), "{}", text(&made));
    assert!(text(&made).contains("1.3 m to each side of the centre"), "{}", text(&made));
    let output = tello_ctl(
        &folder,
        &["sim", "--batch", "3", "--config", "fly.json", "--mission", "excite.json", "--json"],
    );
    let flown: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(flown["finished_count"], 3, "{}", text(&output));
    let wall_m = flown["clearance"]["wall_m"].as_f64().unwrap();
    assert!(wall_m > 1.0, "{wall_m}");

    for (wrong, reason) in [
        (&["--half-width", "1.5"][..], "at most 1.3 around this centre"),
        (&["--centre", "-0.5,0,1.4,0"], "has no place for the smallest pattern"),
        (&["--centre", "1,0"], "--centre needs four numbers"),
        (&["--seconds", "5"], "duration_s"),
        (&["--half-height", "0.9"], "smaller --half-height"),
        (&[], "replace it with --force"),
    ] {
        let arguments = [&["excite", "--config", "fly.json"], wrong].concat();
        let refused = tello_ctl(&folder, &arguments);
        assert_eq!(refused.status.code(), Some(2), "{wrong:?}: {}", text(&refused));
        assert!(text(&refused).contains(reason), "{wrong:?}: {}", text(&refused));
    }
}

#[test]
fn an_obstacle_in_the_pattern_is_refused() {
    let folder = folder("obstacle");
    let column =
        json!([{ "kind": "cylinder", "centre_m": [1.0, 0.5], "radius_m": 0.2, "z_m": [0.0, 2.0] }]);
    in_room(&folder, [[-4.0, 4.0], [-4.0, 4.0]], column);
    let refused = tello_ctl(&folder, &["excite", "--config", "fly.json"]);
    assert_eq!(refused.status.code(), Some(2), "{}", text(&refused));
    assert!(text(&refused).contains("of an obstacle"), "{}", text(&refused));
    assert!(!folder.join("excite.json").exists());
}
