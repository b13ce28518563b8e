use horizon_model::check::amax;
use horizon_model::rows::Sticks;
use tello_io::mocap::parse_line;

use super::*;
use crate::drone::DronePhase;
use crate::firmware::PLAIN;
use crate::plant::{NOMINAL, STANDING_M, UNVARIED, Velocity};

/// A good day with the nominal vehicle of the flights.
pub(crate) fn table() -> SimTable {
    SimTable {
        profile: Profile::GoodDay,
        has_spread: true,
        start: SimStart::Air { x: 0.5, y: -0.5, z: 1.3, theta: 0.2 },
        object: "tello".into(),
        battery_pct: 90.0,
        drone: PLAIN,
        plant: NOMINAL,
        variation: UNVARIED,
        faults: Vec::new(),
        passer: None,
        mocap_age_s: 0.0,
        mocap_rate_hz: 50.0,
    }
}

/// Reports of 20 s under a constant stick.
fn reports(table: &SimTable, seed: u64) -> Vec<MocapReport> {
    let mut world = World::new(table, seed).unwrap();
    world.drone.steer(Sticks::new(0.1, 0.2, 0.0, 0.0));
    (0..1000)
        .map(|_| {
            world.drone.reset_watchdog();
            world.advance();
            world.report()
        })
        .collect()
}

#[test]
fn one_seed_is_one_flight() {
    let table = SimTable { profile: Profile::Outages, ..table() };
    assert_eq!(reports(&table, 5), reports(&table, 5));
    assert_ne!(reports(&table, 5), reports(&table, 6));
}

#[test]
fn starts_scatter_as_the_flights_did() {
    let worlds = 20_000;
    let mut sums = [[0.0; 2]; 4];
    for seed in 0..worlds {
        let truth = World::new(&table(), seed).unwrap().truth();
        let values = [truth.pose[pose::X], truth.pose[pose::Z], truth.pose[pose::THETA]];
        for (sum, value) in sums.iter_mut().zip(values.into_iter().chain([truth.velocity.y_mps])) {
            sum[0] += value;
            sum[1] += value * value;
        }
    }
    let n = worlds as f64;
    for ([sum, squares], (mean, sd)) in
        sums.into_iter().zip([(0.5, 0.10), (1.22, 0.03), (0.23, 0.05), (0.0, 0.16)])
    {
        let got_mean = sum / n;
        let got_sd = (squares / n - got_mean * got_mean).sqrt();
        // Three standard errors of 20 000 draws.
        assert!((got_mean - mean).abs() < 0.022 * sd, "mean {got_mean} instead of {mean}");
        assert!((got_sd / sd - 1.0).abs() < 0.015, "deviation {got_sd} instead of {sd}");
    }
}

#[test]
fn without_spread_every_seed_starts_exactly_at_the_given_pose() {
    let table = SimTable { has_spread: false, ..table() };
    for seed in 0..5 {
        let truth = World::new(&table, seed).unwrap().truth();
        assert_eq!(truth.pose, Pose::new(0.5, -0.5, 1.3, 0.2));
        assert_eq!((truth.velocity, truth.phase), (Velocity::default(), DronePhase::Flying));
    }
    let table = SimTable { start: SimStart::Ground { x: 1.0, y: 2.0, theta: -0.5 }, ..table };
    let truth = World::new(&table, 1).unwrap().truth();
    assert_eq!(
        (truth.pose, truth.phase),
        (Pose::new(1.0, 2.0, STANDING_M, -0.5), DronePhase::Grounded)
    );
}

#[test]
fn scripted_faults_change_the_report_and_nothing_else() {
    let script = [
        (InjectedFault::MocapLost, 2.0),
        (InjectedFault::MocapSilent, 4.0),
        (InjectedFault::MocapFixed, 6.0),
    ];
    let faults: Vec<_> = script
        .into_iter()
        .map(|(fault, from_s)| ScriptedFault { fault, from_s, for_s: 1.0 })
        .collect();
    let clean = SimTable { profile: Profile::Clean, ..table() };
    let undisturbed = reports(&clean, 3);
    for (k, (report, expected)) in
        reports(&SimTable { faults, ..clean }, 3).into_iter().zip(undisturbed).enumerate()
    {
        // The report at index k is that of step k + 1.
        match k + 1 {
            100..150 => assert_eq!(report, MocapReport::Lost, "step {}", k + 1),
            200..250 => assert_eq!(report, MocapReport::Silent, "step {}", k + 1),
            300..350 => assert_eq!(report, Mocap::fixed(), "step {}", k + 1),
            _ => assert_eq!(report, expected, "step {}", k + 1),
        }
    }
}

