use horizon_model::Lagged;
use horizon_model::rows::motion;

use super::*;
use crate::cycle::sense::tests::{DT_NS, Shown, at, sighting, table};
use crate::cycle::{FlightTable, Tick, Unwatched, build};
use crate::time::TimeNs;
use crate::{Fault, ObstacleTable, Sighting, Start};

#[test]
fn what_a_report_lacks_stays_absent() {
    let status =
        DroneStatus { velocity_d_mps: Some([1.0, -0.5, 0.3]), heading_rad: Some(0.25), ..flying() };
    let expected = DroneMotion {
        horizontal_d_mps: Some([1.0, -0.5]),
        height_m: Some(1.0),
        heading_rad: Some(0.25),
    };
    assert_eq!(drone_motion(&status), expected);
    let silent = DroneStatus { height_m: None, velocity_d_mps: None, heading_rad: None, ..status };
    let nothing = DroneMotion { horizontal_d_mps: None, height_m: None, heading_rad: None };
    assert_eq!(drone_motion(&silent), nothing);
}

/// A healthy drone in the air.
fn flying() -> DroneStatus {
    DroneStatus {
        received_at: TimeNs(0),
        is_flying: true,
        is_on_ground: false,
        takes_sticks: true,
        is_battery_low: None,
        is_battery_critical: None,
        battery_pct: 80,
        battery_v: None,
        height_m: Some(1.0),
        velocity_d_mps: Some([0.3, 0.4, 0.0]),
        heading_rad: None,
        flight_mode: None,
    }
}

fn faults(out: &Outcome) -> crate::FaultSet {
    out.decision.unwrap().faults
}

#[test]
fn the_drones_motion_counts_in_flight_while_its_report_is_fresh() {
    let speed_mps = |start: Start, later: usize| {
        let mut shown = Shown::of(&FlightTable { start, ..table() });
        let mut out = shown.show(Some(at(0.0)), Some(flying()));
        (0..later).for_each(|_| out = shown.show(Some(at(0.0)), None));
        out.findings.unwrap().drone_speed_mps
    };
    // 25 ticks later it is 0.5 s old.
    for (start, later, expected) in [
        (Start::Airborne, 0, Some(0.5)),
        (Start::Airborne, 25, Some(0.5)),
        (Start::Airborne, 26, None),
        (Start::Carried, 0, None),
        (Start::Grounded, 0, None),
    ] {
        assert_eq!(speed_mps(start, later), expected, "{start:?}, {later} ticks later");
    }
}

#[test]
fn an_obstacle_bars_the_start_of_a_vehicle_on_the_ground_alone() {
    let above = ObstacleTable::Box { x_m: [-2.5, -1.5], y_m: [-2.5, -1.5], z_m: [1.2, 2.0] };
    for (start, expected) in [(Start::Grounded, true), (Start::Airborne, false)] {
        let mut table = FlightTable { start, ..table() };
        table.cycle.obstacles = vec![above.clone()];
        let mut shown = Shown::of(&table);
        let out = (0..3).map(|_| shown.show(Some(at(0.0)), Some(flying()))).last().unwrap();
        assert_eq!(faults(&out).contains(Fault::StartMisplaced), expected, "{start:?}");
    }
}

#[test]
fn a_drone_that_reports_a_low_battery_has_one() {
    for (is_battery_low, expected) in [(Some(true), true), (Some(false), false), (None, false)] {
        let mut shown = Shown::of(&table());
        let out = shown.show(Some(at(0.0)), Some(DroneStatus { is_battery_low, ..flying() }));
        assert_eq!(faults(&out).contains(Fault::BatteryLow), expected, "{is_battery_low:?}");
    }
}

#[test]
fn a_person_whose_sticks_rest_is_gone_after_a_while() {
    for (stick, expected) in [(0.02, true), (-0.02, true), (0.021, false)] {
        let mut table = table();
        table.cycle.supervisor.failsafe.person_gone_s = Some(10.0);
        let mut shown = Shown::of(&table);
        let gone = (0..520).any(|_| {
            shown.hold(Some([0.0, stick, 0.0, 0.0]));
            faults(&shown.show(Some(at(0.0)), Some(flying()))).contains(Fault::PersonGone)
        });
        assert_eq!(gone, expected, "{stick}");
    }
}

#[test]
fn a_vehicle_that_does_not_follow_its_inputs_is_in_an_outage_that_has_a_limit() {
    let mut table = table();
    table.cycle.supervisor.failsafe.outage_s = 1.0;
    table.cycle.supervisor.failsafe.outage_alone_s = 1.0;
    let still = DroneStatus { velocity_d_mps: Some([0.0; 3]), ..flying() };
    let mut shown = Shown::of(&table);
    let mut down = None;
    let long = (0..400).find(|step| {
        let out = shown.show(Some(at(0.0)), Some(still));
        if out.link.is_some_and(|link| link.state.is_down()) {
            down.get_or_insert(*step);
        }
        faults(&out).contains(Fault::OutageLong)
    });
    let (down, long) = (down.unwrap(), long.unwrap());
    // It counts from the tick in which it is found and is too long beyond a second.
    assert!((49..=50).contains(&(long - down)), "{down}, {long}");
}

#[test]
fn a_vehicle_that_was_approached_may_evade_and_return_for_four_seconds() {
    let mut table = table();
    table.cycle.obstacles = vec![ObstacleTable::Moving { radius_m: 0.2 }];
    let mut cycle =
        build::cycle::<_, _, _, { motion::CONTROLLABLE }>(Lagged::default(), &table).unwrap();
    let (mut inbox, mut out) = (Inbox::new(), cycle.new_outcome());
    // It walks towards the vehicle for 2 s, stops 2 m away and is never in the path to the reference.
    let counts: Vec<bool> = (0..350)
        .map(|step| {
            let now = TimeNs(step * DT_NS);
            inbox.open(step.unsigned_abs(), now);
            inbox.drone = Some(DroneStatus { received_at: now, ..flying() });
            let noise_m = 1e-4 * ((step * 7) % 5) as f64;
            let pose = Some(at(0.0) + Pose::new(noise_m, -noise_m, noise_m, 0.0));
            inbox.sightings.push(Sighting { pose, ..sighting(now, 0) });
            inbox.obstacle_w = Some([-2.0 + noise_m, -6.0 + now.seconds().min(2.0), 1.0]);
            cycle.tick(&inbox, &mut Unwatched::default(), &mut out);
            assert!(!cycle.mission.is_finished());
            cycle.motion().is_some_and(|motion| {
                let reference = cycle.mission.reference();
                let exemption = cycle.tracking_exemption(&motion.pose, reference.as_ref(), now);
                cycle.velocity_error(&motion, None, exemption).is_some()
            })
        })
        .collect();
    let since = counts.iter().rposition(|counts| !counts).unwrap() + 1;
    assert!((300..315).contains(&since), "from tick {since} on the velocity counts");
    assert!(counts[30..since].iter().all(|counts| !counts), "from when it came near on");
}
