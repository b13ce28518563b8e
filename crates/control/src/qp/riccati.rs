//! The quadratic subproblem, solved stage by stage.
//!
//! Owns the search for the active set: which inputs rest at which bound. With the set guessed the rest
//! is a regulator problem with equality only, solved by one sweep along the stages (`sweep.rs`).
//! Each sweep tells for each input where it would go if it alone were let go; inputs that would
//! leave the box are held, held ones that would come back are freed, until nothing changes. Then the
//! answer is optimal to rounding. The set is kept from solve to solve and moves on with the plan.
//!
//! Changing all wrong guesses at once is quick (Hintermueller, Ito and Kunisch, 2003, primal-dual active
//! sets) but may go round in circles. When the number of wrong guesses has not fallen for a while,
//! only the worst one is changed, as in block principal pivoting (Judice and Pires, 1994). Even so a
//! problem in a thousand, begun without a guess, takes too many sweeps and is given up.

mod sweep;

use std::array;

use nalgebra::SVector;

use self::sweep::{Policy, Value, eliminate};
use super::{Curvature, Limits, Problem, Reason, SolveQp, Unsolved};

/// How far an input may lie beyond a bound, or want to leave it, as a share of the box: rounding.
const SLACK: f64 = 1e-12;

/// Sweeps that may change all wrong guesses without there being fewer of them.
const PATIENCE: u32 = 4;

/// What keeps an input from moving.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Hold {
    Free,
    AtLower,
    AtUpper,
    Given,
}

/// A guess of the active set and the buffers of a sweep.
#[derive(Debug)]
pub(super) struct Riccati<const NS: usize, const NU: usize> {
    curvature: Curvature<NS, NU>,
    sweeps_max: u32,
    /// By step.
    holds: Vec<[Hold; NU]>,
    /// By step, inputs as functions of the state and the input before.
    policies: Vec<Policy<NS, NU>>,
    /// `values[k]` is the cost of everything after `ds_k`.
    values: Vec<Value<NS, NU>>,
    /// By step, the inputs of the latest sweep.
    du: Vec<SVector<f64, NU>>,
    /// By step, where each input would go if it alone were let go.
    pull: Vec<SVector<f64, NU>>,
}

impl<const NS: usize, const NU: usize> Riccati<NS, NU> {
    /// A solver for every problem with this `curvature`. All allocation happens here.
    pub(super) fn new(curvature: &Curvature<NS, NU>, limits: Limits) -> Self {
        let steps = curvature.diagonal.steps();
        Self {
            curvature: curvature.clone(),
            sweeps_max: limits.iterations_max,
            holds: vec![[Hold::Free; NU]; steps],
            policies: vec![Policy::zeros(); steps],
            values: vec![Value::zeros(); steps + 1],
            du: vec![SVector::zeros(); steps],
            pull: vec![SVector::zeros(); steps],
        }
    }

    /// Moves the guess on: a stage that `is_moved` becomes what the next one was.
    pub(super) fn shift(&mut self, is_moved: impl Fn(usize) -> bool) {
        for k in (0..self.holds.len() - 1).filter(|k| is_moved(*k)) {
            self.holds[k] = self.holds[k + 1];
        }
    }

    /// Forgets the guess.
    pub(super) fn reset(&mut self) {
        self.holds.fill([Hold::Free; NU]);
    }

    /// Fits the guess of the last solve to what is given now.
    fn hold_given(&mut self, problem: &Problem<'_, NS, NU>) {
        for (k, holds) in self.holds.iter_mut().enumerate() {
            for (i, hold) in holds.iter_mut().enumerate() {
                if problem.bounds[k].is_given(i) {
                    *hold = Hold::Given;
                } else if *hold == Hold::Given {
                    *hold = Hold::Free;
                }
            }
        }
    }

    /// The steps that the held inputs of step `k` take, `None` for free ones.
    fn held(&self, problem: &Problem<'_, NS, NU>, k: usize) -> [Option<f64>; NU] {
        let (bounds, u) = (&problem.bounds[k], &problem.u[k]);
        array::from_fn(|i| match self.holds[k][i] {
            Hold::Free => None,
            Hold::AtLower => Some(bounds.lo[i] - u[i]),
            Hold::AtUpper => Some(bounds.hi[i] - u[i]),
            Hold::Given => Some(0.0),
        })
    }

    /// Policies and values of steps `from`, `from - 1`, .., 0; those after it are still right.
    fn sweep_back(&mut self, problem: &Problem<'_, NS, NU>, from: usize) -> Result<(), Reason> {
        for k in (0..=from).rev() {
            let held = self.held(problem, k);
            let (before, after) = self.values.split_at_mut(k + 1);
            let into = (&mut self.policies[k], &mut before[k]);
            eliminate(k, problem, &self.curvature, &held, into, &after[0])?;
        }
        Ok(())
    }

