use horizon_model::check::{maximum, minimum};

use super::*;
use crate::cycle::FlightTable;
use crate::cycle::sense::tests::table;

/// Keys and rules of what `change` makes infeasible.
fn found(change: impl FnOnce(&mut CycleTable)) -> Vec<(String, String)> {
    let FlightTable { mission: table, mut cycle, .. } = table();
    change(&mut cycle);
    let mission = Mission::new(&table, cycle.dt_s).unwrap();
    let misfits = misfits(&table, &mission, &cycle).unwrap();
    misfits.into_iter().map(|misfit| (misfit.key, misfit.rule)).collect()
}

fn flown() -> Mission {
    let table = table();
    Mission::new(&table.mission, table.cycle.dt_s).unwrap()
}

#[test]
fn a_mission_as_fast_as_a_limit_fits_and_one_that_is_faster_does_not() {
    let demands = flown().demands().unwrap();
    let (speed_mps, horizontal_mps) = (demands.speed.value, demands.horizontal.value);
    assert_eq!(found(|cycle| cycle.supervisor.failsafe.speed_mps = speed_mps), []);
    let faster = found(|cycle| cycle.supervisor.failsafe.speed_mps = speed_mps.next_down());
    assert!(faster.len() == 1 && faster[0].1.contains("failsafe.speed_mps"), "{faster:?}");
    assert_eq!(found(|cycle| cycle.mhe.p_ub[lag::LAMBDA_H] = horizontal_mps), []);
    let weaker = found(|cycle| cycle.mhe.p_ub[lag::LAMBDA_H] = horizontal_mps.next_down());
    assert!(weaker.len() == 1 && weaker[0].1.contains("p_ub[0]"), "{weaker:?}");
}

#[test]
fn full_sticks_are_those_that_controller_and_gate_both_allow() {
    let horizontal_mps = flown().demands().unwrap().horizontal.value;
    let weak = |change: &dyn Fn(&mut CycleTable)| {
        let found = found(|cycle| {
            cycle.mhe.p_ub[lag::LAMBDA_H] = 1.5 * horizontal_mps;
            change(cycle);
        });
        found.len()
    };
    assert_eq!(weak(&|_| {}), 0);
    assert_eq!(weak(&|cycle| cycle.mpc.u_ub[stick::PITCH] = 0.5), 1);
    assert_eq!(weak(&|cycle| cycle.gate.stick_max = 0.5), 1);
    // The throttle moves no vehicle along a level path.
    assert_eq!(weak(&|cycle| cycle.mpc.u_ub[stick::THROTTLE] = 0.0), 0);
}

#[test]
fn each_waypoint_outside_of_the_room_is_named_and_else_the_farthest_place_of_the_path() {
    let stops: Vec<f64> = flown().stops().iter().map(|at| at[pose::X]).collect();
    let most_m = stops.iter().copied().fold(f64::NEG_INFINITY, maximum);
    let outside = |x_max_m: f64| {
        found(|cycle| {
            if let Some(room) = &mut cycle.supervisor.room {
                room.x_m[1] = x_max_m;
            }
        })
    };
    assert_eq!(outside(most_m), [], "a waypoint on the wall");
    let keys: Vec<String> = outside(most_m - 0.1).into_iter().map(|(key, _)| key).collect();
    let named = stops.iter().enumerate().filter(|(_, x_m)| **x_m > most_m - 0.1);
    let named: Vec<String> =
        named.map(|(k, _)| format!("mission.waypoints.waypoints[{k}]")).collect();
    assert_eq!(keys, named);
}

/// A box around `x_m`, `y_m` from the floor up to `top_m`.
fn table_top(x_m: f64, y_m: f64, top_m: f64) -> crate::ObstacleTable {
    let around = |at_m: f64| [at_m - 0.3, at_m + 0.3];
    let text = serde_json::json!({
        "kind": "box", "x_m": around(x_m), "y_m": around(y_m), "z_m": [0.0, top_m]
    });
    serde_json::from_value(text).unwrap()
}

#[test]
fn a_heading_in_degrees_is_refused() {
    let FlightTable { mission: mut mission_table, cycle, .. } = table();
    let mission = flown();
    let MissionTable::Waypoints(square) = &mut mission_table else { panic!("waypoints") };
    let mut refused = |theta: f64| {
        let [.., last] = &mut square.waypoints[..] else { panic!("no waypoint") };
        let [.., of_last] = last;
        *of_last = theta;
        let table = MissionTable::Waypoints(square.clone());
        misfits(&table, &mission, &cycle).unwrap()
    };
    assert_eq!(refused(-ANGLE_MAX_RAD), []);
    let [error] = &refused(90.0)[..] else { panic!("not one") };
    assert!(error.rule.contains("in radians"), "{error}");
}

#[test]
fn angles_of_a_circle_and_of_a_trajectory_in_degrees_are_refused() {
    let (FlightTable { cycle, .. }, mission) = (table(), flown());
    let refused = |table: serde_json::Value| -> Vec<String> {
        let table = serde_json::from_value(table).unwrap();
        let errors = misfits(&table, &mission, &cycle).unwrap();
        errors.into_iter().map(|error| error.key).collect()
    };
    let circle = |theta: f64, begin_rad: f64| {
        refused(serde_json::json!({ "circle": {
            "centre": [0.0, 0.0, 1.0, theta], "begin_rad": begin_rad, "radius_m": 0.5
        } }))
    };
    assert_eq!(circle(-3.1, 6.2), [""; 0]);
    assert_eq!(circle(90.0, 180.0), ["mission.circle.centre[3]", "mission.circle.begin_rad"]);
    let trajectory = |thetas: &[f64]| {
        let row = |(k, theta): (usize, &f64)| [k as f64, 0.0, 0.0, 1.0, *theta];
        let rows: Vec<_> = thetas.iter().enumerate().map(row).collect();
        refused(serde_json::json!({ "trajectory": { "points": { "rows": rows } } }))
    };
    // Headings of three turns on a circle add up.
    assert_eq!(trajectory(&[0.0, 6.0, 12.0, 18.0]), [""; 0]);
    assert_eq!(trajectory(&[90.0, 90.0]), ["mission.trajectory.points.rows[0][4]"]);
    assert_eq!(trajectory(&[0.0, 0.0, 90.0]), ["mission.trajectory.points.rows[2][4]"]);
}

