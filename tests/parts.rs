//! Batches and campaigns in parts: what is merged is what one process prints, or nothing.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::thread;
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use crate::program;
use program::{config_file, tello_ctl, text};

const PARTS: usize = 3;

fn folder(name: &str) -> PathBuf {
    program::folder(&format!("parts-{name}"))
}

/// Flies part `part` of `arguments` into a file of that number.
fn fly(folder: &Path, arguments: &[&str], part: usize) -> Output {
    let (shard, file) = (format!("{part}/{PARTS}"), format!("{part}.part"));
    tello_ctl(folder, &[&["sim"], arguments, &["--shard", &shard, "--part", &file]].concat())
}

fn fly_all(folder: &Path, arguments: &[&str]) {
    for part in 1..=PARTS {
        let output = fly(folder, arguments, part);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output));
        assert!(output.stdout.is_empty(), "{}", text(&output));
    }
}

/// Asserts that the merged parts print what one process prints, as text and as JSON.
fn assert_merges(folder: &Path, arguments: &[&str]) {
    fly_all(folder, arguments);
    for json in [&[][..], &["--json"]] {
        let whole = tello_ctl(folder, &[&["sim"], arguments, json].concat());
        let merged = tello_ctl(folder, &[&["merge", "3.part", "1.part", "2.part"], json].concat());
        assert!(!whole.stdout.is_empty(), "{}", text(&whole));
        assert_eq!(whole.stdout, merged.stdout, "{}", text(&merged));
        assert_eq!(whole.status.code(), merged.status.code());
    }
}

#[test]
fn parts_of_a_batch_merge_to_the_bytes_of_one_process() {
    assert_merges(&folder("batch"), &["--batch", "3", "--seed", "11"]);
}

#[test]
#[ignore = "24 flights: in .ci/run all"]
fn parts_of_a_comparison_merge_to_the_bytes_of_one_process() {
    let (folder, published) = (folder("against"), config_file("thesis/fly.json"));
    let slower = published.replace("fly.json", "as_flown.json");
    let arguments = ["--batch", "4", "--config", &published, "--against", &slower];
    assert_merges(&folder, &arguments);
}

#[test]
#[ignore = "12 flights: in .ci/run all"]
fn parts_of_a_campaign_merge_to_the_bytes_of_one_process() {
    assert_merges(&folder("campaign"), &["--batch", "4", "--campaign"]);
}

#[test]
fn a_part_that_is_there_is_not_flown_again_and_another_one_is_not_replaced() {
    let folder = folder("resume");
    let arguments = ["--batch", "3", "--campaign", "--family", "still"];
    fly_all(&folder, &arguments);
    let of = |folder: &Path| fs::read(folder.join("1.part")).unwrap();
    let modified = || fs::metadata(folder.join("1.part")).unwrap().modified().unwrap();
    let (bytes, at) = (of(&folder), modified());
    let again = fly(&folder, &arguments, 1);
    assert_eq!(again.status.code(), Some(0), "{}", text(&again));
    assert!(text(&again).contains("exists already"), "{}", text(&again));
    assert_eq!((of(&folder), modified()), (bytes.clone(), at));
    let other = fly(&folder, &["--batch", "3", "--campaign", "--family", "drift"], 1);
    assert_eq!(other.status.code(), Some(2), "{}", text(&other));
    assert_eq!(of(&folder), bytes);
}

