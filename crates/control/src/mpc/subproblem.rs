//! The quadratic subproblem of a plan: choice of its Hessian, and its solution.
//!
//! Owns the choice of the Hessian. The solver of the subproblem is `qp.rs`, the length of its step `line_search.rs`.

use horizon_model::{HessianKind, HessianRequest, InputHessian, Model};

use super::Mpc;
use super::expansion::{Expansion, Gain};
use super::prepared::Prepared;
use super::report::MpcProblem;
use crate::qp::product::resized;
use crate::qp::{Problem, Solved, Stage, Unsolved};

/// Smallest ratio of the first-order to the second-order predicted decrease of a step with the exact Hessian. 1
const DESCENT_MIN: f64 = 0.5;

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize, const NR: usize>
    Mpc<M, NS, NU, NO, NP, NR>
where
    M: Model<NS, NU, NO, NP>,
{
    /// Fills the second derivatives of the dynamics for the Hessian of `kind`.
    ///
    /// With `w_k` the costate of `s_k`, step `k` adds the second derivatives of
    /// `w_{k+1}' f(s_k, u_k, p)`. `None` adds nothing.
    pub(super) fn fill_second_derivatives(
        &mut self,
        problem: &MpcProblem<'_, NS, NU, NP>,
        kind: Option<HessianKind>,
    ) {
        self.expansion.second_derivatives.clear();
        let Some(kind) = kind else { return };
        let mut s = problem.s_0;
        let mut prepared = Prepared::new(self.model);
        for (k, Stage { by_input, .. }) in self.expansion.stages.iter().enumerate() {
            let dt_s = self.stage_s[k];
            let request = HessianRequest {
                s,
                u: &self.plan.u[k],
                p: problem.p,
                dt_s,
                by_input: &resized(by_input),
                w: &resized(&self.expansion.costate[k]),
                kind,
            };
            let second = prepared.over(problem.p, dt_s).hessian_by_input(&request);
            let Some(second) = second else { break };
            self.expansion.second_derivatives.push(InputHessian {
                by_state: resized(&second.by_state),
                by_input_state: resized(&second.by_input_state),
                by_input: second.by_input,
            });
            s = &self.plan.s[k];
        }
    }

    /// Solves the quadratic subproblem for the step. Returns the decrease that the quadratic model predicts as well.
    ///
    /// The Hessian is the exact one; if it is indefinite, the convexified one; if the model has none, that of
    /// Gauss-Newton.
    pub(super) fn find_step(
        &mut self,
        problem: &MpcProblem<'_, NS, NU, NP>,
        is_late: &mut dyn FnMut() -> bool,
    ) -> Result<(Solved, f64), Unsolved> {
        let mut spent = 0;
        let mut kinds = [HessianKind::Exact, HessianKind::Convexified].into_iter();
        loop {
            let kind = kinds.next();
            self.fill_second_derivatives(problem, kind);
            let (u, bounds) = (&self.plan.u, &self.bounds);
            let Expansion { stages, gradient, second_derivatives, penalties, du, .. } =
                &mut self.expansion;
            let subproblem = Problem { stages, gradient, u, bounds, second_derivatives, penalties };
            let solved = match self.qp.solve(&subproblem, du, is_late) {
                Ok(solved) => solved.after(spent),
                Err(unsolved) if unsolved.is_indefinite() => {
                    spent += unsolved.iterations;
                    continue;
                }
                Err(unsolved) => return Err(unsolved.after(spent)),
            };
            let Gain { descent, decrease } =
                self.expansion.complete_step(u, bounds, solved.has_second_derivatives);
            // An active bound may hide a direction of negative curvature: the directional derivative must confirm the
            // decrease.
            let is_steep = descent >= DESCENT_MIN * decrease.abs();
            if is_steep || !solved.has_second_derivatives || kind != Some(HessianKind::Exact) {
                return Ok((solved, decrease));
            }
            spent = solved.iterations;
        }
    }
}
