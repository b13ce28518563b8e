//! Limits, holds and headings of the outlier filter.

use std::f64::consts::{PI, TAU};

use super::*;

fn table() -> FilterTable {
    FilterTable {
        horizontal_base_m: 0.3,
        horizontal_growth_m: 0.1,
        vertical_base_m: 0.3,
        vertical_growth_m: 0.06,
        angle_base_rad: 0.15,
        angle_growth_rad: 0.04,
        angle_growth_refused_rad: None,
        floor_m: 0.01,
        origin_m: 0.001,
    }
}

/// A filter whose reference is `o`.
fn filter_at(o: &Pose) -> PoseFilter {
    let mut filter = PoseFilter::new((&table()).try_into().unwrap());
    assert_eq!(filter.update(Some(o)).position, Acceptance::Accepted);
    filter
}

#[test]
fn nothing_is_accepted_before_the_first_sight() {
    let mut filter = PoseFilter::new((&table()).try_into().unwrap());
    let lost = Pose::new(0.0, -0.0009, 0.0, 1.0);
    let nan = Pose::new(0.0, f64::NAN, 1.0, 0.0);
    for raw in [None, Some(&lost), Some(&nan)] {
        let filtered = filter.update(raw);
        assert_eq!((filtered.o, filtered.position), (None, Acceptance::Missing), "{raw:?}");
    }
    let o = Pose::new(0.0, 0.0, 0.5, 1.0);
    assert_eq!(filter.update(Some(&o)).o, Some(o));
}

#[test]
fn heading_goes_on_over_the_wrap() {
    let mut filter = filter_at(&Pose::new(0.0, 0.0, 1.0, 3.1));
    let mut turned = 3.1;
    for k in 0..200 {
        turned += 0.1;
        let raw = Pose::new(0.0, 0.0, 1.0, wrap(turned));
        let filtered = filter.update(Some(&raw));
        let gap = filtered.o.map_or(f64::NAN, |o| o[pose::THETA] - turned);
        assert!(gap.abs() < 1e-9, "gap {gap} at {k}");
    }
    assert!(turned > 3.0 * TAU);
}

#[test]
fn a_jump_is_held_until_the_limit_has_grown_to_it() {
    let start = Pose::new(0.0, 0.0, 1.0, 0.0);
    for (raw, expected) in [
        (Pose::new(0.31, 0.0, 1.0, 0.0), 1),
        (Pose::new(0.6, 0.8, 1.0, 0.0), 7),
        (Pose::new(0.0, 0.0, 1.5, 0.0), 4),
    ] {
        let mut filter = filter_at(&start);
        let held = (0..100).take_while(|_| filter.update(Some(&raw)).position == Acceptance::Held);
        assert_eq!(held.count(), expected, "{raw}");
    }
    let mut filter = filter_at(&start);
    let below = Pose::new(0.0, 0.0, 0.009, 0.0);
    assert!((0..100).all(|_| filter.update(Some(&below)).position == Acceptance::Held));
}

#[test]
fn a_flipped_heading_is_held_while_the_position_goes_on() {
    let mut filter = filter_at(&Pose::new(0.0, 0.0, 1.0, 0.2));
    for k in 1..=10 {
        let x = 0.02 * f64::from(k);
        let filtered = filter.update(Some(&Pose::new(x, 0.0, 1.0, 0.2 - PI)));
        assert_eq!((filtered.position, filtered.heading), (Acceptance::Accepted, Acceptance::Held));
        assert_eq!(filtered.o, Some(Pose::new(x, 0.0, 1.0, 0.2)));
    }
    let back = filter.update(Some(&Pose::new(0.2, 0.0, 1.0, 0.25)));
    assert_eq!(back.heading, Acceptance::Accepted);
}

#[test]
fn a_heading_that_is_seen_and_refused_widens_its_limit_by_its_own_growth() {
    let own = FilterTable { angle_growth_refused_rad: Some(0.01), ..table() };
    let mut filter = PoseFilter::new((&own).try_into().unwrap());
    let turned = |theta: f64| Pose::new(0.0, 0.0, 1.0, theta);
    filter.update(Some(&turned(0.0)));
    // 0.15 + 0.01 n reaches 0.595 after 45 samples.
    let held =
        (0..100).take_while(|_| filter.update(Some(&turned(0.595))).heading == Acceptance::Held);
    assert_eq!(held.count(), 45);
    // Missing samples widen it as before: 0.15 + 0.04 * 9, and 0.01 for one that was refused.
    for _ in 0..9 {
        filter.update(None);
    }
    assert_eq!(filter.update(Some(&turned(0.595 + 0.515))).heading, Acceptance::Held);
    assert_eq!(filter.update(Some(&turned(0.595 + 0.515))).heading, Acceptance::Accepted);
    // A refused heading that is the estimate's is accepted.
    let raw = turned(-2.0);
    let filtered = filter.update(Some(&raw));
    assert_eq!(filter.confirm_heading(&raw, -1.8, filtered).heading, Acceptance::Held);
    let confirmed = filter.confirm_heading(&raw, -2.1 + TAU, filtered);
    assert_eq!(confirmed.heading, Acceptance::Accepted);
    assert!(wrap(confirmed.o.unwrap()[pose::THETA] + 2.0).abs() < 1e-12);
    assert_eq!(filter.update(Some(&turned(-2.1))).heading, Acceptance::Accepted);
    let mut without = filter_at(&turned(0.0));
    let filtered = without.update(Some(&raw));
    assert_eq!(without.confirm_heading(&raw, -2.0, filtered), filtered);
    let error = FilterSettings::try_from(&FilterTable {
        angle_growth_refused_rad: Some(f64::NAN),
        ..table()
    })
    .unwrap_err();
    assert_eq!(error.key, "angle_growth_refused_rad");
}

