mod hour;
mod learned_rate;
mod rate;
mod rate_change;

use proptest::prelude::*;

use super::*;

const PERIOD_MS: f64 = 20.0;
const RATE_HZ: f64 = 1e3 / PERIOD_MS;

/// Frames on the ground before a take-off in these tests: ten seconds.
const ON_GROUND: i64 = 500;

/// A healthy delay that varies by some milliseconds, and is zero now and then. ms
fn jitter_ms(number: i64) -> f64 {
    (number * 7_919 % 8) as f64
}

/// A uniform number of 0..1 that depends on `number` alone (Steele, Lea and Flood, `SplitMix64`).
fn uniform(number: i64) -> f64 {
    let mut bits = number.cast_unsigned().wrapping_mul(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (bits >> 11) as f64 / (1_u64 << 53) as f64
}

fn at_ms(ms: f64) -> TimeNs {
    TimeNs(whole(ms * 1e6))
}

#[expect(clippy::cast_possible_truncation, reason = "hours of ns fit 63 bits")]
fn whole(value: f64) -> i64 {
    value.round() as i64
}

/// How late the frame is that comes at `ms`; `None` if its time is not known. ms
fn late_ms(clock: &mut FrameClock, number: i64, rate_hz: f64, ms: f64) -> Option<f64> {
    let at = at_ms(ms);
    let measured_at = clock.measured_at(number, rate_hz, at)?;
    assert!(measured_at <= at, "frame {number}");
    Some(at.since(measured_at).seconds() * 1e3)
}

/// The same for a frame of a 50 Hz system that comes `delay_ms` after it was measured.
fn late_after_ms(clock: &mut FrameClock, number: i64, delay_ms: f64) -> Option<f64> {
    late_ms(clock, number, RATE_HZ, PERIOD_MS * number as f64 + delay_ms)
}

/// A clock that took off after `count` healthy frames of 50 Hz.
fn flying_after(count: i64) -> FrameClock {
    let mut clock = FrameClock::new();
    for number in 0..count {
        late_after_ms(&mut clock, number, jitter_ms(number));
    }
    clock.set_airborne(true);
    clock
}

fn flying() -> FrameClock {
    flying_after(ON_GROUND)
}

/// Numbers of the frames of some seconds in flight.
fn in_flight(seconds: i64) -> std::ops::Range<i64> {
    ON_GROUND..ON_GROUND + 50 * seconds
}

fn is_near(actual_ms: Option<f64>, expected_ms: f64) -> bool {
    // The drift that may be followed in 20 s.
    actual_ms.is_some_and(|actual_ms| (actual_ms - expected_ms).abs() < 2.1)
}

#[test]
fn frames_on_time_were_measured_when_received() {
    for is_airborne in [false, true] {
        let mut clock = FrameClock::new();
        for number in 0..1000 {
            clock.set_airborne(is_airborne && number > 200);
            let late_ms =
                late_ms(&mut clock, 7_000_000 + number, RATE_HZ, 300.0 + 20.0 * number as f64);
            assert_eq!(late_ms, Some(0.0), "frame {number}");
        }
    }
}

#[test]
fn a_burst_after_a_stall_is_as_old_as_its_frames() {
    for mut clock in [FrameClock::new(), flying_after(1)] {
        let burst =
            [(0, 0.0), (1, 20.0), (2, 440.0), (3, 440.0), (12, 440.0), (22, 440.0), (23, 460.0)];
        for ((number, ms), expected_ms) in
            burst.into_iter().zip([0.0, 0.0, 400.0, 380.0, 200.0, 0.0, 0.0])
        {
            let late_ms = late_ms(&mut clock, number, RATE_HZ, ms);
            assert!(is_near(late_ms, expected_ms), "frame {number}: {late_ms:?} ms");
        }
    }
}

#[test]
fn frames_that_are_left_out_make_nothing_old() {
    for mut clock in [FrameClock::new(), flying_after(2)] {
        for number in [0, 1, 51, 52, 30_000, 30_001] {
            assert!(is_near(late_after_ms(&mut clock, number, 0.0), 0.0), "frame {number}");
        }
    }
}

#[test]
fn a_first_frame_that_was_late_is_corrected_by_the_next() {
    let mut clock = FrameClock::new();
    for (number, ms, expected_ms) in [(0, 90.0, 0.0), (4, 90.0, 0.0), (5, 190.0, 80.0)] {
        assert!(is_near(late_ms(&mut clock, number, RATE_HZ, ms), expected_ms), "frame {number}");
    }
}

#[test]
fn a_stream_that_falls_behind_in_flight_stays_late_for_as_long_as_it_does() {
    // Less than 70 ms may be jitter and drift.
    for lag_ms in [75.0, 100.0, 400.0, 1200.0, 4900.0] {
        let mut clock = flying();
        // A Tello flies for a quarter of an hour.
        for number in in_flight(900) {
            let late_ms = late_after_ms(&mut clock, number, lag_ms + jitter_ms(number));
            let least_ms = lag_ms - 20.1;
            assert!(late_ms > Some(least_ms), "{lag_ms} ms, frame {number}: {late_ms:?} ms");
        }
        let number = in_flight(900).end;
        assert!(
            is_near(late_after_ms(&mut clock, number, 0.0), 0.0),
            "{lag_ms} ms: at once after it"
        );
    }
}

#[test]
fn a_delay_that_grows_in_flight_is_seen_as_it_grows() {
    for growth_ms_per_s in [5.0, 50.0, 150.0] {
        let mut clock = flying();
        for number in in_flight(20) {
            let behind_ms = growth_ms_per_s * (number - ON_GROUND) as f64 / RATE_HZ;
            let late_ms = late_after_ms(&mut clock, number, behind_ms);
            let is_exact = late_ms.is_some_and(|late_ms| (late_ms - behind_ms).abs() < 2.5);
            assert!(is_exact, "{growth_ms_per_s} ms/s: {late_ms:?} of {behind_ms} ms");
        }
    }
}

#[test]
fn a_backlog_that_drains_ends_in_frames_on_time() {
    let mut clock = flying();
    let begin_ms = PERIOD_MS * ON_GROUND as f64;
    // Nothing for 3 s, then twice as many frames as are measured.
    for number in in_flight(20) {
        let due_ms = PERIOD_MS * number as f64;
        let drained_ms = begin_ms + 3000.0 + 10.0 * (number - ON_GROUND) as f64;
        let late_ms = late_ms(&mut clock, number, RATE_HZ, due_ms.max(drained_ms));
        assert!(is_near(late_ms, (drained_ms - due_ms).max(0.0)), "frame {number}: {late_ms:?} ms");
    }
}

#[test]
fn later_than_any_backlog_or_earlier_than_any_jitter_is_another_count() {
    // In the climb, and after it.
    for (frames, early_max_ms) in [(0, 250.0), (160, 50.0)] {
        for (delay_ms, is_known) in [
            (5.0 - early_max_ms, true),
            (-5.0 - early_max_ms, false),
            (4900.0, true),
            (5100.0, false),
            (1e9, false),
            (-1e9, false),
        ] {
            let mut clock = flying();
            for number in ON_GROUND..ON_GROUND + frames {
                late_after_ms(&mut clock, number, 0.0);
            }
            let number = ON_GROUND + frames;
            let late_ms = late_after_ms(&mut clock, number, delay_ms);
            assert_eq!(late_ms.is_some(), is_known, "{delay_ms} ms");
            // What has no time moves nothing.
            let late_ms = late_after_ms(&mut clock, number + 1, 0.0);
            assert!(is_near(late_ms, 0.0) || is_known, "{delay_ms} ms: {late_ms:?}");
        }
    }
}

#[test]
fn a_line_that_was_learned_in_a_busy_moment_comes_down_in_the_climb() {
    let mut clock = FrameClock::new();
    for number in 0..5 {
        late_after_ms(&mut clock, number, 200.0);
    }
    clock.set_airborne(true);
    assert!(is_near(late_after_ms(&mut clock, 5, 80.0), 0.0));
    assert!((6..3000).all(|number| is_near(late_after_ms(&mut clock, number, 0.0), 0.0)));
    assert!(is_near(late_after_ms(&mut clock, 3000, 400.0), 400.0));
}

#[test]
fn a_delay_that_becomes_shorter_in_flight_is_followed_and_a_stall_behind_it_is_seen() {
    let mut clock = FrameClock::new();
    for number in 0..ON_GROUND {
        late_after_ms(&mut clock, number, 80.0 + jitter_ms(number));
    }
    clock.set_airborne(true);
    for number in ON_GROUND..ON_GROUND + 200 {
        assert!(late_after_ms(&mut clock, number, 80.0 + jitter_ms(number)).is_some());
    }
    let known =
        |clock: &mut FrameClock, numbers: std::ops::Range<i64>, delay_ms: fn(i64) -> f64| {
            numbers.filter_map(|number| late_after_ms(clock, number, delay_ms(number))).collect()
        };
    let shorter: Vec<f64> = known(&mut clock, 700..1000, jitter_ms);
    assert!((272..=276).contains(&shorter.len()), "half a second without times: {shorter:?}");
    assert!(shorter.iter().all(|late_ms| *late_ms < 8.1), "{shorter:?}");
    // What has waited for a second comes at once.
    let stalled: Vec<f64> = known(&mut clock, 1000..1050, |number| 20.0 * (1050 - number) as f64);
    assert!(stalled.len() == 50 && stalled[0] > 990.0 && stalled[40] > 190.0, "{stalled:?}");
}

#[test]
fn numbers_that_run_ahead_in_flight_cannot_hide_a_delay() {
    // For the climb, and until neither jitter nor a delay shorter by 0.25 s explains it any more; from one number per
    // frame to 1.05, each frame seems to come a millisecond earlier.
    for (ratio, hidden_max_ms) in [(1.05, 220.0), (1.015, 350.0), (1.008, 330.0)] {
        let mut clock = flying();
        let known = in_flight(600).filter(|number| {
            let counted = ON_GROUND + whole(ratio * (number - ON_GROUND) as f64);
            late_ms(&mut clock, counted, RATE_HZ, PERIOD_MS * *number as f64).is_some()
        });
        let hidden_ms = PERIOD_MS * (ratio - 1.0) * (known.last().unwrap() - ON_GROUND) as f64;
        assert!((60.0..hidden_max_ms).contains(&hidden_ms), "{ratio}: {hidden_ms} ms");
    }
}

#[test]
fn the_rate_of_a_flight_is_that_of_the_ground_whatever_is_announced() {
    let mut clock = flying();
    for number in in_flight(5) {
        let announced_hz = [0.0, 25.0, -1.0, 100.0][usize::try_from(number).unwrap() % 4];
        let late_ms = late_ms(&mut clock, number, announced_hz, PERIOD_MS * number as f64);
        assert!(is_near(late_ms, 0.0), "frame {number}: {late_ms:?} ms");
    }
    // The count itself slows down to half of it.
    let begin = in_flight(5).end;
    for frame in 0..500 {
        let ms = PERIOD_MS * (begin + 2 * frame) as f64;
        let (late_ms, expected_ms) =
            (late_ms(&mut clock, begin + frame, RATE_HZ, ms), PERIOD_MS * frame as f64);
        match frame {
            0..=249 => assert!(is_near(late_ms, expected_ms), "{late_ms:?} of {expected_ms} ms"),
            251.. => assert_eq!(late_ms, None, "{expected_ms} ms"),
            _ => {}
        }
    }
}

#[test]
fn a_new_connection_in_flight_goes_on_with_the_count_or_has_no_time() {
    let mut clock = flying();
    clock.restart();
    // It went on counting for the second that it took.
    assert!(is_near(late_after_ms(&mut clock, ON_GROUND + 50, 0.0), 0.0));
    assert!(is_near(late_after_ms(&mut clock, ON_GROUND + 51, 800.0), 800.0));
    clock.restart();
    for number in 0..400 {
        let ms = PERIOD_MS * (ON_GROUND + 100 + number) as f64;
        assert_eq!(
            late_ms(&mut clock, number, RATE_HZ, ms),
            None,
            "frame {number} of a new server"
        );
    }
    clock.set_airborne(false);
    assert_eq!(
        late_ms(&mut clock, 400, RATE_HZ, 2e4),
        Some(0.0),
        "on the ground it is learned anew"
    );
}

#[test]
fn without_a_frame_before_the_take_off_there_is_no_time_in_flight() {
    let mut clock = flying_after(0);
    assert!((0..500).all(|number| late_after_ms(&mut clock, number, 0.0).is_none()));
}

#[test]
fn a_new_count_on_the_ground_begins_without_a_past() {
    let mut clock = FrameClock::new();
    // Back; more than 5 s ahead of time; another rate; more than 5 s late.
    let counts = [
        (100, 50.0, 0.0),
        (99, 50.0, 500.0),
        (900, 50.0, 2e3),
        (901, 100.0, 3e3),
        (902, 100.0, 9e3),
    ];
    for (number, rate_hz, ms) in counts {
        assert_eq!(late_ms(&mut clock, number, rate_hz, ms), Some(0.0), "frame {number}");
    }
    assert!(is_near(late_ms(&mut clock, 903, 100.0, 9_500.0), 490.0));
    clock.restart();
    assert_eq!(late_ms(&mut clock, 904, 100.0, 9_900.0), Some(0.0));
}

#[test]
fn clocks_that_drift_apart_do_not_age_the_frames() {
    // The mocap system is slower or faster by 80 us per second; a quarter of an hour adds up to 72 ms.
    for period_ns in [20_001_600, 19_998_400] {
        for is_airborne in [false, true] {
            let mut clock = FrameClock::new();
            for number in 0..45_000 {
                clock.set_airborne(is_airborne && number > 100);
                let late_ms =
                    late_ms(&mut clock, number, RATE_HZ, (number * period_ns) as f64 / 1e6);
                assert!(late_ms.is_some_and(|ms| ms < 1.0), "frame {number}: {late_ms:?} ms");
            }
        }
    }
}

proptest! {
    #[test]
    fn no_frame_was_measured_after_it_came(
        frames in prop::collection::vec(
            prop_oneof![
                (any::<i64>(), -1e3_f64..1e3, any::<i64>(), any::<bool>()),
                (0..60_i64, Just(50.0), 0..2_000_000_000_i64, any::<bool>()),
            ],
            0..50,
        ),
    ) {
        let mut clock = FrameClock::new();
        for (number, rate_hz, at, is_airborne) in frames {
            clock.set_airborne(is_airborne);
            let measured_at = clock.measured_at(number, rate_hz, TimeNs(at));
            prop_assert!(measured_at.is_none_or(|measured_at| measured_at <= TimeNs(at)));
        }
    }

    #[test]
    fn no_delay_in_flight_makes_a_pose_look_younger_than_it_is(
        delays_ms in prop::collection::vec(0.0..3000.0_f64, 1..400),
    ) {
        let mut clock = flying();
        for (number, delay_ms) in (ON_GROUND..).zip(delays_ms) {
            let late_ms = late_after_ms(&mut clock, number, delay_ms);
            // Beside the drift that is followed.
            let is_honest = late_ms.is_some_and(|late_ms| late_ms > delay_ms - 2.0);
            prop_assert!(is_honest, "{late_ms:?} of {delay_ms}");
        }
    }
}