#[test]
fn parts_that_are_not_a_whole_are_refused_and_nothing_is_printed() {
    let folder = folder("refused");
    let arguments = ["--batch", "3", "--campaign", "--family", "still"];
    fly_all(&folder, &arguments);
    let others = folder.join("other");
    fs::create_dir(&others).unwrap();
    fly_all(&others, &["--batch", "3", "--campaign", "--family", "still", "--profile", "bad_day"]);
    let whole = fs::read_to_string(folder.join("2.part")).unwrap();
    let put = |name: &str, text: &str| fs::write(folder.join(name), text).unwrap();
    put("torn.part", &whole[..whole.len() / 2]);
    put("cut.part", whole.trim_end());
    put("altered.part", &whole.replacen("\"excess_m\":0", "\"excess_m\":1", 1));
    put("no.part", "flights 3\n");
    for (parts, why) in [
        (&["1.part", "3.part"][..], "part 2 of 3 is missing"),
        (&["1.part", "2.part", "2.part", "3.part"], "part 2 occurs twice"),
        (&["1.part", "other/2.part", "3.part"], "another hash of the settings"),
        (&["1.part", "torn.part", "3.part"], "torn"),
        (&["1.part", "cut.part", "3.part"], "torn"),
        (&["1.part", "altered.part", "3.part"], "altered"),
        (&["1.part", "no.part", "3.part"], "not a part file"),
        (&["1.part", "2.part", "gone.part"], "cannot read"),
    ] {
        let output = tello_ctl(&folder, &[&["merge"], parts].concat());
        assert_eq!(output.status.code(), Some(2), "{parts:?}: {}", text(&output));
        assert!(output.stdout.is_empty(), "{parts:?}");
        assert!(text(&output).contains(why), "{parts:?}: {}", text(&output));
    }
}

/// `merge --watch` of the folder `watched`, running.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn watch(folder: &Path) -> Child {
    fs::create_dir_all(folder.join("watched")).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_tello-ctl"));
    command.args(["merge", "--watch", "watched"]).current_dir(folder);
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Lets a part arrive as the program does: whole.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn arrive(folder: &Path, name: &str) {
    let into = folder.join("watched");
    let hidden = into.join(format!(".{name}.1.part"));
    fs::copy(folder.join(name), &hidden).unwrap();
    fs::rename(hidden, into.join(name)).unwrap();
}

#[test]
fn a_watch_merges_parts_that_arrive_late() {
    let folder = folder("watch");
    fly_all(&folder, &["--batch", "7", "--campaign", "--family", "still"]);
    let mut watching = watch(&folder);
    // What is being written is no part.
    fs::write(folder.join("watched/.2.part.1.part"), "torn").unwrap();
    for part in ["2.part", "3.part"] {
        thread::sleep(Duration::from_millis(700));
        arrive(&folder, part);
    }
    thread::sleep(Duration::from_millis(700));
    assert!(watching.try_wait().unwrap().is_none(), "it did not wait for the last part");
    arrive(&folder, "1.part");
    let watched = watching.wait_with_output().unwrap();
    let merged = tello_ctl(&folder, &["merge", "1.part", "2.part", "3.part"]);
    assert!(!merged.stdout.is_empty(), "{}", text(&merged));
    assert_eq!(watched.stdout, merged.stdout, "{}", text(&watched));
    assert_eq!(watched.status.code(), merged.status.code());
    let progress = String::from_utf8(watched.stderr).unwrap();
    let lines: Vec<&str> = progress.lines().collect();
    let starts =
        ["parts 1/3, flights 2/7, ", "parts 2/3, flights 5/7, ", "parts 3/3, flights 7/7, "];
    assert_eq!(lines.len(), starts.len(), "{progress}");
    for (line, start) in lines.iter().zip(starts) {
        assert!(
            line.starts_with(start) && line.contains("/s, ") && line.ends_with(" s left"),
            "{line}"
        );
    }
}

#[test]
fn a_watch_ends_on_ctrl_c_and_refuses_parts_of_another_whole() {
    let folder = folder("watch-ends");
    fly_all(&folder, &["--batch", "3", "--campaign", "--family", "still"]);
    let watching = watch(&folder);
    arrive(&folder, "1.part");
    thread::sleep(Duration::from_millis(700));
    kill(Pid::from_raw(watching.id().try_into().unwrap()), Signal::SIGINT).unwrap();
    let output = watching.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    assert!(output.stdout.is_empty());
    let whole = fs::read(folder.join("2.part")).unwrap();
    fs::write(folder.join("4.part"), &whole[..whole.len() / 2]).unwrap();
    fs::copy(folder.join("1.part"), folder.join("5.part")).unwrap();
    for (part, why) in [("4.part", "torn"), ("5.part", "part 1 occurs twice")] {
        let watching = watch(&folder);
        arrive(&folder, part);
        let output = watching.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        assert!(output.stdout.is_empty() && text(&output).contains(why), "{}", text(&output));
        fs::remove_file(folder.join("watched").join(part)).unwrap();
    }
}
