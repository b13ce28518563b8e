use super::super::{MocapSettings, MocapTable};

fn error(text: &str) -> String {
    let table: MocapTable = serde_json::from_str(text).unwrap();
    MocapSettings::try_from(&table).unwrap_err().to_string()
}

#[test]
fn each_protocol_is_chosen_by_its_key() {
    for text in [
        r#"{ "natnet": { "address": "motive:1510", "object": "tello" } }"#,
        r##"{ "natnet": { "address": "motive:1510", "object": "#7", "rate_hz": 120.0 } }"##,
        r#"{ "qtm": { "address": "qtm:22223", "object": "my drone", "frame": { "nose": "y" } } }"#,
        r#"{ "vrpn": { "address": "a:3883", "object": "tello", "rate_hz": 100.0,
              "frame": { "axes": ["x", "-z", "y"], "unit": "mm" } } }"#,
    ] {
        let table: MocapTable = serde_json::from_str(text).unwrap();
        assert!(MocapSettings::try_from(&table).is_ok(), "{text}");
        let back = serde_json::to_value(&table).unwrap();
        assert_eq!(back, serde_json::from_str::<serde_json::Value>(text).unwrap());
    }
}

#[test]
fn protocol_settings_that_break_a_rule_are_refused_with_key_value_and_rule() {
    assert_eq!(
        error(r#"{ "natnet": { "address": "motive", "object": "tello" } }"#),
        "natnet.address = motive: expected host:port"
    );
    assert_eq!(
        error(r#"{ "qtm": { "address": "a:1", "object": "" } }"#),
        "qtm.object = \"\": expected a name"
    );
    let text = r#"{ "vrpn": { "address": "a:1", "object": "t", "rate_hz": 0.0 } }"#;
    assert!(error(text).starts_with("vrpn.rate_hz = 0"));
    let text = r#"{ "natnet": { "address": "a:1", "object": "t", "frame": { "axes": ["x", "z", "y"] } } }"#;
    assert!(error(text).starts_with("natnet.frame.axes = x, z, y: expected a right-handed"));
    let text = r#"{ "natnet": { "address": "a:1", "object": "t", "unit": "mm" } }"#;
    assert!(serde_json::from_str::<MocapTable>(text).is_err(), "unknown keys are");
}
