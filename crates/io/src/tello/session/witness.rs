//! Who says whether the drone flies: its own status, and motion capture.
//!
//! Owns how long each counts. Either can be wrong: a status may deny a flight, a pose may be missing.
//! So "down" needs both witnesses, or one of them for longer; "airborne" needs one.

use tello_flight::drone::{ALONE_HOLD, DroneStatus, denies_standing};

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
    /// The drone's own height before the take-off. m
    ground_m: Option<f64>,
    /// Whether the newest status says that the drone stands, and its height denies that.
    is_status_denied: bool,
}

/// Since when the drone is down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rest {
    /// Since when one witness at least says so and none denies it.
    since: TimeNs,
    /// Since when both say so.
    agreed_since: Option<TimeNs>,
}

impl Rest {
    /// When the drone has been down for long enough: for `hold` to both witnesses, or for
    /// [`ALONE_HOLD`] to one.
    pub(super) fn is_over_at(self, hold: SpanNs) -> TimeNs {
        let alone = self.since.after(ALONE_HOLD);
        self.agreed_since.map_or(alone, |since| since.after(hold).min(alone))
    }

    /// Whether both witnesses say so.
    pub(super) fn is_agreed(self) -> bool {
        self.agreed_since.is_some()
    }
}

impl Witnesses {
    /// Takes a status; `has_flown`: whether a take-off may have been before it.
    pub(super) fn hear_status(&mut self, status: &DroneStatus, has_flown: bool, now: TimeNs) {
        let height_m = status.height_m;
        if !has_flown && !status.is_flying {
            self.ground_m = height_m;
        }
        self.is_status_denied = !status.is_flying && denies_standing(height_m, self.ground_m);
        self.status = Some(Word { is_airborne: status.is_flying, at: now });
    }

    /// The time of rest, given that up to now. None before the first moment at which a witness says that
    /// the drone is down and none denies it.
    pub(super) fn rest(&self, before: Option<Rest>, now: TimeNs) -> Option<Rest> {
        (self.is_airborne(now) == Some(false)).then(|| {
            let since = before.map_or(now, |rest| rest.since);
            let agreed_since = before.and_then(|rest| rest.agreed_since);
            let is_agreed = !self.is_alone(now);
            Rest { since, agreed_since: is_agreed.then(|| agreed_since.unwrap_or(now)) }
        })
    }

    /// What a fresh pose says; `None` if there is no fresh pose.
    ///
    /// Without a call a pose in the air does not expire: the control thread may be gone, and the drone that it left in
    /// the air is still there.
    pub(super) fn see_pose(&mut self, is_airborne: Option<bool>, now: TimeNs) {
        match is_airborne {
            Some(is_airborne) => self.pose = Some(Word { is_airborne, at: now }),
            None => self.pose = self.pose.filter(|word| now.since(word.at) < AIRBORNE_HELD),
        }
    }

    /// Whether a status of the last 2 s says that the drone flies; `None` if it contradicts itself.
    pub(super) fn status(&self, now: TimeNs) -> Option<bool> {
        let fresh = self.status.filter(|word| now.since(word.at) <= STATUS_FRESH);
        let fresh = fresh.filter(|_| !self.is_status_denied);
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

    /// Whether no more than one witness is available.
    pub(super) fn is_alone(&self, now: TimeNs) -> bool {
        self.status(now).is_none() || self.pose(now).is_none()
    }
}
