//! The optimizer: COBYLA, which models the cost by a plane through as many points as there are numbers
//! and one more. `docs/decisions/0014-tuning.md` has the comparison.
//!
//! Owns what a foreign optimizer does not know: that a try may be refused, and that the user may stop.

use std::cell::RefCell;

use anyhow::Result;
use cobyla::{Func, RhoBeg, StopTols};

/// Change of every fraction below which the search ends. 1
const X_TOLERANCE: f64 = 1e-3;

/// A point that was tried.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// Fractions of the ranges. 1, 0..=1
    pub x: Vec<f64>,
    /// Cost of the batch. s
    pub cost: f64,
}

/// Determines the cost of a point, given those that were tried before; `None` ends the search.
pub(super) type Cost<'a> = &'a mut dyn FnMut(&[f64], &[Trial]) -> Result<Option<f64>>;

/// Looks for the least cost from `start` on with at most `tries` points; the points in the order of
/// their tries, `start` first.
///
/// Deterministic: no random numbers.
///
/// # Errors
/// The cost of `start` cannot be determined. Later failures count as refused points.
pub fn minimize(start: &[f64], step: f64, tries: usize, cost: Cost<'_>) -> Result<Vec<Trial>> {
    let state = RefCell::new(SearchState { cost, trials: Vec::new(), left: tries, error: None });
    let objective = |x: &[f64], (): &mut ()| state.borrow_mut().cost_at(x);
    let bounds = vec![(0.0, 1.0); start.len()];
    let tolerances = StopTols { xtol_abs: vec![X_TOLERANCE; start.len()], ..StopTols::default() };
    let constraints: [&dyn Func<()>; 0] = [];
    // The status is ignored: the best trial is the result whatever ended the search.
    let (Ok(_) | Err(_)) = cobyla::minimize(
        objective,
        start,
        &bounds,
        &constraints,
        (),
        tries,
        RhoBeg::All(step),
        Some(tolerances),
    );
    let SearchState { trials, error, .. } = state.into_inner();
    error.map_or(Ok(trials), Err)
}

struct SearchState<'a> {
    cost: Cost<'a>,
    trials: Vec<Trial>,
    /// Tries that are left; none once the search is over.
    left: usize,
    /// Why the first try failed.
    error: Option<anyhow::Error>,
}

impl SearchState<'_> {
    /// The cost that the optimizer gets for `x`. It cannot be stopped from within: after the last try the
    /// answers are cheap.
    fn cost_at(&mut self, x: &[f64]) -> f64 {
        if self.left == 0 {
            return self.worst();
        }
        self.left -= 1;
        let x: Vec<f64> = x.iter().map(|fraction| fraction.clamp(0.0, 1.0)).collect();
        let cost = match (self.cost)(&x, &self.trials) {
            Ok(Some(cost)) => cost,
            Ok(None) => {
                self.left = 0;
                return self.worst();
            }
            Err(reason) if self.trials.is_empty() => {
                self.left = 0;
                self.error = Some(reason);
                return self.worst();
            }
            Err(_) => self.worst(),
        };
        self.trials.push(Trial { x, cost });
        cost
    }

    /// Cost of a refused point: that of the worst one. A larger penalty would distort the optimizer's linear model.
    fn worst(&self) -> f64 {
        self.trials.iter().map(|trial| trial.cost).reduce(f64::max).unwrap_or(0.0)
    }
}

/// The first of the cheapest points.
pub fn best(trials: &[Trial]) -> Option<&Trial> {
    trials.iter().min_by(|a, b| a.cost.total_cmp(&b.cost))
}

#[cfg(test)]
mod tests {
    use anyhow::bail;

    use super::*;

    /// A minimum across the axes, with its bottom at (0.3, 0.6).
    fn minimum(x: &[f64]) -> f64 {
        let (a, b) = (x[0] - 0.3, x[1] - 0.6);
        1.0 + 10.0 * (a + b).powi(2) + (a - b).powi(2)
    }

    #[test]
    fn the_minimum_is_found_again_and_again() {
        let run = || minimize(&[0.9, 0.9], 0.2, 60, &mut |x, _| Ok(Some(minimum(x)))).unwrap();
        let trials = run();
        let best = best(&trials).unwrap();
        assert!(best.cost < 1.001, "{best:?} after {} tries", trials.len());
        assert_eq!(trials[0].x, [0.9, 0.9]);
        assert_eq!(trials, run());
    }

    #[test]
    fn points_stay_in_their_ranges_and_refused_ones_are_left() {
        let trials = minimize(&[0.5, 0.5], 0.2, 40, &mut |x, _| {
            if x[0] > 0.8 {
                bail!("too far");
            }
            Ok(Some(-x[0] - x[1]))
        });
        let trials = trials.unwrap();
        assert!(trials.iter().flat_map(|trial| &trial.x).all(|x| (0.0..=1.0).contains(x)));
        // The best point costs -1.8. A linear model does not see the jump of the cost beside it.
        let best = best(&trials).unwrap();
        assert!(best.cost < -1.4, "{best:?}");
    }

    #[test]
    fn it_ends_on_request_and_never_tries_more_than_allowed() {
        let stopped = minimize(&[0.9, 0.9], 0.2, 60, &mut |x, trials| {
            Ok((trials.len() < 5).then(|| minimum(x)))
        });
        assert_eq!(stopped.unwrap().len(), 5);
        let few = minimize(&[0.9, 0.9], 0.2, 7, &mut |x, _| Ok(Some(minimum(x)))).unwrap();
        assert_eq!(few.len(), 7);
        let error = minimize(&[0.5], 0.2, 9, &mut |_, _| bail!("no such file")).unwrap_err();
        assert_eq!(error.to_string(), "no such file");
    }
}
