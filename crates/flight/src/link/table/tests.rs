use serde_json::{Value, json};

use super::*;
use crate::link::tests::table;

/// Keys with the least and the largest of what they may be.
const RANGES: [(&str, f64, f64); 3] = [
    ("dead_time_change_s", 0.0, 0.5),
    ("dead_time_min_ratio", 0.0, 1.0),
    ("outage_stick_max", 0.1, 1.0),
];

/// The key that is refused when `key` of `section`, or of the table itself, is `value`.
fn refused(section: Option<&str>, key: &str, value: f64) -> Option<String> {
    let mut document = serde_json::to_value(table()).unwrap();
    match section {
        Some(section) => document[section][key] = json!(value),
        None => document[key] = json!(value),
    }
    let table: LinkTable = serde_json::from_value(document).unwrap();
    LinkSettings::try_from(&table).err().map(|error| error.key)
}

#[test]
fn every_number_has_to_be_positive_and_is_refused_by_its_own_key() {
    let document = serde_json::to_value(table()).unwrap();
    let mut checked = 0;
    let mut check = |section: Option<&str>, key: &str| {
        let name = section.map_or(key.to_owned(), |section| format!("{section}.{key}"));
        for bad in [0.0, -1.0] {
            assert_eq!(refused(section, key, bad).as_ref(), Some(&name), "{bad}");
        }
        checked += 1;
    };
    for (key, value) in document.as_object().unwrap() {
        match value {
            Value::Object(section) => section.keys().for_each(|inner| check(Some(key), inner)),
            _ if RANGES.iter().any(|(ranged, ..)| key == ranged) => {}
            _ => check(None, key),
        }
    }
    assert_eq!(checked, 12 + 2 + 3 + 4);
}

#[test]
fn a_number_that_is_not_finite_is_refused_by_its_own_key() {
    let refused = |table: LinkTable| LinkSettings::try_from(&table).unwrap_err().key;
    let (dead_time, turn) = (table().dead_time.unwrap(), table().turn.unwrap());
    let height = table().height.unwrap();
    for bad in [f64::NAN, f64::INFINITY] {
        assert_eq!(refused(LinkTable { outage_evidence: bad, ..table() }), "outage_evidence");
        assert_eq!(refused(LinkTable { forget_s: bad, ..table() }), "forget_s");
        let dead_time = Some(DeadTimeTable { adapt_s: bad, ..dead_time });
        assert_eq!(refused(LinkTable { dead_time, ..table() }), "dead_time.adapt_s");
        let turn = Some(TurnTable { sd_disturbance_radps: bad, ..turn });
        assert_eq!(refused(LinkTable { turn, ..table() }), "turn.sd_disturbance_radps");
        let height = Some(HeightTable { sd_z_m: bad, ..height });
        assert_eq!(refused(LinkTable { height, ..table() }), "height.sd_z_m");
    }
}

#[test]
fn what_has_a_range_is_refused_outside_of_it_by_its_own_key() {
    for (key, low, high) in RANGES {
        for good in [low, high] {
            assert_eq!(refused(None, key, good), None, "{key} = {good}");
        }
        for bad in [low - 0.001, high + 0.001, f64::MAX] {
            assert_eq!(refused(None, key, bad).as_deref(), Some(key), "{key} = {bad}");
        }
    }
}

#[test]
fn a_log_from_before_the_newer_keys_keeps_its_behaviour() {
    let mut document = serde_json::to_value(table()).unwrap();
    let older = document.as_object_mut().unwrap();
    let newer = ["dead_time_adapt_s", "dead_time", "turn", "height"];
    for key in newer.into_iter().chain(RANGES.map(|(key, ..)| key)) {
        assert!(older.remove(key).is_some(), "{key}");
    }
    let older: LinkTable = serde_json::from_value(document.clone()).unwrap();
    let expected = LinkTable {
        dead_time_adapt_s: None,
        dead_time_change_s: 0.0,
        dead_time_min_ratio: 0.0,
        outage_stick_max: None,
        dead_time: None,
        turn: None,
        height: None,
        ..table()
    };
    assert_eq!(older, expected);
    assert!(LinkSettings::try_from(&older).is_ok());
    document["colour"] = json!(1);
    assert!(serde_json::from_value::<LinkTable>(document).is_err());
}

#[test]
fn the_filter_of_the_dead_time_has_its_own_noise_and_memory_and_else_those_of_the_link() {
    let own = DeadTimeTable { sd_position_m: 0.003, adapt_s: 700.0 };
    let expected = LinkTable { sd_position_m: 0.003, dead_time_adapt_s: Some(700.0), ..table() };
    assert_eq!(own.of_filter(&table()), expected);
}
