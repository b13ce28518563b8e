//! The whole loop on the simulated plant, in virtual time.

use std::path::Path;

use horizon_model::check::maximum;
use horizon_model::rows::pose;
use tello_eval::metrics::{FlownTrack, Metrics, ReferencePath};
use tello_flight::cycle::{FlightTable, Pipeline};
use tello_flight::{Fault, Phase, Start};
use tello_io::config;
use tello_sim::plant::RIGID_BODY;
use tello_sim::virtual_time::VirtualFlight;
use tello_sim::{InjectedFault, Measured, Profile, ScriptedFault, SimTable};

/// Longest virtual flight. s
const TIME_LIMIT_S: f64 = 90.0;

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn tables(start: Start, profile: Profile) -> (FlightTable, SimTable) {
    let (fly, mission) = config::fly(None, None).unwrap();
    let mut sim = tello_sim::settings(None).unwrap();
    sim.profile = profile;
    (config::flight(&fly, mission, start), sim)
}

/// Phases in the order in which they came, and the figures by the true pose.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn fly(flight: &FlightTable, sim: &SimTable, seed: u64) -> (Vec<Phase>, Option<Metrics>, f64) {
    let mut virtual_flight = VirtualFlight::new(flight, sim, seed).unwrap();
    let mut track = FlownTrack::new(ReferencePath::of(flight).unwrap(), flight.cycle.dt_s);
    let mut phases = vec![];
    let mut height_max_m = 0.0_f64;
    loop {
        let out = virtual_flight.tick().unwrap();
        if phases.last() != Some(&out.phase()) {
            phases.push(out.phase());
        }
        let (reached, u_sent, step) = (out.targets_reached, out.u_sent, out.step);
        let is_over = matches!(out.phase(), Phase::Landed | Phase::LandingUnconfirmed);
        let at = virtual_flight.true_pose();
        height_max_m = maximum(height_max_m, at[pose::Z]);
        track.add(step as f64 * flight.cycle.dt_s, &at, &u_sent, reached);
        if is_over || step as f64 * flight.cycle.dt_s > TIME_LIMIT_S {
            return (phases, track.metrics(), height_max_m);
        }
    }
}

#[test]
fn the_square_is_flown_from_the_ground_and_back() {
    let (flight, sim) = tables(Start::Grounded, Profile::GoodDay);
    for seed in [1, 2, 3] {
        let (phases, metrics, height_max_m) = fly(&flight, &sim, seed);
        // Half a second of poses has to agree first.
        let expected =
            [Phase::Idle, Phase::TakingOff, Phase::Flying, Phase::Landing, Phase::Landed];
        assert_eq!(phases, expected, "seed {seed}");
        assert!(height_max_m > 0.8, "seed {seed} never became airborne: {height_max_m} m");
        let metrics = metrics.unwrap();
        let finish_s = metrics.finish_s.expect("the last target is reached");
        // The thesis' own flights without lost commands take 10.9 to 18.6 s; beyond 0.3 m they do
        // not count.
        assert!(finish_s < 18.6, "seed {seed}: {metrics:?}");
        assert!(metrics.distance_max_m < 0.3, "seed {seed}: {metrics:?}");
    }
}

#[test]
fn stages_make_room_for_any_dead_times() {
    let (mut flight, sim) = tables(Start::Airborne, Profile::Clean);
    assert!(!flight.cycle.mpc.stages.is_empty());
    // None of them ends with a stage of the settings.
    for dead_time_s in [[0.34, 0.34, 0.04, 0.19], [0.36, 0.345, 0.08, 0.21], [0.33; 4]] {
        flight.cycle.dead_time_s = dead_time_s.to_vec();
        let (_, metrics, _) = fly(&flight, &sim, 4);
        let metrics = metrics.unwrap();
        assert!(metrics.finish_s.is_some_and(|finish_s| finish_s < 9.0), "{metrics:?}");
        assert!(metrics.distance_max_m < 0.3, "{dead_time_s:?}: {metrics:?}");
    }
}

