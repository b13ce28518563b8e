//! Whether the poses on the ground agree before anything moves, and whether a flight that began in the air began with
//! a false heading.
//!
//! Owns the position where the vehicle stands: a first pose may be an outlier, and a filter that began with it
//! refuses all that are right. Nothing is accepted before the poses agree for a while.

use horizon_model::angle::wrap;
use horizon_model::rows::{Pose, pose};
use horizon_model::setting::{SettingError, in_range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::time::{SpanNs, TimeNs};

/// When the poses of a standing vehicle agree, as written in a file. 5 mm and 0.02 rad of noise (standard deviations)
/// agree with the values of `configs/fly.json`, a drone that is carried does not.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StandingTable {
    /// How long they must agree. s, 0.1..=10
    pub for_s: f64,
    /// Largest distance between poses that agree. m, 0.001..=1
    pub distance_m: f64,
    /// Largest turn between poses that agree. rad, 0.001..=3
    pub turn_rad: f64,
}

impl Default for StandingTable {
    /// The values of flights whose logs have no such settings.
    fn default() -> Self {
        Self { for_s: 0.5, distance_m: 0.1, turn_rad: 0.3 }
    }
}

impl StandingTable {
    fn check(&self) -> Result<(), SettingError> {
        in_range("for_s", self.for_s, 0.1..=10.0)?;
        in_range("distance_m", self.distance_m, 0.001..=1.0)?;
        in_range("turn_rad", self.turn_rad, 0.001..=3.0).map(|_| ())
    }
}

/// How many poses must agree at least.
const POSES_MIN: u32 = 10;
/// Turn between a heading and the estimate that contradict each other. rad
const CONTRADICTION_RAD: f64 = 0.3;

/// In flight: how long headings must contradict the estimate, and how long after the begin they may. A compromise: a
/// start with a wrong heading has to be found soon, and wrong headings of real recordings last up to 1.5 s
/// (`tests/filter_recordings.rs`).
const CONTRADICT: SpanNs = SpanNs::from_ms(800);
const BEGIN: SpanNs = SpanNs::from_ms(2000);

/// The poses at the start so far.
#[derive(Debug, Clone)]
pub(super) struct StandingStart {
    table: StandingTable,
    /// On the ground: the pose that the others are compared with.
    first: Option<Pose>,
    /// When the first pose came that is compared, with `first` or, in flight, with the estimate.
    began: Option<TimeNs>,
    count: u32,
    is_settled: bool,
    /// In flight: since when each heading has contradicted the estimate.
    contradicted_since: Option<TimeNs>,
}

impl StandingStart {
    /// Nothing was seen yet.
    ///
    /// # Errors
    /// The first value that breaks its rule, with its key below this table.
    pub(super) fn new(table: StandingTable) -> Result<Self, SettingError> {
        table.check()?;
        let (first, began, contradicted_since) = (None, None, None);
        Ok(Self { table, first, began, count: 0, is_settled: false, contradicted_since })
    }

    /// Takes a raw pose of the vehicle on the ground. Returns whether it contradicts the ones before: then the filter
    /// has to begin anew.
    #[must_use]
    pub(super) fn observe(&mut self, raw: &Pose, at: TimeNs) -> bool {
        let agrees = self.first.is_some_and(|first| {
            let apart_w = raw - first;
            apart_w.fixed_rows::<3>(pose::X).norm() <= self.table.distance_m
                && wrap(apart_w[pose::THETA]).abs() <= self.table.turn_rad
        });
        if !agrees {
            let is_first = self.first.is_none();
            (self.first, self.began) = (Some(*raw), Some(at));
            (self.count, self.is_settled, self.contradicted_since) = (0, false, None);
            return !is_first;
        }
        self.count = self.count.saturating_add(1);
        let has_lasted =
            at.since(self.began.unwrap_or(at)) >= SpanNs::from_seconds(self.table.for_s);
        self.is_settled = self.count >= POSES_MIN && has_lasted;
        false
    }

