mod changes;
mod hands;
mod orders;

use horizon_model::rows::Pose;

use super::*;
use crate::monitor::{Agreement, Findings};

pub(super) use changes::{with_drone, with_obstacles, with_poses, with_tracking};

pub(super) const TABLE: SupervisorTable = SupervisorTable {
    stale_s: 0.25,
    lost_s: 1.0,
    jump_m: 1.5,
    jump_rad: 2.0,
    room: Some(RoomTable { x_m: [-3.0, 3.0], y_m: [-3.0, 3.0], z_m: [-0.2, 3.0], stop_s: 0.8 }),
    drone_silent_s: 2.0,
    battery_low_pct: 30,
    battery_critical_pct: 10,
    take_off_timeout_s: 8.0,
    airborne_height_m: 0.5,
    settle_s: 1.5,
    landing_timeout_s: 10.0,
    solver_failures_max: 3,
    late_periods_max: 10,
    finish_hold_s: 2.0,
    land_from_m: None,
    failsafe: FailsafeTable {
        tracking_m: 1.0,
        speed_mps: 3.0,
        overtime_s: 60.0,
        outage_s: 16.0,
        outage_alone_s: 6.0,
        person_gone_s: Some(60.0),
        pressed_s: Some(2.2),
    },
};

/// Monitors that have seen nothing.
pub(super) const NOTHING_FOUND: Findings = Findings {
    still_s: None,
    frozen_s: None,
    velocity: Agreement::Unknown,
    drone_speed_mps: None,
    displacement_error_m: 0.0,
    height: Agreement::Unknown,
    height_error_m: 0.0,
    heading: Agreement::Unknown,
    heading_error_rad: 0.0,
    direction_error_rad: None,
    is_direction_wrong: false,
};

const NO_INCIDENTS: Incidents = Incidents {
    is_guardian_lost: false,
    has_landed_unasked: false,
    has_input_expired: false,
    is_mocap_undated: false,
};
pub(super) const GUARDIAN_LOST: Incidents = Incidents { is_guardian_lost: true, ..NO_INCIDENTS };
pub(super) const STALLED: Incidents = Incidents { has_landed_unasked: true, ..NO_INCIDENTS };
pub(super) const UNDATED: Incidents = Incidents { is_mocap_undated: true, ..NO_INCIDENTS };

pub(super) const TICK_NS: i64 = 100_000_000; // 0.1 s

/// Nothing wrong, on the ground, nothing asked.
pub(super) const CALM: Evidence = Evidence {
    t_ns: 0,
    skipped: 0,
    pose_age_s: Some(0.01),
    pose: Some(Pose::new(0.0, 0.0, 0.1, 0.0)),
    motion: None,
    plan: PlanClearance::Unknown,
    obstacles: ObstacleEvidence {
        is_unseen: false,
        blocks_take_off: false,
        approach: ObstacleApproach::No,
        reference_behind_w: None,
        is_vehicle_inside: false,
    },
    poses: PoseEvidence {
        is_repeated: false,
        jump_m: None,
        shift_m: 0.0,
        is_rough: false,
        drop_m: None,
        is_settled: true,
    },
    findings: NOTHING_FOUND,
    outage: None,
    is_dead_time_long: false,
    tracking: TrackingEvidence {
        position_growth_m: Some(0.1),
        velocity_error_mps: Some(0.1),
        is_receding: false,
        heading_growth_rad: Some(0.1),
        height_deficit_m: Some(0.1),
        sink_depth_m: Some(0.1),
        pressed_s: 0.0,
        has_hit: false,
        overtime_s: -30.0,
    },
    speed_mps: 0.1,
    drone: Some(REPORT),
    operator: Operator::Wait,
    incidents: NO_INCIDENTS,
    hand: HandInput::Absent,
    is_mission_done: false,
    has_estimator_failed: false,
    has_controller_failed: false,
};

/// A drone that stands, well charged.
pub(super) const REPORT: DroneReport = DroneReport {
    age_s: 0.1,
    is_flying: false,
    takes_sticks: true,
    height_m: None,
    battery_pct: 80,
    is_battery_low: false,
    is_battery_critical: false,
};

/// On the ground to motion capture; the drone has not reported for long.
pub(super) const MUTE: Evidence =
    Evidence { drone: Some(DroneReport { age_s: 9.0, is_flying: true, ..REPORT }), ..CALM };

/// On the ground to the drone; motion capture has seen nothing for long.
pub(super) const BLIND: Evidence = Evidence { pose_age_s: Some(9.0), ..CALM };

