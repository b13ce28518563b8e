//! The quadratic subproblem, solved stage by stage.
//!
//! Owns the active-set method: the working set has the inputs at a bound, and at which. With a fixed working set the
//! problem is a linear-quadratic regulator, solved by one backward Riccati recursion (`riccati.rs`) and one forward
//! roll-out. Each roll-out gives for every input the minimizer if its bound alone were removed. A minimizer outside
//! of the box adds the bound to the working set; a minimizer of an active input inside of the box removes the bound.
//! A penalty on a state is in the working set where its linearized constraint is violated at the roll-out.
//! When the working set no longer changes, the optimality conditions hold to rounding; a convex problem has no other
//! minimum. The bounds of the working set are the warm start of the next solve and are shifted with the plan; after a
//! problem that went to another solver they are those of its solution. Penalties begin with the excess at the present
//! plan.
//!
//! Correcting all wrong entries of the working set at once is quick (Hintermueller, Ito and Kunisch, 2003, primal-dual
//! active sets) but may cycle. When their number has had no new minimum for [`STALLED_ITERATIONS_MAX`] iterations, only
//! the worst one is corrected, as in block principal pivoting (Judice and Pires, 1994). Cold-started problems can still
//! exceed the iteration limit.

mod riccati;

use std::array;

use horizon_model::{Bounds, Vector};

use self::riccati::{Policy, Value, Working, eliminate};
use super::penalty::of_stage;
use super::{CostHessian, Limits, Problem, Reason, SolveQp, Unsolved};

/// Violation that counts as rounding: of a bound as a fraction of the box, 1; of a penalty in the unit of its
/// constraint.
const ROUNDING_TOLERANCE: f64 = 1e-12;

/// Distance, as a fraction of the box, within which an input of another solver's solution counts as at its bound: an
/// interior-point solution ends at about its tolerance from an active bound, 1e-8 by default. A wrong guess costs one
/// more recursion. 1
const NEAR_BOUND: f64 = 1e-6;

/// Iterations in a row that correct all wrong entries of the working set although their number has no new minimum.
const STALLED_ITERATIONS_MAX: u32 = 4;

/// State of an input in the working set. `Committed`: the input is fixed by the caller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Bound {
    Inactive,
    AtLower,
    AtUpper,
    Committed,
}

/// The working set and the buffers of an iteration.
#[derive(Debug)]
pub(super) struct ActiveSet<const NS: usize, const NU: usize> {
    curvature: CostHessian<NS, NU>,
    iterations_max: u32,
    /// By step.
    working_set: Vec<[Bound; NU]>,
    /// By penalty of the problem, whether it is in the working set.
    penalized: Vec<bool>,
    /// By step, inputs as functions of the state and the input before.
    policies: Vec<Policy<NS, NU>>,
    /// `values[k]` is the cost of everything after `ds_k`.
    values: Vec<Value<NS, NU>>,
    /// By step, the inputs of the latest roll-out.
    du: Vec<Vector<NU>>,
    /// By step, the minimizer of each input if its bound alone were removed.
    minimizers: Vec<Vector<NU>>,
    /// By penalty, its linearized constraint at the latest roll-out. Unit of the constraint
    excess: Vec<f64>,
}

impl<const NS: usize, const NU: usize> ActiveSet<NS, NU> {
    /// A solver for every problem with this `curvature`. All allocation happens here.
    pub(super) fn new(curvature: &CostHessian<NS, NU>, limits: Limits) -> Self {
        let steps = curvature.diagonal.steps();
        Self {
            curvature: curvature.clone(),
            iterations_max: limits.iterations_max,
            working_set: vec![[Bound::Inactive; NU]; steps],
            penalized: Vec::with_capacity(steps * limits.penalties_max),
            policies: vec![Policy::zeros(); steps],
            values: vec![Value::zeros(); steps + 1],
            du: vec![Vector::zeros(); steps],
            minimizers: vec![Vector::zeros(); steps],
            excess: Vec::with_capacity(steps * limits.penalties_max),
        }
    }

    /// Shifts the working set: a stage that `is_moved` gets the bounds of the next stage.
    pub(super) fn shift(&mut self, is_moved: impl Fn(usize) -> bool) {
        for k in (0..self.working_set.len() - 1).filter(|k| is_moved(*k)) {
            self.working_set[k] = self.working_set[k + 1];
        }
    }

    /// Empties the working set.
    pub(super) fn reset(&mut self) {
        self.working_set.fill([Bound::Inactive; NU]);
    }

    /// Sets the working set to the active bounds of `du`, the solution of `problem` by another solver. From an empty
    /// working set this solver would probably fail on the next problem as well.
    pub(super) fn warm_start(&mut self, problem: &Problem<'_, NS, NU>, du: &[Vector<NU>]) {
        for (k, working_set) in self.working_set.iter_mut().enumerate() {
            let Bounds { lo, hi } = &problem.bounds[k];
            *working_set = array::from_fn(|i| {
                let (u, near) = (problem.u[k][i] + du[k][i], NEAR_BOUND * (hi[i] - lo[i]));
                match u {
                    _ if problem.bounds[k].is_given(i) => Bound::Committed,
                    _ if u <= lo[i] + near => Bound::AtLower,
                    _ if u >= hi[i] - near => Bound::AtUpper,
                    _ => Bound::Inactive,
                }
            });
        }
    }

