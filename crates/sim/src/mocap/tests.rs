use super::*;

/// Draws of a single fault.
const STEPS: u32 = 1_000_000;
/// Steps of the whole stream, which draws 16 normals each.
const STREAM_STEPS: u32 = 300_000;

fn truth() -> Pose {
    Pose::new(1.0, -2.0, 1.3, 0.4)
}

/// Three standard deviations of a count with the given mean.
fn assert_count(what: &str, count: usize, expected: f64) {
    let gap = (count as f64 - expected).abs();
    assert!(gap < 3.0 * expected.sqrt(), "{what}: {count} instead of {expected:.0}");
}

/// Lengths of the episodes that `begin` started in a million free steps.
fn lengths(mut begin: impl FnMut() -> Option<u32>) -> Vec<u32> {
    (0..STEPS).filter_map(|_| begin()).collect()
}

fn count(lengths: &[u32], shortest: u32, longest: u32) -> usize {
    lengths.iter().filter(|steps| (shortest..=longest).contains(steps)).count()
}

#[test]
fn stalls_have_their_rates_and_lengths() {
    let mut random = Random::new(21, Purpose::Stall);
    let stalls = lengths(|| stall_steps(&mut random, &TYPICAL));
    let free = f64::from(STEPS);
    for (steps, fraction) in (1..).zip(SHORT_STALL_FRACTIONS) {
        let expected = free * 0.06 * 0.997 * fraction;
        assert_count(&format!("stalls of {steps}"), count(&stalls, steps, steps), expected);
    }
    for (fraction, shortest, longest) in
        [(0.4, 6, 13), (0.4, 14, 17), (0.13, 19, 27), (0.07, 44, 46)]
    {
        let expected = free * 0.003 * fraction;
        let range = format!("stalls of {shortest}..={longest}");
        assert_count(&range, count(&stalls, shortest, longest), expected);
    }
    let ends = [6, 13, 14, 17, 19, 27, 44, 46];
    assert!(ends.iter().all(|steps| stalls.contains(steps)), "an end of a range never occurs");
}

#[test]
fn losses_and_flips_have_their_rates_and_lengths() {
    for (purpose, rate, length, single, tail) in [
        (Purpose::Zero, 0.002, ZERO_LENGTH, 0.70, 5.0_f64),
        (Purpose::Flip, 0.006, FLIP_LENGTH, 0.45, 6.0),
    ] {
        let mut random = Random::new(22, purpose);
        let found = lengths(|| episode_steps(&mut random, rate, length));
        let all = f64::from(STEPS) * rate;
        assert_count("episodes", found.len(), all);
        assert_count("of one step", count(&found, 1, 1), all * single);
        // 2 + round(exp) exceeds 11 where exp > 9.5.
        let long = all * (1.0 - single) * (-9.5 / tail).exp();
        assert_count("of 12 and more", count(&found, 12, u32::MAX), long);
    }
}

/// Fractions of steps that are silent, lost, and reported with a heading off by more than 0.3 rad.
fn fractions(profile: Profile) -> [f64; 3] {
    let mut mocap = Mocap::new(profile, 23);
    let (mut silent, mut lost, mut flipped) = (0, 0, 0);
    for _ in 0..STREAM_STEPS {
        match mocap.observe(&truth()) {
            MocapReport::Silent => silent += 1,
            MocapReport::Lost => lost += 1,
            MocapReport::Pose(o) => {
                flipped +=
                    u32::from(angle::wrap(o[pose::THETA] - truth()[pose::THETA]).abs() > 0.3);
            }
        }
    }
    let seen = STREAM_STEPS - silent - lost;
    let fraction = |count, of| f64::from(count) / f64::from(of);
    [fraction(silent, STREAM_STEPS), fraction(lost, STREAM_STEPS - silent), fraction(flipped, seen)]
}

#[test]
fn a_bad_day_looks_like_the_identification_flights() {
    let [silent, lost, flipped] = fractions(Profile::BadDay);
    // Measured 21 %, 2.4 %, 3.9 %. The rare losses of seconds, in the measured fraction, are not modelled.
    assert!((0.19..0.24).contains(&silent), "stalled {silent}");
    assert!((0.014..0.025).contains(&lost), "lost {lost}");
    assert!((0.032..0.046).contains(&flipped), "flipped {flipped}");
}

