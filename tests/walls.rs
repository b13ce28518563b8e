//! Walls and obstacles in the plan, in whole flights.

use std::fs;
use std::path::Path;

use horizon_model::check::maximum;
use horizon_model::rows::pose;
use serde_json::{Value, json};
use tello_eval::flight_log::{self, TickRecord};
use tello_eval::metrics::{LeastClearance, Surroundings};
use tello_flight::cycle::{FlightTable, Outcome, Timing};
use tello_flight::{Fault, ObstacleTable, Phase, RoomTable, Start};
use tello_io::config;
use tello_sim::plant::{RIGID_BODY, RigidBodyTable};
use tello_sim::virtual_time::VirtualFlight;
use tello_sim::{PasserTable, SimTable};

use crate::program::{folder, tello_ctl, text};

/// It reaches 0.05 m over the first side of the square.
const POLE: ObstacleTable =
    ObstacleTable::Cylinder { centre_m: [-2.1, -2.2], radius_m: 0.15, z_m: [-0.2, 2.5] };

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn tables() -> (FlightTable, SimTable) {
    let (fly, mission) = config::fly(None, None).unwrap();
    (config::flight(&fly, mission, Start::Airborne), tello_sim::settings(None).unwrap())
}

/// Least true distances of a flight of 14 s, its ticks with the fence near or the plan blocked, its targets; `see` sees
/// each tick.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn fly(
    (flight, sim): &(FlightTable, SimTable),
    seed: u64,
    mut see: impl FnMut(&Outcome),
) -> (LeastClearance, usize, usize) {
    let surroundings = Surroundings::of(&flight.cycle).unwrap();
    let mut virtual_flight = VirtualFlight::new(flight, sim, seed).unwrap();
    let (mut least, mut near, mut reached) = (LeastClearance::default(), 0, 0);
    for _ in 0..700 {
        let out = virtual_flight.tick().unwrap();
        see(out);
        reached = out.targets_reached;
        let has = |fault| out.decision.is_some_and(|decision| decision.faults.contains(fault));
        near += usize::from(has(Fault::PlanBlocked) || has(Fault::FenceNear));
        least.add(surroundings.at(&virtual_flight.true_pose(), virtual_flight.true_obstacle_w()));
    }
    (least, near, reached)
}

#[test]
fn far_from_walls_the_flight_has_the_bits_of_a_plan_without_them() {
    let (flight, sim) = tables();
    assert!(flight.cycle.mpc.walls.is_some(), "the built-in plan knows walls");
    let mut without = flight.clone();
    without.cycle.mpc.walls = None;
    let sticks = |flight: FlightTable| {
        let mut sent = Vec::new();
        fly(&(flight, sim.clone()), 5, |out| sent.push((out.u_sent, out.s_hat.clone())));
        sent
    };
    assert_eq!(sticks(flight), sticks(without));
}

#[test]
fn an_obstacle_on_the_path_is_flown_around_by_both_plants() {
    for body in [None, Some(RIGID_BODY)] {
        let (mut flight, mut sim) = tables();
        sim.plant.rigid_body = body;
        flight.cycle.obstacles = vec![POLE];
        let mut seen = 0;
        let with = fly(&(flight.clone(), sim.clone()), 3, |out| {
            seen += usize::from(out.clearance.is_some_and(|clearance| clearance.active > 0));
        });
        let (LeastClearance { obstacle_m, .. }, near, reached) = with;
        assert!(obstacle_m.unwrap() > 0.05, "{with:?}");
        assert_eq!((near, reached), (0, 5), "{with:?}");
        assert!(seen > 20, "{seen} ticks with an active constraint");
        // Nearly no weight: the plan leads through the pole, and the vehicle brakes and waits in front of it.
        flight.cycle.mpc.walls.as_mut().unwrap().weight = 1.0;
        let (LeastClearance { obstacle_m, .. }, near, _) = fly(&(flight, sim), 3, |_| ());
        assert!(obstacle_m.unwrap() > 0.0 && near > 100, "{obstacle_m:?}, {near} ticks");
    }
}

