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
/// Cost of one squared grid step per period. 1
const STEP_COST: f64 = 0.35;
/// Largest step, in points. A larger one would cost more than calling the sample a flip.
const STEP_MAX: usize = 5;
/// Noise of a heading: fraction and standard deviation of two normal laws; the rest is uniform. 1, rad
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

/// Cost of the best path that ends at each point. Negative log likelihood. 1
struct Grid {
    cost: [f64; POINTS],
    /// Cost of a sample by its distance around the circle, in points. Negative log likelihood. 1
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
    horizon_model::whole(((wrap(angle) + PI) / SPACING_RAD).round()) % POINTS
}

#[cfg(test)]
mod tests {
    use horizon_model::check::maximum;

    use super::*;

    /// Cost of a path of points under `samples`, summed by itself.
    fn cost(path: &[usize], samples: &[Option<f64>]) -> f64 {
        let grid = Grid::new();
        let around = |from: usize, to: usize| {
            let gap = (to + POINTS - from) % POINTS;
            if gap > POINTS / 2 { gap as f64 - POINTS as f64 } else { gap as f64 }
        };
        let steps = path.windows(2).map(|pair| {
            let step = around(pair[0], pair[1]);
            if step.abs() > STEP_MAX as f64 { f64::INFINITY } else { STEP_COST * step * step }
        });
        let seen = path.iter().zip(samples).filter_map(|(point, sample)| {
            let at = point_of((*sample)?);
            Some(grid.sample_cost[(point + POINTS - at) % POINTS])
        });
        steps.sum::<f64>() + seen.sum::<f64>()
    }

    /// A turn through half a turn with losses, a flip of a step and one of ten.
    fn samples() -> Vec<Option<f64>> {
        let sample = |k: usize| {
            let flip = if k == 20 || (40..50).contains(&k) { 1.9 } else { 0.0 };
            (k % 7 != 3).then_some(wrap(2.7 + 0.02 * k as f64 + flip))
        };
        (0..80).map(sample).collect()
    }

    #[test]
    fn no_path_beside_the_best_one_costs_less() {
        let samples = samples();
        let best: Vec<usize> = best_path(&samples).into_iter().map(point_of).collect();
        let least = cost(&best, &samples);
        assert!(least.is_finite(), "{best:?}");
        for begin in 0..samples.len() {
            for end in begin + 1..=samples.len() {
                for aside in [1, 2, POINTS - 1, POINTS - 2] {
                    let mut other = best.clone();
                    for point in &mut other[begin..end] {
                        *point = (*point + aside) % POINTS;
                    }
                    let cost = cost(&other, &samples);
                    assert!(
                        cost >= least - 1e-9,
                        "{cost} below {least}: {begin}..{end} by {aside}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_turn_is_followed_over_the_wrap_and_a_flip_is_not() {
        // Near the ends fewer samples pull: the path turns less than they do.
        let gap = best_path(&samples())
            .into_iter()
            .enumerate()
            .filter(|(k, _)| (15..65).contains(k))
            .map(|(k, angle)| wrap(angle - 2.7 - 0.02 * k as f64).abs())
            .fold(0.0, maximum);
        // Two points of the grid.
        assert!(gap < 2.0 * SPACING_RAD, "{gap} rad");
    }

    #[test]
    fn the_end_of_the_best_path_so_far_is_the_end_of_the_best_path() {
        let samples = samples();
        let so_far = best_so_far(&samples);
        for count in [1, 5, 21, 45, 80] {
            let end = best_path(&samples[..count]).pop().unwrap();
            assert_eq!(so_far[count - 1].to_bits(), end.to_bits(), "{count} samples");
        }
        assert!(best_path(&[]).is_empty() && best_so_far(&[]).is_empty());
    }

    #[test]
    fn a_heading_that_stays_turned_is_followed_in_the_end() {
        let turned: Vec<_> = (0..400).map(|k| Some(if k < 100 { 0.0 } else { 1.5 })).collect();
        let path = best_path(&turned);
        assert!(path[50].abs() < SPACING_RAD && (path[350] - 1.5).abs() < SPACING_RAD);
    }

    #[test]
    fn points_and_angles_are_inverse_all_around() {
        for point in 0..POINTS {
            assert_eq!(point_of(angle_of(point)), point);
            assert_eq!(point_of(angle_of(point) + TAU), point);
        }
        // Half a turn is where the circle begins; halves of a point belong to the nearest.
        assert_eq!((point_of(PI), point_of(-PI), point_of(PI - 0.6 * SPACING_RAD)), (0, 0, 627));
        assert_eq!(point_of(PI - 0.4 * SPACING_RAD), 0);
        for (point, shifted) in [(0, 0), (0, 10), (627, 0), (3, 8)] {
            let from = origin(point, shifted);
            assert_eq!(
                (from + shifted) % POINTS,
                (point + STEP_MAX) % POINTS,
                "{point}, {shifted}"
            );
        }
    }

    #[test]
    fn a_sample_costs_least_where_it_is_and_alike_on_both_sides() {
        let Grid { sample_cost, .. } = Grid::new();
        for distance in 1..POINTS / 2 {
            let gap = (sample_cost[distance] - sample_cost[POINTS - distance]).abs();
            assert!(gap < 1e-9, "{gap} at {distance}");
            assert!(sample_cost[distance] >= sample_cost[distance - 1], "{distance}");
        }
        // The density is one over the circle, up to a grid of a quarter of the standard deviation.
        let whole: f64 = sample_cost.iter().map(|cost| (-cost).exp() * SPACING_RAD).sum();
        assert!((whole - 1.0).abs() < 1e-6, "{whole}");
    }
}
