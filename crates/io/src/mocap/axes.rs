//! The one place where axes, unit and nose of a source become our frame.
//!
//! Our frame: metres, z up, right-handed; a body's x axis is its nose, z its top. A source defines where its
//! objects are along axes of its own, in a unit of its own. Owns that mapping and its check: a mapping that
//! mirrors is refused, since a mirrored room cannot be flown in.

#![deny(clippy::indexing_slicing)]

use horizon_model::rows::Pose;
use horizon_model::setting::SettingError;
use nalgebra::{Matrix3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Refusal;
use super::body::{heading_of_matrix, pose};

/// Largest entry of `R R^T - I` of a rotation, and largest difference of a quaternion's length to 1. 1
const UNIT_SLACK: f64 = 1e-2;

/// How the source counts, as written in JSON. What is left out is usual for the source.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FrameTable {
    /// Which of the source's axes our x, y and z are: `["x", "-z", "y"]` for a source whose y points up.
    /// Three different axes, right-handed. [default: `["x", "y", "z"]`]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axes: Option<[SourceAxis; 3]>,
    /// Where the nose points in the axes of the object, as the source defined it. [default: our x]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nose: Option<SourceAxis>,
    /// Unit of positions. [default: that of the protocol]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<Unit>,
}

/// A direction along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum SourceAxis {
    /// Along the first axis.
    #[serde(rename = "x")]
    X,
    /// Along the second axis.
    #[serde(rename = "y")]
    Y,
    /// Along the third axis.
    #[serde(rename = "z")]
    Z,
    /// Against the first axis.
    #[serde(rename = "-x")]
    MinusX,
    /// Against the second axis.
    #[serde(rename = "-y")]
    MinusY,
    /// Against the third axis.
    #[serde(rename = "-z")]
    MinusZ,
}

/// A unit of length.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Unit {
    /// Metre.
    #[default]
    #[serde(rename = "m")]
    Metre,
    /// Centimetre.
    #[serde(rename = "cm")]
    Centimetre,
    /// Millimetre.
    #[serde(rename = "mm")]
    Millimetre,
}

/// Where a rigid body is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// x, y, z in axes and unit of the source.
    pub pos_v: [f64; 3],
    /// Rotation from body to the same axes, row by row. 1
    pub matrix: [f64; 9],
}

impl Placement {
    /// Why this is no place in any axes; `None` if it is one.
    pub(super) fn refusal(&self) -> Option<Refusal> {
        let is_finite = self.pos_v.iter().chain(&self.matrix).all(|value| value.is_finite());
        match (is_finite, is_rotation(&self.matrix)) {
            (false, _) => Some(Refusal::Number),
            (true, false) => Some(Refusal::Rotation),
            (true, true) => None,
        }
    }
}

/// Checked [`FrameTable`].
#[derive(Debug, Clone, PartialEq)]
pub struct Axes {
    /// Rows: our axes in those of the source.
    world_from_source: Matrix3<f64>,
    /// Columns: nose, left and top in the object's axes.
    object_from_body: Matrix3<f64>,
    /// Unit of the source's positions.
    pub(super) unit: Unit,
}

impl SourceAxis {
    /// All of them, those along an axis first.
    pub const ALL: [Self; 6] =
        [Self::X, Self::Y, Self::Z, Self::MinusX, Self::MinusY, Self::MinusZ];

    /// Name in the settings: x, y or z, with a minus sign if reversed.
    pub fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
            Self::MinusX => "-x",
            Self::MinusY => "-y",
            Self::MinusZ => "-z",
        }
    }

    /// The direction as a vector of length 1.
    pub fn vector(self) -> Vector3<f64> {
        match self {
            Self::X => Vector3::x(),
            Self::Y => Vector3::y(),
            Self::Z => Vector3::z(),
            Self::MinusX => -Vector3::x(),
            Self::MinusY => -Vector3::y(),
            Self::MinusZ => -Vector3::z(),
        }
    }

    /// The axis that comes nearest to a direction, and the angle between them. rad
    pub fn nearest(direction: &Vector3<f64>) -> (Self, f64) {
        let angle = |axis: &Self| axis.vector().angle(direction);
        let nearest = Self::ALL.into_iter().min_by(|a, b| angle(a).total_cmp(&angle(b)));
        let nearest = nearest.unwrap_or(Self::X);
        (nearest, angle(&nearest))
    }
}

impl Unit {
    /// Length of the unit. m
    pub fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Centimetre => 1e-2,
            Self::Millimetre => 1e-3,
        }
    }
}

