//! Every combination of evidence in every reachable phase: what must hold whatever happens.

use horizon_model::rows::{Pose, pose};
use horizon_model::setting::SettingError;
use nalgebra::Vector3;
use tello_flight::drone::DroneOrder;
use tello_flight::{
    Agreement, Decision, DroneReport, EstimatedMotion, Evidence, FailsafeTable, Fault, Findings,
    HandInput, Incidents, ObstacleApproach, ObstacleEvidence, Operator, Outage, Phase, Pilot,
    PlanClearance, PoseEvidence, Reaction, RoomTable, Start, Supervisor, SupervisorSettings,
    SupervisorTable, TrackingEvidence,
};

const STALE_S: f64 = 0.25;

/// Time between two ticks of the search: longer than some limits, shorter than others.
const STEPS_NS: [i64; 3] = [20_000_000, 700_000_000, 5_000_000_000];

fn settings() -> Result<SupervisorSettings, SettingError> {
    SupervisorSettings::try_from(&SupervisorTable {
        stale_s: STALE_S,
        lost_s: 1.0,
        jump_m: 1.5,
        jump_rad: 2.0,
        room: Some(RoomTable { x_m: [-3.0, 3.0], y_m: [-3.0, 3.0], z_m: [-0.5, 3.0], stop_s: 1.0 }),
        drone_silent_s: 2.0,
        battery_low_pct: 30,
        battery_critical_pct: 10,
        take_off_timeout_s: 6.0,
        airborne_height_m: 0.5,
        settle_s: 1.0,
        landing_timeout_s: 12.0,
        solver_failures_max: 1,
        late_periods_max: 10,
        finish_hold_s: 1.0,
        land_from_m: Some(0.45),
        failsafe: FailsafeTable::default(),
    })
}

/// Places: none, on the ground, in the air, outside of the room, nowhere.
const PLACES: [Option<[f64; 2]>; 5] =
    [None, Some([0.0, 0.0]), Some([0.0, 1.0]), Some([3.5, 1.0]), Some([0.0, f64::NAN])];

const OPERATORS: [Operator; 5] =
    [Operator::Wait, Operator::Fly, Operator::FlyByHand, Operator::Land, Operator::EmergencyStop];

/// All combinations of evidence at one moment, but for what the capture shows beside the pose: that
/// goes along with the flags.
fn every_evidence() -> Vec<Evidence> {
    let ages_s = [None, Some(0.0), Some(0.5), Some(3.0), Some(f64::NAN)];
    let mut all = Vec::new();
    for pose_age_s in ages_s {
        for place in PLACES {
            for drone_age_s in ages_s {
                for drone in 0..6_u8 {
                    for (operator, flags) in
                        OPERATORS.into_iter().flat_map(|by| (0..16_u8).map(move |bits| (by, bits)))
                    {
                        all.push(evidence(
                            pose_age_s,
                            place,
                            (drone_age_s, drone),
                            (operator, flags),
                        ));
                    }
                }
            }
        }
    }
    all
}

fn findings(flag: impl Fn(u8) -> bool) -> Findings {
    Findings {
        still_s: (flag(1) && flag(2) && flag(3)).then_some(0.9),
        frozen_s: (flag(1) && flag(2) && flag(3)).then_some(0.9),
        velocity: if flag(0) && flag(1) { Agreement::Doubtful } else { Agreement::Unknown },
        height: if flag(0) && flag(2) { Agreement::Disagrees } else { Agreement::Agrees },
        is_direction_wrong: flag(0) && flag(3),
        ..Findings::default()
    }
}

fn obstacles(flag: impl Fn(u8) -> bool) -> ObstacleEvidence {
    ObstacleEvidence {
        is_unseen: flag(0) && flag(1) && flag(3),
        blocks_take_off: flag(1) && flag(2) && flag(3),
        approach: match (flag(1), flag(2)) {
            _ if !flag(3) => ObstacleApproach::No,
            (true, _) => ObstacleApproach::Predicted,
            (false, true) => ObstacleApproach::Possible,
            (false, false) => ObstacleApproach::No,
        },
        reference_behind_w: (flag(0) && flag(3)).then(Vector3::zeros),
        is_vehicle_inside: flag(0) && flag(1) && flag(2),
    }
}

