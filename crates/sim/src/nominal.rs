//! A mission flown by a simulated vehicle, without faults, before it is flown in earnest.
//!
//! Owns that flight and its report: whether the plan gets to its end, how long it takes, how near it comes to
//! walls and obstacles. What follows from the path alone is [`tello_flight::Survey`].

use std::fmt::{self, Display, Formatter};

use anyhow::Result;
use schemars::JsonSchema;
use serde::Serialize;
use tello_eval::metrics::LeastClearance;
use tello_flight::cycle::FlightTable;
use tello_flight::{Fault, ObstacleTable, Start};

use crate::batch::{Contender, Ending};
use crate::{Profile, SimTable};

/// Result of a mission in the simulator.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct NominalFlight {
    /// Targets that were reached.
    pub targets_reached: usize,
    /// Targets of the mission.
    pub targets_count: usize,
    /// From the first target to the last by the true pose; null if it was not reached. s
    pub finish_s: Option<f64>,
    /// Horizontal distance to the path that 95 % of the poses are within; null if no target was reached. m
    pub distance_p95_m: Option<f64>,
    /// Least true distances to walls and obstacles that stand.
    pub clearance: LeastClearance,
    /// The faults that ended it, if it landed early.
    pub landed_by: Vec<Fault>,
}

impl NominalFlight {
    /// Flies `flight` from the air with the built-in vehicle, without its faults, spread and noise, and without
    /// obstacles that move: nobody knows where they will be. One result, bit for bit.
    ///
    /// # Errors
    /// A setting that breaks its rule.
    pub fn fly(flight: &FlightTable) -> Result<Self> {
        let mut flight = FlightTable { start: Start::Airborne, ..flight.clone() };
        flight.cycle.obstacles.retain(|one| !matches!(one, ObstacleTable::Moving { .. }));
        // Its disturbance stays: a vehicle that no air moves stands as still as an object that is not it.
        let sim = SimTable {
            profile: Profile::Clean,
            has_spread: false,
            faults: Vec::new(),
            ..crate::settings(None)?
        };
        let contender = Contender::new(flight, None)?;
        let row = contender.fly(&sim, 0)?.row;
        let targets_count = contender.reference.targets_count;
        let is_finished = row.ending == Ending::Finished;
        Ok(Self {
            // Judged by poses, a flight may be over a tick before the controller counts its last target.
            targets_reached: if is_finished { targets_count } else { row.targets_reached },
            targets_count,
            finish_s: row.by_truth.as_ref().and_then(|score| score.metrics.finish_s),
            distance_p95_m: row.by_truth.map(|score| score.metrics.distance_p95_m),
            clearance: row.clearance,
            landed_by: row.landed_by,
        })
    }

    /// Whether it shows that mission, room and obstacles do not go together, whatever the vehicle is.
    pub fn is_blocked(&self) -> bool {
        let is_of_mission = |fault: &Fault| {
            matches!(
                fault,
                Fault::BlockedLong
                    | Fault::PlanBlocked
                    | Fault::ObstacleEntered
                    | Fault::FenceLeft
                    | Fault::MissionOverdue
            )
        };
        !self.is_finished() && self.landed_by.iter().any(is_of_mission)
    }

    /// Whether all targets were reached.
    pub fn is_finished(&self) -> bool {
        self.targets_reached == self.targets_count
    }
}

impl Display for NominalFlight {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let (reached, count) = (self.targets_reached, self.targets_count);
        if !self.is_finished() {
            write!(f, "NOT TO ITS END: {reached} of {count} targets")?;
        } else if let Some(finish_s) = self.finish_s {
            write!(f, "{finish_s:.1} s from first to last target")?;
        } else {
            write!(f, "{count} of {count} targets")?;
        }
        if !self.landed_by.is_empty() {
            let names: Vec<&str> = self.landed_by.iter().copied().map(Fault::name).collect();
            write!(f, ", landed: {}", names.join(", "))?;
        }
        if let Some(distance_m) = self.distance_p95_m {
            write!(f, ", {distance_m:.2} m off at 95 %")?;
        }
        for (what, least_m) in
            [("wall", self.clearance.wall_m), ("obstacle", self.clearance.obstacle_m)]
        {
            if let Some(least_m) = least_m.filter(|least_m| least_m.is_finite()) {
                write!(f, ", {least_m:.2} m to the nearest {what}")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use tello_io::config;

    use super::*;

    /// The built-in flight after a change, in the simulator.
    fn flown(change: impl FnOnce(&mut FlightTable)) -> NominalFlight {
        let (table, mission) = config::fly(None, None).unwrap();
        let mut flight = config::flight(&table, mission, Start::Grounded);
        change(&mut flight);
        NominalFlight::fly(&flight).unwrap()
    }

    #[test]
    fn the_built_in_mission_gets_to_its_end_the_same_way_each_time() {
        let flight = flown(|_| {});
        assert!(flight.is_finished() && flight.landed_by.is_empty(), "{flight:?}");
        assert!(flight.finish_s.is_some() && flight.distance_p95_m.is_some(), "{flight:?}");
        assert!(flight.clearance.wall_m.is_some_and(|wall_m| wall_m > 1.0), "{flight:?}");
        assert_eq!(flight, flown(|_| {}));
        let text = flight.to_string();
        assert!(text.contains("s from first to last target") && text.contains("wall"), "{text}");
    }

    #[test]
    fn a_mission_whose_way_is_closed_is_found_before_it_is_flown() {
        let wall = ObstacleTable::Box { x_m: [-5.0, 5.0], y_m: [-2.3, -2.2], z_m: [-0.2, 3.0] };
        let flight = flown(|flight| flight.cycle.obstacles = vec![wall]);
        assert!(!flight.is_finished() && flight.finish_s.is_none(), "{flight:?}");
        assert_eq!(flight.landed_by, [Fault::BlockedLong], "it stays before the wall: {flight:?}");
        assert!(flight.is_blocked());
        // Another vehicle might do better.
        assert!(
            !NominalFlight { landed_by: vec![Fault::DeadTimeLong], ..flight.clone() }.is_blocked()
        );
        assert!(flight.to_string().starts_with("NOT TO ITS END: 1 of 5 targets"), "{flight}");
        // One that moves is nowhere yet.
        let moving = ObstacleTable::Moving { radius_m: 0.3 };
        assert!(flown(|flight| flight.cycle.obstacles = vec![moving]).is_finished());
    }
}
