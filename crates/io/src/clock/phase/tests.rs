//! The grid of the ticks against frames of sources with jitter, drift, stalls and other rates.

use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::*;

const PERIOD_NS: i64 = 20_000_000;
const WAIT_NS: i64 = 1_000_000;

/// A source as the host sees it.
#[derive(Clone, Copy)]
struct Source {
    /// By its own clock.
    frame_ns: f64,
    /// What its clock is too slow. ppm
    drift_ppm: f64,
    first_ns: f64,
    /// Arrivals are later by up to this, uniformly. ns
    jitter_ns: f64,
    /// Of a hundred frames so many begin a stall of ten, which ends in a burst.
    stalls_pct: u32,
}

const QUIET: Source =
    Source { frame_ns: 20e6, drift_ppm: 0.0, first_ns: 13.7e6, jitter_ns: 0.0, stalls_pct: 0 };

/// What a flight with a source shows once the ticks had time to find its phase. All in ns.
#[derive(Debug, Default)]
struct Seen {
    /// Age of the newest frame while the ticks went by the clock alone.
    first_age: f64,
    /// Ages of the newest frame when the ticks began, waits included.
    ages: Vec<f64>,
    /// Time from tick to tick.
    spans: Vec<f64>,
}

impl Seen {
    /// The age that this fraction of the ticks does not exceed. ms
    fn age_ms(&self, fraction: f64) -> f64 {
        let mut ages = self.ages.clone();
        ages.sort_by(f64::total_cmp);
        let above = (0..ages.len()).filter(|k| *k as f64 >= fraction * (ages.len() - 1) as f64);
        ages[above.min().unwrap()] * 1e-6
    }

    /// Largest difference of a span to the period. ms
    fn unevenness_ms(&self) -> f64 {
        let differences = self.spans.iter().map(|span| (span - PERIOD_NS as f64).abs());
        differences.max_by(f64::total_cmp).unwrap() * 1e-6
    }
}

/// In 0..1.
fn uniform(random: &mut ChaCha8Rng) -> f64 {
    f64::from(random.next_u32()) / f64::from(u32::MAX)
}

/// Ticks against `source` for `ticks` periods; what the second half of them shows.
fn tick(source: Source, ticks: u32) -> Seen {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut phase = FramePhase::new(SpanNs(PERIOD_NS), SpanNs(WAIT_NS));
    let mut seen = Seen::default();
    let mut due = TimeNs(0);
    let (mut number, mut stalled_until) = (0_i64, f64::NEG_INFINITY);
    let mut coming: Option<Sighting> = None;
    let mut next = || {
        number += 1;
        let sent_ns =
            source.first_ns + number as f64 * source.frame_ns * (1.0 + 1e-6 * source.drift_ppm);
        if sent_ns > stalled_until && 100.0 * uniform(&mut random) < f64::from(source.stalls_pct) {
            stalled_until = sent_ns + 10.0 * source.frame_ns;
        }
        let arrival_ns = sent_ns.max(stalled_until) + uniform(&mut random) * source.jitter_ns;
        let received_at = TimeNs(0).after(span(arrival_ns));
        Sighting { frame: 2 * number, measured_at: received_at, received_at, pose: None }
    };
    let (mut newest, mut last) = (TimeNs(0), None);
    for k in 0..ticks {
        let window = phase.window(due);
        let mut sightings = Vec::new();
        let mut begin = due;
        // All that arrives until the tick begins: at once, with its frame, or after the wait.
        loop {
            let sighting = *coming.get_or_insert_with(&mut next);
            let waits = window.is_some_and(|(from, _)| newest < from);
            let until = if waits { window.unwrap().1 } else { due };
            if sighting.received_at > until.max(begin) {
                begin = begin.max(until);
                break;
            }
            begin = begin.max(sighting.received_at);
            newest = newest.max(sighting.received_at);
            sightings.push(sighting);
            coming = None;
        }
        if k == 10 {
            seen.first_age = begin.since(newest).0 as f64;
        }
        if 2 * k > ticks {
            seen.ages.push(begin.since(newest).0 as f64);
            seen.spans.extend(last.map(|last| begin.since(last).0 as f64));
        }
        last = Some(begin);
        due = due.after(SpanNs(PERIOD_NS)).after(phase.correction(due, &sightings));
    }
    seen
}

#[test]
fn ticks_begin_with_their_frames() {
    // At first the frame waits for 20 - 13.7 ms.
    let begun_ms = 1e-6 * tick(QUIET, 2000).first_age;
    assert!((begun_ms - 6.3).abs() < 1e-3, "{begun_ms}");
    for first_ns in [0.0, 0.3e6, 5e6, 13.7e6, 19.9e6] {
        let seen = tick(Source { first_ns, ..QUIET }, 2000);
        assert!(seen.age_ms(1.0) < 1e-3, "{first_ns}: {} ms", seen.age_ms(1.0));
        assert!(seen.unevenness_ms() < 0.01, "{first_ns}: {} ms", seen.unevenness_ms());
    }
}

