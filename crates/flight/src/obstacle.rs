//! Obstacles that stand in the room, or move in it: boxes and upright cylinders.
//!
//! Owns their signed distance and its gradient. What follows from being near stands in
//! `cycle/walls.rs` and `cycle/walls/occupancy.rs`.

use horizon_model::rows::pose;
use horizon_model::setting::{SettingError, in_range, positive};
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// An obstacle, as written in JSON, in the world frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum ObstacleTable {
    /// An upright cylinder.
    Cylinder {
        /// World x and y of its axis. m, -1000..=1000
        centre_m: [f64; 2],
        /// Radius. m, > 0, <= 1000
        radius_m: f64,
        /// Lower and upper end. m, -1000..=1000, the first below the second
        z_m: [f64; 2],
    },
    /// A box along the axes of the world.
    Box {
        /// Lower and upper end along x. m, -1000..=1000, the first below the second
        x_m: [f64; 2],
        /// Along y. m
        y_m: [f64; 2],
        /// Along z. m
        z_m: [f64; 2],
    },
    /// An upright cylinder without ends around a second object that moves, whose position comes with each tick.
    Moving {
        /// Radius. m, > 0, <= 1000
        radius_m: f64,
    },
}

/// Largest radius, and largest distance of an end or an axis from the origin along an axis. m
const FAR_M: f64 = 1000.0;

/// Checked [`ObstacleTable`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Obstacle {
    /// m
    centre_w: Vector3<f64>,
    shape: Shape,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Shape {
    /// Half of the height. m
    Cylinder { radius_m: f64, half_m: f64 },
    /// Half of each edge. m
    Box { half_w: Vector3<f64> },
    /// Around a position that comes with each tick.
    Moving { radius_m: f64 },
}

/// Distance from the surface of an obstacle, negative inside, and its gradient: a unit vector away from the obstacle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SignedDistance {
    /// Distance. m
    pub distance_m: f64,
    /// Gradient of the distance by the position. 1
    pub gradient_w: Vector3<f64>,
}

impl TryFrom<&ObstacleTable> for Obstacle {
    type Error = SettingError;

    fn try_from(table: &ObstacleTable) -> Result<Self, SettingError> {
        match table {
            ObstacleTable::Cylinder { centre_m: [x, y], radius_m, z_m } => {
                let (x, y) = (position("centre_m[0]", *x)?, position("centre_m[1]", *y)?);
                let radius_m = radius(*radius_m)?;
                let (z, half_m) = middle("z_m", *z_m)?;
                let shape = Shape::Cylinder { radius_m, half_m };
                Ok(Self { centre_w: Vector3::new(x, y, z), shape })
            }
            ObstacleTable::Box { x_m, y_m, z_m } => {
                let (x, half_x) = middle("x_m", *x_m)?;
                let (y, half_y) = middle("y_m", *y_m)?;
                let (z, half_z) = middle("z_m", *z_m)?;
                let shape = Shape::Box { half_w: Vector3::new(half_x, half_y, half_z) };
                Ok(Self { centre_w: Vector3::new(x, y, z), shape })
            }
            ObstacleTable::Moving { radius_m } => {
                let radius_m = radius(*radius_m)?;
                Ok(Self { centre_w: Vector3::zeros(), shape: Shape::Moving { radius_m } })
            }
        }
    }
}

/// The checked obstacles, in the order of `tables`.
///
/// # Errors
/// The first value that breaks its rule, under the number of its obstacle; a second obstacle that moves.
pub fn obstacles(tables: &[ObstacleTable]) -> Result<Vec<Obstacle>, SettingError> {
    let is_moving = |(_, table): &(usize, &ObstacleTable)| table.extent_m().is_none();
    if let Some((k, _)) = tables.iter().enumerate().filter(is_moving).nth(1) {
        let rule = "one obstacle that moves at most: its position is that of `moving_object`";
        return Err(SettingError::new(format!("obstacles[{k}]"), "moving", rule));
    }
    let number = |k: usize| move |error: SettingError| error.under(&format!("obstacles[{k}]"));
    tables.iter().enumerate().map(|(k, table)| table.try_into().map_err(number(k))).collect()
}

fn position(key: &str, position_m: f64) -> Result<f64, SettingError> {
    in_range(key, position_m, -FAR_M..=FAR_M)
}

fn radius(radius_m: f64) -> Result<f64, SettingError> {
    in_range("radius_m", positive("radius_m", radius_m)?, 0.0..=FAR_M)
}

/// Middle and half of the length between two ends.
fn middle(key: &str, [low_m, high_m]: [f64; 2]) -> Result<(f64, f64), SettingError> {
    position(key, low_m)?;
    position(key, high_m)?;
    if low_m >= high_m {
        let given = format!("[{low_m}, {high_m}]");
        return Err(SettingError::new(key, given, "the first number below the second"));
    }
    Ok((0.5 * (low_m + high_m), 0.5 * (high_m - low_m)))
}

impl ObstacleTable {
    /// Lower and upper end of the obstacle along x, y and z; `None` for one that moves. World frame. m
    pub(crate) fn extent_m(&self) -> Option<[[f64; 2]; 3]> {
        match self {
            Self::Cylinder { centre_m, radius_m, z_m } => {
                let [x_m, y_m] = centre_m.map(|at_m| [at_m - radius_m, at_m + radius_m]);
                Some([x_m, y_m, *z_m])
            }
            Self::Box { x_m, y_m, z_m } => Some([*x_m, *y_m, *z_m]),
            Self::Moving { .. } => None,
        }
    }
}