#[test]
#[ignore = "24 flights: in .ci/run all"]
fn an_obstacle_that_moves_is_evaded_where_it_is_going_to_be() {
    let (mut flight, mut sim) = tables();
    flight.cycle.obstacles = vec![ObstacleTable::Moving { radius_m: 0.2 }];
    let (from_w_m, to_w_m) = ([-3.5, -2.2, 1.0], [-0.5, -2.2, 1.0]);
    sim.passer = Some(PasserTable { from_w_m, to_w_m, speed_mps: 1.0, hidden_s: None });
    let touched = |weight| {
        let mut flight = flight.clone();
        flight.cycle.mpc.walls.as_mut().unwrap().weight = weight;
        let fly = |seed| fly(&(flight.clone(), sim.clone()), seed, |_| ()).0.obstacle_m.unwrap();
        (1..=12).filter(|seed| fly(*seed) < 0.0).count()
    };
    let (without, with) = (touched(1.0), touched(100.0));
    assert!(without >= 3 && with == 0, "{without} of 12 touched with little weight, {with} with");
}

#[test]
fn a_vehicle_that_a_person_drives_from_its_reference_is_not_astray() {
    let (mut flight, mut sim) = tables();
    flight.cycle.obstacles = vec![ObstacleTable::Moving { radius_m: 0.5 }];
    let (from_w_m, to_w_m) = ([-0.5, -3.0, 1.0], [-3.5, -3.0, 1.0]);
    sim.passer = Some(PasserTable { from_w_m, to_w_m, speed_mps: 1.2, hidden_s: None });
    let mut away_m = 0.0_f64;
    for seed in 1..=4 {
        fly(&(flight.clone(), sim.clone()), seed, |out| {
            let apart_w = out
                .reference
                .zip(out.pose_hat())
                .map(|(to, at)| (to - at).fixed_rows::<2>(pose::X).norm());
            away_m = maximum(away_m, apart_w.unwrap_or_default());
            let faults = out.decision.unwrap().faults;
            assert!(!faults.contains(Fault::TrackingLost), "seed {seed}: {faults:?}");
        });
    }
    assert!(away_m > flight.cycle.supervisor.failsafe.tracking_m, "it went {away_m} m away");
}

/// Targets reached by a flight far from an obstacle of kind `moving` that is not seen in `hidden_s`; `see` gets the
/// time, whether the obstacle is missed and what the tick decides.
fn fly_with_hidden(hidden_s: [f64; 2], mut see: impl FnMut(f64, bool, &Outcome)) -> usize {
    let (mut flight, mut sim) = tables();
    flight.cycle.obstacles = vec![ObstacleTable::Moving { radius_m: 0.2 }];
    let at_m = [4.0, 4.0, 1.0];
    let hidden_s = Some(hidden_s);
    sim.passer = Some(PasserTable { from_w_m: at_m, to_w_m: at_m, speed_mps: 0.0, hidden_s });
    let is_missed =
        |out: &Outcome| out.decision.is_some_and(|r| r.faults.contains(Fault::ObstacleUnseen));
    fly(&(flight, sim), 3, |out| see(0.02 * out.step as f64, is_missed(out), out)).2
}

#[test]
fn an_obstacle_that_moves_unseen_keeps_a_vehicle_down() {
    let reached = fly_with_hidden([0.0, 1e3], |t_s, is_missed, out| {
        assert!(is_missed && out.order().is_none(), "{t_s} s, {:?}", out.decision);
    });
    assert_eq!(reached, 0);
}

#[test]
fn an_obstacle_that_moves_unseen_in_flight_is_waited_for() {
    let (mut moving_mps, mut waiting_mps) = (0.0_f64, 0.0_f64);
    let reached = fly_with_hidden([7.0, 10.0], |t_s, is_missed, out| {
        assert!(is_missed || !(7.55..9.99).contains(&t_s), "{t_s} s");
        // Found, it is seen 0.3 s later.
        assert!(!is_missed || t_s < 0.3 || (7.45..10.31).contains(&t_s), "{t_s} s");
        let of = if (9.0..10.0).contains(&t_s) { &mut waiting_mps } else { &mut moving_mps };
        *of = maximum(*of, out.speed_mps);
    });
    assert!(moving_mps > 0.5 && waiting_mps < 0.2, "{moving_mps} and {waiting_mps} m/s");
    assert_eq!(reached, 5, "it goes on");
}

