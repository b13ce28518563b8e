//! Short campaigns of random faults.

use crate::program;

use serde_json::Value;

use program::{folder, tello_ctl, text};

/// The campaign with 8 seeds and these additional arguments, started in the folder `name`, and what it exits with.
fn campaign(name: &str, arguments: &[&str]) -> (Option<i32>, Vec<u8>) {
    let all = [&["sim", "--batch", "8", "--campaign", "--json"], arguments].concat();
    let output = tello_ctl(&folder(name), &all);
    assert!(output.status.code().is_some_and(|code| code < 2), "{}", text(&output));
    (output.status.code(), output.stdout)
}

#[test]
fn whatever_hides_the_drone_it_comes_down_inside_of_the_room_without_sticks() {
    let (code, stdout) = campaign("campaign_of_one_family", &["--family", "lost", "--seed", "1"]);
    let campaign: Value = serde_json::from_slice(&stdout).unwrap();
    assert_eq!(code, Some(0), "{campaign}");
    let flights = campaign["flights"].as_array().unwrap();
    assert_eq!(flights.len(), 8);
    let landed = flights.iter().filter(|flight| flight["end"] == "landed").count();
    assert!(landed > 5, "only {landed} of 8 flights landed: the others prove little");
    let rows = campaign["families"].as_array().unwrap();
    assert_eq!(rows.len(), 1);
    let row = &rows[0];
    assert_eq!((&row["family"], row["flights"].as_u64()), (&"lost".into(), Some(8)));
    let detected = row["detected"].as_u64().unwrap();
    assert!(detected > 0 && row["neutral_s"][1].as_f64().is_some(), "{row}");
}

#[test]
#[ignore = "16 flights: in .ci/run all"]
fn one_seed_is_one_flight_and_draws_of_all_families() {
    let (_, first) = campaign("campaign", &["--seed", "40"]);
    let (_, again) = campaign("campaign_again", &["--seed", "40", "--threads", "1"]);
    assert!(first == again, "equal arguments print equal bytes");
    let campaign: Value = serde_json::from_slice(&first).unwrap();
    let rows = campaign["families"].as_array().unwrap();
    assert!(rows.len() > 6, "{rows:?}");
}

#[test]
fn a_flight_of_a_campaign_leaves_its_log() {
    let here = folder("campaign_log");
    let arguments =
        ["sim", "--campaign", "--family", "lost", "--seed", "1", "--log", "1.mcap", "--json"];
    let output = tello_ctl(&here, &arguments);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let flight: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(flight["phase"], "landed", "{flight}");
    let report = text(&tello_ctl(&here, &["report", "1.mcap", "--json"]));
    assert!(report.contains("fault mocap lost"), "{report}");
    let replay = tello_ctl(&here, &["replay", "1.mcap"]);
    assert_eq!(replay.status.code(), Some(0), "{}", text(&replay));
}

#[test]
fn a_family_that_does_not_exist_is_refused_with_the_list() {
    let arguments = ["sim", "--batch", "1", "--campaign", "--family", "fog"];
    let output = tello_ctl(&folder("campaign_without_family"), &arguments);
    assert_eq!(output.status.code(), Some(2));
    let error = text(&output);
    assert!(error.contains("still") && error.contains("second_controller"), "{error}");
}
