//! The monitors beside real flights: silent where the rigid body was defined right, loud where it was
//! turned by half a turn.

use std::path::Path;

use horizon_model::rows::pose;
use tello_flight::{Findings, MonitorSettings, MonitorTable, Monitors, Sample};

use crate::recorded;
use crate::support;
use recorded::{DT_S, dead_time_s, logs, read};

/// Height from which on the vehicle flies. m
const FLYING_M: f64 = 0.35;

/// Results of the monitors with the built-in settings on a recording, step by step. The recordings have no
/// reports of the drone.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn watch(path: &Path) -> Vec<Findings> {
    let recording = read(path, 0.0);
    let applied = recording.applied(&dead_time_s(), DT_S);
    let settings = MonitorSettings::try_from(&MonitorTable::default()).unwrap();
    let mut monitors = Monitors::new(&settings, DT_S);
    let mut before = None;
    let mut found = Vec::new();
    for (o, u) in recording.o.iter().zip(&applied) {
        let raw = o.is_present[pose::X].then_some(o.o);
        // A repeated pose is a stall of the recording, zeros are an object that was not seen.
        let pose = raw.filter(|now| before != raw && now.amax() > 0.0);
        before = raw;
        let sample = Sample { pose, drone: None, u_applied: *u, link_is_up: true };
        if pose.is_some_and(|now| now[pose::Z] < FLYING_M) {
            monitors.update_on_ground(&sample);
        } else {
            found.push(monitors.update(&sample));
        }
    }
    found
}

#[test]
fn the_identification_flights_raise_no_alarm() {
    let mut steps = 0;
    for folder in ["thesis/ident/raw", "thesis/ident/filt"] {
        let Some(folder) = support::data(folder) else { return };
        for path in logs(&folder, "") {
            let found = watch(&path);
            steps += found.len();
            let still = found.iter().filter(|found| found.still_s.is_some()).count();
            let wrong = found.iter().filter(|found| found.is_direction_wrong).count();
            println!("{}: {} steps, {still} still, {wrong} turned", path.display(), found.len());
            assert_eq!((still, wrong), (0, 0), "{}", path.display());
        }
    }
    assert!(steps > 40_000, "only {steps} steps");
}

#[test]
fn a_rigid_body_that_was_turned_by_half_a_turn_is_found_in_every_flight() {
    let Some(folder) = support::data("thesis/manual/filt") else { return };
    let paths = logs(&folder, "");
    assert_eq!(paths.len(), 3);
    for path in paths {
        let found = watch(&path);
        let first = found.iter().position(|found| found.is_direction_wrong);
        let first_s = first.map(|step| step as f64 * DT_S);
        println!("{}: turned after {first_s:?} s", path.display());
        assert!(first_s.is_some_and(|first_s| first_s < 6.0), "{}: {first_s:?}", path.display());
    }
}
