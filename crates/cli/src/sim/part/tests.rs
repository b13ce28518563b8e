use clap::Parser;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::*;

#[derive(Debug, Parser)]
struct Program {
    #[command(flatten)]
    arguments: Arguments,
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Row(u64);

impl Seeded for Row {
    fn seed(&self) -> Option<u64> {
        Some(self.0)
    }
}

fn target(words: &[&str], settings: Value) -> Option<Target> {
    let words = ["sim", "--batch", "10", "--seed", "100"].iter().chain(words);
    let arguments = Program::try_parse_from(words).unwrap().arguments;
    Target::of(&arguments, Kind::Batch, settings, 10)
}

/// The second of three parts, at `path`.
fn second(path: &str, settings: Value) -> Target {
    target(&["--shard", "2/3", "--part", path], settings).unwrap()
}

#[test]
fn a_batch_that_is_not_divided_has_no_target() {
    assert!(target(&[], Value::Null).is_none());
    let target = second("second.part", Value::Null);
    assert_eq!(target.path, PathBuf::from("second.part"));
    assert_eq!((target.header.numbers(), target.header.seeds()), ([2, 3], 103..106));
    assert_eq!((target.header.seed, target.header.count), (100, 10));
    assert_eq!(target.header.names, ["built-in", "built-in"]);
}

#[test]
fn a_part_is_flown_once_and_never_taken_for_one_of_other_settings() {
    let name = format!("tello-ctl-part-{}.part", std::process::id());
    let path = std::env::temp_dir().join(name);
    std::fs::remove_file(&path).ok();
    let at = path.to_str().unwrap();
    let target = second(at, json!({ "gain": 1 }));
    assert!(!target.check_existing::<Row>().unwrap());
    assert!(target.write(&[Row(103)]).is_err(), "two of its three seeds are missing");
    assert!(!target.check_existing::<Row>().unwrap());
    assert_eq!(target.write(&[Row(103), Row(104), Row(105)]).unwrap(), Verdict::Good);
    assert!(target.check_existing::<Row>().unwrap());
    let other = second(at, json!({ "gain": 2 })).check_existing::<Row>().unwrap_err().to_string();
    assert!(other.contains("hash of the settings"), "{other}");
    std::fs::remove_file(&path).unwrap();
}
