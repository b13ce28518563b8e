use super::*;
use crate::{Kinematic, Lagged, Model};

#[test]
fn the_numbers_of_rows_are_those_of_the_models_names() {
    let names = |rows: &[crate::Row]| rows.iter().map(|row| row.name).collect::<Vec<_>>();
    let (state, input) = (names(&Lagged::STATE), names(&Kinematic::INPUT));
    for (row, name) in [
        (motion::X, "x"),
        (motion::Y, "y"),
        (motion::Z, "z"),
        (motion::THETA, "theta"),
        (motion::V_X, "v_x"),
        (motion::V_Y, "v_y"),
        (motion::V_Z, "v_z"),
        (motion::OMEGA, "omega"),
        (motion::D_X, "d_x"),
        (motion::D_Y, "d_y"),
        (motion::D_Z, "d_z"),
    ] {
        assert_eq!(state[row], name);
    }
    for (row, name) in [
        (stick::ROLL, "roll"),
        (stick::PITCH, "pitch"),
        (stick::YAW, "yaw"),
        (stick::THROTTLE, "throttle"),
    ] {
        assert_eq!(input[row], name);
    }
    assert_eq!(state[motion::CONTROLLABLE], "d_x", "the first that is not controllable");
    assert_eq!(names(&Kinematic::STATE), state[..pose::COUNT]);
}

#[test]
fn the_numbers_of_parameters_are_those_of_the_models_names() {
    for (row, name) in [
        (lag::LAMBDA_H, "lambda_h"),
        (lag::LAMBDA_V, "lambda_v"),
        (lag::LAMBDA_A, "lambda_a"),
        (lag::THETA_0, "theta_0"),
        (lag::TAU_H, "tau_h"),
        (lag::TAU_V, "tau_v"),
        (lag::TAU_A, "tau_a"),
        (lag::DEAD_H, "dead_h"),
        (lag::DEAD_V, "dead_v"),
        (lag::DEAD_A, "dead_a"),
        (lag::A_MAX, "a_max"),
    ] {
        assert_eq!(Lagged::PARAMETER[row].name, name);
        if row < gain::COUNT {
            assert_eq!(Kinematic::PARAMETER[row].name, name);
        }
    }
}

#[test]
fn the_position_of_a_pose_is_all_but_its_heading() {
    assert_eq!(pos_w(&Pose::new(1.0, 2.0, 3.0, 4.0)), Vector3::new(1.0, 2.0, 3.0));
}
