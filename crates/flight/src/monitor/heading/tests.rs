use horizon_model::rows::{Pose, Sticks, stick};

use super::*;
use crate::monitor::DroneMotion;
use crate::monitor::typical_vehicle::{DEAD_ZONE, YAW_GAIN_RADPS};

const DT_S: f64 = 0.02;
const LIMIT_RAD: f64 = 0.6;

/// Yaw rates of a flight: of the vehicle, as the inputs ask, of the poses beside the true one, and of the drone's
/// own heading beside the true one. rad/s
#[derive(Clone, Copy, Default)]
struct Rates {
    true_radps: f64,
    asked_radps: f64,
    poses_radps: f64,
    drone_radps: f64,
    /// Sense of the drone's heading; 0: it reports a constant one.
    sense: f64,
}

struct Flight {
    monitor: HeadingMonitor,
    /// True, by the poses, by the drone. rad
    headings: [f64; 3],
}

impl Flight {
    fn new() -> Self {
        Self { monitor: HeadingMonitor::new(LIMIT_RAD, DT_S), headings: [3.0, -3.0, 1.0] }
    }

    fn tick(&mut self, rates: &Rates) -> (Agreement, f64) {
        self.tick_with(rates, true)
    }

    fn tick_without_drone(&mut self, rates: &Rates) -> (Agreement, f64) {
        self.tick_with(rates, false)
    }

    fn tick_with(&mut self, rates: &Rates, is_reported: bool) -> (Agreement, f64) {
        let [theta, by_pose, by_drone] = &mut self.headings;
        *theta += rates.true_radps * DT_S;
        *by_pose += (rates.true_radps + rates.poses_radps) * DT_S;
        *by_drone += (rates.sense * rates.true_radps + rates.drone_radps) * DT_S;
        let mut u_applied = Sticks::zeros();
        let u = rates.asked_radps.abs() / YAW_GAIN_RADPS + DEAD_ZONE;
        u_applied[stick::YAW] =
            if rates.asked_radps == 0.0 { 0.0 } else { u.copysign(rates.asked_radps) };
        let heading_rad = Some(wrap(*by_drone));
        self.monitor.update(&Sample {
            pose: Some(Pose::new(0.0, 0.0, 1.0, wrap(*by_pose))),
            drone: is_reported.then_some(DroneMotion {
                horizontal_d_mps: None,
                height_m: None,
                heading_rad,
            }),
            u_applied,
            link_is_up: true,
        })
    }

    /// Flies for at most `seconds`: when the poses were first in doubt, and wrong. s
    fn fly(&mut self, seconds: f64, rates: &Rates) -> [Option<f64>; 2] {
        let (mut t_s, mut first) = (0.0, [None; 2]);
        while t_s < seconds {
            t_s += DT_S;
            let (agreement, _) = self.tick(rates);
            let found = [agreement >= Agreement::Doubtful, agreement == Agreement::Disagrees];
            for (first, found) in first.iter_mut().zip(found) {
                *first = first.or(found.then_some(t_s));
            }
        }
        first
    }
}

/// A controller holds the heading of poses that drift by 0.3 rad/s.
const HELD: Rates =
    Rates { true_radps: -0.3, asked_radps: -0.3, poses_radps: 0.3, drone_radps: 0.0, sense: 1.0 };

/// A turn that all see.
const TURN: Rates =
    Rates { true_radps: 0.5, asked_radps: 0.5, poses_radps: 0.0, drone_radps: 0.0, sense: 1.0 };

