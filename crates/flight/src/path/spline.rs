//! Smooth curves through waypoints.

use horizon_model::rows::{Pose, pos_w};
use nalgebra::Vector3;

use super::{Path, Point, parts};

/// Passes of the iteration for the second derivatives. Each one at least halves the error.
const PASSES: u32 = 60;

/// Speed below which a spline has no direction, in units of its parameter. 1
const CUSP_SPEED: f64 = 1e-6;

/// The cubic spline through `waypoints` over the chord length: direction and curvature are
/// continuous. A closed one ends where it begins, an open one is straight at both ends.
pub(crate) fn spline(waypoints: &[Pose], is_closed: bool) -> Path {
    let mut knots_w: Vec<Vector3<f64>> = waypoints.iter().map(pos_w).collect();
    if is_closed {
        knots_w.extend(knots_w.first().copied());
    }
    let second_derivatives_w = second_derivatives(&knots_w, is_closed);
    let mut points: Vec<Point> = Vec::new();
    let mut marks = vec![0];
    for (i, side) in knots_w.windows(2).enumerate() {
        let span = Span {
            ends_w: [side[0], side[1]],
            second_derivatives_w: [second_derivatives_w[i], second_derivatives_w[i + 1]],
        };
        let count = parts(span.chord_m());
        let first = u32::from(i > 0);
        for j in first..=count {
            let fallback_w = points.last().map_or(side[1] - side[0], |point| point.tangent_w);
            points.push(span.at(f64::from(j) / f64::from(count), fallback_w));
        }
        marks.push(points.len() - 1);
    }
    Path::new(points, marks)
}

/// Second derivatives at the knots by the chord length, from the continuity of the first ones:
/// `h_a m_a + 2 (h_a + h_b) m + h_b m_b = 6 (d_b / h_b - d_a / h_a)` with the neighbours a and b
/// (de Boor, A Practical Guide to Splines, 1978, chapter IV).
///
/// Each row's diagonal is twice the rest: Gauss-Seidel passes converge from anywhere, and a closed
/// spline is no special case.
fn second_derivatives(knots_w: &[Vector3<f64>], is_closed: bool) -> Vec<Vector3<f64>> {
    let last = knots_w.len() - 1;
    let mut second_derivatives_w = vec![Vector3::zeros(); knots_w.len()];
    for _ in 0..PASSES {
        for i in usize::from(!is_closed)..last {
            let before = if i == 0 { last - 1 } else { i - 1 };
            let (chord_a_w, chord_b_w) =
                (knots_w[i] - knots_w[before], knots_w[i + 1] - knots_w[i]);
            let (h_a, h_b) = (chord_a_w.norm(), chord_b_w.norm());
            let known_w = 6.0 * (chord_b_w / h_b - chord_a_w / h_a);
            second_derivatives_w[i] =
                (known_w - h_a * second_derivatives_w[before] - h_b * second_derivatives_w[i + 1])
                    / (2.0 * (h_a + h_b));
            if i == 0 {
                second_derivatives_w[last] = second_derivatives_w[0];
            }
        }
    }
    second_derivatives_w
}

/// One cubic of a spline.
struct Span {
    ends_w: [Vector3<f64>; 2],
    second_derivatives_w: [Vector3<f64>; 2],
}

impl Span {
    fn chord_m(&self) -> f64 {
        (self.ends_w[1] - self.ends_w[0]).norm()
    }

    /// The point at the fraction `q` of the chord; `fallback_w` is the direction where there is none.
    fn at(&self, q: f64, fallback_w: Vector3<f64>) -> Point {
        let ([from_w, to_w], [second_a_w, second_b_w], h) =
            (self.ends_w, self.second_derivatives_w, self.chord_m());
        let r = 1.0 - q;
        let pos_w = r * from_w
            + q * to_w
            + (h * h / 6.0) * ((r.powi(3) - r) * second_a_w + (q.powi(3) - q) * second_b_w);
        let derivative_w = (to_w - from_w) / h
            + (h / 6.0) * ((1.0 - 3.0 * r * r) * second_a_w + (3.0 * q * q - 1.0) * second_b_w);
        let second_w = r * second_a_w + q * second_b_w;
        if derivative_w.norm() < CUSP_SPEED {
            return Point {
                pos_w,
                tangent_w: fallback_w.normalize(),
                curvature: 0.0,
                is_sharp: true,
            };
        }
        let curvature = derivative_w.cross(&second_w).norm() / derivative_w.norm().powi(3);
        Point { pos_w, tangent_w: derivative_w.normalize(), curvature, is_sharp: false }
    }
}

#[cfg(test)]
mod tests;
