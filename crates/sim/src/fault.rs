//! Faults on order.
//!
//! Owns the faults that a test or a user switches on, by script or live, beside those that happen by
//! chance, and since when each is there. What a fault does stands where it acts: [`crate::mocap`],
//! `distortion`, `frame_lag`, `world` and `wire`. Which values a fault may have is `fault/limits.rs`.

mod limits;

use horizon_model::rows::{Pose, stick};
use horizon_model::setting::{SettingError, not_negative, positive};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::DT_S;

/// Something that breaks. Those with values act by their size; "at the onset" is when the fault begins.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum InjectedFault {
    /// The cameras do not see the drone: its pose is reported as lost.
    MocapLost,
    /// The pose stream is silent.
    MocapSilent,
    /// A fixed wrong pose: another object is taken for the drone.
    #[serde(alias = "mocap_ghost")]
    MocapFixed,
    /// The pose stream repeats its last pose.
    MocapFrozen,
    /// The pose is not a number.
    MocapNan,
    /// The pose is 10 m away, along x.
    MocapFar,
    /// The pose is 3 m away, along x.
    MocapAside,
    /// The heading is the opposite one.
    MocapFlipped,
    /// The position comes in millimetres.
    MocapMillimetres,
    /// Only another object is seen.
    MocapOther,
    /// Another object that stands still is taken for the drone, with measurement noise.
    MocapStill {
        /// From the true position at the onset to the object, world frame. m
        #[serde(rename = "offset_m")]
        offset_w_m: [f64; 3],
        /// From the true heading at the onset to that of the object. rad
        turn_rad: f64,
        /// Standard deviation of each coordinate. m
        noise_m: f64,
        /// Standard deviation of the heading. rad
        noise_rad: f64,
    },
    /// The object is found in two places: in some frames another object at rest is taken for the drone.
    MocapSplit {
        /// From the true position at the onset to the other object, world frame. m
        #[serde(rename = "offset_m")]
        offset_w_m: [f64; 3],
        /// Fraction of the frames, drawn one by one, that show the other object. 1
        fraction: f64,
    },
    /// Every position is off by the same way, as of a rigid body of which markers were swapped.
    MocapShifted {
        /// Added to the true position, world frame. m
        #[serde(rename = "offset_m")]
        offset_w_m: [f64; 3],
    },
    /// Some coordinates of the position are stuck, the others are right.
    MocapAxesStuck {
        /// Whether x, y, z stay at their true values of the onset.
        axes: [bool; 3],
        /// Standard deviation of a coordinate that is stuck. m
        noise_m: f64,
    },
    /// Another object that moves on a circle, such as a person with the markers, is taken for the drone.
    MocapWalker {
        /// From the true position at the onset to the object at the onset, world frame. m
        #[serde(rename = "offset_m")]
        offset_w_m: [f64; 3],
        /// Radius of the circle, counter-clockwise. m, > 0
        radius_m: f64,
        /// Speed along the circle. m/s
        speed_mps: f64,
        /// Standard deviation of each coordinate. m
        noise_m: f64,
        /// Standard deviation of the heading. rad
        noise_rad: f64,
    },
    /// A velocity is added to the pose, integrated from the onset.
    MocapDrift {
        /// World x, y, z. m/s
        #[serde(rename = "velocity_mps")]
        velocity_w_mps: [f64; 3],
        /// Heading. rad/s
        yaw_radps: f64,
    },
    /// The world frame is set up differently: mirrored, scaled, then turned, about the origin.
    MocapFrame {
        /// Angle about z, of position and heading. rad
        turn_rad: f64,
        /// Whether y and heading have the other sign.
        is_mirrored: bool,
        /// Factor of the position. 1, > 0
        scale: f64,
    },
    /// The heading is turned and the position is right: the body was defined turned, or is redefined.
    MocapHeading {
        /// Added to the heading. rad
        turn_rad: f64,
    },
    /// Normal noise whose standard deviation grows from the onset.
    MocapNoise {
        /// Growth for each coordinate. m/s
        growth_mps: f64,
        /// Growth for the heading. rad/s
        growth_radps: f64,
    },
    /// The object is lost again and again.
    MocapOccluded {
        /// From one outage to the next. s, > 0
        period_s: f64,
        /// Length of each outage. s, > 0
        lost_s: f64,
    },
    /// Frames of the mocap arrive late. After the fault all frames in transit arrive at once.
    MocapLag {
        /// Age on arrival. s
        delay_s: f64,
    },
    /// Frames of the mocap arrive later and later.
    MocapLagRamp {
        /// Growth of the age. s/s
        growth: f64,
    },
    /// The connection to the mocap is slow: what it cannot carry waits.
    MocapSlowLink {
        /// Bytes of the text relay that pass. 1/s, > 0
        bytes_per_s: f64,
    },
    /// The drone hears nothing: neither sticks nor orders.
    DroneDeaf,
    /// The drone reports nothing.
    DroneMute,
    /// The drone executes orders, and its sticks stay as they are.
    DroneSticksStuck,
    /// The drone refuses to land.
    DroneRefusesLand,
    /// The drone starts anew: for the time of the fault it neither hears nor reports and its sticks are
    /// level; afterwards it knows no host until one asks for a connection.
    DroneReboot {
        /// Whether the motors stop in the air.
        falls: bool,
    },
    /// The drone is held where it was at the onset, as by a hand or in a net; its own sensors show it.
    DroneHeld {
        /// Amplitude with which the hand sways in x, y and z. m
        sway_m: f64,
        /// By how much the hand lowers it first, at 0.5 m/s. m
        #[serde(default)]
        lowered_m: f64,
    },
    /// The drone is carried on with a velocity beside the one that it flies with, as by a gust that its own velocity
    /// control does not balance; its own sensors show it.
    DronePushed {
        /// World x, y, z. m/s
        #[serde(rename = "velocity_mps")]
        velocity_w_mps: [f64; 3],
    },
    /// Another controller sends its sticks to the drone, which follows the newest packet.
    SecondController {
        /// Roll, pitch, yaw, throttle. 1, -1..=1
        sticks: [f64; stick::COUNT],
        /// Packets per second; at 50 none of ours acts. Hz, > 0, <= 50
        rate_hz: f64,
    },
    /// The control loop of the program stands still, the thread of its sockets does not. In virtual time
    /// only.
    ControlStalled,
}

