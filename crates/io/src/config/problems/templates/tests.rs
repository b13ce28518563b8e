use tello_flight::MissionTable;

use super::*;
use crate::config::FlyTable;
use crate::mocap::MocapKind;

#[test]
fn there_is_a_valid_mission_of_every_kind() {
    for &kind in MissionTable::NAMES {
        let mut template = mission_template(&json!({ "$schema": "x", kind: null })).unwrap();
        assert!(template.get(kind).is_some(), "{kind}: {template}");
        template.as_object_mut().unwrap().remove(SCHEMA);
        serde_json::from_value::<MissionTable>(template).unwrap();
    }
    for none in [json!({}), json!({ "$schema": "x" }), json!({ "dance": 1 }), json!([1]), json!(1)]
    {
        assert_eq!(mission_template(&none), None, "{none}");
    }
}

fn table(template: &Value) -> FlyTable {
    let mut template = template.clone();
    template.as_object_mut().unwrap().remove(SCHEMA);
    serde_json::from_value(template).unwrap()
}

#[test]
fn settings_are_replaced_from_ones_with_the_same_source_of_poses() {
    for kind in MocapKind::ALL.map(MocapKind::name) {
        for frame in [None, Some(json!({ "axes": 1 }))] {
            let given = frame.map_or_else(|| json!({}), |frame| json!({ "frame": frame }));
            let has_frame =
                given.get("frame").is_some() && ["natnet", "qtm", "vrpn"].contains(&kind);
            let template = fly_template(&json!({ "mocap": { kind: given } })).unwrap();
            let source = &template["mocap"][kind];
            assert!(source.is_object(), "{kind}: {template}");
            assert_eq!(source.get("frame").is_some(), has_frame, "{kind}");
            table(&template);
        }
    }
    let built_in: Value = parse(BUILT_IN_FLY).unwrap();
    for mocap in [json!({ "sonar": {} }), json!({ "udp": {}, "qtm": {} }), json!({}), json!(7)] {
        let template = fly_template(&json!({ "mocap": mocap })).unwrap();
        assert_eq!(template["mocap"], built_in["mocap"], "{mocap}");
    }
}

#[test]
fn each_obstacle_has_a_valid_one_of_its_kind_in_its_place() {
    let kinds = ["box", "cylinder", "moving", "box"].map(|kind| json!({ "kind": kind, "x": null }));
    let template = fly_template(&json!({ "cycle": { "obstacles": kinds } })).unwrap();
    let obstacles = template["cycle"]["obstacles"].as_array().unwrap();
    let found: Vec<_> = obstacles.iter().map(|one| one["kind"].clone()).collect();
    assert_eq!(found, ["box", "cylinder", "moving", "box"]);
    assert_eq!(template["moving_object"], "object_of_its_own");
    assert_eq!(table(&template).cycle.obstacles.len(), 4);
    // A wrong kind, and none.
    let kinds = [json!({ "kind": "sphere" }), json!(3)];
    let template = fly_template(&json!({ "cycle": { "obstacles": kinds } })).unwrap();
    let obstacles = table(&template).cycle.obstacles;
    assert_eq!(obstacles.len(), 2);
    assert_ne!(template["moving_object"], "object_of_its_own", "only where one moves");
}