#[test]
fn an_obstacle_in_millimetres_is_noted_and_one_that_reaches_into_the_room_is_not() {
    let noted = |obstacle: serde_json::Value| {
        let mut cycle = table().cycle;
        cycle.obstacles = vec![serde_json::from_value(obstacle).unwrap()];
        notes(&flown(), &cycle)
    };
    let pole = |centre: [f64; 2], radius: f64| {
        serde_json::json!({
            "kind": "cylinder", "centre_m": centre, "radius_m": radius, "z_m": [0.0, 2.0]
        })
    };
    let room = table().cycle.supervisor.room.unwrap();
    let wall_m = room.x_m[1];
    assert_eq!(noted(pole([wall_m + 0.1, 0.0], 0.2)), [""; 0]);
    assert_eq!(noted(serde_json::json!({ "kind": "moving", "radius_m": 0.3 })), [""; 0]);
    for outside in [pole([wall_m + 0.3, 0.0], 0.2), pole([0.0, -800.0], 300.0)] {
        let [note] = &noted(outside)[..] else { panic!("not one note") };
        assert!(note.starts_with("cycle.obstacles[0] is outside"), "{note}");
    }
}

#[test]
fn a_mission_that_ends_above_an_obstacle_does_not_fit_and_one_that_passes_above_does() {
    let [.., passed, end] = flown().stops()[..] else { panic!("no two stops") };
    let with = |at: Pose, top_m: f64| {
        found(|cycle| cycle.obstacles = vec![table_top(at[pose::X], at[pose::Y], top_m)])
    };
    assert_eq!(with(passed, end[pose::Z] - 0.3), []);
    let above = with(end, end[pose::Z] - 0.3);
    assert!(above.len() == 1 && above[0].1.starts_with("not above"), "{above:?}");
    let inside = with(end, end[pose::Z] + 0.3);
    assert!(inside.len() == 1 && inside[0].1.starts_with("outside of"), "{inside:?}");
    // Below the floor that the poses know nothing is in the way.
    assert_eq!(with(end, 0.005), []);
}

#[test]
fn a_take_off_is_as_near_as_the_nearest_wall_beside_it_or_obstacle_in_its_climb() {
    let mut cycle = table().cycle;
    cycle.supervisor.room.as_mut().unwrap().x_m = [-5.0, 5.0];
    let at = Pose::new(4.8, 0.0, 0.0, 0.0);
    let (wall_m, name) = take_off_clearance(&at, &cycle).unwrap().unwrap();
    assert!((wall_m - 0.2).abs() < 1e-12 && name.contains("upper x"), "{wall_m}, {name}");
    cycle.obstacles = vec![table_top(4.0, 0.0, 0.5)];
    let at = Pose::new(4.4, 0.0, 0.0, 0.0);
    let (box_m, name) = take_off_clearance(&at, &cycle).unwrap().unwrap();
    assert!((box_m - 0.1).abs() < 1e-12 && name.contains("obstacles[0]"), "{box_m}, {name}");
    cycle.obstacles.clear();
    cycle.supervisor.room = None;
    assert_eq!(take_off_clearance(&at, &cycle), Ok(None));
}

#[test]
fn each_waypoint_that_is_too_low_is_named() {
    let lowest_m = flown().stops().iter().map(|at| at[pose::Z]).fold(f64::INFINITY, minimum);
    let above_floor = |height_m: f64| found(|cycle| cycle.filter.floor_m = lowest_m - height_m);
    assert_eq!(above_floor(0.301), []);
    let low = above_floor(0.29);
    assert!(!low.is_empty() && low[0].1.starts_with("at least "), "{low:?}");
    assert!(low.iter().all(|(key, _)| key.starts_with("mission.waypoints.waypoints[")));
}

#[test]
fn a_mission_that_asks_for_more_than_the_expected_vehicle_is_noted() {
    let count = |change: &dyn Fn(&mut CycleTable)| {
        let mut cycle = table().cycle;
        change(&mut cycle);
        notes(&flown(), &cycle).len()
    };
    let accel_mps2 = flown().demands().unwrap().accel.value;
    let as_asked = |cycle: &mut CycleTable| cycle.mhe.p_prior[lag::A_MAX] = accel_mps2;
    let less = |cycle: &mut CycleTable| cycle.mhe.p_prior[lag::A_MAX] = 0.9 * accel_mps2;
    let kinematic = |cycle: &mut CycleTable| {
        less(cycle);
        cycle.model = ModelKind::Kinematic;
    };
    assert_eq!([count(&as_asked), count(&less), count(&kinematic)], [0, 1, 0]);
    assert_eq!(count(&|cycle| cycle.mhe.p_prior[lag::LAMBDA_H] = 0.1), 1);
    let mut weak = table().cycle;
    weak.mhe.p_prior[lag::A_MAX] = 0.1;
    let [note] = &notes(&flown(), &weak)[..] else { panic!("not one note") };
    assert!(note.contains("0.10 m/s^2 and leaves the path"), "{note}");
}
