//! Flights beside walls and obstacles, without and with them in the plan: how near they come, and what a tick takes.
//!
//! `cargo run --release -p tello-sim --example walls -- 200` flies 200 seeds of each scene with both plants and prints
//! the tables of `docs/benchmarks/2026-11-23-walls/README.md`.

use anyhow::{Context, Result};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use tello_eval::metrics::{LeastClearance, Surroundings};
use tello_eval::quantile;
use tello_flight::cycle::{self, FlightTable, Inbox, Unwatched};
use tello_flight::{Fault, ObstacleTable, Phase, RoomTable, Start};
use tello_io::clock::Clock;
use tello_io::config;
use tello_sim::plant::RIGID_BODY;
use tello_sim::virtual_time::VirtualFlight;
use tello_sim::{PasserTable, Profile, SimTable};

/// First seed, as in the other benchmarks.
const SEED: u64 = 1001;

/// Time after which a flight is given up. s
const TIME_LIMIT_S: f64 = 60.0;

/// Passes of the timed ticks; each tick counts with its shortest time.
const PASSES: usize = 15;

/// Obstacles beside the square from (-2, -3) to (-0.5, -1.5), whose first side leads along y.
struct Scene {
    name: &'static str,
    room: Option<RoomTable>,
    obstacle: Option<ObstacleTable>,
    passer: Option<PasserTable>,
}

impl Scene {
    fn new(name: &'static str) -> Self {
        Self { name, room: None, obstacle: None, passer: None }
    }

    fn among(name: &'static str, obstacle: ObstacleTable) -> Self {
        Self { obstacle: Some(obstacle), ..Self::new(name) }
    }
}

fn pole(x_m: f64, radius_m: f64) -> ObstacleTable {
    let (centre_m, z_m) = ([x_m, -2.2], [-0.2, 2.5]);
    ObstacleTable::Cylinder { centre_m, radius_m, z_m }
}

fn scenes() -> [Scene; 7] {
    let near = RoomTable { x_m: [-5.0, -0.25], y_m: [-5.0, -1.25], z_m: [-0.2, 3.0], stop_s: 1.3 };
    let block = ObstacleTable::Box { x_m: [-2.3, -1.7], y_m: [-2.5, -2.0], z_m: [-0.2, 1.25] };
    let passer = PasserTable {
        from_w_m: [-3.5, -2.2, 1.0],
        to_w_m: [-0.5, -2.2, 1.0],
        speed_mps: 1.0,
        hidden_s: None,
    };
    let moving = ObstacleTable::Moving { radius_m: 0.2 };
    [
        Scene::new("far from all"),
        Scene { room: Some(near), ..Scene::new("two walls at 0.25 m") },
        Scene::among("pole 0.10 m beside the path", pole(-2.35, 0.25)),
        Scene::among("pole 0.05 m over the path", pole(-2.1, 0.15)),
        Scene::among("pole in the middle of the path", pole(-2.0, 0.15)),
        Scene::among("box 0.05 m below the path", block),
        Scene { passer: Some(passer), ..Scene::among("passer of 0.2 m radius at 1 m/s", moving) },
    ]
}

/// How one flight went.
struct Flown {
    finish_s: Option<f64>,
    least_m: f64,
    braked_s: f64,
}

fn fly(flight: &FlightTable, around: &Surroundings, sim: &SimTable, seed: u64) -> Result<Flown> {
    let dt_s = flight.cycle.dt_s;
    let mut virtual_flight = VirtualFlight::new(flight, sim, seed)?.without_plan();
    let (mut least, mut braked_s) = (LeastClearance::default(), 0.0);
    let (mut began_s, mut finish_s) = (None, None);
    let mut now_s = 0.0;
    while now_s < TIME_LIMIT_S && finish_s.is_none() {
        let out = virtual_flight.tick()?;
        if out.phase() != Phase::Flying {
            break;
        }
        now_s = out.step as f64 * dt_s;
        if out.targets_reached > 0 {
            began_s.get_or_insert(now_s);
        }
        if out.targets_reached == 5 {
            finish_s = began_s.map(|began_s| now_s - began_s + dt_s);
        }
        let has = |fault| out.decision.is_some_and(|decision| decision.faults.contains(fault));
        let is_braked = has(Fault::PlanBlocked) || has(Fault::FenceNear);
        braked_s += if is_braked { dt_s } else { 0.0 };
        least.add(around.at(&virtual_flight.true_pose(), virtual_flight.true_obstacle_w()));
    }
    let least_m = least.obstacle_m.or(least.wall_m).context("nothing to be near to")?;
    Ok(Flown { finish_s, least_m, braked_s })
}

