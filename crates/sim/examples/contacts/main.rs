//! Flights with faults beside walls and past an obstacle that moves: contacts, and whether braking would have avoided
//! them.
//!
//! `cargo run --release -p tello-sim --example contacts -- faults 500 1` flies 500 seeds from 1 on through each scene
//! with faults of all families; `good_day` in place of `faults` flies without. More arguments choose the plant,
//! `identified` or `rigid_body`, the scene, `walls`, `passer` or `both`, `obstacle_accel_mps2` and `margin_sd` of the
//! plan.

mod contact;

use std::collections::BTreeMap;

use anyhow::{Result, bail};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use tello_flight::{MissionTable, ObstacleTable, RoomTable, Start};
use tello_io::config;
use tello_sim::plant::RIGID_BODY;
use tello_sim::{PasserTable, Profile, SimTable};

use contact::{ContactFlight, fly_to_contact};

/// Walls beside two sides of the square from (-2, -3) to (-0.5, -1.5).
const NEAR: RoomTable =
    RoomTable { x_m: [-5.0, -0.25], y_m: [-5.0, -1.25], z_m: [-0.2, 3.0], stop_s: 1.3 };

/// It crosses the first side and turns round on the third.
const PASSER: PasserTable = PasserTable {
    from_w_m: [-3.5, -2.2, 1.0],
    to_w_m: [-0.5, -2.2, 1.0],
    speed_mps: 1.0,
    hidden_s: None,
};

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [what, count, first, others @ ..] = arguments.as_slice() else {
        bail!(
            "usage: contacts faults|good_day COUNT FIRST_SEED [PLANT] [SCENE] [ACCEL_MPS2] [MARGIN_SD]"
        );
    };
    let (count, first): (u64, u64) = (count.parse()?, first.parse()?);
    let has_faults = what == "faults";
    let (fly, mission) = config::fly(None, None)?;
    let mut flight = config::flight(&fly, mission, Start::Airborne);
    let mut sim = SimTable { profile: Profile::GoodDay, ..tello_sim::settings(None)? };
    if others.first().is_some_and(|name| name == "rigid_body") {
        sim.plant.rigid_body = Some(RIGID_BODY);
    }
    let MissionTable::Waypoints(square) = &mut flight.mission else { bail!("no waypoints") };
    square.laps = 2;
    if let (Some(accel), Some(walls)) = (others.get(2), &mut flight.cycle.mpc.walls) {
        walls.obstacle_accel_mps2 = accel.parse()?;
    }
    if let (Some(sd), Some(walls)) = (others.get(3), &mut flight.cycle.mpc.walls) {
        walls.margin_sd = sd.parse()?;
    }
    let chosen = others.get(1).map_or("both", String::as_str);
    for scene in ["walls", "passer"].into_iter().filter(|scene| ["both", scene].contains(&chosen)) {
        let (mut flight, mut sim) = (flight.clone(), sim.clone());
        if scene == "walls" {
            flight.cycle.supervisor.room = Some(NEAR);
        } else {
            flight.cycle.obstacles.push(ObstacleTable::Moving { radius_m: 0.2 });
            sim.passer = Some(PASSER);
        }
        let flown: Result<Vec<ContactFlight>> = (first..first + count)
            .into_par_iter()
            .map(|seed| fly_to_contact(&flight, &sim, has_faults, seed))
            .collect();
        print(scene, first, &flown?);
    }
    Ok(())
}

fn print(scene: &str, first: u64, flown: &[ContactFlight]) {
    let finished = flown.iter().filter(|one| one.is_finished).count();
    let mut contacts: BTreeMap<_, u32> = BTreeMap::new();
    for contact in flown.iter().filter_map(|one| one.contact) {
        *contacts.entry((contact.touched, contact.avoidability)).or_default() += 1;
    }
    println!("{scene}: {} flights, {finished} finished, contacts {contacts:?}", flown.len());
    for (one, seed) in flown.iter().zip(first..) {
        let Some(contact) = one.contact else { continue };
        println!("seed {seed}: {contact:?}, {:?}", one.families);
    }
}
