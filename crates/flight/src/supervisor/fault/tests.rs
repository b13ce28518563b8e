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

/// Words of the table of faults.
fn word(reaction: Reaction) -> &'static str {
    match reaction {
        Reaction::Note => "note",
        Reaction::StayDown => "stay down",
        Reaction::Brake => "brake",
        Reaction::Hold => "hold",
        Reaction::BrakeAndLand => "brake, land",
        Reaction::Land => "land",
        Reaction::EmergencyStop => "emergency stop",
    }
}

#[test]
fn every_fault_has_the_reactions_that_its_row_in_the_safety_document_has() {
    let document = include_str!("../../../../../docs/safety.md");
    for fault in Fault::ALL {
        let name = serde_json::to_value(fault).unwrap();
        let begin = format!("| `{}` | ", name.as_str().unwrap());
        let row = document.lines().find_map(|line| line.strip_prefix(&begin));
        let row = row.unwrap_or_else(|| panic!("no row {begin}"));
        // What comes with time stands behind a semicolon.
        let decided =
            row.split(" | ").skip(1).map(|cell| cell.split([';', '|']).next().unwrap().trim());
        let reactions = [Pilot::Controller, Pilot::Person].map(|by| word(fault.reaction(by)));
        assert_eq!(decided.collect::<Vec<_>>(), reactions, "{fault:?}");
    }
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
fn a_fault_that_ends_a_flight_early_names_its_likely_causes() {
    for fault in Fault::ALL {
        let ends =
            fault.reaction(Pilot::Controller) >= Reaction::BrakeAndLand && fault.ends_early();
        let is_plain = [Fault::BatteryCritical, Fault::OperatorEmergencyStop].contains(fault);
        assert!(!ends || is_plain || fault.likely_causes().is_some(), "{fault:?}");
    }
}
