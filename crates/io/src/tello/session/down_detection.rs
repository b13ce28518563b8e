//! Detection of a drone that is down, by two redundant sources: its own status, and motion capture.
//!
//! Owns how long a report of each source counts. Either can be wrong: a status may deny a flight, a pose may be
//! missing. So "down" needs both sources, or one of them for longer; "airborne" needs one.

use tello_flight::drone::{ALONE_HOLD, DroneStatus, STATUS_FRESH, denies_standing};

use crate::clock::{SpanNs, TimeNs};

/// Age beyond which a pose on the floor no longer counts.
const FLOOR_FRESH: SpanNs = SpanNs::from_ms(500);
/// How long a pose in the air counts while motion capture sees nothing. Longer than on the floor: if in
/// doubt the drone flies.
const AIRBORNE_HELD: SpanNs = SpanNs::from_ms(2000);

/// Newest report of one source, and its time.
#[derive(Debug, Clone, Copy, PartialEq)]
struct AirborneReport {
    is_airborne: bool,
    at: TimeNs,
}

/// Newest reports of both sources.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct AirborneSources {
    status: Option<AirborneReport>,
    pose: Option<AirborneReport>,
    /// The drone's own height before the take-off. m
    ground_m: Option<f64>,
    /// Whether the newest status reports that the drone stands, and its height contradicts that.
    is_status_implausible: bool,
}

/// Since when the drone is down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rest {
    /// Since when one source at least reports so and none denies it.
    since: TimeNs,
    /// Since when both report so.
    agreed_since: Option<TimeNs>,
}

impl Rest {
    /// When the drone has been down for long enough: for `hold` to both sources, or for
    /// [`ALONE_HOLD`] to one.
    pub(super) fn is_over_at(self, hold: SpanNs) -> TimeNs {
        let alone = self.since.after(ALONE_HOLD);
        self.agreed_since.map_or(alone, |since| since.after(hold).min(alone))
    }

    /// Whether both sources report so.
    pub(super) fn is_agreed(self) -> bool {
        self.agreed_since.is_some()
    }
}

impl AirborneSources {
    /// Takes a status; `has_flown`: whether a take-off may have been before it.
    pub(super) fn receive_status(&mut self, status: &DroneStatus, has_flown: bool, now: TimeNs) {
        let height_m = status.height_m;
        if !has_flown && !status.is_flying {
            self.ground_m = height_m;
        }
        self.is_status_implausible = !status.is_flying && denies_standing(height_m, self.ground_m);
        self.status = Some(AirborneReport { is_airborne: status.is_flying, at: now });
    }

    /// Continues the rest `before` to `now`; `None` unless a source reports the drone down and none contradicts it.
    pub(super) fn rest(&self, before: Option<Rest>, now: TimeNs) -> Option<Rest> {
        (self.is_airborne(now) == Some(false)).then(|| {
            let since = before.map_or(now, |rest| rest.since);
            let agreed_since = before.and_then(|rest| rest.agreed_since);
            let is_agreed = !self.is_alone(now);
            Rest { since, agreed_since: is_agreed.then(|| agreed_since.unwrap_or(now)) }
        })
    }

    /// Takes the report of a fresh pose; `None` if there is no fresh pose.
    ///
    /// Without a call a pose in the air does not expire: the control thread may be gone, and the drone that it left in
    /// the air is still there.
    pub(super) fn observe_pose(&mut self, is_airborne: Option<bool>, now: TimeNs) {
        match is_airborne {
            Some(is_airborne) => self.pose = Some(AirborneReport { is_airborne, at: now }),
            None => self.pose = self.pose.filter(|report| now.since(report.at) < AIRBORNE_HELD),
        }
    }

    /// Whether a status of the last 2 s reports that the drone flies; `None` if it contradicts itself.
    pub(super) fn status(&self, now: TimeNs) -> Option<bool> {
        let fresh = self.status.filter(|report| now.since(report.at) <= STATUS_FRESH);
        let fresh = fresh.filter(|_| !self.is_status_implausible);
        fresh.map(|report| report.is_airborne)
    }

    /// The drone's last status, however old.
    pub(super) fn last_status(&self) -> Option<bool> {
        self.status.map(|report| report.is_airborne)
    }

    fn pose(&self, now: TimeNs) -> Option<bool> {
        let counts =
            |report: &AirborneReport| report.is_airborne || now.since(report.at) <= FLOOR_FRESH;
        self.pose.filter(counts).map(|report| report.is_airborne)
    }

    /// Whether one of the available sources reports that the drone is airborne; `None` without any.
    pub(super) fn is_airborne(&self, now: TimeNs) -> Option<bool> {
        match (self.status(now), self.pose(now)) {
            (None, None) => None,
            (status, pose) => Some(status == Some(true) || pose == Some(true)),
        }
    }

