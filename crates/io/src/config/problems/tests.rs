use std::fs;
use std::path::PathBuf;

use serde::Deserialize;

use super::*;

const TEMPLATE: &str = r#"{ "a": 1.0, "b": { "c": 2, "d": 3 } }"#;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    a: f64,
    b: Inner,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Inner {
    c: u32,
    d: u32,
}

fn template(_: &Value) -> Option<Value> {
    serde_json::from_str(TEMPLATE).ok()
}

fn check(table: &Table) -> Result<(), SettingError> {
    if table.a <= 0.0 {
        return Err(SettingError::new("a", table.a, "> 0"));
    }
    if table.b.c + table.b.d > 9 {
        return Err(SettingError::new("b.d", table.b.d, "at most 9 with b.c"));
    }
    Ok(())
}

/// A file with `text`, of a name of its own.
fn file(name: &str, text: &str) -> PathBuf {
    let path =
        std::env::temp_dir().join(format!("tello-ctl-problems-{}-{name}", std::process::id()));
    fs::write(&path, text).unwrap();
    path
}

/// Places and texts of the mistakes of a file with `text`.
fn found(name: &str, text: &str) -> Vec<(Option<(usize, usize)>, String)> {
    let path = file(name, text);
    let problems = problems(&path, template, check);
    fs::remove_file(&path).unwrap();
    let named = path.display().to_string();
    assert!(problems.list.iter().all(|problem| problem.file == named), "{problems}");
    problems.list.into_iter().map(|problem| (problem.place, problem.text)).collect()
}

#[test]
fn every_kind_of_mistake_is_found_at_once_with_its_place() {
    let text = "{\n  \"a\": -1.0,\n  \"b\": { \"c\": \"x\", \"e\": 7 }\n}";
    let found = found("all", text);
    for (place, start) in [
        ((3, 15), "b.c: invalid type: string \"x\""),
        ((3, 25), "b.e: unknown field `e`"),
        ((3, 8), "b: missing field `d`"),
        ((2, 8), "a = -1: expected > 0"),
    ] {
        let is_it = |(at, text): &&(_, String)| *at == Some(place) && text.starts_with(start);
        assert_eq!(found.iter().filter(is_it).count(), 1, "{start}: {found:?}");
    }
    assert_eq!(found.len(), 4, "{found:?}");
}

#[test]
fn a_file_without_mistakes_has_none() {
    assert_eq!(found("none", TEMPLATE), []);
}

#[test]
fn what_follows_from_a_replacement_is_not_reported() {
    // With the template's 2 in the place of `c`, 8 is refused by a rule that names `c`; what is wrong beside is found.
    let found = found("replaced", r#"{ "a": -1.0, "b": { "c": -1, "d": 8 } }"#);
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found[0].1.starts_with("b.c: ") && found[1].1.starts_with("a = -1"), "{found:?}");
    // A check that refuses the template's own value is asked once.
    let path = file("endless", TEMPLATE);
    let refuse = |table: &Table| Err(SettingError::new("a", table.a, "never"));
    assert_eq!(problems(&path, template, refuse).list.len(), 1);
    fs::remove_file(path).unwrap();
}

#[test]
fn text_that_is_no_json_is_one_mistake_with_its_place() {
    let found = found("text", "{\n  \"a\": 1.0,,\n}");
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(found[0].0, Some((2, 12)), "{found:?}");
}

#[test]
fn a_file_that_is_not_there_is_named_by_its_text() {
    let problems = problems(Path::new("/nowhere/settings.json"), template, check);
    let [problem] = &*problems.list else { panic!("{problems}") };
    assert_eq!((problem.file.as_str(), problem.place), ("", None));
    assert!(problem.text.contains("/nowhere/settings.json"), "{problem}");
}

#[test]
fn one_mistake_is_a_line_and_more_are_counted() {
    let problem =
        |line| SettingProblem { file: "f".into(), place: Some((line, 2)), text: "t".into() };
    let one = Problems { list: vec![problem(1)] };
    assert_eq!(one.to_string(), "f:1:2: t");
    let two = Problems { list: vec![problem(1), SettingProblem { place: None, ..problem(3) }] };
    assert_eq!(two.to_string(), "2 mistakes\n  f:1:2: t\n  f: t");
}

#[test]
fn rows_of_a_trajectory_are_all_named_by_their_lines() {
    // Time runs backwards in line 5, with the header and an empty line; line 6 is short, line 7 holds a word.
    let csv = "t,x,y,z,theta\n0,0,0,1,0\n\n1,0.1,0,1,0\n0.5,0.2,0,1,0\n2,0.3\n3,0,up,1,0\n";
    let csv = file("points.csv", csv);
    let mission = |points: &str| format!("{{ \"trajectory\": {{ \"points\": {points} }} }}");
    let named = format!("{{ \"csv\": \"{}\" }}", csv.file_name().unwrap().to_str().unwrap());
    let path = file("mission.json", &mission(&named));
    let in_csv = mission_problems(&path);
    let rows = "{ \"rows\": [[1, 0, 0, 1, 0],\n[0, 0, 0, 1, 0],\n[1, 0, 0, 1, 0]] }";
    fs::write(&path, mission(rows)).unwrap();
    let in_rows = mission_problems(&path);
    fs::remove_file(&path).unwrap();
    fs::remove_file(&csv).unwrap();
    for (problems, file, places) in
        [(in_csv, &csv, &[(5, 1), (6, 1), (7, 5)][..]), (in_rows, &path, &[(2, 2), (3, 2)])]
    {
        let found: Vec<_> = problems.list.iter().filter_map(|problem| problem.place).collect();
        assert_eq!(found, places, "{problems}");
        let is_there = |problem: &SettingProblem| problem.file == file.display().to_string();
        assert!(problems.list.iter().all(is_there), "{problems}");
    }
}