#[test]
fn a_drift_that_is_flown_against_is_in_doubt_beyond_the_limit_and_wrong_after_it_lasted() {
    for sense in [1.0, -1.0] {
        for mirror in [1.0, -1.0] {
            let [doubt_s, wrong_s] = Flight::new().fly(
                5.0,
                &Rates {
                    true_radps: mirror * HELD.true_radps,
                    asked_radps: mirror * HELD.asked_radps,
                    poses_radps: mirror * HELD.poses_radps,
                    sense,
                    ..HELD
                },
            );
            let [doubt_s, wrong_s] = [doubt_s, wrong_s].map(Option::unwrap);
            // 0.6 rad at 0.3 rad/s, a little of it forgotten.
            assert!((2.0..2.3).contains(&doubt_s), "{doubt_s:.2} s");
            assert!((1.3..1.6).contains(&(wrong_s - doubt_s)), "{wrong_s:.2} s");
        }
    }
}

#[test]
fn turns_that_all_see_agree_whatever_the_sense_the_gain_and_the_size() {
    for sense in [1.0, -1.0] {
        for gain in [0.6, 1.0, 1.8] {
            for true_radps in [0.05, -0.5, 1.7] {
                let asked_radps = true_radps / gain;
                let rates = Rates { true_radps, asked_radps, sense, ..Rates::default() };
                assert_eq!(Flight::new().fly(30.0, &rates), [None; 2], "{true_radps}, {gain}");
            }
        }
    }
}

#[test]
fn a_drone_that_drifts_or_reports_a_constant_heading_contradicts_nothing() {
    for (sense, drone_radps) in [(1.0, 0.1), (1.0, -0.1), (0.0, 0.0)] {
        for true_radps in [0.0, 0.4, -0.4] {
            let mut flight = Flight::new();
            assert_eq!(flight.fly(2.0, &TURN), [None; 2]);
            let (asked_radps, poses_radps) = (true_radps, 0.0);
            let rates = Rates { true_radps, asked_radps, poses_radps, drone_radps, sense };
            assert_eq!(flight.fly(40.0, &rates), [None; 2], "{true_radps}, {drone_radps}");
        }
    }
}

#[test]
fn a_step_of_the_poses_is_wrong_at_once_once_the_drone_is_known() {
    let mut flight = Flight::new();
    let rest = Rates { sense: 1.0, ..Rates::default() };
    flight.fly(2.0, &TURN);
    flight.fly(2.0, &rest);
    flight.headings[1] += 1.4;
    let [doubt_s, wrong_s] = flight.fly(1.0, &rest).map(Option::unwrap);
    assert!(doubt_s <= DT_S && (0.25..0.35).contains(&wrong_s), "{doubt_s:.2}, {wrong_s:.2}");
    // The drone never turned: nothing is known of its sense.
    let mut unknown = Flight::new();
    unknown.fly(2.0, &rest);
    unknown.headings[1] += 1.4;
    assert_eq!(unknown.fly(10.0, &rest), [None; 2]);
}

#[test]
fn a_new_zero_of_the_drone_and_a_gap_begin_anew() {
    let mut flight = Flight::new();
    flight.fly(2.0, &TURN);
    flight.headings[2] -= 2.0;
    assert_eq!(flight.tick(&TURN), (Agreement::Unknown, 0.0), "a new zero");
    assert_eq!(flight.fly(10.0, &TURN), [None; 2]);
    flight.fly(1.5, &HELD);
    let silent = Sample { pose: None, drone: None, u_applied: Sticks::zeros(), link_is_up: true };
    for _ in 0..52 {
        assert_eq!(flight.monitor.update(&silent).0, Agreement::Unknown, "a gap");
    }
    assert_eq!(flight.fly(1.5, &HELD), [None; 2]);
    assert!(flight.fly(1.0, &HELD)[0].is_some());
}

#[test]
fn short_gaps_in_the_reports_hide_no_drift() {
    let mut flight = Flight::new();
    let (mut t_s, mut doubt_s) = (0.0, None);
    while t_s < 4.0 && doubt_s.is_none() {
        t_s += DT_S;
        // 0.5 s of each second without a report.
        let (agreement, _) =
            if t_s % 1.0 < 0.5 { flight.tick_without_drone(&HELD) } else { flight.tick(&HELD) };
        doubt_s = (agreement >= Agreement::Doubtful).then_some(t_s);
    }
    assert!(doubt_s.is_some_and(|doubt_s| doubt_s < 2.8), "{doubt_s:?} s");
}

