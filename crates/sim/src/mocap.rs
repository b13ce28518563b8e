//! Measurement of the true pose by the motion capture.
//!
//! Owns noise, stalls, lost poses and heading flips with the rates and lengths counted in real
//! recordings of the thesis. Each kind of fault is a small state machine with its own random
//! stream. The bytes of the protocols are `tello_io::mocap`'s.

use std::f64::consts::PI;

use horizon_model::angle;
use horizon_model::rows::{Pose, pose};
use tello_io::mocap::Body;

use crate::profile::Profile;
use crate::random::{Purpose, Random};

/// Report of the stream about one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MocapReport {
    /// A pose, true or not; heading in `(-pi, pi]`.
    Pose(Pose),
    /// The object was not seen.
    Lost,
    /// Nothing was sent.
    Silent,
}

/// One frame of the motion capture, before it becomes bytes of one protocol or another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MocapFrame<'a> {
    /// Number of the frame.
    pub number: u32,
    /// Frames per second. Hz
    pub rate_hz: f64,
    /// Name of the object that this frame is of.
    pub object: &'a str,
    /// The object, by the same name; `None` if it is not seen.
    pub body: Option<Body<'a>>,
}

/// Probabilities per step that has no such fault yet, 1, and scales of the noise.
#[derive(Debug, Clone, Copy)]
struct Rates {
    short_stall: f64,
    long_stall: f64,
    zero: f64,
    flip: f64,
    /// Scale of Student's t. m
    noise_m: f64,
    /// Scale of Student's t. rad
    noise_rad: f64,
}

const TYPICAL: Rates = Rates {
    short_stall: 0.06,
    long_stall: 0.003,
    zero: 0.002,
    flip: 0.006,
    noise_m: 0.3e-3,
    noise_rad: 3e-3,
};

const GOOD_DAY: Rates = Rates { short_stall: 0.01, long_stall: 0.0, zero: 1e-4, ..TYPICAL };

/// Fractions of repeated and lost samples: `docs/benchmarks/2026-11-23-recordings`.
///
/// From 214 short and 23 long stalls, 19 losses and 22 flips per minute of the identification flights,
/// divided by the fraction of steps that are free to begin one (0.79, 0.98, 0.96). The noise's robust
/// deviations, 0.42 mm and 4.1 mrad, are 1.134 times the scale of a Student t with 3 degrees.
const BAD_DAY: Rates = Rates {
    short_stall: 0.090,
    long_stall: 0.0097,
    zero: 0.0065,
    flip: 0.0076,
    noise_m: 0.37e-3,
    noise_rad: 3.6e-3,
};

/// Fractions of short stalls of 1, 2, .. steps. 1
const SHORT_STALL_FRACTIONS: [f64; 5] = [0.75, 0.16, 0.045, 0.03, 0.015];
/// Long stalls: fraction, shortest and longest. They cluster at the retransmission times of TCP. 1, steps, steps
const LONG_STALLS: [(f64, u32, u32); 4] =
    [(0.40, 6, 13), (0.40, 14, 17), (0.13, 19, 27), (0.07, 44, 46)];
/// Fraction of lost poses that last one step, and the mean of what exceeds two steps in the others, in steps.
const ZERO_LENGTH: (f64, f64) = (0.70, 5.0);
/// Fraction of heading flips that last one step, and the mean of what exceeds two steps in the others, in steps.
const FLIP_LENGTH: (f64, f64) = (0.45, 6.0);
/// Smallest heading flip; the largest is half a turn. rad
const FLIP_MIN_RAD: f64 = 0.3;
/// The constant pose that another object was once reported at for thousands of samples. m, rad
const FIXED_POSE: [f64; pose::COUNT] = [3.46, 2.86, 0.37, 0.0];

/// State of the measurement faults, advanced once per step.
#[derive(Debug, Clone)]
pub struct Mocap {
    /// None of a stream without faults and noise.
    rates: Option<Rates>,
    stall: Episode,
    zero: Episode,
    flip: Episode,
    flip_rad: f64,
    noise: Random,
}

/// A fault that begins by chance and lasts some steps.
#[derive(Debug, Clone)]
struct Episode {
    random: Random,
    steps_left: u32,
}

