//! One trajectory as a least-squares problem: states after a fixed first one, and the parameter.
//!
//! Owns the current iterate, the candidate, the prior on the parameter (thesis equation 3.43) and its
//! box. The blocks along the trajectory are `residual.rs`, the loop is `levenberg.rs`. Nothing here
//! knows of time steps that come and go; that is `mhe.rs`.

use nalgebra::{SMatrix, SVector};
use tello_model::setting::{SettingError, bounds, in_range, not_negative, vector};
use tello_model::{Model, Row};

use crate::chain::{Block, Chain};
use crate::cholesky::NotPositive;
use crate::corner::{Bounds, Corner};
use crate::levenberg::{Linearization, Problem, SolveError, Step};
use crate::residual::{Observed, Path, Residuals};

/// What is believed of the parameter before any observation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior<const NP: usize> {
    /// Weight of the residual `C_p (p - p_prior)`, >= 0. Unit: 1 / unit of the row.
    pub c_p: SVector<f64, NP>,
    /// Expected parameter, inside the box.
    pub p_prior: SVector<f64, NP>,
    /// Box of the parameter.
    pub bounds: Bounds<NP>,
}

impl<const NP: usize> Prior<NP> {
    /// The prior of `C_p`, `p_prior`, `p_lb` and `p_ub` for a parameter with these rows.
    ///
    /// # Errors
    /// The first key that breaks its rule.
    pub(crate) fn check(
        rows: &[Row; NP],
        c_p: &[f64],
        p_prior: &[f64],
        (p_lb, p_ub): (&[f64], &[f64]),
    ) -> Result<Self, SettingError> {
        let (lo, hi) = bounds(("p_lb", p_lb), ("p_ub", p_ub), rows)?;
        let p_prior = vector("p_prior", p_prior, rows, |_, value| Ok(value))?;
        for row in 0..NP {
            in_range(&format!("p_prior[{row}]"), p_prior[row], lo[row]..=hi[row])?;
        }
        let c_p = vector("C_p", c_p, rows, not_negative)?;
        Ok(Self { c_p, p_prior, bounds: Bounds { lo, hi } })
    }

    /// `C_p (p - p_prior)`, thesis equation 3.43.
    fn residual(&self, p: &SVector<f64, NP>) -> SVector<f64, NP> {
        self.c_p.component_mul(&(p - self.p_prior))
    }

    pub(crate) fn cost(&self, p: &SVector<f64, NP>) -> f64 {
        0.5 * self.residual(p).norm_squared()
    }

    /// Adds gradient and curvature at `p`; the Jacobian is `diag(C_p)`, thesis equation 3.75.
    pub(crate) fn add_to(&self, corner: &mut Corner<NP>, p: &SVector<f64, NP>) {
        corner.gradient += self.c_p.component_mul(&self.residual(p));
        corner.hessian += SMatrix::from_diagonal(&self.c_p.component_mul(&self.c_p));
    }
}

