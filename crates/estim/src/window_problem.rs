//! The least-squares problem over a window: its states and the parameter.
//!
//! Owns the current iterate, the candidate, the prior on the parameter (thesis equation 3.43) and its
//! box. The first state is either fixed or free under an arrival cost (`arrival_cost.rs`). The blocks along
//! the window are `residual.rs`, the loop is `levenberg.rs`. When time steps come and go is
//! decided in `mhe.rs`.

use horizon_model::setting::{SettingError, bounds, in_range, vector, weight_or_zero};
use horizon_model::{Bounds, Matrix, Model, Row, Vector};

use crate::arrival_cost::{ArrivalCost, ArrivalSettings};
use crate::chain::{Block, Chain};
use crate::cholesky::NotPositive;
use crate::levenberg::{self, IterateScale, LeastSquares, LmError, LmSettings, SolveReport, Step};
use crate::partition::Partition;
use crate::reduced_system::ReducedSystem;
use crate::residual::{Curvature, Iterate, Observed, Residuals};

/// Prior of the parameter, before any observation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior<const NP: usize> {
    /// Weight of the residual `C_p (p - p_prior)`, 0 or 1e-6..=1e6. Unit: 1 / unit of the row.
    pub c_p: Vector<NP>,
    /// Expected parameter, inside the box. Unit of each row
    pub p_prior: Vector<NP>,
    /// Box of the parameter.
    pub bounds: Bounds<NP>,
}

impl<const NP: usize> Prior<NP> {
    /// The prior of `C_p`, `p_prior`, `p_lb` and `p_ub` for a parameter with these rows.
    ///
    /// # Errors
    /// The first key that breaks its rule; the box must lie in the domains of the rows.
    pub(crate) fn check(
        rows: &[Row; NP],
        c_p: &[f64],
        p_prior: &[f64],
        p_lb: &[f64],
        p_ub: &[f64],
    ) -> Result<Self, SettingError> {
        let (lo, hi) = bounds(("p_lb", p_lb), ("p_ub", p_ub), rows)?;
        let p_prior = vector("p_prior", p_prior, rows, |_, value| Ok(value))?;
        for row in 0..NP {
            in_range(&format!("p_prior[{row}]"), p_prior[row], lo[row]..=hi[row])?;
        }
        let c_p = vector("C_p", c_p, rows, weight_or_zero)?;
        Ok(Self { c_p, p_prior, bounds: Bounds { lo, hi } })
    }

    /// `C_p (p - p_prior)`, thesis equation 3.43.
    fn residual(&self, p: &Vector<NP>) -> Vector<NP> {
        self.c_p.component_mul(&(p - self.p_prior))
    }

    pub(crate) fn cost(&self, p: &Vector<NP>) -> f64 {
        0.5 * self.residual(p).norm_squared()
    }

    /// Adds gradient and curvature at `p`; the Jacobian is `diag(C_p)`, thesis equation 3.75.
    pub(crate) fn add_to(&self, parameter_block: &mut ReducedSystem<NP>, p: &Vector<NP>) {
        parameter_block.gradient += self.c_p.component_mul(&self.residual(p));
        parameter_block.hessian += self.information();
    }

    /// `diag(C_p)^2`.
    pub(crate) fn information(&self) -> Matrix<NP, NP> {
        Matrix::from_diagonal(&self.c_p.component_mul(&self.c_p))
    }
}

