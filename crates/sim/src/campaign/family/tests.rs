//! Draws of the families.

use super::*;

#[test]
fn every_family_draws_valid_values_and_the_same_ones_for_a_seed() {
    let sim = crate::settings(None).unwrap();
    for family in Family::value_variants().iter().copied() {
        for seed in 0..50 {
            let drawn = draw(seed, &sim, Some(family));
            assert_eq!(drawn, draw(seed, &sim, Some(family)));
            assert_eq!(drawn.families, [family]);
            assert!(drawn.sim != sim, "{family:?} changes nothing");
            let is_silent =
                drawn.sim.faults.iter().any(|entry| entry.fault == InjectedFault::MocapSilent);
            assert_eq!(is_silent, family == Family::Silent, "{family:?} has no fault of its own");
            crate::World::new(&drawn.sim, seed).unwrap();
        }
    }
}

#[test]
fn all_families_are_drawn_together() {
    let sim = crate::settings(None).unwrap();
    let mut seen = std::collections::BTreeSet::new();
    for seed in 0..2_000 {
        let drawn = draw(seed, &sim, None);
        assert!(drawn.families.iter().any(|family| !family.is_lasting()));
        seen.extend(drawn.families);
    }
    assert_eq!(seen.len(), Family::value_variants().len(), "{seen:?}");
}

#[test]
fn the_families_that_last_for_the_flight_are_the_last_ones() {
    let lasting = [
        Family::NoEmergency,
        Family::LandingKeepsSticks,
        Family::LandUnheard,
        Family::LandingCancelled,
        Family::FlyingFlag,
        Family::Velocity,
        Family::Height,
        Family::NoAutoLand,
        Family::HeldOutages,
        Family::AlreadyFlying,
        Family::FrameTurned,
        Family::FrameMirrored,
        Family::FrameScaled,
        Family::HeadingTurned,
        Family::HeadingReport,
    ];
    let of_all = Family::value_variants().iter().copied().filter(|family| family.is_lasting());
    assert!(of_all.eq(lasting));
}
