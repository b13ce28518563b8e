use super::*;
use serde_json::{Value, json};

/// A value that identifies its row; dead zones stay below the half stick that the simulator accepts.
fn value(k: usize) -> f64 {
    0.1 + 0.03125 * k as f64
}

fn file(model: ModelKind) -> Value {
    let entry = |(k, row): (usize, &Row)| {
        let value = value(k);
        let entry =
            json!({ "value": value, "std": 0.1, "lower": null, "upper": 1.7, "unit": row.unit });
        (row.name.to_owned(), entry)
    };
    let parameters: serde_json::Map<String, Value> =
        model.parameters().iter().enumerate().map(entry).collect();
    json!({
        "format": 1,
        "model": model,
        "parameters": parameters,
        "dead_time_s": [0.3, 0.5, 0.1, 0.2],
        "data": [{ "path": "logs/1.log", "sha256": "ab12", "steps": 305 }],
        "settings": { "piece_steps_min": 300 },
        "revision": "0123abc",
    })
}

fn parse(json: &Value) -> Result<ParameterFile> {
    let file: ParameterFile = config::parse(&json.to_string())?;
    file.check()?;
    Ok(file)
}

#[test]
fn a_file_is_read_back_as_it_was_written() {
    for model in ModelKind::ALL {
        let file = parse(&file(model)).unwrap();
        let name = format!("tello-ctl-{}-{}.json", model.name(), std::process::id());
        let path = std::env::temp_dir().join(name);
        file.write(&path).unwrap();
        assert_eq!(ParameterFile::read(&path).unwrap(), file);
        std::fs::remove_file(path).unwrap();
        let expected: Vec<f64> = (0..model.parameters().len()).map(value).collect();
        assert_eq!(file.values(), expected, "in the order of the rows");
    }
}

#[test]
fn what_breaks_a_rule_is_refused_with_its_key() {
    let refusal = |change: &dyn Fn(&mut Value)| {
        let mut json = file(ModelKind::Lagged);
        change(&mut json);
        parse(&json).unwrap_err().to_string()
    };
    let set = |path: &'static str, value: Value| {
        refusal(&move |json| *json.pointer_mut(path).unwrap() = value.clone())
    };
    for (message, part) in [
        (set("/format", json!(2)), "format = 2: expected 1..=1"),
        (set("/model", json!("flying")), "unknown variant `flying`"),
        (set("/model", json!("kinematic")), "expected the parameters of kinematic"),
        (set("/parameters/tau_h/unit", json!("m")), "parameters.tau_h.unit = \"m\": expected s"),
        (set("/parameters/tau_h/std", json!(-1.0)), "parameters.tau_h.std = -1"),
        (
            set("/parameters/tau_h/lower", json!(3.0)),
            "parameters.tau_h.lower = 3: expected at most",
        ),
        (set("/parameters/tau_h/value", json!(null)), "parameters.tau_h.value"),
        (set("/dead_time_s", json!([0.1, 0.1, 0.1])), "4 entries (roll, pitch, yaw, throttle)"),
        (set("/dead_time_s/1", json!(2.5)), "dead_time_s[1] = 2.5: expected 0.0..=2.0"),
        (
            refusal(&|json| drop(json["parameters"].as_object_mut().unwrap().remove("a_max"))),
            "parameters.a_max = nothing: expected a value for each of lambda_h, ",
        ),
        (
            refusal(&|json| json["parameters"]["tau_x"] = json["parameters"]["tau_h"].clone()),
            "tau_x",
        ),
        (
            refusal(&|json| {
                drop(json["parameters"]["tau_h"].as_object_mut().unwrap().remove("std"));
            }),
            "missing field `std`",
        ),
        (refusal(&|json| json["seed"] = json!(3)), "unknown field `seed`"),
    ] {
        assert!(message.contains(part), "{part:?} is not in {message:?}");
    }
}

#[test]
fn a_file_replaces_prior_and_dead_times_of_the_loop() {
    let (table, _) = config::fly(None, None).unwrap();
    let mut json = file(ModelKind::Lagged);
    let p: Vec<f64> = table.cycle.mhe.p_prior.iter().map(|value| 1.01 * value).collect();
    for (row, value) in ModelKind::Lagged.parameters().iter().zip(&p) {
        json["parameters"][row.name]["value"] = json!(value);
    }
    json["dead_time_s"] = json!([0.3, 0.31, 0.1, 0.2]);
    let mut cycle = table.cycle.clone();
    cycle.take(&parse(&json).unwrap()).unwrap();
    let mut expected = table.cycle.clone();
    expected.mhe.p_prior = p;
    expected.dead_time_s = vec![0.3, 0.31, 0.1, 0.2];
    assert_eq!(cycle, expected, "and nothing else");

    json["parameters"]["lambda_h"]["value"] = json!(4.6);
    let error = cycle.take(&parse(&json).unwrap()).unwrap_err().to_string();
    assert!(error.contains("lambda_h = 4.6 m/s lies outside"), "{error}");
    assert!(error.contains("cycle.mhe.p_ub"), "{error}");
    assert_eq!(cycle, expected, "a refused file changes nothing");
}

#[test]
fn a_file_of_another_model_is_refused_with_what_can_be_used() {
    let (mut table, _) = config::fly(None, None).unwrap();
    for model in [ModelKind::Kinematic, ModelKind::KinematicPublished] {
        let error = table.cycle.take(&parse(&file(model)).unwrap()).unwrap_err().to_string();
        assert!(error.contains(model.name()), "{error}");
        assert!(error.contains("the loop runs lagged"), "{error}");
    }
}