/// The problem of thesis equations 3.42-3.45 over one window.
#[derive(Debug, Clone)]
pub struct WindowProblem<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> {
    residuals: Residuals<M, NS, NU, NO, NP>,
    prior: Prior<NP>,
    /// What is known of `s[0]` and, the prior included, of `p`; without it `s[0]` is fixed.
    arrival: Option<ArrivalCost<NS, NP>>,
    parameter_is_held: bool,
    /// `s[0]..=s[n]`, the current iterate.
    s: Vec<Vector<NS>>,
    /// `u[0]..u[n]`.
    u: Vec<Vector<NU>>,
    /// `o[0]..=o[n]`; `o[0]` is missing where it observes a fixed state or is that of the start.
    o: Vec<Observed<NO>>,
    p: Vector<NP>,
    s_candidate: Vec<Vector<NS>>,
    p_candidate: Vector<NP>,
    chain: Chain<NS, NP>,
    /// What the newest elimination left for the parameter.
    reduced: ReducedSystem<NP>,
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>
    WindowProblem<M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP>,
{
    /// A window of the one state `at_rest(0)`, with room for `steps_max` steps: more of them
    /// allocate.
    pub fn new(
        residuals: Residuals<M, NS, NU, NO, NP>,
        prior: Prior<NP>,
        arrival: ArrivalSettings<NS>,
        steps_max: usize,
    ) -> Self {
        let states_max = steps_max + 1;
        let s_0 = residuals.model.at_rest(&Vector::zeros());
        let arrival = match arrival {
            ArrivalSettings::Fixed => None,
            ArrivalSettings::Carried { c_0, forget_s } => {
                Some(ArrivalCost::new(c_0, forget_s, residuals.dt_s, Partition::of::<M, NU, NO>(0)))
            }
        };
        let mut chain = Chain::new(states_max);
        // Reweighted losses scale the rows of an observation without joining them.
        if arrival.is_some() {
            chain = chain.partitioned(Partition::of::<M, NU, NO>(states_max));
        }
        let mut problem = Self {
            residuals,
            prior,
            arrival,
            parameter_is_held: false,
            s: Vec::with_capacity(states_max),
            u: Vec::with_capacity(steps_max),
            o: Vec::with_capacity(states_max),
            p: prior.p_prior,
            s_candidate: Vec::with_capacity(states_max),
            p_candidate: prior.p_prior,
            chain,
            reduced: ReducedSystem::zeros(),
        };
        problem.start(s_0);
        problem
    }

    /// Minimizes from the current iterate by Levenberg-Marquardt; the best iterate found is left.
    ///
    /// Real time: no allocation; `is_late` is polled once per iteration.
    ///
    /// # Errors
    /// A residual or a derivative is not finite at the start, or a derivative where the solve leads.
    pub fn solve(
        &mut self,
        settings: &LmSettings,
        is_late: &mut dyn FnMut() -> bool,
    ) -> Result<SolveReport, LmError> {
        levenberg::solve(self, settings, is_late)
    }

    /// Forgets all steps and what the arrival cost carries, and starts at the state `s_0` with the prior parameter. The
    /// prior and [`WindowProblem::hold_parameter`] stay.
    ///
    /// | name  | shape | unit                                    |
    /// |-------|-------|-----------------------------------------|
    /// | `s_0` | NS    | that of each row of [`Model::STATE`]    |
    ///
    /// Real time: no allocation.
    pub fn start(&mut self, s_0: Vector<NS>) {
        self.s.clear();
        self.u.clear();
        self.o.clear();
        self.s.push(s_0);
        self.o.push(Observed::missing());
        self.p = self.prior.p_prior;
        // Without it the newest covariance would be that of the window before.
        self.reduced = ReducedSystem::zeros();
        if let Some(arrival) = &mut self.arrival {
            arrival.start(&s_0, &self.prior);
        }
    }

    /// Adds a step: `u` was applied, then `observed` was seen. The new state starts where the model leads from the
    /// newest one with the present parameter.
    ///
    /// | name       | shape | unit                                       |
    /// |------------|-------|--------------------------------------------|
    /// | `u`        | NU    | that of each row of [`Model::INPUT`]       |
    /// | `observed` | NO    | that of each row of [`Model::OBSERVATION`] |
    ///
    /// Real time: no allocation while there are at most `steps_max` steps of [`WindowProblem::new`].
    pub fn push(&mut self, u: &Vector<NU>, observed: &Observed<NO>) {
        let s_next = self.residuals.model.step(self.newest(), u, &self.p, self.residuals.dt_s);
        self.s.push(s_next);
        self.u.push(*u);
        self.o.push(*observed);
    }

    /// Drops the oldest step, if there is one. The present `s[1]` becomes the fixed state, whose observation is
    /// forgotten, or the arrival cost takes up the step.
    ///
    /// Real time: no allocation; moves all steps by one place.
    pub fn pop(&mut self) {
        if self.u.is_empty() {
            return;
        }
        if let Some(arrival) = &mut self.arrival {
            let iterate = Iterate { s: &self.s, u: &self.u, o: &self.o, p: &self.p };
            arrival.absorb_oldest_step(
                &self.residuals,
                &iterate,
                &self.prior,
                self.parameter_is_held,
            );
        } else {
            self.o[1] = Observed::missing();
        }
        self.s.remove(0);
        self.u.remove(0);
        self.o.remove(0);
    }

    /// Replaces the input of step `k`, 0 being the oldest, by `u`: NU rows in the units of [`Model::INPUT`]. The states
    /// stay where they are until the next solve.
    ///
    /// Real time: no allocation.
    ///
    /// # Panics
    /// There are `k` steps or fewer.
    pub fn amend(&mut self, k: usize, u: &Vector<NU>) {
        self.u[k] = *u;
    }

    /// Sets the present rows of `observed` in the observation of state `k`, 0 being the oldest: NO rows in the units of
    /// [`Model::OBSERVATION`]. Absent rows of `observed` leave what was known; the states stay where they are.
    ///
    /// Real time: no allocation.
    ///
    /// # Panics
    /// There are `k` states or fewer; the states are one more than the steps.
    pub fn observe(&mut self, k: usize, observed: &Observed<NO>) {
        let known = &mut self.o[k];
        for row in (0..NO).filter(|row| observed.is_present[*row]) {
            known.o[row] = observed.o[row];
            known.is_present[row] = true;
        }
    }

    /// Whether the parameter is held from now on: solutions leave it where it is, and steps that the arrival cost takes
    /// up tell nothing of it. It is not held at first; [`WindowProblem::start`] does not change that.
    ///
    /// Real time: no allocation.
    pub fn hold_parameter(&mut self, is_held: bool) {
        self.parameter_is_held = is_held;
    }

    /// Information of the steps before the window and of the prior on the parameter, the inverse of its covariance in
    /// the units of the weights; `None` without a carried arrival, or if that leaves a state open.
    ///
    /// Real time: no allocation, one factorization.
    pub fn information(&self) -> Option<Matrix<NP, NP>> {
        self.arrival.as_ref()?.information().ok()
    }

    /// Covariance of the newest state by the last curvature that was factorized, with its damping, in the units of the
    /// weights: of the window before where a solve was too late for one. Real time: factorizations of the reduced
    /// Hessian and products, no allocation.
    ///
    /// # Errors
    /// Nothing has been solved, or the window shows nothing of a row of the parameter.
    pub(crate) fn newest_covariance(&self) -> Result<Matrix<NS, NS>, NotPositive> {
        self.chain.last_covariance(&self.reduced)
    }

    /// What weighs on the first state and the parameter, at `(s_0, p)`.
    fn cost_of_past(&self, s_0: &Vector<NS>, p: &Vector<NP>) -> f64 {
        match &self.arrival {
            Some(arrival) => arrival.cost(s_0, p),
            None => self.prior.cost(p),
        }
    }

    /// Changes what is expected of the parameter to `p_prior`: NP rows in the units of [`Model::PARAMETER`], inside the
    /// box, which is not checked. The present parameter stays until the next solve; what an arrival cost has carried
    /// fades to it.
    ///
    /// Real time: no allocation.
    pub(crate) fn set_prior(&mut self, p_prior: Vector<NP>) {
        self.prior.p_prior = p_prior;
    }

    /// The model that the transitions follow.
    pub fn model(&self) -> &M {
        &self.residuals.model
    }

    /// The states, the oldest first: one more than steps, NS rows in the units of [`Model::STATE`].
    pub fn states(&self) -> &[Vector<NS>] {
        &self.s
    }

    /// The parameter, NP rows in the units of [`Model::PARAMETER`].
    pub fn parameter(&self) -> &Vector<NP> {
        &self.p
    }

    /// The newest state, NS rows in the units of [`Model::STATE`].
    pub fn newest(&self) -> &Vector<NS> {
        &self.s[self.u.len()]
    }
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> LeastSquares
    for WindowProblem<M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP>,
{
    const REMAINING_DECREASE_MIN: f64 = 0.0;

    fn linearize(&mut self) -> Result<IterateScale, LmError> {
        self.chain.clear(self.s.len());
        let iterate = Iterate { s: &self.s, u: &self.u, o: &self.o, p: &self.p };
        // Little but its observation determines a free state that has just been added.
        let curvature =
            if self.arrival.is_some() { Curvature::Reweighted } else { Curvature::GaussNewton };
        let cost = self.residuals.accumulate(&iterate, curvature, &mut self.chain)?
            + self.cost_of_past(&self.s[0], &self.p);
        if let Some(arrival) = &self.arrival {
            let (blocks, parameter_block) = self.chain.parts_mut();
            arrival.add_to(&mut blocks[0], parameter_block, &self.s[0], &self.p);
        } else {
            self.prior.add_to(&mut self.chain.parameter_block, &self.p);
            self.chain.pin(0);
        }
        let diagonal_max = self.chain.diagonal_max();
        if diagonal_max.is_finite() {
            Ok(IterateScale { cost, diagonal_max })
        } else {
            let is_broken = |block: &Block<NS, NP>| !block.diagonal.trace().is_finite();
            let k = self.chain.blocks_mut().iter().position(is_broken).unwrap_or(0);
            Err(LmError::NonFinite { block: "derivative", k })
        }
    }

    fn try_step(&mut self, damping: f64) -> Result<Step, NotPositive> {
        // Without a factorization there is no covariance, neither of this solve nor of the one before.
        self.reduced = ReducedSystem::zeros();
        self.reduced = self.chain.eliminate(damping)?;
        let (p_candidate, decrease) = if self.parameter_is_held {
            (self.p, self.reduced.decrease)
        } else {
            self.reduced.solve(damping, &self.p, &self.prior.bounds)?
        };
        let p_step = p_candidate - self.p;
        self.p_candidate = p_candidate;
        let mut step_squared = p_step.norm_squared();
        let mut iterate_squared = self.p.norm_squared();
        self.s_candidate.clear();
        for (s, step) in self.s.iter().zip(self.chain.back_substitute(&p_step)) {
            self.s_candidate.push(s + step);
            step_squared += step.norm_squared();
            iterate_squared += s.norm_squared();
        }
        Ok(Step {
            // The reduced model counts the damping as a cost.
            decrease: decrease + 0.5 * damping * step_squared,
            norm: step_squared.sqrt(),
            iterate_norm: iterate_squared.sqrt(),
        })
    }

    fn candidate_cost(&mut self) -> f64 {
        let iterate =
            Iterate { s: &self.s_candidate, u: &self.u, o: &self.o, p: &self.p_candidate };
        self.residuals.cost(&iterate) + self.cost_of_past(&self.s_candidate[0], &self.p_candidate)
    }

    fn accept(&mut self) {
        std::mem::swap(&mut self.s, &mut self.s_candidate);
        self.p = self.p_candidate;
    }
}

#[cfg(test)]
impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>
    WindowProblem<M, NS, NU, NO, NP>
{
    pub(crate) fn arrival(&self) -> &ArrivalCost<NS, NP> {
        self.arrival.as_ref().unwrap()
    }

    pub(crate) fn iterate(&self) -> Iterate<'_, NS, NU, NO, NP> {
        Iterate { s: &self.s, u: &self.u, o: &self.o, p: &self.p }
    }

    /// The problem whose elimination ignores the subsystems of the model.
    pub(crate) fn undivided(self) -> Self {
        let chain = Chain::new(self.s.len());
        Self { arrival: self.arrival.map(ArrivalCost::undivided), chain, ..self }
    }

    /// Information about the parameter when every state is eliminated, at the last linearization.
    pub(crate) fn information_of_parameter(&mut self) -> Matrix<NP, NP> {
        self.chain.eliminate(0.0).unwrap().hessian
    }
}

#[cfg(test)]
mod tests;
