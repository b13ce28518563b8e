//! Poses in a frame that is not the world's: mirrored or turned from the start, or drifting away in flight.

use std::f64::consts::{FRAC_PI_2, TAU};

use horizon_model::check::maximum;
use horizon_model::rows::pose;
use serde_json::json;
use tello_flight::{Agreement, Fault, MissionTable};
use tello_sim::virtual_time::VirtualFlight;
use tello_sim::{HeadingReport, InjectedFault, OutageBehaviour, Profile, ScriptedFault, SimStart};

use super::story::{FAULT_AT_S, Moment, Story, fly_alone, mission, settings};

const MISSIONS: [&str; 6] =
    ["big_square.json", "square.json", "figure_eight.json", "cross.json", "arc.json", "hover.json"];

/// A flight of `name` with `fault` from `from_s` on.
fn fly(name: &str, fault: InjectedFault, from_s: f64) -> Story {
    let mut settings = settings(&[ScriptedFault { fault, from_s, for_s: 1e3 }]);
    settings.0.mission = mission(name);
    fly_alone(&settings, 60.0)
}

/// Largest horizontal distance between true poses since `from_s`. m
fn distance_m(story: &Story, from_s: f64) -> f64 {
    let mut since = story.moments.iter().filter(|moment| moment.at_s >= from_s);
    let Some(begin) = since.next() else { return f64::NAN };
    let from_begin = |moment: &Moment| {
        let way = moment.pose - begin.pose;
        way[pose::X].hypot(way[pose::Y])
    };
    since.map(from_begin).fold(0.0, maximum)
}

/// Landed within `within_s` of the first stick that is not neutral.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn assert_landed_soon(story: &Story, within_s: f64, case: &str) {
    let steers = |moment: &Moment| moment.stick.is_some_and(|stick| stick > 0.0);
    let first_s = story.first(0.0, steers).unwrap();
    let landing_s = story.first(0.0, |moment| moment.landings > 0).unwrap() - first_s;
    assert!(landing_s <= within_s, "{case}: LAND {landing_s:.2} s after the first stick");
    story.assert_sound();
    story.assert_down();
}

#[test]
fn a_mirrored_frame_lands_within_two_seconds_of_the_first_stick() {
    for name in MISSIONS {
        let mirrored = InjectedFault::MocapFrame { turn_rad: 0.0, is_mirrored: true, scale: 1.0 };
        let story = fly(name, mirrored, 0.0);
        assert_landed_soon(&story, 2.0, name);
        assert!(story.has(Fault::HeadingWrong), "{name}: {:?}", story.last());
        let far_m = distance_m(&story, 0.0);
        assert!(far_m < 2.0, "{name}: {far_m:.2} m");
    }
}

#[test]
fn a_mirrored_frame_lands_though_the_first_leg_runs_along_its_axis() {
    // The motion along the axis is as in the right frame; it leaves the axis by itself. With x and y exchanged the axis
    // is at 45 degrees, and the nose off by 90.
    for (name, turn_rad, [x, y]) in [
        ("square.json", 0.0, [1.2, 0.0]),
        ("big_square.json", 0.0, [1.2, -0.75]),
        ("hover.json", 0.0, [-1.2, 0.0]),
        ("hover.json", FRAC_PI_2, [1.0, 1.0]),
        ("arc.json", FRAC_PI_2, [0.7, 0.7]),
    ] {
        let mirrored = InjectedFault::MocapFrame { turn_rad, is_mirrored: true, scale: 1.0 };
        let mut settings = settings(&[ScriptedFault { fault: mirrored, from_s: 0.0, for_s: 1e3 }]);
        settings.0.mission = mission(name);
        settings.1.start = SimStart::Ground { x, y, theta: 0.0 };
        let story = fly_alone(&settings, 60.0);
        let case = format!("{name}, {turn_rad} rad from {x}, {y}");
        println!("{case}: {:.2} m", distance_m(&story, 0.0));
        assert_landed_soon(&story, 3.5, &case);
    }
}

#[test]
fn a_rigid_body_that_is_turned_lands_within_three_seconds_of_the_first_stick() {
    for name in MISSIONS {
        for turn_rad in [0.9, -1.57, 3.1] {
            let story = fly(name, InjectedFault::MocapHeading { turn_rad }, 0.0);
            let case = format!("{name}, {turn_rad} rad");
            assert_landed_soon(&story, 3.0, &case);
            let has_seen = story.has(Fault::HeadingWrong) || story.has(Fault::FenceLeft);
            assert!(has_seen, "{case}: {:?}", story.last());
        }
    }
}

/// When a flight of `mission` is landed whose heading drifts by `yaw_radps`, with a drone that reports its own heading
/// as `report`. s after the begin of the drift
fn landing_s(mission: MissionTable, yaw_radps: f64, report: HeadingReport) -> f64 {
    let fault = InjectedFault::MocapDrift { velocity_w_mps: [0.0; 3], yaw_radps };
    let mut settings = settings(&[ScriptedFault { fault, from_s: FAULT_AT_S, for_s: 1e3 }]);
    settings.0.mission = mission;
    settings.1.drone.status.heading = report;
    let story = fly_alone(&settings, 60.0);
    story.assert_sound();
    story.assert_down();
    let landing_s = story.first(0.0, |moment| moment.landings > 0);
    landing_s.map_or(f64::INFINITY, |at_s| at_s - FAULT_AT_S)
}

