use std::f64::consts::FRAC_PI_2;

use horizon_model::check::{amax, maximum};
use horizon_model::rows::pose;
use proptest::prelude::*;

use super::*;

const LEVEL: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

fn table(axes: [SourceAxis; 3], nose: Option<SourceAxis>, unit: Option<Unit>) -> FrameTable {
    FrameTable { axes: Some(axes), nose, unit }
}

fn pose_of(table: &FrameTable, pos_v: [f64; 3], matrix: [f64; 9]) -> Pose {
    let axes = Axes::new(Some(table), Unit::Metre).unwrap();
    axes.pose(&Placement { pos_v, matrix }).unwrap()
}

#[test]
fn a_source_whose_y_points_up_is_turned() {
    // x right, y up, z towards the viewer: 1 right, 2 up, 3 away is -z.
    let y_up = table([SourceAxis::X, SourceAxis::MinusZ, SourceAxis::Y], None, None);
    let pose = pose_of(&y_up, [1.0, 2.0, -3.0], LEVEL);
    assert!(amax(&(pose - Pose::new(1.0, 3.0, 2.0, 0.0))) < 1e-12, "{pose}");
    // A quarter turn about the source's y, counter-clockwise from above.
    let turned = matrix_of_quaternion([0.0, (FRAC_PI_2 / 2.0).sin(), 0.0, (FRAC_PI_2 / 2.0).cos()]);
    let pose = pose_of(&y_up, [0.0; 3], turned.unwrap());
    assert!(amax(&(pose - Pose::new(0.0, 0.0, 0.0, FRAC_PI_2))) < 1e-12, "{pose}");
}

#[test]
fn the_nose_is_where_the_settings_say() {
    let along_y = table([SourceAxis::X, SourceAxis::Y, SourceAxis::Z], Some(SourceAxis::Y), None);
    let pose = pose_of(&along_y, [0.0; 3], LEVEL);
    assert!((pose[pose::THETA] - FRAC_PI_2).abs() < 1e-12, "{pose}");
    // Where y points up, a nose along the object's z, which is our -y.
    let y_up = table([SourceAxis::X, SourceAxis::MinusZ, SourceAxis::Y], Some(SourceAxis::Z), None);
    let pose = pose_of(&y_up, [0.0; 3], LEVEL);
    assert!((pose[pose::THETA] + FRAC_PI_2).abs() < 1e-12, "{pose}");
}

#[test]
fn units_are_metres_behind_the_mapping() {
    for (unit, x_m) in [(Unit::Metre, 1500.0), (Unit::Centimetre, 15.0), (Unit::Millimetre, 1.5)] {
        let table = table([SourceAxis::X, SourceAxis::Y, SourceAxis::Z], None, Some(unit));
        let pose = pose_of(&table, [1500.0, 0.0, 0.0], LEVEL);
        assert!((pose[pose::X] - x_m).abs() < 1e-9, "{unit:?}: {pose}");
    }
    // Without a word the unit is that of the protocol.
    let usual = Axes::new(None, Unit::Millimetre).unwrap();
    let pose = usual.pose(&Placement { pos_v: [1500.0, 0.0, 0.0], matrix: LEVEL }).unwrap();
    assert!((pose[pose::X] - 1.5).abs() < 1e-12, "{pose}");
}

/// Reason to refuse a table.
fn refusal(axes: [SourceAxis; 3], nose: Option<SourceAxis>) -> String {
    Axes::new(Some(&table(axes, nose, None)), Unit::Metre).unwrap_err().to_string()
}

#[test]
fn what_mirrors_or_has_no_volume_is_refused() {
    let mirrored = refusal([SourceAxis::X, SourceAxis::Z, SourceAxis::Y], None);
    assert!(mirrored.starts_with("frame.axes = x, z, y: expected a right-handed"), "{mirrored}");
    assert!(
        refusal([SourceAxis::X, SourceAxis::Y, SourceAxis::MinusZ], None).contains("right-handed")
    );
    assert!(
        refusal([SourceAxis::X, SourceAxis::MinusX, SourceAxis::Z], None)
            .ends_with("three different axes")
    );
    let nose =
        refusal([SourceAxis::X, SourceAxis::MinusZ, SourceAxis::Y], Some(SourceAxis::MinusY));
    assert!(nose.starts_with("frame.nose = -y: expected an axis"), "{nose}");
}