#[test]
fn inputs_that_get_lost_before_a_turn_the_other_way_change_no_sense() {
    for sense in [1.0, -1.0] {
        let turn = Rates { true_radps: 0.5, asked_radps: 0.5, sense, ..Rates::default() };
        for lost_rad in [0.4, 0.7, 1.0, 2.0] {
            for is_known in [true, false] {
                let mut flight = Flight::new();
                if is_known {
                    assert_eq!(flight.fly(1.0, &turn), [None; 2]);
                }
                let lost = Rates { true_radps: 0.0, asked_radps: lost_rad, ..turn };
                assert_eq!(flight.fly(1.0, &lost), [None; 2]);
                let back = Rates { true_radps: -0.4, asked_radps: -0.4, ..turn };
                assert_eq!(flight.fly(4.0, &back), [None; 2], "{lost_rad} rad lost");
            }
        }
    }
}

#[test]
fn a_heading_that_is_held_while_the_drone_turns_is_no_measurement() {
    let mut flight = Flight::new();
    flight.fly(1.0, &TURN);
    let by_pose = flight.headings[1];
    for _ in 0..45 {
        flight.monitor.observe(false);
        assert_eq!(flight.tick(&TURN).0, Agreement::Unknown);
        flight.headings[1] = by_pose;
    }
    flight.headings[1] += 45.0 * 0.5 * DT_S;
    assert_eq!(flight.fly(1.0, &TURN), [None; 2]);
}

#[test]
fn without_a_pose_nothing_is_known_and_its_turn_comes_with_the_next() {
    let mut flight = Flight::new();
    flight.fly(2.0, &TURN);
    for _ in 0..40 {
        flight.headings[2] += 0.5 * DT_S;
        flight.headings[1] += 0.5 * DT_S;
        let mut u_applied = Sticks::zeros();
        u_applied[stick::YAW] = 0.5 / YAW_GAIN_RADPS + DEAD_ZONE;
        let heading_rad = Some(wrap(flight.headings[2]));
        let drone = Some(DroneMotion { horizontal_d_mps: None, height_m: None, heading_rad });
        let lost = Sample { pose: None, drone, u_applied, link_is_up: true };
        assert_eq!(flight.monitor.update(&lost).0, Agreement::Unknown);
    }
    let (agreement, error_rad) = flight.tick(&TURN);
    assert!(agreement == Agreement::Agrees && error_rad < 0.1, "{error_rad:.3} rad");
}

#[test]
fn the_inputs_turn_a_typical_vehicle_after_its_lag() {
    let mut flight = Flight::new();
    flight.fly(0.5, &TURN);
    // The integral of a first-order lag; a thirtieth of it is forgotten.
    let expected_rad = 0.5 * (0.5 - YAW_LAG_S * (1.0 - (-0.5 / YAW_LAG_S).exp()));
    let turned_rad = flight.monitor.turns.by_inputs_rad;
    assert!((turned_rad / expected_rad - 1.0).abs() < 0.05, "{turned_rad}, {expected_rad} rad");
}

#[test]
fn inputs_and_poses_that_contradict_each_other_show_no_sense() {
    let mut flight = Flight::new();
    let apart = Rates { asked_radps: -0.5, ..TURN };
    for _ in 0..100 {
        assert_eq!(flight.tick(&apart), (Agreement::Unknown, 0.0));
    }
    assert_eq!(flight.monitor.sense, None);
    // A known one stays.
    let mut known = Flight::new();
    known.fly(1.0, &TURN);
    known.fly(6.0, &Rates { poses_radps: -1.0, ..TURN });
    assert_eq!(known.monitor.sense, Some(Sense::CounterClockwise));
}
