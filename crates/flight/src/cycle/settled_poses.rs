//! Whether the poses on the ground agree before anything moves, and whether a flight that began in the air began with
//! a false heading.
//!
//! Owns the place where the vehicle stands: a first pose may be an outlier, and a filter that began with it
//! refuses all that are right. Nothing is accepted before half a second of poses agrees.

use horizon_model::angle::wrap;
use horizon_model::rows::{Pose, pose};

use crate::time::{SpanNs, TimeNs};

/// How long the poses must agree, and how many there must be at least.
const AGREE: SpanNs = SpanNs::from_ms(500);
const POSES_MIN: u32 = 10;
/// Largest distance and turn between poses that agree. m, rad
const DISTANCE_MAX_M: f64 = 0.1;
const TURN_MAX_RAD: f64 = 0.3;

/// In flight: how long headings must contradict the estimate, and how long after the begin they may. The
/// heading flips of the real recordings last up to 0.7 s.
const CONTRADICT: SpanNs = SpanNs::from_ms(800);
const BEGIN: SpanNs = SpanNs::from_ms(2000);

/// The poses at the start so far.
#[derive(Debug, Clone, Default)]
pub(super) struct StandingStart {
    /// The pose that the others are compared with, and when it came.
    first: Option<(Pose, TimeNs)>,
    count: u32,
    is_settled: bool,
    /// In flight: since when each heading has contradicted the estimate.
    contradicted_since: Option<TimeNs>,
}

impl StandingStart {
    /// Takes a raw pose of the vehicle on the ground. Whether it contradicts the ones before: then the
    /// filter has to begin anew.
    pub(super) fn observe(&mut self, raw: &Pose, at: TimeNs) -> bool {
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

    /// Takes a raw heading of a flight that began in the air, where nothing has to settle first. Whether it
    /// has contradicted the estimate `theta_hat_rad` for so long that the estimate began with a false one.
    pub(super) fn observe_in_flight(
        &mut self,
        theta_rad: f64,
        theta_hat_rad: f64,
        at: TimeNs,
    ) -> bool {
        let (_, began) = *self.first.get_or_insert((Pose::zeros(), at));
        if self.is_settled || at.since(began) > BEGIN {
            return false;
        }
        if wrap(theta_rad - theta_hat_rad).abs() <= TURN_MAX_RAD {
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

    /// Shows `count` poses, 50 a second from `from` on; whether one contradicted those before.
    fn show(start: &mut StandingStart, pose: &Pose, from: i64, count: i64) -> bool {
        let seen = (from..from + count)
            .map(|k| start.observe(pose, TimeNs(0).after(SpanNs::from_ms(20 * k))));
        seen.filter(|is_other| *is_other).count() > 0
    }

    #[test]
    fn half_a_second_of_poses_has_to_agree() {
        let mut start = StandingStart::default();
        assert!(!start.is_settled() && !show(&mut start, &HERE, 0, 25));
        assert!(!start.is_settled(), "0.48 s");
        show(&mut start, &HERE, 25, 1);
        assert!(start.is_settled());
    }

    #[test]
    fn few_poses_are_no_agreement() {
        let mut start = StandingStart::default();
        for k in 0..9 {
            start.observe(&HERE, TimeNs(0).after(SpanNs::from_ms(400 * k)));
        }
        assert!(!start.is_settled());
    }

    #[test]
    fn a_false_initial_heading_is_detected_after_0_8_s_and_a_flip_is_none() {
        let at = |k: i64| TimeNs(0).after(SpanNs::from_ms(20 * k));
        let detected = |seen: &dyn Fn(i64) -> f64| {
            let mut start = StandingStart::default();
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
            (HERE + Pose::new(0.09, 0.0, 0.0, 0.0), false),
            (HERE + Pose::new(0.0, 0.0, 0.11, 0.0), true),
            (HERE + Pose::new(0.0, 0.0, 0.0, 0.31), true),
            (wrapped, false),
        ] {
            let mut start = StandingStart::default();
            show(&mut start, &HERE, 0, 50);
            assert_eq!(show(&mut start, &other, 50, 1), is_other, "{other}");
            assert_eq!(start.is_settled(), !is_other, "{other}");
        }
    }
}