fn tracking(flag: impl Fn(u8) -> bool) -> TrackingEvidence {
    TrackingEvidence {
        pressed_s: if flag(2) && flag(3) { 9.0 } else { 0.0 },
        has_hit: flag(3) && flag(5),
        position_growth_m: flag(0).then_some(2.0),
        velocity_error_mps: flag(2).then_some(2.0),
        is_receding: flag(2),
        heading_growth_rad: flag(2).then_some(2.0),
        height_deficit_m: flag(1).then_some(0.5),
        sink_depth_m: flag(1).then_some(0.5),
        overtime_s: if flag(1) { 61.0 } else { 0.0 },
    }
}

fn evidence(
    pose_age_s: Option<f64>,
    place: Option<[f64; 2]>,
    (drone_age_s, drone): (Option<f64>, u8),
    (operator, flags): (Operator, u8),
) -> Evidence {
    let flag = |bit: u8| flags >> bit & 1 == 1;
    let pose = place.map(|[x_m, z_m]| Pose::new(x_m, 0.0, z_m, 0.0));
    let rate = Pose::new(if flag(3) { 4.0 } else { 0.0 }, 0.0, 0.0, 0.0);
    Evidence {
        t_ns: 0,
        skipped: if flag(2) && flag(3) { 30 } else { 0 },
        pose_age_s,
        pose,
        motion: pose.map(|pose| EstimatedMotion { pose, rate }),
        plan: match (flag(0) != flag(1), flag(2)) {
            (false, _) => PlanClearance::Unknown,
            (true, true) => PlanClearance::Clear,
            (true, false) => PlanClearance::Blocked,
        },
        obstacles: obstacles(flag),
        poses: PoseEvidence {
            is_repeated: flag(2),
            jump_m: (flag(1) && flag(2)).then_some(2.0),
            shift_m: if flag(0) && flag(2) { 2.0 } else { 0.0 },
            is_rough: flag(1) && flag(2) && flag(0),
            drop_m: None,
            is_settled: !(flag(1) && flag(3)),
        },
        findings: findings(flag),
        outage: pose.filter(|_| flag(0) && flag(1) && flag(3)).map(|pose| Outage {
            for_s: 7.0,
            is_held: flag(2),
            if_applied: [EstimatedMotion { pose, rate }; 2],
        }),
        is_dead_time_long: flag(1) && flag(3),
        tracking: tracking(flag),
        speed_mps: if flag(3) { 4.0 } else { 0.0 },
        drone: drone_age_s.map(|age_s| DroneReport {
            age_s,
            is_flying: drone % 2 == 1,
            takes_sticks: !(flag(1) && flag(3)),
            height_m: None,
            battery_pct: [80, 20, 5][usize::from(drone / 2)],
            is_battery_low: flag(0) && flag(3),
            is_battery_critical: flag(2) && flag(3),
        }),
        operator,
        incidents: Incidents {
            is_guardian_lost: flag(0) && flag(1) && flag(2),
            has_landed_unasked: flag(1) && flag(2) && flag(3),
            has_input_expired: flag(0) && flag(3),
            is_mocap_undated: flag(0) && flag(2),
        },
        hand: match (flag(0), flag(2)) {
            (false, _) => HandInput::Absent,
            (true, true) => HandInput::Neutral,
            (true, false) => HandInput::Steering,
        },
        is_mission_done: flag(1),
        has_estimator_failed: flag(2),
        has_controller_failed: flag(3),
    }
}

/// A take-off needs poses inside of the room, or a person who sees, and a drone that can fly.
fn assert_may_take_off(before: Phase, sees: bool, e: &Evidence) {
    let is_by_sight =
        e.is_by_hand() && (e.operator == Operator::FlyByHand || before != Phase::Idle);
    assert!(sees || is_by_sight, "takes off blind: {before:?}, {e:?}");
    let is_able =
        |drone: DroneReport| drone.battery_pct >= 30 && (is_by_sight || drone.age_s <= 2.0);
    assert!(e.drone.is_some_and(is_able), "takes off without a drone that can: {before:?}, {e:?}");
    let is_seen_by_person = before == Phase::Idle && is_by_sight;
    assert!(
        !e.obstacles.blocks_take_off || is_seen_by_person,
        "takes off into something: {before:?}, {e:?}"
    );
}

