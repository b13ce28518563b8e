use horizon_estim::Observed;
use horizon_model::rows::stick;

use super::*;
use crate::smooth::smooth;

const DT_S: f64 = 0.02;

fn table() -> OutageTable {
    OutageTable {
        lambda_h_mps: 2.0,
        theta_0_rad: -0.06,
        tau_h_s: 0.63,
        a_max_mps2: None,
        dead_h: 0.07,
        sd_mps: 0.25,
        correlation_s: 0.25,
        outage_cost: 8.0,
        return_cost: 4.0,
    }
}

/// A flight of `steps` with first-order lag and 20 % more gain than expected, whose commands do not
/// act where `is_lost`.
fn flight(steps: usize, is_lost: impl Fn(usize) -> bool) -> (Vec<Sticks>, MotionTrack) {
    let mut velocity = Vector2::zeros();
    let mut pose = Pose::new(0.0, 0.0, 1.0, 1.0);
    let (mut u, mut o) = (Vec::new(), Vec::new());
    for k in 0..steps {
        let t = k as f64 * DT_S;
        let mut sticks = Sticks::zeros();
        sticks[stick::ROLL] = 0.5 * (0.8 * t).sin();
        sticks[stick::PITCH] = 0.5 * (1.1 * t).cos();
        let asked = 1.2 * command(&table(), &sticks, pose[pose::THETA]);
        let asked = if is_lost(k) { Vector2::zeros() } else { asked };
        u.push(sticks);
        o.push(Observed::full(pose));
        velocity += DT_S / 0.63 * (asked - velocity);
        pose[pose::X] += DT_S * velocity.x;
        pose[pose::Y] += DT_S * velocity.y;
    }
    let track = smooth(&o, DT_S);
    (u, track)
}

#[test]
fn an_outage_is_found_with_its_ends_and_nothing_else() {
    let truth = |k: usize| (500..650).contains(&k) || (1200..1500).contains(&k);
    let (u, track) = flight(2000, truth);
    let is_lost = lost_commands(&(&table()).try_into().unwrap(), &u, &track, DT_S);
    let found = (0..2000).filter(|k| is_lost[*k] && truth(*k)).count();
    let wrong = (0..2000).filter(|k| is_lost[*k] && !truth(*k)).count();
    // An end is blurred by the correlation time and by sticks that cross zero: a quarter second each.
    assert!(found > 400, "{found}");
    assert!(wrong < 25, "{wrong}");
}

#[test]
fn a_flight_that_follows_has_no_loss() {
    let (u, track) = flight(2000, |_| false);
    let is_lost = lost_commands(&(&table()).try_into().unwrap(), &u, &track, DT_S);
    assert!(!is_lost.contains(&true), "{:?}", is_lost.iter().position(|is_lost| *is_lost));
}

/// Full sticks to and fro, and a vehicle that accelerates by 1.1 m/s^2 at most and ignores its
/// sticks where `is_lost`.
fn bang_bang(steps: usize, is_lost: impl Fn(usize) -> bool) -> (Vec<Sticks>, MotionTrack) {
    let (mut velocity, mut pose) = (Vector2::zeros(), Pose::new(0.0, 0.0, 1.0, 1.0));
    let (mut u, mut o) = (Vec::new(), Vec::new());
    for k in 0..steps {
        let mut sticks = Sticks::zeros();
        sticks[stick::ROLL] = if k / 25 % 2 == 0 { 1.0 } else { -1.0 };
        sticks[stick::PITCH] = if k / 50 % 2 == 0 { 1.0 } else { -1.0 };
        let asked = command(&table(), &sticks, pose[pose::THETA]);
        let asked = if is_lost(k) { Vector2::zeros() } else { asked };
        u.push(sticks);
        o.push(Observed::full(pose));
        velocity += ((asked - velocity) * (DT_S / 0.63)).cap_magnitude(DT_S * 1.1);
        pose[pose::X] += DT_S * velocity.x;
        pose[pose::Y] += DT_S * velocity.y;
    }
    let track = smooth(&o, DT_S);
    (u, track)
}

#[test]
fn full_sticks_at_the_limit_of_acceleration_are_no_outage() {
    let lost = |a_max_mps2: Option<f64>, (u, track): (Vec<Sticks>, MotionTrack)| {
        let settings = OutageSettings::try_from(&OutageTable { a_max_mps2, ..table() }).unwrap();
        let is_lost = lost_commands(&settings, &u, &track, DT_S);
        (0..2000).filter(|k| is_lost[*k]).map(|k| (700..1000).contains(&k)).collect::<Vec<_>>()
    };
    let found = lost(Some(1.5), bang_bang(2000, |_| false));
    assert!(found.is_empty(), "{}", found.len());
    let found = lost(None, bang_bang(2000, |_| false));
    assert!(found.len() > 500, "a limit that is not known: {}", found.len());
    let found = lost(Some(1.5), bang_bang(2000, |k| (700..1000).contains(&k)));
    let inside = found.iter().filter(|is_inside| **is_inside).count();
    assert!(inside > 200 && found.len() < inside + 50, "{inside} of {}", found.len());
}

#[test]
fn a_bad_value_is_refused_by_name() {
    let refused = |table: OutageTable| OutageSettings::try_from(&table).unwrap_err().key;
    assert_eq!(refused(OutageTable { sd_mps: 0.0, ..table() }), "sd_mps");
    assert_eq!(refused(OutageTable { dead_h: 0.6, ..table() }), "dead_h");
    assert_eq!(refused(OutageTable { a_max_mps2: Some(0.0), ..table() }), "a_max_mps2");
    assert_eq!(refused(OutageTable { outage_cost: f64::NAN, ..table() }), "outage_cost");
}
