//! Signals, a second program for the same drone, and readers that do not read.

use std::io::{PipeWriter, Write};
use std::net::UdpSocket;
use std::os::fd::{AsFd, OwnedFd};

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

use super::*;
use crate::program::{config_file, folder};

/// Signals that come from people, terminals, timers and limits, and two of those for real time.
const SIGNALS: [&str; 21] = [
    "HUP", "INT", "QUIT", "ABRT", "USR1", "USR2", "ALRM", "TERM", "STKFLT", "TSTP", "TTIN", "TTOU",
    "XCPU", "VTALRM", "PROF", "IO", "PWR", "SYS", "34", "50", "64",
];

/// A privileged port: nothing listens there and no other test is given it.
const NOBODY: &str = "127.0.0.1:1";

#[test]
fn each_signal_that_stops_kills_or_freezes_other_programs_ends_this_one_in_order() {
    // On the ground, where it waits for a room without anybody in it.
    let waiting = SIGNALS.map(|name| {
        let folder = folder(&format!("orders-{name}"));
        // Held to the end of the test: each program has a drone of its own.
        let drone = UdpSocket::bind("127.0.0.1:0").unwrap();
        let text = fs::read_to_string(config_file("fly.json")).unwrap();
        let mut table: Value = serde_json::from_str(&text).unwrap();
        table["mission"] = config_file("missions/square.json").into();
        table["mocap"]["relay"]["address"] = NOBODY.into();
        table["tello"]["address"] = drone.local_addr().unwrap().to_string().into();
        fs::write(folder.join("fly.json"), table.to_string()).unwrap();
        let child = fly(&folder, &["--dry-run"]).stderr(Stdio::piped()).spawn().unwrap();
        (name, folder, drone, child)
    });
    sleep(Duration::from_secs(5));
    for (name, .., child) in &waiting {
        let is_sent = Command::new("kill").args(["-s", name, &child.id().to_string()]).status();
        assert!(is_sent.unwrap().success(), "{name}");
    }
    let clock = Clock::start();
    for (name, folder, _drone, child) in waiting {
        let output = child.wait_with_output().unwrap();
        // 10 s after its start it would end by itself, with 2.
        assert!(clock.now().seconds() < 4.0, "{name}: {output:?}");
        assert_eq!(output.status.code(), Some(1), "{name}: {output:?}");
        assert_is_complete(&folder);
    }
}

#[test]
fn signals_in_flight_land_the_drone() {
    let benches =
        ["-TSTP", "-QUIT", "-35"].map(|name| (name, Fixture::start(&format!("orders{name}"), &[])));
    for (name, bench) in &benches {
        bench.wait_for(DronePhase::Flying, 30.0);
        sleep(Duration::from_secs(1));
        let pid = bench.child.id().to_string();
        let ordered_at = bench.drone_proxy.clock.now();
        assert!(Command::new("kill").args([name, &*pid]).status().unwrap().success());
        bench.wait_for(DronePhase::Landing(Cause::Order), 2.0);
        assert!(bench.drone_proxy.landing_s(ordered_at).unwrap() < 0.5, "{name}");
    }
    for (_, bench) in benches {
        bench.assert_ends_on_the_ground();
    }
}

#[test]
fn a_log_that_reaches_the_limit_of_a_file_ends_alone() {
    let limit = Some(("prlimit", "--fsize=150000"));
    let folder = folder("faults-limit-errors");
    let (errors, summary) = (folder.join(ERRORS), folder.join("summary.json"));
    let [errors, out] = [&errors, &summary].map(|path| Stdio::from(File::create(path).unwrap()));
    let mut bench = Fixture::start_with("limit", limit, &["--json"], out, errors);
    bench.wait_until_it_flies();
    assert!(fs::metadata(bench.folder.join("flight.mcap")).unwrap().len() == 150_000);
    assert!(bench.drone_proxy.is_steered());
    // To the end of its mission: the summary is that of a flight with a log, the exit code says that there is none.
    bench.wait_for(DronePhase::Grounded, 90.0);
    assert_eq!(bench.child.wait().unwrap().code(), Some(1), "{}", bench.errors());
    assert!(bench.errors().contains("the log is incomplete: cannot write to flight.mcap"));
    let summary: Value = serde_json::from_str(&fs::read_to_string(summary).unwrap()).unwrap();
    assert_eq!(summary["phase"], "landed", "{summary}");
    assert_eq!(summary["targets_reached"], summary["targets_count"], "{summary}");
    assert!(summary["metrics"]["finish_s"].as_f64().is_some(), "{summary}");
    assert!(summary["log"].is_null(), "{summary}");
    assert!(summary["log_error"].as_str().unwrap().contains("flight.mcap"), "{summary}");
    let (ticks, missing) = (&summary["ticks"], &summary["records_dropped"]);
    assert!(missing.as_u64().unwrap() > ticks.as_u64().unwrap() / 2, "{summary}");
}

#[test]
fn a_pipe_that_nobody_reads_keeps_neither_the_log_nor_the_program() {
    let (reader, mut writer) = std::io::pipe().unwrap();
    let out = || Stdio::from(OwnedFd::from(writer.try_clone().unwrap()));
    let mut bench = Fixture::start_with("unread", None, &[], out(), out());
    bench.wait_until_it_flies();
    // Its reader reads no more.
    let takes = |writer: &PipeWriter| {
        let mut files = [PollFd::new(writer.as_fd(), PollFlags::POLLOUT)];
        poll(&mut files, PollTimeout::ZERO).unwrap() > 0
    };
    while takes(&writer) {
        writer.write_all(&[b'x'; 4096]).unwrap();
    }
    sleep(Duration::from_secs(3));
    assert!(bench.drone_proxy.is_steered());
    bench.send(Signal::SIGINT);
    bench.wait_for(DronePhase::Grounded, 20.0);
    let clock = Clock::start();
    assert_eq!(bench.child.wait().unwrap().code(), Some(1));
    let after_s = clock.now().seconds();
    // A second to say that it stands, half for the log to show it, one for each the line and the summary.
    assert!(after_s < 5.0, "it ends {after_s} s after the drone stands");
    assert_is_complete(&bench.folder);
    drop(reader);
}

#[test]
fn a_second_flight_of_the_same_drone_is_refused_and_disturbs_nothing() {
    let bench = Fixture::start("second", &[]);
    bench.wait_until_it_flies();
    let packets = bench.emulator.truth().received;
    let second = fly(&bench.folder, &["--yes", "--log", "second.mcap"]).output().unwrap();
    let text = String::from_utf8_lossy(&second.stderr).into_owned();
    assert_eq!(second.status.code(), Some(2), "{text}");
    assert!(text.contains(&format!("process {}", bench.child.id())), "{text}");
    assert!(
        bench.drone_proxy.is_steered()
            && bench.emulator.truth().received.landings == packets.landings
    );
    bench.send(Signal::SIGINT);
    bench.assert_ends_on_the_ground();
}