/// The problem of thesis equations 3.42-3.45 for one trajectory. `s[0]` is fixed.
#[derive(Debug, Clone)]
pub struct Trajectory<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> {
    residuals: Residuals<M, NS, NU, NO, NP>,
    prior: Prior<NP>,
    /// `s[0]..=s[n]`, the current iterate.
    s: Vec<SVector<f64, NS>>,
    /// `u[0]..u[n]`.
    u: Vec<SVector<f64, NU>>,
    /// `o[0]..=o[n]`; `o[0]` observes a fixed state and is missing.
    o: Vec<Observed<NO>>,
    p: SVector<f64, NP>,
    s_candidate: Vec<SVector<f64, NS>>,
    p_candidate: SVector<f64, NP>,
    chain: Chain<NS, NP>,
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>
    Trajectory<M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP>,
{
    /// A trajectory of the one state `at_rest(0)`, with room for `steps_max` steps: more of them
    /// allocate.
    pub fn new(
        residuals: Residuals<M, NS, NU, NO, NP>,
        prior: Prior<NP>,
        steps_max: usize,
    ) -> Self {
        let states_max = steps_max + 1;
        let s_0 = residuals.model.at_rest(&SVector::zeros());
        let mut trajectory = Self {
            residuals,
            prior,
            s: Vec::with_capacity(states_max),
            u: Vec::with_capacity(steps_max),
            o: Vec::with_capacity(states_max),
            p: prior.p_prior,
            s_candidate: Vec::with_capacity(states_max),
            p_candidate: prior.p_prior,
            chain: Chain::new(states_max),
        };
        trajectory.start(s_0);
        trajectory
    }

    /// Forgets everything and starts at the fixed state `s_0` with the prior parameter.
    pub fn start(&mut self, s_0: SVector<f64, NS>) {
        self.s.clear();
        self.u.clear();
        self.o.clear();
        self.s.push(s_0);
        self.o.push(Observed::missing());
        self.p = self.prior.p_prior;
    }

    /// Adds a step: `u` acted, then `observed` was seen. The new state starts where the model leads.
    pub fn push(&mut self, u: &SVector<f64, NU>, observed: &Observed<NO>) {
        let s_next = self.residuals.model.step(self.newest(), u, &self.p, self.residuals.dt_s);
        self.s.push(s_next);
        self.u.push(*u);
        self.o.push(*observed);
    }

    /// Drops the oldest step, if there is one; the present `s[1]` becomes the fixed state.
    pub fn pop(&mut self) {
        if !self.u.is_empty() {
            self.s.remove(0);
            self.u.remove(0);
            self.o.remove(0);
            self.o[0] = Observed::missing();
        }
    }

    /// Changes what is expected of the parameter; `p_prior` lies inside the box.
    pub fn set_prior(&mut self, p_prior: SVector<f64, NP>) {
        self.prior.p_prior = p_prior;
    }

    /// The model.
    pub fn model(&self) -> &M {
        &self.residuals.model
    }

    /// The states, the fixed one first.
    pub fn states(&self) -> &[SVector<f64, NS>] {
        &self.s
    }

    /// The parameter.
    pub fn parameter(&self) -> &SVector<f64, NP> {
        &self.p
    }

    /// The newest state.
    pub fn newest(&self) -> &SVector<f64, NS> {
        &self.s[self.u.len()]
    }
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> Problem
    for Trajectory<M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP>,
{
    fn linearize(&mut self) -> Result<Linearization, SolveError> {
        self.chain.clear(self.s.len());
        let path = Path { s: &self.s, u: &self.u, o: &self.o, p: &self.p };
        let cost = self.residuals.accumulate(&path, &mut self.chain)? + self.prior.cost(&self.p);
        self.prior.add_to(&mut self.chain.corner, &self.p);
        self.chain.pin(0);
        let diagonal_max = self.chain.diagonal_max();
        if diagonal_max.is_finite() {
            Ok(Linearization { cost, diagonal_max })
        } else {
            let is_broken = |block: &Block<NS, NP>| !block.diagonal.trace().is_finite();
            let k = self.chain.blocks_mut().iter().position(is_broken).unwrap_or(0);
            Err(SolveError::NonFinite { block: "derivative", k })
        }
    }

    fn try_step(&mut self, damping: f64) -> Result<Step, NotPositive> {
        let reduced = self.chain.eliminate(damping)?;
        let (p_candidate, decrease) = reduced.solve(damping, &self.p, &self.prior.bounds)?;
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
        let path = Path { s: &self.s_candidate, u: &self.u, o: &self.o, p: &self.p_candidate };
        self.residuals.cost(&path) + self.prior.cost(&self.p_candidate)
    }

    fn accept(&mut self) {
        std::mem::swap(&mut self.s, &mut self.s_candidate);
        self.p = self.p_candidate;
    }
}

#[cfg(test)]
mod tests {
    use tello_model::Kinematic;
    use tello_model::rows::{Pose, Sticks};

    use super::*;
    use crate::loss::Loss;

    /// Five steps that neither the model nor the prior explains.
    fn trajectory() -> Trajectory<Kinematic, 4, 4, 4, 4> {
        let residuals = Residuals {
            model: Kinematic,
            dt_s: 0.02,
            c_o: SVector::from([3.0, 3.0, 2.0, 0.5]),
            c_s: SVector::from([0.4, 0.4, 0.4, 0.2]),
            observation_loss: Loss::Huber { scale: 1.0 },
            transition_loss: Loss::None,
        };
        let p_prior = SVector::from([1.2, 0.5, 0.9, 0.1]);
        let bounds = Bounds { lo: p_prior - Pose::repeat(0.5), hi: p_prior + Pose::repeat(0.5) };
        let prior = Prior { c_p: Pose::repeat(2.0), p_prior, bounds };
        let mut trajectory = Trajectory::new(residuals, prior, 5);
        let s = Pose::new(0.1, 0.2, 1.0, 3.1);
        trajectory.start(s);
        for k in 1..=5 {
            let drift = 0.04 * f64::from(k);
            let observed = Observed::full(s + Pose::new(drift, -drift, 0.1, drift));
            trajectory.push(&Sticks::new(0.5, 0.8, -0.3, 0.2), &observed);
        }
        // Away from the prior, so that it too has a gradient.
        trajectory.p += Pose::new(0.1, -0.1, 0.05, 0.2);
        trajectory
    }

    #[test]
    fn a_short_step_gains_what_the_model_expects() {
        let mut trajectory = trajectory();
        let start = trajectory.linearize().unwrap();
        let step = trajectory.try_step(1e3 * start.diagonal_max).unwrap();
        let gain = start.cost - trajectory.candidate_cost();
        // The damping leaves a thousandth of the way: higher orders are that small.
        assert!((gain / step.decrease - 1.0).abs() < 2e-3, "{gain} instead of {}", step.decrease);
    }

    #[test]
    fn the_first_state_never_moves() {
        let mut trajectory = trajectory();
        let s_0 = trajectory.states()[0];
        trajectory.linearize().unwrap();
        trajectory.try_step(0.0).unwrap();
        trajectory.accept();
        assert_eq!(trajectory.states()[0], s_0);
        assert!((trajectory.newest() - s_0).norm() > 0.01);
    }
}
