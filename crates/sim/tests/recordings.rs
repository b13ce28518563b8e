//! A simulated flight, logged, and read again as a recording.

use std::fs;
use std::path::PathBuf;

use horizon_estim::Observed;
use horizon_model::rows::pose;
use tello_eval::flight_log::{self, TickRecord};
use tello_eval::recordings::{self, Loaded};
use tello_flight::cycle::{FlightTable, Timing};
use tello_flight::{Acceptance, Phase, Start};
use tello_io::config;
use tello_sim::Profile;
use tello_sim::virtual_time::VirtualFlight;

/// The only recording in `path`, or why there is none.
fn load(path: &PathBuf) -> Result<Loaded, String> {
    let found = recordings::load(std::slice::from_ref(path)).map_err(|error| error.to_string())?;
    let (mut loaded, unusable) = found;
    loaded.pop().ok_or_else(|| unusable.into_iter().map(|file| file.why).collect())
}

/// Ticks of a recorded flight, which is still running at its end.
const TICKS: usize = 500;

#[test]
fn of_a_flight_of_ours_the_accepted_poses_and_the_sent_sticks_count() {
    let (fly, mission) = config::fly(None, None).unwrap();
    let mut flight = config::flight(&fly, mission, Start::Grounded);
    let mut sim = tello_sim::settings(None).unwrap();
    sim.profile = Profile::BadDay;
    let mut virtual_flight = VirtualFlight::new(&flight, &sim, 5).unwrap();
    let path = std::env::temp_dir().join(format!("tello-ctl-flight-{}.mcap", std::process::id()));
    let write = |flight: &FlightTable, ticks: &[TickRecord]| {
        fs::remove_file(&path).ok();
        let mut log = flight_log::create(&path, flight, 0, &ticks[0].out).unwrap();
        for tick in ticks {
            flight_log::write_tick(&mut log, tick).unwrap();
        }
        log.finish().unwrap();
        let loaded = load(&path);
        fs::remove_file(&path).unwrap();
        loaded
    };
    let mut ticks: Vec<TickRecord> = (0..TICKS)
        .map(|_| TickRecord {
            out: virtual_flight.tick().unwrap().clone(),
            inbox: virtual_flight.inbox().clone(),
            timing: Timing::default(),
        })
        .collect();
    let loaded = write(&flight, &ticks).unwrap();
    let flying = ticks.iter().position(|tick| tick.out.phase() == Phase::Flying).unwrap();
    let idle = ticks.iter().filter(|tick| tick.out.phase() == Phase::Idle).count();
    let first = ticks.iter().position(|tick| tick.out.u_sent.amax() > 0.0).unwrap();
    assert!(flying > 50 && first > flying + 50, "in flight from {flying}, flown from {first}");
    assert_eq!(loaded.recording.u.len(), TICKS - first);
    let left_out = [
        format!("{idle} ticks before the take-off"),
        format!("{} ticks of the take-off", flying - idle),
        format!("{} ticks in which the firmware flew by itself", first - flying),
    ];
    assert_eq!(loaded.skipped, left_out);
    let mut rows_missing = [0; pose::COUNT];
    for (k, tick) in ticks[first..].iter().enumerate() {
        assert_eq!(loaded.recording.u[k], tick.out.u_sent, "tick {k}");
        let (o, filtered) = (&loaded.recording.o[k], tick.out.filtered.unwrap());
        assert_eq!(Some(o.o), filtered.o, "tick {k}");
        assert_eq!(o.is_present[pose::X], filtered.position == Acceptance::Accepted, "tick {k}");
        assert_eq!(o.is_present[pose::THETA], filtered.heading == Acceptance::Accepted, "tick {k}");
        for (missing, is_present) in rows_missing.iter_mut().zip(o.is_present) {
            *missing += usize::from(!is_present);
        }
    }
    assert!(rows_missing[pose::X] > 20, "a bad day without stalls: {rows_missing:?}");

    // Two periods without a tick are two missing steps.
    ticks[first + 100].inbox.skipped = 2;
    let late = write(&flight, &ticks).unwrap();
    assert_eq!(late.recording.u.len(), loaded.recording.u.len() + 2);
    assert_eq!(late.recording.o[100], Observed::missing());
    assert_eq!(late.recording.o[102], loaded.recording.o[100]);
    assert_eq!(late.recording.u[101], loaded.recording.u[99]);

    let on_the_ground = write(&flight, &ticks[..50]).unwrap_err();
    assert!(on_the_ground.contains("never reached the flying phase"), "{on_the_ground}");
    flight.cycle.dt_s = 0.01;
    let fast = write(&flight, &ticks[..50]).unwrap_err();
    assert!(fast.contains("its period is 0.01 s"), "{fast}");
}
