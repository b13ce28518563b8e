//! Positions and paths beside obstacles, at the distances that decide.

use super::super::WallTable;
use super::super::tests::{POLE, TABLE};
use super::*;
use crate::ObstacleTable;

#[test]
fn one_who_walks_past_may_turn_and_one_who_stands_does_not() {
    let moving = ObstacleTable::Moving { radius_m: 0.2 };
    let may_come = |table: &WallTable, speed_mps: f64, apart_m: f64| {
        let mut walls =
            Walls::new(Some(table), None, std::slice::from_ref(&moving)).unwrap().unwrap();
        for k in 0..100 {
            walls.follow_obstacle(
                Some([0.02 * speed_mps * f64::from(k), 1e-4 * f64::from(k % 2), 1.0]),
                None,
                0.02,
            );
        }
        // Beside the newest position: by its velocity the obstacle comes no nearer.
        let at_w = Vector3::new(0.02 * speed_mps * 99.0, apart_m, 1.0);
        assert!(!walls.is_approached(&at_w), "{speed_mps} m/s, {apart_m} m");
        walls.may_be_approached(&at_w)
    };
    let reach_m = 0.2 + TABLE.margin_m + 4.0;
    assert_eq!([0.99, 1.01].map(|part| may_come(&TABLE, 1.0, part * reach_m)), [true, false]);
    assert_eq!([0.29, 0.31].map(|speed_mps| may_come(&TABLE, speed_mps, 1.0)), [false, true]);
    let of_older_settings = WallTable { obstacle_accel_mps2: 0.0, ..TABLE };
    assert!(!may_come(&of_older_settings, 1.0, 1.0), "it may not accelerate");
}

#[test]
fn a_vehicle_in_flight_is_inside_of_obstacles_that_do_not_move_alone() {
    let still = ObstacleTable::Box { x_m: [0.0, 1.0], y_m: [0.0, 1.0], z_m: [0.0, 2.0] };
    let walls = Walls::new(Some(&TABLE), None, &[still, ObstacleTable::Moving { radius_m: 0.2 }])
        .unwrap()
        .unwrap();
    let is_inside = |x_m| walls.is_in_fixed(&Vector3::new(x_m, 0.5, 0.9));
    assert!(is_inside(0.01) && is_inside(0.99));
    assert!(!is_inside(-0.01) && !is_inside(1.01), "within its margin");
    let is_beside = |x_m| walls.is_beside_fixed(&Vector3::new(x_m, 0.5, 0.9));
    assert_eq!([-0.61, -0.59, 0.5, 1.59, 1.61].map(is_beside), [false, true, true, true, false]);
}

#[test]
fn a_position_or_a_path_that_is_no_number_counts_as_near_to_obstacles_that_do_not_move() {
    let still = || ObstacleTable::Box { x_m: [0.0, 1.0], y_m: [0.0, 1.0], z_m: [0.0, 2.0] };
    let free_w = Vector3::new(5.0, 5.0, 1.0);
    for obstacles in [vec![POLE], vec![still(), POLE], vec![POLE, still()]] {
        let walls = Walls::new(Some(&TABLE), None, &obstacles).unwrap().unwrap();
        assert!(!walls.is_beside_fixed(&free_w) && !walls.fixed_blocks_path(&free_w, &free_w));
        let at_w = Vector3::new(f64::NAN, 5.0, 1.0);
        assert!(walls.is_in_fixed(&at_w) && walls.is_beside_fixed(&at_w), "{obstacles:?}");
        assert!(walls.fixed_blocks_path(&at_w, &free_w), "{obstacles:?}");
        assert!(walls.fixed_blocks_path(&free_w, &at_w), "{obstacles:?}");
    }
}

#[test]
fn a_path_is_blocked_by_an_obstacle_that_moves_between_its_ends_or_beside_one_of_them() {
    let moving = ObstacleTable::Moving { radius_m: 0.5 };
    let mut walls = Walls::new(Some(&TABLE), None, &[moving, POLE]).unwrap().unwrap();
    let to_w = Vector3::new(0.0, 0.0, 1.0);
    let is_blocked =
        |walls: &Walls, x_m: f64| walls.moving_blocks_path(&Vector3::new(x_m, 0.0, 1.3), &to_w);
    assert!(!is_blocked(&walls, 2.0), "nobody knows where it is");
    for _ in 0..100 {
        walls.follow_obstacle(Some([1.2, 0.3, 0.0]), None, 0.02);
    }
    // Behind it, inside of it, driven on by it within 0.6 m and beyond, and on the far side of the reference.
    let blocked = [(3.0, true), (1.0, true), (0.3, true), (0.05, false), (-3.0, false)];
    for (x_m, is_expected) in blocked {
        assert_eq!(is_blocked(&walls, x_m), is_expected, "{x_m} m");
    }
    for _ in 0..100 {
        walls.follow_obstacle(Some([-0.2, 0.0, 0.0]), None, 0.02);
    }
    assert!(is_blocked(&walls, 2.0), "it stands where the vehicle is to be");
}