/// The same in the air.
pub(super) const ALOFT: Evidence = Evidence {
    pose: Some(Pose::new(0.0, 0.0, 1.1, 0.0)),
    drone: Some(DroneReport { is_flying: true, ..REPORT }),
    ..CALM
};

/// A supervisor and the present time, which `tick` moves on.
pub(super) struct Fixture {
    pub(super) supervisor: Supervisor,
    pub(super) t_ns: i64,
}

impl Fixture {
    pub(super) fn new(start: Start) -> Self {
        // Any moment can be the zero of time.
        let settings = SupervisorSettings::try_from(&TABLE).unwrap();
        Self { supervisor: Supervisor::new(settings, start), t_ns: -7_000_000_000 }
    }

    pub(super) fn tick(&mut self, e: &Evidence) -> Decision {
        let out = self.supervisor.decide(&Evidence { t_ns: self.t_ns, ..*e });
        assert_eq!(self.supervisor.phase(), out.phase);
        self.t_ns += TICK_NS;
        out
    }

    /// Ticks with the same evidence for `ticks` tenths of a second; the last decision comes back.
    pub(super) fn run(&mut self, ticks: u32, e: &Evidence) -> Decision {
        self.pass(ticks - 1, e);
        self.tick(e)
    }

    /// The same when the decisions do not matter beyond what always holds.
    pub(super) fn pass(&mut self, ticks: u32, e: &Evidence) {
        for _ in 0..ticks {
            let out = self.tick(e);
            assert!(!out.may_steer() || out.phase == Phase::Flying, "{out:?}");
        }
    }

    /// In the air and steered.
    pub(super) fn flying() -> Self {
        let mut fixture = Self::new(Start::Airborne);
        assert!(fixture.tick(&ALOFT).may_steer());
        fixture
    }

    /// Take-off ordered one tick ago.
    pub(super) fn taking_off() -> Self {
        let mut fixture = Self::new(Start::Grounded);
        fixture.pass(1, &CALM);
        assert_eq!(fixture.tick(&asks_to_fly(CALM)).order, Some(DroneOrder::TakeOff));
        fixture
    }

    /// In the air and steered, after a take-off: the ground is known.
    pub(super) fn flown() -> Self {
        let mut fixture = Self::new(Start::Grounded);
        fixture.pass(1, &CALM);
        fixture.pass(1, &asks_to_fly(CALM));
        assert!(fixture.run(50, &ALOFT).may_steer());
        fixture
    }

    /// Landing ordered by the operator one tick ago, from steered flight.
    pub(super) fn landing() -> Self {
        let mut fixture = Self::flown();
        assert_eq!(fixture.tick(&asks_to_land(ALOFT)).order, Some(DroneOrder::Land));
        fixture
    }
}

pub(super) fn asks_to_fly(e: Evidence) -> Evidence {
    Evidence { operator: Operator::Fly, ..e }
}

pub(super) fn asks_to_land(e: Evidence) -> Evidence {
    Evidence { operator: Operator::Land, ..e }
}

pub(super) fn at_height(height_m: f64) -> Pose {
    at(0.0, height_m)
}

pub(super) fn at(x_m: f64, height_m: f64) -> Pose {
    Pose::new(x_m, 0.0, height_m, 0.0)
}

pub(super) fn faults(out: Decision) -> Vec<Fault> {
    out.faults.iter().collect()
}

#[test]
fn a_whole_flight_goes_through_every_phase() {
    let mut fixture = Fixture::new(Start::Grounded);
    let out = fixture.run(30, &CALM);
    assert_eq!((out.phase, out.order, out.may_steer()), (Phase::Idle, None, false));
    let out = fixture.tick(&asks_to_fly(CALM));
    assert_eq!((out.phase, out.order), (Phase::TakingOff, Some(DroneOrder::TakeOff)));
    let out = fixture.run(20, &CALM);
    assert_eq!((out.phase, out.order), (Phase::TakingOff, None));
    let out = fixture.tick(&ALOFT);
    assert_eq!((out.phase, out.may_steer()), (Phase::Flying, false));
    assert!(!fixture.run(14, &ALOFT).may_steer(), "1.4 s after the take-off");
    assert!(fixture.tick(&ALOFT).may_steer(), "1.5 s after the take-off");

    let done = Evidence { is_mission_done: true, ..ALOFT };
    let out = fixture.run(20, &done);
    assert_eq!((out.phase, out.may_steer()), (Phase::Flying, true), "done for 1.9 s");
    let out = fixture.tick(&done);
    assert_eq!((out.phase, out.order), (Phase::Landing, Some(DroneOrder::Land)), "done for 2.0 s");
    assert!(!out.may_steer() && out.faults.is_empty());

    let out = fixture.run(10, &CALM);
    assert_eq!(out.phase, Phase::Landing, "down for 0.9 s");
    let out = fixture.tick(&CALM);
    assert_eq!((out.phase, out.order), (Phase::Landed, None), "down for 1.0 s");
    assert!(out.faults.is_empty());
    let out = fixture.run(100, &asks_to_fly(CALM));
    assert_eq!((out.phase, out.order), (Phase::Landed, None));
}

