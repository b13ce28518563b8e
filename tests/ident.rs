//! `tello-ctl ident` as its users meet it: the documented commands, bad logs, shards, the thesis' table.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use serde_json::Value;
use sha2::{Digest, Sha256};
use tello_io::log::csv::CsvRow;
use tello_sim::plant::{NOMINAL, PlantParams};
use tello_sim::{ManualFlight, MocapReport, Profile};

use crate::program;
use crate::support;
use program::{json, tello_ctl, text};

/// A fresh folder of a test.
fn folder(name: &str) -> PathBuf {
    program::folder(&format!("ident-{name}"))
}

/// A file of the repository.
fn file(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(name).display().to_string()
}

/// A simulated manual flight as a CSV log.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn log(path: &Path, seed: u64, steps: usize) {
    let params = PlantParams::try_from(NOMINAL).unwrap();
    let flight = ManualFlight::fly(&params, Profile::GoodDay, seed, steps).unwrap();
    let mut text = Vec::new();
    for (step, (u, report)) in flight.u_sent.iter().zip(&flight.reports).enumerate() {
        let pos = if let MocapReport::Pose(pose) = report { Some(*pose) } else { None };
        let row = CsvRow { step: step as u64, pos, input: Some(*u), ..CsvRow::default() };
        row.write(&mut text, 6).unwrap();
    }
    fs::write(path, text).unwrap();
}

/// Commands of the block `block` of the section `Identify` of `docs/commands.md`.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn commands(block: usize) -> Vec<Vec<String>> {
    let page = fs::read_to_string(file("docs/commands.md")).unwrap();
    let section = page.split("## Identify").nth(1).unwrap().split("\n## ").next().unwrap();
    let block = section.split("```sh\n").nth(1 + block).unwrap().split("```").next().unwrap();
    let lines = block.lines().filter_map(|line| line.strip_prefix("tello-ctl "));
    let words = |line: &str| -> Vec<String> {
        let command = line.split('#').next().unwrap_or_default();
        command.split_whitespace().map(str::to_owned).collect()
    };
    lines.map(words).collect()
}

/// Runs a documented command in `folder`, with the repository's files and `data` in the place of its
/// folders of logs.
fn run(folder: &Path, command: &[String], data: &[(&str, &str)]) -> Output {
    let replaced = |word: &String| match data.iter().find(|(name, _)| name == word) {
        Some((_, path)) => (*path).to_owned(),
        None if word.starts_with("configs/") => file(word),
        None => word.clone(),
    };
    let words: Vec<String> = command.iter().map(replaced).collect();
    let output = tello_ctl(folder, &words.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(output.status.code(), Some(0), "{words:?}: {}", text(&output));
    output
}

#[test]
fn the_documented_commands_run_one_after_the_other() {
    let folder = folder("documented");
    let commands = commands(0);
    assert!(commands.len() >= 5, "{commands:?}");
    for command in commands {
        run(&folder, &command, &[]);
    }
    for name in ["fit", "delay", "delay_shift", "bootstrap", "residuals_observations"] {
        for ending in ["svg", "png"] {
            let path = folder.join(format!("ident/figures/{name}.{ending}"));
            assert!(path.exists(), "no {}", path.display());
        }
    }
}

#[test]
fn the_thesis_logs_tell_its_story() {
    let (Some(pieces), Some(flights)) =
        (support::data("thesis/pieces"), support::data("thesis/ident/filt"))
    else {
        return;
    };
    let (pieces, flights) = (pieces.display().to_string(), flights.display().to_string());
    let data = [("pieces/", pieces.as_str()), ("flights/", flights.as_str())];
    let folder = folder("thesis");
    let commands = commands(1);
    let mut story = commands[0].clone();
    story.push("--json".into());
    let report = json(&run(&folder, &story, &data));
    let numbers = |value: &Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|entry| entry.as_f64().unwrap()).collect()
    };
    let close = |got: &[f64], expected: [f64; 4], tolerance: f64| {
        assert!(got.iter().zip(expected).all(|(a, b)| (a - b).abs() <= tolerance), "{got:?}");
    };
    // Table 5.1 to the digits between its early stop and the minimum.
    close(&numbers(&report["p"]), [1.0658, 0.4471, 0.9569, -0.1742], 0.005);
    assert!(report["cost"].as_f64().unwrap() <= 2323.1, "{}", report["cost"]);
    // Ceres at 1e-14; its default tolerance stops at theta_0 = 0.03271 with a higher cost.
    let equation = &report["against"][0];
    close(&numbers(&equation["p"]), [1.294_080, 0.444_741, 0.994_382, 0.033_083], 1e-5);
    let cost = equation["cost"].as_f64().unwrap();
    assert!((cost / 1_083.955_45 - 1.0).abs() < 1e-7, "{cost}");
    assert_eq!(report["files_used"].as_array().unwrap().len(), 89);
}

