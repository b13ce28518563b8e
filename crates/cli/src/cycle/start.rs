//! Whether the poses on the ground agree, before anything moves.
//!
//! Owns the place where the vehicle stands: a first pose may be an outlier, and a filter that began with it
//! refuses all that are right. Nothing is believed before half a second of poses agrees.

use tello_io::clock::{SpanNs, TimeNs};
use tello_model::angle::wrap;
use tello_model::rows::{Pose, pose};

/// How long the poses must agree, and how many there must be at least.
const AGREE: SpanNs = SpanNs::from_ms(500);
const POSES_MIN: u32 = 10;
/// Largest distance and turn between poses that agree. m, rad
const DISTANCE_MAX_M: f64 = 0.1;
const TURN_MAX_RAD: f64 = 0.3;

/// The poses on the ground so far.
#[derive(Debug, Clone, Default)]
pub(super) struct StandingStart {
    /// The pose that the others are compared with, and when it came.
    first: Option<(Pose, TimeNs)>,
    count: u32,
    is_settled: bool,
}

impl StandingStart {
    /// Takes a raw pose of the vehicle on the ground. Whether it contradicts the ones before: then the
    /// filter has to begin anew.
    pub(super) fn see(&mut self, raw: &Pose, at: TimeNs) -> bool {
        let agrees = self.first.is_some_and(|(first, _)| {
            let apart = raw - first;
            apart.fixed_rows::<3>(pose::X).norm() <= DISTANCE_MAX_M
                && wrap(apart[pose::THETA]).abs() <= TURN_MAX_RAD
        });
        if !agrees {
            let is_first = self.first.is_none();
            *self = Self { first: Some((*raw, at)), ..Self::default() };
            return !is_first;
        }
        self.count = self.count.saturating_add(1);
        let since = self.first.map_or(at, |(_, since)| since);
        self.is_settled = self.count >= POSES_MIN && at.since(since) >= AGREE;
        false
    }

    /// Whether the newest poses agree for long enough.
    pub(super) fn is_settled(&self) -> bool {
        self.is_settled
    }
}
