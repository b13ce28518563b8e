use horizon_model::rows::Sticks;
use tello_flight::{Fault, RoomTable};
use tello_io::clock::TimeOfDay;

use super::*;
use crate::plant::Velocity;
use crate::{Cause, ReceivedOrders};

const LAND: HostPacket = HostPacket::Action { action: Action::Land, sequence: 1 };
const DT_S: f64 = 0.02;

fn sticks(pitch: f64) -> HostPacket {
    let u = Sticks::new(0.0, pitch, 0.0, 0.0);
    HostPacket::Sticks { u, is_fast: false, time: TimeOfDay::default() }
}

/// A flight that is looked at tick by tick; the room ends at x = 1 m and the way to a stop is 1 s long.
struct Fixture {
    judge: Judge,
    now_s: f64,
    faults: FaultSet,
    ignores: [bool; 2],
    phase: DronePhase,
}

impl Fixture {
    fn new(onset_s: f64) -> Self {
        let table = RoomTable { x_m: [-1.0, 1.0], y_m: [-1.0, 1.0], z_m: [-0.2, 3.0], stop_s: 1.0 };
        let judge = Judge::new(Some(Room::try_from(&table).unwrap()), onset_s);
        let faults = FaultSet::default();
        Self { judge, now_s: 0.0, faults, ignores: [false; 2], phase: DronePhase::Flying }
    }

    fn truth(&self, x_m: f64, speed_mps: f64) -> Truth {
        Truth {
            pose: Pose::new(x_m, 0.0, 1.0, 0.0),
            velocity: Velocity { x_mps: speed_mps, ..Velocity::default() },
            phase: self.phase,
            link_is_up: true,
            battery_pct: 90.0,
            motor_s: 1.0,
            received: ReceivedOrders::default(),
        }
    }

    /// One tick with the vehicle there and these packets.
    fn tick(&mut self, x_m: f64, speed_mps: f64, wire: &[HostPacket]) {
        let truth = self.truth(x_m, speed_mps);
        let Self { now_s, faults, ignores, .. } = *self;
        self.judge.update(&TickView { now_s, faults, wire, truth, ignores });
        self.now_s += DT_S;
    }

    fn violations(&self) -> Vec<Violation> {
        self.judge.violations(End::Landed)
    }
}

#[test]
fn sticks_after_a_landing_are_neutral_and_directly_before_another_order_to_land() {
    for (wire, is_bad) in [
        (vec![LAND], false),
        (vec![sticks(0.0), LAND], false),
        (vec![HostPacket::EmergencyStop, sticks(0.0), LAND], false),
        (vec![sticks(0.0)], true),
        (vec![sticks(0.0), HostPacket::EmergencyStop, LAND], true),
        (vec![sticks(0.1), LAND], true),
        (vec![LAND, sticks(0.0)], true),
    ] {
        let mut fixture = Fixture::new(0.0);
        fixture.tick(0.0, 0.0, &[sticks(0.3)]);
        fixture.tick(0.0, 0.0, &[sticks(0.0), LAND]);
        assert_eq!(fixture.violations(), []);
        fixture.tick(0.0, 0.0, &wire);
        let expected = if is_bad { vec![Violation::SticksWhileLanding] } else { vec![] };
        assert_eq!(fixture.violations(), expected, "{wire:?}");
    }
}

#[test]
fn outside_of_the_room_there_is_the_way_to_a_stop() {
    for (furthest_m, is_bad) in [(1.49, false), (1.52, true)] {
        let mut fixture = Fixture::new(0.0);
        fixture.tick(0.9, 0.5, &[]);
        // 0.01 m outside at 0.5 m/s: 0.51 m are allowed.
        fixture.tick(1.01, 0.5, &[]);
        fixture.tick(furthest_m, 0.2, &[]);
        assert_eq!(fixture.violations() == [Violation::LeftRoom], is_bad, "{furthest_m} m");
    }
}

#[test]
fn a_drone_that_ignores_its_sticks_may_go_anywhere_and_then_has_its_way_to_a_stop() {
    for (furthest_m, is_bad) in [(5.9, false), (6.1, true)] {
        let mut fixture = Fixture::new(0.0);
        fixture.ignores = [true, false];
        fixture.tick(0.9, 1.0, &[]);
        fixture.tick(3.0, 1.0, &[]);
        fixture.tick(5.0, 1.0, &[]);
        fixture.ignores = [false, false];
        fixture.tick(5.02, 1.0, &[sticks(0.0), LAND]);
        assert_eq!(fixture.violations(), []);
        fixture.tick(furthest_m, 0.0, &[]);
        assert_eq!(fixture.violations() == [Violation::LeftRoom], is_bad, "{furthest_m} m");
    }
    // Back inside, the permission is over.
    let mut fixture = Fixture::new(0.0);
    fixture.ignores = [true, false];
    fixture.tick(5.0, 1.0, &[]);
    fixture.ignores = [false, false];
    fixture.tick(0.5, 0.1, &[LAND]);
    fixture.tick(1.05, 0.1, &[]);
    fixture.tick(1.5, 0.1, &[]);
    assert_eq!(fixture.violations(), [Violation::LeftRoom]);
}