#[test]
fn rates_that_the_period_is_a_multiple_of_are_followed() {
    for rate_hz in [50.0, 100.0, 200.0, 250.0, 500.0] {
        for drift_ppm in [-100.0, 100.0] {
            let source = Source { frame_ns: 1e9 / rate_hz, drift_ppm, jitter_ns: 0.2e6, ..QUIET };
            let seen = tick(source, 4000);
            let case = format!("{rate_hz} Hz, {drift_ppm} ppm: {} ms", seen.age_ms(0.999));
            assert!(seen.age_ms(0.5) < 0.1 && seen.age_ms(0.999) < 0.5, "{case}");
            assert!(seen.unevenness_ms() <= 1.0, "{case}, {} ms", seen.unevenness_ms());
        }
    }
}

#[test]
fn other_rates_are_left_to_the_clock() {
    for rate_hz in [30.0, 40.0, 60.0, 120.0, 240.0, 49.0] {
        let source = Source { frame_ns: 1e9 / rate_hz, ..QUIET };
        let seen = tick(source, 2000);
        assert!(seen.unevenness_ms() == 0.0, "{rate_hz} Hz: {} ms", seen.unevenness_ms());
    }
}

/// One frame of a hundred misses its tick, and the others wait no longer than the jitter is long.
#[test]
fn a_tick_gives_a_jittering_source_the_time_that_it_needs() {
    for jitter_ms in [2.0, 5.0] {
        let source = Source { jitter_ns: 1e6 * jitter_ms, ..QUIET };
        let seen = tick(source, 20_000);
        let missed = seen.ages.iter().filter(|age| **age > 1e6 * jitter_ms).count();
        let missed = missed as f64 / seen.ages.len() as f64;
        assert!(missed < 0.02, "{jitter_ms} ms: {missed}");
        assert!(seen.age_ms(0.9) < jitter_ms, "{jitter_ms} ms: {}", seen.age_ms(0.9));
        assert!(seen.unevenness_ms() <= 1.5, "{jitter_ms} ms: {}", seen.unevenness_ms());
    }
}

#[test]
fn stalls_and_their_bursts_do_not_move_the_ticks() {
    let seen = tick(Source { stalls_pct: 2, jitter_ns: 0.2e6, ..QUIET }, 10_000);
    assert!(seen.age_ms(0.5) < 0.1, "{}", seen.age_ms(0.5));
    assert!(seen.unevenness_ms() <= 1.5, "{}", seen.unevenness_ms());
}

#[test]
fn a_source_that_changes_its_rate_is_learned_anew() {
    let period = SpanNs(PERIOD_NS);
    let mut phase = FramePhase::new(period, SpanNs(WAIT_NS));
    let mut due = TimeNs(0);
    let mut at = TimeNs(3_000_000);
    let mut number = 0;
    for (frame_ns, is_followed) in [(20_000_000, true), (27_000_000, false), (10_000_000, true)] {
        for _ in 0..1500 {
            let mut sightings = Vec::new();
            while at <= due.after(SpanNs(WAIT_NS)) {
                number += 1;
                let (measured_at, received_at) = (at, at);
                sightings.push(Sighting { frame: number, measured_at, received_at, pose: None });
                at = at.after(SpanNs(frame_ns));
            }
            due = due.after(period).after(phase.correction(due, &sightings));
        }
        assert_eq!(phase.window(due).is_some(), is_followed, "{frame_ns} ns");
    }
}

proptest! {
    /// Whatever numbers a source sends, and whenever: a period changes by half a millisecond at most.
    #[test]
    fn no_source_makes_the_ticks_uneven(
        frames in prop::collection::vec((any::<i64>(), 0_i64..60_000_000, any::<bool>()), 0..2000)
    ) {
        let mut phase = FramePhase::new(SpanNs(PERIOD_NS), SpanNs(WAIT_NS));
        let (mut due, mut at, mut number) = (TimeNs(0), TimeNs(0), 0_i64);
        for (any_number, gap_ns, is_next) in frames {
            at = at.after(SpanNs(if is_next { PERIOD_NS } else { gap_ns }));
            number = if is_next { number.wrapping_add(1) } else { any_number };
            let sighting = Sighting { frame: number, measured_at: at, received_at: at, pose: None };
            let step = phase.correction(due, &[sighting]);
            prop_assert!(step.0.abs() <= 500_000, "{step:?}");
            due = due.after(SpanNs(PERIOD_NS)).after(step);
        }
    }
}
