//! What happens while the controller brings the vehicle down after its mission.

use horizon_model::rows::{Sticks, pose};
use tello_flight::cycle::FlightTable;
use tello_flight::{Fault, MissionTable, ObstacleTable, Phase, Pilot};
use tello_sim::{InjectedFault, PasserTable, ScriptedFault, SimTable};

use super::story::{Moment, Story, fly, fly_alone, settings};

/// Height of the hover, and one on the way down. m
const HOVER_M: f64 = 2.0;
const DOWN_M: f64 = 1.5;

/// The controller hovers for some seconds at 2 m before it brings the vehicle down.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn hover() -> (FlightTable, SimTable) {
    let mut settings = settings(&[]);
    let hover = include_str!("../../configs/missions/hover.json");
    let hover = hover.replace("1.3", "2.0").replace("30.0", "3.0");
    settings.0.mission = serde_json::from_str::<MissionTable>(&hover).unwrap();
    settings
}

fn is_down_to(height_m: f64, after_s: f64) -> impl Fn(&Moment) -> bool {
    move |moment| {
        moment.at_s > after_s && moment.phase == Phase::Flying && moment.pose[pose::Z] < height_m
    }
}

/// When a vehicle that nothing disturbs is above its last target, and when it has come down to `height_m`. s
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn down_at_s(height_m: f64) -> f64 {
    let story = fly_alone(&hover(), 60.0);
    let top_s = story.first(0.0, |moment| moment.pose[pose::Z] > HOVER_M - 0.05).unwrap();
    story.first(top_s, is_down_to(height_m, top_s)).unwrap()
}

/// The flight, with or without a link monitor, with `fault` from when the vehicle has come down to [`DOWN_M`], and that
/// time. s
fn with_fault(fault: InjectedFault, for_s: f64, judges_link: bool) -> (Story, f64) {
    let from_s = down_at_s(DOWN_M);
    let mut settings = hover();
    if !judges_link {
        settings.0.cycle.link = None;
    }
    settings.1.faults = vec![ScriptedFault { fault, from_s, for_s }];
    (fly_alone(&settings, from_s + 40.0), from_s)
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn landing_s(story: &Story) -> f64 {
    story.first(0.0, |moment| moment.landings > 0).unwrap()
}

#[test]
fn nothing_disturbs_it_and_it_lands_from_low_down() {
    let story = fly_alone(&hover(), 60.0);
    story.assert_sound();
    let landing = story.moments.iter().find(|moment| moment.landings > 0).unwrap();
    assert!((0.4..0.6).contains(&landing.pose[pose::Z]), "{landing:?}");
    assert!(landing.faults.is_empty(), "{landing:?}");
    story.assert_down();
}

#[test]
fn a_second_fault_lands_it_at_once() {
    let (story, from_s) = with_fault(InjectedFault::MocapSilent, 60.0, true);
    let after_s = landing_s(&story) - from_s;
    assert!((0.1..0.7).contains(&after_s), "no poses: LAND after {after_s} s");
    story.assert_down();
}

#[test]
fn a_vehicle_that_is_carried_away_is_landed() {
    for (mps, judges_link, expected_s) in [(1.2, true, 0.4..0.8), (2.2, false, 0.7..1.4)] {
        let push = InjectedFault::DronePushed { velocity_w_mps: [mps, 0.0, 0.0] };
        let (story, from_s) = with_fault(push, 3.0, judges_link);
        let after_s = landing_s(&story) - from_s;
        assert!(expected_s.contains(&after_s), "by {mps} m/s: LAND after {after_s} s");
        // Else as in an outage.
        assert_eq!(story.has(Fault::TrackingLost), !judges_link, "{:?}", story.last());
        story.assert_down();
    }
}

#[test]
fn a_drone_that_does_not_come_down_is_landed_soon() {
    for (what, fault) in [
        ("an outage", InjectedFault::DroneReboot { falls: false }),
        ("a table", InjectedFault::DroneHeld { sway_m: 0.02, lowered_m: 0.0 }),
    ] {
        let (story, from_s) = with_fault(fault, 6.0, true);
        let after_s = landing_s(&story) - from_s;
        assert!((0.5..2.2).contains(&after_s), "{what}: LAND after {after_s} s");
        story.assert_down();
    }
}

#[test]
fn a_person_takes_over_and_after_the_hand_back_the_mission_ends_anew() {
    let from_s = down_at_s(DOWN_M);
    let to_s = from_s + 3.0;
    let hold_s = hover().0.cycle.supervisor.finish_hold_s;
    let story = fly(&hover(), from_s + 60.0, |at_s, flight| {
        let is_by_hand = (from_s..to_s).contains(&at_s);
        flight.set_manual(is_by_hand.then(|| Sticks::new(0.0, 0.4, 0.0, 0.3)));
    });
    story.assert_sound();
    let by_hand: Vec<_> =
        story.moments.iter().filter(|moment| (from_s..to_s).contains(&moment.at_s)).collect();
    assert!(by_hand.iter().all(|moment| moment.pilot == Some(Pilot::Person)), "{:?}", by_hand[0]);
    let moved_m = by_hand[149].pose[pose::X] - by_hand[0].pose[pose::X];
    assert!(moved_m > 1.0, "the person's sticks moved it by {moved_m} m");
    let landing_s = landing_s(&story);
    assert!(landing_s > to_s + hold_s + 1.0, "handed back at {to_s} s, LAND at {landing_s} s");
    assert!(story.last().faults.is_empty(), "{:?}", story.last());
    story.assert_down();
}

#[test]
fn somebody_who_comes_near_is_evaded_and_let_past() {
    const RADIUS_M: f64 = 0.3;
    let begins_s = down_at_s(HOVER_M - 0.1);
    let mut settings = hover();
    settings.0.cycle.obstacles = vec![ObstacleTable::Moving { radius_m: RADIUS_M }];
    // It walks for more than 20 m, stands beside the hover 5 s after the descent has begun, and walks back.
    let (speed_mps, arrives_s) = (1.0, begins_s + 5.0);
    let begun = 0.18034;
    let length_m = speed_mps * arrives_s / (1.0 - begun);
    let passer = PasserTable {
        from_w_m: [0.1 + length_m, 0.1, 1.0],
        to_w_m: [0.1, 0.1, 1.0],
        speed_mps,
        hidden_s: None,
    };
    settings.1.passer = Some(passer);
    let mut nearest_m = f64::INFINITY;
    let story = fly(&settings, begins_s + 60.0, |_, flight| {
        let at = flight.truth().pose;
        if let Some([x_m, y_m, _]) = flight.true_obstacle_w() {
            nearest_m = nearest_m.min((at[pose::X] - x_m).hypot(at[pose::Y] - y_m) - RADIUS_M);
        }
    });
    story.assert_sound();
    let low_s = story.first(begins_s, is_down_to(0.6, begins_s)).unwrap();
    let landing_s = landing_s(&story);
    assert!(low_s < arrives_s, "low at {low_s} s, it arrives at {arrives_s} s");
    // It is near until it is more than 4 s of its walk away, and 4 s longer.
    assert!((7.0..10.0).contains(&(landing_s - arrives_s)), "{arrives_s} s, LAND at {landing_s} s");
    assert!(nearest_m > 0.1, "{nearest_m} m");
    let in_flight = story.moments.iter().filter(|moment| moment.at_s > begins_s);
    let faults: Vec<_> = in_flight.flat_map(|moment| &moment.faults).collect();
    assert!(faults.is_empty(), "{faults:?}");
    story.assert_down();
}
