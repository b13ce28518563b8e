use std::fs;

use super::*;

fn config(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs").join(name)
}

/// The values of a file with this text, or why it has none.
fn resolved(name: &str, text: &str) -> Result<Value, String> {
    let path = std::env::temp_dir().join(format!("tello-ctl-check-{}-{name}", std::process::id()));
    fs::write(&path, text).unwrap();
    let resolved = resolve(None, Some(&path));
    fs::remove_file(&path).unwrap();
    resolved.map_err(|error| format!("{error:#}").replace(&path.display().to_string(), "FILE"))
}

#[test]
fn the_kind_of_a_file_follows_from_its_keys() {
    for (name, key) in [
        ("fly.json", "/flight/cycle"),
        ("sim.json", "/profile"),
        ("ident.json", "/map"),
        ("missions/hover.json", "/trajectory"),
        ("missions/square.json", "/waypoints"),
        ("missions/figure_eight.json", "/spline"),
        ("targets/square.json", "/targets"),
    ] {
        let values = resolve(None, Some(&config(name))).unwrap();
        assert!(values.pointer(key).is_some(), "{name}: {values}");
    }
    assert!(resolve(None, None).unwrap().pointer("/flight/mission").is_some());
}

#[test]
fn a_key_of_a_flight_that_occurs_twice_is_no_mistake_of_a_mission() {
    let text = fs::read_to_string(config("fly.json")).unwrap();
    let twice = text.replacen('{', "{ \"manual\": null,", 1);
    let error = resolved("twice.json", &twice).unwrap_err();
    assert!(error.contains("manual occurs twice"), "{error}");
    assert!(!error.contains("one kind is expected"), "{error}");
}

#[test]
fn a_file_of_no_kind_shows_the_keys_that_it_has() {
    let error = resolved("other.json", r#"{ "b": 1, "a": 2 }"#).unwrap_err();
    assert!(error.starts_with("FILE: unknown kind of file: found `a`, `b`, no key"), "{error}");
    for none in ["{}", "[1]", "7"] {
        let error = resolved("none.json", none).unwrap_err();
        assert!(error.starts_with("FILE: unknown kind of file: found none, no key"), "{error}");
    }
}

#[test]
fn parameters_that_the_estimator_does_not_take_are_refused() {
    let lagged = |lambda_v: f64, later_s: f64| {
        let (table, _) = config::fly(None, None).unwrap();
        let entry = |(row, value): (&horizon_model::Row, &f64)| {
            let value = if row.name == "lambda_v" { lambda_v } else { *value };
            let entry = json!({ "value": value, "std": null, "lower": null, "upper": null, "unit": row.unit });
            (row.name.to_owned(), entry)
        };
        let rows = table.cycle.model.parameters().iter().zip(&table.cycle.mhe.p_prior);
        let parameters: serde_json::Map<_, _> = rows.map(entry).collect();
        let dead_time_s = table.cycle.dead_time_s.iter().map(|s| s + later_s).collect::<Vec<_>>();
        let file = json!({
            "format": 1, "model": table.cycle.model, "parameters": parameters, "data": [], "settings": {},
            "dead_time_s": dead_time_s, "revision": "none",
        });
        resolved("params.json", &file.to_string())
    };
    assert!(lagged(0.9, 0.0).is_ok(), "{:?}", lagged(0.9, 0.0));
    for (lambda_v, later_s, key) in [(30.0, 0.0, "lambda_v"), (0.9, 1.5, "cycle.mpc.horizon_steps")]
    {
        let error = lagged(lambda_v, later_s).unwrap_err();
        assert!(error.contains("with the parameters of FILE"), "{error}");
        assert!(error.contains(key), "{error}");
    }
}

#[test]
fn only_missions_and_settings_of_a_flight_have_a_look() {
    let look = |name: &str| {
        let values = resolve(None, Some(&config(name))).unwrap();
        CheckedMission::of(&values, None, SPEED_AS_WRITTEN).unwrap().map(|found| found.look)
    };
    let of_settings = look("fly.json").unwrap();
    assert!(look("sim.json").is_none() && look("ident.json").is_none());
    assert!(of_settings.survey.length_m > 0.0, "{of_settings}");
    assert!(look("missions/hover.json").is_some());
}

#[test]
fn a_look_says_where_the_walls_and_the_obstacles_are() {
    let part = PathPoint { at_w: [1.0, 2.0, 3.0], at_s: 4.25, speed_mps: 0.5 };
    let survey = Survey {
        length_m: 12.345,
        duration_s: 9.87,
        low_w: [-1.0, 0.0, 0.5],
        high_w: [1.0, 2.0, 1.5],
        fastest: Some(part),
        slowest: None,
    };
    let (built_in, mission) = config::fly(None, None).unwrap();
    let flight = config::flight(&built_in, mission, Start::Grounded);
    let nominal = NominalFlight {
        finish_s: Some(7.25),
        distance_p95_m: Some(0.061),
        ..CheckedMission::at(&flight).unwrap().look.nominal
    };
    let look = |room_margin_m, obstacle_margin_m| {
        let (survey, nominal) = (survey.clone(), nominal.clone());
        let notes = vec!["it is too fast".to_owned()];
        Look { survey, room_margin_m, obstacle_margin_m, notes, nominal }.to_string()
    };
    assert_eq!(
        look(Some(0.4), Some(-0.25)),
        "  length   12.35 m\n  time     9.9 s as planned\n\
         \x20 box      x -1.00..1.00, y 0.00..2.00, z 0.50..1.50 m\n\
         \x20 fastest  0.50 m/s at 1.00, 2.00, 3.00 m after 4.2 s\n\
         \x20 room     0.40 m or more to its walls\n\
         \x20 obstacle 0.25 m INSIDE: the plan flies around it\n\
         \x20 flown    in the simulator: 7.2 s from first to last target, 0.06 m off at 95 %, \
         1.49 m to the nearest wall\n\
         \x20 note     it is too fast\n"
    );
    let far = look(None, Some(0.0));
    assert!(far.contains("room     none is set: a real drone does not fly without one\n  obstacle 0.00 m or more to each\n"), "{far}");
    assert!(!look(None, None).contains("obstacle"));
}