#[test]
fn the_documented_comparison_finds_the_model_that_flew() {
    let folder = folder("compare");
    fs::create_dir_all(folder.join("logs")).unwrap();
    for seed in 0..2 {
        log(&folder.join(format!("logs/{seed}.log")), seed, 700);
    }
    let mut command = commands(1)[1].clone();
    command.push("--json".into());
    let report = json(&run(&folder, &command, &[("flights/", "logs")]));
    let model = |at: usize| report["comparison"]["models"][at]["name"].as_str().map(str::to_owned);
    assert_eq!(model(0).as_deref(), Some("built-in"), "{}", report["comparison"]);
}

#[test]
fn bad_logs_are_named_and_the_rest_is_used() {
    let folder = folder("bad");
    let logs = folder.join("logs");
    fs::create_dir_all(&logs).unwrap();
    for (name, seed) in [("good1.log", 1), ("good2.log", 2), ("torn.log", 3), ("nan.log", 4)] {
        log(&logs.join(name), seed, 1500);
    }
    let torn = fs::read(logs.join("torn.log")).unwrap();
    fs::write(logs.join("torn.log"), &torn[..torn.len() / 2 + 7]).unwrap();
    fs::write(logs.join("empty.log"), "").unwrap();
    let text_of = |name: &str| fs::read_to_string(logs.join(name)).unwrap();
    let nan: String = text_of("nan.log")
        .lines()
        .enumerate()
        .map(|(i, line)| match line.rsplit_once(',') {
            Some((start, _)) if i % 50 == 0 => format!("{start},NaN\n"),
            _ => format!("{line}\n"),
        })
        .collect();
    fs::write(logs.join("nan.log"), nan).unwrap();
    let still: String = text_of("good1.log")
        .lines()
        .map(|line| match line.split(',').collect::<Vec<_>>()[..] {
            ["input", step, ..] => format!("input,{step},0.1,0.1,0,0\n"),
            _ => format!("{line}\n"),
        })
        .collect();
    fs::write(logs.join("constant.log"), still).unwrap();

    let config = file("configs/ident_kinematic.json");
    let output = tello_ctl(&folder, &["ident", "logs", "--config", &config, "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let report = json(&output);
    let named = |list: &str, name: &str| -> Option<String> {
        let entries = report[list].as_array().unwrap();
        let entry = entries.iter().find(|entry| entry["path"].as_str().unwrap().ends_with(name))?;
        Some(format!("{} {}", entry["why"], entry["skipped"]))
    };
    for (name, word) in [("empty.log", "empty"), ("constant.log", "constant")] {
        let why = named("files_skipped", name).unwrap_or_default();
        assert!(why.contains(word), "{name}: {why}");
    }
    for name in ["torn.log", "nan.log"] {
        let skipped = named("files_used", name).unwrap_or_default();
        assert!(skipped.contains("line"), "{name}: {skipped}");
    }
    assert_eq!(report["files_used"].as_array().unwrap().len(), 4);

    for name in ["good1.log", "good2.log", "torn.log", "nan.log"] {
        fs::remove_file(logs.join(name)).unwrap();
    }
    let output = tello_ctl(&folder, &["ident", "logs", "--config", &config]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    assert!(text(&output).contains("no log can be used"), "{}", text(&output));
    let output = tello_ctl(&folder, &["ident"]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
}

#[test]
fn a_file_that_cannot_be_judged_by_is_named_and_the_rest_is_used() {
    let folder = folder("judge");
    fs::create_dir_all(folder.join("judge")).unwrap();
    log(&folder.join("1.log"), 1, 900);
    log(&folder.join("judge/2.log"), 2, 900);
    fs::write(folder.join("judge/empty.log"), "").unwrap();
    let config = file("configs/ident_kinematic.json");
    let arguments =
        ["ident", "1.log", "--config", &config, "--compare", "--judge", "judge", "--json"];
    let output = tello_ctl(&folder, &arguments);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let report = json(&output);
    let skipped = report["files_skipped"][0]["path"].as_str().unwrap();
    assert!(skipped.ends_with("empty.log"), "{skipped}");
    assert_eq!(report["comparison"]["folds"], 0);
    fs::remove_file(folder.join("judge/2.log")).unwrap();
    let output = tello_ctl(&folder, &arguments);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
}

#[test]
fn parameters_from_logs_of_automatic_flights_lie_in_their_intervals_and_fly_as_well() {
    let folder = folder("automatic");
    let arguments = ["ident", "--self-test", "--automatic", "--runs", "20", "--json"];
    let output = tello_ctl(&folder, &arguments);
    let test = json(&output);
    assert_eq!((&test["runs"], &test["refused"]), (&20.into(), &0.into()), "{test}");
    // All of them: a square says little of yaw and climb, and the prior is wider than the spread of the vehicles.
    assert!(test["coverage"].as_f64().unwrap() >= 0.9, "{test}");
    let [before, after] = [0, 1].map(|at: usize| &test["flown"][at]);
    assert_eq!(after["finished"], 20, "{test}");
    let distance_m = |flown: &Value| flown["distance_p95_m"].as_f64().unwrap();
    assert!(distance_m(after) <= 1.1 * distance_m(before), "{test}");
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
}

#[test]
fn parameters_that_fly_refuses_are_not_written() {
    let folder = folder("refused");
    log(&folder.join("1.log"), 1, 1500);
    let identify = |flight: &str| {
        let arguments = ["ident", "1.log", "--out", "out", "--flight", flight, "--json"];
        let output = tello_ctl(&folder, &arguments);
        (output.status.code(), json(&output))
    };
    let built_in = file("configs/fly.json");
    let (code, report) = identify(&built_in);
    assert_eq!((code, &report["refused"]), (Some(0), &Value::Null), "{report}");
    let parameters = folder.join("out/parameters.json");
    let output = tello_ctl(&folder, &["check", "out/parameters.json"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    // The same flight with bounds that end below the gain.
    let mut narrow: Value = serde_json::from_str(&fs::read_to_string(&built_in).unwrap()).unwrap();
    narrow["mission"] = file("configs/missions/square.json").into();
    narrow["cycle"]["mhe"]["p_ub"][0] = 1.2.into();
    narrow["cycle"]["mhe"]["p_prior"][0] = 1.1.into();
    fs::write(folder.join("narrow.json"), narrow.to_string()).unwrap();
    let (code, report) = identify("narrow.json");
    let why = report["refused"].as_str().unwrap_or_default();
    assert!(code == Some(1) && why.contains("lambda_h"), "{why}");
    assert!(!parameters.exists(), "the file of the run before");
}

const BOOTSTRAP: [&str; 7] = ["ident", "0.log", "1.log", "2.log", "3.log", "--bootstrap", "20"];

/// A bootstrap of four logs, with further arguments.
fn bootstrap(folder: &Path, more: &[&str]) -> Output {
    let config = file("configs/thesis/ident.json");
    tello_ctl(folder, &[&BOOTSTRAP[..], &["--config", &config, "--seed", "7"], more].concat())
}

/// A folder with four logs, and the three parts of their bootstrap.
fn bootstrap_parts(name: &str) -> PathBuf {
    let folder = folder(name);
    for seed in 0..4 {
        log(&folder.join(format!("{seed}.log")), seed, 1300);
    }
    for (shard, threads) in [("1/3", "1"), ("2/3", "2"), ("3/3", "0")] {
        let more = ["--out", "parts", "--shard", shard, "--threads", threads, "--json"];
        let output = bootstrap(&folder, &more);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    }
    folder
}

/// File of part `part` of [`bootstrap_parts`].
fn part(part: u8) -> String {
    format!("parts/bootstrap-{part}-of-3.part")
}

#[test]
fn shards_merge_to_the_whole_bootstrap() {
    let folder = bootstrap_parts("shards");
    let done = |output: &Output| assert_eq!(output.status.code(), Some(0), "{}", text(output));
    done(&bootstrap(&folder, &["--out", "whole", "--json"]));
    let whole = fs::read(folder.join("whole/bootstrap.json")).unwrap();
    let parts = [part(2), part(1), part(3)];
    let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
    let merged = tello_ctl(&folder, &[&["merge", "--json"], &parts[..]].concat());
    done(&merged);
    assert!(merged.stdout == whole, "{}", text(&merged));
    let table = tello_ctl(&folder, &[&["merge"], &parts[..]].concat());
    assert!(text(&table).contains("20 resamples, 0 not converged, seed 7"), "{}", text(&table));
    // The merged file and the parts continue an identification alike.
    fs::write(folder.join("merged.json"), merged.stdout).unwrap();
    for (out, resume) in [("a", vec!["merged.json"]), ("b", parts)] {
        done(&bootstrap(&folder, &[&["--out", out, "--json", "--resume"], &resume[..]].concat()));
        assert_eq!(fs::read(folder.join(out).join("bootstrap.json")).unwrap(), whole);
    }
    // A part that is there is not done again.
    let modified = || fs::metadata(folder.join(part(1))).unwrap().modified().unwrap();
    let at = modified();
    done(&bootstrap(&folder, &["--out", "parts", "--shard", "1/3", "--json"]));
    assert_eq!(modified(), at);
}

#[test]
fn parts_of_a_bootstrap_that_are_not_a_whole_are_refused() {
    let folder = bootstrap_parts("refused-parts");
    let config = file("configs/thesis/ident.json");
    let foreign = ["ident", "0.log", "--config", &config, "--bootstrap", "20", "--seed", "7"];
    let into = |name: &str| -> Output {
        tello_ctl(&folder, &[&foreign[..], &["--shard", "2/3", "--part", name]].concat())
    };
    assert_eq!(into("foreign.part").status.code(), Some(0));
    let name = |part: u8| folder.join(self::part(part));
    let second = fs::read_to_string(name(2)).unwrap();
    let put = |name: &str, text: &str| fs::write(folder.join(name), text).unwrap();
    put("torn.part", &second[..second.len() / 2]);
    put("altered.part", &second.replacen("\"index\":7", "\"index\":8", 1));
    let other = second.replacen("\"revision\":\"", "\"revision\":\"0", 1);
    let (body, _) = other.trim_end().rsplit_once('\n').unwrap();
    let sum = Sha256::digest(format!("{body}\n"));
    put("revision.part", &format!("{body}\n{{\"sha256\":\"{sum:x}\"}}\n"));
    let [first, second, third] = [1, 2, 3].map(part);
    let expect = |parts: &[&str], why: &str| {
        let output = tello_ctl(&folder, &[&["merge", "--json"], parts].concat());
        assert_eq!(output.status.code(), Some(2), "{parts:?}: {}", text(&output));
        assert!(output.stdout.is_empty(), "{parts:?}");
        assert!(text(&output).contains(why), "{parts:?}: {}", text(&output));
    };
    expect(&[&first, &third], "part 2 of 3 is missing");
    expect(&[&first, &second, &second, &third], "part 2 occurs twice");
    expect(&[&first, "foreign.part", &third], "another hash of the settings");
    expect(&[&first, "torn.part", &third], "torn");
    expect(&[&first, "altered.part", &third], "altered");
    expect(&[&first, "revision.part", &third], "another revision of the program");
    // Neither is a part of other logs replaced or taken over.
    let bytes = fs::read(name(2)).unwrap();
    let output = into(&second);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    assert_eq!(fs::read(name(2)).unwrap(), bytes);
    let output = tello_ctl(&folder, &[&foreign[..], &["--resume", &second]].concat());
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    assert!(text(&output).contains("another identification"), "{}", text(&output));
}
