//! Every combination of evidence in every reachable phase: what must hold whatever happens.

use tello_control::{
    DroneReport, Evidence, Fault, Order, Phase, Reaction, Ruling, Start, Supervisor,
    SupervisorSettings, SupervisorTable,
};
use tello_model::setting::SettingError;

const STALE_S: f64 = 0.25;

/// Time between two ticks of the sweep: longer than some limits, shorter than others.
const STEPS_NS: [i64; 3] = [20_000_000, 700_000_000, 5_000_000_000];

fn settings() -> Result<SupervisorSettings, SettingError> {
    SupervisorSettings::try_from(&SupervisorTable {
        stale_s: STALE_S,
        lost_s: 1.0,
        drone_silent_s: 2.0,
        battery_low_pct: 30,
        battery_critical_pct: 10,
        take_off_timeout_s: 6.0,
        airborne_height_m: 0.5,
        settle_s: 1.0,
        landing_timeout_s: 12.0,
        solver_failures_max: 1,
        finish_hold_s: 1.0,
    })
}

/// All combinations of evidence at one moment.
fn every_evidence() -> Vec<Evidence> {
    let ages_s = [None, Some(0.0), Some(0.5), Some(3.0), Some(f64::NAN)];
    let mut all = Vec::new();
    for pose_age_s in ages_s {
        for height_m in [None, Some(0.0), Some(1.0), Some(f64::NAN)] {
            for drone_age_s in ages_s {
                for drone in 0..6_u8 {
                    for flags in 0..32_u8 {
                        let flag = |bit: u8| flags >> bit & 1 == 1;
                        let report = |age_s| DroneReport {
                            age_s,
                            is_flying: drone % 2 == 1,
                            battery_pct: [80, 20, 5][usize::from(drone / 2)],
                        };
                        all.push(Evidence {
                            t_ns: 0,
                            pose_age_s,
                            height_m,
                            drone: drone_age_s.map(report),
                            asks_to_fly: flag(0),
                            asks_to_land: flag(1),
                            is_mission_done: flag(2),
                            estimator_failed: flag(3),
                            controller_failed: flag(4),
                        });
                    }
                }
            }
        }
    }
    all
}

/// What a ruling must never break, seen from the phase before it.
fn assert_safe(before: Phase, has_landed: bool, e: &Evidence, ruling: Ruling) {
    let told = || format!("{before:?}, {e:?}, {ruling:?}");
    let is_fresh = e.pose_age_s.is_some_and(|age_s| age_s <= STALE_S);
    if ruling.may_steer {
        assert!(is_fresh, "steers on stale data: {}", told());
        assert_eq!(ruling.phase, Phase::Flying, "steers outside of a flight: {}", told());
        assert!(!e.asks_to_land && !e.estimator_failed, "steers against orders: {}", told());
        assert_ne!(ruling.order, Order::Land, "steers while landing: {}", told());
    }
    if ruling.order == Order::TakeOff {
        assert_eq!(ruling.phase, Phase::TakingOff, "{}", told());
        assert!(!has_landed, "takes off after a landing: {}", told());
        assert!(is_fresh && !e.asks_to_land, "takes off blind or against orders: {}", told());
        assert!(
            e.drone.is_some_and(|drone| drone.age_s <= 2.0 && drone.battery_pct >= 30),
            "takes off without a drone that can: {}",
            told()
        );
    }
    if ruling.order == Order::Land {
        assert!(matches!(ruling.phase, Phase::Landing | Phase::Fault), "{}", told());
    }
    let is_on_the_way = matches!(before, Phase::TakingOff | Phase::Flying);
    let must_land = ruling.faults.iter().any(|fault| fault.reaction() == Reaction::Land);
    if is_on_the_way && must_land {
        assert_eq!((ruling.phase, ruling.order), (Phase::Landing, Order::Land), "{}", told());
    }
    let may_follow: &[Phase] = match before {
        Phase::Idle => &[Phase::Idle, Phase::TakingOff, Phase::Landing],
        Phase::TakingOff => &[Phase::TakingOff, Phase::Flying, Phase::Landing],
        Phase::Flying => &[Phase::Flying, Phase::Landing],
        Phase::Landing => &[Phase::Landing, Phase::Landed, Phase::Fault],
        Phase::Landed => &[Phase::Landed],
        Phase::Fault => &[Phase::Fault],
    };
    assert!(may_follow.contains(&ruling.phase), "no such transition: {}", told());
    if !is_fresh {
        assert!(ruling.faults.contains(Fault::MocapStale), "stale and not noted: {}", told());
    }
}

