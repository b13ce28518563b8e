//! Phases, orders of the operator and incidents.

use super::*;

#[test]
fn each_phase_has_its_name_on_terminals() {
    let phases = [Phase::Idle, Phase::TakingOff, Phase::Flying, Phase::Landing, Phase::Landed];
    let names = ["idle", "taking off", "flying", "landing", "landed"];
    assert_eq!(phases.map(Phase::name), names);
    assert_eq!(
        [Phase::LandingUnconfirmed, Phase::MotorsStopped].map(Phase::name),
        ["landing unconfirmed", "emergency stop"]
    );
}

#[test]
fn a_flight_is_over_in_its_last_phases_and_a_success_if_it_landed_with_all_targets() {
    use Phase::{Flying, Idle, Landed, Landing, LandingUnconfirmed, MotorsStopped, TakingOff};
    assert!([Landed, LandingUnconfirmed, MotorsStopped].into_iter().all(Phase::is_over));
    assert!(![Idle, TakingOff, Flying, Landing].into_iter().any(Phase::is_over));
    assert!(Landed.is_success(5, 5, &[]) && Landed.is_success(0, 0, &[]));
    assert!(!Landed.is_success(4, 5, &[]) && !MotorsStopped.is_success(5, 5, &[]));
    for (fault, is_success) in [
        (Fault::OperatorStop, true),
        (Fault::LandedByPose, true),
        (Fault::TrackingLost, false),
        (Fault::FenceLeft, false),
    ] {
        assert_eq!(Landed.is_success(5, 5, &[fault]), is_success, "{fault:?}");
    }
}

#[test]
fn a_stop_of_the_motors_is_the_strongest_order_and_landing_the_next() {
    use Operator::{EmergencyStop, Fly, FlyByHand, Land, Wait};
    assert!([Wait, Fly, FlyByHand, Land, EmergencyStop].is_sorted_by(|a, b| a < b));
    assert_eq!(Operator::default(), Wait);
}

#[test]
fn a_lost_guardian_and_an_unasked_landing_end_a_flight_and_no_other_incident_does() {
    let none = Incidents::default();
    for (incidents, ends) in [
        (none, false),
        (Incidents { is_guardian_lost: true, ..none }, true),
        (Incidents { has_landed_unasked: true, ..none }, true),
        (Incidents { has_input_expired: true, is_mocap_undated: true, ..none }, false),
    ] {
        assert_eq!(incidents.ends_flight(), ends, "{incidents:?}");
    }
}

#[test]
fn logs_without_dated_poses_or_with_the_old_word_for_an_emergency_stop_are_read() {
    let old =
        r#"{"is_guardian_lost": true, "has_landed_unasked": false, "has_input_expired": false}"#;
    let expected = Incidents { is_guardian_lost: true, ..Incidents::default() };
    assert_eq!(serde_json::from_str::<Incidents>(old).unwrap(), expected);
    let unknown = old.replace("has_input_expired", "has_input_expires");
    assert!(serde_json::from_str::<Incidents>(&unknown).is_err());
    let old = || serde_json::json!("cut");
    assert_eq!(serde_json::from_value::<Operator>(old()).unwrap(), Operator::EmergencyStop);
    assert_eq!(serde_json::from_value::<Phase>(old()).unwrap(), Phase::MotorsStopped);
}
