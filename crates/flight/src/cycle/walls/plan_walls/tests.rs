//! Values and gradients of the soft constraints of a plan.

use horizon_model::check::jacobian_gap;
use horizon_model::rows::{Motion, motion};
use horizon_model::{Kinematic, Lagged};
use nalgebra::{Matrix3, Vector1, Vector4};

use super::super::tests::{BLOCK, TABLE, walls};
use super::*;
use crate::cycle::WallTable;
use crate::{ObstacleTable, Room};

/// Rows of `lag`.
const P: [f64; 11] = [1.9, 0.89, 1.4, -0.06, 0.64, 0.25, 0.12, 0.07, 0.12, 0.08, 1.1];

#[test]
fn constraints_on_the_state_of_a_vehicle_meet_their_numeric_twins() {
    let model = Lagged::default();
    let walls = walls(Some(&TABLE)).unwrap().unwrap();
    let p = SVector::from(P);
    let constraints = PlanWalls { model: &model, p: &p, walls: &walls };
    assert_eq!(SoftConstraints::<11>::count(&constraints), 8);
    let mut seen = [0; 8];
    for at in [[0.5, 0.4, 0.9], [1.1, 0.3, 1.1], [-1.7, -0.6, 1.6], [-1.2, 0.1, 0.7]] {
        let mut s = Motion::zeros();
        (s[motion::X], s[motion::Y], s[motion::Z]) = (at[pose::X], at[pose::Y], at[pose::Z]);
        // Without a velocity both ends of the coasting are equally near: the constraint is nonsmooth there.
        (s[motion::V_X], s[motion::V_Y], s[motion::V_Z], s[motion::D_Y]) = (0.7, -0.2, 0.1, 0.05);
        for (i, seen) in seen.iter_mut().enumerate() {
            let Some(found) = constraints.excess(i, &s, 0.4) else { continue };
            *seen += 1;
            let value = |s: &Motion| {
                let excess = constraints.excess(i, s, 0.4);
                Vector1::new(excess.map_or(f64::NAN, |excess| excess.value))
            };
            let gap = jacobian_gap(value, &s, &found.gradient.transpose());
            assert!(gap < 1e-8, "gap {gap:e} of constraint {i} at {at:?}");
        }
    }
    // The wall at x = 3 is further away than 1 m from all of these positions.
    assert!(seen.iter().enumerate().all(|(i, seen)| (*seen > 0) == (i != 1)), "{seen:?}");
}

#[test]
fn the_position_at_rest_keeps_clear_of_walls_but_not_of_obstacles() {
    let model = Lagged::default();
    let (p, mut s) = (SVector::from(P), Motion::zeros());
    // 0.5 m before the pole and 2.7 m before the wall at x = 3; 0.64 s of its velocity bring it 1.2 m further.
    (s[motion::X], s[motion::Y], s[motion::Z], s[motion::V_X]) = (0.3, 0.2, 1.0, 1.875);
    let value = |coasting, i| {
        let table = WallTable { coasting, margin_m: 1.0, growth_mps: 0.0, ..TABLE };
        let walls = walls(Some(&table)).unwrap().unwrap();
        let excess = PlanWalls { model: &model, p: &p, walls: &walls }.excess(i, &s, 0.4);
        excess.map(|excess| excess.value)
    };
    let (wall, side, pole) = (1, 3, Room::WALLS);
    assert_eq!(value(0.0, wall), None);
    assert!(value(1.0, wall).is_some_and(|value| (value + 0.5).abs() < 1e-9));
    for i in [side, pole] {
        let change = value(1.0, i).zip(value(0.0, i)).map(|(with, without)| with - without);
        assert!(change.is_some_and(|change| change.abs() < 1e-12), "{i}: {change:?}");
    }
}

/// Excess of constraint `i` of `walls` at the pose `at`, 0.4 s after the beginning of the plan, by the kinematic model,
/// which does not coast.
fn excess_at(walls: &Walls, i: usize, at: [f64; 4]) -> Option<Excess<4>> {
    let p = Vector4::repeat(1.0);
    PlanWalls { model: &Kinematic, p: &p, walls }.excess(i, &Vector4::from(at), 0.4)
}

