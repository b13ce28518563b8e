//! Manual flights for identification, flown by a simulated pilot.
//!
//! Owns the pilot: keys pressed and released on all four axes as in the recorded identification
//! flights, and the wish to stay in the room. Vehicle, link and motion capture are those of the other
//! simulated flights. What is identified from such a flight, and how, is not known here.

use horizon_model::rows::{Pose, Sticks, pose, stick};
use horizon_model::setting::SettingError;

use crate::DT_S;
use crate::command_link::CommandLink;
use crate::mocap::{Mocap, MocapReport};
use crate::plant::{Plant, PlantParams, Velocity};
use crate::profile::Profile;
use crate::random::{Purpose, Random};

/// Fraction of the way to its key that a stick covers in one step: the sticks of the recorded flights
/// are key presses smoothed by exactly this much. 1
const STICK_RATE: f64 = 0.015;

/// How a pilot uses the keys of one axis.
#[derive(Debug, Clone, Copy)]
struct Habit {
    /// Shortest and longest press. s
    press_s: (f64, f64),
    /// Mean time between presses. s
    pause_s: f64,
}

/// From 585 presses in the six recorded flights: medians of 0.4 to 1.5 s, means of the pauses between
/// 1 and 10 s. The rarely used axes are used a little more often here.
const HABITS: [Habit; stick::COUNT] = {
    let mut habits = [Habit { press_s: (0.3, 1.8), pause_s: 2.0 }; stick::COUNT];
    habits[stick::ROLL].pause_s = 3.0;
    habits[stick::THROTTLE] = Habit { press_s: (0.2, 1.2), pause_s: 3.0 };
    habits
};

/// How far ahead the pilot looks: about what dead time, lag and the smoothing of the sticks add up to.
/// s
const LOOK_AHEAD_S: f64 = 1.5;
/// Height that the pilot returns to. m
const HEIGHT_M: f64 = 1.6;
/// How far from the middle the pilot lets the vehicle go, horizontally and vertically. m
const RANGE_H_M: f64 = 1.0;
const RANGE_V_M: f64 = 0.1;

/// A recorded manual flight and what was true in it. All vectors have one entry per step.
#[derive(Debug, Clone, PartialEq)]
pub struct ManualFlight {
    /// Sticks sent in the step. 1
    pub u_sent: Vec<Sticks>,
    /// The report of the motion capture at the beginning of the step.
    pub reports: Vec<MocapReport>,
    /// True pose at the beginning of the step; the heading is continuous. m, rad
    pub truth: Vec<Pose>,
    /// Whether the sticks of the step reached the vehicle.
    pub link_is_up: Vec<bool>,
}

impl ManualFlight {
    /// Flies the vehicle `params` for `steps` steps of [`DT_S`], from rest in the middle of the room.
    ///
    /// `profile` decides about noise, stalls, losses and flips of the motion capture and about lost
    /// commands; `seed` about everything that happens by chance.
    ///
    /// # Errors
    /// A dead time that the vehicle's FIFO refuses.
    pub fn fly(
        params: &PlantParams,
        profile: Profile,
        seed: u64,
        steps: usize,
    ) -> Result<Self, SettingError> {
        let mut start = Pose::zeros();
        start[pose::Z] = HEIGHT_M;
        let mut plant = Plant::new(*params, start, Velocity::default(), seed)?;
        let mut mocap = Mocap::new(profile, seed);
        let mut link = CommandLink::new(profile, seed);
        let mut pilot = ExcitationPilot::new(seed);
        let mut flight = Self {
            u_sent: Vec::with_capacity(steps),
            reports: Vec::with_capacity(steps),
            truth: Vec::with_capacity(steps),
            link_is_up: Vec::with_capacity(steps),
        };
        for _ in 0..steps {
            let u_sent = pilot.steer(plant.pose(), plant.velocity());
            let link_is_up = link.step();
            flight.u_sent.push(u_sent);
            flight.reports.push(mocap.observe(plant.pose()));
            flight.truth.push(*plant.pose());
            flight.link_is_up.push(link_is_up);
            plant.step(&u_sent, link_is_up);
        }
        Ok(flight)
    }
}

/// Four keys, smoothed to sticks.
#[derive(Debug, Clone)]
struct ExcitationPilot {
    random: Random,
    /// Pressed direction of each axis: -1, 0 or 1.
    keys: Sticks,
    /// Time until the key of each axis is pressed or released. s
    remaining_s: Sticks,
    sticks: Sticks,
}

