use horizon_model::{Kinematic, Vector};
use serde_json::{Value, json};

use super::*;

fn good() -> Value {
    json!({
        "C_o": [3.0, 3.0, 2.0, 0.0], "C_s": [1.0, 1.0, 1.0, 0.5], "C_p": [0.1, 0.1, 0.1, 0.0],
        "C_0": [0.0, 0.0, 0.0, 2.0],
        "p_prior": [1.0, 0.5, 0.9, 0.0], "p_lb": [0.1, 0.1, 0.1, -0.5], "p_ub": [3.0, 3.0, 3.0, 0.5],
        "observation_loss": { "kind": "huber", "scale": 1.0 }, "transition_loss": { "kind": "none" },
        "curvature": "exact",
        "solver": {
            "damping_start": 1e-8, "cost_tolerance": 1e-12, "step_tolerance": 1e-10,
            "iterations_max": 100
        }
    })
}

fn check(document: Value) -> Result<IdentSettings<4, 4, 4>, String> {
    let table: IdentTable = serde_json::from_value(document).map_err(|error| error.to_string())?;
    table.check::<Kinematic, 4, 4, 4, 4>().map_err(|error| error.to_string())
}

#[test]
fn a_good_table_keeps_its_values_in_their_places() {
    let settings = check(good()).unwrap();
    assert_eq!(settings.c_o, Vector::from([3.0, 3.0, 2.0, 0.0]));
    assert_eq!(settings.c_s, Vector::from([1.0, 1.0, 1.0, 0.5]));
    assert_eq!(settings.c_0, Vector::from([0.0, 0.0, 0.0, 2.0]));
    assert_eq!(settings.prior.p_prior, Vector::from([1.0, 0.5, 0.9, 0.0]));
    assert_ne!(settings.observation_loss, settings.transition_loss);
    let table: IdentTable = serde_json::from_value(good()).unwrap();
    assert_eq!(serde_json::to_value(&table).unwrap(), good());
}

#[test]
fn each_bad_value_is_refused_by_its_own_key() {
    for (pointer, bad, key) in [
        ("/C_o/2", json!(-1.0), "C_o[2]"),
        ("/C_s/3", json!(0.0), "C_s[3]"),
        ("/C_p/1", json!(-0.1), "C_p[1]"),
        ("/C_0/0", json!(-0.1), "C_0[0]"),
        ("/C_0", json!([0.0]), "C_0"),
        ("/p_prior/0", json!(3.1), "p_prior[0]"),
        ("/p_prior/3", json!(-0.6), "p_prior[3]"),
        ("/p_lb/1", json!(4.0), "p_lb[1]"),
        ("/observation_loss/scale", json!(0.0), "observation_loss"),
        ("/solver/iterations_max", json!(0), "solver.iterations_max"),
    ] {
        let mut document = good();
        *document.pointer_mut(pointer).unwrap() = bad.clone();
        let message = check(document).unwrap_err();
        assert!(message.starts_with(key), "{pointer} = {bad}: {message}");
    }
}

#[test]
fn an_unknown_key_and_a_missing_one_are_refused() {
    let mut document = good();
    document["colour"] = json!(1);
    assert!(check(document).unwrap_err().starts_with("unknown field `colour`"));
    for key in good().as_object().unwrap().keys() {
        let mut document = good();
        document.as_object_mut().unwrap().remove(key);
        assert_eq!(check(document).unwrap_err(), format!("missing field `{key}`"));
    }
}
