//! Curves through space: where to go, not when.
//!
//! Owns the sampled curve and its arc length. Shapes are in `path/corner.rs`, `path/spline.rs` and
//! `path/circle.rs`, the heading along a curve in `path/heading.rs`, the time it takes in
//! `path/speed.rs`. Nothing here is called in flight.

mod circle;
mod corner;
mod heading;
mod speed;
mod spline;
#[cfg(test)]
mod tests;

use nalgebra::Vector3;

pub(crate) use circle::circle;
pub(crate) use corner::rounded;
pub use heading::Heading;
pub(crate) use speed::Limits;
pub(crate) use spline::spline;

/// Distance between the points of a curve. m
///
/// A straight line between two points leaves a curve of 0.25 m radius by 13 micrometres.
const SPACING_M: f64 = 0.005;

/// Largest turn between two points of a smooth curve. rad
const TURN_MAX_RAD: f64 = 1.0;

/// A point of a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Point {
    /// Position. m
    pub pos_w: Vector3<f64>,
    /// Direction of the curve, of length 1.
    pub tangent_w: Vector3<f64>,
    /// Curvature. 1/m
    pub curvature: f64,
    /// Whether the direction jumps here, so that the vehicle must stand still.
    pub is_sharp: bool,
}

/// A curve as points in a row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Path {
    /// At least three.
    points: Vec<Point>,
    /// Arc length from the beginning to each point. m
    arcs_m: Vec<f64>,
    /// For each waypoint the point where the curve passes it; the first and the last point are among
    /// them.
    marks: Vec<usize>,
}

impl Path {
    fn new(points: Vec<Point>, marks: Vec<usize>) -> Self {
        let mut arc_m = 0.0;
        let mut arcs_m = vec![arc_m];
        for pair in points.windows(2) {
            let chord_m = (pair[1].pos_w - pair[0].pos_w).norm();
            let turn = 0.5 * (pair[0].curvature + pair[1].curvature) * chord_m;
            // An arc is longer than its chord by this fraction, up to the fourth power of the turn.
            arc_m += chord_m * (1.0 + turn * turn / 24.0);
            arcs_m.push(arc_m);
        }
        Self { points, arcs_m, marks }
    }

    /// The first waypoint after which the curve turns by more than [`TURN_MAX_RAD`] from one point to
    /// the next without a stop: what happens between them is not known.
    pub(crate) fn first_unresolved(&self) -> Option<usize> {
        let turns = |i: &usize| {
            let (a, b) = (&self.points[*i], &self.points[*i + 1]);
            let turn = 0.5 * (a.curvature + b.curvature) * (self.arcs_m[*i + 1] - self.arcs_m[*i]);
            let turn_cos = a.tangent_w.dot(&b.tangent_w);
            !(a.is_sharp || b.is_sharp) && (turn > TURN_MAX_RAD || turn_cos < TURN_MAX_RAD.cos())
        };
        let point = (0..self.points.len() - 1).find(turns)?;
        self.marks.iter().rposition(|mark| *mark <= point)
    }

    /// Points where the curve passes its waypoints.
    pub(crate) fn marks(&self) -> &[usize] {
        &self.marks
    }
}

/// Number of equal parts of `length_m` that are no longer than the spacing: even, at least two.
fn parts(length_m: f64) -> u32 {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked lengths")]
    let half = (0.5 * length_m / SPACING_M).ceil().max(1.0) as u32;
    2 * half
}