impl Obstacle {
    /// Whether motion capture measures this obstacle in each tick; a fixed one stands where the settings say.
    pub fn is_moving(&self) -> bool {
        matches!(self.shape, Shape::Moving { .. })
    }

    /// The signed distance at `at_w`, m, and its gradient, a unit vector, 1; both in the world frame. The
    /// obstacle that moves is at `moving_w`, m; its distance is infinite if that is unknown.
    ///
    /// The gradient is exact where the distance is smooth. On the axis of a cylinder, and inside where two surfaces
    /// are equally near, it is one of the possible directions.
    ///
    /// Real time: no allocation, constant cost.
    pub fn distance_from(
        &self,
        at_w: &Vector3<f64>,
        moving_w: Option<&Vector3<f64>>,
    ) -> SignedDistance {
        let from_w = at_w - self.centre_w;
        match self.shape {
            Shape::Cylinder { radius_m, half_m } => {
                let (across_m, out_w) = radial(&from_w);
                let up_w = Vector3::z() * from_w.z.signum();
                of_excesses(&[(across_m - radius_m, out_w), (from_w.z.abs() - half_m, up_w)])
            }
            Shape::Box { half_w } => {
                let axes_w = [Vector3::x(), Vector3::y(), Vector3::z()];
                let over = |i: usize| (from_w[i].abs() - half_w[i], axes_w[i] * from_w[i].signum());
                of_excesses(&[pose::X, pose::Y, pose::Z].map(over))
            }
            Shape::Moving { radius_m } => {
                let Some(centre_w) = moving_w else {
                    let (distance_m, gradient_w) = (f64::INFINITY, Vector3::zeros());
                    return SignedDistance { distance_m, gradient_w };
                };
                let (across_m, gradient_w) = radial(&(at_w - centre_w));
                SignedDistance { distance_m: across_m - radius_m, gradient_w }
            }
        }
    }

    /// Signed distance, m, and gradient at `at_w`, as of [`Obstacle::distance_from`], of an obstacle at rest.
    pub fn distance(&self, at_w: &Vector3<f64>) -> SignedDistance {
        self.distance_from(at_w, None)
    }

    /// Smallest [`Obstacle::distance_from`] along a vertical climb of `climb_m` from `from_w`, world frame. m
    ///
    /// Obstacles are upright prisms, symmetric about the height of their centre: along a vertical line the distance
    /// grows with the difference from that height, so the smallest one is at the nearest height of the climb.
    ///
    /// Real time: no allocation, constant cost.
    pub(crate) fn distance_in_climb(
        &self,
        from_w: &Vector3<f64>,
        climb_m: f64,
        moving_w: Option<&Vector3<f64>>,
    ) -> SignedDistance {
        // No clamp, which panics if a bound is no number.
        let nearest_z = self.centre_w.z.max(from_w.z).min(from_w.z + climb_m);
        self.distance_from(&Vector3::new(from_w.x, from_w.y, nearest_z), moving_w)
    }

    /// Outline of the obstacle from above, closed, for drawings. m
    pub fn outline(&self) -> Vec<(f64, f64)> {
        const CORNERS: u32 = 48;
        let (x, y) = (self.centre_w.x, self.centre_w.y);
        match self.shape {
            Shape::Cylinder { radius_m, .. } => (0..=CORNERS)
                .map(|k| {
                    let angle_rad = std::f64::consts::TAU * f64::from(k) / f64::from(CORNERS);
                    let (sin, cos) = angle_rad.sin_cos();
                    (x + radius_m * cos, y + radius_m * sin)
                })
                .collect(),
            Shape::Box { half_w } => {
                [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0)]
                    .map(|(a, b)| (x + a * half_w.x, y + b * half_w.y))
                    .to_vec()
            }
            Shape::Moving { .. } => Vec::new(),
        }
    }
}

/// Horizontal length and direction.
fn radial(from_w: &Vector3<f64>) -> (f64, Vector3<f64>) {
    let across_m = from_w.x.hypot(from_w.y);
    let out_w = if across_m > 0.0 {
        Vector3::new(from_w.x / across_m, from_w.y / across_m, 0.0)
    } else {
        Vector3::x()
    };
    (across_m, out_w)
}

/// Distance from the intersection of slabs at right angles, from the excess over each of them and its direction.
fn of_excesses(excesses: &[(f64, Vector3<f64>)]) -> SignedDistance {
    let mut outside_w = Vector3::zeros();
    let (mut distance_m, mut gradient_w) = (f64::NEG_INFINITY, Vector3::zeros());
    for (excess_m, direction_w) in excesses {
        outside_w += direction_w * excess_m.max(0.0);
        if *excess_m > distance_m {
            (distance_m, gradient_w) = (*excess_m, *direction_w);
        }
    }
    let outside_m = outside_w.norm();
    if outside_m > 0.0 {
        return SignedDistance { distance_m: outside_m, gradient_w: outside_w / outside_m };
    }
    SignedDistance { distance_m, gradient_w }
}

#[cfg(test)]
mod tests;