/// A pose observes the state of its own time: moved to the tick by the estimate that it makes, old poses oscillated.
#[test]
#[ignore = "15 flights: in .ci/run all"]
fn poses_of_any_age_that_still_counts_fly_the_square() {
    let (flight, mut sim) = tables(Start::Airborne, Profile::GoodDay);
    for delay_s in [0.02, 0.04, 0.06, 0.08, 0.095] {
        let lag =
            ScriptedFault { fault: InjectedFault::MocapLag { delay_s }, from_s: 1.0, for_s: 90.0 };
        sim.faults = vec![lag];
        for seed in [500_001, 500_002, 500_003] {
            let (_, metrics, _) = fly(&flight, &sim, seed);
            let metrics = metrics.unwrap();
            assert!(
                metrics.finish_s.is_some_and(|finish_s| finish_s < 9.0),
                "{delay_s}: {metrics:?}"
            );
            assert!(metrics.distance_p95_m < 0.09, "{delay_s}: {metrics:?}");
        }
    }
}

/// Real flights drift by the error of the drone's own velocity, by which it holds its place.
#[test]
fn a_drone_that_reports_its_own_velocity_without_its_drift_is_not_landed() {
    let laps =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/missions/square_laps.json");
    let (fly, mission) = config::fly(None, Some(&laps)).unwrap();
    let flight = config::flight(&fly, mission, Start::Airborne);
    for (body, disturbance_h_mps) in [(Some(RIGID_BODY), 0.05), (None, 0.075)] {
        let (_, mut sim) = tables(Start::Airborne, Profile::GoodDay);
        (sim.plant.rigid_body, sim.plant.disturbance_h_mps) = (body, disturbance_h_mps);
        sim.drone.status.velocity.measured = Measured::Own;
        for seed in [1, 3] {
            let mut virtual_flight = VirtualFlight::new(&flight, &sim, seed).unwrap();
            for step in 0..2250 {
                let out = virtual_flight.tick().unwrap();
                let faults = out.decision.unwrap().faults;
                assert!(!faults.contains(Fault::PoseInconsistent), "seed {seed}, step {step}");
            }
        }
    }
}

#[test]
fn both_pipelines_finish_the_square() {
    let (mut flight, sim) = tables(Start::Airborne, Profile::Clean);
    for pipeline in [Pipeline::SameTick, Pipeline::NextTick] {
        flight.cycle.pipeline = pipeline;
        let (phases, metrics, _) = fly(&flight, &sim, 4);
        assert_eq!(phases.first(), Some(&Phase::Flying), "{pipeline:?}");
        let finish_s = metrics.and_then(|metrics| metrics.finish_s);
        assert!(finish_s.is_some_and(|finish_s| finish_s < 18.6), "{pipeline:?}: {metrics:?}");
    }
}

#[test]
fn the_published_controller_flies() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/thesis/fly.json");
    let (fly_table, mission) = config::fly(Some(&path), None).unwrap();
    let flight = config::flight(&fly_table, mission, Start::Airborne);
    let (_, sim) = tables(Start::Airborne, Profile::GoodDay);
    let (_, metrics, _) = fly(&flight, &sim, 1);
    assert!(metrics.is_some_and(|metrics| metrics.finish_s.is_some()), "{metrics:?}");
}

#[test]
fn one_seed_is_one_flight_and_two_seeds_are_two() {
    let (flight, sim) = tables(Start::Airborne, Profile::BadDay);
    let sticks = |seed| -> Vec<[u64; 4]> {
        let mut virtual_flight = VirtualFlight::new(&flight, &sim, seed).unwrap();
        (0..500)
            .map(|_| {
                let u_sent = virtual_flight.tick().unwrap().u_sent;
                <[f64; 4]>::from(u_sent).map(f64::to_bits)
            })
            .collect()
    };
    let (first, again, other) = (sticks(7), sticks(7), sticks(8));
    assert!(first.iter().any(|u| *u != [0; 4]), "nothing was ever steered");
    assert_eq!(first, again);
    assert_ne!(first, other);
}
