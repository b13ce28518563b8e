//! Who says whether the drone flies: its own status, and motion capture.
//!
//! Owns how long each counts. Either can be wrong: a status may deny a flight, a pose may be missing.
//! So "down" needs every witness that is available, "airborne" needs one.

use crate::clock::{SpanNs, TimeNs};

/// Age from which a status no longer counts. Real statuses come ten times a second; the longest gaps
/// are 0.6 s.
const STATUS_FRESH: SpanNs = SpanNs::from_ms(2000);
/// Age from which a pose on the floor no longer counts.
const FLOOR_FRESH: SpanNs = SpanNs::from_ms(500);
/// How long a pose in the air counts while motion capture sees nothing. Longer than on the floor: if in
/// doubt the drone flies.
const AIRBORNE_HELD: SpanNs = SpanNs::from_ms(2000);

/// One witness: what it says, and since when.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Word {
    is_airborne: bool,
    at: TimeNs,
}

/// The newest of both witnesses.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Witnesses {
    status: Option<Word>,
    pose: Option<Word>,
}

impl Witnesses {
    pub(super) fn hear_status(&mut self, is_flying: bool, now: TimeNs) {
        self.status = Some(Word { is_airborne: is_flying, at: now });
    }

    /// What a fresh pose says; `None` if there is no fresh pose.
    ///
    /// Without a call nothing expires that says "airborne": the control thread may be gone, and the drone
    /// that it left in the air is still there.
    pub(super) fn see_pose(&mut self, is_airborne: Option<bool>, now: TimeNs) {
        match is_airborne {
            Some(is_airborne) => self.pose = Some(Word { is_airborne, at: now }),
            None => self.pose = self.pose.filter(|word| now.since(word.at) < AIRBORNE_HELD),
        }
    }

    /// Whether a status of the last 2 s says that the drone flies.
    pub(super) fn status(&self, now: TimeNs) -> Option<bool> {
        let fresh = self.status.filter(|word| now.since(word.at) <= STATUS_FRESH);
        fresh.map(|word| word.is_airborne)
    }

    /// The drone's last status, however old.
    pub(super) fn last_status(&self) -> Option<bool> {
        self.status.map(|word| word.is_airborne)
    }

    fn pose(&self, now: TimeNs) -> Option<bool> {
        let counts = |word: &Word| word.is_airborne || now.since(word.at) <= FLOOR_FRESH;
        self.pose.filter(counts).map(|word| word.is_airborne)
    }

    /// Whether one of the available witnesses says that the drone is airborne; `None` without any.
    pub(super) fn is_airborne(&self, now: TimeNs) -> Option<bool> {
        match (self.status(now), self.pose(now)) {
            (None, None) => None,
            (status, pose) => Some(status == Some(true) || pose == Some(true)),
        }
    }
}
