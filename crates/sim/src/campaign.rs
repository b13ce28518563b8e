//! Many simulated flights with random faults: is there one that ends badly?
//!
//! Owns the flights and what becomes of all of them. What a seed draws is `campaign/family.rs`, what no
//! flight may do is `campaign/judge.rs`, what each family came to is `campaign/table.rs`.

mod family;
mod judge;
mod table;

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};
use std::ops::Range;

use anyhow::Result;
use horizon_model::check::maximum;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tello_eval::part_file::Seeded;
use tello_eval::rate_interval;
use tello_flight::{FaultSet, Room};

use crate::seeds::fly_each;
use crate::virtual_time::VirtualFlight;
use crate::{DroneTable, ScriptedFault, SimTable};
pub use family::{Draw, Family, draw};
use judge::{End, Judge, MeasuredReaction, TickView, Violation};
use table::FamilyRow;
use tello_flight::cycle::FlightTable;

impl Seeded for CampaignRow {
    fn seed(&self) -> Option<u64> {
        Some(self.seed)
    }
}

/// One flight of a campaign.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CampaignRow {
    pub(crate) seed: u64,
    families: Vec<Family>,
    faults: Vec<ScriptedFault>,
    /// The drone, if a switch differs from the settings.
    drone: Option<DroneTable>,
    end: End,
    /// Furthest outside of the room while the drone executed its orders. m
    excess_m: f64,
    /// From the moment on in which the first fault could be observed; null if the flight was over.
    reaction: Option<MeasuredReaction>,
    violations: Vec<Violation>,
}

/// All flights of a campaign.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Campaign {
    families: Vec<FamilyRow>,
    /// 95 % interval of the fraction of flights with a violation (Wilson). 1
    violations_interval: [f64; 2],
    flights: Vec<CampaignRow>,
}

/// Flies a campaign: one simulated flight per seed, with faults of all families or of `only`. Rows in the order of
/// `seeds`; fewer if `is_interrupted`. `on_flown` is called after every flight.
///
/// Cost: up to 240 s of virtual time per seed, on all threads.
///
/// # Errors
/// A setting that breaks its rule.
pub fn fly(
    flight: &FlightTable,
    sim: &SimTable,
    seeds: Range<u64>,
    only: Option<Family>,
    is_interrupted: &(dyn Fn() -> bool + Sync),
    on_flown: &(dyn Fn() + Sync),
) -> Result<Vec<CampaignRow>> {
    fly_each(seeds, is_interrupted, on_flown, |seed| fly_one(flight, sim, seed, only))
}

impl Campaign {
    /// The campaign of `flights`, in the order of their seeds.
    pub fn of(flights: Vec<CampaignRow>) -> Self {
        let bad = flights.iter().filter(|flight| !flight.violations.is_empty()).count();
        Self {
            families: table::rows(&flights),
            violations_interval: rate_interval(bad, flights.len()),
            flights,
        }
    }

    /// Whether no flight did what none may do.
    pub fn is_clean(&self) -> bool {
        self.flights.iter().all(|flight| flight.violations.is_empty())
    }
}

/// The world of the flight of `seed`: `sim` with the faults that it draws of all families, or of `only`.
pub fn world(seed: u64, sim: &SimTable, only: Option<Family>) -> SimTable {
    draw(seed, sim, only).sim
}

/// The flight of `seed`, from the ground to its end.
fn fly_one(
    flight: &FlightTable,
    settings: &SimTable,
    seed: u64,
    only: Option<Family>,
) -> Result<CampaignRow> {
    let Draw { families, sim, onset_s } = draw(seed, settings, only);
    let room = flight.cycle.supervisor.room.as_ref().map(Room::try_from).transpose()?;
    let mut judge = Judge::new(room, onset_s);
    let mut virtual_flight = VirtualFlight::new(flight, &sim, seed)?.without_plan();
    let mut now_s = 0.0;
    let end = loop {
        let out = virtual_flight.tick()?;
        let (phase, decision) = (out.phase(), out.decision);
        let truth = virtual_flight.truth();
        judge.update(&TickView {
            now_s,
            faults: decision.map_or(FaultSet::default(), |decision| decision.faults),
            wire: virtual_flight.wire(),
            truth,
            ignores: virtual_flight.ignores(),
        });
        if let Some(end) = judge.end(now_s, phase, &truth) {
            break end;
        }
        now_s += flight.cycle.dt_s;
    };
    Ok(CampaignRow {
        seed,
        families,
        faults: sim.faults,
        drone: (sim.drone != settings.drone).then_some(sim.drone),
        end,
        excess_m: judge.excess_m,
        reaction: judge.reaction(),
        violations: judge.violations(end),
    })
}

impl Display for Campaign {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let mut ends: BTreeMap<End, u64> = BTreeMap::new();
        for flight in &self.flights {
            *ends.entry(flight.end).or_default() += 1;
        }
        writeln!(f, "flights       {}", self.flights.len())?;
        for (end, count) in ends {
            writeln!(f, "{count:>13}  {end:?}")?;
        }
        let outside = self.flights.iter().filter(|flight| flight.excess_m > 0.0).count();
        let furthest_m = self.flights.iter().map(|flight| flight.excess_m).fold(0.0, maximum);
        writeln!(
            f,
            "outside       {outside} flights left the room while the drone obeyed, by \
             {furthest_m:.2} m at most"
        )?;
        table::write(&self.families, f)?;
        for flight in self.flights.iter().filter(|flight| !flight.violations.is_empty()) {
            let CampaignRow { seed, families, end, excess_m, violations, .. } = flight;
            writeln!(
                f,
                "seed {seed:<8} {violations:?}, {end:?}, {excess_m:.2} m outside, {families:?}"
            )?;
        }
        let bad = self.flights.iter().filter(|flight| !flight.violations.is_empty()).count();
        let [low, high] = self.violations_interval;
        writeln!(f, "violations    {bad}; {low:.6} to {high:.6} of such flights (95 %, Wilson)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flown(seed: u64, end: End, excess_m: f64, violations: &[Violation]) -> CampaignRow {
        CampaignRow {
            seed,
            families: vec![Family::Lost],
            faults: Vec::new(),
            drone: None,
            end,
            excess_m,
            reaction: None,
            violations: violations.to_vec(),
        }
    }

    #[test]
    fn one_violation_makes_a_campaign_unclean_and_is_shown_with_its_seed() {
        let clean = [flown(3, End::Landed, 0.0, &[]), flown(4, End::StayedDown, 0.25, &[])];
        let campaign = Campaign::of(clean.to_vec());
        assert!(campaign.is_clean() && Campaign::of(Vec::new()).is_clean());
        assert!(campaign.violations_interval[0].abs() < 1e-12, "{campaign:?}");
        let bad = flown(5, End::Undefined, 0.5, &[Violation::NoEnd]);
        let campaign = Campaign::of([&clean[..], &[bad]].concat());
        assert!(!campaign.is_clean());
        let text = campaign.to_string();
        for line in [
            "flights       3",
            "            1  StayedDown",
            "outside       2 flights left the room while the drone obeyed, by 0.50 m at most",
            "seed 5        [NoEnd], Undefined, 0.50 m outside, [Lost]",
            // Wilson's interval of 1 in 3.
            "violations    1; 0.061492 to 0.792340 of such flights (95 %, Wilson)",
        ] {
            assert!(text.lines().any(|shown| shown == line), "{line:?} is not in {text}");
        }
        assert_eq!(campaign.flights.iter().map(|row| row.seed).collect::<Vec<_>>(), [3, 4, 5]);
    }
}