#[test]
fn only_an_obstacle_that_comes_near_within_four_seconds_bars_a_start() {
    let moving = ObstacleTable::Moving { radius_m: 0.3 };
    let is_blocked = |aside_m: f64, away_m: f64, speed_mps: f64| {
        let mut walls =
            Walls::new(Some(&TABLE), None, std::slice::from_ref(&moving)).unwrap().unwrap();
        for k in 0..100 {
            let x_m = -away_m + speed_mps * 0.02 * f64::from(k - 99);
            walls.follow_obstacle(Some([x_m, aside_m, 1.0]), None, 0.02);
        }
        walls.blocks_take_off(&Vector3::zeros())
    };
    // 0.3 m more than the margin from its surface, for the drift of a climb.
    assert!(is_blocked(0.0, 0.69, 0.0) && !is_blocked(0.0, 0.71, 0.0), "it stands");
    assert!(is_blocked(0.0, 4.2, 1.0) && !is_blocked(0.0, 4.6, 1.0), "it comes");
    assert!(is_blocked(0.35, 2.0, 1.0) && !is_blocked(0.5, 2.0, 1.0), "it passes");
    assert!(!is_blocked(0.0, 1.0, -1.0), "it leaves");
}

#[test]
fn a_vehicle_stays_down_inside_of_an_obstacle_and_below_one_that_its_climb_meets() {
    let shelf = |low_m| ObstacleTable::Box { x_m: [0.0, 1.0], y_m: [0.0, 1.0], z_m: [low_m, 2.4] };
    let is_blocked = |obstacle: ObstacleTable, x_m: f64, z_m: f64| {
        let walls = Walls::new(Some(&TABLE), None, &[obstacle]).unwrap().unwrap();
        walls.blocks_take_off(&Vector3::new(x_m, 0.5, z_m))
    };
    assert!(is_blocked(shelf(-0.1), 0.5, 0.05), "inside");
    assert!(is_blocked(shelf(1.3), 0.5, 0.05) && !is_blocked(shelf(1.4), 0.5, 0.05), "above");
    assert!(!is_blocked(shelf(1.3), 1.1, 0.05), "beside");
    assert!(!is_blocked(shelf(-0.1), 0.5, 2.45), "on top");
}

#[test]
fn an_obstacle_of_any_thickness_in_the_climb_keeps_the_vehicle_down() {
    let shelf = |z_m| ObstacleTable::Box { x_m: [0.0, 1.0], y_m: [0.0, 1.0], z_m };
    let disc = |z_m| ObstacleTable::Cylinder { centre_m: [0.4, 0.5], radius_m: 0.2, z_m };
    // From 0.05 m the climb ends at 1.35 m.
    for (z_m, is_barred) in [
        ([0.58, 0.62], true),
        ([0.999, 1.001], true),
        ([1.345, 1.35], true),
        ([1.355, 1.36], false),
        ([0.045, 0.055], true),
        ([0.0, 0.045], false),
    ] {
        for obstacle in [shelf(z_m), disc(z_m)] {
            let walls = Walls::new(Some(&TABLE), None, std::slice::from_ref(&obstacle));
            let blocks_take_off =
                walls.unwrap().unwrap().blocks_take_off(&Vector3::new(0.5, 0.5, 0.05));
            assert_eq!(blocks_take_off, is_barred, "{obstacle:?}");
        }
    }
}

#[test]
fn a_path_along_an_obstacle_that_is_too_long_to_be_checked_is_one_through_it() {
    let bench = ObstacleTable::Box { x_m: [-2.0, 8.0], y_m: [-0.5, 0.5], z_m: [0.0, 1.0] };
    let walls = Walls::new(Some(&TABLE), None, &[bench]).unwrap().unwrap();
    let is_through = |y_m: f64, length_m: f64| {
        let [at_w, to_w] = [0.0, length_m].map(|x_m| Vector3::new(x_m, y_m, 0.5));
        walls.fixed_blocks_path(&at_w, &to_w)
    };
    assert!(is_through(0.4, 1.0), "inside of it");
    // 5 mm beside it each point is 0.01 m from the one before: 200 of them are 1.99 m.
    assert!(!is_through(0.505, 1.98), "it is free");
    assert!(is_through(0.505, 2.0), "nobody has looked at its end");
    assert!(!is_through(0.6, 5.0), "with 0.1 m beside it");
}

#[test]
fn a_path_is_blocked_by_what_moves_within_60_cm_and_further_by_what_accelerates() {
    let moving = ObstacleTable::Moving { radius_m: 0.5 };
    // The amplitude of the acceleration, 2.25 m/s^2 per m of that of the position.
    for (amplitude_m, [low_mps2, high_mps2]) in
        [(0.0, [0.0, 0.01]), (0.3, [0.55, 0.9]), (1.0, [1.0, 1.0])]
    {
        let mut walls =
            Walls::new(Some(&TABLE), None, std::slice::from_ref(&moving)).unwrap().unwrap();
        for k in 0..500 {
            let x_m = amplitude_m * (1.5 * 0.02 * f64::from(k)).sin();
            walls.follow_obstacle(Some([x_m, 0.0, 1.0]), None, 0.02);
        }
        let shown_mps2 = walls.shown_accel_mps2();
        assert!((low_mps2..=high_mps2).contains(&shown_mps2), "{amplitude_m} m: {shown_mps2}");
        let limit_m = 0.6 + 0.5 * (shown_mps2 - 0.5).max(0.0);
        let at_w = walls.moving.position(0.0).unwrap();
        let is_blocked = |beside_m: f64| {
            let from_w = at_w + Vector3::new(0.0, 0.5 + beside_m, 0.0);
            walls.moving_blocks_path(&from_w, &(from_w + Vector3::new(0.0, 3.0, 0.4)))
        };
        assert!(is_blocked(limit_m - 0.01) && !is_blocked(limit_m + 0.01), "{amplitude_m} m");
    }
}

#[test]
fn a_take_off_keeps_30_cm_more_than_a_plan_from_what_moves() {
    assert!((climb_beside_m(0.12) - 0.42).abs() < 1e-12);
}
