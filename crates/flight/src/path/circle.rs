//! Circles at constant height.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::Vector3;

use super::{Path, Point, parts};

/// The circle around `centre_w` from `begin_rad` on, `turns` long, counter-clockwise if positive.
pub(crate) fn circle(centre_w: Vector3<f64>, radius_m: f64, begin_rad: f64, turns: f64) -> Path {
    let count = parts(TAU * turns.abs() * radius_m);
    let direction = |angle: f64| Vector3::new(angle.cos(), angle.sin(), 0.0);
    let points: Vec<Point> = (0..=count)
        .map(|i| {
            let angle = begin_rad + TAU * turns * f64::from(i) / f64::from(count);
            Point {
                pos_w: centre_w + radius_m * direction(angle),
                tangent_w: direction(angle + FRAC_PI_2.copysign(turns)),
                curvature: 1.0 / radius_m,
                is_sharp: false,
            }
        })
        .collect();
    let end = points.len() - 1;
    Path::new(points, vec![0, end])
}