#[test]
fn a_drone_that_listens_again_has_to_receive_the_order_within_half_a_second() {
    for (silent_ticks, is_bad) in [(20, false), (60, true)] {
        let mut fixture = Fixture::new(0.0);
        fixture.ignores = [true, false];
        fixture.tick(2.0, 1.0, &[]);
        fixture.ignores = [false, false];
        for tick in 0..silent_ticks {
            fixture.tick(2.0 + 0.1 * f64::from(tick), 1.0, &[]);
        }
        fixture.tick(2.0 + 0.1 * f64::from(silent_ticks), 1.0, &[LAND]);
        assert_eq!(!fixture.violations().is_empty(), is_bad, "{silent_ticks} ticks");
    }
}

#[test]
fn a_vehicle_that_lands_outside_may_drift() {
    for (drift_mps, is_bad) in [(0.05, false), (0.2, true)] {
        let mut fixture = Fixture::new(0.0);
        fixture.tick(1.01, 0.0, &[LAND]);
        for tick in 0..150 {
            fixture.tick(1.01 + drift_mps * DT_S * f64::from(tick), 0.0, &[]);
        }
        assert_eq!(!fixture.violations().is_empty(), is_bad, "{drift_mps} m/s");
    }
}

#[test]
fn a_refused_landing_excuses_only_once_it_was_ordered() {
    for (is_ordered, is_bad) in [(true, false), (false, true)] {
        let mut fixture = Fixture::new(0.0);
        fixture.ignores = [false, true];
        fixture.tick(0.0, 0.0, if is_ordered { &[LAND] } else { &[] });
        fixture.tick(1.1, 0.1, &[]);
        fixture.tick(3.0, 0.1, &[]);
        assert_eq!(fixture.violations() == [Violation::LeftRoom], is_bad);
    }
}

#[test]
fn a_flight_ends_on_the_floor_or_is_one_of_those_sought() {
    let end = |phase, now_s, supervisor, ignores| {
        let mut fixture = Fixture::new(0.0);
        fixture.tick(0.0, 0.0, &[LAND]);
        (fixture.phase, fixture.ignores) = (phase, ignores);
        fixture.tick(0.0, 0.0, &[]);
        fixture.judge.end(now_s, supervisor, &fixture.truth(0.0, 0.0))
    };
    let late_s = TIME_LIMIT_S + 1.0;
    let (down, landing) = (DronePhase::Grounded, DronePhase::Landing(Cause::Order));
    let obeys = [false; 2];
    assert_eq!(end(down, 30.0, Phase::Landed, obeys), Some(End::Landed));
    assert_eq!(end(landing, 30.0, Phase::Landed, obeys), None, "the program errs");
    assert_eq!(end(landing, late_s, Phase::Landed, obeys), Some(End::Undefined));
    assert_eq!(end(landing, late_s, Phase::Landed, [false, true]), Some(End::Ignored));
    assert_eq!(end(down, 30.0, Phase::Flying, obeys), None);
    assert_eq!(end(down, late_s, Phase::Flying, obeys), Some(End::Unnoticed));
    let judge = Fixture::new(0.0).judge;
    assert_eq!(judge.violations(End::Undefined), [Violation::NoEnd]);
    assert_eq!(judge.violations(End::Ignored), []);
}

#[test]
fn a_reaction_is_timed_from_when_the_fault_is_there_and_the_vehicle_flies() {
    let mut fixture = Fixture::new(1.0);
    fixture.faults.set(Fault::MocapStale, true);
    for _ in 0..50 {
        fixture.tick(0.0, 0.3, &[sticks(0.2)]);
    }
    assert_eq!(fixture.judge.reaction(), None);
    // 0.4 s with sticks, then a fault and 0.2 s of neutral sticks, then a landing that drifts on.
    for k in 0..20 {
        fixture.tick(0.01 * f64::from(k), 0.3, &[sticks(0.2)]);
    }
    assert_eq!(fixture.judge.reaction().unwrap().detected_s, None, "known before");
    fixture.faults.set(Fault::MocapJumped, true);
    for _ in 0..10 {
        fixture.tick(0.2, 0.3, &[sticks(0.0)]);
    }
    fixture.tick(0.2, 0.0, &[sticks(0.0), LAND]);
    fixture.tick(0.3, 0.0, &[]);
    let reaction = fixture.judge.reaction().unwrap();
    let close = |got: Option<f64>, expected: f64| (got.unwrap() - expected).abs() < 1e-9;
    assert!(close(reaction.detected_s, 0.4), "{reaction:?}");
    assert!(close(reaction.neutral_s, 0.4), "{reaction:?}");
    assert!(close(reaction.land_s, 0.6), "{reaction:?}");
    assert!(!reaction.is_mission_over && (reaction.travelled_m - 0.3).abs() < 1e-9);
}

#[test]
fn neutral_sticks_of_a_moment_are_no_reaction_and_the_end_of_a_mission_is_none() {
    let mut fixture = Fixture::new(0.0);
    for _ in 0..20 {
        fixture.tick(0.0, 0.3, &[sticks(0.2)]);
        fixture.tick(0.0, 0.3, &[sticks(0.0)]);
    }
    assert_eq!(fixture.judge.reaction().unwrap().neutral_s, None);
    fixture.tick(0.0, 0.0, &[LAND]);
    let reaction = fixture.judge.reaction().unwrap();
    assert!(reaction.is_mission_over && reaction.detected_s.is_none(), "{reaction:?}");
}