#[test]
fn outages_let_the_drone_drift_to_a_stop() {
    let table = SimTable { profile: Profile::Outages, has_spread: false, ..table() };
    let mut world = World::new(&table, 8).unwrap();
    world.drone.steer(Sticks::new(0.0, 0.5, 0.0, 0.0));
    let (mut down, mut slowest_mps, mut down_s) = (0, f64::INFINITY, 0.0);
    for _ in 0..3000 {
        world.drone.reset_watchdog();
        world.advance();
        let truth = world.truth();
        down_s = if truth.link_is_up { 0.0 } else { down_s + DT_S };
        if down_s > 3.0 {
            down += 1;
            let speed_mps = truth.velocity.x_mps.hypot(truth.velocity.y_mps);
            slowest_mps = slowest_mps.min(speed_mps);
        }
    }
    assert!(down > 0, "no outage of more than 3 s in a minute");
    assert!(slowest_mps < 0.1, "{slowest_mps} m/s after 3 s without commands");
}

#[test]
fn a_world_with_a_value_outside_of_its_range_is_refused_with_key_value_and_rule() {
    let refusal = |table: SimTable| World::new(&table, 0).unwrap_err().to_string();
    assert_eq!(
        refusal(SimTable { battery_pct: 101.0, ..table() }),
        "battery_pct = 101: expected 0.0..=100.0"
    );
    assert_eq!(
        refusal(SimTable { object: "my tello".into(), ..table() }),
        "object = my tello: expected a name without spaces"
    );
    let start = SimStart::Air { x: f64::NAN, y: 0.0, z: 1.0, theta: 0.0 };
    assert_eq!(refusal(SimTable { start, ..table() }), "start.x = NaN: expected finite");
    let start = SimStart::Air { x: 0.0, y: 0.0, z: -5.0, theta: 0.0 };
    assert_eq!(refusal(SimTable { start, ..table() }), "start.z = -5: expected finite and > 0");
    let mut bad = table();
    bad.variation.gain = -1.0;
    assert_eq!(refusal(bad), "variation.gain = -1: expected 0.01..=100.0");
    let mut table = table();
    table.plant.vertical.tau_s = 0.0;
    assert_eq!(refusal(table), "plant.vertical.tau_s = 0: expected finite and > 0");
}

#[test]
fn the_relay_line_is_what_the_parser_reads() {
    let clean = SimTable { profile: Profile::Clean, has_spread: false, ..table() };
    let faults = [(InjectedFault::MocapSilent, 0.02), (InjectedFault::MocapLost, 0.04)]
        .map(|(fault, from_s)| ScriptedFault { fault, from_s, for_s: 0.02 });
    let mut world = World::new(&SimTable { faults: faults.into(), ..clean }, 1).unwrap();
    let mut bytes = Vec::new();
    for _ in 0..3 {
        world.relay_line(&mut bytes);
        world.advance();
    }
    let lines: Vec<_> = bytes.split_inclusive(|byte| *byte == b'\n').collect();
    assert_eq!(lines.len(), 2, "nothing is sent while silent");
    let seen = parse_line(lines[0].trim_ascii_end()).unwrap();
    assert_eq!((seen.frame, seen.object), (0, "tello"));
    // The relay prints four decimals.
    assert!(amax(&(seen.pose().unwrap() - Pose::new(0.5, -0.5, 1.3, 0.2))) < 1e-4, "{seen:?}");
    let lost = parse_line(lines[1].trim_ascii_end()).unwrap();
    assert_eq!((lost.frame, lost.at), (2, None), "frames keep pace with time while silent");
    for line in [seen, lost] {
        assert!((line.rate_hz * DT_S - 1.0).abs() < 1e-12, "{} Hz", line.rate_hz);
    }
}

#[test]
fn a_pose_of_an_age_is_that_of_where_the_vehicle_was() {
    let table = SimTable { profile: Profile::Clean, mocap_age_s: 0.005, ..table() };
    let mut world = World::new(&table, 3).unwrap();
    world.drone.steer(Sticks::new(0.4, 0.8, 0.5, 0.0));
    let mut earlier = world.truth().pose;
    for _ in 0..200 {
        world.drone.reset_watchdog();
        world.advance();
        let now = world.truth().pose;
        let MocapReport::Pose(o) = world.report() else { panic!("a clean stream is complete") };
        let mut off = o - (now + 0.25 * (earlier - now));
        off[pose::THETA] = wrap(off[pose::THETA]);
        // The turn passes pi, where the difference of the two is no heading between them.
        let has_wrapped = (earlier[pose::THETA] - now[pose::THETA]).abs() > 1.0;
        assert!(has_wrapped || off.norm() < 1e-12, "{off}");
        earlier = now;
    }
    assert!(World::new(&SimTable { mocap_age_s: 0.021, ..table }, 3).is_err());
}
