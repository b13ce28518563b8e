//! The rate of the frame numbers, learned on the ground.

use horizon_model::check::maximum;

use super::*;

#[test]
fn without_a_rate_no_frame_has_a_time() {
    for rate_hz in [0.0, -1.0, 1e-300, 1e300] {
        let mut clock = FrameClock::new();
        for number in 0..500 {
            let ms = PERIOD_MS * number as f64;
            assert_eq!(
                late_ms(&mut clock, number, rate_hz, ms),
                None,
                "{rate_hz} Hz, frame {number}"
            );
        }
        assert!(!clock.is_confirmed());
        clock.set_airborne(true);
        assert_eq!(late_ms(&mut clock, 501, RATE_HZ, 1e4), None, "{rate_hz} Hz");
    }
}

/// A clock that was for `seconds` on the ground with a source that counts `count_hz` and announces 50;
/// whether the last frame there has a time, and how late the frames of a minute in flight are at most.
fn announced_50(count_hz: f64, seconds: f64) -> (FrameClock, bool, Option<f64>) {
    let mut clock = FrameClock::new();
    let ms = |number: i64| 1e3 * number as f64 / count_hz + jitter_ms(number);
    let ground = whole(count_hz * seconds);
    let last = (0..ground).map(|number| late_ms(&mut clock, number, RATE_HZ, ms(number))).last();
    clock.set_airborne(true);
    let flight = ground..ground + whole(60.0 * count_hz);
    let mut late_max_ms = Some(0.0);
    for number in flight {
        let late_ms = late_ms(&mut clock, number, RATE_HZ, ms(number));
        late_max_ms = late_max_ms.zip(late_ms).map(|(a, b)| maximum(a, b));
    }
    (clock, last.flatten().is_some(), late_max_ms)
}

#[test]
fn a_count_by_a_whole_factor_is_learned_on_the_ground() {
    for count_hz in [50.0, 25.0, 100.0, 12.5, 400.0] {
        for seconds in [2.3, 5.0, 31.0] {
            let (clock, is_known, late_max_ms) = announced_50(count_hz, seconds);
            let trouble = format!("{count_hz} Hz after {seconds} s: {late_max_ms:?}");
            assert!(is_known && clock.is_confirmed(), "{trouble}");
            assert!(late_max_ms.is_some_and(|late_ms| late_ms < 8.5), "{trouble}");
            let measured_hz = clock.count_hz().unwrap();
            assert!((measured_hz / count_hz - 1.0).abs() < 1e-9, "{trouble}: {measured_hz} Hz");
        }
    }
}

#[test]
fn a_rate_that_is_called_by_its_round_number_is_measured() {
    let count_hz = 50.0 / 1.001;
    let (clock, is_known, late_max_ms) = announced_50(count_hz, 31.0);
    assert!(is_known && clock.is_confirmed());
    assert!(late_max_ms.is_some_and(|late_ms| late_ms < 10.0), "{late_max_ms:?}");
    // With the announced one they would be 60 ms late after a minute: so it is learned in flight.
    let (_, _, late_max_ms) = announced_50(count_hz, 3.0);
    assert!(late_max_ms.is_some_and(|late_ms| late_ms < 15.0), "{late_max_ms:?}");
}

#[test]
fn frames_at_another_rate_than_announced_have_no_time() {
    // The first three are 50 Hz behind a delay that grows by 50, 150 and 500 ms per second.
    for count_hz in [50.0 / 1.05, 50.0 / 1.15, 50.0 / 1.5, 47.0, 55.0, 80.0, 500.0] {
        let (clock, is_known, _) = announced_50(count_hz, 5.0);
        assert!(!is_known && !clock.is_confirmed(), "{count_hz} Hz");
        let measured_hz = clock.count_hz().unwrap();
        assert!((measured_hz / count_hz - 1.0).abs() < 5e-3, "{count_hz} Hz: {measured_hz} Hz");
    }
}