#[test]
fn the_value_is_the_missing_distance_and_the_gradient_leads_away_from_the_wall_or_obstacle() {
    let walls = walls(Some(&TABLE)).unwrap().unwrap();
    // The margin of 0.1 m has grown by 0.05 m/s for 0.4 s.
    let margin_m = 0.12;
    let (low_x, high_y, pole, block) = (0, 3, Room::WALLS, Room::WALLS + 1);
    for (i, at, distance_m, away_w) in [
        (low_x, [-1.75, 0.0, 1.0, 0.3], 0.25, [1.0, 0.0, 0.0]),
        (low_x, [-2.5, 0.0, 1.0, 0.3], -0.5, [1.0, 0.0, 0.0]),
        (high_y, [0.0, 0.5, 1.0, -3.0], 0.5, [0.0, -1.0, 0.0]),
        (pole, [1.0, 0.9, 1.0, 0.0], 0.5, [0.0, 1.0, 0.0]),
        (pole, [1.1, 0.2, 1.0, 0.0], -0.1, [1.0, 0.0, 0.0]),
        (block, [-1.25, 0.0, 1.4, 0.0], 0.4, [0.0, 0.0, 1.0]),
    ] {
        let found = excess_at(&walls, i, at).unwrap();
        let gap_m = found.value - (margin_m - distance_m);
        assert!(gap_m.abs() < 1e-12, "constraint {i} at {at:?}: {}", found.value);
        let [x, y, z] = away_w.map(|away| -away);
        assert!((found.gradient - Vector4::new(x, y, z, 0.0)).norm() < 1e-12, "{}", found.gradient);
        assert_eq!(found.weight.to_bits(), TABLE.weight.to_bits());
    }
}

#[test]
fn a_constraint_more_than_one_metre_beyond_its_margin_is_left_out() {
    let walls = walls(Some(&TABLE)).unwrap().unwrap();
    let (low_x, pole) = (0, Room::WALLS);
    for (beyond_m, is_left_out) in [(0.999, false), (1.001, true)] {
        let apart_m = 0.12 + beyond_m;
        let by_wall = excess_at(&walls, low_x, [-2.0 + apart_m, 0.0, 1.0, 0.0]);
        let by_pole = excess_at(&walls, pole, [1.2 + apart_m, 0.2, 1.0, 0.0]);
        assert_eq!([by_wall.is_none(), by_pole.is_none()], [is_left_out; 2], "{beyond_m} m");
    }
    assert!(excess_at(&walls, Room::WALLS + 2, [0.0; 4]).is_none(), "there are two obstacles");
}

#[test]
fn each_prediction_of_the_moving_obstacle_has_the_gradient_of_its_numeric_twin() {
    let moving = ObstacleTable::Moving { radius_m: 0.2 };
    let mut walls = Walls::new(Some(&TABLE), None, &[BLOCK, moving]).unwrap().unwrap();
    for k in 0..100 {
        walls.follow_obstacle(Some([0.02 * f64::from(k), 0.1, 1.0]), None, 0.02);
    }
    walls.begin_after(0.3, Matrix3::zeros());
    let p = Vector4::repeat(1.0);
    let constraints = PlanWalls { model: &Kinematic, p: &p, walls: &walls };
    assert_eq!(SoftConstraints::<4>::count(&constraints), 4);
    let s = Vector4::new(2.4, 0.9, 1.2, 0.4);
    let values = [1, 2, 3].map(|i| {
        let found = constraints.excess(i, &s, 0.4).unwrap();
        let value = |s: &Vector4<f64>| {
            let excess = constraints.excess(i, s, 0.4);
            Vector1::new(excess.map_or(f64::NAN, |excess| excess.value))
        };
        let gap = jacobian_gap(value, &s, &found.gradient.transpose());
        assert!(gap < 1e-8, "gap {gap:e} of prediction {i}");
        found.value
    });
    let [by_velocity, _, by_stop] = values;
    // At 1 m/s for 0.7 s it comes to 2.7 m, and to 2.2 m if it stops; only the former margin grows with acceleration.
    assert!((by_velocity - by_stop).abs() > 0.05, "{values:?}");
}
