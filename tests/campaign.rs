//! A short campaign of random faults.

mod program;

use serde_json::Value;

use program::{folder, tello_ctl, text};

#[test]
fn whatever_breaks_the_drone_comes_down_inside_of_the_room_without_sticks() {
    let output = tello_ctl(
        &folder("campaign"),
        &["sim", "--batch", "12", "--campaign", "--json", "--seed", "1"],
    );
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let campaign: Value = serde_json::from_slice(&output.stdout).unwrap();
    let flights = campaign["flights"].as_array().unwrap();
    assert_eq!(flights.len(), 12);
    let landed = flights.iter().filter(|flight| flight["end"] == "landed").count();
    assert!(landed > 5, "only {landed} of 12 flights landed: the others prove little");
}
