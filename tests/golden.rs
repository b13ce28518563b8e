//! Closed-loop flights against recorded ones: a change of the flown way must show here and be looked at.
//!
//! `TELLO_GOLDEN=write cargo test --test quick golden` writes `tests/golden/*.csv` anew.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use horizon_model::check::{maximum, minimum};
use tello_flight::Start;
use tello_io::config;
use tello_sim::plant::RIGID_BODY;
use tello_sim::virtual_time::VirtualFlight;
use tello_sim::{Profile, SimTable};

/// Largest difference from a recorded flight: the last bits of sine and exponential differ between machines.
/// m, rad
const TOLERANCE: f64 = 1e-5;
/// Ticks between two recorded poses.
const EVERY: usize = 10;
/// Columns of a recording.
const HEADER: &str = "t_s,x_m,y_m,z_m,theta_rad";

fn project() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// True poses of a flight of 16 s, one line for each 0.2 s.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn fly(mission: &str, start: Start, change: impl FnOnce(&mut SimTable)) -> String {
    let mission = project().join(format!("configs/missions/{mission}.json"));
    let (fly, mission) = config::fly(None, Some(&mission)).unwrap();
    let mut sim = tello_sim::settings(None).unwrap();
    change(&mut sim);
    let mut flight = VirtualFlight::new(&config::flight(&fly, mission, start), &sim, 5).unwrap();
    let mut csv = format!("{HEADER}\n");
    for tick in 0..800_usize {
        flight.tick().unwrap();
        if tick.is_multiple_of(EVERY) {
            let [x, y, z, theta] = flight.true_pose().into();
            let t_s = 0.02 * tick as f64;
            writeln!(csv, "{t_s:.2},{x:.7},{y:.7},{z:.7},{theta:.7}").unwrap();
        }
    }
    csv
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn numbers(csv: &str) -> Vec<Vec<f64>> {
    let row = |line: &str| line.split(',').map(|number| number.parse().unwrap()).collect();
    csv.lines().skip(1).map(row).collect()
}

/// Compares `csv` with the recorded flight `name`.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn compare(name: &str, csv: &str) {
    let path = project().join(format!("tests/golden/{name}.csv"));
    if std::env::var_os("TELLO_GOLDEN").is_some_and(|what| what == "write") {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, csv).unwrap();
    }
    let recorded = fs::read_to_string(&path).unwrap();
    let (got, recorded) = (numbers(csv), numbers(&recorded));
    assert_eq!((got.len(), recorded.len()), (80, 80), "{name}");
    // It flies: more than a metre from one end to the other.
    let xs = got.iter().map(|row| row[1]);
    let (low, high) =
        xs.fold((f64::MAX, f64::MIN), |(low, high), x| (minimum(low, x), maximum(high, x)));
    assert!(high - low > 1.0, "{name}: {low} to {high} m");
    for (got, recorded) in got.iter().zip(&recorded) {
        let gap = got.iter().zip(recorded).map(|(a, b)| (a - b).abs()).fold(0.0, maximum);
        assert!(
            gap <= TOLERANCE,
            "{name} at {} s: {got:?} instead of {recorded:?}; if that is intended, run this test with \
             TELLO_GOLDEN=write and read the difference",
            recorded[0]
        );
    }
}

#[test]
fn the_square_from_the_ground_is_flown_as_recorded() {
    compare("square", &fly("square", Start::Grounded, |_| ()));
}

#[test]
fn a_square_with_outages_is_flown_as_recorded() {
    let change = |sim: &mut SimTable| sim.profile = Profile::Outages;
    compare("square_outages", &fly("square_at_once", Start::Airborne, change));
}

#[test]
fn the_figure_of_eight_is_flown_as_recorded() {
    compare("figure_eight", &fly("figure_eight", Start::Airborne, |_| ()));
}

#[test]
fn a_square_of_the_rigid_body_is_flown_as_recorded() {
    let change = |sim: &mut SimTable| sim.plant.rigid_body = Some(RIGID_BODY);
    compare("square_rigid_body", &fly("square", Start::Airborne, change));
}