#[test]
fn stalls_and_bursts_on_the_ground_are_no_other_rate() {
    let mut clock = FrameClock::new();
    let mut released_ms = 0.0;
    for number in 0..3000 {
        let due_ms = PERIOD_MS * number as f64 + jitter_ms(number);
        // Twenty times a minute nothing comes for a quarter of a second.
        if number % 150 == 0 {
            released_ms = due_ms + 250.0;
        }
        let late_ms = late_ms(&mut clock, number, RATE_HZ, due_ms.max(released_ms));
        assert!(late_ms.is_some_and(|late_ms| late_ms < 260.0), "frame {number}: {late_ms:?} ms");
        // Two seconds, as soon as both ends of them have punctual frames.
        if !(110..120).contains(&number) {
            assert_eq!(clock.is_confirmed(), number >= 120, "frame {number}");
        }
    }
}

#[test]
fn a_stream_that_stays_late_on_the_ground_is_accepted_again_after_the_window() {
    let mut clock = FrameClock::new();
    for number in 0..4000 {
        let behind_ms = if number < 500 { 0.0 } else { 400.0 };
        let late_ms = late_after_ms(&mut clock, number, behind_ms);
        match number {
            0..500 => assert!(is_near(late_ms, 0.0)),
            500..1970 => {
                assert!(late_ms.is_none_or(|late_ms| late_ms > 396.0), "{number}: {late_ms:?}");
            }
            2010.. => assert!(is_near(late_ms, 0.0), "frame {number}: {late_ms:?}"),
            _ => {}
        }
    }
}

/// When a source with this jitter is confirmed on the ground, and how late its frames seem at most in the rest of a
/// minute, beyond their delay; infinite for a frame without a time. `None` if it is not confirmed in `ground_s`. s, ms
fn started(
    (announced_hz, count_hz): (f64, f64),
    jitter_ms: f64,
    seed: i64,
    ground_s: f64,
) -> Option<(f64, f64)> {
    let mut clock = FrameClock::new();
    let (mut started_s, mut late_max_ms, mut arrived_ms) = (None, 0.0_f64, 0.0_f64);
    for number in 0..whole(60.0 * count_hz) {
        let due_ms = 1e3 * number as f64 / count_hz;
        arrived_ms = arrived_ms.max(due_ms + jitter_ms * uniform(seed * 1_000_003 + number));
        let late_ms = late_ms(&mut clock, number, announced_hz, arrived_ms);
        if started_s.is_some() {
            let late_ms = late_ms.map_or(f64::INFINITY, |late_ms| late_ms - (arrived_ms - due_ms));
            late_max_ms = late_max_ms.max(late_ms);
        } else if clock.is_confirmed() {
            started_s = Some(due_ms / 1e3);
            clock.set_airborne(true);
        } else if due_ms > 1e3 * ground_s {
            return None;
        }
    }
    started_s.map(|started_s| (started_s, late_max_ms))
}

#[test]
fn what_the_ground_confirms_a_flight_holds() {
    for jitter_ms in [0.0, 8.0, 30.0] {
        for deviation in [0.0, 1e-3, 3e-3, 4e-3, 4.5e-3, 5e-3, 5.5e-3, 6e-3, 7e-3] {
            for (sign, seed) in [1.0, -1.0]
                .into_iter()
                .zip([0, 3])
                .flat_map(|(sign, seed)| (seed..seed + 3).map(move |seed| (sign, seed)))
            {
                let announced_hz = 100.0 * (1.0 + sign * deviation);
                let started = started((announced_hz, 100.0), jitter_ms, seed, 12.0);
                let trouble = format!("{announced_hz} Hz, {jitter_ms} ms, {seed}: {started:?}");
                assert!(started.is_none_or(|(_, late_ms)| late_ms < 30.0), "{trouble}");
                assert!(started.is_none() || deviation < 7e-3, "{trouble}");
                let is_soon = started.is_some_and(|(started_s, _)| started_s < 4.0);
                assert!(is_soon || deviation > 3e-3, "{trouble}");
            }
        }
    }
}