impl Axes {
    /// The mapping of `table` for a protocol whose positions are in `usual`.
    ///
    /// # Errors
    /// An axis that occurs twice, a mapping that mirrors, a nose that points up or down.
    pub fn new(table: Option<&FrameTable>, usual: Unit) -> Result<Self, SettingError> {
        let table = table.cloned().unwrap_or_default();
        let axes = table.axes.unwrap_or([SourceAxis::X, SourceAxis::Y, SourceAxis::Z]);
        let [x, y, z] = axes.map(SourceAxis::vector);
        let world_from_source = Matrix3::from_columns(&[x, y, z]).transpose();
        let determinant = world_from_source.determinant();
        if determinant < 0.5 {
            let text = axes.map(SourceAxis::name).join(", ");
            let rule = if determinant < -0.5 {
                "a right-handed mapping: this one mirrors the room; negate one axis or swap two"
            } else {
                "three different axes"
            };
            return Err(SettingError::new("frame.axes", text, rule));
        }
        let nose = table.nose.map_or(x, SourceAxis::vector);
        let left = z.cross(&nose);
        if left.norm() < 0.5 {
            let nose = table.nose.map_or("x", SourceAxis::name);
            let rule = "an axis of the object that lies level, not the one that points up";
            return Err(SettingError::new("frame.nose", nose, rule));
        }
        let object_from_body = Matrix3::from_columns(&[nose, left, z]);
        let unit = table.unit.unwrap_or(usual);
        Ok(Self { world_from_source, object_from_body, unit })
    }

    /// The mapping of a source that counts as we do.
    pub fn ours() -> Self {
        let identity = Matrix3::identity();
        Self { world_from_source: identity, object_from_body: identity, unit: Unit::Metre }
    }

    /// Position of a placement of the source in the world frame, m, and its rotation from body to world, row by row, 1.
    pub fn place(&self, at: &Placement) -> ([f64; 3], [f64; 9]) {
        let pos_w = self.world_from_source * Vector3::from(at.pos_v) * self.unit.metres();
        let rotation = Matrix3::from_row_slice(&at.matrix);
        let matrix = self.world_from_source * rotation * self.object_from_body;
        (pos_w.into(), rows_of(&matrix))
    }

    /// The pose of a placement of the source; `None` if a number is not finite, the rotation is none, or
    /// the top is further than 60 degrees from up. m, rad. No allocation, constant cost.
    pub fn pose(&self, at: &Placement) -> Option<Pose> {
        self.checked_pose(at).ok()
    }

    /// As [`pose`](Self::pose).
    ///
    /// # Errors
    /// Why there is none.
    pub(super) fn checked_pose(&self, at: &Placement) -> Result<Pose, Refusal> {
        let (pos_w, matrix) = self.place(at);
        if !is_rotation(&matrix) {
            let is_finite = matrix.iter().all(|value| value.is_finite());
            return Err(if is_finite { Refusal::Rotation } else { Refusal::Number });
        }
        let theta = heading_of_matrix(&matrix).ok_or(Refusal::Top)?;
        pose(pos_w, theta).ok_or(Refusal::Number)
    }
}

/// Whether the rows of a matrix are orthonormal within [`UNIT_SLACK`], and nothing is mirrored.
fn is_rotation(matrix: &[f64; 9]) -> bool {
    let matrix = Matrix3::from_row_slice(matrix);
    let gap = (matrix * matrix.transpose() - Matrix3::identity()).amax();
    gap <= UNIT_SLACK && matrix.determinant() > 0.0
}

/// A matrix row by row.
pub(super) fn rows_of(matrix: &Matrix3<f64>) -> [f64; 9] {
    // Storage is by columns.
    let mut rows = [0.0; 9];
    rows.iter_mut().zip(matrix.transpose().iter()).for_each(|(to, from)| *to = *from);
    rows
}

/// Matrix, row by row, of a quaternion x y z w; `None` unless its length is 1 within [`UNIT_SLACK`]. 1
pub(super) fn matrix_of_quaternion([x, y, z, w]: [f64; 4]) -> Option<[f64; 9]> {
    let length = nalgebra::Vector4::new(x, y, z, w).norm();
    // Also false for a length that is not a number.
    if !((1.0 - UNIT_SLACK)..=(1.0 + UNIT_SLACK)).contains(&length) {
        return None;
    }
    let quaternion = nalgebra::Quaternion::new(w, x, y, z);
    let rotation = nalgebra::UnitQuaternion::from_quaternion(quaternion).to_rotation_matrix();
    Some(rows_of(rotation.matrix()))
}

/// Quaternion x y z w of the rotation matrix, which is row by row. 1
pub fn quaternion_of_matrix(matrix: &[f64; 9]) -> [f64; 4] {
    let rotation = nalgebra::Rotation3::from_matrix_unchecked(Matrix3::from_row_slice(matrix));
    let quaternion = nalgebra::UnitQuaternion::from_rotation_matrix(&rotation);
    [quaternion.i, quaternion.j, quaternion.k, quaternion.w]
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
