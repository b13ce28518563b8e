use horizon_estim::{Observed, Recording};
use horizon_model::rows::{Pose, Sticks, pose};
use horizon_model::{Kinematic, Model, Row};
use tello_io::log::LogReader;

use super::super::compare::{Tally, ValidationFlight};
use super::super::predict::AddErrors;
use super::super::report::tests::fit;
use super::super::table::IdentFileTable;
use super::*;
use crate::ident::job::fixtures;

const OBSERVATION: [Row; 4] =
    [Row::linear("x", "m"), Row::linear("y", "m"), Row::linear("z", "m"), Row::angle("theta")];

/// A fit of nothing.
struct Nothing;

impl AddErrors for Nothing {
    fn add_errors_to(&self, _: &ValidationFlight, _: &mut Tally, _: usize) {}
}

/// A log of five steps; x is -1.25, y is absent in the odd ones.
fn log(path: &str) -> Loaded {
    let observed = |step: usize| {
        let mut o = Observed::full(Pose::new(-1.25, 2.0, 0.0, 0.0));
        o.is_present[pose::Y] = step.is_multiple_of(2);
        o
    };
    let recording = Recording { u: vec![Sticks::zeros(); 5], o: (0..5).map(observed).collect() };
    fixtures::log(path, recording)
}

/// A piece of a log; the rows of its states are 0.5, 1.5 and so on, a tenth more in each step.
fn trace(log: usize, steps: std::ops::Range<usize>) -> Trace {
    let row = |row: usize| (0..steps.len()).map(|k| 0.5 + row as f64 + 0.1 * k as f64).collect();
    let s = (0..Kinematic::STATE.len()).map(row).collect();
    let none = Vec::new;
    let (simulated, transition_residuals, observation_residuals) = (none(), none(), none());
    Trace { log, steps, s, simulated, transition_residuals, observation_residuals }
}

fn result(traces: Vec<Trace>) -> FitResult {
    FitResult {
        fit: fit(),
        state_rows: &Kinematic::STATE,
        observation_rows: &OBSERVATION,
        traces,
        resamples: None,
        delay: Vec::new(),
        has_converged: true,
        parameter_file: None,
        predict: Box::new(Nothing),
    }
}

fn table() -> IdentFileTable {
    crate::ident::settings(None).unwrap()
}

fn job<'a>(table: &'a IdentFileTable, logs: &'a [Loaded]) -> Job<'a> {
    let (name, bootstrap, flight) = ("ident.json", None, None);
    Job { name, table, logs, bootstrap, flight, observer: &(), keeps_estimates: true }
}

#[test]
fn an_absent_observation_is_an_empty_field() {
    let (table, logs) = (table(), [log("a.log")]);
    let (first, second) = (trace(0, 0..1), trace(0, 3..5));
    let csv = estimates_csv(&job(&table, &logs), &result(vec![]), &logs[0], &[&first, &second]);
    assert_eq!(
        csv,
        "piece,step,time_s,x,y,z,theta,o_x,o_y,o_z,o_theta\n\
         0,0,0.000,0.500000,1.500000,2.500000,3.500000,-1.250000,2.000000,0.000000,0.000000\n\
         1,3,0.060,0.500000,1.500000,2.500000,3.500000,-1.250000,,0.000000,0.000000\n\
         1,4,0.080,0.600000,1.600000,2.600000,3.600000,-1.250000,2.000000,0.000000,0.000000\n"
    );
}

#[test]
fn each_log_with_a_piece_has_its_files_numbered_by_its_place() {
    let dir = std::env::temp_dir().join(format!("tello-ctl-estimates-{}", std::process::id()));
    fs::create_dir_all(&dir).unwrap();
    fs::write(dir.join("001-old.csv"), "").unwrap();
    let mut table = table();
    let logs = [log("a/f.log"), log("b/g.log"), log("c/f.log")];
    let result = result(vec![trace(0, 0..2), trace(2, 1..4)]);
    let names = || {
        let mut names: Vec<_> =
            fs::read_dir(&dir).unwrap().map(|file| file.unwrap().file_name()).collect();
        names.sort();
        names
    };
    let expected = ["001-f.csv", "001-f.mcap", "003-f.csv", "003-f.mcap"];
    table.clear_estimates = true;
    write_estimates(&dir, &job(&table, &logs), &result).unwrap();
    assert_eq!(names(), expected, "what was there before is gone");
    fs::write(dir.join("009-kept.csv"), "").unwrap();
    table.clear_estimates = false;
    write_estimates(&dir, &job(&table, &logs), &result).unwrap();
    assert_eq!(names()[..4], expected);
    assert_eq!(names()[4..], ["009-kept.csv"]);
    let mut log = LogReader::open(&dir.join("003-f.mcap")).unwrap();
    let mut times_ms = Vec::new();
    while let Some(message) = log.next_message().unwrap() {
        times_ms.push(message.t.0 / 1_000_000);
    }
    assert_eq!(times_ms, [20, 40, 60]);
    fs::remove_dir_all(dir).unwrap();
}

#[test]
fn parameters_of_an_earlier_run_keep_another_name() {
    let dir = std::env::temp_dir().join(format!("tello-ctl-earlier-{}", std::process::id()));
    fs::create_dir_all(&dir).unwrap();
    fs::write(dir.join("parameters.json"), "mine").unwrap();
    let (table, logs) = (table(), [log("a.log")]);
    let written = write(&dir, &job(&table, &logs), &result(vec![])).unwrap();
    let earlier = dir.join("parameters.earlier.json");
    assert_eq!((fs::read(&earlier).unwrap(), &written[0]), (b"mine".to_vec(), &earlier));
    assert!(!dir.join("parameters.json").exists());
    fs::remove_dir_all(dir).unwrap();
}

#[test]
fn what_flights_taught_is_kept() {
    let dir = std::env::temp_dir().join(format!("tello-ctl-taught-{}", std::process::id()));
    fs::create_dir_all(&dir).unwrap();
    let parameters = dir.join("parameters.json");
    let taught = |flights: u32| format!("{{ \"flown\": {{ \"flights\": {flights} }} }}");
    for (number, name) in [(1, "parameters.earlier.json"), (2, "parameters.earlier-2.json")] {
        fs::write(&parameters, taught(number)).unwrap();
        assert!(has_flown(&parameters));
        let earlier = keep_earlier(&parameters).unwrap();
        assert_eq!(earlier, dir.join(name));
        assert_eq!(fs::read_to_string(earlier).unwrap(), taught(number));
        assert!(!has_flown(&parameters), "it is gone");
    }
    fs::write(&parameters, "{ \"flown\": null }").unwrap();
    assert!(!has_flown(&parameters));
    fs::remove_dir_all(dir).unwrap();
}
