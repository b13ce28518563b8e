//! Names, order and reactions of all faults.

use super::*;

#[test]
fn each_fault_has_a_name_of_its_own_on_a_terminal() {
    for fault in Fault::ALL {
        let of_this_name = Fault::ALL.iter().filter(|other| other.name() == fault.name());
        assert_eq!(of_this_name.count(), 1, "{fault:?}: {:?}", fault.name());
    }
    assert_eq!(Fault::FenceLeft.name(), "outside of the room");
}

#[test]
fn every_fault_has_the_reaction_that_was_decided() {
    let reaction =
        |&fault: &Fault| (fault, [Pilot::Controller, Pilot::Person].map(|by| fault.reaction(by)));
    let reactions: Vec<_> = Fault::ALL.iter().map(reaction).collect();
    let expected = [
        (Fault::MocapStale, [Reaction::Hold, Reaction::Note]),
        (Fault::MocapLost, [Reaction::Land, Reaction::Note]),
        (Fault::MocapFrozen, [Reaction::Hold, Reaction::Note]),
        (Fault::MocapJumped, [Reaction::Land, Reaction::Note]),
        (Fault::MocapRough, [Reaction::Land, Reaction::Note]),
        (Fault::MocapUnsettled, [Reaction::StayDown, Reaction::Note]),
        (Fault::MocapUndated, [Reaction::StayDown, Reaction::Note]),
        (Fault::PoseDoubtful, [Reaction::Hold, Reaction::Note]),
        (Fault::PoseInconsistent, [Reaction::Land, Reaction::Note]),
        (Fault::HeadingWrong, [Reaction::Land, Reaction::Note]),
        (Fault::StartMisplaced, [Reaction::StayDown, Reaction::Note]),
        (Fault::PlanBlocked, [Reaction::Brake, Reaction::Note]),
        (Fault::BlockedLong, [Reaction::BrakeAndLand, Reaction::Note]),
        (Fault::ObstacleEntered, [Reaction::Land, Reaction::Note]),
        (Fault::ObstacleUnseen, [Reaction::Brake, Reaction::Note]),
        (Fault::ObstacleApproaches, [Reaction::Land, Reaction::Note]),
        (Fault::FenceNear, [Reaction::Hold, Reaction::Note]),
        (Fault::FenceLeft, [Reaction::Land, Reaction::Note]),
        (Fault::TrackingLost, [Reaction::Land, Reaction::Note]),
        (Fault::Immobile, [Reaction::Land, Reaction::Note]),
        (Fault::TooFast, [Reaction::Land, Reaction::Note]),
        (Fault::DeadTimeLong, [Reaction::Land, Reaction::Note]),
        (Fault::MissionOverdue, [Reaction::BrakeAndLand, Reaction::Note]),
        (Fault::OutageHeld, [Reaction::Brake, Reaction::Note]),
        (Fault::OutageLong, [Reaction::Land, Reaction::Note]),
        (Fault::OutageUnsafe, [Reaction::Land, Reaction::Note]),
        (Fault::DroneUnheard, [Reaction::StayDown, Reaction::StayDown]),
        (Fault::DroneAloft, [Reaction::StayDown, Reaction::StayDown]),
        (Fault::TookOffUnasked, [Reaction::Land, Reaction::Land]),
        (Fault::DroneSilent, [Reaction::BrakeAndLand, Reaction::Note]),
        (Fault::NotFlying, [Reaction::Land, Reaction::Land]),
        (Fault::BatteryLow, [Reaction::StayDown, Reaction::StayDown]),
        (Fault::BatteryCritical, [Reaction::BrakeAndLand, Reaction::Land]),
        (Fault::EstimatorFailed, [Reaction::Hold, Reaction::Note]),
        (Fault::ControllerFailed, [Reaction::Note, Reaction::Note]),
        (Fault::SolverFailing, [Reaction::Land, Reaction::Note]),
        (Fault::TicksLate, [Reaction::Land, Reaction::Land]),
        (Fault::TakeOffTimeout, [Reaction::Land, Reaction::Land]),
        (Fault::LandingTimeout, [Reaction::Land, Reaction::Land]),
        (Fault::GuardianLost, [Reaction::Land, Reaction::Land]),
        (Fault::ProgramStalled, [Reaction::Land, Reaction::Land]),
        (Fault::PersonGone, [Reaction::Land, Reaction::Land]),
        (Fault::InputExpired, [Reaction::Note, Reaction::Note]),
        (Fault::LandedByPose, [Reaction::Note, Reaction::Note]),
        (Fault::LandedByDrone, [Reaction::Note, Reaction::Note]),
        (Fault::OperatorStop, [Reaction::Land, Reaction::Land]),
        (Fault::OperatorEmergencyStop, [Reaction::EmergencyStop, Reaction::EmergencyStop]),
    ];
    assert_eq!(reactions, expected);
}

#[test]
fn a_set_holds_what_was_put_in_and_reacts_to_the_strongest() {
    let mut faults = FaultSet::default();
    assert!(faults.is_empty());
    assert_eq!(faults.reaction(Pilot::Controller), Reaction::Note);
    faults.set(Fault::OperatorStop, false);
    faults.set(Fault::BatteryLow, true);
    faults.set(Fault::MocapStale, true);
    faults.set(Fault::MocapStale, false);
    assert!(!faults.is_empty());
    assert_eq!(faults.iter().collect::<Vec<_>>(), [Fault::MocapStale, Fault::BatteryLow]);
    assert_eq!(faults.reaction(Pilot::Controller), Reaction::Hold);
    assert_eq!(faults.reaction(Pilot::Person), Reaction::StayDown);
    assert_eq!(format!("{faults:?}"), "{MocapStale, BatteryLow}");
}

#[test]
fn only_faults_that_land_or_stop_the_motors_end_a_flight() {
    let all = Fault::ALL.iter().fold(FaultSet::default(), |mut set, &fault| {
        set.set(fault, true);
        set
    });
    for pilot in [Pilot::Controller, Pilot::Person] {
        let ending = all.ending_flight(pilot);
        for &fault in Fault::ALL {
            let ends = fault.reaction(pilot) >= Reaction::BrakeAndLand;
            assert_eq!(ending.contains(fault), ends, "{fault:?}, {pilot:?}");
        }
        assert_eq!(ending.union(all), all);
        assert_eq!(FaultSet::default().union(ending), ending);
    }
}

#[test]
fn what_ended_a_flight_early_is_named_behind_its_landing() {
    let names = |ended_by: &[Fault]| Fault::ending_names(ended_by);
    assert_eq!(names(&[Fault::OperatorStop, Fault::LandedByPose, Fault::LandedByDrone]), "");
    let two = names(&[Fault::TrackingLost, Fault::OperatorStop, Fault::FenceLeft]);
    assert_eq!(two, " (off the reference, outside of the room)");
}

#[test]
fn a_fault_that_cuts_a_flight_short_names_its_likely_causes() {
    for fault in Fault::ALL {
        let ends =
            fault.reaction(Pilot::Controller) >= Reaction::BrakeAndLand && fault.ends_early();
        let is_plain = [Fault::BatteryCritical, Fault::OperatorEmergencyStop].contains(fault);
        assert!(!ends || is_plain || fault.likely_causes().is_some(), "{fault:?}");
    }
}
