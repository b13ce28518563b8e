//! The quadratic subproblem of a plan: which Hessian it gets, and its solution.
//!
//! Owns the choice of the Hessian; who solves the subproblem is `qp.rs`, how far its step is taken `line_search.rs`.

use horizon_model::{DriveHessian, HessianKind, Model};

use super::Mpc;
use super::expansion::{Expansion, Gain};
use super::prepared::Prepared;
use super::report::Ask;
use crate::qp::product::resized;
use crate::qp::{Problem, Solved, Stage, Unsolved};

/// Smallest ratio of the first-order to the second-order predicted decrease of a step with the exact Hessian.
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
        ask: &Ask<'_, NS, NU, NP>,
        kind: Option<HessianKind>,
    ) {
        self.expansion.second_derivatives.clear();
        let Some(kind) = kind else { return };
        let mut s = ask.s_0;
        let mut prepared = Prepared::new(self.model);
        for (k, Stage { by_input, .. }) in self.expansion.stages.iter().enumerate() {
            let at = (s, &self.plan.u[k]);
            let along = (&resized(&self.expansion.costate[k]), kind);
            let (stage_s, by_input) = (self.stage_s[k], resized(by_input));
            let model = prepared.over(ask.p, stage_s);
            let second = model.drive_curvature(at, ask.p, stage_s, &by_input, along);
            let Some(second) = second else { break };
            self.expansion.second_derivatives.push(DriveHessian {
                by_state: resized(&second.by_state),
                by_input_state: resized(&second.by_input_state),
                by_input: second.by_input,
            });
            s = &self.plan.s[k];
        }
    }

    /// Solves the quadratic subproblem for the step. Returns the decrease that the quadratic model predicts, too.
    ///
    /// The Hessian is the exact one; if it is indefinite, the convexified one; if the model has none, that of
    /// Gauss-Newton.
    pub(super) fn find_step(
        &mut self,
        ask: &Ask<'_, NS, NU, NP>,
        is_late: &mut dyn FnMut() -> bool,
    ) -> Result<(Solved, f64), Unsolved> {
        let mut spent = 0;
        let mut kinds = [HessianKind::Exact, HessianKind::Convexified].into_iter();
        loop {
            let kind = kinds.next();
            self.fill_second_derivatives(ask, kind);
            let (u, bounds) = (&self.plan.u, &self.bounds);
            let Expansion { stages, gradient, second_derivatives, penalties, du, .. } =
                &mut self.expansion;
            let problem = Problem { stages, gradient, u, bounds, second_derivatives, penalties };
            let solved = match self.qp.solve(&problem, du, is_late) {
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