#[test]
fn every_fault_keeps_an_idle_vehicle_down_and_is_named() {
    for (e, fault) in [
        (Evidence { pose_age_s: None, ..CALM }, Fault::MocapStale),
        (Evidence { pose_age_s: Some(0.26), ..CALM }, Fault::MocapStale),
        (Evidence { pose_age_s: Some(f64::NAN), ..CALM }, Fault::MocapLost),
        (Evidence { pose_age_s: Some(1.01), ..CALM }, Fault::MocapLost),
        (Evidence { drone: None, ..CALM }, Fault::DroneUnheard),
        (with_drone(CALM, |drone| drone.age_s = 2.01), Fault::DroneSilent),
        (with_drone(CALM, |drone| drone.age_s = f64::NAN), Fault::DroneSilent),
        (with_drone(CALM, |drone| drone.battery_pct = 29), Fault::BatteryLow),
        (with_drone(CALM, |drone| drone.is_battery_low = true), Fault::BatteryLow),
        (with_drone(CALM, |drone| drone.battery_pct = 101), Fault::BatteryLow),
        (Evidence { has_estimator_failed: true, ..CALM }, Fault::EstimatorFailed),
        (Evidence { pose: Some(at(3.1, 0.1)), ..CALM }, Fault::StartMisplaced),
        (Evidence { pose: Some(at(0.0, 1.3)), ..CALM }, Fault::StartMisplaced),
        (with_obstacles(CALM, |it| it.blocks_take_off = true), Fault::StartMisplaced),
        (with_poses(CALM, |it| it.is_settled = false), Fault::MocapUnsettled),
        (with_obstacles(CALM, |it| it.is_unseen = true), Fault::ObstacleUnseen),
        (Evidence { incidents: UNDATED, ..CALM }, Fault::MocapUndated),
        (with_drone(CALM, |drone| drone.is_flying = true), Fault::DroneAloft),
    ] {
        let mut fixture = Fixture::new(Start::Grounded);
        let out = fixture.run(5, &asks_to_fly(e));
        assert_eq!((out.phase, out.order), (Phase::Idle, None), "{fault:?}");
        assert!(out.faults.contains(fault), "{fault:?} is not in {:?}", out.faults);
        // Nothing of it stays: nothing has happened yet.
        let out = fixture.tick(&asks_to_fly(CALM));
        assert_eq!(
            (out.phase, out.order),
            (Phase::TakingOff, Some(DroneOrder::TakeOff)),
            "{fault:?}"
        );
        assert!(out.faults.is_empty(), "{:?}", out.faults);
    }
}

#[test]
fn a_stale_position_means_neutral_sticks_and_control_resumes() {
    let mut fixture = Fixture::flying();
    for pose_age_s in [Some(0.26), Some(1.0), None] {
        let out = fixture.tick(&Evidence { pose_age_s, ..ALOFT });
        assert_eq!((out.phase, out.may_steer()), (Phase::Flying, false), "{pose_age_s:?}");
        assert_eq!(faults(out), [Fault::MocapStale], "{pose_age_s:?}");
        assert!(fixture.tick(&ALOFT).may_steer());
    }
}

