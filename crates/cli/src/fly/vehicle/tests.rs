use std::path::{Path, PathBuf};

use clap::Parser;
use tello_eval::flight_summary::Tally;
use tello_eval::parameter_file::{DataFile, ParameterFile};
use tello_flight::cycle::ParameterEstimate;
use tello_flight::{FaultSet, Phase, Start};
use tello_io::config;

use super::*;

#[derive(Debug, Parser)]
struct Program {
    #[command(flatten)]
    arguments: Arguments,
}

/// A vehicle file that does not exist yet.
fn path(name: &str) -> PathBuf {
    let name = format!("tello-ctl-vehicle-{}-{name}.json", std::process::id());
    let path = std::env::temp_dir().join(name);
    std::fs::remove_file(&path).ok();
    path
}

fn flight() -> FlightTable {
    let (table, mission) = config::fly(None, None).unwrap();
    config::flight(&table, mission, Start::Grounded)
}

/// A flight that moved every parameter by half a deviation of its prior, and knows each to a tenth of it.
fn found(flight: &FlightTable) -> ParameterEstimate {
    let mhe = &flight.cycle.mhe;
    let count = mhe.p_prior.len();
    let variance = |i: usize, j: usize| if i == j { (0.1 / mhe.c_p[i]).powi(2) } else { 0.0 };
    ParameterEstimate {
        p: mhe.p_prior.iter().zip(&mhe.c_p).map(|(value, weight)| value + 0.5 / weight).collect(),
        covariance: (0..count).map(|i| (0..count).map(|j| variance(i, j)).collect()).collect(),
        dead_time_change_s: None,
    }
}

/// What a flight left that ended in `phase` with all but `missed` targets reached.
fn left(path: &Path, phase: Phase, missed: usize, has_flown: bool) -> Option<ParameterFile> {
    let flight = flight();
    let words = ["fly", "--sim", "--vehicle", path.to_str().unwrap()];
    let arguments = Program::try_parse_from(words).unwrap().arguments;
    let mut summary = Tally::new(&flight).unwrap().summary();
    summary.phase = phase;
    summary.targets_reached = summary.targets_count - missed;
    let end = LoopEnd {
        phase,
        faults_last: FaultSet::default(),
        faults: FaultSet::default(),
        ended_by: FaultSet::default(),
        targets_reached: summary.targets_reached,
        has_frames: true,
        orders_lost: 0,
        sightings_dropped: 0,
        records_dropped: 0,
        found: has_flown.then(|| found(&flight)),
    };
    save_vehicle_parameters(&arguments, &flight, &summary, &end, Clock::start());
    path.exists().then(|| ParameterFile::read(path).unwrap())
}

#[test]
fn a_flight_that_ended_well_leaves_its_estimate_and_whether_it_was_simulated() {
    let path = path("good");
    let file = left(&path, Phase::Landed, 0, true).unwrap();
    let flight = flight();
    let values: Vec<f64> =
        flight.cycle.model.parameters().iter().map(|row| file.parameters[row.name].value).collect();
    assert_eq!(values, found(&flight).p);
    let flown = file.flown.unwrap();
    assert_eq!((flown.flights, flown.is_simulated), (1, true));
    std::fs::remove_file(&path).unwrap();
}

#[test]
fn a_flight_that_ended_early_leaves_the_file_as_it_was() {
    let path = path("early");
    for (phase, missed, has_flown) in [
        (Phase::Landed, 1, true),
        (Phase::LandingUnconfirmed, 0, true),
        (Phase::MotorsStopped, 0, true),
        (Phase::Landed, 0, false),
    ] {
        assert_eq!(left(&path, phase, missed, has_flown), None, "{phase:?}, {missed} missed");
    }
}

#[test]
fn parameters_of_simulated_logs_are_none_of_a_real_drone() {
    let path = path("simulated");
    let (mut table, _) = config::fly(None, None).unwrap();
    let mut file = ParameterFile::of_settings(&table.cycle);
    file.data = vec![DataFile {
        path: "a.mcap".into(),
        sha256: String::new(),
        steps: 1,
        is_simulated: true,
    }];
    file.write(&path).unwrap();
    let mut take = |words: &[&str]| {
        let words = [&["fly", "--params", path.to_str().unwrap()], words].concat();
        let arguments = Program::try_parse_from(words).unwrap().arguments;
        take_parameters(&arguments, &mut table)
    };
    let refusal = format!("{:#}", take(&[]).unwrap_err());
    assert!(refusal.contains("a.mcap was simulated"), "{refusal}");
    take(&["--sim"]).unwrap();
    take(&["--dry-run"]).unwrap();
    table.tello.address = "127.0.0.1:8889".into();
    let words = ["fly", "--params", path.to_str().unwrap()];
    take_parameters(&Program::try_parse_from(words).unwrap().arguments, &mut table).unwrap();
    std::fs::remove_file(&path).unwrap();
}
