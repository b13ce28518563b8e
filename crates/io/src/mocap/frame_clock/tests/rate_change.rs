//! A rate that changes in flight.

use super::*;

/// How late frames are that come at `ms` and announce a rate, by the time since the change; `None` without a time. ms
fn late_after_change(
    (before_hz, after_hz): (f64, f64),
    announced_hz: f64,
    ms: impl Fn(i64) -> f64,
) -> Vec<Option<f64>> {
    let mut clock = FrameClock::new();
    let change = whole(15.0 * before_hz);
    for number in 0..change {
        clock.set_airborne(number as f64 > 3.0 * before_hz);
        let ms = 1e3 * number as f64 / before_hz + jitter_ms(number);
        late_ms(&mut clock, number, before_hz, ms);
    }
    let begin_ms = 1e3 * (change - 1) as f64 / before_hz;
    (1..=whole(60.0 * after_hz))
        .map(|frame| {
            let at_ms = begin_ms + ms(frame) + jitter_ms(frame);
            late_ms(&mut clock, change - 1 + frame, announced_hz, at_ms)
        })
        .collect()
}

#[test]
fn a_rate_that_changes_as_announced_is_flown_on_after_half_a_second() {
    for (before_hz, after_hz) in [(240.0, 60.0), (100.0, 200.0), (120.0, 100.0), (500.0, 50.0)] {
        let late_ms = late_after_change((before_hz, after_hz), after_hz, |frame| {
            1e3 * frame as f64 / after_hz
        });
        let confirmed = usize::try_from(whole(0.55 * after_hz)).unwrap();
        let is_known = |late_ms: &Option<f64>| late_ms.is_some_and(|late_ms| late_ms < 10.0);
        let trouble = format!("{before_hz} to {after_hz} Hz");
        assert!(
            late_ms[confirmed..].iter().all(is_known),
            "{trouble}: {:?}",
            &late_ms[confirmed..][..9]
        );
    }
}

#[test]
fn a_rate_that_changes_without_a_word_or_otherwise_than_announced_has_no_time() {
    for announced_hz in [240.0, 100.0, 50.0, 0.0] {
        let late_ms =
            late_after_change((240.0, 60.0), announced_hz, |frame| 1e3 * frame as f64 / 60.0);
        let is_old = |late_ms: &Option<f64>| late_ms.is_none_or(|late_ms| late_ms > 200.0);
        assert!(late_ms[30..].iter().all(is_old), "{announced_hz} Hz");
    }
    // After a pause of 0.2 s, which may as well be a delay that stays.
    let late_ms = late_after_change((240.0, 60.0), 60.0, |frame| 200.0 + 1e3 * frame as f64 / 60.0);
    assert!(late_ms[3..].iter().all(|late_ms| late_ms.is_none_or(|late_ms| late_ms > 200.0)));
}

#[test]
fn the_first_frame_of_another_rate_may_come_at_any_time_of_either_period() {
    for (before_hz, after_hz, begin_ms) in [
        (200.0, 20.0, 0.0),
        (200.0, 20.0, 5.0),
        (200.0, 20.0, 30.0),
        (200.0, 20.0, 50.0),
        (20.0, 50.0, 50.0),
        (20.0, 50.0, 3.0),
        (50.0, 200.0, 20.0),
    ] {
        let late_ms = late_after_change((before_hz, after_hz), after_hz, |frame| {
            begin_ms + 1e3 * (frame - 1) as f64 / after_hz
        });
        let confirmed = usize::try_from(whole(0.6 * after_hz)).unwrap();
        let is_known = |late_ms: &Option<f64>| late_ms.is_some_and(|late_ms| late_ms < 10.0);
        assert!(
            late_ms[confirmed..].iter().all(is_known),
            "{before_hz}, {after_hz}, {begin_ms} ms"
        );
    }
}

#[test]
fn an_announcement_alone_changes_nothing() {
    for announced_hz in [60.0, 480.0, 239.0] {
        let late_ms =
            late_after_change((240.0, 240.0), announced_hz, |frame| 1e3 * frame as f64 / 240.0);
        let is_known = |late_ms: &Option<f64>| late_ms.is_some_and(|late_ms| late_ms < 9.0);
        assert!(late_ms.iter().all(is_known), "{announced_hz} Hz");
        // Frames that really fall behind meanwhile are reported as late.
        let late_ms = late_after_change((240.0, 240.0), announced_hz, |frame| {
            1e3 * frame as f64 / 240.0 + 400.0
        });
        assert!(late_ms.iter().all(|late_ms| late_ms.is_some_and(|late_ms| late_ms > 380.0)));
    }
}