#[test]
fn landing_faults_end_the_flight_for_good() {
    for (e, fault) in [
        (Evidence { pose_age_s: Some(1.01), ..ALOFT }, Fault::MocapLost),
        (Evidence { pose_age_s: Some(f64::NAN), ..ALOFT }, Fault::MocapLost),
        (with_drone(ALOFT, |drone| drone.age_s = 2.01), Fault::DroneSilent),
        (with_drone(ALOFT, |drone| drone.age_s = f64::NAN), Fault::DroneSilent),
        (with_poses(ALOFT, |it| it.jump_m = Some(1.51)), Fault::MocapJumped),
        (with_poses(ALOFT, |it| it.jump_m = Some(f64::NAN)), Fault::MocapJumped),
        (with_poses(ALOFT, |it| it.shift_m = 1.51), Fault::MocapJumped),
        (with_poses(ALOFT, |it| it.is_rough = true), Fault::MocapRough),
        (Evidence { pose: Some(at(3.01, 1.1)), ..ALOFT }, Fault::FenceLeft),
        (Evidence { pose: Some(at(0.0, f64::NAN)), ..ALOFT }, Fault::FenceLeft),
        (Evidence { skipped: 11, ..ALOFT }, Fault::TicksLate),
        (Evidence { incidents: GUARDIAN_LOST, ..ALOFT }, Fault::GuardianLost),
        (Evidence { incidents: STALLED, ..ALOFT }, Fault::ProgramStalled),
        (asks_to_land(ALOFT), Fault::OperatorStop),
    ] {
        for mut fixture in [Fixture::flying(), Fixture::taking_off()] {
            let out = fixture.tick(&e);
            assert_eq!(
                (out.phase, out.order),
                (Phase::Landing, Some(DroneOrder::Land)),
                "{fault:?}"
            );
            assert!(out.faults.contains(fault) && !out.may_steer(), "{:?}", out.faults);
            let out = fixture.run(50, &asks_to_fly(ALOFT));
            assert_eq!((out.phase, out.may_steer()), (Phase::Landing, false), "{fault:?}");
            // What ended the flight stays, what came along with it does not.
            assert_eq!(faults(out), [fault]);
        }
    }
}

#[test]
fn mild_faults_are_noted_and_the_flight_goes_on() {
    let mut fixture = Fixture::flying();
    let out = fixture.run(50, &with_drone(ALOFT, |drone| drone.battery_pct = 29));
    assert_eq!((out.may_steer(), faults(out)), (true, vec![Fault::BatteryLow]));
    let out = fixture.tick(&Evidence { has_controller_failed: true, ..ALOFT });
    assert_eq!((out.may_steer(), faults(out)), (true, vec![Fault::ControllerFailed]));
    let expired = Incidents { has_input_expired: true, ..NO_INCIDENTS };
    let out = fixture.tick(&Evidence { incidents: expired, ..ALOFT });
    assert_eq!((out.may_steer(), faults(out)), (true, vec![Fault::InputExpired]));
    let out = fixture.tick(&Evidence { has_estimator_failed: true, ..ALOFT });
    assert_eq!((out.phase, out.may_steer()), (Phase::Flying, false));
    assert_eq!(faults(out), [Fault::EstimatorFailed]);
}

#[test]
fn what_never_came_is_missed_from_the_first_tick() {
    let mut fixture = Fixture::new(Start::Airborne);
    let out = fixture.run(11, &Evidence { pose_age_s: None, ..ALOFT });
    assert_eq!((out.phase, faults(out)), (Phase::Flying, vec![Fault::MocapStale]));
    let out = fixture.tick(&Evidence { pose_age_s: None, ..ALOFT });
    assert_eq!((out.phase, out.order), (Phase::Landing, Some(DroneOrder::Land)));

    let mut fixture = Fixture::new(Start::Airborne);
    let out = fixture.run(21, &Evidence { drone: None, ..ALOFT });
    assert_eq!((out.may_steer(), faults(out)), (true, vec![Fault::DroneUnheard]));
    let out = fixture.tick(&Evidence { drone: None, ..ALOFT });
    assert_eq!(out.phase, Phase::Landing);
    assert_eq!(faults(out), [Fault::DroneUnheard, Fault::DroneSilent]);
}

#[test]
fn solvers_may_fail_a_few_ticks_in_a_row_but_no_more() {
    for (has_estimator_failed, has_controller_failed) in [(true, false), (false, true)] {
        let failed = Evidence { has_estimator_failed, has_controller_failed, ..ALOFT };
        let mut fixture = Fixture::flying();
        assert_eq!(fixture.run(3, &failed).phase, Phase::Flying);
        assert_eq!(fixture.run(6, &ALOFT).phase, Phase::Flying);
        assert_eq!(fixture.run(3, &failed).phase, Phase::Flying);
        let out = fixture.tick(&failed);
        assert_eq!(out.phase, Phase::Landing);
        assert!(out.faults.contains(Fault::SolverFailing), "{:?}", out.faults);
    }
}

#[test]
fn a_failed_plan_of_long_ago_does_not_count() {
    // While sticks are neutral nothing is planned and the flag stays as it was.
    let mut fixture = Fixture::flying();
    let failed = Evidence { has_controller_failed: true, ..ALOFT };
    let stale = Evidence { pose_age_s: Some(0.5), ..failed };
    assert_eq!(faults(fixture.tick(&stale)), [Fault::MocapStale, Fault::ControllerFailed]);
    let out = fixture.run(20, &stale);
    assert_eq!((out.phase, faults(out)), (Phase::Flying, vec![Fault::MocapStale]));
    assert!(fixture.tick(&failed).may_steer());
}
