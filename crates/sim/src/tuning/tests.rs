use serde_json::json;

use super::*;

/// One number on either scale.
fn setup(document: Value) -> Setup {
    let variable =
        |text: &str, scale| Variable::new(&text.parse::<VariableRange>().unwrap(), scale).unwrap();
    Setup {
        document,
        variables: vec![
            variable("a=0..4", Scale::Linear),
            variable("b[0]=0.1..10", Scale::Logarithmic),
        ],
        weights: Weights::new(&[]),
        sim: crate::settings(None).unwrap(),
        seeds: 1..3,
    }
}

#[test]
fn the_search_begins_at_the_present_numbers() {
    let start = setup(json!({ "a": 1.0, "b": [1.0] })).start().unwrap();
    assert_eq!(start.len(), 2);
    assert!((start[0] - 0.25).abs() < 1e-12 && (start[1] - 0.5).abs() < 1e-12, "{start:?}");
    assert!(setup(json!({ "a": 1.0 })).start().is_err(), "b[0] is missing");
}

#[test]
fn a_try_changes_its_numbers_in_a_copy_of_the_settings_alone() {
    let before = json!({ "a": 1.0, "b": [1.0], "c": 7.0 });
    let setup = setup(before.clone());
    let flight = setup.flight(&[0.75, 1.0]).unwrap();
    assert_eq!(flight, json!({ "a": 3.0, "b": [10.0], "c": 7.0 }));
    assert_eq!(setup.document, before);
}

#[test]
fn a_try_that_is_no_flight_is_refused() {
    assert!(setup(json!({ "a": 1.0, "b": [1.0] })).cost(&[0.5, 0.5], &|| false).is_err());
}
