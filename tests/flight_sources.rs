//! A short flight of the whole program over each mocap source and each protocol of the drone, from its
//! sockets to its log.

use std::fs;

use horizon_model::rows::pose;
use serde_json::{Value, json};
use tello_flight::cycle::Inbox;
use tello_io::log::LogReader;

use crate::program;
use program::{folder, tello_ctl, text};

/// Flies to a point above the start, holds it for 2 s and lands.
fn assert_flies(name: &str, mocap: &Value, protocol: &str) {
    assert_flies_at(name, mocap, protocol, 50.0);
}

/// The same with so many frames per second.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn assert_flies_at(name: &str, mocap: &Value, protocol: &str, rate_hz: f64) {
    let folder = folder(&format!("flight-{name}"));
    let mut table: Value = serde_json::from_str(include_str!("../configs/fly.json")).unwrap();
    table["mission"] = "above.json".into();
    table["mocap"] = mocap.clone();
    table["tello"]["protocol"] = protocol.into();
    table["cycle"]["supervisor"]["finish_hold_s"] = 2.0.into();
    let above = json!({ "targets": { "reach": 0.2, "targets": [[-2.0, -0.5, 1.2, 0.0]] } });
    fs::write(folder.join("fly.json"), table.to_string()).unwrap();
    fs::write(folder.join("above.json"), above.to_string()).unwrap();
    let mut sim: Value = serde_json::from_str(include_str!("../configs/sim.json")).unwrap();
    sim["mocap_rate_hz"] = rate_hz.into();
    fs::write(folder.join("sim.json"), sim.to_string()).unwrap();
    let mut arguments = vec!["fly", "--sim", "--sim-config", "sim.json", "--profile", "clean"];
    arguments.extend(["--config", "fly.json", "--json"]);
    let output = tello_ctl(&folder, &arguments);
    assert_eq!(output.status.code(), Some(0), "{name}: {}", text(&output));
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["phase"], "landed", "{name}: {summary}");
    assert_eq!(summary["targets_reached"], 1, "{name}: {summary}");
    assert_eq!(summary["faults"], json!([]), "{name}: {summary}");
    let stream = &summary["mocap"];
    assert_eq!((&stream["malformed"], &stream["other_object"]), (&json!(0), &json!(0)), "{name}");
    let measured_hz = stream["rate_hz"].as_f64().unwrap();
    assert!((measured_hz / rate_hz - 1.0).abs() < 0.03, "{name}: {stream}");
    assert_eq!((&stream["overflow"], &stream["undated"]), (&json!(0), &json!(0)), "{name}");
    assert_eq!(summary["links"]["sightings_dropped"], 0, "{name}: {summary}");
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
fn faster_sources_fly_the_drone() {
    let relay = json!({ "relay": { "address": "mocap:51602", "object": "any" } });
    assert_flies_at("relay-120", &relay, "binary", 120.0);
    assert_flies_at("relay-240", &relay, "binary", 240.0);
    let natnet = json!({ "natnet": { "address": "motive:1510", "object": "any" } });
    assert_flies_at("natnet-120", &natnet, "binary", 120.0);
    assert_flies_at("natnet-240", &natnet, "binary", 240.0);
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

/// It crosses the place where the vehicle holds still, far from where it takes off and too slowly for one who could
/// turn towards a landing; the relay sends it as an object of its own.
#[test]
fn a_second_object_is_evaded_over_sockets() {
    let folder = folder("flight-moving");
    let mut table: Value = serde_json::from_str(include_str!("../configs/fly.json")).unwrap();
    table["mission"] = "above.json".into();
    table["cycle"]["obstacles"] = json!([{ "kind": "moving", "radius_m": 0.2 }]);
    table["moving_object"] = "passer".into();
    table["cycle"]["supervisor"]["finish_hold_s"] = 8.0.into();
    let above = json!({ "targets": { "reach": 0.2, "targets": [[-2.0, -3.0, 1.2, 0.0]] } });
    let mut sim: Value = serde_json::from_str(include_str!("../configs/sim.json")).unwrap();
    sim["passer"] =
        json!({ "from_m": [-3.8, -0.6, 1.0], "to_m": [-0.2, -0.6, 1.0], "speed_mps": 0.29 });
    for (name, value) in [("fly.json", table), ("above.json", above), ("sim.json", sim)] {
        fs::write(folder.join(name), value.to_string()).unwrap();
    }
    let arguments = [
        "fly",
        "--sim",
        "--sim-config",
        "sim.json",
        "--profile",
        "clean",
        "--config",
        "fly.json",
        "--json",
    ];
    let output = tello_ctl(&folder, &arguments);
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["phase"], "landed", "{summary}: {}", text(&output));
    let log = folder.join(summary["log"].as_str().unwrap());
    let mut reader = LogReader::open(&log).unwrap().select(&["/cycle/inbox"]);
    let (mut unseen, mut unseen_max, mut flown, mut least_m) = (0, 0, 0, f64::INFINITY);
    while let Some(message) = reader.next_message().unwrap() {
        let inbox: Inbox = serde_json::from_slice(message.data).unwrap();
        let Some(at) = inbox.sightings.last().and_then(|newest| newest.pose) else { continue };
        if at[pose::Z] < 0.8 {
            continue;
        }
        flown += 1;
        // Its line is sent after the vehicle's: some ticks get it late, the next one with the newer.
        unseen += 1;
        unseen_max = unseen.max(unseen_max);
        let Some([x, y, _]) = inbox.obstacle_w else { continue };
        unseen = 0;
        least_m = least_m.min((at[pose::X] - x).hypot(at[pose::Y] - y));
    }
    // The plan goes on with what it knows for 0.5 s.
    assert!(unseen_max < 12 && flown > 400, "unseen for {unseen_max} ticks, {flown} ticks");
    // Without the plan it would come to 0.1 m of its axis.
    assert!(least_m > 0.2, "{least_m} m");
}