    /// Adapts the working set of the last solve to the inputs that are given now.
    fn fix_given(&mut self, problem: &Problem<'_, NS, NU>) {
        for (k, working_set) in self.working_set.iter_mut().enumerate() {
            for (i, bound) in working_set.iter_mut().enumerate() {
                if problem.bounds[k].is_given(i) {
                    *bound = Bound::Committed;
                } else if *bound == Bound::Committed {
                    *bound = Bound::Inactive;
                }
            }
        }
    }

    /// The steps of the inputs of stage `k` at active bounds, `None` for inactive bounds.
    fn active_steps(&self, problem: &Problem<'_, NS, NU>, k: usize) -> [Option<f64>; NU] {
        let (bounds, u) = (&problem.bounds[k], &problem.u[k]);
        array::from_fn(|i| match self.working_set[k][i] {
            Bound::Inactive => None,
            Bound::AtLower => Some(bounds.lo[i] - u[i]),
            Bound::AtUpper => Some(bounds.hi[i] - u[i]),
            Bound::Committed => Some(0.0),
        })
    }

    /// Backward Riccati recursion over the stages `from`, `from - 1`, .., 0; the later stages are unchanged.
    fn backward_recursion(
        &mut self,
        problem: &Problem<'_, NS, NU>,
        from: usize,
    ) -> Result<(), Reason> {
        for k in (0..=from).rev() {
            let of_stage = of_stage(problem.penalties, k);
            let working = Working {
                k,
                active: self.active_steps(problem, k),
                penalties: &problem.penalties[of_stage.clone()],
                penalized: &self.penalized[of_stage],
            };
            let (before, after) = self.values.split_at_mut(k + 1);
            let (policy, value) = (&mut self.policies[k], &mut before[k]);
            eliminate(problem, &self.curvature, &working, &after[0], policy, value)?;
        }
        Ok(())
    }

    /// Forward roll-out of the policies: inputs and minimizers of every stage, and the linearized constraint of every
    /// penalty.
    fn roll_out(&mut self, problem: &Problem<'_, NS, NU>) {
        self.excess.clear();
        let mut ds = Vector::zeros();
        let mut du_before = Vector::zeros();
        for (k, (policy, stage)) in self.policies.iter().zip(problem.stages).enumerate() {
            let minimizers = policy.minimizers(&ds, &du_before);
            let active = self.active_steps(problem, k);
            let du = Vector::from_fn(|i, _| active[i].unwrap_or(minimizers[i]));
            ds = stage.next(&ds, &du);
            du_before = du;
            (self.du[k], self.minimizers[k]) = (du, minimizers);
            let penalties = &problem.penalties[of_stage(problem.penalties, k)];
            self.excess.extend(penalties.iter().map(|penalty| penalty.excess_at(&ds)));
        }
    }

    /// The correction of the working set for input `i` of stage `k`; `None` if its bound is right.
    fn wrong_bound(&self, problem: &Problem<'_, NS, NU>, k: usize, i: usize) -> Option<WrongEntry> {
        let bound = self.working_set[k][i];
        let (lo, hi) = (problem.bounds[k].lo[i], problem.bounds[k].hi[i]);
        let minimizer = problem.u[k][i] + self.minimizers[k][i];
        let (below, above) = ((lo - minimizer) / (hi - lo), (minimizer - hi) / (hi - lo));
        let corrected = match bound {
            Bound::Committed => return None,
            _ if below > ROUNDING_TOLERANCE => Bound::AtLower,
            _ if above > ROUNDING_TOLERANCE => Bound::AtUpper,
            Bound::AtLower if below >= -ROUNDING_TOLERANCE => Bound::AtLower,
            Bound::AtUpper if above >= -ROUNDING_TOLERANCE => Bound::AtUpper,
            Bound::Inactive | Bound::AtLower | Bound::AtUpper => Bound::Inactive,
        };
        let gap = match bound {
            Bound::AtLower => -below,
            Bound::AtUpper => -above,
            Bound::Inactive | Bound::Committed => below.max(above),
        };
        let entry = Entry::Input { i, corrected };
        (corrected != bound).then_some(WrongEntry { k, entry, gap })
    }

    /// The correction of the working set for penalty `j`; `None` if the roll-out agrees with the working set.
    fn wrong_penalty(&self, problem: &Problem<'_, NS, NU>, j: usize) -> Option<WrongEntry> {
        let (penalty, excess) = (&problem.penalties[j], self.excess[j]);
        let is_wrong = self.penalized[j] != (excess > 0.0) && excess.abs() > ROUNDING_TOLERANCE;
        is_wrong.then_some(WrongEntry {
            k: penalty.stage,
            entry: Entry::Penalty(j),
            gap: excess.abs(),
        })
    }

