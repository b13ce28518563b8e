//! The last code before the wire: limits and freshness, nothing of control.
//!
//! Owns [`Approved`], which only this module can make; in a flight no other stick value reaches the socket. The
//! checks of `bench`, with a person beside the drone, send their own. It knows no model, no estimate and no clock.

use horizon_model::rows::{Sticks, stick};
use horizon_model::setting::{SettingError, in_range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::drone::Protocol;

/// Deflection from which on all sticks together, pitch back, throttle down, roll and yaw to either side, count as the
/// gesture that stops the motors. The known gesture is full deflection; 0.75 leaves a margin. 1
const GESTURE: f64 = 0.75;

/// Deflection of yaw that is sent in place of the gesture's. 1
const YAW_BESIDE_GESTURE: f64 = 0.5;

/// Limits of the gate, as written in JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GateTable {
    /// Largest deflection of each stick. 1, 0..=1
    pub stick_max: f64,
    /// Age beyond which a pose is too old to steer by. s, 0.01..=2
    pub stale_s: f64,
}

/// Lets sticks pass that are within their limits and rest on a fresh pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Gate {
    /// Deflection from neutral to full. Steps of the wire
    steps_full: f64,
    /// Largest deflection that goes out. Whole steps of the wire
    steps_max: f64,
    /// Largest deflection that is not refused, rounded to a step of the wire: `steps_max`, or one more. Steps of the
    /// wire
    steps_accepted: f64,
    /// Age beyond which a pose is too old to steer by. s
    stale_s: f64,
}

/// Sticks that passed the gate; in a flight nothing else reaches the socket. By default neutral.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Approved(Sticks);

impl Gate {
    /// A gate with these limits for sticks that go out in `protocol`.
    ///
    /// # Errors
    /// `stick_max` outside 0..=1, `stale_s` outside 0.01..=2.
    pub fn new(table: &GateTable, protocol: Protocol) -> Result<Self, SettingError> {
        let stick_max = in_range("stick_max", table.stick_max, 0.0..=1.0)?;
        let stale_s = in_range("stale_s", table.stale_s, 0.01..=2.0)?;
        let steps_full = f64::from(protocol.stick_steps());
        let limit = steps_full * stick_max;
        // 0.29 of 100 steps is below 29 by a rounding error.
        let steps_max = (limit + 1e-9).floor();
        Ok(Self { steps_full, steps_max, steps_accepted: limit.round(), stale_s })
    }

    /// `u_proposed` as the wire carries it, or neutral sticks if a row is not finite or over its limit,
    /// or if the pose is absent or stale.
    ///
    /// A value over the limit means that control is wrong, so it is refused and not cut off. The limit is checked
    /// after rounding to a step of the wire: a solver may leave its bound by a rounding error. A limit between two
    /// steps is sent as the lower one. Of sticks that are each within it and together the gesture that stops the
    /// motors, yaw is cut to 0.5. The age may be negative by as much as it may be positive: a pose can arrive between
    /// the due time of a tick and the tick.
    ///
    /// Real time: no allocation, constant cost.
    pub fn pass(&self, u_proposed: &Sticks, pose_age_s: Option<f64>) -> Approved {
        // Comparisons are false for NaN.
        let is_fresh = pose_age_s.is_some_and(|age_s| age_s.abs() <= self.stale_s);
        if is_fresh { self.pass_manual(u_proposed) } else { Approved::neutral() }
    }

    /// The sticks of a person as the wire carries them, or neutral sticks if a row is not finite or
    /// over its limit; never the gesture that stops the motors. A person sees the vehicle and needs no pose.
    ///
    /// Real time: no allocation, constant cost.
    pub(crate) fn pass_manual(&self, u_hand: &Sticks) -> Approved {
        let steps = u_hand.map(|u| (u * self.steps_full).round());
        // Comparisons are false for NaN.
        let is_within = steps.iter().all(|steps| steps.abs() <= self.steps_accepted);
        let on_wire = steps.map(|steps| {
            // Adding zero turns -0 into 0.
            steps.clamp(-self.steps_max, self.steps_max) / self.steps_full + 0.0
        });
        if is_within { Approved(without_gesture(on_wire)) } else { Approved::neutral() }
    }
}

impl Approved {
    /// All sticks at rest: always allowed.
    ///
    /// Real time: no allocation, constant cost.
    pub fn neutral() -> Self {
        Self(Sticks::zeros())
    }

    /// The sticks, each row a whole number of steps of the wire: 1/660, in the text SDK 1/100.
    ///
    /// Real time: no allocation, constant cost.
    pub fn sticks(&self) -> Sticks {
        self.0
    }
}

/// `u`, with less yaw if it is the gesture that stops the motors.
fn without_gesture(mut u: Sticks) -> Sticks {
    let is_gesture = u[stick::PITCH] <= -GESTURE
        && u[stick::THROTTLE] <= -GESTURE
        && u[stick::ROLL].abs() >= GESTURE
        && u[stick::YAW].abs() >= GESTURE;
    if is_gesture {
        u[stick::YAW] = YAW_BESIDE_GESTURE.copysign(u[stick::YAW]);
    }
    u
}

#[cfg(test)]
mod tests;
