//! Valid files that the mistakes of a wrong file are replaced from: of the same kinds, with as many entries in their
//! lists.

use serde_json::{Value, json};

use super::super::{BUILT_IN_FLY, BUILT_IN_MISSION, SCHEMA, parse};

/// A valid mission of each kind.
const MISSIONS: [&str; 5] = [
    BUILT_IN_MISSION,
    include_str!("../../../../../configs/missions/figure_eight.json"),
    include_str!("../../../../../configs/missions/arc.json"),
    include_str!("../../../../../configs/missions/hover.json"),
    include_str!("../../../../../configs/targets/square.json"),
];

/// A valid mission of the kind of `mission`.
pub(super) fn mission_template(mission: &Value) -> Option<Value> {
    let kind = mission.as_object()?.keys().find(|key| *key != SCHEMA)?;
    let valid = MISSIONS.iter().filter_map(|text| parse::<Value>(text).ok());
    valid.into_iter().find(|it| it.get(kind).is_some())
}

/// Valid settings with the kind of motion capture and the obstacles of `settings`.
pub(super) fn fly_template(settings: &Value) -> Option<Value> {
    let mut template: Value = parse(BUILT_IN_FLY).ok()?;
    let kinds = settings.get("mocap").and_then(Value::as_object);
    if let Some((kind, given)) =
        kinds.filter(|kinds| kinds.len() == 1).and_then(|it| it.iter().next())
        && let Some(source) = source(kind, given)
    {
        template["mocap"] = json!({ kind: source });
    }
    if let Some(obstacles) = settings.pointer("/cycle/obstacles").and_then(Value::as_array) {
        template["cycle"]["obstacles"] = obstacles.iter().map(obstacle).collect();
        if obstacles.iter().any(|given| given.get("kind") == Some(&json!("moving"))) {
            template["moving_object"] = json!("object_of_its_own");
        }
    }
    Some(template)
}

/// A valid source of poses of `kind`, with a frame if `given` has one.
fn source(kind: &str, given: &Value) -> Option<Value> {
    let mut valid = match kind {
        "udp" => json!({ "listen": "0.0.0.0:51001", "object": "tello", "rate_hz": 100.0 }),
        "vrpn" => json!({ "address": "127.0.0.1:3883", "object": "tello", "rate_hz": 100.0 }),
        "relay" | "datastream" | "natnet" | "qtm" => {
            json!({ "address": "127.0.0.1:801", "object": "tello" })
        }
        _ => return None,
    };
    if given.get("frame").is_some() && ["natnet", "qtm", "vrpn"].contains(&kind) {
        valid["frame"] = json!({ "axes": ["x", "y", "z"], "nose": "x", "unit": "m" });
    }
    Some(valid)
}

/// A valid obstacle of the kind of `given`.
fn obstacle(given: &Value) -> Value {
    match given.get("kind").and_then(Value::as_str) {
        Some("box") => {
            json!({ "kind": "box", "x_m": [8.0, 9.0], "y_m": [8.0, 9.0], "z_m": [0.0, 1.0] })
        }
        Some("moving") => json!({ "kind": "moving", "radius_m": 0.3 }),
        _ => {
            json!({ "kind": "cylinder", "centre_m": [9.0, 9.0], "radius_m": 0.3, "z_m": [0.0, 1.0] })
        }
    }
}

#[cfg(test)]
mod tests;
