//! Frames on their way from the cameras to the program.
//!
//! Owns what arrives when: without a fault every frame in the step in which it was taken, with one of
//! the faults of the connection later, in order, with the frame number that it was taken with.

use std::collections::VecDeque;

use horizon_model::rows::{Pose, pose};
use tello_io::mocap::{Body, format_line};

use crate::DT_S;
use crate::fault::{Faults, InjectedFault};
use crate::mocap::MocapFrame;

/// A frame that was taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TakenFrame {
    pub(crate) step: u64,
    /// Whether another object is seen in place of the drone.
    pub(crate) is_other: bool,
    /// World frame, m and rad; `None` if the object is not seen.
    pub(crate) pose: Option<Pose>,
    /// How that pose changes in a step, for frames between two steps. m and rad
    pub(crate) change: Pose,
}

/// Frames in transit, and frames that arrive in the present step.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Lag {
    on_its_way: VecDeque<TakenFrame>,
    arrived: Vec<TakenFrame>,
    /// What a slow link may carry before the next frame. bytes
    credit: f64,
    line: Vec<u8>,
}

impl Lag {
    /// Advances to `step`, in which `taken` was taken; frames of other steps arrive under the name
    /// `object`.
    pub(crate) fn advance(
        &mut self,
        taken: Option<TakenFrame>,
        step: u64,
        faults: &Faults,
        object: &str,
    ) {
        self.arrived.clear();
        self.on_its_way.extend(taken);
        let (mut age_min_s, mut bytes_per_s) = (0.0_f64, f64::INFINITY);
        for present in faults.present(step) {
            match present.fault {
                InjectedFault::MocapLag { delay_s } => age_min_s = age_min_s.max(delay_s),
                InjectedFault::MocapLagRamp { growth } => {
                    age_min_s = age_min_s.max(growth * present.elapsed_s);
                }
                InjectedFault::MocapSlowLink { bytes_per_s: limit } => {
                    bytes_per_s = bytes_per_s.min(limit);
                }
                _ => {}
            }
        }
        self.credit += bytes_per_s * DT_S;
        while let Some(frame) = self.on_its_way.front().copied() {
            // Half a step: a delay of a whole number of steps is that number up to rounding.
            let age_s = (step.saturating_sub(frame.step) as f64 + 0.5) * DT_S;
            let bytes = if bytes_per_s.is_finite() { self.bytes(&frame, object) } else { 0.0 };
            if age_s < age_min_s || self.credit < bytes {
                break;
            }
            self.credit -= bytes;
            self.on_its_way.pop_front();
            self.arrived.push(frame);
        }
        if self.on_its_way.is_empty() || bytes_per_s.is_infinite() {
            // An idle link saves nothing for later.
            self.credit = 0.0;
        }
    }

    /// Frames that arrive in the present step, oldest first.
    pub(crate) fn frames<'a>(&'a self, object: &'a str) -> impl Iterator<Item = MocapFrame<'a>> {
        self.moving(object).map(|(frame, _)| frame)
    }

    /// Frames that arrive in the present step, each with the change of its pose in a step. m, rad
    pub(crate) fn moving<'a>(
        &'a self,
        object: &'a str,
    ) -> impl Iterator<Item = (MocapFrame<'a>, Pose)> {
        self.arrived.iter().map(move |frame| (frame.sent(object), frame.change))
    }

    /// Length of a frame as a line of the text relay.
    fn bytes(&mut self, frame: &TakenFrame, object: &str) -> f64 {
        self.line.clear();
        let MocapFrame { number, rate_hz, object, body } = frame.sent(object);
        format_line(number.into(), rate_hz, object, body.as_ref(), &mut self.line);
        self.line.len() as f64
    }
}

impl TakenFrame {
    /// The frame as sent, under the name `object`. The simulated drone flies level.
    fn sent<'a>(&self, object: &'a str) -> MocapFrame<'a> {
        let object = if self.is_other { "wand" } else { object };
        let body = self.pose.map(|o| Body {
            name: object.as_bytes(),
            pos_v: [o[pose::X], o[pose::Y], o[pose::Z]],
            angles: [0.0, 0.0, o[pose::THETA]],
        });
        // u32 lasts for two years at 50 Hz.
        let number = u32::try_from(self.step).unwrap_or(u32::MAX);
        MocapFrame { number, rate_hz: 1.0 / DT_S, object, body }
    }
}

#[cfg(test)]
mod tests;
