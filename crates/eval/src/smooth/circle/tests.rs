use super::*;

/// Angles are on the grid: half a point of rounding.
const GRID_RAD: f64 = 0.5 * SPACING_RAD + 1e-12;

fn worst(path: &[f64], truth: impl Fn(usize) -> f64) -> f64 {
    let gap = |(k, angle): (usize, &f64)| wrap(angle - truth(k)).abs();
    path.iter().enumerate().map(gap).fold(0.0, f64::max)
}

#[test]
fn a_path_without_noise_comes_back_over_the_end_of_the_circle() {
    // Three points in a period, through -pi and pi.
    let truth = |k: usize| wrap(3.0 + 3.0 * SPACING_RAD * k as f64);
    let samples: Vec<_> = (0..100).map(|k| Some(truth(k))).collect();
    let path = best_path(&samples);
    // Far from its ends, where a slower turn costs less, both sides of a point pull alike.
    assert!(worst(&path[15..85], |k| truth(15 + k)) < GRID_RAD, "{path:?}");
    assert!(path.iter().all(|angle| (-PI..PI).contains(angle)));
}

#[test]
fn the_path_knows_that_a_flip_ends_and_the_tracker_does_not() {
    let samples: Vec<_> = (0..150).map(|k| Some(if k < 120 { 0.0 } else { 1.5 })).collect();
    let (path, so_far) = (best_path(&samples), best_so_far(&samples));
    // Thirty samples off by 1.5 rad are a flip until they outweigh a turn.
    assert!(worst(&path[..110], |_| 0.0) < GRID_RAD, "{path:?}");
    assert!(worst(&so_far[..122], |_| 0.0) < GRID_RAD, "{so_far:?}");
    assert_eq!(path.last(), so_far.last(), "all samples are known at the end");
    let ends: Vec<_> = (0..150).map(|k| Some(if k % 150 < 20 { 1.5 } else { 0.0 })).collect();
    assert!(worst(&best_path(&ends), |_| 0.0) < GRID_RAD, "a flip at the begin is seen later");
    assert!(worst(&best_so_far(&ends)[..20], |_| 1.5) < GRID_RAD, "not before it ends");
}

#[test]
fn between_samples_the_path_goes_the_shorter_way_round_in_even_steps() {
    let mut samples = vec![None; 40];
    samples[..5].fill(Some(3.0));
    samples[35..].fill(Some(-3.0));
    let path = best_path(&samples);
    for pair in path.windows(2) {
        let step = wrap(pair[1] - pair[0]) / SPACING_RAD;
        assert!((-1e-6..1.0 + 1e-6).contains(&step), "{step} points");
    }
    // Five samples off by d points cost 5 d^2 / 32 (a standard deviation of 4 points), a step 0.35: d is 1.1.
    let pull_rad = 2.0 * SPACING_RAD + GRID_RAD;
    assert!(worst(&path[..5], |_| 3.0) < pull_rad, "{path:?}");
    assert!(worst(&path[35..], |_| -3.0) < pull_rad, "{path:?}");
}

#[test]
fn a_point_of_the_grid_is_the_nearest_of_its_angle() {
    for point in 0..POINTS {
        for off in [-0.49, 0.0, 0.49] {
            assert_eq!(point_of(angle_of(point) + off * SPACING_RAD), point, "{off}");
        }
    }
    assert_eq!((point_of(-PI), point_of(PI)), (0, 0));
}

#[test]
fn no_samples_are_no_path() {
    assert!(best_path(&[]).is_empty() && best_so_far(&[]).is_empty());
    assert_eq!(best_path(&[None; 3]).len(), 3);
}
