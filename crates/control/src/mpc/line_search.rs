//! How far a step is taken.
//!
//! Owns the line search on the true cost; where the step comes from is not known here.

use horizon_model::Model;

use super::cost::Against;
use super::report::Ask;
use super::{Mpc, Trial};

/// Constant of the sufficient decrease (Armijo) condition, Nocedal and Wright, Numerical Optimization, 2006, equation
/// 3.4.
const SUFFICIENT_DECREASE: f64 = 1e-4;

/// Halvings of a step before it is given up: what is left then is a millionth of it.
const HALVINGS_MAX: u32 = 20;

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize, const NR: usize>
    Mpc<M, NS, NU, NO, NP, NR>
where
    M: Model<NS, NU, NO, NP>,
{
    /// Backtracking line search: takes the longest of the step, its half, its quarter, .. that satisfies the sufficient
    /// decrease condition on the true cost. Returns the new cost; `None` leaves the plan unchanged.
    ///
    /// `decrease` is the one that the quadratic model predicts for the whole step.
    pub(super) fn search_line(
        &mut self,
        ask: &Ask<'_, NS, NU, NP>,
        against: &Against<'_, NS, NU>,
        (cost, decrease): (f64, f64),
        trial: Trial,
    ) -> Option<f64> {
        let mut step_length = 1.0;
        for _ in 0..=HALVINGS_MAX {
            for k in 0..self.plan.steps() {
                // Between two inputs inside the box; the bounds only catch rounding.
                let u = self.plan.u[k] + self.expansion.du[k] * step_length;
                self.trial.u[k] = self.bounds[k].clamp(&u);
            }
            let lower = self.roll_out(ask, against, trial);
            if lower < cost && cost - lower >= SUFFICIENT_DECREASE * step_length * decrease {
                self.take_trial();
                return Some(lower);
            }
            step_length *= 0.5;
        }
        None
    }
}
