//! How fast a path is flown.

use std::f64::consts::FRAC_PI_2;

use horizon_model::rows::Pose;

use super::Path;
use crate::trajectory::{Node, Trajectory};

/// Curvature of a straight line, up to rounding. 1/m
const CURVATURE_MIN: f64 = 1e-6;

/// How fast a path may be flown. All > 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Limits {
    /// Speed along the path. m/s
    pub speed_mps: f64,
    /// Acceleration, along the path and across together. m/s^2
    pub accel_mps2: f64,
    /// Acceleration where the speed rises. m/s^2
    pub speed_up_mps2: f64,
    /// Speed upwards or downwards. m/s
    pub climb_mps: f64,
    /// Yaw rate. rad/s
    pub turn_radps: f64,
}

impl Path {
    /// The path flown from rest to rest as fast as `limits` allow, with `headings` at its points.
    ///
    /// The speed `v` is below all of `speed_mps`, `climb_mps / |dz/ds|`, `turn_radps / |dtheta/ds|`
    /// and `sqrt(accel_mps2 / curvature)`, and changes with at most what the curve leaves of the
    /// acceleration, `sqrt(accel^2 - (curvature v^2)^2)`. With `w = v^2` a constant acceleration `a`
    /// is `dw/ds = 2 a`: one pass forward, with `speed_up_mps2`, and one backward give the fastest such speed.
    ///
    /// A jump of the heading lies between two points, and the limit there lets the vehicle turn
    /// almost on the spot.
    ///
    /// [`Path::duration_s`] with the same arguments is finite.
    pub(crate) fn timed(&self, headings: &[f64], limits: &Limits) -> Trajectory {
        let speeds_mps = self.speeds(headings, limits);
        let derivatives = self.heading_derivatives(headings);
        let mut at_s = 0.0;
        let nodes = (0..self.points.len()).map(|i| {
            if i > 0 {
                at_s += 2.0 * self.length_m(i - 1) / (speeds_mps[i - 1] + speeds_mps[i]);
            }
            let point = &self.points[i];
            let rate_w = speeds_mps[i] * point.tangent_w;
            Node {
                at_s,
                arc_m: self.arcs_m[i],
                pose: Pose::new(point.pos_w.x, point.pos_w.y, point.pos_w.z, headings[i]),
                rate: Pose::new(rate_w.x, rate_w.y, rate_w.z, speeds_mps[i] * derivatives[i]),
            }
        });
        Trajectory::new(nodes.collect())
    }

    /// Time that [`Path::timed`] takes; infinite where the limits leave no speed. s
    pub(crate) fn duration_s(&self, headings: &[f64], limits: &Limits) -> f64 {
        let speeds_mps = self.speeds(headings, limits);
        let times = speeds_mps.windows(2).enumerate();
        times.map(|(i, ends)| 2.0 * self.length_m(i) / (ends[0] + ends[1])).sum()
    }

    /// Length of the interval after point `i`. m
    fn length_m(&self, i: usize) -> f64 {
        self.arcs_m[i + 1] - self.arcs_m[i]
    }

    /// Speed at each point. m/s
    fn speeds(&self, headings: &[f64], limits: &Limits) -> Vec<f64> {
        let mut w = self.speed_squares_max(headings, limits);
        let last = w.len() - 1;
        for i in 0..last {
            w[i + 1] = w[i + 1].min(self.square_after(i, w[i], limits.speed_up_mps2));
        }
        for i in (0..last).rev() {
            w[i] = w[i].min(self.square_after(i, w[i + 1], limits.accel_mps2));
        }
        w.into_iter().map(f64::sqrt).collect()
    }

    /// Square of the largest speed at each point, whatever the speed elsewhere.
    fn speed_squares_max(&self, headings: &[f64], limits: &Limits) -> Vec<f64> {
        let last = self.points.len() - 1;
        let mut w: Vec<f64> = self
            .points
            .iter()
            .enumerate()
            .map(|(i, point)| match point {
                point if point.is_sharp || i == 0 || i == last => 0.0,
                point => limits.speed_mps.powi(2).min(limits.accel_mps2 / point.curvature),
            })
            .collect();
        for i in 0..last {
            let climb = (self.points[i + 1].pos_w.z - self.points[i].pos_w.z) / self.length_m(i);
            let turn = (headings[i + 1] - headings[i]) / self.length_m(i);
            let speed_mps = (limits.climb_mps / climb.abs()).min(limits.turn_radps / turn.abs());
            w[i] = w[i].min(speed_mps.powi(2));
            w[i + 1] = w[i + 1].min(speed_mps.powi(2));
        }
        w
    }

    /// Largest square of the speed at one end of interval `i` if it is `w` at the other.
    ///
    /// With one curvature all along, `dw/ds = 2 sqrt(accel^2 - (curvature w)^2)` is a sine that rises
    /// to `accel / curvature`: from rest there always is some speed.
    fn square_after(&self, i: usize, w: f64, accel_mps2: f64) -> f64 {
        let curvature = 0.5 * (self.points[i].curvature + self.points[i + 1].curvature);
        if curvature < CURVATURE_MIN {
            return w + 2.0 * self.length_m(i) * accel_mps2;
        }
        let square_max = accel_mps2 / curvature;
        let begin = (w / square_max).min(1.0).asin();
        let end = (begin + 2.0 * curvature * self.length_m(i)).min(FRAC_PI_2);
        w.max(square_max * end.sin())
    }

    /// Derivative of the heading by the arc length at each point: the harmonic mean of both sides, 0 where
    /// one of them is, so that the heading between points never leaves theirs. rad/m
    fn heading_derivatives(&self, headings: &[f64]) -> Vec<f64> {
        let last = self.points.len() - 1;
        let derivative = |i: usize| (headings[i + 1] - headings[i]) / self.length_m(i);
        (0..=last)
            .map(|i| match i {
                0 => derivative(0),
                i if i == last => derivative(last - 1),
                i => {
                    let (before, after) = (derivative(i - 1), derivative(i));
                    let product = before * after;
                    if product > 0.0 { 2.0 * product / (before + after) } else { 0.0 }
                }
            })
            .collect()
    }
}

#[cfg(test)]
mod tests;
