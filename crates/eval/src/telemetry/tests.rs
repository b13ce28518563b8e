use horizon_model::{Kinematic, Lagged, Model};
use tello_flight::{Decision, FaultSet, LinkDecision, LinkState};

use super::*;

fn outcome() -> Outcome {
    Outcome::with_buffers(&Kinematic::STATE, &Kinematic::PARAMETER, 1)
}

fn facts(inbox: &Inbox, out: &Outcome) -> Telemetry {
    Telemetry::of(inbox, out, PredictedTrajectory::default())
}

#[test]
fn a_tick_before_anything_was_seen_claims_nothing() {
    let facts = facts(&Inbox::new(), &outcome());
    assert_eq!((facts.phase, facts.pilot, facts.is_by_hand), (Some(Phase::Idle), None, false));
    assert_eq!((facts.estimate, facts.velocity_w, facts.disturbance_w), (None, None, None));
    assert_eq!((facts.reference, facts.link, facts.drone), (None, None, None));
    assert!(facts.faults.is_empty());
}

#[test]
fn the_ruling_of_the_tick_is_shown_as_it_is() {
    let faults = [Fault::MocapStale, Fault::BatteryLow];
    let mut set = FaultSet::default();
    for fault in faults {
        set.set(fault, true);
    }
    let mut out = outcome();
    out.decision = Some(Decision {
        phase: Phase::Flying,
        pilot: Some(Pilot::Person),
        is_braking: false,
        order: None,
        faults: set,
        ended_by: FaultSet::default(),
        pose_is_airborne: None,
    });
    let inbox = Inbox { manual: Some([0.0; 4]), operator: Operator::Land, ..Inbox::new() };
    let facts = facts(&inbox, &out);
    assert_eq!((facts.phase, facts.pilot), (Some(Phase::Flying), Some(Pilot::Person)));
    assert_eq!((facts.is_by_hand, facts.operator), (true, Operator::Land));
    assert_eq!(facts.faults.len(), 2);
    assert!(faults.iter().all(|fault| facts.faults.contains(fault)));
}

#[test]
fn the_velocity_has_the_disturbance_in_it_and_is_none_for_a_model_without() {
    let mut out = Outcome::with_buffers(&Lagged::STATE, &Lagged::PARAMETER, 1);
    out.s_hat = vec![0.0; motion::COUNT];
    (out.s_hat[motion::V_X], out.s_hat[motion::D_X]) = (0.5, 0.1);
    (out.s_hat[motion::V_Y], out.s_hat[motion::D_Y]) = (-0.25, 0.05);
    (out.s_hat[motion::V_Z], out.s_hat[motion::D_Z]) = (0.02, -0.012_345);
    let shown = facts(&Inbox::new(), &out);
    assert_eq!(shown.velocity_w, Some([0.6, -0.2, 0.008]));
    assert_eq!(shown.disturbance_w, Some([0.1, 0.05, -0.012]));
    out.s_hat.truncate(pose::COUNT);
    let shown = facts(&Inbox::new(), &out);
    assert_eq!((shown.velocity_w, shown.disturbance_w), (None, None));
    assert!(shown.estimate.is_some());
}

#[test]
fn rows_keep_their_names_to_a_thousandth() {
    let at = Spot::from(Pose::new(1.0004, -2.0006, 1.5, -3.0006));
    assert_eq!(at, Spot { x: 1.0, y: -2.001, z: 1.5, theta: -3.001 });
    let mut u = Sticks::zeros();
    (u[stick::ROLL], u[stick::PITCH], u[stick::YAW], u[stick::THROTTLE]) = (0.1, 0.2, 0.3, 0.4);
    let shown = SticksFact { roll: 0.1, pitch: 0.2, yaw: 0.3, throttle: 0.4 };
    assert_eq!(SticksFact::from(u), shown);
}

#[test]
fn a_link_is_down_in_both_ways_of_losing_it() {
    for (state, is_down) in
        [(LinkState::Up, false), (LinkState::Released, true), (LinkState::Held, true)]
    {
        let mut out = outcome();
        out.link = Some(LinkDecision { state, score: -1.5, has_changed: false, onset_steps: 0 });
        let link = facts(&Inbox::new(), &out).link;
        assert_eq!(link, Some(LinkTelemetry { is_down, score: -1.5 }), "{state:?}");
    }
}

#[test]
fn the_age_of_a_status_counts_from_its_arrival() {
    let status = DroneStatus {
        received_at: TimeNs(1_500_000_000),
        is_flying: true,
        is_on_ground: false,
        takes_sticks: true,
        is_battery_low: Some(true),
        is_battery_critical: Some(false),
        battery_pct: 12,
        battery_v: None,
        height_m: Some(1.1),
        velocity_d_mps: None,
        heading_rad: None,
        flight_mode: None,
    };
    let expected = DroneTelemetry {
        age_s: 0.25,
        battery_pct: 12,
        is_battery_low: Some(true),
        is_flying: true,
        height_m: Some(1.1),
    };
    assert_eq!(DroneTelemetry::of(&status, TimeNs(1_750_000_000)), expected);
}

#[test]
fn times_are_milliseconds_and_the_worst_is_taken_of_each() {
    let timing = Timing {
        step: 1,
        late_ns: 1_000_000,
        estimate_ns: 2_000_400,
        plan_ns: 500_000,
        sent_ns: 9_000_000,
        socket_latency_ns: 9_000_000,
        tick_ns: 3_500_000,
    };
    let one = Times::from(&timing);
    assert_eq!(one, Times { late_ms: 1.0, estimate_ms: 2.0, plan_ms: 0.5, tick_ms: 3.5 });
    let other = Times { late_ms: 0.5, estimate_ms: 4.0, plan_ms: 0.25, tick_ms: 5.0 };
    let worst = Times { late_ms: 1.0, estimate_ms: 4.0, plan_ms: 0.5, tick_ms: 5.0 };
    assert_eq!((one.sup(&other), other.sup(&one)), (worst, worst));
}