    /// Every wrong entry of the working set.
    fn wrong_entries(&self, problem: &Problem<'_, NS, NU>) -> impl Iterator<Item = WrongEntry> {
        let inputs = (0..self.working_set.len()).flat_map(|k| (0..NU).map(move |i| (k, i)));
        let inputs = inputs.filter_map(|(k, i)| self.wrong_bound(problem, k, i));
        inputs.chain((0..self.excess.len()).filter_map(|j| self.wrong_penalty(problem, j)))
    }

    /// Corrects one entry of the working set.
    fn correct_entry(&mut self, wrong: &WrongEntry) {
        match wrong.entry {
            Entry::Input { i, corrected } => self.working_set[wrong.k][i] = corrected,
            Entry::Penalty(j) => self.penalized[j] = !self.penalized[j],
        }
    }

    /// Corrects the working set: all wrong entries, or the one with the largest gap if they have stalled.
    /// Returns the latest stage that was changed, `None` if every entry is right.
    fn correct(
        &mut self,
        problem: &Problem<'_, NS, NU>,
        stall: &mut StallDetector,
    ) -> Option<usize> {
        let mut count = 0;
        let mut worst: Option<WrongEntry> = None;
        let mut latest = 0;
        for wrong in self.wrong_entries(problem) {
            count += 1;
            latest = latest.max(wrong.k);
            if worst.as_ref().is_none_or(|worst| wrong.gap > worst.gap) {
                worst = Some(wrong);
            }
        }
        let worst = worst?;
        if stall.has_stalled(count) {
            self.correct_entry(&worst);
            return Some(worst.k);
        }
        for k in 0..=latest {
            for i in 0..NU {
                if let Some(wrong) = self.wrong_bound(problem, k, i) {
                    self.correct_entry(&wrong);
                }
            }
        }
        for j in 0..self.excess.len() {
            if let Some(wrong) = self.wrong_penalty(problem, j) {
                self.correct_entry(&wrong);
            }
        }
        Some(latest)
    }

    /// Iterates until the working set is optimal. Returns the number of iterations.
    fn search(&mut self, problem: &Problem<'_, NS, NU>) -> Result<u32, Unsolved> {
        self.fix_given(problem);
        self.penalized.clear();
        self.penalized.extend(problem.penalties.iter().map(|penalty| penalty.excess > 0.0));
        let mut stall =
            StallDetector { fewest: usize::MAX, iterations_left: STALLED_ITERATIONS_MAX };
        let mut from = Some(self.working_set.len() - 1);
        let mut iterations = 0;
        while let Some(latest) = from {
            if iterations == self.iterations_max {
                return Err(Unsolved { reason: Reason::IterationLimit, iterations });
            }
            iterations += 1;
            self.backward_recursion(problem, latest)
                .map_err(|reason| Unsolved { reason, iterations })?;
            self.roll_out(problem);
            from = self.correct(problem, &mut stall);
        }
        let is_finite = self.du.iter().all(|du| du.iter().all(|value| value.is_finite()));
        if is_finite {
            Ok(iterations)
        } else {
            Err(Unsolved { reason: Reason::NotFinite, iterations })
        }
    }
}

impl<const NS: usize, const NU: usize> SolveQp<NS, NU> for ActiveSet<NS, NU> {
    fn solve(
        &mut self,
        problem: &Problem<'_, NS, NU>,
        du: &mut [Vector<NU>],
    ) -> Result<u32, Unsolved> {
        let searched = self.search(problem);
        match searched {
            Ok(_) => du.copy_from_slice(&self.du),
            Err(_) => self.reset(),
        }
        searched
    }
}

/// A wrong entry of the working set.
#[derive(Debug)]
struct WrongEntry {
    /// The last stage whose elimination depends on the entry.
    k: usize,
    entry: Entry,
    /// Of an input, the distance of its minimizer from its bound as a fraction of the box. 1
    /// Of a penalty, the absolute value of its linearized constraint. Unit of the constraint
    gap: f64,
}

/// An entry of the working set.
#[derive(Debug)]
enum Entry {
    /// Input `i` of the stage, and its state in the corrected working set.
    Input { i: usize, corrected: Bound },
    /// Index of a penalty, which the correction adds to the working set or removes from it.
    Penalty(usize),
}

/// Detects by the number of wrong entries of the working set that the iterations make no progress.
#[derive(Debug)]
struct StallDetector {
    /// Smallest number of wrong entries so far.
    fewest: usize,
    /// Iterations left without a new smallest number before they have stalled.
    iterations_left: u32,
}

impl StallDetector {
    /// Counts an iteration with `wrong_count` wrong entries. Returns whether their number has had no new minimum for
    /// more than [`STALLED_ITERATIONS_MAX`] iterations, so that only one entry may be corrected.
    fn has_stalled(&mut self, wrong_count: usize) -> bool {
        if wrong_count < self.fewest {
            *self = Self { fewest: wrong_count, iterations_left: STALLED_ITERATIONS_MAX };
            return false;
        }
        let has_stalled = self.iterations_left == 0;
        self.iterations_left = self.iterations_left.saturating_sub(1);
        has_stalled
    }
}

#[cfg(test)]
mod tests;
