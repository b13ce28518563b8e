//! Model predictive control: the inputs over the horizon with the least cost, thesis section 3.1.5.
//!
//! Owns the nonlinear problem and its solution by sequential quadratic programming with single shooting: the states are
//! the roll-out of the inputs, so every iterate satisfies the dynamics. Each step is accepted on the true cost. The
//! origin of the reference and the use of the plan are not known here.

mod builder;
mod cost;
mod expansion;
mod line_search;
mod prepared;
mod report;
mod settings;
mod soft;
mod subproblem;

use std::fmt::Display;

use horizon_model::setting::{SettingError, in_range, positive};
use horizon_model::{Bounds, Model, Vector};

pub use self::builder::MpcBuilder;
use self::cost::{Cost, CostContext};
use self::expansion::Expansion;
use self::prepared::Prepared;
use self::report::all_finite_of;
pub use self::report::{MpcProblem, MpcReport, SqpError, SqpStop};
pub use self::settings::{InputCost, MpcSettings, MpcTable, QpKind, SolverTable};
use crate::SoftConstraints;
use crate::horizon::Horizon;
use crate::qp::product::resized;
use crate::qp::{Limits, Qp, Stage};

/// Controller of one model, with the plan that it improves from solve to solve.
///
/// `NR` is the model's [`Model::CONTROLLABLE`]: subproblems have as many rows of state.
#[derive(Debug)]
pub struct Mpc<
    M,
    const NS: usize,
    const NU: usize,
    const NO: usize,
    const NP: usize,
    const NR: usize,
