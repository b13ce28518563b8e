use horizon_model::check::{jacobian_gap, minimum};
use nalgebra::Vector1;

use super::*;

fn of(text: &str) -> Result<Obstacle, String> {
    let table: ObstacleTable = serde_json::from_str(text).map_err(|error| error.to_string())?;
    Obstacle::try_from(&table).map_err(|error| error.to_string())
}

const CYLINDER: &str =
    r#"{"kind": "cylinder", "centre_m": [1, 2], "radius_m": 0.5, "z_m": [0, 2]}"#;
const BOX: &str = r#"{"kind": "box", "x_m": [0, 2], "y_m": [1, 2], "z_m": [0, 1]}"#;

#[test]
fn distances_are_those_of_the_nearest_surface() {
    for (text, at, distance_m) in [
        (CYLINDER, [2.0, 2.0, 1.0], 0.5),
        (CYLINDER, [1.0, 1.0, 0.2], 0.5),
        (CYLINDER, [1.2, 2.0, 1.0], -0.3),
        (CYLINDER, [1.0, 2.0, 1.9], -0.1),
        (CYLINDER, [1.8, 2.0, 2.4], 0.5),
        (CYLINDER, [1.0, 2.0, -0.25], 0.25),
        (BOX, [3.0, 1.5, 0.5], 1.0),
        (BOX, [2.3, 2.4, 0.5], 0.5),
        (BOX, [1.0, 1.9, 0.5], -0.1),
        (BOX, [1.0, 0.9, 0.5], 0.1),
    ] {
        let found_m = of(text).unwrap().distance(&Vector3::from(at)).distance_m;
        assert!((found_m - distance_m).abs() < 1e-12, "{text} at {at:?}: {found_m}");
    }
}

#[test]
fn the_gradient_meets_its_numeric_twin_outside_and_inside() {
    for text in [CYLINDER, BOX] {
        let obstacle = of(text).unwrap();
        for at in [
            [2.5, 2.7, 0.4],
            [2.2, 2.3, 2.6],
            [0.2, 0.1, -0.5],
            [0.9, 1.7, 0.45],
            [1.31, 1.62, 0.3],
            [-3.0, 1.4, 0.9],
            [1.1, 1.9, 1.93],
        ] {
            let at = Vector3::from(at);
            let value = |at: &Vector3<f64>| Vector1::new(obstacle.distance(at).distance_m);
            let gradient = obstacle.distance(&at).gradient_w;
            let gap = jacobian_gap(value, &at, &gradient.transpose());
            assert!(gap < 1e-8, "gap {gap:e} of {text} at {at}");
            assert!((gradient.norm() - 1.0).abs() < 1e-12, "{gradient}");
        }
    }
}