#[test]
fn half_of_the_mappings_with_three_axes_are_rotations() {
    let mut counts = [0; 2];
    for a in SourceAxis::ALL {
        for b in SourceAxis::ALL {
            for c in SourceAxis::ALL {
                let is_accepted =
                    Axes::new(Some(&table([a, b, c], None, None)), Unit::Metre).is_ok();
                counts[usize::from(is_accepted)] += 1;
            }
        }
    }
    assert_eq!(counts, [216 - 24, 24], "a cube has 24 rotations");
}

#[test]
fn what_is_no_rotation_has_no_pose() {
    let axes = Axes::new(None, Unit::Metre).unwrap();
    let mut mirrored = LEVEL;
    mirrored[8] = -1.0;
    for matrix in [[0.0; 9], [f64::NAN; 9], LEVEL.map(|r| 2.0 * r), mirrored] {
        assert_eq!(axes.pose(&Placement { pos_v: [0.0; 3], matrix }), None, "{matrix:?}");
    }
    assert_eq!(axes.pose(&Placement { pos_v: [f64::NAN, 0.0, 0.0], matrix: LEVEL }), None);
    assert_eq!(matrix_of_quaternion([0.0; 4]), None);
    assert_eq!(matrix_of_quaternion([f64::NAN, 0.0, 0.0, 1.0]), None);
    assert_eq!(matrix_of_quaternion([1.0, 1.0, 0.0, 0.0]), None);
}

#[test]
fn the_table_is_what_stands_in_the_settings() {
    let text = r#"{ "axes": ["x", "-z", "y"], "nose": "z", "unit": "mm" }"#;
    let table: FrameTable = serde_json::from_str(text).unwrap();
    let expected = FrameTable {
        axes: Some([SourceAxis::X, SourceAxis::MinusZ, SourceAxis::Y]),
        nose: Some(SourceAxis::Z),
        unit: Some(Unit::Millimetre),
    };
    assert_eq!(table, expected);
    for text in
        [r#"{ "axes": ["x", "y"] }"#, r#"{ "axes": ["x", "y", "up"] }"#, r#"{ "axis": [] }"#]
    {
        assert!(serde_json::from_str::<FrameTable>(text).is_err(), "{text}");
    }
}

proptest! {
    #[test]
    fn quaternion_and_matrix_are_the_same_rotation(
        angles in prop::array::uniform3(-3.0..3.0),
    ) {
        let matrix = crate::mocap::matrix_of_angles(angles);
        let back = matrix_of_quaternion(quaternion_of_matrix(&matrix)).unwrap();
        let gap = matrix.iter().zip(back).map(|(a, b)| (a - b).abs()).fold(0.0, maximum);
        prop_assert!(gap < 1e-12, "{gap}");
    }

    #[test]
    fn the_mapping_of_axes_keeps_distances_and_gives_rotations(
        a in prop::array::uniform3(-9.0..9.0), b in prop::array::uniform3(-9.0..9.0),
        angles in prop::array::uniform3(-3.0..3.0),
    ) {
        let y_up = table([SourceAxis::MinusZ, SourceAxis::MinusX, SourceAxis::Y], Some(SourceAxis::X), None);
        let axes = Axes::new(Some(&y_up), Unit::Metre).unwrap();
        let matrix = crate::mocap::matrix_of_angles(angles);
        let [(a_w, rotation), (b_w, _)] = [a, b].map(|pos_v| axes.place(&Placement { pos_v, matrix }));
        let apart = |a: [f64; 3], b: [f64; 3]| (Vector3::from(a) - Vector3::from(b)).norm();
        prop_assert!((apart(a_w, b_w) - apart(a, b)).abs() < 1e-12);
        prop_assert!(is_rotation(&rotation));
    }
}
