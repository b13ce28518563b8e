//! The most probable path of an angle on a circular grid.
//!
//! Owns the grid, the noise of a heading sample (flips included) and Viterbi's dynamic programming
//! (A. J. Viterbi, IEEE Transactions on Information Theory 13, 1967). A
//! flip that lasts a second is cheaper to call noise than to follow, which no gate can know before it
//! ends.

use std::f64::consts::{PI, TAU};

use horizon_model::angle::wrap;

/// Points of the grid: 0.01 rad apart.
const POINTS: usize = 628;
const SPACING_RAD: f64 = TAU / POINTS as f64;
/// Cost of one squared grid step per period.
const STEP_COST: f64 = 0.35;
/// Largest step, in points. A larger one would cost more than calling the sample a flip.
const STEP_MAX: usize = 5;
/// Noise of a heading: fraction and standard deviation (rad) of two normal laws; the rest is uniform.
const NARROW: (f64, f64) = (0.85, 0.04);
const WIDE: (f64, f64) = (0.10, 0.15);

/// Angle at every step from all samples, on the grid in `[-pi, pi)`. rad
///
/// Allocates one byte per grid point and step; constant cost per step.
pub(super) fn best_path(samples: &[Option<f64>]) -> Vec<f64> {
    let mut grid = Grid::new();
    let mut steps_to = vec![[0; POINTS]; samples.len()];
    for (sample, steps_to) in samples.iter().zip(&mut steps_to) {
        grid.advance(*sample, steps_to);
    }
    let mut point = grid.best();
    let mut path: Vec<f64> = steps_to
        .iter()
        .rev()
        .map(|steps_to| {
            let angle = angle_of(point);
            point = origin(point, usize::from(steps_to[point]));
            angle
        })
        .collect();
    path.reverse();
    path
}

/// Angle at every step from the samples up to it: the end of the best path so far. rad
pub(super) fn best_so_far(samples: &[Option<f64>]) -> Vec<f64> {
    let mut grid = Grid::new();
    let mut unused = [0; POINTS];
    let end = |sample: &Option<f64>| {
        grid.advance(*sample, &mut unused);
        angle_of(grid.best())
    };
    samples.iter().map(end).collect()
}

/// Cost of the best path that ends at each point.
struct Grid {
    cost: [f64; POINTS],
    /// Cost of a sample by its distance around the circle, in points.
    sample_cost: [f64; POINTS],
}

impl Grid {
    fn new() -> Self {
        let normal = |(fraction, sd): (f64, f64), r: f64| {
            fraction / (sd * TAU.sqrt()) * (-0.5 * (r / sd).powi(2)).exp()
        };
        let flip = (1.0 - NARROW.0 - WIDE.0) / TAU;
        let mut sample_cost = [0.0; POINTS];
        for (distance, cost) in sample_cost.iter_mut().enumerate() {
            let r = wrap(distance as f64 * SPACING_RAD);
            *cost = -(normal(NARROW, r) + normal(WIDE, r) + flip).ln();
        }
        Self { cost: [0.0; POINTS], sample_cost }
    }

    /// One step and its sample. `steps_to[point]` becomes the step, shifted by [`STEP_MAX`] to be
    /// positive, by which the best path arrives at `point`.
    fn advance(&mut self, sample: Option<f64>, steps_to: &mut [u8; POINTS]) {
        let before = self.cost;
        self.cost = [f64::INFINITY; POINTS];
        for (shifted, step) in (0_u8..).zip(0..=2 * STEP_MAX) {
            let cost_of_step = STEP_COST * (step as f64 - STEP_MAX as f64).powi(2);
            for point in 0..POINTS {
                let cost = before[origin(point, step)] + cost_of_step;
                if cost < self.cost[point] {
                    self.cost[point] = cost;
                    steps_to[point] = shifted;
                }
            }
        }
        if let Some(sample) = sample {
            let at = point_of(sample);
            for (point, cost) in self.cost.iter_mut().enumerate() {
                *cost += self.sample_cost[(point + POINTS - at) % POINTS];
            }
        }
    }

    fn best(&self) -> usize {
        let mut best = 0;
        for (point, cost) in self.cost.iter().enumerate() {
            if *cost < self.cost[best] {
                best = point;
            }
        }
        best
    }
}

/// Where a path that arrives at `point` by `shifted_step` comes from.
fn origin(point: usize, shifted_step: usize) -> usize {
    (point + POINTS + STEP_MAX - shifted_step) % POINTS
}

fn angle_of(point: usize) -> f64 {
    point as f64 * SPACING_RAD - PI
}

fn point_of(angle: f64) -> usize {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "wrap + pi lies in 0..2 pi; a cast saturates"
    )]
    let point = ((wrap(angle) + PI) / SPACING_RAD).round() as usize;
    point % POINTS
}

#[cfg(test)]
mod tests;