/// Rules that a decision must never break, seen from the phase before it.
fn assert_safe(before: Phase, has_landed: bool, e: &Evidence, out: Decision) {
    let case = || format!("{before:?}, {e:?}, {out:?}");
    let is_fresh = e.pose_age_s.is_some_and(|age_s| age_s <= STALE_S);
    let is_inside = e.pose.is_none_or(|at| at[pose::X] <= 3.0 && at[pose::Z].is_finite());
    let asks_to_end =
        matches!(e.operator, Operator::Land | Operator::EmergencyStop) || e.incidents.ends_flight();
    if out.may_steer() {
        assert_eq!(out.phase, Phase::Flying, "steers outside of a flight: {}", case());
        assert!(!asks_to_end, "steers against orders: {}", case());
        assert_eq!(out.order, None, "steers beside an order: {}", case());
    }
    match out.pilot {
        Some(Pilot::Controller) => {
            assert!(is_fresh && !e.has_estimator_failed, "steers on stale data: {}", case());
            assert!(is_inside, "steers behind the wall: {}", case());
            assert!(!e.is_by_hand(), "takes the sticks from a person: {}", case());
        }
        Some(Pilot::Person) => assert!(e.is_by_hand(), "no person steers: {}", case()),
        None => {}
    }
    if e.operator == Operator::EmergencyStop {
        assert_eq!(out.phase, Phase::MotorsStopped, "does not stop: {}", case());
    }
    if out.order == Some(DroneOrder::EmergencyStop) {
        assert_eq!(out.phase, Phase::MotorsStopped, "{}", case());
    }
    if out.order == Some(DroneOrder::TakeOff) {
        assert_eq!(out.phase, Phase::TakingOff, "{}", case());
        assert!(!has_landed, "takes off after a landing: {}", case());
        assert!(!asks_to_end, "takes off against orders: {}", case());
        assert_may_take_off(before, is_fresh && is_inside, e);
    }
    if out.order == Some(DroneOrder::Land) {
        assert!(matches!(out.phase, Phase::Landing | Phase::LandingUnconfirmed), "{}", case());
    }
    let is_on_the_way = matches!(before, Phase::TakingOff | Phase::Flying);
    let pilot = if e.is_by_hand() { Pilot::Person } else { Pilot::Controller };
    let must_land = out.faults.reaction(pilot) == Reaction::Land;
    if is_on_the_way && must_land {
        assert_eq!((out.phase, out.order), (Phase::Landing, Some(DroneOrder::Land)), "{}", case());
    }
    let must_brake = out.faults.reaction(pilot) == Reaction::BrakeAndLand;
    if is_on_the_way && must_brake {
        let is_flown = out.phase == Phase::Flying && out.pilot == Some(Pilot::Controller);
        assert!(out.phase == Phase::Landing || (is_flown && out.is_braking), "{}", case());
    }
    let may_follow: &[Phase] = match before {
        _ if e.operator == Operator::EmergencyStop => &[Phase::MotorsStopped],
        Phase::Idle => &[Phase::Idle, Phase::TakingOff, Phase::Landing],
        Phase::TakingOff => &[Phase::TakingOff, Phase::Flying, Phase::Landing],
        Phase::Flying => &[Phase::Flying, Phase::Landing],
        Phase::Landing => &[Phase::Landing, Phase::Landed, Phase::LandingUnconfirmed],
        Phase::Landed => &[Phase::Landed],
        Phase::LandingUnconfirmed => &[Phase::LandingUnconfirmed],
        Phase::MotorsStopped => &[Phase::MotorsStopped],
    };
    assert!(may_follow.contains(&out.phase), "no such transition: {}", case());
    if !is_fresh {
        assert!(out.faults.contains(Fault::MocapStale), "stale and not noted: {}", case());
    }
}

