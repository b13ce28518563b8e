//! A short flight of the whole program over each mocap source and each protocol of the drone, from its
//! sockets to its log.

use crate::program;

use std::fs;

use serde_json::{Value, json};

use program::{folder, tello_ctl, text};

/// Flies to a point above the start, holds it for 2 s and lands.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn assert_flies(name: &str, mocap: &Value, protocol: &str) {
    let folder = folder(&format!("flight-{name}"));
    let mut table: Value = serde_json::from_str(include_str!("../configs/fly.json")).unwrap();
    table["mission"] = "above.json".into();
    table["mocap"] = mocap.clone();
    table["tello"]["protocol"] = protocol.into();
    table["cycle"]["supervisor"]["finish_hold_s"] = 2.0.into();
    let above = json!({ "targets": { "reach": 0.2, "targets": [[-2.0, -3.0, 1.2, 0.0]] } });
    fs::write(folder.join("fly.json"), table.to_string()).unwrap();
    fs::write(folder.join("above.json"), above.to_string()).unwrap();
    let arguments = ["fly", "--sim", "--profile", "clean", "--config", "fly.json", "--json"];
    let output = tello_ctl(&folder, &arguments);
    assert_eq!(output.status.code(), Some(0), "{name}: {}", text(&output));
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["phase"], "landed", "{name}: {summary}");
    assert_eq!(summary["targets_reached"], 1, "{name}: {summary}");
    assert_eq!(summary["faults"], json!([]), "{name}: {summary}");
    let stream = &summary["mocap"];
    assert_eq!((&stream["malformed"], &stream["other_object"]), (&json!(0), &json!(0)), "{name}");
    // What was flown can be flown again, so that nothing of the source is missing in the log.
    let log = summary["log"].as_str().unwrap();
    let replayed = tello_ctl(&folder, &["replay", log, "--json"]);
    assert_eq!(replayed.status.code(), Some(0), "{name}: {}", text(&replayed));
}

/// The addresses are those of the simulator, whatever stands here.
#[test]
fn a_datastream_flies_the_drone() {
    let mocap = json!({ "datastream": { "address": "vicon:801", "object": "any" } });
    assert_flies("datastream", &mocap, "binary");
}

#[test]
fn an_object_stream_flies_the_drone() {
    let mocap = json!({ "udp": { "listen": "0.0.0.0:51001", "object": "any", "rate_hz": 100.0 } });
    assert_flies("object-stream", &mocap, "text");
}

#[test]
fn natnet_flies_the_drone() {
    let mocap = json!({ "natnet": { "address": "motive:1510", "object": "any" } });
    assert_flies("natnet", &mocap, "binary");
}

#[test]
fn qtm_flies_the_drone() {
    let mocap = json!({ "qtm": { "address": "qtm:22223", "object": "any" } });
    assert_flies("qtm", &mocap, "text");
}

#[test]
fn vrpn_flies_the_drone() {
    let mocap = json!({ "vrpn": { "address": "vrpn:3883", "object": "any", "rate_hz": 100.0 } });
    assert_flies("vrpn", &mocap, "binary");
}
