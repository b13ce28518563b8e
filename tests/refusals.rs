//! What a flight is refused for before it begins, and before a person is asked.

use std::fs;
use std::net::TcpListener;
use std::process::{Command, Output};

use crate::program;
use program::{config_file, folder, tello_ctl, text};

/// Output of a simulated flight under a limit of the shell.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn fly_under(limit: &str, name: &str) -> Output {
    let fly = format!("ulimit {limit}; exec \"$0\" fly --sim");
    Command::new("sh")
        .args(["-c", &fly, env!("CARGO_BIN_EXE_tello-ctl")])
        .current_dir(folder(name))
        .output()
        .unwrap()
}

#[test]
fn a_program_that_may_open_few_files_does_not_panic() {
    for handles in 6..=14 {
        let output = fly_under(&format!("-n {handles}"), "refusals-handles");
        assert_eq!(output.status.code(), Some(2), "{handles}: {}", text(&output));
    }
}

#[test]
fn a_limit_of_the_memory_is_named() {
    let output = fly_under("-v 500000", "refusals-memory");
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    assert!(text(&output).contains("ulimit -v"), "{}", text(&output));
}

#[test]
fn a_log_and_an_address_that_are_taken_are_refused_before_the_question() {
    let folder = folder("refusals-taken");
    let settings = fs::read_to_string(config_file("fly.json")).unwrap();
    let square = config_file("missions/square.json");
    let settings = settings.replace("192.168.10.1:8889", "127.0.0.1:1");
    fs::write(folder.join("fly.json"), settings.replace("missions/square.json", &square)).unwrap();
    fs::write(folder.join("there.mcap"), "").unwrap();
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    for (option, value) in
        [("--log", "there.mcap"), ("--log", "/proc/no/a.mcap"), ("--view", &*address)]
    {
        let output = tello_ctl(&folder, &["fly", "--config", "fly.json", "--yes", option, value]);
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        assert!(!text(&output).contains("pre-flight"), "{value}: {}", text(&output));
    }
}