#[test]
fn what_moves_is_where_it_is_now_and_nowhere_while_unseen() {
    let obstacle = of(r#"{"kind": "moving", "radius_m": 0.3}"#).unwrap();
    let at = Vector3::new(1.0, 2.0, 1.5);
    assert!(obstacle.is_moving() && obstacle.distance(&at).distance_m > 1e9);
    let position = Vector3::new(0.4, 1.2, 0.1);
    let found = obstacle.distance_from(&at, Some(&position));
    assert!((found.distance_m - 0.7).abs() < 1e-12, "{found:?}");
    let value =
        |at: &Vector3<f64>| Vector1::new(obstacle.distance_from(at, Some(&position)).distance_m);
    let gap = jacobian_gap(value, &at, &found.gradient_w.transpose());
    assert!(gap < 1e-8, "gap {gap:e}");
}

#[test]
fn the_least_distance_in_a_climb_is_that_of_its_nearest_height() {
    let (climb_m, count) = (1.3, 1300);
    for text in [CYLINDER, BOX] {
        let obstacle = of(text).unwrap();
        for from_w in [[1.2, 1.9, -2.0], [1.2, 1.9, -0.9], [0.7, 1.6, 0.6], [3.0, 1.5, 2.1]] {
            let from_w = Vector3::from(from_w);
            let above_w = |k| from_w + Vector3::z() * (climb_m * f64::from(k) / f64::from(count));
            let sampled_m = (0..=count).map(|k| obstacle.distance(&above_w(k)).distance_m);
            let sampled_m = sampled_m.reduce(minimum).unwrap();
            let found_m = obstacle.distance_in_climb(&from_w, climb_m, None).distance_m;
            assert!((-1e-12..0.001).contains(&(sampled_m - found_m)), "{text}: {found_m}");
        }
    }
}

#[test]
fn the_axis_of_a_cylinder_has_a_gradient_too() {
    let found = of(CYLINDER).unwrap().distance(&Vector3::new(1.0, 2.0, 1.0));
    assert_eq!((found.distance_m, found.gradient_w), (-0.5, Vector3::x()));
}

#[test]
fn what_is_no_obstacle_is_refused() {
    for (text, good, bad, refusal) in [
        (CYLINDER, "0.5", "0", "radius_m = 0: expected finite and > 0"),
        (CYLINDER, "0.5", "1000.1", "radius_m = 1000.1: expected 0.0..=1000.0"),
        (CYLINDER, "[1, 2]", "[1, -1e300]", "centre_m[1] = -1"),
        (BOX, "[1, 2]", "[1, 1000.1]", "y_m = 1000.1: expected -1000.0..=1000.0"),
        (CYLINDER, "[0, 2]", "[2, 0]", "z_m = [2, 0]: expected the first number below the second"),
        (CYLINDER, "[1, 2]", "[1, 1e999]", "number out of range"),
        (BOX, "[1, 2]", "[2, 2]", "y_m = [2, 2]: expected the first number below the second"),
        (BOX, "\"z_m\"", "\"height_m\"", "unknown field `height_m`"),
        (BOX, "box", "sphere", "unknown variant `sphere`"),
    ] {
        let changed = text.replacen(good, bad, 1);
        assert_ne!(changed, text);
        let refused = of(&changed).unwrap_err();
        assert!(refused.starts_with(refusal), "{changed}: {refused}");
    }
    let moving = || ObstacleTable::Moving { radius_m: 0.3 };
    let refused = obstacles(&[moving(), moving()]).unwrap_err().to_string();
    assert!(refused.starts_with("obstacles[1] = moving: expected one"), "{refused}");
    let nan = ObstacleTable::Box { x_m: [f64::NAN, 1.0], y_m: [0.0, 1.0], z_m: [0.0, 1.0] };
    let refused = obstacles(&[nan]).unwrap_err().to_string();
    assert!(refused.starts_with("obstacles[0].x_m = NaN: expected -1000.0..=1000.0"), "{refused}");
}

#[test]
fn the_outline_goes_around_the_obstacle_once_counter_clockwise() {
    let circle_m2 = 24.0 * 0.25 * (std::f64::consts::TAU / 48.0).sin();
    for (text, z_m, expected_m2) in [(CYLINDER, 1.0, circle_m2), (BOX, 0.5, 2.0)] {
        let obstacle = of(text).unwrap();
        let outline = obstacle.outline();
        let twice_m2 = |pair: &[(f64, f64)]| pair[0].0 * pair[1].1 - pair[1].0 * pair[0].1;
        let area_m2 = 0.5 * outline.windows(2).map(twice_m2).sum::<f64>();
        assert!((area_m2 - expected_m2).abs() < 1e-12, "{text}: {area_m2}");
        let gap_m = outline.first().zip(outline.last()).map(|(a, b)| (a.0 - b.0).hypot(a.1 - b.1));
        assert!(gap_m.is_some_and(|gap_m| gap_m < 1e-12), "{text}: {outline:?}");
        for (x, y) in outline {
            let gap_m = obstacle.distance(&Vector3::new(x, y, z_m)).distance_m;
            assert!(gap_m.abs() < 1e-12, "{text}: {gap_m} at {x}, {y}");
        }
    }
}
