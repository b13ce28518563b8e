use serde_json::{Value, json};

use super::*;

fn read(document: &Value) -> Result<MonitorTable, String> {
    serde_json::from_value(document.clone()).map_err(|error| error.to_string())
}

/// The usual table with `key` as `value`, checked; what is refused, as its message.
fn check(key: &str, value: &Value) -> Result<(), String> {
    let mut document = serde_json::to_value(MonitorTable::default()).unwrap();
    document[key] = value.clone();
    let table = read(&document)?;
    let settings = MonitorSettings::try_from(&table).map_err(|error| error.to_string())?;
    assert_eq!(settings.0, table);
    Ok(())
}

#[test]
fn limits_hold_at_both_ends_and_are_named_in_the_refusal() {
    for (key, low, high, rule) in [
        ("still_m", 0.0005_f64, 0.01_f64, "0.0005..=0.01"),
        ("displacement_m", 0.2, 5.0, "0.2..=5.0"),
        ("height_m", 0.2, 5.0, "0.2..=5.0"),
        ("heading_rad", 0.2, 1.5, "0.2..=1.5"),
        ("direction_rad", 0.5, 1.5, "0.5..=1.5"),
    ] {
        for good in [low, high] {
            assert_eq!(check(key, &json!(good)), Ok(()), "{key}");
        }
        for bad in [low.next_down(), high.next_up()] {
            assert_eq!(check(key, &json!(bad)), Err(format!("{key} = {bad}: expected {rule}")));
        }
    }
}

#[test]
fn a_monitor_can_be_switched_off_but_neither_stillness_nor_direction() {
    for key in ["displacement_m", "height_m", "heading_rad"] {
        assert_eq!(check(key, &Value::Null), Ok(()), "{key}");
    }
    for key in ["still_m", "direction_rad"] {
        assert!(check(key, &Value::Null).unwrap_err().starts_with("invalid type: null"), "{key}");
    }
}

#[test]
fn a_key_that_is_missing_or_unknown_is_refused_save_the_newest() {
    let usual = serde_json::to_value(MonitorTable::default()).unwrap();
    for key in usual.as_object().unwrap().keys() {
        let mut without = usual.clone();
        without.as_object_mut().unwrap().remove(key);
        match read(&without) {
            Ok(table) => {
                assert_eq!((key.as_str(), table.heading_rad), ("heading_rad", Some(0.6)));
            }
            Err(error) => assert_eq!(error, format!("missing field `{key}`")),
        }
    }
    let mut more = usual;
    more["colour"] = json!(1);
    assert!(read(&more).unwrap_err().starts_with("unknown field `colour`"));
}

#[test]
fn logs_without_monitors_are_checked_by_the_settings_of_the_usual_flight() {
    let text = include_str!("../../../../../configs/fly.json");
    let document: Value = serde_json::from_str(text).unwrap();
    assert_eq!(read(&document["cycle"]["monitors"]), Ok(MonitorTable::default()));
}