/// A fault with its onset and duration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScriptedFault {
    /// Kind and size of the fault.
    pub fault: InjectedFault,
    /// Onset, since the start of the simulation. s, >= 0
    pub from_s: f64,
    /// Duration. s, > 0
    pub for_s: f64,
}

/// A fault that is present, as it began.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Present {
    pub(crate) fault: InjectedFault,
    /// Since the onset. s
    pub(crate) elapsed_s: f64,
    /// True pose at the onset, world frame. m and rad
    pub(crate) pose_onset: Pose,
}

/// The faults of a world: those of its script and those switched on by hand.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Faults {
    entries: Vec<Entry>,
}

#[derive(Debug, Clone, PartialEq)]
struct Entry {
    fault: InjectedFault,
    /// From first to last, without the last; all times for one that is switched on by hand. s
    from_s: f64,
    until_s: f64,
    /// Step and true pose in which it was first seen to be present.
    onset: Option<(u64, Pose)>,
}

impl Faults {
    /// The faults of `script`; they may overlap.
    ///
    /// # Errors
    /// A time that is negative or not finite, no duration, or a value of a fault that breaks its rule.
    pub fn new(script: Vec<ScriptedFault>) -> Result<Self, SettingError> {
        for (i, entry) in script.iter().enumerate() {
            not_negative(&format!("faults[{i}].from_s"), entry.from_s)?;
            positive(&format!("faults[{i}].for_s"), entry.for_s)?;
            entry.fault.check().map_err(|error| error.under(&format!("faults[{i}].fault")))?;
        }
        let entries = script.into_iter().map(|ScriptedFault { fault, from_s, for_s }| Entry {
            fault,
            from_s,
            until_s: from_s + for_s,
            onset: None,
        });
        Ok(Self { entries: entries.collect() })
    }

    /// Switches a fault on or off, beside the script.
    pub fn set(&mut self, fault: InjectedFault, is_on: bool) {
        self.entries.retain(|entry| !(entry.is_by_hand() && entry.fault == fault));
        if is_on {
            let (from_s, until_s) = (f64::NEG_INFINITY, f64::INFINITY);
            self.entries.push(Entry { fault, from_s, until_s, onset: None });
        }
    }

    /// Whether `fault`, with these values, is present in `step`.
    pub fn is_on(&self, fault: InjectedFault, step: u64) -> bool {
        self.entries.iter().any(|entry| entry.fault == fault && entry.is_on(step))
    }

    /// Notes which faults begin in `step`, and where the drone truly is then.
    pub(crate) fn begin(&mut self, step: u64, truth: &Pose) {
        for entry in &mut self.entries {
            entry.onset = entry.is_on(step).then(|| entry.onset.unwrap_or((step, *truth)));
        }
    }

    /// The faults that are present in `step`, in the order of the script; those that begin in it once
    /// [`Faults::begin`] was called.
    pub(crate) fn present(&self, step: u64) -> impl Iterator<Item = Present> {
        self.entries.iter().filter(move |entry| entry.is_on(step)).filter_map(move |entry| {
            let (since, pose_onset) = entry.onset?;
            let elapsed_s = step.saturating_sub(since) as f64 * DT_S;
            Some(Present { fault: entry.fault, elapsed_s, pose_onset })
        })
    }
}

impl Entry {
    fn is_by_hand(&self) -> bool {
        self.until_s.is_infinite()
    }

    fn is_on(&self, step: u64) -> bool {
        // The middle of the step: a time that is a whole number of steps up to rounding stays one.
        let now_s = (step as f64 + 0.5) * DT_S;
        (self.from_s..self.until_s).contains(&now_s)
    }
}

#[cfg(test)]
mod tests;
