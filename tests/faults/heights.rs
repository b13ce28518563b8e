//! Climbs and descents that are meant: none of them is a vehicle that sinks or stands.

use tello_flight::cycle::{FlightTable, Operator};
use tello_flight::{Fault, MissionTable, Phase};
use tello_sim::{InjectedFault, OutageBehaviour, Profile, ScriptedFault, SimTable};

use super::story::{Story, fly, fly_alone, settings};

/// Targets at these heights, 1 m apart along x, in the simulator with `script`. m
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn targets(heights_m: &[f64], script: &[ScriptedFault]) -> (FlightTable, SimTable) {
    let places = heights_m.iter().zip(0..).map(|(z_m, number)| {
        let x_m = if number % 2 == 0 { -2.0 } else { -1.0 };
        serde_json::json!([x_m, -3.0, z_m, 0.0])
    });
    let places: Vec<_> = places.collect();
    let mission = serde_json::json!({ "targets": { "reach": 0.2, "targets": places } });
    let mut settings = settings(script);
    settings.0.mission = serde_json::from_value::<MissionTable>(mission).unwrap();
    settings
}

fn assert_calm(story: &Story, what: &str) {
    for fault in [Fault::TrackingLost, Fault::Immobile] {
        let has = story.moments.iter().any(|moment| moment.faults.contains(&fault));
        assert!(!has, "{what}: {fault:?}, {:?}", story.last());
    }
    assert_eq!(story.last().phase, Phase::Landed, "{what}: {:?}", story.last());
    assert!(story.last().faults.is_empty(), "{what}: {:?}", story.last());
}

#[test]
fn a_mission_may_climb_and_descend_by_more_than_a_vehicle_may_sink() {
    let heights_m = [2.2, 0.7, 2.2, 1.3, 0.6, 2.0];
    for (profile, outage) in [
        (Profile::Clean, OutageBehaviour::Level),
        (Profile::GoodDay, OutageBehaviour::Level),
        (Profile::MildOutages, OutageBehaviour::Level),
        (Profile::MildOutages, OutageBehaviour::Mixed),
    ] {
        let mut settings = targets(&heights_m, &[]);
        settings.1.profile = profile;
        settings.1.drone.outage = outage;
        assert_calm(&fly_alone(&settings, 120.0), &format!("{profile:?}, {outage:?}"));
    }
}

#[test]
fn a_vehicle_that_was_carried_higher_before_its_take_off_has_not_sunk() {
    let carried = InjectedFault::MocapShifted { offset_w_m: [0.0, 0.0, 1.1] };
    let script = [ScriptedFault { fault: carried, from_s: 1.0, for_s: 4.0 }];
    let story = fly(&targets(&[1.3, 1.3], &script), 60.0, |at_s, flight| {
        flight.set_operator(if at_s < 8.0 { Operator::Wait } else { Operator::Fly });
    });
    assert_calm(&story, "carried");
}