#[test]
fn no_single_piece_of_evidence_breaks_an_invariant_in_any_phase() {
    let calm = Evidence {
        hand: HandInput::Absent,
        ..evidence(Some(0.0), PLACES[1], (Some(0.0), 0), (Operator::Wait, 0))
    };
    let fly = Evidence { operator: Operator::Fly, ..calm };
    let aloft = Evidence { pose: Some(Pose::new(0.0, 0.0, 1.0, 0.0)), ..calm };
    let land = Evidence { operator: Operator::Land, ..aloft };
    let stop = Evidence { operator: Operator::EmergencyStop, ..aloft };
    // One way into each phase, a second and a half between its steps.
    let ways: [(Start, &[Evidence], Phase); 9] = [
        (Start::Grounded, &[], Phase::Idle),
        (Start::Grounded, &[calm], Phase::Idle),
        (Start::Grounded, &[calm, fly], Phase::TakingOff),
        (Start::Grounded, &[calm, fly, aloft], Phase::Flying),
        (Start::Grounded, &[calm, fly, aloft, aloft], Phase::Flying),
        (Start::Airborne, &[], Phase::Flying),
        (Start::Grounded, &[calm, fly, land], Phase::Landing),
        (Start::Grounded, &[calm, fly, land, calm, calm, calm, calm], Phase::Landed),
        (Start::Grounded, &[calm, fly, aloft, stop], Phase::MotorsStopped),
    ];
    let mut steered = 0;
    for (start, way, phase) in ways {
        let mut prepared = Supervisor::new(settings().unwrap(), start);
        let mut t_ns = 0;
        for e in way {
            let decision = prepared.decide(&Evidence { t_ns, ..*e });
            assert_eq!(decision.phase, prepared.phase());
            t_ns += 1_500_000_000;
        }
        assert_eq!(prepared.phase(), phase, "after {} steps", way.len());
        let has_landed = matches!(phase, Phase::Landing | Phase::Landed | Phase::MotorsStopped);
        for step_ns in STEPS_NS {
            for e in every_evidence() {
                let mut supervisor = prepared.clone();
                let e = Evidence { t_ns: t_ns + step_ns, ..e };
                let decision = supervisor.decide(&e);
                assert_safe(phase, has_landed, &e, decision);
                steered += u32::from(decision.may_steer());
            }
        }
    }
    assert!(steered > 100, "only {steered} decisions let control steer");
}

#[test]
fn long_random_flights_break_no_invariant_and_visit_every_phase() {
    let all = every_evidence();
    // Mild evidence, so that a flight lives long enough to get somewhere.
    let mild: Vec<Evidence> = all
        .iter()
        .filter(|e| {
            !matches!(e.operator, Operator::Land | Operator::EmergencyStop)
                && e.skipped == 0
                && e.poses.jump_m.is_none()
                && e.poses.shift_m < 1.0
                && e.pose.is_none_or(|at| at[pose::X] < 1.0 && at[pose::Z].is_finite())
                && e.pose_age_s.is_some_and(|age_s| age_s < 1.0)
                && e.drone.is_some_and(|drone| drone.age_s < 1.0 && drone.battery_pct > 30)
        })
        .copied()
        .collect();
    let mut visited = Vec::new();
    for seed in 0..1_000_u64 {
        // A linear congruential generator, constants of Knuth's MMIX.
        let mut random = seed;
        let mut draw = |below: usize| {
            random = random
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            usize::try_from(random >> 33).unwrap() % below
        };
        let start = [Start::Grounded, Start::Airborne][draw(2)];
        let mut supervisor = Supervisor::new(settings().unwrap(), start);
        let (mut t_ns, mut has_landed) = (0, false);
        for _ in 0..200 {
            let e = if draw(20) == 0 { all[draw(all.len())] } else { mild[draw(mild.len())] };
            let e = Evidence { t_ns, ..e };
            let before = supervisor.phase();
            let decision = supervisor.decide(&e);
            assert_safe(before, has_landed, &e, decision);
            has_landed |= matches!(
                decision.phase,
                Phase::Landing | Phase::Landed | Phase::LandingUnconfirmed | Phase::MotorsStopped
            );
            if !visited.contains(&decision.phase) {
                visited.push(decision.phase);
            }
            t_ns += STEPS_NS[draw(2)];
        }
    }
    assert_eq!(visited.len(), 7, "visited only {visited:?}");
}
