//! Where a simulated flight starts, and how starts vary between flights.

use horizon_model::rows::{Pose, pose};
use horizon_model::setting::{SettingError, finite, positive};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::drone::Phase;
use crate::plant::{STANDING_M, Velocity};
use crate::random::Random;

/// Where a flight starts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Start {
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

impl Start {
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
    pub(super) fn exact(self) -> (Phase, Pose, Velocity) {
        let rest = Velocity::default();
        match self {
            Self::Ground { x, y, theta } => {
                (Phase::Grounded, Pose::new(x, y, STANDING_M, theta), rest)
            }
            Self::Air { x, y, z, theta } => (Phase::Flying, Pose::new(x, y, z, theta), rest),
        }
    }

    /// Phase, pose and velocity as they vary between flights. A drone on the floor stands where it
    /// was put.
    pub(super) fn draw(self, random: &mut Random) -> (Phase, Pose, Velocity) {
        let (phase, mut at, mut velocity) = self.exact();
        if phase == Phase::Flying {
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
