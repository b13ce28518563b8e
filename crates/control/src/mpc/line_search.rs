//! Backtracking line search along a step.
//!
//! Owns the step length by the true cost; the origin of the step is not known here.

use horizon_model::Model;

use super::cost::CostContext;
use super::report::MpcProblem;
use super::{Mpc, RollOut};

/// Constant of the sufficient decrease (Armijo) condition, Nocedal and Wright, Numerical Optimization, 2006, equation
/// 3.4. 1
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
    /// `cost` is the cost of the plan, `decrease` the predicted decrease of the quadratic model by the whole step. 1
    pub(super) fn search_line(
        &mut self,
        problem: &MpcProblem<'_, NS, NU, NP>,
        context: &CostContext<'_, NS, NU>,
        cost: f64,
        decrease: f64,
        results: RollOut,
    ) -> Option<f64> {
        let mut step_length = 1.0;
        for _ in 0..=HALVINGS_MAX {
            for k in 0..self.plan.steps() {
                // Between two inputs inside the box; the bounds only catch rounding.
                let u = self.plan.u[k] + self.expansion.du[k] * step_length;
                self.trial.u[k] = self.bounds[k].clamp(&u);
            }
            let lower = self.roll_out(problem, context, results);
            if lower < cost && cost - lower >= SUFFICIENT_DECREASE * step_length * decrease {
                self.take_trial();
                return Some(lower);
            }
            step_length *= 0.5;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::Vector;
    use horizon_model::rows::{Pose, Sticks, gain, pose, stick};
    use horizon_model::{Bounds, Kinematic};

    use super::*;
    use crate::MpcSettings;

    const STAGES: usize = 3;

    /// A controller that throttle alone moves: its cost is a parabola along every direction.
    struct At {
        mpc: Mpc<Kinematic, 4, 4, 4, 4, 4>,
        p: Vector<{ gain::COUNT }>,
        s_ref: [Pose; STAGES],
    }

    impl At {
        fn new() -> Self {
            let settings = MpcSettings::builder(STAGES).c_s([1.0; 4]).bounds([-1e3; 4], [1e3; 4]);
            let settings = settings.build(&Kinematic).unwrap();
            let mut s_ref = Pose::zeros();
            s_ref[pose::Z] = 0.4;
            Self {
                mpc: Mpc::new(Kinematic, settings, 0.1).unwrap(),
                p: Vector::from([1.3, 0.45, 1.0, 0.0]),
                s_ref: [s_ref; STAGES],
            }
        }

        fn with<T>(
            &mut self,
            act: impl FnOnce(
                &mut Mpc<Kinematic, 4, 4, 4, 4, 4>,
                &MpcProblem<'_, 4, 4, 4>,
                &CostContext<'_, 4, 4>,
            ) -> T,
        ) -> T {
            let Self { mpc, p, s_ref } = self;
            let (s_0, u_before) = (&Pose::zeros(), &Sticks::zeros());
            let problem = MpcProblem::new(s_0, p, u_before, s_ref);
            act(mpc, &problem, &CostContext { u_before, s_ref, constraints: None })
        }

        /// Cost of the plan after `length` of the step with `throttle`.
        fn cost(&mut self, throttle: f64, length: f64) -> f64 {
            self.with(|mpc, problem, context| {
                for (k, u) in mpc.trial.u.iter_mut().enumerate() {
                    *u = mpc.plan.u[k] + length * step(throttle);
                }
                mpc.bounds.fill(wide());
                mpc.roll_out(problem, context, RollOut::States)
            })
        }

        /// The throttle with which the cost is least after `length` of the step.
        fn throttle_for(&mut self, length: f64) -> f64 {
            let [back, here, there] = [-1.0, 0.0, 1.0].map(|length| self.cost(1.0, length));
            0.5 * (back - there) / (there + back - 2.0 * here) / length
        }

        /// The new cost and the length of the step that was taken.
        fn search(&mut self, throttle: f64, decrease: f64) -> Option<(f64, f64)> {
            let cost = self.cost(throttle, 0.0);
            self.with(|mpc, problem, context| {
                mpc.expansion.du.fill(step(throttle));
                let before = mpc.plan.u[0][stick::THROTTLE];
                let lower = mpc.search_line(problem, context, cost, decrease, RollOut::States)?;
                Some((lower, (mpc.plan.u[0][stick::THROTTLE] - before) / throttle))
            })
        }
    }

    fn step(throttle: f64) -> Sticks {
        let mut du = Sticks::zeros();
        du[stick::THROTTLE] = throttle;
        du
    }

    fn wide() -> Bounds<4> {
        Bounds { lo: Sticks::repeat(-1e3), hi: Sticks::repeat(1e3) }
    }

    #[test]
    fn the_longest_part_of_a_step_that_lowers_the_cost_is_taken() {
        // The cost falls up to twice its least: a step with the least at a fifth of it is too long twice over.
        for (least_at, taken) in [(1.0, 1.0), (0.6, 1.0), (0.4, 0.5), (0.2, 0.25)] {
            let mut at = At::new();
            let throttle = at.throttle_for(least_at);
            let expected = at.cost(throttle, taken);
            let (cost, length) = at.search(throttle, 0.0).unwrap();
            assert!(
                (length - taken).abs() < 1e-12,
                "{length} of a step whose least is at {least_at}"
            );
            assert!((cost - expected).abs() < 1e-12, "{cost}, not {expected}");
        }
    }

    #[test]
    fn a_step_must_bring_a_ten_thousandth_of_what_is_predicted() {
        for (excess, taken) in [(-1e-6, 1.0), (1e-6, 0.5)] {
            let mut at = At::new();
            let throttle = at.throttle_for(1.0);
            let gained = at.cost(throttle, 0.0) - at.cost(throttle, 1.0);
            // Half of the step brings three quarters of that, and half is asked for.
            let (_, length) = at.search(throttle, 1e4 * gained * (1.0 + excess)).unwrap();
            assert!((length - taken).abs() < 1e-12, "{length} with an excess of {excess}");
        }
    }

    #[test]
    fn a_step_that_lowers_nothing_leaves_the_plan() {
        let mut at = At::new();
        let uphill = -at.throttle_for(1.0);
        let before = at.mpc.plan.clone();
        assert_eq!(at.search(uphill, 1.0), None);
        assert_eq!(at.mpc.plan, before);
        at.s_ref[1][pose::Z] = f64::NAN;
        assert_eq!(at.search(-uphill, 1.0), None, "a cost that is not a number is not lower");
        assert_eq!(at.mpc.plan, before);
    }
}
