//! Shapes of a scene in the kinds that Foxglove publishes, by the crate `foxglove`.
//!
//! SI units, angles as quaternions, colours and opacity in 0..=1.

use foxglove::messages::{
    Color, CubePrimitive, Duration, FrameTransform, LinePrimitive, Point3, Pose, Quaternion,
    SceneEntity, SpherePrimitive, Timestamp, Vector3,
};
use horizon_model::rows::{Pose as Row, pose};

use crate::display_rounding::{PosW, pos_w_of};
use crate::ros2::place;

/// The colours of the figures.
pub(super) const BLUE: Color = Color { r: 0.0, g: 0.45, b: 0.70, a: 1.0 };
pub(super) const ORANGE: Color = Color { r: 0.90, g: 0.62, b: 0.0, a: 1.0 };
pub(super) const GREEN: Color = Color { r: 0.0, g: 0.62, b: 0.45, a: 1.0 };
pub(super) const GREY: Color = Color { r: 0.5, g: 0.5, b: 0.5, a: 1.0 };
pub(super) const VERMILION: Color = Color { r: 0.84, g: 0.37, b: 0.0, a: 0.7 };

/// How long something that is drawn again and again may stay. s
const LIFETIME_S: i32 = 1;

/// A moment. ns since 1970
pub(super) fn moment(ns: u64) -> Option<Timestamp> {
    let sec = u32::try_from(ns / 1_000_000_000).ok()?;
    Timestamp::new_checked(sec, u32::try_from(ns % 1_000_000_000).ok()?)
}

pub(super) fn point([x, y, z]: PosW) -> Point3 {
    Point3 { x, y, z }
}

fn vector([x, y, z]: [f64; 3]) -> Vector3 {
    Vector3 { x, y, z }
}

/// A pose of the vehicle: turned by theta about z.
pub(super) fn pose_of(at: &Row) -> Pose {
    let ([x, y, z], turn) = place([at[pose::X], at[pose::Y], at[pose::Z], at[pose::THETA]]);
    Pose { position: Some(vector([x, y, z])), orientation: Some(quaternion(turn)) }
}

/// A place without a heading, as those of a plan are.
pub(super) fn at_place(at: PosW) -> Pose {
    Pose { position: Some(vector(at)), orientation: Some(quaternion([0.0, 0.0, 0.0, 1.0])) }
}

fn quaternion([x, y, z, w]: [f64; 4]) -> Quaternion {
    Quaternion { x, y, z, w }
}

/// Where the frame `child` is in the frame `parent`.
pub(super) fn transform(ns: u64, parent: &str, child: &str, at: Pose) -> FrameTransform {
    FrameTransform {
        timestamp: moment(ns),
        parent_frame_id: parent.to_owned(),
        child_frame_id: child.to_owned(),
        translation: at.position,
        rotation: at.orientation,
    }
}

/// Nothing called `id` yet; it is removed after a second without another one.
pub(super) fn entity(ns: u64, frame_id: &str, id: &str) -> SceneEntity {
    SceneEntity {
        timestamp: moment(ns),
        frame_id: frame_id.to_owned(),
        id: id.to_owned(),
        lifetime: Duration::new_checked(LIFETIME_S, 0),
        frame_locked: true,
        ..SceneEntity::default()
    }
}

/// Shapes of a scene, added to an entity.
pub(super) trait Shapes: Sized {
    /// This entity, shown for ever.
    fn staying(self) -> Self;
    /// This entity with a line of 2 px.
    fn line(self, points: Vec<Point3>, color: Color) -> Self;
    /// This entity with a box of size x, y, z around its origin. m
    fn cube(self, size_m: [f64; 3], color: Color) -> Self;
    /// This entity with a ball of this diameter. m
    fn sphere(self, at: &Row, diameter_m: f64, color: Color) -> Self;
}

impl Shapes for SceneEntity {
    fn staying(mut self) -> Self {
        self.lifetime = None;
        self
    }

    fn line(mut self, points: Vec<Point3>, color: Color) -> Self {
        self.lines.push(LinePrimitive {
            pose: Some(at_place([0.0; 3])),
            thickness: 2.0,
            scale_invariant: true,
            points,
            color: Some(color),
            // The default kind is a line through all points.
            ..LinePrimitive::default()
        });
        self
    }

    fn cube(mut self, size_m: [f64; 3], color: Color) -> Self {
        self.cubes.push(CubePrimitive {
            pose: Some(at_place([0.0; 3])),
            size: Some(vector(size_m)),
            color: Some(color),
        });
        self
    }

    fn sphere(mut self, at: &Row, diameter_m: f64, color: Color) -> Self {
        self.spheres.push(SpherePrimitive {
            pose: Some(at_place(pos_w_of(at))),
            size: Some(vector([diameter_m; 3])),
            color: Some(color),
        });
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moment_is_split_at_the_second_and_ends_with_the_seconds_of_its_kind() {
        assert_eq!(moment(3_000_000_004), Timestamp::new_checked(3, 4));
        assert_eq!(moment(999_999_999), Timestamp::new_checked(0, 999_999_999));
        let last = (u64::from(u32::MAX) + 1) * 1_000_000_000;
        assert!(moment(last - 1).is_some() && moment(last).is_none());
    }

    #[test]
    fn a_quarter_turn_is_half_of_it_in_the_quaternion() {
        let at = pose_of(&Row::new(1.0, -2.0, 0.5, std::f64::consts::FRAC_PI_2));
        assert_eq!(at.position, Some(Vector3 { x: 1.0, y: -2.0, z: 0.5 }));
        let Quaternion { x, y, z, w } = at.orientation.unwrap();
        let half = std::f64::consts::FRAC_1_SQRT_2;
        assert!(x.abs() + y.abs() + (z - half).abs() + (w - half).abs() < 1e-12, "{z}, {w}");
    }

    #[test]
    fn an_entity_collects_its_shapes_and_may_stay() {
        let drawn = entity(5, "world", "a")
            .line(vec![point([0.0; 3]), point([1.0, 0.0, 0.0])], BLUE)
            .cube([0.1, 0.2, 0.3], GREY)
            .sphere(&Row::new(1.0, 2.0, 3.000_4, 0.5), 0.2, GREEN);
        assert_eq!((drawn.lines.len(), drawn.cubes.len(), drawn.spheres.len()), (1, 1, 1));
        assert_eq!(drawn.lifetime, Duration::new_checked(1, 0));
        assert_eq!(drawn.cubes[0].size, Some(Vector3 { x: 0.1, y: 0.2, z: 0.3 }));
        let ball = drawn.spheres[0].pose.as_ref().unwrap();
        // Rounded to a millimetre, without a turn.
        assert_eq!(ball.position, Some(Vector3 { x: 1.0, y: 2.0, z: 3.0 }));
        assert_eq!(ball.orientation, Some(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }));
        assert_eq!(drawn.staying().lifetime, None);
    }

    #[test]
    fn a_transform_leads_from_the_parent_to_the_child() {
        let made = transform(7, "world", "tello", at_place([1.0, 2.0, 3.0]));
        assert_eq!((&*made.parent_frame_id, &*made.child_frame_id), ("world", "tello"));
        assert_eq!(made.translation, Some(Vector3 { x: 1.0, y: 2.0, z: 3.0 }));
    }
}
