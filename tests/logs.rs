//! Logs in the hands of others: `tello-ctl log`, the recipes of `docs/logs.md`, the messages of Foxglove.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use tello_eval::flight_log::{self, TickRecord};
use tello_eval::scene::{self, Scene};
use tello_flight::Start;
use tello_flight::cycle::{Timing, Topic};
use tello_io::clock::Clock;
use tello_io::config;
use tello_io::log::LogReader;
use tello_sim::virtual_time::VirtualFlight;

use crate::program;
use program::{folder, tello_ctl, text};

/// Ticks of the flight: take-off, and half of the square.
const TICKS: u64 = 500;

/// A flight in virtual time from the ground, as `fly` writes it, or without its scene.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn flight(folder: &Path, name: &str, has_scene: bool) -> PathBuf {
    let path = folder.join(name);
    let (fly, mission) = config::fly(None, None).unwrap();
    let flight = config::flight(&fly, mission, Start::Grounded);
    let started_unix_ns = 1_700_000_000_123_456_789;
    let mut virtual_flight =
        VirtualFlight::new(&flight, &tello_sim::settings(None).unwrap(), 2).unwrap();
    let shape = virtual_flight.new_outcome();
    let mut log = flight_log::create(&path, &flight, started_unix_ns, &shape).unwrap();
    let mut scene = Scene::new(&flight, started_unix_ns).unwrap();
    for step in 0..TICKS {
        let out = virtual_flight.tick().unwrap().clone();
        let inbox = virtual_flight.inbox().clone();
        let tick = TickRecord { inbox, out, timing: Timing { step, ..Timing::default() } };
        flight_log::write_tick(&mut log, &tick).unwrap();
        if has_scene {
            scene.write(&mut log, &tick).unwrap();
        }
        if step % 50 == 49 {
            log.flush().unwrap();
        }
    }
    log.finish().unwrap();
    path
}

/// A Python that can import `packages`, if there is one.
fn python(packages: &str) -> Option<OsString> {
    let python = std::env::var_os("TELLO_PYTHON").unwrap_or_else(|| "python3".into());
    let imports = Command::new(&python).args(["-c", &format!("import {packages}")]).output();
    if imports.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    assert!(std::env::var_os("CI").is_none(), "no Python with {packages} in CI");
    eprintln!("NOT CHECKED: no Python with {packages}; set TELLO_PYTHON to one that has them");
    None
}

/// A file of the repository.
fn file(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)
}

#[test]
fn info_names_channels_and_the_tear_and_recover_mends_it() {
    let folder = folder("logs-recover");
    let path = flight(&folder, "whole.mcap", true);
    let info = |name: &str, code: i32| -> Value {
        let output = tello_ctl(&folder, &["log", "info", name, "--json"]);
        assert_eq!(output.status.code(), Some(code), "{}", text(&output));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let whole = info("whole.mcap", 0);
    assert_eq!(whole["channels"]["/cycle/inbox"], TICKS, "{whole}");
    assert_eq!(whole["documents"], serde_json::json!(["config.json"]), "{whole}");
    assert!((whole["lasts_s"].as_f64().unwrap() - 9.98).abs() < 0.02, "{whole}");

    let bytes = fs::read(&path).unwrap();
    let mut tears = Vec::new();
    for percent in [60, 65, 70, 75, 80] {
        fs::write(folder.join("torn.mcap"), &bytes[..bytes.len() * percent / 100]).unwrap();
        let torn = info("torn.mcap", 1);
        let mended_name = format!("mended-{percent}.mcap");
        let output = tello_ctl(&folder, &["log", "recover", "torn.mcap", "-o", &mended_name]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output));
        let mended = info(&mended_name, 0);
        for key in ["channels", "messages", "started_unix_ns", "version", "documents"] {
            assert_eq!(mended[key], torn[key], "{key}");
        }
        assert!(mended["messages"].as_u64() > Some(3000), "{mended}");
        // What is there is repeated bit by bit.
        let replayed = tello_ctl(&folder, &["replay", &mended_name, "--json"]);
        let report: Value = serde_json::from_slice(&replayed.stdout).unwrap();
        let channels = report["channels"].as_object().unwrap();
        assert!(channels.len() > 10, "{}", text(&replayed));
        assert!(channels.values().all(|one| one["different"] == 0), "{}", text(&replayed));
        tears.push(report["torn"].clone());
    }
    // Where a chunk ends is the writer's choice: most tears fall into a tick, one may fall between two.
    assert!(tears.iter().any(|torn| torn == "cut within its last tick"), "{tears:?}");

    let again = tello_ctl(&folder, &["log", "recover", "torn.mcap", "-o", "mended-80.mcap"]);
    assert_eq!(again.status.code(), Some(2), "{}", text(&again));
    let info = text(&tello_ctl(&folder, &["log", "info", "mended-80.mcap"]));
    let started = info.lines().find_map(|line| line.strip_prefix("started    ")).unwrap();
    assert!(started.starts_with("20") && started.ends_with(" UTC"), "date and time: {started}");
    let missing = text(&tello_ctl(&folder, &["log", "info", "missing.mcap"]));
    assert_eq!(missing.matches("os error 2").count(), 1, "{missing}");
    fs::write(folder.join("other.txt"), "no log").unwrap();
    let other = tello_ctl(&folder, &["log", "info", "other.txt"]);
    assert!(
        other.status.code() == Some(2) && text(&other).contains("not a log"),
        "{}",
        text(&other)
    );
}

