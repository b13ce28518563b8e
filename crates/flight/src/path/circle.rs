//! Circles at constant height.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::Vector3;

use super::{Path, Point, parts};

/// The circle around `centre_w` from `begin_rad` on, `turns` long, counter-clockwise if positive.
pub(crate) fn circle(centre_w: Vector3<f64>, radius_m: f64, begin_rad: f64, turns: f64) -> Path {
    let count = parts(TAU * turns.abs() * radius_m);
    let direction_w = |angle: f64| Vector3::new(angle.cos(), angle.sin(), 0.0);
    let points: Vec<Point> = (0..=count)
        .map(|i| {
            let angle = begin_rad + TAU * turns * f64::from(i) / f64::from(count);
            Point {
                pos_w: centre_w + radius_m * direction_w(angle),
                tangent_w: direction_w(angle + FRAC_PI_2.copysign(turns)),
                curvature: 1.0 / radius_m,
                is_sharp: false,
            }
        })
        .collect();
    let end = points.len() - 1;
    Path::new(points, vec![0, end])
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    #[test]
    fn points_lie_on_the_circle_with_tangents_along_it_in_the_sense_of_the_turns() {
        let centre_w = Vector3::new(1.0, -2.0, 1.2);
        for turns in [1.0, -1.0, 0.25, -2.5] {
            let path = circle(centre_w, 0.6, 0.3, turns);
            let points = &path.points;
            for (a, b) in points.iter().zip(&points[1..]) {
                let arm_w = a.pos_w - centre_w;
                assert!((arm_w.norm() - 0.6).abs() < 1e-12 && arm_w.z == 0.0, "{turns}: {a:?}");
                assert!((a.tangent_w.norm() - 1.0).abs() < 1e-12, "{turns}");
                assert!(arm_w.dot(&a.tangent_w).abs() < 1e-12, "{turns}");
                assert!(a.tangent_w.dot(&(b.pos_w - a.pos_w)) > 0.0, "{turns}: against the motion");
                assert!(arm_w.cross(&a.tangent_w).z * turns > 0.0, "{turns}: the other sense");
                assert!((a.curvature * 0.6 - 1.0).abs() < 1e-12, "{turns}");
            }
            let (first, last) = (points[0].pos_w, points[points.len() - 1].pos_w);
            let begin_w = centre_w + 0.6 * Vector3::new(0.3_f64.cos(), 0.3_f64.sin(), 0.0);
            assert!((first - begin_w).norm() < 1e-12, "{turns}");
            let chord_m = 2.0 * 0.6 * (PI * turns).sin().abs();
            assert!(((last - first).norm() - chord_m).abs() < 1e-9, "{turns}");
        }
    }
}