impl ExcitationPilot {
    fn new(seed: u64) -> Self {
        let mut random = Random::new(seed, Purpose::Pilot);
        let remaining_s = Sticks::from_fn(|axis, _| random.exponential(HABITS[axis].pause_s));
        Self { random, keys: Sticks::zeros(), remaining_s, sticks: Sticks::zeros() }
    }

    /// The sticks of one step. The pilot sees where the vehicle really is.
    fn steer(&mut self, at: &Pose, velocity: Velocity) -> Sticks {
        for (axis, habit) in HABITS.into_iter().enumerate() {
            self.remaining_s[axis] -= DT_S;
            if self.remaining_s[axis] > 0.0 {
                continue;
            }
            let is_released = self.keys[axis].abs() < 0.5;
            let Habit { press_s: (shortest_s, longest_s), pause_s } = habit;
            (self.keys[axis], self.remaining_s[axis]) = if is_released {
                let at_random = if self.random.chance(0.5) { 1.0 } else { -1.0 };
                let key = homewards(axis, at, velocity).unwrap_or(at_random);
                (key, self.random.between(shortest_s, longest_s))
            } else {
                (0.0, self.random.exponential(pause_s))
            };
        }
        self.sticks += (self.keys - self.sticks) * STICK_RATE;
        self.sticks
    }
}

/// The direction of `axis` that leads back to the middle, if the vehicle is about to leave it.
fn homewards(axis: usize, at: &Pose, velocity: Velocity) -> Option<f64> {
    let x = at[pose::X] + LOOK_AHEAD_S * velocity.x_mps;
    let y = at[pose::Y] + LOOK_AHEAD_S * velocity.y_mps;
    let z = at[pose::Z] + LOOK_AHEAD_S * velocity.z_mps;
    let (sin, cos) = at[pose::THETA].sin_cos();
    let (missing, range) = match axis {
        stick::PITCH => (-(cos * x + sin * y), RANGE_H_M),
        stick::ROLL => (-(sin * x - cos * y), RANGE_H_M),
        stick::THROTTLE => (HEIGHT_M - z, RANGE_V_M),
        _ => return None,
    };
    (missing.abs() > range).then(|| missing.signum())
}

#[cfg(test)]
mod tests {
    use horizon_model::check::maximum;

    use super::*;
    use crate::plant::NOMINAL;

    const STEPS: usize = 6000;

    fn fly(profile: Profile, seed: u64) -> ManualFlight {
        let params = PlantParams::try_from(NOMINAL).unwrap();
        ManualFlight::fly(&params, profile, seed, STEPS).unwrap()
    }

    #[test]
    fn one_seed_is_one_flight() {
        assert_eq!(fly(Profile::Outages, 3), fly(Profile::Outages, 3));
        assert_ne!(fly(Profile::Outages, 3).u_sent, fly(Profile::Outages, 4).u_sent);
    }

    #[test]
    fn every_axis_is_used_as_much_as_by_a_pilot() {
        for seed in 0..10 {
            let flight = fly(Profile::Clean, seed);
            for axis in 0..stick::COUNT {
                let square = flight.u_sent.iter().map(|u| u[axis].powi(2)).sum::<f64>();
                let rms = (square / STEPS as f64).sqrt();
                // The recorded flights have 0.06 to 0.47.
                assert!((0.1..0.5).contains(&rms), "seed {seed}, axis {axis}: rms {rms}");
                let largest = flight.u_sent.iter().map(|u| u[axis].abs()).fold(0.0, maximum);
                assert!((0.4..=1.0).contains(&largest), "seed {seed}, axis {axis}: {largest}");
            }
        }
    }

    #[test]
    fn the_vehicle_stays_in_the_room() {
        for seed in 0..10 {
            for at in fly(Profile::Typical, seed).truth {
                // The recorded flights reach 5.5 m from the middle, and 0.1 m above the floor.
                let distance = at[pose::X].hypot(at[pose::Y]);
                assert!(distance < 6.0, "seed {seed}: {distance} m from the middle");
                // Below 0.28 m the simulated vehicle no longer follows its sticks.
                assert!((0.28..3.0).contains(&at[pose::Z]), "seed {seed}: {} m high", at[pose::Z]);
            }
        }
    }

    #[test]
    fn commands_get_lost_only_on_a_bad_link() {
        assert!(fly(Profile::BadDay, 1).link_is_up.iter().all(|is_up| *is_up));
        let flight = fly(Profile::Outages, 1);
        let down = flight.link_is_up.iter().filter(|is_up| !**is_up).count();
        assert!((300..3000).contains(&down), "{down} of {STEPS} steps lost");
    }
}
