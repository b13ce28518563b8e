//! A rate that is wrong by some thousandths, and delays that only look like one.

use super::*;

/// How late the frames of a flight are at most in its first ten seconds and after them, with a source that counts
/// `count_hz` and announces another rate, after some seconds on the ground; `None` if one has no time. ms
fn late_max_ms(announced_hz: f64, count_hz: f64, ground_s: f64) -> Option<[f64; 2]> {
    let mut clock = FrameClock::new();
    let ms = |number: i64| 1e3 * number as f64 / count_hz + jitter_ms(number);
    let ground = whole(count_hz * ground_s);
    for number in 0..ground {
        late_ms(&mut clock, number, announced_hz, ms(number));
    }
    clock.set_airborne(true);
    let mut late_max_ms = [0.0_f64; 2];
    for number in ground..ground + whole(120.0 * count_hz) {
        let late_ms = late_ms(&mut clock, number, announced_hz, ms(number))?;
        let is_later = (number - ground) as f64 > 10.0 * count_hz;
        let late_max_ms = &mut late_max_ms[usize::from(is_later)];
        *late_max_ms = late_max_ms.max(late_ms);
    }
    Some(late_max_ms)
}

#[test]
fn a_rate_that_is_wrong_by_thousandths_is_learned_in_flight() {
    let rates_hz = [(241.0, 240.0), (60.0, 59.94), (100.3, 100.0), (500.0, 498.0)];
    for (a_hz, b_hz) in rates_hz {
        for (announced_hz, count_hz) in [(a_hz, b_hz), (b_hz, a_hz), (b_hz, b_hz)] {
            for ground_s in [0.5, 5.0, 31.0] {
                let late_max_ms = late_max_ms(announced_hz, count_hz, ground_s);
                // Seven of jitter, and up to four per second until five seconds show the rate.
                let is_good = late_max_ms.is_some_and(|[first, then]| first < 30.0 && then < 10.0);
                let trouble = format!("{announced_hz} for {count_hz} Hz after {ground_s} s");
                assert!(is_good, "{trouble}: {late_max_ms:?} ms");
            }
        }
    }
}

#[test]
fn a_delay_that_grows_more_than_earlier_frames_allow_is_no_rate() {
    // After so many seconds without it: ten milliseconds in that time are jitter, more is not.
    for (healthy_s, growth_ms_per_s) in [(10, 4.0), (20, 3.0), (60, 1.5), (120, 1.0)] {
        let mut clock = flying();
        let begin = ON_GROUND + 50 * (healthy_s - 10);
        for number in ON_GROUND..begin + 50 * 120 {
            let behind_ms = growth_ms_per_s * (number - begin).max(0) as f64 / RATE_HZ;
            let late_ms = late_after_ms(&mut clock, number, behind_ms);
            let hidden_ms = late_ms.map(|late_ms| behind_ms - late_ms);
            let is_seen = hidden_ms.is_some_and(|hidden_ms| hidden_ms < 12.0);
            assert!(is_seen, "{growth_ms_per_s} after {healthy_s} s: {hidden_ms:?} of {behind_ms}");
        }
    }
}

#[test]
fn a_step_of_the_delay_is_no_rate() {
    for step_ms in [20.0, 45.0, 80.0] {
        let mut clock = flying();
        for number in in_flight(300) {
            let seconds = (number - ON_GROUND) as f64 / RATE_HZ;
            let behind_ms = if seconds < 20.0 { 0.0 } else { step_ms };
            let late_ms = late_after_ms(&mut clock, number, behind_ms + jitter_ms(number));
            // Beside the drift that is followed: 28 ms in 280 s at most.
            let is_seen = late_ms.is_some_and(|late_ms| late_ms > behind_ms - 28.1);
            assert!(is_seen, "{step_ms} ms after {seconds} s: {late_ms:?}");
        }
        let number = in_flight(300).end;
        let late_ms = late_after_ms(&mut clock, number, 0.0);
        assert!(is_near(late_ms, 0.0), "{step_ms} ms, at once after it: {late_ms:?}");
    }
}

#[test]
fn a_wrong_rate_is_learned_across_stalls_and_lost_frames() {
    for (announced_hz, count_hz) in [(241.0, 240.0), (240.0, 241.0)] {
        let mut clock = FrameClock::new();
        let mut released_ms = 0.0;
        let take_off = whole(3.0 * count_hz);
        for number in 0..whole(180.0 * count_hz) {
            clock.set_airborne(number >= take_off);
            let due_ms = 1e3 * number as f64 / count_hz + jitter_ms(number);
            // Once in two seconds nothing comes for 80 ms, then all of it at once; a tenth is lost.
            if number % whole(2.0 * count_hz) == 0 {
                released_ms = due_ms + 80.0;
            }
            if number * 31 % 10 == 0 {
                continue;
            }
            let late_ms = late_ms(&mut clock, number, announced_hz, due_ms.max(released_ms));
            assert!(late_ms.is_some_and(|late_ms| late_ms < 105.0), "{number}: {late_ms:?} ms");
        }
        let number = whole(180.0 * count_hz);
        let late_ms = late_ms(&mut clock, number, announced_hz, 1e3 * number as f64 / count_hz);
        assert!(late_ms.is_some_and(|late_ms| late_ms < 2.0), "{late_ms:?} ms");
    }
}
