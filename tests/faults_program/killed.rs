//! The program is killed, stopped, or left alone by its guardian: who lands the drone, and when.

use tello_flight::cycle::Topic;

use super::*;

/// Within this time after the program is dead or stopped the drone is ordered to land. s
const GUARDED_S: f64 = 0.5;

#[test]
fn a_killed_program_is_replaced_by_its_guardian() {
    let mut bench = Fixture::start("killed", &[]);
    bench.wait_until_it_flies();
    let guardian = bench.guardian();
    let killed_at = bench.send(Signal::SIGKILL);
    bench.wait_for(DronePhase::Landing(Cause::Order), 2.0);
    let after_s = bench.drone_proxy.landing_s(killed_at).unwrap();
    assert!(after_s < GUARDED_S, "landing after {after_s} s");
    bench.child.wait().unwrap();
    bench.wait_for(DronePhase::Grounded, 20.0);
    Fixture::wait_until_gone(guardian, 17.0);
    bench.drone_proxy.assert_only_landings(killed_at, 55);
    bench.drone_proxy.assert_neutral_before_landings(killed_at);
    assert!(bench.errors().contains("its guardian orders the drone"), "{}", bench.errors());
}

#[test]
fn a_stopped_program_is_landed_and_goes_on_with_the_landing_when_it_goes_on() {
    let bench = Fixture::start("stopped", &[]);
    bench.wait_until_it_flies();
    let stopped_at = bench.send(Signal::SIGSTOP);
    bench.wait_for(DronePhase::Landing(Cause::Order), 2.0);
    let after_s = bench.drone_proxy.landing_s(stopped_at).unwrap();
    assert!(after_s < GUARDED_S, "landing after {after_s} s");
    sleep(Duration::from_secs(1));
    bench.send(Signal::SIGCONT);
    let (drone_proxy, folder) = bench.assert_ends_on_the_ground();
    drone_proxy.assert_only_landings(stopped_at, 5);
    let (_, link) = last_link(&folder);
    assert_eq!(link["guardian_landings"], 1, "{link}");
    let faults = faults(&folder);
    let has = |name: &str| faults.iter().any(|fault| fault == name);
    // Its ticks were late, too.
    assert!(has("program_stalled") && !has("operator_stop"), "{faults:?}");
    assert!(link["longest_pause_ns"].as_i64().unwrap() > 1_000_000_000, "{link}");
}

#[test]
fn a_stop_that_is_too_short_to_be_noticed_costs_no_flight() {
    let bench = Fixture::start("hiccup", &[]);
    bench.wait_until_it_flies();
    for _ in 0..3 {
        let stopped_at = bench.send(Signal::SIGSTOP);
        sleep(Duration::from_millis(100));
        bench.send(Signal::SIGCONT);
        sleep(Duration::from_secs(1));
        assert_eq!(bench.drone_proxy.landing_s(stopped_at), None);
        assert!(bench.drone_proxy.is_steered());
    }
    bench.send(Signal::SIGINT);
    bench.assert_ends_on_the_ground();
}

#[test]
fn a_program_that_loses_its_guardian_lands() {
    let bench = Fixture::start("unguarded", &[]);
    bench.wait_until_it_flies();
    let killed_at = bench.drone_proxy.clock.now();
    kill(bench.guardian(), Signal::SIGKILL).unwrap();
    bench.wait_for(DronePhase::Landing(Cause::Order), 2.0);
    assert!(bench.drone_proxy.landing_s(killed_at).unwrap() < GUARDED_S);
    let (_, folder) = bench.assert_ends_on_the_ground();
    let (_, link) = last_link(&folder);
    assert_eq!(link["guardians_lost"], 1);
    assert!(link["longest_pause_ns"].as_i64().unwrap() < 400_000_000, "{link}");
    assert_eq!(faults(&folder), ["guardian_lost"]);
}

#[test]
fn a_program_whose_guardian_is_stopped_lands() {
    let bench = Fixture::start("deaf", &[]);
    bench.wait_until_it_flies();
    let guardian = bench.guardian();
    let stopped_at = bench.drone_proxy.clock.now();
    kill(guardian, Signal::SIGSTOP).unwrap();
    bench.wait_for(DronePhase::Landing(Cause::Order), 2.0);
    let after_s = bench.drone_proxy.landing_s(stopped_at).unwrap();
    assert!(after_s < 1.5 * GUARDED_S, "landing after {after_s} s");
    let (_, folder) = bench.assert_ends_on_the_ground();
    let (_, link) = last_link(&folder);
    assert_eq!(link["guardians_lost"], 1, "{link}");
    assert!(link["longest_pause_ns"].as_i64().unwrap() < 400_000_000, "{link}");
    assert!(kill(guardian, None).is_err(), "the guardian outlived the program");
}