/// Median time of a tick with a plan, each by its shortest time of all passes. us
fn tick_us(flight: &FlightTable, sim: &SimTable) -> Result<f64> {
    let mut virtual_flight = VirtualFlight::new(flight, sim, SEED)?;
    let mut inboxes: Vec<Inbox> = Vec::new();
    for _ in 0..600 {
        virtual_flight.tick()?;
        inboxes.push(virtual_flight.inbox().clone());
    }
    let clock = Clock::start();
    let mut least_us = vec![f64::INFINITY; inboxes.len()];
    for _ in 0..PASSES {
        let mut cycle = cycle::build(flight)?;
        let mut out = cycle.new_outcome();
        for (least_us, inbox) in least_us.iter_mut().zip(&inboxes) {
            let start = clock.now();
            cycle.tick(inbox, &mut Unwatched::without_plan(), &mut out);
            *least_us = least_us.min(clock.now().since(start).seconds() * 1e6);
        }
    }
    quantile(&least_us, 0.5).context("no tick")
}

fn main() -> Result<()> {
    let count = std::env::args().nth(1).map_or(Ok(20), |count| count.parse::<u64>())?;
    let (fly_table, mission) = config::fly(None, None)?;
    let built_in = config::flight(&fly_table, mission, Start::Airborne);
    println!(
        "| scene | plant | walls in the plan | finished | touched | least clearance: worst, median m | finish, median s | braked, mean s | tick, median us |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for Scene { name, room, obstacle, passer } in scenes() {
        for (plant, rigid_body) in [("identified", None), ("rigid body", Some(RIGID_BODY))] {
            let mut sim = SimTable { profile: Profile::GoodDay, ..tello_sim::settings(None)? };
            sim.plant.rigid_body = rigid_body;
            sim.passer = passer;
            let mut with = built_in.clone();
            with.cycle.supervisor.room = room.clone().or(with.cycle.supervisor.room);
            with.cycle.obstacles.extend(obstacle.clone());
            let around = Surroundings::of(&with.cycle)?;
            let mut without = with.clone();
            without.cycle.mpc.walls = None;
            without.cycle.obstacles.clear();
            for (known, flight) in [("no", &without), ("yes", &with)] {
                let flown: Result<Vec<Flown>> = (SEED..SEED + count)
                    .into_par_iter()
                    .map(|seed| fly(flight, &around, &sim, seed))
                    .collect();
                let flown = flown?;
                let finished = flown.iter().filter(|one| one.finish_s.is_some()).count();
                let touched = flown.iter().filter(|one| one.least_m < 0.0).count();
                let least_m: Vec<f64> = flown.iter().map(|one| one.least_m).collect();
                let times_s = flown.iter().map(|one| one.finish_s.unwrap_or(TIME_LIMIT_S));
                let times_s: Vec<f64> = times_s.collect();
                let at = |values: &[f64], fraction| quantile(values, fraction).unwrap_or(f64::NAN);
                let braked_s = flown.iter().map(|one| one.braked_s).sum::<f64>() / count as f64;
                println!(
                    "| {name} | {plant} | {known} | {finished} of {count} | {touched} | {:.3}, {:.3} | {:.2} | {braked_s:.2} | {:.1} |",
                    at(&least_m, 0.0),
                    at(&least_m, 0.5),
                    at(&times_s, 0.5),
                    tick_us(flight, &sim)?,
                );
            }
        }
    }
    Ok(())
}