    /// Inputs and pulls that follow from the policies.
    fn sweep_forward(&mut self, problem: &Problem<'_, NS, NU>) {
        let mut ds = SVector::zeros();
        let mut du_before = SVector::zeros();
        for (k, (policy, stage)) in self.policies.iter().zip(problem.stages).enumerate() {
            let pull = policy.pull(&ds, &du_before);
            let held = self.held(problem, k);
            let du = SVector::from_fn(|i, _| held[i].unwrap_or(pull[i]));
            ds = stage.next(&ds, &du);
            du_before = du;
            (self.du[k], self.pull[k]) = (du, pull);
        }
    }

    /// What is wrong about how input `i` of step `k` is held, by where it would go; `None` if nothing.
    fn mistake(&self, problem: &Problem<'_, NS, NU>, k: usize, i: usize) -> Option<Mistake> {
        let hold = self.holds[k][i];
        let (lo, hi) = (problem.bounds[k].lo[i], problem.bounds[k].hi[i]);
        let goal = problem.u[k][i] + self.pull[k][i];
        let (below, above) = ((lo - goal) / (hi - lo), (goal - hi) / (hi - lo));
        let better = match hold {
            Hold::Given => return None,
            _ if below > SLACK => Hold::AtLower,
            _ if above > SLACK => Hold::AtUpper,
            Hold::AtLower if below >= -SLACK => Hold::AtLower,
            Hold::AtUpper if above >= -SLACK => Hold::AtUpper,
            Hold::Free | Hold::AtLower | Hold::AtUpper => Hold::Free,
        };
        let gap = match hold {
            Hold::AtLower => -below,
            Hold::AtUpper => -above,
            Hold::Free | Hold::Given => below.max(above),
        };
        (better != hold).then_some(Mistake { k, i, better, gap })
    }

    /// Corrects mistakes: all of them, or the worst one if `patience` is at its end. The latest step
    /// that was touched comes back, `None` if there was no mistake.
    fn correct(&mut self, problem: &Problem<'_, NS, NU>, patience: &mut Patience) -> Option<usize> {
        let mut count = 0;
        let mut worst: Option<Mistake> = None;
        let mut latest = 0;
        for k in 0..self.holds.len() {
            for i in 0..NU {
                let Some(mistake) = self.mistake(problem, k, i) else { continue };
                count += 1;
                latest = k;
                if worst.as_ref().is_none_or(|worst| mistake.gap > worst.gap) {
                    worst = Some(mistake);
                }
            }
        }
        let worst = worst?;
        if !patience.lasts(count) {
            self.holds[worst.k][worst.i] = worst.better;
            return Some(worst.k);
        }
        for k in 0..=latest {
            for i in 0..NU {
                if let Some(mistake) = self.mistake(problem, k, i) {
                    self.holds[k][i] = mistake.better;
                }
            }
        }
        Some(latest)
    }

    /// Sweeps until the guess is right. The number of sweeps comes back.
    fn search(&mut self, problem: &Problem<'_, NS, NU>) -> Result<u32, Unsolved> {
        self.hold_given(problem);
        let mut patience = Patience { fewest: usize::MAX, left: PATIENCE };
        let mut from = Some(self.holds.len() - 1);
        let mut iterations = 0;
        while let Some(latest) = from {
            if iterations == self.sweeps_max {
                return Err(Unsolved { reason: Reason::SweepLimit, iterations });
            }
            iterations += 1;
            self.sweep_back(problem, latest).map_err(|reason| Unsolved { reason, iterations })?;
            self.sweep_forward(problem);
            from = self.correct(problem, &mut patience);
        }
        let is_finite = self.du.iter().all(|du| du.iter().all(|value| value.is_finite()));
        if is_finite {
            Ok(iterations)
        } else {
            Err(Unsolved { reason: Reason::NotFinite, iterations })
        }
    }
}

impl<const NS: usize, const NU: usize> SolveQp<NS, NU> for Riccati<NS, NU> {
    fn solve(
        &mut self,
        problem: &Problem<'_, NS, NU>,
        du: &mut [SVector<f64, NU>],
    ) -> Result<u32, Unsolved> {
        let searched = self.search(problem);
        match searched {
            Ok(_) => du.copy_from_slice(&self.du),
            Err(_) => self.reset(),
        }
        searched
    }
}

/// An input that is held where it should not be, or not held where it should.
#[derive(Debug)]
struct Mistake {
    k: usize,
    i: usize,
    better: Hold,
    /// How far from its place the input is or would go, as a share of the box.
    gap: f64,
}

/// For how long all wrong guesses are changed at once.
#[derive(Debug)]
struct Patience {
    /// Fewest wrong guesses so far.
    fewest: usize,
    /// Sweeps left without fewer.
    left: u32,
}

impl Patience {
    fn lasts(&mut self, wrong_count: usize) -> bool {
        if wrong_count < self.fewest {
            *self = Self { fewest: wrong_count, left: PATIENCE };
            return true;
        }
        let lasts = self.left > 0;
        self.left = self.left.saturating_sub(1);
        lasts
    }
}