impl Mocap {
    /// A stream without a fault in progress.
    pub fn new(profile: Profile, seed: u64) -> Self {
        Self {
            rates: match profile {
                Profile::Clean => None,
                Profile::GoodDay | Profile::MildOutages | Profile::Outages => Some(GOOD_DAY),
                Profile::Typical => Some(TYPICAL),
                Profile::BadDay => Some(BAD_DAY),
            },
            stall: Episode::new(seed, Purpose::Stall),
            zero: Episode::new(seed, Purpose::Zero),
            flip: Episode::new(seed, Purpose::Flip),
            flip_rad: 0.0,
            noise: Random::new(seed, Purpose::Noise),
        }
    }

    /// The report about the true pose `truth` of one step: world frame, m and rad.
    ///
    /// A stall hides a loss, a loss hides a flip. After a stall the stream is current at once. Every
    /// kind draws from its own random stream whatever the others do, so that switching one off leaves the
    /// others as they were. No allocation, constant cost.
    pub fn observe(&mut self, truth: &Pose) -> MocapReport {
        let Some(rates) = self.rates else { return MocapReport::Pose(reported(*truth)) };
        let is_stalled = self.stall.step(|random| stall_steps(random, &rates));
        let is_lost = self.zero.step(|random| episode_steps(random, rates.zero, ZERO_LENGTH));
        let flip_rad = &mut self.flip_rad;
        let is_flipped = self.flip.step(|random| {
            let steps = episode_steps(random, rates.flip, FLIP_LENGTH)?;
            let size_rad = random.between(FLIP_MIN_RAD, PI);
            *flip_rad = if random.chance(0.5) { size_rad } else { -size_rad };
            Some(steps)
        });

        let mut o = *truth;
        o[pose::X] += rates.noise_m * self.noise.student_t3();
        o[pose::Y] += rates.noise_m * self.noise.student_t3();
        o[pose::Z] += rates.noise_m * self.noise.student_t3();
        o[pose::THETA] += rates.noise_rad * self.noise.student_t3();
        if is_flipped {
            o[pose::THETA] += self.flip_rad;
        }
        let o = reported(o);
        if is_stalled {
            MocapReport::Silent
        } else if is_lost {
            MocapReport::Lost
        } else {
            MocapReport::Pose(o)
        }
    }

    /// The report while another object is taken for the drone.
    pub fn fixed() -> MocapReport {
        MocapReport::Pose(Pose::from(FIXED_POSE))
    }
}

impl Episode {
    fn new(seed: u64, purpose: Purpose) -> Self {
        Self { random: Random::new(seed, purpose), steps_left: 0 }
    }

    /// Whether the fault is present in this step; `begin` decides in a free step how long one that
    /// begins here lasts.
    fn step(&mut self, begin: impl FnOnce(&mut Random) -> Option<u32>) -> bool {
        if self.steps_left == 0 {
            self.steps_left = begin(&mut self.random).unwrap_or(0);
        }
        let is_present = self.steps_left > 0;
        self.steps_left = self.steps_left.saturating_sub(1);
        is_present
    }
}

/// `o` with the heading in the stream's interval, which is open below, that of `wrap` above.
pub(crate) fn reported(mut o: Pose) -> Pose {
    o[pose::THETA] = -angle::wrap(-o[pose::THETA]);
    o
}

/// Length of a stall that begins in this step, if one does.
fn stall_steps(random: &mut Random, rates: &Rates) -> Option<u32> {
    if random.chance(rates.long_stall) {
        let mut left = random.uniform();
        for (fraction, shortest, longest) in LONG_STALLS {
            if left < fraction {
                return Some(
                    shortest + whole(random.between(0.0, f64::from(longest - shortest + 1))),
                );
            }
            left -= fraction;
        }
    } else if random.chance(rates.short_stall) {
        let mut left = random.uniform();
        for (fraction, steps) in SHORT_STALL_FRACTIONS.into_iter().zip(1..) {
            if left < fraction {
                return Some(steps);
            }
            left -= fraction;
        }
    }
    // Nothing began, or rounding of the fractions left a sliver above their sum.
    None
}

/// Length of a loss or flip that begins in this step, if one does: one step, or two and more.
fn episode_steps(
    random: &mut Random,
    probability: f64,
    (single_fraction, tail_mean): (f64, f64),
) -> Option<u32> {
    if !random.chance(probability) {
        return None;
    }
    let is_single = random.chance(single_fraction);
    Some(if is_single { 1 } else { 2 + whole(random.exponential(tail_mean).round()) })
}

/// A small non-negative number without its fraction.
fn whole(value: f64) -> u32 {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0..1000")]
    let whole = value as u32;
    whole
}

#[cfg(test)]
mod tests;
