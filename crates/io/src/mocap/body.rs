//! A rigid body as the mocap system reports it, and the heading of its rotation.
//!
//! Owns the one convention of Vicon's rotations: a matrix leads from body to world coordinates, three
//! angles mean `R = Rx(a) Ry(b) Rz(c)`. The heading is the direction of the body's x axis seen from
//! above, `atan2(R10, R00)`; the third angle is that only while the body is level.

#![deny(clippy::indexing_slicing)]

use horizon_model::rows::Pose;

/// Least height of the tip of the body's z axis: a vehicle whose top is further than 60 degrees from up has tipped
/// over, or its object has other axes. 1
const TOP_MIN: f64 = 0.5;

/// A body that the mocap system sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body<'a> {
    /// Name of the object, without padding.
    pub name: &'a [u8],
    /// x, y, z in the axes of the source, which for Vicon are those of the world. m
    pub pos_v: [f64; 3],
    /// Angles about x, y and z of `R = Rx Ry Rz`. rad
    pub angles: [f64; 3],
}

/// Place of the angle about the vertical in [`Body::angles`].
pub const ABOUT_Z: usize = 2;

/// Rotation matrix, row by row, of three angles in rad: `R = Rx Ry Rz`.
pub fn matrix_of_angles([a, b, c]: [f64; 3]) -> [f64; 9] {
    let ((sa, ca), (sb, cb), (sc, cc)) = (a.sin_cos(), b.sin_cos(), c.sin_cos());
    [
        cb * cc,
        -cb * sc,
        sb,
        ca * sc + sa * sb * cc,
        ca * cc - sa * sb * sc,
        -sa * cb,
        sa * sc - ca * sb * cc,
        sa * cc + ca * sb * sc,
        ca * cb,
    ]
}

/// Heading of a rotation matrix, in [-pi, pi]; `None` if the top of the body is further than 60 degrees from up. rad
pub(super) fn heading_of_matrix(matrix: &[f64; 9]) -> Option<f64> {
    let [r00, _, _, r10, .., r22] = *matrix;
    (r22 >= TOP_MIN).then(|| r10.atan2(r00))
}

/// The pose at `pos_v` with heading `theta`; `None` if a coordinate is not finite.
pub(super) fn pose([x, y, z]: [f64; 3], theta: f64) -> Option<Pose> {
    let is_finite = [x, y, z].iter().all(|value| value.is_finite());
    is_finite.then(|| Pose::new(x, y, z, theta))
}

/// Whether all numbers are zero: how Vicon's programs write an object that they lost.
pub(super) fn is_all_zero(numbers: impl IntoIterator<Item = f64>) -> bool {
    numbers.into_iter().all(|number| number.abs() <= 0.0)
}

#[cfg(test)]
mod tests {
    use horizon_model::check::{amax, maximum};

    use super::*;
    use crate::mocap::axes::matrix_of_quaternion;

    fn heading_of_angles(angles: [f64; 3]) -> Option<f64> {
        heading_of_matrix(&matrix_of_angles(angles))
    }

    #[test]
    fn the_matrix_turns_about_x_y_and_z_in_this_order() {
        let [a, b, c] = [0.1, 0.2, 0.3];
        let matrix = |axis: [f64; 3], angle: f64| {
            *nalgebra::Rotation3::new(nalgebra::Vector3::from(axis) * angle).matrix()
        };
        let product =
            matrix([1.0, 0.0, 0.0], a) * matrix([0.0, 1.0, 0.0], b) * matrix([0.0, 0.0, 1.0], c);
        let gap = nalgebra::Matrix3::from_row_slice(&matrix_of_angles([a, b, c])) - product;
        assert!(amax(&gap) < 1e-15, "{gap}");
    }

    #[test]
    fn all_forms_of_a_rotation_have_the_same_heading() {
        // Quaternion of the angles (0.1, 0.2, 0.3), by an independent program.
        let quaternion = [0.0641, 0.0912, 0.1534, 0.9819];
        let by_angles = heading_of_angles([0.1, 0.2, 0.3]).unwrap();
        let by_quaternion = heading_of_matrix(&matrix_of_quaternion(quaternion).unwrap()).unwrap();
        assert!((by_angles - by_quaternion).abs() < 2e-4, "{by_angles} {by_quaternion}");
    }

    #[test]
    fn the_third_angle_of_a_tilted_body_is_not_its_heading() {
        // Largest gap for roll and pitch of 5, 10, 15 and 20 deg each, over all headings. deg
        for (tilt_deg, gap_deg) in [(5.0_f64, 0.44), (10.0, 1.75), (15.0, 4.0), (20.0, 7.1)] {
            let tilt = tilt_deg.to_radians();
            let gaps = (0..360).map(|deg| {
                let third = f64::from(deg).to_radians();
                let gap = heading_of_angles([tilt, tilt, third]).unwrap() - third;
                horizon_model::angle::wrap(gap).abs().to_degrees()
            });
            let largest = gaps.fold(0.0, maximum);
            assert!((largest - gap_deg).abs() < 0.06, "{largest} at {tilt_deg} deg");
        }
    }

    #[test]
    fn a_level_body_points_where_its_third_angle_says() {
        for third in [-3.1, -0.5, 0.0, 0.3, 3.1, 3.5, 100.0] {
            let gap = heading_of_angles([0.0, 0.0, third]).unwrap() - third;
            assert!(horizon_model::angle::wrap(gap).abs() < 1e-12, "{third}: {gap}");
        }
    }

    #[test]
    fn a_nose_straight_up_and_no_rotation_have_no_heading() {
        assert_eq!(heading_of_angles([0.0, std::f64::consts::FRAC_PI_2, 0.0]), None);
        assert_eq!(heading_of_matrix(&[0.0; 9]), None);
        assert_eq!(heading_of_matrix(&[f64::NAN; 9]), None);
    }
}
