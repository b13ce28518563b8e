//! Rate, gaps, jitter and age of the frames of one object.
//!
//! Frames that arrive together, as they do over Wi-Fi or from a bridge that collects them, have arrival times
//! that do not show the rate. So the steps of time stamps count if the source sends any, else those of frame
//! numbers, whose rate is that of the lowest arrivals, and arrivals only where neither moves.

use serde::Serialize;
use tello_flight::cycle::SIGHTING_AGE_MAX;

use super::super::axes::{Placement, Unit};
use super::super::frame_clock::RateMeter;
use super::super::protocol::Head;
use super::super::statistics::GAP_PERIODS;
use super::intervals::Intervals;
use crate::clock::{SpanNs, TimeNs};

/// Silence of so long is a gap, whatever the numbers show: older poses are not flown by.
const SILENCE: SpanNs = SIGHTING_AGE_MAX;

/// Largest factor between the rate by stamps and that of the arrivals, of stamps in seconds. 1
const STAMPS_FACTOR_MAX: f64 = 1.5;

/// Two places of one frame further apart are those of two objects. m
const ONE_PLACE_M: f64 = 0.1;

/// Frames of one object: rate, gaps, jitter, age, and its places.
#[derive(Debug, Clone, Default)]
pub struct SurveyTrack {
    /// Frames of the source since it was there first.
    pub frames: u64,
    /// Frames in which it was seen.
    pub seen: u64,
    /// Places beside the first one of a frame.
    doubled: u64,
    /// Seconds between arrivals.
    waits: Intervals,
    numbers: Intervals,
    /// Seconds between stamps.
    stamps: Intervals,
    rate_meter: RateMeter,
    last: Option<(TimeNs, Head)>,
    /// Silences without a gap in numbers or stamps.
    silences: u64,
    latency_sum_s: f64,
    latency_max_s: f64,
    /// Unit of `places` and `furthest`.
    unit: Unit,
    /// First and newest place, in the axes and the unit of the source.
    pub places: Option<[Placement; 2]>,
    /// The place that was furthest from the first one.
    pub furthest: Option<Placement>,
    /// When it was seen last.
    pub seen_at: Option<TimeNs>,
}

/// Numbers of a [`SurveyTrack`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct TrackReport {
    /// Frames since the object was there first.
    pub frames: u64,
    /// Frames in which it was seen.
    pub seen: u64,
    /// Times that a frame had another place of it: two objects have the name. They count nowhere else.
    pub doubled: u64,
    /// Frames that did not come, by numbers or time stamps: lost on the way, or not sent since the object was not seen.
    pub missing: u64,
    /// Frames per second, gaps included. Hz
    pub rate_hz: f64,
    /// Rate without gaps. Hz
    pub usual_hz: f64,
    /// Standard deviation of the time between arrivals. s
    pub jitter_s: f64,
    /// Times that two or more frames in a row did not come, or that nothing came for 0.1 s.
    pub gaps: u64,
    /// Longest time between arrivals. s
    pub gap_max_s: f64,
    /// Mean age of frames when they were sent, as the source reports; 0 if it does not. s
    pub latency_mean_s: f64,
    /// Largest such age. s
    pub latency_max_s: f64,
}

impl SurveyTrack {
    /// No frame yet of a source whose positions are in `unit`.
    pub(super) fn new(unit: Unit) -> Self {
        Self { unit, ..Self::default() }
    }

    /// Numbers of the frames so far.
    pub fn report(&self) -> TrackReport {
        let frames = self.frames;
        let rate = |period_s: f64| if period_s > 0.0 { 1.0 / period_s } else { 0.0 };
        let rate_hz = rate(self.waits.mean());
        let (steps, usual_hz) = self
            .by_stamps(rate_hz)
            .or_else(|| self.by_numbers())
            .unwrap_or((&self.waits, self.waits.usual().map_or(rate_hz, rate)));
        TrackReport {
            frames,
            seen: self.seen,
            doubled: self.doubled,
            missing: steps.missing(),
            rate_hz,
            usual_hz,
            jitter_s: self.waits.deviation(),
            gaps: steps.gaps + self.silences,
            gap_max_s: self.waits.max,
            latency_mean_s: self.latency_sum_s / frames.max(1) as f64,
            latency_max_s: self.latency_max_s,
        }
    }

