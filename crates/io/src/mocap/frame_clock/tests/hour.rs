//! An hour at the worst drift, with heavy jitter, a pause and a source that starts anew.

use super::*;

/// Ground, then flight, then the source starts anew in flight, then ground again. s
const TAKE_OFF_S: i64 = 120;
const PAUSE_S: std::ops::Range<i64> = 1_200..1_203;
const REBOOT_S: i64 = 3_000;
const LANDED_S: i64 = 3_300;
const END_S: i64 = 3_600;

/// Errors of the measurement times in an hour of 50 Hz whose clock differs by `drift`, by part: ground, flight, ground
/// after it; and how many frames had no time in each, and between reboot and landing. ms
fn hour(drift: f64, jitter_ms: f64) -> ([Vec<f64>; 3], [usize; 4]) {
    let mut clock = FrameClock::new();
    let (mut errors_ms, mut unknown) = ([const { Vec::new() }; 3], [0; 4]);
    let mut arrived_ms = 0.0_f64;
    for frame in 0..END_S * 50 {
        let second = frame / 50;
        if PAUSE_S.contains(&second) {
            continue;
        }
        clock.set_airborne((TAKE_OFF_S..LANDED_S).contains(&second));
        let number = if second < REBOOT_S { 1_000_000 + frame } else { frame - 50 * REBOOT_S };
        let measured_ms = PERIOD_MS * frame as f64 * (1.0 + drift);
        // A stream keeps the order of its frames.
        arrived_ms = arrived_ms.max(measured_ms + jitter_ms * uniform(frame));
        let late_ms = late_ms(&mut clock, number, RATE_HZ, arrived_ms);
        let part = match second {
            TAKE_OFF_S..REBOOT_S => 1,
            REBOOT_S..LANDED_S => 3,
            LANDED_S.. => 2,
            _ => 0,
        };
        match late_ms {
            None => unknown[part] += 1,
            Some(late_ms) => {
                errors_ms[part.min(2)].push((arrived_ms - late_ms - measured_ms).abs());
            }
        }
    }
    (errors_ms, unknown)
}

/// The value that `fraction` of all do not exceed.
fn at_most(values: &mut [f64], fraction: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let last = values.len() - 1;
    values[usize::try_from(whole(fraction * last as f64)).unwrap()]
}

#[test]
fn an_hour_of_drift_jitter_pause_and_reboot_has_times_to_a_millisecond() {
    for drift in [-100e-6, 30e-6, 100e-6] {
        let (errors_ms, unknown) = hour(drift, 30.0);
        // Nothing is learned anew in flight: after the reboot no frame has a time until the landing.
        assert_eq!(unknown, [0, 0, 0, 15_000], "{drift}");
        let mut all_ms = errors_ms.concat();
        let [_, mut flight_ms, _] = errors_ms;
        let at_99 = [at_most(&mut all_ms, 0.99), at_most(&mut flight_ms, 0.99)];
        assert!(at_99.iter().all(|ms| (0.001..=1.0).contains(ms)), "{drift}: {at_99:?} ms");
        assert!(at_most(&mut flight_ms, 1.0) < 1.5, "{drift}");
    }
}
