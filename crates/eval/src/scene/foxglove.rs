//! The well-known messages that Foxglove and Lichtblick draw without set-up.
//!
//! Owns their shape as published by Foxglove under the names `foxglove.PoseInFrame`,
//! `foxglove.FrameTransform`, `foxglove.SceneUpdate` and `foxglove.Log`. SI units, angles as quaternions,
//! colours and opacity in 0..=1. Lists that we never fill are there, since a viewer counts on them.

use horizon_model::rows::{Pose as Row, pose};
use schemars::JsonSchema;
use serde::Serialize;

use crate::predicted_trajectory::{Place, place_of};

/// A list that stays empty.
type Never = [bool; 0];

/// Moment or duration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
pub(super) struct Time {
    sec: u32,
    nsec: u32,
}

/// Point or vector. m
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub(super) struct Vector3 {
    x: f64,
    y: f64,
    z: f64,
}

/// Orientation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub(super) struct Quaternion {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

/// Position and orientation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub(super) struct Pose {
    position: Vector3,
    orientation: Quaternion,
}

/// `foxglove.PoseInFrame`
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct PoseInFrame {
    pub timestamp: Time,
    pub frame_id: &'static str,
    pub pose: Pose,
}

/// `foxglove.FrameTransform`
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct FrameTransform {
    timestamp: Time,
    parent_frame_id: &'static str,
    child_frame_id: &'static str,
    translation: Vector3,
    rotation: Quaternion,
}

/// `foxglove.SceneUpdate`
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct SceneUpdate {
    pub deletions: Never,
    pub entities: Vec<SceneEntity>,
}

/// What replaces the entity of the same name.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct SceneEntity {
    timestamp: Time,
    frame_id: &'static str,
    id: &'static str,
    lifetime: Time,
    frame_locked: bool,
    metadata: Never,
    arrows: Never,
    cubes: Vec<Body>,
    spheres: Vec<Body>,
    cylinders: Never,
    lines: Vec<Line>,
    triangles: Never,
    texts: Never,
    models: Never,
}

/// A cube or a sphere.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Body {
    pose: Pose,
    size: Vector3,
    color: Color,
}

/// A line through points.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Line {
    /// 0: a line through all points.
    r#type: u8,
    pose: Pose,
    /// m, or px if it does not scale.
    thickness: f64,
    scale_invariant: bool,
    points: Vec<Vector3>,
    color: Color,
    colors: Never,
    indices: Never,
}

/// Red, green, blue and opacity in 0..=1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub(super) struct Color {
    r: f64,
    g: f64,
    b: f64,
    a: f64,
}

/// `foxglove.Log`
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Log {
    pub timestamp: Time,
    pub level: Level,
    pub message: String,
    pub name: &'static str,
    pub file: &'static str,
    pub line: u32,
}

/// How bad a message is, as its published number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Level {
    Info = 2,
    Warning = 3,
}

impl Serialize for Level {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u8(*self as u8)
    }
}

impl JsonSchema for Level {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Level".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({ "type": "integer", "minimum": 0, "maximum": 5 })
    }
}

/// The colours of the figures.
pub(super) const BLUE: Color = Color { r: 0.0, g: 0.45, b: 0.70, a: 1.0 };
pub(super) const ORANGE: Color = Color { r: 0.90, g: 0.62, b: 0.0, a: 1.0 };
pub(super) const GREEN: Color = Color { r: 0.0, g: 0.62, b: 0.45, a: 1.0 };
pub(super) const GREY: Color = Color { r: 0.5, g: 0.5, b: 0.5, a: 1.0 };
pub(super) const VERMILION: Color = Color { r: 0.84, g: 0.37, b: 0.0, a: 0.7 };

impl Time {
    /// For ever, as a lifetime.
    pub(super) const ZERO: Self = Self { sec: 0, nsec: 0 };

    /// A moment, or a duration. ns
    pub(super) fn from_ns(ns: u64) -> Self {
        let sec = u32::try_from(ns / 1_000_000_000).unwrap_or(u32::MAX);
        Self { sec, nsec: u32::try_from(ns % 1_000_000_000).unwrap_or(0) }
    }
}

impl From<Place> for Vector3 {
    fn from([x, y, z]: Place) -> Self {
        Self { x, y, z }
    }
}

impl Vector3 {
    pub(super) fn of(at: &Row) -> Self {
        place_of(at).into()
    }
}

impl Pose {
    /// No shift, no turn.
    pub(super) const HERE: Self = Self {
        position: Vector3 { x: 0.0, y: 0.0, z: 0.0 },
        orientation: Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 },
    };

    /// A pose of the vehicle: turned by theta about z.
    pub(super) fn of(at: &Row) -> Self {
        let (z, w) = (0.5 * at[pose::THETA]).sin_cos();
        Self { position: Vector3::of(at), orientation: Quaternion { x: 0.0, y: 0.0, z, w } }
    }
}

impl FrameTransform {
    /// Where the frame `child_frame_id` is in the frame `parent_frame_id`.
    pub(super) fn new(
        timestamp: Time,
        parent_frame_id: &'static str,
        child_frame_id: &'static str,
        at: &Pose,
    ) -> Self {
        let Pose { position: translation, orientation: rotation } = *at;
        Self { timestamp, parent_frame_id, child_frame_id, translation, rotation }
    }
}

impl SceneEntity {
    /// Nothing called `id` yet, for as long as `lifetime`.
    pub(super) fn new(
        timestamp: Time,
        frame_id: &'static str,
        id: &'static str,
        lifetime: Time,
    ) -> Self {
        Self {
            timestamp,
            frame_id,
            id,
            lifetime,
            frame_locked: true,
            metadata: [],
            arrows: [],
            cubes: Vec::new(),
            spheres: Vec::new(),
            cylinders: [],
            lines: Vec::new(),
            triangles: [],
            texts: [],
            models: [],
        }
    }

    /// The same with a line of 2 px.
    pub(super) fn line(mut self, points: Vec<Vector3>, color: Color) -> Self {
        self.lines.push(Line {
            r#type: 0,
            pose: Pose::HERE,
            thickness: 2.0,
            scale_invariant: true,
            points,
            color,
            colors: [],
            indices: [],
        });
        self
    }

    /// The same with a box of size x, y, z. m
    pub(super) fn cube(mut self, pose: Pose, [x, y, z]: [f64; 3], color: Color) -> Self {
        self.cubes.push(Body { pose, size: Vector3 { x, y, z }, color });
        self
    }

    /// The same with a ball of this diameter. m
    pub(super) fn sphere(mut self, pose: Pose, diameter_m: f64, color: Color) -> Self {
        let size = Vector3 { x: diameter_m, y: diameter_m, z: diameter_m };
        self.spheres.push(Body { pose, size, color });
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_a_turn_is_the_quaternion_about_z() {
        let Pose { orientation: Quaternion { x, y, z, w }, .. } =
            Pose::of(&Row::new(0.0, 0.0, 0.0, std::f64::consts::PI));
        assert!(x.abs() + y.abs() + w.abs() < 1e-12 && (z - 1.0).abs() < 1e-12, "{x} {y} {z} {w}");
    }

    #[test]
    fn a_time_is_split_at_the_second() {
        assert_eq!(Time::from_ns(1_700_000_000_123_456_789).nsec, 123_456_789);
        let json = serde_json::to_string(&Time::from_ns(2_000_000_001)).unwrap();
        assert_eq!(json, r#"{"sec":2,"nsec":1}"#);
        assert_eq!(serde_json::to_string(&Level::Warning).unwrap(), "3");
    }
}
