use horizon_estim::{Observed, Recording};
use horizon_model::rows::{Pose, Sticks};

use super::*;
use crate::ident::job::fixtures;

fn log(theta: f64) -> Loaded {
    let o = vec![Observed::full(Pose::new(1.0, 2.0, 3.0, theta)); 3];
    let recording = Recording { u: vec![Sticks::zeros(); 3], o };
    Loaded { sha256: "ab".into(), skipped: vec!["c".into()], ..fixtures::log("a.log", recording) }
}

#[test]
fn a_turned_object_changes_the_heading_of_every_observation_and_nothing_else() {
    let mut logs = [log(0.5), log(-1.0)];
    turn(&mut logs, 0.25);
    for (log, theta) in logs.iter().zip([0.75, -0.75]) {
        let expected = Observed::full(Pose::new(1.0, 2.0, 3.0, theta));
        assert!(log.recording.o.iter().all(|o| *o == expected), "{:?}", log.recording.o);
    }
}

#[test]
fn no_log_is_refused_with_the_reason_of_each_file() {
    let unusable = [("a.log", "it is empty"), ("b.mcap", "there is no flight in it")];
    let files = unusable.map(|(path, why)| FileSkipped { path: path.into(), why: why.into() });
    assert!(refuse_none(&[log(0.0)], &files).is_ok());
    let message = refuse_none(&[], &files).unwrap_err().to_string();
    let expected = "no log can be used:\n  a.log: it is empty\n  b.mcap: there is no flight in it";
    assert_eq!(message, expected);
}

#[test]
fn an_identification_needs_logs_and_a_judgement_does_not() {
    let table = crate::ident::settings(None).unwrap();
    assert!(load_logs(&[], &table).unwrap_err().to_string().starts_with("no logs"));
    let (logs, skipped) = load_judged(&[], 0.02, 0.0, &[]).unwrap();
    assert!(logs.is_empty() && skipped.is_empty());
}

#[test]
fn a_file_that_was_used_is_reported_with_its_length_and_what_was_left_out() {
    let FileUsed { path, sha256, steps, skipped } = log(0.0).into();
    assert_eq!((path, sha256.as_str(), steps), (PathBuf::from("a.log"), "ab", 3));
    assert_eq!(skipped, ["c"]);
}