> {
    model: M,
    settings: MpcSettings<NS, NU>,
    /// By stage, how long it lasts. s
    stage_s: Vec<f64>,
    cost: Cost<NS, NU>,
    qp: Qp<NR, NU>,
    plan: Horizon<NS, NU>,
    /// Plan under trial.
    trial: Horizon<NS, NU>,
    /// Linear dynamics along it, as those of the expansion are along the plan.
    trial_stages: Vec<Stage<NR, NU>>,
    expansion: Expansion<NR, NU>,
    /// Bounds of the inputs in the latest problem, by stage. Unit of the row
    bounds: Vec<Bounds<NU>>,
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize, const NR: usize>
    Mpc<M, NS, NU, NO, NP, NR>
where
    M: Model<NS, NU, NO, NP>,
{
    /// A controller of the period `dt_s` (s) with the plan of [`Mpc::reset`]. All of our allocation happens here.
    ///
    /// # Errors
    /// `dt_s` is not positive, there are more than 1000 places for constraints, or the quadratic solver refuses the
    /// horizon.
    pub fn new(model: M, settings: MpcSettings<NS, NU>, dt_s: f64) -> Result<Self, SettingError> {
        const { assert!(NR == M::CONTROLLABLE && NR <= NS, "NR is not Model::CONTROLLABLE") };
        let dt_s = positive("dt_s", dt_s)?;
        let stage_s = settings.stage_steps().iter().map(|steps| dt_s * f64::from(*steps)).collect();
        let stages = settings.stage_steps().len();
        let cost = Cost::new(&settings);
        let limits = Limits {
            tolerance: settings.solver.qp_tolerance,
            iterations_max: settings.solver.qp_iterations_max,
            penalties_max: in_range("constraints_max", settings.constraints_max, 0..=1000)?,
        };
        let is_stage_wise = settings.solver.qp == QpKind::Riccati;
        let curvature = cost.curvature();
        let qp = Qp::new(&curvature, limits, is_stage_wise)
            .map_err(|error| refusal(&settings, &error))?;
        let bounds = settings.bounds();
        let mut mpc = Self {
            model,
            settings,
            stage_s,
            cost,
            qp,
            plan: Horizon::zeros(stages),
            trial: Horizon::zeros(stages),
            trial_stages: vec![Stage::zeros(); stages],
            expansion: Expansion::new(curvature, limits.penalties_max),
            bounds: vec![bounds; stages],
        };
        mpc.reset();
        Ok(mpc)
    }

    /// Improves the present plan until it is optimal for `problem`, or until a limit.
    ///
    /// Thesis equations 3.46-3.49, one half of the weighted squares:
    ///
    /// ```text
    /// minimize    sum   1/2 |C_u Delta u_k|^2 +  sum   1/2 |C_s (s_k - s_ref_k)|^2
    ///            k < N                    0<k<N
    ///                                    + 1/2 |C_s_end (s_N - s_ref_N)|^2
    /// subject to  s_{k+1} = f(s_k, u_k, p),  u_lb <= u_k <= u_ub where it is not given
    /// ```
    ///
    /// with the input or its change `Delta u_k` ([`InputCost`]), over the stages `k` of the horizon. A stage of several
    /// steps has the weight of its steps together (`docs/model.md`, section 5).
    ///
    /// First the plan takes over the inputs that `problem` gives; their cost counts. `is_late` is called once per
    /// iteration, before its first quadratic subproblem, and again before Clarabel gets a subproblem that the
    /// stage-wise solver did not solve; `true` ends the solve. Inputs that are not given stay within the bounds, and
    /// the cost of the plan never increases; read the plan with [`Mpc::plan`].
    ///
    /// # Errors
    /// The plan stays as it was. [`SqpError::NotFinite`], [`SqpError::Horizon`], [`SqpError::Given`] and
    /// [`SqpError::Inside`]: `problem` does not fit the horizon, a mistake of the caller. [`SqpError::Cost`] and
    /// [`SqpError::Derivative`]: the roll-out of the present plan, or the model along it, is not finite;
    /// [`Mpc::reset`] it.
    ///
    /// Real time: no allocation of ours, one in Clarabel's timers per subproblem that it gets. Each
    /// subproblem is linear in the horizon.
    pub fn solve(
        &mut self,
        problem: &MpcProblem<'_, NS, NU, NP>,
        is_late: &mut dyn FnMut() -> bool,
    ) -> Result<MpcReport, SqpError> {
        self.solve_with(problem, None, is_late)
    }

    /// [`Mpc::solve`] with `constraints` on the states after each stage, whose penalties add to the cost.
    ///
    /// # Errors
    /// As [`Mpc::solve`], more constraints than [`MpcSettings::with_constraints`], and [`SqpError::Constraint`]: a
    /// constraint along the present plan is not finite, or its weight is negative.
    ///
    /// Real time: as [`Mpc::solve`]; linear in the constraints that count.
    pub fn solve_with(
        &mut self,
        problem: &MpcProblem<'_, NS, NU, NP>,
        constraints: Option<&dyn SoftConstraints<NS>>,
        is_late: &mut dyn FnMut() -> bool,
    ) -> Result<MpcReport, SqpError> {
        problem.check(&self.settings)?;
        self.check_constraints(constraints)?;
        let context = CostContext { u_before: problem.u_before, s_ref: problem.s_ref, constraints };
        self.apply_committed_inputs(problem);
        let cost_start = self.roll_out(problem, &context, RollOut::StatesAndDynamics);
        if !cost_start.is_finite() {
            self.check_excesses(&self.trial, &context)?;
            return Err(SqpError::Cost { cost: cost_start });
        }
        self.take_trial();
        let improved = self.improve(problem, &context, cost_start, is_late);
        if improved.is_err() {
            // No step was taken: the trial is still the previous plan.
            self.take_trial();
        }
        improved
    }

    /// Improves the plan, which costs `cost_start`, until it is optimal, or until a limit.
    ///
    /// # Errors
    /// A derivative or a constraint along the first plan is not finite.
    fn improve(
        &mut self,
        problem: &MpcProblem<'_, NS, NU, NP>,
        context: &CostContext<'_, NS, NU>,
        cost_start: f64,
        is_late: &mut dyn FnMut() -> bool,
    ) -> Result<MpcReport, SqpError> {
        let solver = self.settings.solver;
        let (mut cost, mut iterations) = (cost_start, 0);
        let (mut qp_iterations, mut qp_fallbacks) = (0, 0);
        let stop = loop {
            if iterations == solver.iterations_max {
                break SqpStop::IterationLimit;
            }
            if is_late() {
                break SqpStop::Late;
            }
            if let Err(error) = self.fill_gradients(context) {
                break if iterations == 0 { return Err(error) } else { SqpStop::QpUnsolved };
            }
            if self.gain_max() <= solver.cost_tolerance * cost {
                break SqpStop::CostTolerance;
            }
            let (solved, decrease) = match self.find_step(problem, is_late) {
                Ok(found) => found,
                Err(unsolved) => {
                    qp_iterations += unsolved.iterations;
                    if iterations == 0 {
                        self.check_derivatives()?;
                    }
                    break if unsolved.is_late() { SqpStop::Late } else { SqpStop::QpUnsolved };
                }
            };
            qp_iterations += solved.iterations;
            qp_fallbacks += u32::from(solved.has_fallen_back);
            // Judged by the predicted decrease: near the optimum a step may gain much although little is predicted.
            let is_optimal = decrease <= solver.cost_tolerance * cost;
            let is_last = iterations + 1 == solver.iterations_max;
            let roll_out = if is_last { RollOut::States } else { RollOut::StatesAndDynamics };
            let Some(lower) = self.search_line(problem, context, cost, decrease, roll_out) else {
                let rounding = self.cost.rounding(cost, &self.plan, context.s_ref);
                let is_optimal_to_rounding = is_optimal || decrease <= rounding;
                break if is_optimal_to_rounding {
                    SqpStop::CostTolerance
                } else {
                    SqpStop::Stalled
                };
            };
            cost = lower;
            iterations += 1;
            if is_optimal {
                break SqpStop::CostTolerance;
            }
        };
        Ok(MpcReport { stop, iterations, qp_iterations, qp_fallbacks, cost_start, cost })
    }

    /// Moves the plan on by one step, as the start for the next solve: drops the first step of `u_0` and goes
    /// on with `u_{N-1}`. The inputs of a stage of several steps are mixed with those of the next one.
    ///
    /// Real time: no allocation, cost linear in the number of stages.
    pub fn shift(&mut self) {
        let stages = self.settings.stage_steps();
        let Horizon { u, s } = &mut self.plan;
        for (k, steps) in stages.iter().enumerate().take(stages.len() - 1) {
            let fraction = 1.0 / f64::from(*steps);
            u[k] = u[k] * (1.0 - fraction) + u[k + 1] * fraction;
            s[k] = s[k] * (1.0 - fraction) + s[k + 1] * fraction;
        }
        self.qp.shift(|k| stages[k] == 1);
    }

    /// Forgets the plan: each input is zero, or the bound nearest to zero.
    ///
    /// Real time: no allocation, cost linear in the number of stages.
    pub fn reset(&mut self) {
        self.plan.u.fill(self.settings.bounds().clamp(&Vector::zeros()));
        self.plan.s.fill(Vector::zeros());
        self.qp.reset();
    }

    /// Replaces the plan that the next solve improves, for a problem with several minima: `u` has one input for each
    /// stage, in the unit of each row, and is moved into the bounds.
    ///
    /// # Errors
    /// The plan stays as it was. [`SqpError::Plan`]: not one input for each stage; [`SqpError::NotFinite`].
    ///
    /// Real time: no allocation, cost linear in the number of stages.
    pub fn set_plan(&mut self, u: &[Vector<NU>]) -> Result<(), SqpError> {
        let stages = self.plan.steps();
        if u.len() != stages {
            return Err(SqpError::Plan { given: u.len(), stages });
        }
        all_finite_of("u", u)?;
        self.reset();
        let bounds = self.settings.bounds();
        for (plan, u) in self.plan.u.iter_mut().zip(u) {
            *plan = bounds.clamp(u);
        }
        Ok(())
    }

    /// The present plan `u_0 .. u_{N-1}`, one for each stage, each within the bounds where it was not given.
    pub fn plan(&self) -> &[Vector<NU>] {
        &self.plan.u
    }

    /// States `s_1 .. s_N` that follow from the plan by the latest problem, N stages, in the units of [`Model::STATE`];
    /// interpolated after a shift, zeros before the first problem and after a reset.
    pub fn planned_states(&self) -> &[Vector<NS>] {
        &self.plan.s
    }

    /// Settings of this controller.
    pub fn settings(&self) -> &MpcSettings<NS, NU> {
        &self.settings
    }

    /// Sets the bounds of this problem, equal ones for given inputs, and the trial to the plan clipped to them.
    fn apply_committed_inputs(&mut self, problem: &MpcProblem<'_, NS, NU, NP>) {
        let mut begin = 0;
        for (k, steps) in self.settings.stage_steps().iter().enumerate() {
            let end = begin + *steps as usize;
            let bounds = &mut self.bounds[k];
            *bounds = self.settings.bounds();
            for i in (0..NU).filter(|i| end <= problem.given_steps[*i]) {
                let sum: f64 = problem.u_given[begin..end].iter().map(|u_given| u_given[i]).sum();
                let mean = sum / f64::from(*steps);
                (bounds.lo[i], bounds.hi[i]) = (mean, mean);
            }
            self.trial.u[k] = bounds.clamp(&self.plan.u[k]);
            begin = end;
        }
    }

    /// Exchanges trial and plan: the trial becomes the plan.
    fn take_trial(&mut self) {
        std::mem::swap(&mut self.plan, &mut self.trial);
        std::mem::swap(&mut self.expansion.stages, &mut self.trial_stages);
    }

    /// Fills the states of the trial from its inputs, and with [`RollOut::StatesAndDynamics`] the linear
    /// dynamics. Returns the cost of the trial.
    fn roll_out(
        &mut self,
        problem: &MpcProblem<'_, NS, NU, NP>,
        context: &CostContext<'_, NS, NU>,
        results: RollOut,
    ) -> f64 {
        let mut s = *problem.s_0;
        let mut prepared = Prepared::new(self.model);
        let stages = self.trial_stages.iter_mut().zip(&self.stage_s);
        let steps = self.trial.u.iter().zip(&mut self.trial.s);
        for ((u, s_next), (stage, stage_s)) in steps.zip(stages) {
            let model = prepared.over(problem.p, *stage_s);
            s = match results {
                RollOut::States => model.step(&s, u, problem.p, *stage_s),
                RollOut::StatesAndDynamics => {
                    let linearized = model.linearize_by_input(&s, u, problem.p, *stage_s);
                    let by_state = resized(&linearized.by_state);
                    *stage = Stage { by_state, by_input: resized(&linearized.by_input) };
                    linearized.s_next
                }
            };
            *s_next = s;
        }
        self.cost.value(&self.trial, context) + self.penalty(context)
    }

    /// Fills gradient, costates and reduced gradient of the cost along the plan.
    ///
    /// # Errors
    /// A constraint is not finite, or its weight is negative.
    fn fill_gradients(&mut self, context: &CostContext<'_, NS, NU>) -> Result<(), SqpError> {
        self.cost.gradient(&self.plan, context, &mut self.expansion.gradient);
        self.fill_penalties(context)?;
        self.expansion.fill_gradients();
        Ok(())
    }

    /// Checks that the linear dynamics along the plan are finite.
    ///
    /// # Errors
    /// [`SqpError::Derivative`] with the first stage where they are not.
    fn check_derivatives(&self) -> Result<(), SqpError> {
        let is_finite = |Stage { by_state, by_input }: &Stage<NR, NU>| {
            by_state.iter().chain(by_input).all(|entry| entry.is_finite())
        };
        match self.expansion.stages.iter().position(|stage| !is_finite(stage)) {
            None => Ok(()),
            Some(stage) => Err(SqpError::Derivative { stage }),
        }
    }

    /// Upper bound of the decrease that is still possible, see [`Cost::gain_max`].
    fn gain_max(&self) -> f64 {
        let gradients = self.expansion.reduced_gradient.iter().zip(&self.plan.u).zip(&self.bounds);
        self.cost.gain_max(
            gradients.map(|((gradient, u), bounds)| bounds.projected_gradient(gradient, u)),
        )
    }
}

/// Why the quadratic solver refuses a horizon.
fn refusal<const NS: usize, const NU: usize>(
    settings: &MpcSettings<NS, NU>,
    error: &impl Display,
) -> SettingError {
    SettingError::new("horizon_steps", settings.horizon_steps(), error.to_string())
}

/// Results of a roll-out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum RollOut {
    /// States.
    States,
    /// States and linear dynamics, which cost little more together: most trials become the plan, whose derivatives are
    /// then available.
    StatesAndDynamics,
}

#[cfg(test)]
mod tests;