    /// [`SurveyTrack::report`] at `now`: silence since the newest frame counts as a gap.
    pub fn report_at(&self, now: TimeNs) -> TrackReport {
        let report = self.report();
        let wait_s = self.last.map_or(0.0, |(then, _)| now.since(then).seconds());
        if !self.is_silence(wait_s) {
            return report;
        }
        let gap_max_s = report.gap_max_s.max(wait_s);
        TrackReport { gaps: report.gaps + 1, gap_max_s, ..report }
    }

    fn is_silence(&self, wait_s: f64) -> bool {
        wait_s > SILENCE.seconds() && wait_s > GAP_PERIODS * self.waits.mean()
    }

    /// Steps and rate by the source's stamps, if they are times.
    fn by_stamps(&self, rate_hz: f64) -> Option<(&Intervals, f64)> {
        let mean_hz = 1.0 / self.stamps.mean();
        let factor = mean_hz / rate_hz;
        let is_time = (STAMPS_FACTOR_MAX.recip()..=STAMPS_FACTOR_MAX).contains(&factor);
        let usual_s = self.stamps.usual().filter(|_| is_time)?;
        Some((&self.stamps, 1.0 / usual_s))
    }

    /// Steps and rate by frame numbers, if they move.
    fn by_numbers(&self) -> Option<(&Intervals, f64)> {
        let usual = self.numbers.usual()?;
        let count_hz = self.rate_meter.hz().or_else(|| {
            let period_s = self.waits.mean();
            (period_s > 0.0).then(|| self.numbers.mean() / period_s)
        })?;
        Some((&self.numbers, count_hz / usual))
    }

    /// Takes in a frame, and where the object is in it.
    pub(super) fn take(&mut self, now: TimeNs, at: Option<Placement>, head: Head) {
        // Numbers that stand still count no frames.
        if self.had(head.number) && self.numbers.count > 0 {
            self.doubled += u64::from(self.is_elsewhere(at));
            return;
        }
        self.frames += 1;
        self.rate_meter.take(head.number, now);
        if let Some((then, before)) = self.last.replace((now, head)) {
            self.take_steps(now.since(then).seconds(), before, head);
        }
        self.latency_sum_s += head.latency.seconds();
        self.latency_max_s = self.latency_max_s.max(head.latency.seconds());
        if let Some(at) = at {
            self.take_place(now, at);
        }
    }

    /// Takes in the steps of number, stamp and arrival from the frame `before`, which came `wait_s` earlier.
    fn take_steps(&mut self, wait_s: f64, before: Head, head: Head) {
        let number = head.number.saturating_sub(before.number);
        // A number that is back begins another count.
        let mut is_gap = number > 0 && self.numbers.take(number as f64);
        if let (Some(stamp), Some(before)) = (head.stamp, before.stamp) {
            let step = SpanNs(stamp.0.saturating_sub(before.0));
            let is_back = step.seconds() <= -SILENCE.seconds();
            is_gap |= !is_back && self.stamps.take(step.seconds());
        }
        self.waits.take(wait_s);
        let is_silence = self.is_silence(wait_s);
        let has_steps = self.numbers.count > 0 || self.stamps.count > 0;
        self.silences += u64::from(is_silence && !is_gap && has_steps);
    }

    fn take_place(&mut self, now: TimeNs, at: Placement) {
        self.seen += 1;
        self.seen_at = Some(now);
        let [first, _] = *self.places.get_or_insert([at; 2]);
        self.places = Some([first, at]);
        if self.furthest.is_none_or(|furthest| apart(&at, &first) > apart(&furthest, &first)) {
            self.furthest = Some(at);
        }
    }

