//! The drone's own heading beside that of the poses.
//!
//! Owns leaky sums of three turns: by the poses, by the drone, and that the inputs ask of a typical vehicle. The drone's
//! zero and its sense of rotation are not known, and a drone may report no heading or one that stands still: it is a
//! witness from the first turn on in which it followed the inputs or the poses, in the sense in which it did. It
//! contradicts the poses only while it is nearer to the inputs than they are: its own drift is no fault of the poses.

use horizon_model::angle::wrap;
use horizon_model::rows::{pose, stick};

use super::{Agreement, Sample, Verdict};

/// Time within which a turn is forgotten. s
const FORGET_S: f64 = 15.0;
/// Turn by the drone that shows what it follows. rad
const TURN_MIN_RAD: f64 = 0.3;
/// Difference between two turns of which one follows the other, over the larger: gains differ between vehicles.
const TOLERANCE: f64 = 0.5;
/// Distance of the drone from the inputs over that of the poses if the drone contradicts the poses.
const NEARER: f64 = 0.5;
/// Largest turn between two reports: one that is larger is a new zero. rad
const TURN_MAX_RAD: f64 = 1.0;
/// Yaw rate per input of a typical vehicle, its lag and its dead zone. rad/s, s, 1
const GAIN_RADPS: f64 = 1.4;
const LAG_S: f64 = 0.12;
const DEAD: f64 = 0.07;

/// Turns so far.
#[derive(Debug, Clone)]
pub(super) struct HeadingMonitor {
    limit_rad: f64,
    dt_s: f64,
    /// Newest heading by the poses. rad
    before_pose: Option<f64>,
    /// Newest heading by the drone. rad
    before_drone: Option<f64>,
    /// Yaw rate that the inputs ask for, after the lag. rad/s
    asked_radps: f64,
    turns: Turns,
    /// Sense of the drone's heading, 1 or -1, as a turn showed it last.
    sense: Option<f64>,
    verdict: Verdict,
}

/// Leaky sums of turns.
#[derive(Debug, Clone, Copy, Default)]
struct Turns {
    poses_rad: f64,
    drone_rad: f64,
    inputs_rad: f64,
}

impl HeadingMonitor {
    pub(super) fn new(limit_rad: f64, dt_s: f64) -> Self {
        Self {
            limit_rad,
            dt_s,
            before_pose: None,
            before_drone: None,
            asked_radps: 0.0,
            turns: Turns::default(),
            sense: None,
            verdict: Verdict::default(),
        }
    }

    /// Forgets the turns; the sense of the drone's heading stays.
    pub(super) fn rest(&mut self) {
        (self.before_pose, self.before_drone) = (None, None);
        self.asked_radps = 0.0;
        self.turns = Turns::default();
        self.verdict = Verdict::default();
    }

    /// Takes a tick in flight; how both compare, and by how much they differ. rad
    pub(super) fn update(&mut self, sample: &Sample) -> (Agreement, f64) {
        let Some(by_drone) = sample.drone.and_then(|drone| drone.heading_rad) else {
            self.rest();
            return (Agreement::Unknown, 0.0);
        };
        let turned_rad = turned(&mut self.before_drone, by_drone);
        if turned_rad.abs() > TURN_MAX_RAD {
            self.rest();
            return (Agreement::Unknown, 0.0);
        }
        let keep = (-self.dt_s / FORGET_S).exp();
        let u = sample.u_applied[stick::YAW];
        let target_radps = GAIN_RADPS * (u.abs() - DEAD).max(0.0).copysign(u);
        self.asked_radps += (target_radps - self.asked_radps) * (1.0 - (-self.dt_s / LAG_S).exp());
        let turns = &mut self.turns;
        turns.drone_rad = turns.drone_rad * keep + turned_rad;
        turns.inputs_rad = turns.inputs_rad * keep + self.asked_radps * self.dt_s;
        turns.poses_rad *= keep;
        if let Some(pose) = sample.pose {
            turns.poses_rad += turned(&mut self.before_pose, pose[pose::THETA]);
        }
        let by_poses = || turns.sense_of(turns.poses_rad);
        self.sense = turns.sense_of(turns.inputs_rad).or(self.sense).or_else(by_poses);
        let Some(sense) = self.sense else { return (Agreement::Unknown, 0.0) };
        let error_rad = (turns.poses_rad - sense * turns.drone_rad).abs();
        // What the vehicle turned without a pose is in the next one.
        if sample.pose.is_none() || error_rad > self.limit_rad && !turns.is_drone_nearer(sense) {
            return (Agreement::Unknown, error_rad);
        }
        (self.verdict.on(error_rad, self.limit_rad, self.dt_s), error_rad)
    }
}

impl Turns {
    /// Sense in which the drone followed `turn_rad`; `None` if it turned too little or by another amount.
    fn sense_of(&self, turn_rad: f64) -> Option<f64> {
        let larger_rad = self.drone_rad.abs().max(turn_rad.abs());
        let follows =
            |sense: &f64| (sense * self.drone_rad - turn_rad).abs() <= TOLERANCE * larger_rad;
        [1.0, -1.0].into_iter().find(follows).filter(|_| self.drone_rad.abs() >= TURN_MIN_RAD)
    }