const DRIFTING: [&str; 5] =
    ["big_square.json", "figure_eight.json", "cross.json", "arc.json", "hover.json"];

#[test]
fn a_heading_that_drifts_lands_when_the_drone_s_own_does_not() {
    let right = HeadingReport::RIGHT;
    let mirrored = HeadingReport { is_mirrored: true, ..right };
    for (report, missions) in [(right, &DRIFTING[..]), (mirrored, &DRIFTING[..1])] {
        for &name in missions {
            for (yaw_radps, within_s) in [(1.0, 2.0), (0.3, 4.0), (-0.3, 4.0), (-0.15, 7.0)] {
                let after_s = landing_s(mission(name), yaw_radps, report);
                assert!(
                    after_s <= within_s,
                    "{name}, {yaw_radps} rad/s: LAND after {after_s:.2} s"
                );
            }
        }
    }
}

#[test]
fn a_heading_that_drifts_while_the_mission_turns_lands_within_six_seconds() {
    for yaw_radps in [0.3, -0.3] {
        let after_s = landing_s(turning(), yaw_radps, HeadingReport::RIGHT);
        assert!(after_s <= 6.0, "{yaw_radps} rad/s: LAND after {after_s:.2} s");
    }
}

#[test]
fn a_heading_that_drifts_lands_when_the_motion_shows_it() {
    let absent = HeadingReport { is_present: false, ..HeadingReport::RIGHT };
    for name in DRIFTING {
        for yaw_radps in [0.3, -0.3] {
            let after_s = landing_s(mission(name), yaw_radps, absent);
            assert!(after_s <= 13.5, "{name}, {yaw_radps} rad/s: LAND after {after_s:.2} s");
        }
    }
}

#[test]
fn a_drone_whose_own_heading_is_wrong_flies_on() {
    let right = HeadingReport::RIGHT;
    let absent = HeadingReport { is_present: false, ..right };
    let late = HeadingReport { late_s: 0.5, ..right };
    let mirrored = HeadingReport { is_mirrored: true, ..right };
    let [drifting, back] = [0.1, -0.1].map(|drift_radps| HeadingReport { drift_radps, ..right });
    let reports = [absent, late, mirrored, drifting, back];
    for (k, name) in MISSIONS.into_iter().enumerate() {
        // Two of each mission: each report is flown with two or three missions.
        for report in [reports[k % 5], reports[(k + 2) % 5]] {
            let mut settings = settings(&[]);
            settings.0.mission = mission(name);
            settings.1.drone.status.heading = report;
            let story = fly_alone(&settings, 120.0);
            let is_wrong = story.has(Fault::HeadingWrong) || story.has(Fault::PoseDoubtful);
            assert!(!is_wrong, "{name}, {report:?}: {:?}", story.last());
            story.assert_down();
        }
    }
}

/// Turns by 1 rad to either side, every 6 s, while it hovers for 30 s.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn turning() -> MissionTable {
    let row = |k: u32| {
        let at_s = 0.25 * f64::from(k);
        [at_s, 0.0, 0.0, 1.3, (TAU * at_s / 6.0).sin()]
    };
    let rows: Vec<_> = (0..=120).map(row).collect();
    let follow = json!({
        "reach": 0.5,
        "start": { "within": 0.3, "settle_s": 1.0 },
        "wait": { "begin_m": 1.0, "stop_m": 3.0 },
    });
    let trajectory = json!({
        "points": { "rows": rows },
        "accel_max_mps2": 0.9,
        "follow": follow,
    });
    serde_json::from_value(json!({ "trajectory": trajectory })).unwrap()
}

#[test]
fn commands_that_get_lost_in_turns_are_no_wrong_heading() {
    for (outage, turn_rad) in [
        (OutageBehaviour::Level, 0.0),
        (OutageBehaviour::Held, 0.0),
        (OutageBehaviour::Level, 0.5),
        (OutageBehaviour::Held, 0.5),
    ] {
        for seed in 1..=2 {
            let mut settings = settings(&[]);
            settings.0.mission = turning();
            settings.1.profile = Profile::MildOutages;
            settings.1.drone.outage = outage;
            settings.1.start = SimStart::Ground { x: 0.0, y: 0.0, theta: turn_rad };
            let mut flight = VirtualFlight::new(&settings.0, &settings.1, seed).unwrap();
            for tick in 0..2500 {
                let out = flight.tick().unwrap();
                let heading = out.findings.map_or(Agreement::Unknown, |found| found.heading);
                let is_quiet = heading < Agreement::Doubtful;
                assert!(is_quiet, "{outage:?}, seed {seed}, {turn_rad} rad, tick {tick}");
            }
        }
    }
}

#[test]
fn a_position_that_drifts_away_from_a_hover_faster_than_a_drone_may_drift_lands() {
    // A drone's own velocity may be wrong by 0.08 m/s, and is reported in steps of 0.1 m/s.
    for (speed_mps, most_m) in [(0.2, 2.3), (0.3, 3.1)] {
        let drift =
            InjectedFault::MocapDrift { velocity_w_mps: [speed_mps, 0.0, 0.0], yaw_radps: 0.0 };
        let story = fly("hover.json", drift, FAULT_AT_S);
        assert!(story.has(Fault::PoseInconsistent), "{speed_mps} m/s: {:?}", story.last());
        let far_m = distance_m(&story, FAULT_AT_S);
        assert!(far_m < most_m, "{speed_mps} m/s: {far_m:.2} m");
        story.assert_sound();
        story.assert_down();
    }
}