/// A chunk without a checksum that unpacks to 4 GB of records without a meaning, if it is let.
fn bomb() -> Vec<u8> {
    const UNPACKED: u64 = 4 << 30;
    const BLOCK: u32 = 128 * 1024;
    // A frame of zstd: magic, no length, a window of 2 MB, then blocks of one repeated byte.
    let mut packed = vec![0x28, 0xb5, 0x2f, 0xfd, 0x00, 0x58];
    let blocks = UNPACKED / u64::from(BLOCK);
    for number in 0..blocks {
        let is_last = u32::from(number + 1 == blocks);
        let head = (BLOCK << 3) | (1 << 1) | is_last;
        packed.extend(&head.to_le_bytes()[..3]);
        packed.push(0);
    }
    let mut chunk = vec![0x06];
    chunk.extend((8 + 8 + 8 + 4 + 4 + 4 + 8 + packed.len() as u64).to_le_bytes());
    chunk.extend([0; 16]);
    chunk.extend(UNPACKED.to_le_bytes());
    chunk.extend([0; 4]);
    chunk.extend(4_u32.to_le_bytes());
    chunk.extend(b"zstd");
    chunk.extend((packed.len() as u64).to_le_bytes());
    chunk.extend(packed);
    chunk
}

#[test]
fn a_chunk_of_four_gigabytes_is_named_by_every_command_and_never_unpacked() {
    let folder = folder("logs-bomb");
    let mut bytes = fs::read(flight(&folder, "whole.mcap", false)).unwrap();
    // In place of the end of the data section and of all behind it.
    bytes.truncate(bytes.len() * 6 / 10);
    fs::write(folder.join("torn.mcap"), &bytes).unwrap();
    let output = tello_ctl(&folder, &["log", "recover", "torn.mcap", "-o", "half.mcap"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let mut bytes = fs::read(folder.join("half.mcap")).unwrap();
    let data_end = bytes.windows(9).rposition(|head| head == [0x0f, 4, 0, 0, 0, 0, 0, 0, 0]);
    let at = data_end.unwrap();
    bytes.splice(at.., bomb());
    fs::write(folder.join("bomb.mcap"), &bytes).unwrap();

    let began = Clock::start();
    let why = format!("the chunk at byte {at} would unpack to 4294967296 bytes");
    for (arguments, code, names_it) in [
        (&["log", "info", "bomb.mcap"][..], 1, true),
        (&["replay", "bomb.mcap"], 1, true),
        (&["log", "recover", "bomb.mcap", "-o", "mended.mcap"], 0, false),
        (&["log", "csv", "bomb.mcap", "--out-dir", "tables"], 1, true),
    ] {
        let output = tello_ctl(&folder, arguments);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {}", text(&output));
        assert_eq!(text(&output).contains(&why), names_it, "{arguments:?}: {}", text(&output));
    }
    // What they make of half a flight is theirs; they do not unpack it.
    for arguments in [
        &["report", "bomb.mcap", "--json"][..],
        &["convert", "bomb.mcap", "-o", "c.csv"],
        &["ident", "bomb.mcap", "-o", "ident"],
    ] {
        tello_ctl(&folder, arguments);
    }
    // Unpacked, it takes minutes.
    assert!(began.now().seconds() < 30.0, "{} s", began.now().seconds());
    let mended = tello_ctl(&folder, &["log", "info", "mended.mcap"]);
    assert_eq!(mended.status.code(), Some(0), "{}", text(&mended));
}

#[test]
fn a_table_has_every_message_of_its_channel() {
    let folder = folder("logs-csv");
    flight(&folder, "flight.mcap", true);
    let output = tello_ctl(&folder, &["log", "csv", "flight.mcap", "--out-dir", "tables"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let table = fs::read_to_string(folder.join("tables/tello_command.csv")).unwrap();
    let mut lines = table.lines();
    assert_eq!(lines.next(), Some("t_s,pitch,roll,step,throttle,yaw"));
    assert_eq!(lines.clone().count() as u64, TICKS);
    let cells: Vec<f64> =
        lines.next().unwrap().split(',').map(|cell| cell.parse().unwrap()).collect();
    assert_eq!(cells.len(), 6, "{cells:?}");
    for topic in [Topic::Inbox, Topic::State, Topic::Phase] {
        let name = topic.name().trim_start_matches('/').replace('/', "_");
        assert!(folder.join(format!("tables/{name}.csv")).exists(), "{name}");
    }
    let output = tello_ctl(
        &folder,
        &["log", "csv", "flight.mcap", "--out-dir", "one", "--topic", "/no/channel"],
    );
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
}

#[test]
fn the_scene_is_a_small_part_of_the_log_and_the_layout_shows_channels_that_exist() {
    let folder = folder("logs-scene");
    let [with, without] = [("with.mcap", true), ("without.mcap", false)]
        .map(|(name, has_scene)| fs::metadata(flight(&folder, name, has_scene)).unwrap().len());
    let fraction = (with - without) as f64 / with as f64;
    assert!(fraction < 0.4, "the scene is {fraction:.2} of {with} bytes");
    println!("the scene is {fraction:.2} of {with} bytes");

    let layout = fs::read_to_string(file("configs/viewers/foxglove.json")).unwrap();
    let layout: Value = serde_json::from_str(&layout).unwrap();
    let mut named = Vec::new();
    for (panel, settings) in layout["configById"].as_object().unwrap() {
        for path in settings["paths"].as_array().into_iter().flatten() {
            named.push(path["value"].as_str().unwrap().split('.').next().unwrap().to_owned());
        }
        named.extend(
            settings["topics"].as_object().into_iter().flat_map(|topics| topics.keys().cloned()),
        );
        named.extend(settings["topicToRender"].as_str().map(str::to_owned));
        assert!(layout["layout"].to_string().contains(panel.as_str()), "{panel} is not shown");
    }
    assert!(named.len() > 10, "{named:?}");
    let known: Vec<&str> =
        Topic::ALL.iter().copied().map(Topic::name).chain(scene::topics()).collect();
    for topic in named {
        assert!(known.contains(&topic.as_str()), "{topic} is no channel");
    }
}

#[test]
fn programs_of_others_read_the_poses_of_a_log_and_of_its_ros_2_messages() {
    let Some(python) =
        python("foxglove.datasets, foxglove_schemas_protobuf, mcap_protobuf, mcap_ros2, rosbags")
    else {
        return;
    };
    let folder = folder("logs-foxglove");
    let path = flight(&folder, "flight.mcap", true);
    let output = tello_ctl(&folder, &["log", "ros2", "flight.mcap", "-o", "bag.mcap"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let output = Command::new(python)
        .arg(file("tests/logs_foxglove.py"))
        .args([&path, &folder.join("bag.mcap")])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", text(&output));
    println!("{}", text(&output));
}

#[test]
fn every_recipe_of_the_documentation_runs() {
    let Some(python) = python("mcap, pandas") else { return };
    let folder = folder("logs-recipes");
    let path = flight(&folder, "flight.mcap", true);
    let tables = tello_ctl(&folder, &["log", "csv", "flight.mcap", "--out-dir", "tables"]);
    assert_eq!(tables.status.code(), Some(0), "{}", text(&tables));
    let documentation = fs::read_to_string(file("docs/logs.md")).unwrap();
    let recipes: Vec<&str> = documentation
        .split("```python\n")
        .skip(1)
        .filter_map(|rest| rest.split("```").next())
        .collect();
    assert!(recipes.len() >= 3, "{} recipes", recipes.len());
    for recipe in recipes {
        let output = Command::new(&python)
            .args(["-W", "error", "-c", recipe])
            .arg(&path)
            .current_dir(&folder)
            .output()
            .unwrap();
        assert!(output.status.success(), "{recipe}\n{}", text(&output));
        assert!(!output.stdout.is_empty(), "{recipe}\nprints nothing");
    }
    // The documentation names each channel that there is.
    let log = LogReader::open(&path).unwrap();
    assert!(log.head().documents.contains_key("config.json"));
    for topic in scene::topics() {
        assert!(documentation.contains(topic), "{topic} is not in docs/logs.md");
    }
}