    /// Whether the drone is nearer to the inputs than the poses are.
    fn is_drone_nearer(&self, sense: f64) -> bool {
        (sense * self.drone_rad - self.inputs_rad).abs()
            <= NEARER * (self.poses_rad - self.inputs_rad).abs()
    }
}

/// Turn from the heading before, if there was one, to `now_rad`, which replaces it: the short way round. rad
fn turned(before_rad: &mut Option<f64>, now_rad: f64) -> f64 {
    before_rad.replace(now_rad).map_or(0.0, |before_rad| wrap(now_rad - before_rad))
}

#[cfg(test)]
mod tests {
    use horizon_model::rows::{Pose, Sticks};

    use super::*;
    use crate::monitor::DroneMotion;

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
            let [theta, by_pose, by_drone] = &mut self.headings;
            *theta += rates.true_radps * DT_S;
            *by_pose += (rates.true_radps + rates.poses_radps) * DT_S;
            *by_drone += (rates.sense * rates.true_radps + rates.drone_radps) * DT_S;
            let mut u_applied = Sticks::zeros();
            let u = rates.asked_radps.abs() / GAIN_RADPS + DEAD;
            u_applied[stick::YAW] =
                if rates.asked_radps == 0.0 { 0.0 } else { u.copysign(rates.asked_radps) };
            let heading_rad = Some(wrap(*by_drone));
            self.monitor.update(&Sample {
                pose: Some(Pose::new(0.0, 0.0, 1.0, wrap(*by_pose))),
                drone: Some(DroneMotion { horizontal_mps: None, height_m: None, heading_rad }),
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
    const HELD: Rates = Rates {
        true_radps: -0.3,
        asked_radps: -0.3,
        poses_radps: 0.3,
        drone_radps: 0.0,
        sense: 1.0,
    };

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
        let turn = Rates { true_radps: 0.5, asked_radps: 0.5, sense: 1.0, ..Rates::default() };
        for (sense, drone_radps) in [(1.0, 0.1), (1.0, -0.1), (0.0, 0.0)] {
            for true_radps in [0.0, 0.4, -0.4] {
                let mut flight = Flight::new();
                assert_eq!(flight.fly(2.0, &turn), [None; 2]);
                let (asked_radps, poses_radps) = (true_radps, 0.0);
                let rates = Rates { true_radps, asked_radps, poses_radps, drone_radps, sense };
                assert_eq!(flight.fly(40.0, &rates), [None; 2], "{true_radps}, {drone_radps}");
            }
        }
    }

    #[test]
    fn a_step_of_the_poses_is_wrong_at_once_once_the_drone_is_known() {
        let mut flight = Flight::new();
        let turn = Rates { true_radps: 0.5, asked_radps: 0.5, sense: 1.0, ..Rates::default() };
        let rest = Rates { sense: 1.0, ..Rates::default() };
        flight.fly(2.0, &turn);
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
        let turn = Rates { true_radps: 0.5, asked_radps: 0.5, sense: 1.0, ..Rates::default() };
        let mut flight = Flight::new();
        flight.fly(2.0, &turn);
        flight.headings[2] -= 2.0;
        assert_eq!(flight.tick(&turn), (Agreement::Unknown, 0.0), "a new zero");
        assert_eq!(flight.fly(10.0, &turn), [None; 2]);
        flight.fly(1.5, &HELD);
        let silent =
            Sample { pose: None, drone: None, u_applied: Sticks::zeros(), link_is_up: true };
        assert_eq!(flight.monitor.update(&silent), (Agreement::Unknown, 0.0), "a gap");
        assert_eq!(flight.fly(1.5, &HELD), [None; 2]);
        assert!(flight.fly(1.0, &HELD)[0].is_some());
    }

    #[test]
    fn without_a_pose_nothing_is_known_and_its_turn_comes_with_the_next() {
        let turn = Rates { true_radps: 0.5, asked_radps: 0.5, sense: 1.0, ..Rates::default() };
        let mut flight = Flight::new();
        flight.fly(2.0, &turn);
        for _ in 0..100 {
            flight.headings[2] += 0.5 * DT_S;
            flight.headings[1] += 0.5 * DT_S;
            let mut u_applied = Sticks::zeros();
            u_applied[stick::YAW] = 0.5 / GAIN_RADPS + DEAD;
            let heading_rad = Some(wrap(flight.headings[2]));
            let drone = Some(DroneMotion { horizontal_mps: None, height_m: None, heading_rad });
            let lost = Sample { pose: None, drone, u_applied, link_is_up: true };
            assert_eq!(flight.monitor.update(&lost).0, Agreement::Unknown);
        }
        let (agreement, error_rad) = flight.tick(&turn);
        assert!(agreement == Agreement::Agrees && error_rad < 0.1, "{error_rad:.3} rad");
    }
}