    /// Takes a raw heading of a flight that began in the air, where nothing has to settle first. Returns whether
    /// headings have contradicted the estimate `theta_hat_rad` for so long that the estimate began with a false one.
    #[must_use]
    pub(super) fn observe_in_flight(
        &mut self,
        theta_rad: f64,
        theta_hat_rad: f64,
        at: TimeNs,
    ) -> bool {
        let began = *self.began.get_or_insert(at);
        if self.is_settled || at.since(began) > BEGIN {
            return false;
        }
        if wrap(theta_rad - theta_hat_rad).abs() <= CONTRADICTION_RAD {
            self.contradicted_since = None;
            return false;
        }
        at.since(*self.contradicted_since.get_or_insert(at)) >= CONTRADICT
    }

    /// Whether the newest poses agree for long enough.
    pub(super) fn is_settled(&self) -> bool {
        self.is_settled
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HERE: Pose = Pose::new(1.0, 2.0, 0.1, 3.1);

    fn standing() -> StandingStart {
        let table = StandingTable { for_s: 1.0, distance_m: 0.03, turn_rad: 0.15 };
        StandingStart::new(table).unwrap()
    }

    /// Shows `count` poses, 50 a second from `from` on; whether one contradicted those before.
    fn show(start: &mut StandingStart, pose: &Pose, from: i64, count: i64) -> bool {
        let seen = (from..from + count)
            .map(|k| start.observe(pose, TimeNs(0).after(SpanNs::from_ms(20 * k))));
        seen.filter(|is_other| *is_other).count() > 0
    }

    #[test]
    fn a_second_of_poses_has_to_agree() {
        let mut start = standing();
        assert!(!start.is_settled() && !show(&mut start, &HERE, 0, 50));
        assert!(!start.is_settled(), "0.98 s");
        show(&mut start, &HERE, 50, 1);
        assert!(start.is_settled());
    }

    #[test]
    fn a_bad_value_is_refused_with_its_key() {
        let good = StandingTable::default();
        for (table, refusal) in [
            (StandingTable { for_s: 0.0, ..good }, "for_s = 0: expected 0.1..=10.0"),
            (StandingTable { distance_m: 2.0, ..good }, "distance_m = 2: expected 0.001..=1.0"),
            (StandingTable { turn_rad: f64::NAN, ..good }, "turn_rad = NaN: expected 0.001..=3.0"),
        ] {
            assert_eq!(StandingStart::new(table).unwrap_err().to_string(), refusal);
        }
        assert!(StandingStart::new(good).is_ok());
    }

    #[test]
    fn few_poses_are_no_agreement() {
        let mut start = standing();
        for k in 0..9 {
            assert!(!start.observe(&HERE, TimeNs(0).after(SpanNs::from_ms(400 * k))));
        }
        assert!(!start.is_settled());
    }

    #[test]
    fn a_false_initial_heading_is_detected_after_0_8_s_and_a_flip_is_none() {
        let at = |k: i64| TimeNs(0).after(SpanNs::from_ms(20 * k));
        let detected = |seen: &dyn Fn(i64) -> f64| {
            let mut start = standing();
            (0..200).find(|k| start.observe_in_flight(seen(*k), 2.8, at(*k)))
        };
        assert_eq!(detected(&|_| 2.9), None);
        assert_eq!(detected(&|k| if k < 10 { 2.8 } else { 0.1 }), Some(50));
        assert_eq!(detected(&|k| if (10..45).contains(&k) { 0.1 } else { 2.8 }), None, "a flip");
        assert_eq!(
            detected(&|k| if k < 80 { 2.8 } else { 0.1 }),
            None,
            "too late for a false start"
        );
    }

    #[test]
    fn a_pose_elsewhere_or_turned_begins_anew_and_the_wrap_does_not() {
        let wrapped = HERE + Pose::new(0.0, 0.0, 0.0, 0.1 - std::f64::consts::TAU);
        for (other, is_other) in [
            (HERE + Pose::new(0.029, 0.0, 0.0, 0.0), false),
            (HERE + Pose::new(0.0, 0.0, 0.031, 0.0), true),
            (HERE + Pose::new(0.0, 0.0, 0.0, 0.16), true),
            (wrapped, false),
        ] {
            let mut start = standing();
            show(&mut start, &HERE, 0, 50);
            assert_eq!(show(&mut start, &other, 50, 1), is_other, "{other}");
            assert_eq!(start.is_settled(), !is_other, "{other}");
        }
    }
}