#[test]
fn a_program_whose_guardian_is_stopped_on_the_ground_does_not_take_off() {
    let mut bench = Fixture::start("deaf-ground", &[]);
    let clock = Clock::start();
    // Its name is the first that it does; then it says that it watches.
    let is_guarded = || {
        let guardian = bench.guardian_if_any()?;
        let name = fs::read_to_string(format!("/proc/{guardian}/comm")).ok()?;
        (name.trim() == "tello-guardian").then_some(guardian)
    };
    let guardian = loop {
        assert!(clock.now().seconds() < 10.0, "no guardian");
        match is_guarded() {
            Some(guardian) => break guardian,
            None => sleep(Duration::from_millis(1)),
        }
    };
    sleep(Duration::from_millis(30));
    kill(guardian, Signal::SIGSTOP).unwrap();
    let status = bench.child.wait().unwrap();
    let errors = bench.errors();
    assert_eq!(status.code(), Some(2), "{errors}");
    assert!(errors.contains("did not take off: ") && errors.contains("guardian lost"), "{errors}");
    assert!(!errors.contains("operator stop") && !errors.contains("not ready"), "{errors}");
    assert_eq!(bench.emulator.truth().phase, DronePhase::Grounded);
    assert!(!bench.drone_proxy.is_taken_off(), "took off without a guardian");
}

#[test]
fn what_ends_a_terminal_and_its_programs_does_not_end_the_guardian() {
    let mut bench = Fixture::start("terminal", &[]);
    bench.wait_until_it_flies();
    let guardian = bench.guardian();
    for signal in [Signal::SIGHUP, Signal::SIGINT, Signal::SIGTERM, Signal::SIGTSTP] {
        kill(guardian, signal).unwrap();
    }
    // Of a session of its own, so that the terminal's signals do not reach it in the first place.
    assert_eq!(nix::unistd::getsid(Some(guardian)), Ok(guardian));
    let killed_at = bench.send(Signal::SIGKILL);
    bench.child.wait().unwrap();
    bench.wait_for(DronePhase::Landing(Cause::Order), 2.0);
    assert!(bench.drone_proxy.landing_s(killed_at).unwrap() < GUARDED_S);
}

#[test]
fn a_flight_that_ends_well_leaves_no_guardian() {
    let bench = Fixture::start("well", &[]);
    bench.wait_until_it_flies();
    let guardian = bench.guardian();
    bench.send(Signal::SIGTERM);
    bench.assert_ends_on_the_ground();
    assert!(kill(guardian, None).is_err(), "the guardian outlived the program");
}

/// A thread that watches is above the one that it watches, all of them above those of an ordinary program.
#[test]
fn sender_and_guardian_are_scheduled_above_control() {
    let bench = Fixture::start("priorities", &[]);
    bench.wait_for(DronePhase::Flying, 30.0);
    let program = Pid::from_raw(bench.child.id().cast_signed());
    let sender = priority(program, "tello-ctl");
    let control = priority(program, "tello-control");
    let mocap = priority(program, "tello-mocap");
    let guardian = priority(bench.guardian(), "tello-guardian");
    bench.send(Signal::SIGINT);
    bench.assert_ends_on_the_ground();
    if control == 0 {
        assert!(std::env::var_os("CI").is_none(), "no real time in CI");
        eprintln!("NOT CHECKED: this machine permits no real time");
        return;
    }
    let ascending = [mocap, control, sender, guardian];
    assert!(ascending.is_sorted_by(|lower, upper| lower < upper), "{ascending:?}");
}

/// The judge's measure: twenty times each. `cargo test --test thorough dead -- --ignored --nocapture`
#[test]
#[ignore = "seven minutes of flights"]
fn twenty_kills_and_twenty_stops_are_landed_in_time() {
    for signal in [Signal::SIGKILL, Signal::SIGSTOP] {
        let mut after: Vec<f64> = (0..20)
            .map(|i| {
                let mut bench = Fixture::start(&format!("twenty-{i}"), &[]);
                bench.wait_for(DronePhase::Flying, 30.0);
                // Each at another moment of the sender's period.
                sleep(Duration::from_millis(2000 + 7 * i));
                let at = bench.send(signal);
                sleep(Duration::from_secs(1));
                let after_s = bench.drone_proxy.landing_s(at).unwrap_or(f64::INFINITY);
                bench.send(Signal::SIGKILL);
                bench.child.wait().unwrap();
                bench.drone_proxy.assert_only_landings(at, 1);
                after_s
            })
            .collect();
        after.sort_by(f64::total_cmp);
        println!("{signal}: LAND after {:.3} s median, {:.3} s largest", after[10], after[19]);
        assert!(after[19] < GUARDED_S, "{signal}: {after:?}");
    }
}

/// Faults of the last tick of the log: they ended the flight.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn faults(folder: &Path) -> Vec<String> {
    let log = LogReader::open(&folder.join("flight.mcap")).unwrap();
    let mut log = log.select(&[Topic::Fault.name()]);
    let mut last = Value::Null;
    while let Some(message) = log.next_message().unwrap() {
        last = message.decode().unwrap();
    }
    serde_json::from_value(last["faults"].take()).unwrap()
}

/// The real-time priority of the thread `name` of `process`; 0 of an ordinary one.
#[expect(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]
fn priority(process: Pid, name: &str) -> i32 {
    let tasks = fs::read_dir(format!("/proc/{process}/task")).unwrap();
    let stats = tasks.map(|task| fs::read_to_string(task.unwrap().path().join("stat")).unwrap());
    let wanted = format!("({name})");
    let stat = stats.into_iter().find(|stat| stat.contains(&wanted)).expect(name);
    // Field 40 of all; behind the name, which is the second and may hold blanks, the 38th.
    let behind_name = stat.rsplit_once(") ").unwrap().1;
    behind_name.split(' ').nth(37).unwrap().parse().unwrap()
}
