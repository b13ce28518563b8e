use super::*;
use crate::RoomTable;

pub(super) const ROOM: RoomTable =
    RoomTable { x_m: [-2.0, 3.0], y_m: [-1.0, 1.0], z_m: [0.0, 2.5], stop_s: 0.8 };
pub(super) const TABLE: WallTable = WallTable {
    weight: 100.0,
    margin_m: 0.1,
    vehicle_radius_m: 0.0,
    growth_mps: 0.05,
    obstacle_accel_mps2: 0.5,
    margin_sd: 0.0,
    coasting: 1.0,
};
pub(super) const POLE: ObstacleTable =
    ObstacleTable::Cylinder { centre_m: [1.0, 0.2], radius_m: 0.2, z_m: [0.0, 2.0] };
pub(super) const BLOCK: ObstacleTable =
    ObstacleTable::Box { x_m: [-1.5, -1.0], y_m: [-0.5, 0.5], z_m: [0.0, 1.0] };

pub(super) fn walls(table: Option<&WallTable>) -> Result<Option<Walls>, SettingError> {
    Walls::new(table, Some(Room::try_from(&ROOM).unwrap()), &[POLE, BLOCK])
}

#[test]
fn the_margin_grows_over_the_plan_and_the_clearance_is_the_least() {
    let walls = walls(Some(&TABLE)).unwrap().unwrap();
    // 0.13 m from the wall at y = 1: beyond the margin of 0.1 m at first, short of 0.15 m after a second.
    let at = |y: f64| Pose::new(0.0, y, 1.2, 0.0);
    let plan = [(at(0.0), 0.0), (at(0.87), 0.2), (at(0.87), 1.0)];
    let (found, is_clear) = walls.clearance(plan.into_iter());
    let found = found.unwrap();
    assert!(is_clear && !walls.clearance([(at(1.01), 0.0)].into_iter()).1);
    assert!((found.distance_m - 0.13).abs() < 1e-12, "{found:?}");
    assert_eq!((found.ahead_s, found.active), (0.2, 1));
    let wide = RoomTable { x_m: [-5.0, 5.0], y_m: [-5.0, 5.0], z_m: [-2.0, 4.0], stop_s: 0.8 };
    let far = Walls::new(Some(&TABLE), Some(Room::try_from(&wide).unwrap()), &[]);
    assert_eq!(far.unwrap().unwrap().clearance([(at(0.0), 0.0)].into_iter()), (None, true));
}

#[test]
fn the_margin_of_what_moves_grows_with_its_acceleration_from_now_on() {
    let moving = ObstacleTable::Moving { radius_m: 0.2 };
    let mut walls = Walls::new(Some(&TABLE), None, &[BLOCK, moving]).unwrap().unwrap();
    walls.begin_after(0.4, Matrix3::zeros());
    let margins_m = [0, 1].map(|i| walls.margin_m(&walls.constraints[i], &Vector3::x(), 1.0));
    let expected_m = [0.15, 0.15 + 0.25 * 1.4_f64.powi(2)];
    let gap_m = margins_m.into_iter().zip(expected_m).map(|(found, right)| found - right);
    assert!(gap_m.into_iter().all(|gap_m| gap_m.abs() < 1e-12), "{margins_m:?}");
    // 0.6 m from its surface: nearer than its margin of 0.64 m after 1 s, though not after 0.5 s.
    walls.follow_obstacle(Some([0.0, 0.0, 1.0]), None, 0.02);
    let at = Pose::new(0.8, 0.0, 1.5, 0.0);
    let active = |ahead_s| walls.clearance([(at, ahead_s)].into_iter()).0.unwrap().active;
    assert_eq!([active(0.5), active(1.0)], [0, 1]);
}

#[test]
fn a_plan_keeps_the_radius_of_the_vehicle_from_fixed_obstacles_alone() {
    let table = WallTable { vehicle_radius_m: 0.13, ..TABLE };
    let room = Some(Room::try_from(&ROOM).unwrap());
    let moving = ObstacleTable::Moving { radius_m: 0.2 };
    let walls = Walls::new(Some(&table), room, &[BLOCK, moving]).unwrap().unwrap();
    for constraint in &walls.constraints {
        let stands = matches!(constraint, ObstacleConstraint::Fixed(_));
        let margin_m = walls.margin_m(constraint, &Vector3::x(), 0.0);
        let expected_m = if stands { 0.23 } else { 0.1 };
        assert!((margin_m - expected_m).abs() < 1e-12, "{constraint:?}: {margin_m}");
    }
}

#[test]
fn the_margin_grows_with_the_standard_deviation_towards_the_wall() {
    let table = WallTable { margin_sd: 2.0, ..TABLE };
    let mut walls = Walls::new(Some(&table), None, &[BLOCK]).unwrap().unwrap();
    walls.begin_after(0.04, Matrix3::new(9e-4, 0.0, 0.0, 0.0, 16e-4, 0.0, 0.0, 0.0, 1e-4));
    for (gradient_w, expected_m) in [(Vector3::x(), 0.16), (-Vector3::y(), 0.18)] {
        let margin_m = walls.margin_m(&walls.constraints[0], &gradient_w, 0.0);
        assert!((margin_m - expected_m).abs() < 1e-12, "{margin_m} along {gradient_w}");
    }
}

#[test]
fn each_bad_value_is_refused_with_key_value_and_rule() {
    for (table, refusal) in [
        (WallTable { weight: 0.0, ..TABLE }, "mpc.walls.weight = 0: expected 1.0..=10000.0"),
        (WallTable { margin_m: 1.5, ..TABLE }, "mpc.walls.margin_m = 1.5: expected 0.0..=1.0"),
        (
            WallTable { growth_mps: f64::NAN, ..TABLE },
            "mpc.walls.growth_mps = NaN: expected 0.0..=0.5",
        ),
        (
            WallTable { vehicle_radius_m: 0.6, ..TABLE },
            "mpc.walls.vehicle_radius_m = 0.6: expected 0.0..=0.5",
        ),
        (WallTable { margin_sd: -1.0, ..TABLE }, "mpc.walls.margin_sd = -1: expected 0.0..=5.0"),
        (WallTable { coasting: 1.1, ..TABLE }, "mpc.walls.coasting = 1.1: expected 0.0..=1.0"),
    ] {
        assert_eq!(walls(Some(&table)).unwrap_err().to_string(), refusal);
    }
    let refused = walls(None).unwrap_err().to_string();
    assert!(refused.starts_with("mpc.walls = null: expected a table: the plan"), "{refused}");
    assert!(Walls::new(None, None, &[]).unwrap().is_none());
}

#[test]
fn what_moves_is_where_it_is_when_the_plan_comes_there() {
    let moving = ObstacleTable::Moving { radius_m: 0.2 };
    let mut walls = Walls::new(Some(&TABLE), None, &[moving]).unwrap().unwrap();
    for k in 0..100 {
        walls.follow_obstacle(Some([0.02 * f64::from(k), 0.0, 1.0]), None, 0.02);
    }
    let mut distance_m = |lead_s, ahead_s| {
        walls.begin_after(lead_s, Matrix3::zeros());
        walls.distance(&walls.constraints[0], &Vector3::new(10.0, 0.0, 1.0), ahead_s).distance_m
    };
    let (later_m, sooner_m) = (distance_m(0.4, 0.1), distance_m(0.4, 0.0));
    assert!((later_m - distance_m(0.5, 0.0)).abs() < 1e-12, "{later_m}");
    // About 1 m/s towards the position.
    assert!((0.05..0.12).contains(&(sooner_m - later_m)), "{sooner_m} {later_m}");
}
