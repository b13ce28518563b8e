use clap::Parser;
use serde_json::json;

use super::*;

#[derive(Debug, Parser)]
struct Program {
    #[command(flatten)]
    arguments: Arguments,
}

fn arguments(words: &[&str]) -> Arguments {
    let words = ["tune", "fly.json"].iter().chain(words);
    Program::try_parse_from(words).unwrap().arguments
}

/// One number on either scale.
const OVER: [&str; 4] = ["--over", "a=0..4", "--over-log", "b[0]=0.1..10"];

#[test]
fn the_summary_has_every_number_before_and_at_the_best_try() {
    let setup = Setup {
        document: json!({ "a": 1.0, "b": [1.0] }),
        variables: variables(&arguments(&OVER)).unwrap(),
        weights: Weights::new(&[]),
        sim: tello_sim::settings(None).unwrap(),
        seeds: 1..3,
    };
    let trials = [
        Trial { x: vec![0.25, 0.5], cost: 9.0 },
        Trial { x: vec![0.5, 1.0], cost: 8.0 },
        Trial { x: vec![1.0, 0.0], cost: 8.5 },
    ];
    let summary = summary(&setup, &trials, &trials[0], &trials[1]).unwrap();
    let summary = serde_json::to_value(summary).unwrap();
    assert_eq!(summary["tries"], 3);
    assert_eq!((&summary["cost_before"], &summary["cost"]), (&json!(9.0), &json!(8.0)));
    let numbers = json!([
        { "key": "a", "before": 1.0, "after": 2.0 },
        { "key": "b[0]", "before": 1.0, "after": 10.0 },
    ]);
    assert_eq!(summary["numbers"], numbers);
    assert_eq!((&summary["is_interrupted"], &summary["written"]), (&json!(false), &json!([])));
}

#[test]
fn without_a_number_there_is_nothing_to_search() {
    let error = variables(&arguments(&[])).unwrap_err().to_string();
    assert!(error.starts_with("nothing to search"), "{error}");
    // Zero has no logarithm.
    assert!(variables(&arguments(&["--over-log", "a=0..1"])).is_err());
    let names: Vec<String> = variables(&arguments(&OVER))
        .unwrap()
        .iter()
        .map(|variable| variable.name().to_owned())
        .collect();
    assert_eq!(names, ["a", "b[0]"]);
}

#[test]
fn a_first_step_of_nothing_or_of_more_than_half_the_range_is_refused_before_anything_is_read() {
    for step in ["0", "-0.1", "0.51", "NaN"] {
        let step_word = format!("--step={step}");
        let words = [&OVER[..], &[&step_word]].concat();
        let error = run(&arguments(&words)).unwrap_err().to_string();
        assert_eq!(error, format!("--step {step}: expected above 0, at most 0.5"));
    }
}

#[test]
fn what_is_written_is_the_flight_that_was_best_with_its_mission_beside_it() {
    let folder = std::env::temp_dir().join(format!("tello-ctl-tune-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let (mut table, mission) = config::fly(None, None).unwrap();
    let mut flight = config::flight(&table, mission, Start::Airborne);
    flight.cycle.mpc.c_u[0] *= 2.0;
    let out = folder.join("best.json");
    let written = save(&out, false, &mut table, flight.clone()).unwrap();
    assert_eq!(written, [out.clone(), folder.join("best.mission.json")]);
    let (again, mission) = config::fly(Some(&out), None).unwrap();
    assert_eq!(config::flight(&again, mission, Start::Airborne), flight);
    std::fs::remove_dir_all(&folder).unwrap();
}
