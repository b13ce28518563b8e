use horizon_model::rows::Sticks;
use horizon_model::{InputFifo, Kinematic, Model as _};
use tello_io::config;

use super::*;

fn settings() -> CycleTable {
    config::fly(None, None).unwrap().0.cycle
}

/// An estimate `shift` prior deviations away from the prior, every row known to `part` of its prior.
fn found(shift: f64, part: f64) -> ParameterEstimate {
    let mhe = settings().mhe;
    let rows = mhe.p_prior.iter().zip(&mhe.c_p);
    let p: Vec<f64> = rows.map(|(value, weight)| value + shift / weight).collect();
    let variance = |i: usize, j: usize| {
        if i == j { (part / mhe.c_p[i]).powi(2) } else { 0.0 }
    };
    let covariance = (0..p.len()).map(|i| (0..p.len()).map(|j| variance(i, j)).collect());
    let covariance = covariance.collect();
    ParameterEstimate { p, covariance, dead_time_change_s: None }
}

fn done<'a>(found: &'a ParameterEstimate, date: &'a str) -> FlightDone<'a> {
    FlightDone { found, date, is_simulated: false }
}

fn path(name: &str) -> std::path::PathBuf {
    let folder = std::env::temp_dir().join(format!("tello-ctl-vehicle-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join(name);
    std::fs::remove_file(&path).ok();
    path
}

#[test]
fn a_flight_makes_the_file_and_the_next_one_starts_there() {
    let path = path("next.json");
    let mut table = settings();
    before_flight(&path, &mut table, false).unwrap();
    assert_eq!(table, settings(), "nothing is known yet");
    let first = found(0.5, 0.1);
    let changed = after_flight(&path, &table, &done(&first, "2026-11-22")).unwrap();
    assert_eq!(changed.len(), first.p.len());
    before_flight(&path, &mut table, false).unwrap();
    assert_eq!(table.mhe.p_prior, first.p);
    assert_eq!(table.dead_time_s, settings().dead_time_s);
    after_flight(&path, &table, &done(&found(0.6, 0.1), "2026-11-23")).unwrap();
    let flown = ParameterFile::read(&path).unwrap().flown.unwrap();
    let expected = FlightHistory {
        flights: 2,
        first: "2026-11-22".into(),
        last: "2026-11-23".into(),
        is_simulated: false,
    };
    assert_eq!(flown, expected);
    std::fs::remove_file(&path).unwrap();
}

#[test]
fn dead_times_change_as_they_were_found_and_stay_within_their_range() {
    let settings = settings();
    let flown = |dead_time_change_s| {
        let mut file = ParameterFile::of_settings(&settings);
        let found = ParameterEstimate { dead_time_change_s, ..found(0.5, 0.9) };
        let changed = file.update_parameters(&settings, &done(&found, "2026-11-22")).unwrap();
        file.check().unwrap();
        (file.dead_time_s, changed)
    };
    let (later, changed) = flown(Some(Sticks::repeat(0.1)));
    for (after, before) in later.iter().zip(&settings.dead_time_s) {
        assert!((after - before - 0.1).abs() < 1e-12);
    }
    assert_eq!((changed.len(), changed[0].name), (1, "dead_time"));
    let (each, _) = flown(Some(Sticks::new(0.1, 0.1, 0.0, 0.02)));
    for (axis, longer_s) in [0.1, 0.1, 0.0, 0.02].into_iter().enumerate() {
        assert!((each[axis] - settings.dead_time_s[axis] - longer_s).abs() < 1e-12, "{axis}");
    }
    let (longest, _) = flown(Some(Sticks::repeat(1.9)));
    assert!((longest[stick::ROLL] - DEAD_TIME_MAX_S).abs() < 1e-12, "{longest:?}");
    assert_eq!(flown(None), (settings.dead_time_s.clone(), Vec::new()));
}

#[test]
fn each_dead_time_gets_shorter_as_far_as_the_flight_lets_its_axis() {
    for (min_ratio, longer_steps, expected_s) in [
        (0.5, -8, [0.18, 0.18, 0.02, 0.095]),
        (0.5, -2, [0.3, 0.3, 0.02, 0.15]),
        (0.5, -50, [0.17, 0.17, 0.02, 0.095]),
        (0.0, -8, [0.18, 0.18, 0.0, 0.03]),
        (0.0, -50, [0.0; 4]),
        (1.0, -8, [0.34, 0.34, 0.04, 0.19]),
        (1.0, 1, [0.36, 0.36, 0.06, 0.21]),
    ] {
        let longer_s = 0.02 * f64::from(longer_steps);
        let mut settings = settings();
        settings.dead_time_s = vec![0.34, 0.34, 0.04, 0.19];
        settings.link.as_mut().unwrap().dead_time_min_ratio = min_ratio;
        let mut file = ParameterFile::of_settings(&settings);
        let found = ParameterEstimate {
            dead_time_change_s: Some(Sticks::repeat(longer_s)),
            ..found(0.5, 0.9)
        };
        file.update_parameters(&settings, &done(&found, "2026-11-22")).unwrap();
        file.check().unwrap();
        // The FIFO of the flight after the same correction.
        let mut fifo = InputFifo::new(&settings.dead_time_s, &Kinematic::INPUT, 0.02).unwrap();
        fifo = fifo.with_min_ratio(min_ratio).unwrap();
        fifo.correct([longer_steps; 4]);
        for (axis, (after_s, expected_s)) in file.dead_time_s.iter().zip(expected_s).enumerate() {
            let flown_s = 0.02 * fifo.dead_time_steps()[axis];
            assert!((after_s - expected_s).abs() < 1e-12, "{min_ratio}, {longer_s} s: {file:?}");
            assert!((after_s - flown_s).abs() < 1e-12, "axis {axis}: {after_s}, {flown_s} s");
        }
    }
}

#[test]
fn what_was_not_excited_stays() {
    let settings = settings();
    let mut file = ParameterFile::of_settings(&settings);
    let before = file.clone();
    let changed = file.update_parameters(&settings, &done(&found(0.5, 0.9), "2026-11-22")).unwrap();
    assert!(changed.is_empty() && file == before);
    let mut one = found(0.5, 0.9);
    one.covariance[0][0] *= 1e-4;
    let changed = file.update_parameters(&settings, &done(&one, "2026-11-22")).unwrap();
    assert_eq!(changed.len(), 1);
    assert_eq!(file.values()[1..], before.values()[1..]);
    assert!((file.values()[0] - one.p[0]).abs() < 1e-12);
}

#[test]
fn a_flight_moves_no_parameter_far() {
    let settings = settings();
    let mhe = &settings.mhe;
    for (shift, part) in [(50.0, 0.1), (-50.0, 0.1)] {
        let mut file = ParameterFile::of_settings(&settings);
        file.update_parameters(&settings, &done(&found(shift, part), "2026-11-22")).unwrap();
        file.check().unwrap();
        for (i, value) in file.values().iter().enumerate() {
            assert!((mhe.p_lb[i]..=mhe.p_ub[i]).contains(value), "row {i}: {value}");
            let moved = (value - mhe.p_prior[i]).abs();
            assert!(moved <= 3.0 / mhe.c_p[i] + 1e-12, "row {i} by {moved}");
        }
        let mut next = settings.clone();
        next.take(&file).unwrap();
    }
}

#[test]
fn what_is_no_estimate_is_refused() {
    let settings = settings();
    let mut file = ParameterFile::of_settings(&settings);
    let before = file.clone();
    let mut nan = found(0.1, 0.1);
    nan.p[2] = f64::NAN;
    let mut short = found(0.1, 0.1);
    short.covariance.pop();
    for found in [nan, short] {
        assert!(file.update_parameters(&settings, &done(&found, "2026-11-22")).is_err());
        assert_eq!(file, before);
    }
}

#[test]
fn a_simulated_flight_does_not_change_the_file_of_a_real_drone() {
    let path = path("world.json");
    let mut table = settings();
    let found = found(0.5, 0.1);
    after_flight(&path, &table, &done(&found, "2026-11-22")).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    assert!(before_flight(&path, &mut table, true).is_err());
    let simulated = FlightDone { is_simulated: true, ..done(&found, "2026-11-23") };
    assert!(after_flight(&path, &table, &simulated).is_err());
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
    assert!(before_flight(Path::new("no/folder/here.json"), &mut table, false).is_err());
    std::fs::remove_file(&path).unwrap();
}