#[test]
fn missing_samples_widen_both_limits() {
    let mut filter = filter_at(&Pose::new(0.0, 0.0, 1.0, 0.0));
    let far = Pose::new(1.0, 0.0, 1.0, 0.5);
    for _ in 0..9 {
        assert_eq!(filter.update(None).position, Acceptance::Missing);
    }
    let filtered = filter.update(Some(&far));
    assert_eq!((filtered.position, filtered.heading), (Acceptance::Accepted, Acceptance::Accepted));
}

#[test]
fn a_bad_setting_is_named() {
    let bad = FilterTable { vertical_base_m: f64::NAN, ..table() };
    let error = FilterSettings::try_from(&bad).unwrap_err();
    assert_eq!(error.to_string(), "vertical_base_m = NaN: expected 0.01..=5.0");
    let in_degrees = FilterTable { angle_base_rad: 8.6, ..table() };
    let error = FilterSettings::try_from(&in_degrees).unwrap_err();
    assert_eq!(error.to_string(), "angle_base_rad = 8.6: expected 0.01..=3.15");
    let in_millimetres = FilterTable { horizontal_growth_m: 100.0, ..table() };
    let error = FilterSettings::try_from(&in_millimetres).unwrap_err();
    assert_eq!(error.to_string(), "horizontal_growth_m = 100: expected 0.0..=1.0");
    let wide = FilterTable { origin_m: 0.5, ..table() };
    let error = FilterSettings::try_from(&wide).unwrap_err();
    assert_eq!(error.to_string(), "origin_m = 0.5: expected 0.0..=0.1");
}

#[test]
fn several_frames_a_period_loosen_the_limits_no_faster_than_one() {
    let start = Pose::new(0.0, 0.0, 1.0, 0.0);
    let mut filters = [1, 2, 5, 10].map(|frames| (frames, filter_at(&start)));
    let far = Pose::new(2.0, 0.0, 1.0, 0.0);
    let turned = Pose::new(0.0, 0.0, 1.0, 2.0);
    for raw in [far, turned] {
        let held = filters.each_mut().map(|(frames, filter)| {
            filter.restart();
            filter.update(Some(&start));
            let mut is_held = |period: usize| {
                // One pose of each period is wrong, the others repeat it.
                let first = filter.update(Some(&raw));
                let last = (1..*frames).fold(first, |_, _| filter.update_again(Some(&raw)));
                [last.position, last.heading].contains(&Acceptance::Held).then_some(period)
            };
            (0..1000).map_while(&mut is_held).count()
        });
        // The last frame of a period is checked by the hold that its first one has lengthened.
        let is_as_long = |periods: &usize| (held[0] - 1..=held[0]).contains(periods);
        assert!(held[0] > 5 && held.iter().all(is_as_long), "{held:?}");
    }
}

#[test]
fn a_first_sample_at_the_origin_or_below_the_floor_is_none() {
    use Acceptance::{Accepted, Missing};
    let first = |floor_m, raw: Pose| {
        let table = FilterTable { floor_m, ..table() };
        let mut filter = PoseFilter::new((&table).try_into().unwrap());
        filter.update(Some(&raw)).position
    };
    let at = |x_m, z_m| Pose::new(x_m, 0.0, z_m, 0.0);
    // The limits: 1 mm and 0.01 m, or far below.
    for (floor_m, raw, expected) in [
        (0.01, at(1.0, 0.009), Missing),
        (0.01, at(1.0, 0.01), Accepted),
        (-1.0, at(0.0, 0.0), Missing),
        (-1.0, at(0.000_9, -0.000_9), Missing),
        (-1.0, at(0.001, 0.0), Accepted),
        (-1.0, at(0.0, 0.001), Accepted),
        (-1.0, at(1.0, -1.1), Missing),
    ] {
        assert_eq!(first(floor_m, raw), expected, "{raw:?}, floor {floor_m} m");
    }
}
