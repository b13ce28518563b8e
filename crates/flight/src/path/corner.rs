//! Straight sides with rounded corners.

use horizon_model::rows::{Pose, pos_w};
use nalgebra::Vector3;

use super::{Path, Point, parts};

/// Turns beyond this are flown to the waypoint and back instead of around it. Cosine of 168 degrees. 1
const REVERSAL_COS: f64 = -0.98;

/// Sine of half the turn below which a corner is straight. 1
const STRAIGHT_SIN: f64 = 1e-6;

/// Shortest blend that is worth flying. m
const BLEND_MIN_M: f64 = 1e-3;

/// The polyline through `waypoints` with each corner rounded so that the curve passes the waypoint at
/// `corner_m`, or nearer where half a side is too short for that.
///
/// A corner is a parabola from `T` before the waypoint to `T` after it, tangent to both sides,
/// `B(q) = C - T (1-q)^2 d_in_w + T q^2 d_out_w`, `0 <= q <= 1`. With a turn by `phi` it passes the
/// waypoint `C` at `T sin(phi/2) / 2`. It is the curve of a constant acceleration: the whole
/// acceleration is used all the way, and the vehicle enters a right angle 1.29 times as fast as an
/// arc that passes the waypoint at the same distance. The acceleration jumps at both ends, which
/// sticks can do.
///
/// A waypoint where the path turns back on itself, or that is not rounded, is a sharp point.
pub(crate) fn rounded(waypoints: &[Pose], corner_m: f64) -> Path {
    let corners_w: Vec<Vector3<f64>> = waypoints.iter().map(pos_w).collect();
    let mut points = Vec::new();
    let mut marks = vec![0];
    for (k, side) in corners_w.windows(2).enumerate() {
        let displacement_w = side[1] - side[0];
        let d_in_w = displacement_w.normalize();
        if k == 0 {
            points.push(Point {
                pos_w: side[0],
                tangent_w: d_in_w,
                curvature: 0.0,
                is_sharp: false,
            });
        }
        let Some(after_w) = corners_w.get(k + 2) else {
            line_to(&mut points, side[1], d_in_w);
            marks.push(points.len() - 1);
            break;
        };
        let out_w = after_w - side[1];
        let d_out_w = out_w.normalize();
        let blend_m = blend(d_in_w, d_out_w, corner_m)
            .min(0.5 * displacement_w.norm())
            .min(0.5 * out_w.norm());
        line_to(&mut points, side[1] - blend_m * d_in_w, d_in_w);
        if blend_m > 0.0 {
            marks.push(
                points.len() - 1 + parabola(&mut points, side[1], blend_m, [d_in_w, d_out_w]),
            );
        } else {
            marks.push(points.len() - 1);
            let is_straight = (d_out_w - d_in_w).norm() < 2.0 * STRAIGHT_SIN;
            if let Some(corner) = points.last_mut() {
                corner.is_sharp = !is_straight;
            }
        }
    }
    Path::new(points, marks)
}

/// Length of a side that a corner takes; 0 where it is not rounded. m
fn blend(d_in_w: Vector3<f64>, d_out_w: Vector3<f64>, corner_m: f64) -> f64 {
    let half_turn_sin = 0.5 * (d_out_w - d_in_w).norm();
    let blend_m = 2.0 * corner_m / half_turn_sin;
    let is_corner = half_turn_sin > STRAIGHT_SIN && d_in_w.dot(&d_out_w) > REVERSAL_COS;
    if is_corner && blend_m > BLEND_MIN_M { blend_m } else { 0.0 }
}

/// Appends the straight line from the last point to `to_w`.
fn line_to(points: &mut Vec<Point>, to_w: Vector3<f64>, tangent_w: Vector3<f64>) {
    let Some(from_w) = points.last().map(|point| point.pos_w) else { return };
    let displacement_w = to_w - from_w;
    // Two blends on one side leave nothing between them but rounding.
    if displacement_w.norm() < BLEND_MIN_M {
        return;
    }
    let count = parts(displacement_w.norm());
    points.extend((1..=count).map(|i| {
        let pos_w = from_w + displacement_w * (f64::from(i) / f64::from(count));
        Point { pos_w, tangent_w, curvature: 0.0, is_sharp: false }
    }));
}

/// Appends the parabola around `corner_w`; its number of points up to the middle comes back.
fn parabola(
    points: &mut Vec<Point>,
    corner_w: Vector3<f64>,
    blend_m: f64,
    [d_in_w, d_out_w]: [Vector3<f64>; 2],
) -> usize {
    let count = parts(2.0 * blend_m);
    let turn_w = 2.0 * blend_m * (d_out_w - d_in_w);
    let at = |i: u32| {
        let q = f64::from(i) / f64::from(count);
        let by_q_w = 2.0 * blend_m * ((1.0 - q) * d_in_w + q * d_out_w);
        let pos_w = corner_w + blend_m * (q * q * d_out_w - (1.0 - q).powi(2) * d_in_w);
        let curvature = by_q_w.cross(&turn_w).norm() / by_q_w.norm().powi(3);
        Point { pos_w, tangent_w: by_q_w.normalize(), curvature, is_sharp: false }
    };
    if let Some(joint) = points.last_mut() {
        joint.curvature = joint.curvature.max(at(0).curvature);
    }
    points.extend((1..=count).map(at));
    count as usize / 2
}

#[cfg(test)]
mod tests;
