use std::fs;

use super::*;

/// The settings after a change, read from a file; all that is wrong with them.
fn read_back(name: &str, change: impl FnOnce(&mut Value)) -> Result<SimTable, String> {
    let mut value: Value = config::parse(BUILT_IN).unwrap();
    change(&mut value);
    let path = std::env::temp_dir().join(format!("tello-sim-{}-{name}.json", std::process::id()));
    fs::write(&path, value.to_string()).unwrap();
    let read = settings(Some(&path)).map_err(|error| format!("{error:#}"));
    fs::remove_file(path).unwrap();
    read
}

#[test]
fn without_a_file_the_built_in_settings_are_read() {
    let unchanged = read_back("unchanged", |_| {}).unwrap();
    assert_eq!(format!("{:?}", settings(None).unwrap()), format!("{unchanged:?}"));
}

#[test]
fn a_file_may_have_faults_a_rigid_body_and_a_start_in_the_air() {
    let changed = read_back("changed", |value| {
        value["faults"] = json!([
            { "fault": "mocap_lost", "from_s": 2.0, "for_s": 0.5 },
            { "fault": "mocap_lost", "from_s": 9.0, "for_s": 0.5 },
        ]);
        value["plant"]["rigid_body"] = serde_json::to_value(RIGID_BODY).unwrap();
        value["start"] = json!({ "air": { "x": 1.0, "y": 0.5, "z": 1.2, "theta": 0.1 } });
    });
    let changed = changed.unwrap();
    assert_eq!(changed.faults.len(), 2);
    assert!(changed.plant.rigid_body.is_some());
    assert!(matches!(changed.start, SimStart::Air { .. }), "{:?}", changed.start);
}

#[test]
fn every_mistake_is_named_by_its_key() {
    let wrong = read_back("wrong", |value| {
        value["faults"] = json!([
            { "fault": "mocap_lost", "from_s": 2.0, "for_s": 0.5 },
            { "fault": "mocap_lost", "from_s": 9.0, "until_s": 0.5 },
        ]);
        let mut body = serde_json::to_value(RIGID_BODY).unwrap();
        body["mass"] = json!(1.0);
        value["plant"]["rigid_body"] = body;
        value["start"] = json!({ "air": { "x": 1.0, "y": 0.5, "z": "high", "theta": 0.1 } });
    });
    let wrong = wrong.unwrap_err();
    for key in ["faults[1].until_s", "plant.rigid_body.mass", "start.air.z"] {
        assert!(wrong.contains(key), "{key} is not in:\n{wrong}");
    }
}