    /// Whether the newest frame with it has this number.
    pub(super) fn had(&self, number: i64) -> bool {
        self.last.is_some_and(|(_, last)| last.number == number)
    }

    /// Whether a place is not the newest one.
    fn is_elsewhere(&self, at: Option<Placement>) -> bool {
        self.places
            .zip(at)
            .is_some_and(|([_, newest], at)| self.unit.metres() * apart(&newest, &at) > ONE_PLACE_M)
    }
}

/// Distance of two places, in the unit of the source.
fn apart(a: &Placement, b: &Placement) -> f64 {
    a.pos_v.iter().zip(b.pos_v).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::super::protocol::Absence;
    use super::*;

    const MATRIX: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

    fn at_s(seconds: f64) -> TimeNs {
        TimeNs(0).after(SpanNs::from_seconds(seconds))
    }

    fn head(number: i64, stamp: Option<f64>) -> Head {
        let stamp = stamp.map(SpanNs::from_seconds);
        Head { number, rate_hz: 0.0, stamp, latency: SpanNs::from_ms(3), absence: Absence::Lost }
    }

    #[test]
    fn rate_jitter_and_gaps_are_those_of_the_frames() {
        let mut track = SurveyTrack::default();
        assert_eq!(track.report(), TrackReport::default());
        // 100 Hz with one gap of 40 ms, without numbers.
        for at_ms in [0, 10, 20, 60, 70, 80] {
            track.take(TimeNs(0).after(SpanNs::from_ms(at_ms)), None, head(1, None));
        }
        let report = track.report();
        assert_eq!((report.frames, report.seen, report.gaps, report.missing), (6, 0, 1, 3));
        let is_near = |value: f64, expected: f64| (value - expected).abs() < 1e-9;
        assert!(is_near(report.rate_hz, 62.5) && is_near(report.usual_hz, 100.0), "{report:?}");
        assert!(is_near(report.jitter_s, 0.012) && is_near(report.gap_max_s, 0.04), "{report:?}");
        assert!(is_near(report.latency_mean_s, 0.003), "{report:?}");
    }

    /// Frames of a source in bursts of five; those of the numbers that `is_sent`.
    fn bursts(
        rate_hz: f64,
        seconds: f64,
        is_sent: impl Fn(i64) -> bool,
        head: impl Fn(i64) -> Head,
    ) -> TrackReport {
        let mut track = SurveyTrack::default();
        for number in (0..).take_while(|number| *number as f64 <= seconds * rate_hz) {
            if is_sent(number) {
                let arrived_s = (number / 5 * 5 + 4) as f64 / rate_hz;
                track.take(at_s(arrived_s), None, head(number));
            }
        }
        track.report()
    }

    #[test]
    fn bursts_are_no_rate_and_no_gaps() {
        for rate_hz in [50.0, 59.94, 240.0, 500.0] {
            let stamp = |number: i64| Some(1e9 + number as f64 / rate_hz);
            let by_number = bursts(rate_hz, 3.0, |_| true, |number| head(7 + 2 * number, None));
            let by_stamp = bursts(rate_hz, 3.0, |_| true, |number| head(0, stamp(number)));
            for report in [by_number, by_stamp] {
                let is_exact = (report.usual_hz / rate_hz - 1.0).abs() < 2e-3;
                assert!(is_exact && (report.gaps, report.missing) == (0, 0), "{report:?}");
                assert!((report.rate_hz / rate_hz - 1.0).abs() < 0.04, "{report:?}");
            }
        }
    }

    #[test]
    fn frames_that_do_not_come_are_missing() {
        let stamp = |number: i64| Some(number as f64 / 240.0);
        let is_sent = |number: i64| number % 10 != 3;
        let by_number = bursts(240.0, 10.0, is_sent, |number| head(number, None));
        let by_stamp = bursts(240.0, 10.0, is_sent, |number| head(0, stamp(number)));
        for report in [by_number, by_stamp] {
            assert_eq!((report.frames, report.missing, report.gaps), (2161, 240, 0), "{report:?}");
            assert!((report.usual_hz - 240.0).abs() < 0.5, "{report:?}");
        }
        let report = bursts(240.0, 10.0, |number| number % 1000 > 3, |number| head(number, None));
        assert_eq!(
            (report.missing, report.gaps),
            (8, 2),
            "the first ones have no number before them"
        );
    }

    #[test]
    fn a_second_place_in_a_frame_is_counted_and_changes_no_rate() {
        let place = |x_m: f64| Some(Placement { pos_v: [x_m, 0.0, 1.0], matrix: MATRIX });
        let mut track = SurveyTrack::default();
        for number in 0..200_i64 {
            let now = at_s(number as f64 / 100.0);
            track.take(now, place(1e-3 * number as f64), head(number, None));
            track.take(now, place(5.0), head(number, None));
        }
        let report = track.report();
        // At the first frame it is not known yet that numbers move.
        assert_eq!((report.frames, report.seen, report.doubled), (201, 201, 199), "{report:?}");
        assert!((report.usual_hz - 100.0).abs() < 1.0, "{report:?}");
        assert_eq!(bursts(50.0, 3.0, |_| true, |_| head(0, None)).doubled, 0);
        // A frame that is sent twice, a little later.
        let mut track = SurveyTrack::default();
        for number in 0..20_i64 {
            for x_m in [0.0, 0.02] {
                track.take(at_s(number as f64 / 100.0), place(x_m), head(number, None));
            }
        }
        let report = track.report();
        assert_eq!((report.doubled, report.frames), (0, 21), "{report:?}");
        assert!((report.rate_hz - 100.0).abs() < 6.0, "{report:?}");
    }

    #[test]
    fn two_objects_of_one_name_are_a_tenth_of_a_metre_apart_in_every_unit() {
        for unit in [Unit::Metre, Unit::Centimetre, Unit::Millimetre] {
            for (apart_m, is_doubled) in [(0.001, false), (0.099, false), (0.101, true)] {
                let place =
                    |x_m: f64| Placement { pos_v: [x_m / unit.metres(); 3], matrix: MATRIX };
                let mut track = SurveyTrack::new(unit);
                for number in 0..20_i64 {
                    for x_m in [1.0, 1.0 + apart_m / 3.0_f64.sqrt()] {
                        let now = at_s(number as f64 / 100.0);
                        track.take(now, Some(place(x_m)), head(number, None));
                    }
                }
                let report = track.report();
                assert_eq!(report.doubled > 0, is_doubled, "{apart_m} m, {unit:?}: {report:?}");
            }
        }
    }

    #[test]
    fn silence_up_to_now_is_a_gap() {
        let mut track = SurveyTrack::default();
        for number in 0..100_i64 {
            track.take(at_s(number as f64 / 100.0), None, head(number, None));
        }
        for (now_s, gaps, gap_max_s) in [(1.0, 0, 0.01), (1.08, 0, 0.01), (3.99, 1, 3.0)] {
            let report = track.report_at(at_s(now_s));
            assert_eq!(report.gaps, gaps, "{now_s} s");
            assert!((report.gap_max_s - gap_max_s).abs() < 1e-6, "{now_s} s: {report:?}");
        }
    }

    #[test]
    fn gaps_are_counted_for_as_long_as_frames_come() {
        let is_sent = |number: i64| number % 1000 > 3;
        let report = bursts(500.0, 400.0, is_sent, |number| head(number, None));
        assert_eq!((report.gaps, report.missing), (199, 796), "{report:?}");
        // Nothing for 0.5 s, without a number left out.
        let mut track = SurveyTrack::default();
        for number in 0..1000 {
            let late_s = if number < 500 { 0.0 } else { 0.5 };
            track.take(at_s(number as f64 / 100.0 + late_s), None, head(number, None));
        }
        assert_eq!((track.report().gaps, track.report().missing), (1, 0));
    }
}
