use tello_flight::FollowTable;

use super::*;

const ROOM: RoomTable =
    RoomTable { x_m: [-3.0, 3.0], y_m: [-2.0, 4.0], z_m: [0.0, 3.0], stop_s: 1.0 };

/// From one place to another within `length_s`.
fn way(length_s: f64, from: [f64; 3], to: [f64; 3]) -> TrajectoryTable {
    let row = |t_s: f64, [x, y, z]: [f64; 3]| [t_s, x, y, z, 0.0];
    TrajectoryTable {
        points: PointsTable::Rows(vec![row(0.0, from), row(length_s, to)]),
        accel_max_mps2: 1.0,
        follow: FollowTable::default(),
    }
}

/// A way that ends at rest.
fn stay(at: [f64; 3]) -> TrajectoryTable {
    way(1.0, at, at)
}

#[test]
fn the_vehicle_stays_the_allowance_off_every_wall() {
    for (inside, outside) in [
        ([2.69, 0.0, 1.4], [2.71, 0.0, 1.4]),
        ([-2.69, 0.0, 1.4], [-2.71, 0.0, 1.4]),
        ([0.0, 3.69, 1.4], [0.0, 3.71, 1.4]),
        ([0.0, -1.69, 1.4], [0.0, -1.71, 1.4]),
        ([0.0, 0.0, 2.69], [0.0, 0.0, 2.71]),
    ] {
        assert!(fits(&stay(inside), Some(&ROOM)), "{inside:?}");
        assert!(!fits(&stay(outside), Some(&ROOM)), "{outside:?}");
        assert!(fits(&stay(outside), None), "{outside:?} without a room");
    }
}

#[test]
fn a_pattern_stays_off_the_ground_in_any_room_and_in_none() {
    for room in [None, Some(&ROOM)] {
        assert!(fits(&stay([0.0, 0.0, 0.61]), room));
        assert!(!fits(&stay([0.0, 0.0, 0.59]), room));
    }
}

#[test]
fn what_moves_towards_a_wall_needs_room_to_stop() {
    let [near, nearer] = [[1.0, 0.0, 1.4], [1.8, 0.0, 1.4]];
    // 0.8 m/s stop within 0.8 m, at 2.6 m; 1.6 m/s would not; and the return leads off the wall.
    assert!(fits(&way(1.0, near, nearer), Some(&ROOM)));
    assert!(!fits(&way(0.5, near, nearer), Some(&ROOM)));
    assert!(fits(&way(0.5, nearer, near), Some(&ROOM)));
    let quick = RoomTable { stop_s: 0.5, ..ROOM };
    assert!(fits(&way(0.5, near, nearer), Some(&quick)));
}

#[test]
fn points_of_another_file_are_not_judged_to_fit() {
    let mut trajectory = stay([0.0, 0.0, 1.4]);
    trajectory.points = PointsTable::Csv("points.csv".to_owned());
    assert!(!fits(&trajectory, None));
}

#[test]
fn the_centre_is_the_one_given_else_the_middle_of_the_room_at_its_height() {
    let given = [0.5, -0.5, 1.2, 0.3];
    for room in [None, Some(&ROOM)] {
        assert_eq!(centre(&given, room).unwrap(), Pose::from(given));
    }
    assert_eq!(centre(&[], Some(&ROOM)).unwrap(), Pose::new(0.0, 1.0, HEIGHT_M, 0.0));
    assert!(centre(&[], None).unwrap_err().to_string().contains("give --centre"));
    for count in [1, 3, 5] {
        let error = centre(&vec![0.0; count], Some(&ROOM)).unwrap_err().to_string();
        assert!(error.ends_with(&format!("instead of {count}")), "{error}");
    }
}

#[test]
fn a_low_ceiling_lowers_the_pattern() {
    let room = RoomTable { x_m: [-2.0, 2.0], y_m: [-3.0, 1.0], z_m: [0.0, 2.3], ..ROOM };
    let design = Excitation {
        centre: centre(&[], Some(&room)).unwrap(),
        half_width_m: 0.0,
        half_height_m: 0.36,
        duration_s: 60.0,
    };
    assert!(largest(&design, &[HEIGHT_M], Some(&room)).is_err());
    let (_, trajectory) = largest(&design, &[HEIGHT_M, 1.2, 1.0], Some(&room)).unwrap();
    assert!(fits(&trajectory, Some(&room)));
}

/// The half width that is found in a room of `room_m` along both axes.
fn half_width_m(room_m: f64) -> Option<f64> {
    let wall_m = room_m / 2.0;
    let room = RoomTable { x_m: [-wall_m, wall_m], y_m: [-wall_m, wall_m], ..ROOM };
    let design = Excitation {
        centre: centre(&[], Some(&room)).unwrap(),
        half_width_m: 0.0,
        half_height_m: 0.36,
        duration_s: 60.0,
    };
    let (half_width_m, trajectory) = largest(&design, &[HEIGHT_M], Some(&room)).ok()?;
    let larger = Excitation { half_width_m: half_width_m + 0.1, ..design }.trajectory().unwrap();
    assert!(fits(&trajectory, Some(&room)));
    assert!(half_width_m > 1.49 || !fits(&larger, Some(&room)), "{half_width_m} m");
    Some(half_width_m)
}

#[test]
fn the_pattern_is_the_largest_that_fits_within_its_limits() {
    assert_eq!(half_width_m(20.0), Some(1.5));
    let [small_m, large_m] = [3.6, 4.2].map(|room_m| half_width_m(room_m).unwrap());
    assert!(0.5 <= small_m && small_m < large_m && large_m < 1.5, "{small_m} {large_m}");
    assert_eq!(half_width_m(2.0), None);
}
