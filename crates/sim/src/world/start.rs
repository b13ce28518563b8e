//! Where a simulated flight starts, and how starts vary between flights.

use horizon_model::rows::{Pose, pose};
use horizon_model::setting::{SettingError, finite, positive};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::drone::DronePhase;
use crate::plant::{STANDING_M, Velocity};
use crate::random::Random;

/// Where a flight starts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SimStart {
    /// Standing on the floor.
    Ground {
        /// World x. m
        x: f64,
        /// World y. m
        y: f64,
        /// Measured yaw. rad
        theta: f64,
    },
    /// In flight, near the first target.
    Air {
        /// World x of the target. m
        x: f64,
        /// World y of the target. m
        y: f64,
        /// Height of the target. m, > 0
        z: f64,
        /// Measured yaw of the target. rad
        theta: f64,
    },
}

/// How the valid flights of the thesis were handed over to the controller, relative to the first
/// target: mean and deviation.
mod scatter {
    /// Horizontal position, per axis. m
    pub(super) const XY_M: (f64, f64) = (0.0, 0.10);
    /// Height. m
    pub(super) const Z_M: (f64, f64) = (-0.08, 0.03);
    /// Heading. rad
    pub(super) const THETA_RAD: (f64, f64) = (0.03, 0.05);
    /// Horizontal velocity, per axis. m/s
    pub(super) const VELOCITY_MPS: (f64, f64) = (0.0, 0.16);
}

impl SimStart {
    /// # Errors
    /// A place that is not finite, a target on the floor or below it.
    pub(super) fn check(self) -> Result<(), SettingError> {
        let (Self::Ground { x, y, theta } | Self::Air { x, y, theta, .. }) = self;
        for (key, value) in [("x", x), ("y", y), ("theta", theta)] {
            finite(key, value)?;
        }
        if let Self::Air { z, .. } = self {
            positive("z", z)?;
        }
        Ok(())
    }

    /// Phase, pose and velocity, exactly as given and at rest.
    pub(super) fn exact(self) -> (DronePhase, Pose, Velocity) {
        let rest = Velocity::default();
        match self {
            Self::Ground { x, y, theta } => {
                (DronePhase::Grounded, Pose::new(x, y, STANDING_M, theta), rest)
            }
            Self::Air { x, y, z, theta } => (DronePhase::Flying, Pose::new(x, y, z, theta), rest),
        }
    }

    /// Phase, pose and velocity as they vary between flights. A drone on the floor stands where it
    /// was put.
    pub(super) fn draw(self, random: &mut Random) -> (DronePhase, Pose, Velocity) {
        let (phase, mut at, mut velocity) = self.exact();
        if phase == DronePhase::Flying {
            let mut draw = |(mean, sd): (f64, f64)| mean + sd * random.normal();
            at[pose::X] += draw(scatter::XY_M);
            at[pose::Y] += draw(scatter::XY_M);
            at[pose::Z] = (at[pose::Z] + draw(scatter::Z_M)).max(STANDING_M);
            at[pose::THETA] += draw(scatter::THETA_RAD);
            velocity.x_mps = draw(scatter::VELOCITY_MPS);
            velocity.y_mps = draw(scatter::VELOCITY_MPS);
        }
        (phase, at, velocity)
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::check::amax;

    use super::*;
    use crate::random::Purpose;

    #[test]
    fn a_drone_stands_where_it_was_put_and_one_in_the_air_begins_around_its_target() {
        const FLIGHTS: u32 = 2000;
        let mut random = Random::new(1, Purpose::Start);
        let ground = SimStart::Ground { x: 1.0, y: -2.0, theta: 0.5 };
        assert_eq!(ground.draw(&mut random), ground.exact());
        let air = SimStart::Air { x: 1.0, y: -2.0, z: 1.3, theta: 0.5 };
        let (mut mean, mut speed_mps) = (Pose::zeros(), 0.0);
        for _ in 0..FLIGHTS {
            let (phase, at, velocity) = air.draw(&mut random);
            assert_eq!(phase, DronePhase::Flying);
            mean += at / f64::from(FLIGHTS);
            speed_mps += velocity.x_mps.abs() / f64::from(FLIGHTS);
        }
        assert!(amax(&(mean - Pose::new(1.0, -2.0, 1.22, 0.53))) < 0.01, "{mean}");
        // The mean of |v| is sqrt(2 / pi) of its deviation.
        assert!((speed_mps - 0.8 * 0.16).abs() < 0.01, "{speed_mps}");
        let low = SimStart::Air { x: 0.0, y: 0.0, z: 0.05, theta: 0.0 };
        assert!((0..20).all(|_| low.draw(&mut random).1[pose::Z] >= STANDING_M));
    }
}