    /// Whether no more than one source is available.
    pub(super) fn is_alone(&self, now: TimeNs) -> bool {
        self.status(now).is_none() || self.pose(now).is_none()
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::ms;
    use super::*;

    const NS: SpanNs = SpanNs(1);

    fn status(is_flying: bool, height_m: Option<f64>) -> DroneStatus {
        DroneStatus {
            received_at: TimeNs(0),
            is_flying,
            is_on_ground: !is_flying,
            takes_sticks: true,
            is_battery_low: None,
            is_battery_critical: None,
            battery_pct: 80,
            battery_v: None,
            height_m,
            velocity_d_mps: None,
            heading_rad: None,
            flight_mode: None,
        }
    }

    #[test]
    fn a_status_counts_for_two_seconds_and_the_floor_for_half_of_one() {
        let mut sources = AirborneSources::default();
        assert_eq!((sources.is_airborne(ms(0)), sources.last_status()), (None, None));
        sources.receive_status(&status(true, None), true, ms(0));
        assert_eq!(sources.status(ms(2_000)), Some(true));
        assert_eq!(sources.status(ms(2_000).after(NS)), None);
        assert_eq!(sources.last_status(), Some(true), "however old");
        sources.observe_pose(Some(false), ms(0));
        assert_eq!(sources.pose(ms(500)), Some(false));
        assert_eq!(sources.pose(ms(500).after(NS)), None);
    }

    #[test]
    fn a_pose_in_the_air_counts_until_two_seconds_without_one_were_noticed() {
        let mut sources = AirborneSources::default();
        sources.observe_pose(Some(true), ms(0));
        assert_eq!(sources.pose(ms(60_000)), Some(true), "the control thread is gone");
        sources.observe_pose(None, ms(1_999));
        assert_eq!(sources.pose(ms(1_999)), Some(true));
        sources.observe_pose(None, ms(2_000));
        assert_eq!(sources.pose(ms(2_000)), None);
    }

    #[test]
    fn a_drone_that_stands_high_by_its_own_height_is_no_source() {
        let mut sources = AirborneSources::default();
        sources.receive_status(&status(false, Some(0.2)), false, ms(0));
        // By at most 0.4 m above the height before the flight, which does not change any more.
        for (is_flying, height_m, expected) in [
            (false, Some(0.6), Some(false)),
            (false, Some(0.7), None),
            (false, None, Some(false)),
            (true, Some(0.7), Some(true)),
            (false, Some(-0.5), Some(false)),
            (false, Some(0.7), None),
        ] {
            sources.receive_status(&status(is_flying, height_m), true, ms(0));
            assert_eq!(sources.status(ms(0)), expected, "{height_m:?}, flying {is_flying}");
            assert_eq!(sources.last_status(), Some(is_flying));
        }
    }

    #[test]
    fn one_source_is_enough_for_airborne_and_both_are_needed_for_agreement() {
        for (by_status, by_pose, is_airborne, is_alone) in [
            (Some(true), Some(false), Some(true), false),
            (Some(false), Some(true), Some(true), false),
            (Some(false), Some(false), Some(false), false),
            (Some(false), None, Some(false), true),
            (None, Some(false), Some(false), true),
            (None, None, None, true),
        ] {
            let mut sources = AirborneSources::default();
            if let Some(is_flying) = by_status {
                sources.receive_status(&status(is_flying, None), true, ms(0));
            }
            sources.observe_pose(by_pose, ms(0));
            assert_eq!(sources.is_airborne(ms(0)), is_airborne, "{by_status:?}, {by_pose:?}");
            assert_eq!(sources.is_alone(ms(0)), is_alone, "{by_status:?}, {by_pose:?}");
            let is_agreed = sources.rest(None, ms(0)).map(Rest::is_agreed);
            let expected = (is_airborne == Some(false)).then_some(!is_alone);
            assert_eq!(is_agreed, expected, "{by_status:?}, {by_pose:?}");
        }
    }

    #[test]
    fn rest_counts_from_its_beginning_and_agreement_never_delays_its_end() {
        let mut sources = AirborneSources::default();
        sources.receive_status(&status(false, None), true, ms(100));
        let alone = sources.rest(None, ms(100)).unwrap();
        assert_eq!(alone.is_over_at(SpanNs::from_ms(300)), ms(100).after(ALONE_HOLD));
        for (agreed_ms, over_ms) in [(1_000, 1_300), (10_000, 10_100)] {
            sources.receive_status(&status(false, None), true, ms(agreed_ms));
            sources.observe_pose(Some(false), ms(agreed_ms));
            let agreed = sources.rest(Some(alone), ms(agreed_ms));
            let later = sources.rest(agreed, ms(agreed_ms + 50)).unwrap();
            assert_eq!(later.is_over_at(SpanNs::from_ms(300)), ms(over_ms), "{agreed_ms} ms");
        }
    }
}