#[test]
fn a_vehicle_that_waits_for_an_obstacle_stays_where_it_stopped() {
    let (mut flight, mut sim) = tables();
    flight.cycle.obstacles = vec![ObstacleTable::Moving { radius_m: 0.2 }];
    let (at_m, hidden_s) = ([4.0, 4.0, 1.0], Some([3.0, 1e3]));
    sim.passer = Some(PasserTable { from_w_m: at_m, to_w_m: at_m, speed_mps: 0.0, hidden_s });
    sim.plant.rigid_body = Some(RigidBodyTable { wind_mps: 0.5, ..RIGID_BODY });
    for seed in 1..=4 {
        let (mut at_rest, mut far_m) = (None, 0.0_f64);
        fly(&(flight.clone(), sim.clone()), seed, |out| {
            let faults = out.decision.unwrap().faults;
            assert!(out.step < 200 || faults.contains(Fault::ObstacleUnseen), "{faults:?}");
            assert_eq!(out.phase(), Phase::Flying, "{faults:?}");
            if let Some(at) = out.pose_hat().filter(|_| out.step > 400) {
                let way = at - *at_rest.get_or_insert(at);
                far_m = maximum(far_m, way[pose::X].hypot(way[pose::Y]));
            }
        });
        assert!(far_m < 0.2, "seed {seed}: {far_m:.2} m");
    }
}

#[test]
fn a_vehicle_that_evades_somebody_who_is_hidden_on_the_way_to_it_does_not_return_to_it() {
    const RADIUS_M: f64 = 0.3;
    let (mut flight, mut sim) = tables();
    let hover = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/missions/hover.json");
    flight.mission = config::mission(&hover).unwrap();
    flight.cycle.obstacles = vec![ObstacleTable::Moving { radius_m: RADIUS_M }];
    // It walks through the hover at 7.2 s, unseen from 3 m before it on, and counts as forgotten when it is there.
    let (from_w_m, to_w_m) = ([12.0, 0.05, 1.0], [-12.0, 0.05, 1.0]);
    sim.passer = Some(PasserTable { from_w_m, to_w_m, speed_mps: 1.5, hidden_s: Some([4.9, 1e3]) });
    let (mut away_m, mut least_m) = (0.0, f64::INFINITY);
    let (least, ..) = fly(&(flight, sim), 13, |out| {
        let at = out.pose_hat().unwrap();
        away_m = at[pose::X].hypot(at[pose::Y]);
        if out.step > 350 {
            least_m = least_m.min(away_m);
        }
    });
    let found = format!("{away_m} m from the hover, least {least_m} m, {least:?}");
    assert!(least_m > 0.3 && least.obstacle_m.unwrap() > 0.0, "{found}");
}

#[test]
fn a_mission_beside_a_wall_is_not_braked_by_it() {
    let (mut flight, sim) = tables();
    let room = RoomTable { x_m: [-2.25, 5.0], y_m: [-3.25, 5.0], z_m: [-0.2, 3.0], stop_s: 1.3 };
    flight.cycle.supervisor.room = Some(room);
    let (least, near, reached) = fly(&(flight.clone(), sim.clone()), 2, |_| ());
    assert!(least.wall_m.unwrap() > 0.03 && reached == 5, "{least:?}, {reached} targets");
    flight.cycle.mpc.walls = None;
    let (_, near_without, _) = fly(&(flight, sim), 2, |_| ());
    assert!(near == 0 && near_without > 20, "{near} and {near_without} ticks");
}