#[test]
fn no_single_piece_of_evidence_breaks_an_invariant_in_any_phase() {
    let calm = Evidence {
        t_ns: 0,
        pose_age_s: Some(0.0),
        height_m: Some(0.0),
        drone: Some(DroneReport { age_s: 0.0, is_flying: false, battery_pct: 80 }),
        asks_to_fly: false,
        asks_to_land: false,
        is_mission_done: false,
        estimator_failed: false,
        controller_failed: false,
    };
    let fly = Evidence { asks_to_fly: true, ..calm };
    let aloft = Evidence { height_m: Some(1.0), ..calm };
    let land = Evidence { asks_to_land: true, ..aloft };
    // One way into each phase, a second and a half between its steps.
    let ways: [(Start, &[Evidence], Phase); 8] = [
        (Start::Grounded, &[], Phase::Idle),
        (Start::Grounded, &[calm], Phase::Idle),
        (Start::Grounded, &[calm, fly], Phase::TakingOff),
        (Start::Grounded, &[calm, fly, aloft], Phase::Flying),
        (Start::Grounded, &[calm, fly, aloft, aloft], Phase::Flying),
        (Start::Airborne, &[], Phase::Flying),
        (Start::Grounded, &[calm, fly, land], Phase::Landing),
        (Start::Grounded, &[calm, fly, land, calm, calm, calm, calm], Phase::Landed),
    ];
    let mut steered = 0;
    for (start, way, phase) in ways {
        let mut prepared = Supervisor::new(settings().unwrap(), start);
        let mut t_ns = 0;
        for e in way {
            let ruling = prepared.rule(&Evidence { t_ns, ..*e });
            assert_eq!(ruling.phase, prepared.phase());
            t_ns += 1_500_000_000;
        }
        assert_eq!(prepared.phase(), phase, "after {} steps", way.len());
        let has_landed = matches!(phase, Phase::Landing | Phase::Landed);
        for step_ns in STEPS_NS {
            for e in every_evidence() {
                let mut supervisor = prepared.clone();
                let e = Evidence { t_ns: t_ns + step_ns, ..e };
                let ruling = supervisor.rule(&e);
                assert_safe(phase, has_landed, &e, ruling);
                steered += u32::from(ruling.may_steer);
            }
        }
    }
    assert!(steered > 100, "only {steered} rulings let control steer");
}

#[test]
fn long_random_flights_break_no_invariant_and_visit_every_phase() {
    let all = every_evidence();
    // Mild evidence, so that a flight lives long enough to get somewhere.
    let mild: Vec<Evidence> = all
        .iter()
        .filter(|e| {
            !e.asks_to_land
                && e.pose_age_s.is_some_and(|age_s| age_s < 1.0)
                && e.drone.is_some_and(|drone| drone.age_s < 1.0 && drone.battery_pct > 30)
        })
        .copied()
        .collect();
    let mut visited = Vec::new();
    for seed in 0..300_u64 {
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
            let ruling = supervisor.rule(&e);
            assert_safe(before, has_landed, &e, ruling);
            has_landed |= matches!(ruling.phase, Phase::Landing | Phase::Landed | Phase::Fault);
            if !visited.contains(&ruling.phase) {
                visited.push(ruling.phase);
            }
            t_ns += STEPS_NS[draw(2)];
        }
    }
    assert_eq!(visited.len(), 6, "visited only {visited:?}");
}