#[test]
fn a_good_day_is_better_and_a_clean_one_perfect() {
    let [silent, lost, flipped] = fractions(Profile::GoodDay);
    // 0.01 starts of 1.4 steps, 1e-4 of 2.8, and the flips of the mean day: 0.006 of 4.8 steps.
    assert!((0.012..0.016).contains(&silent), "stalled {silent}");
    // 30 losses are expected, few of them long: 2.8e-4, with a deviation of 0.9e-4.
    assert!((0.2e-4..5.5e-4).contains(&lost), "lost {lost}");
    assert!((0.023..0.034).contains(&flipped), "flipped {flipped}");

    let mut mocap = Mocap::new(Profile::Clean, 23);
    for _ in 0..1000 {
        let MocapReport::Pose(o) = mocap.observe(&truth()) else {
            panic!("no pose on a clean day")
        };
        // Wrapping the heading rounds it.
        assert!((o - truth()).norm() < 1e-15, "{o}");
    }
}

#[test]
fn flips_are_spread_over_the_circle_and_hold_their_size() {
    let mut mocap = Mocap::new(Profile::Typical, 24);
    let mut sizes = Vec::new();
    for _ in 0..STREAM_STEPS {
        let was_flipped = mocap.flip.steps_left > 0;
        let before = mocap.flip_rad;
        mocap.observe(&truth());
        assert!(!was_flipped || before.to_bits() == mocap.flip_rad.to_bits(), "changed size");
        if before.to_bits() != mocap.flip_rad.to_bits() {
            sizes.push(mocap.flip_rad);
        }
    }
    assert!(sizes.iter().all(|size| (FLIP_MIN_RAD..=PI).contains(&size.abs())));
    let quarter = sizes.len() as f64 / 4.0;
    let middle = f64::midpoint(FLIP_MIN_RAD, PI);
    for (sign, range) in [(1.0, FLIP_MIN_RAD..middle), (-1.0, middle..PI)] {
        let count = sizes.iter().filter(|size| range.contains(&(sign * **size))).count();
        assert_count("flips in a quarter", count, quarter);
    }
}

#[test]
fn noise_has_its_quartiles() {
    let mut mocap = Mocap::new(Profile::GoodDay, 25);
    let (mut near, mut near_theta, mut seen) = (0, 0, 0);
    for _ in 0..100_000 {
        if let MocapReport::Pose(o) = mocap.observe(&truth()) {
            seen += 1;
            // Half of a Student t with 3 degrees lies within 0.7649 of its scale.
            near += u32::from((o[pose::Y] + 2.0).abs() < 0.7649 * 0.3e-3);
            near_theta += u32::from((o[pose::THETA] - 0.4).abs() < 0.7649 * 3e-3);
        }
    }
    let fraction = f64::from(near) / f64::from(seen);
    // Three standard deviations of a proportion of 100 000; flips take 2.8 % of the headings away.
    assert!((fraction - 0.5).abs() < 0.005, "{fraction} within the quartiles");
    let fraction = f64::from(near_theta) / f64::from(seen);
    assert!((fraction - 0.486).abs() < 0.007, "{fraction} of the headings within the quartiles");
}

#[test]
fn heading_is_reported_in_the_interval_open_below() {
    let mut mocap = Mocap::new(Profile::Clean, 1);
    for (theta, expected) in
        [(PI, PI), (-PI, PI), (4.0, 4.0 - 2.0 * PI), (-9.0, 4.0 * PI - 9.0 - 2.0 * PI)]
    {
        let mut at = truth();
        at[pose::THETA] = theta;
        let MocapReport::Pose(o) = mocap.observe(&at) else { panic!("no pose on a clean day") };
        assert!((o[pose::THETA] - expected).abs() < 1e-12, "{theta} became {}", o[pose::THETA]);
    }
}

#[test]
fn a_fault_more_leaves_the_others_as_they_were() {
    let silent = |rates: Rates| -> Vec<bool> {
        let mut mocap = Mocap { rates: Some(rates), ..Mocap::new(Profile::Clean, 26) };
        (0..5000).map(|_| mocap.observe(&truth()) == MocapReport::Silent).collect()
    };
    let without = silent(Rates { zero: 0.0, flip: 0.0, ..TYPICAL });
    assert_eq!(silent(TYPICAL), without);
    assert!(without.contains(&true));
}