#[test]
fn a_flight_around_an_obstacle_replays_bit_by_bit_and_its_log_has_the_clearance() {
    let folder = folder("walls-replay");
    let (mut flight, sim) = tables();
    flight.cycle.obstacles = vec![POLE];
    flight.cycle.obstacles.push(ObstacleTable::Moving { radius_m: 0.2 });
    let (from_w_m, to_w_m) = ([-3.5, -1.2, 1.0], [-0.5, -1.2, 1.0]);
    let sim = SimTable {
        passer: Some(PasserTable { from_w_m, to_w_m, speed_mps: 0.7, hidden_s: None }),
        ..sim
    };
    let path = folder.join("flight.mcap");
    let mut virtual_flight = VirtualFlight::new(&flight, &sim, 4).unwrap();
    let mut log = flight_log::create(&path, &flight, 0, &virtual_flight.new_outcome()).unwrap();
    for step in 0..400 {
        let out = virtual_flight.tick().unwrap().clone();
        let inbox = virtual_flight.inbox().clone();
        let timing = Timing { step, ..Timing::default() };
        flight_log::write_tick(&mut log, &TickRecord { inbox, out, timing }).unwrap();
    }
    log.finish().unwrap();
    let output = tello_ctl(&folder, &["replay", path.to_str().unwrap()]);
    assert!(text(&output).contains("equal, bit by bit"), "{}", text(&output));
    let output = tello_ctl(&folder, &["report", path.to_str().unwrap()]);
    assert!(text(&output).contains("nearest to an obstacle: 0."), "{}", text(&output));
    let mut reader = tello_io::log::LogReader::open(&path).unwrap().select(&["/control/solve"]);
    let mut active = 0;
    while let Some(message) = reader.next_message().unwrap() {
        let record: Value = serde_json::from_slice(message.data).unwrap();
        active += record.pointer("/clearance/active").and_then(Value::as_u64).unwrap_or(0);
    }
    assert!(active > 50, "{active}");
}

#[test]
fn check_names_wrong_obstacles_and_draws_right_ones() {
    let folder = folder("walls-check");
    let (fly, _) = config::fly(None, None).unwrap();
    let with = |obstacles: Value| {
        let mut settings = serde_json::to_value(&fly).unwrap();
        settings["cycle"]["obstacles"] = obstacles;
        let mission = format!("{}/../../configs/missions/square.json", env!("CARGO_MANIFEST_DIR"));
        settings["mission"] = mission.into();
        let path = folder.join("fly.json");
        fs::write(&path, serde_json::to_string_pretty(&settings).unwrap()).unwrap();
        let picture = folder.join("seen");
        let arguments =
            ["check", path.to_str().unwrap(), "--figure", picture.to_str().unwrap(), "--force"];
        text(&tello_ctl(&folder, &arguments))
    };
    let pole = |x: f64, radius_m: f64| json!({ "kind": "cylinder", "centre_m": [x, -2.2], "radius_m": radius_m, "z_m": [0, 2] });
    for (obstacles, expected) in [
        (
            json!([pole(-2.3, 0.2), pole(-2.3, -0.2)]),
            "cycle.obstacles[1].radius_m = -0.2: expected",
        ),
        (
            json!([{ "kind": "box", "x_m": [1, 0], "y_m": [0, 1], "z_m": [0, 1] }]),
            "x_m = [1, 0]: expected the first number",
        ),
        (json!([{ "kind": "ball", "x_m": [1, 0] }]), "unknown variant `ball`"),
        (
            json!([pole(-2.1, 0.9)]),
            "(-2.00, -1.50, 1.30) m: expected outside of cycle.obstacles[0]: it is 0.19 m inside",
        ),
        (json!([pole(-2.4, 0.2)]), "obstacle 0.20 m or more to each"),
        (json!([pole(-2.1, 0.2)]), "obstacle 0.10 m INSIDE"),
    ] {
        let shown = with(obstacles.clone());
        assert!(shown.contains(expected), "{obstacles}: {shown}");
    }
    let svg = fs::read_to_string(folder.join("seen.svg")).unwrap();
    assert!(svg.contains("obstacle"), "a legend names it");
}
