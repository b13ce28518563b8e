//! Settings of the controller from code: defaults, and one method for each that is set.

use horizon_model::setting::SettingError;
use horizon_model::{Model, Vector};

use super::report::MpcProblem;
use super::settings::{InputCost, MpcSettings, MpcTable, QpKind, SolverTable};

impl Default for SolverTable {
    /// Stage-wise solver, plan optimal to 1e-6 of its cost, at most 50 subproblems of 50 iterations.
    fn default() -> Self {
        Self {
            qp: QpKind::Riccati,
            cost_tolerance: 1e-6,
            iterations_max: 50,
            qp_tolerance: 1e-9,
            qp_iterations_max: 50,
        }
    }
}

impl<'a, const NS: usize, const NU: usize, const NP: usize> MpcProblem<'a, NS, NU, NP> {
    /// A problem without inputs that are sent already. Shapes and units are those of [`MpcProblem`].
    pub fn new(
        s_0: &'a Vector<NS>,
        p: &'a Vector<NP>,
        u_before: &'a Vector<NU>,
        s_ref: &'a [Vector<NS>],
    ) -> Self {
        Self { s_0, p, u_before, s_ref, u_given: &[], given_steps: [0; NU] }
    }
}

/// Builder of [`MpcSettings`], from [`MpcSettings::builder`].
///
/// | setting                      | default                        |
/// |------------------------------|--------------------------------|
/// | [`Self::c_u`]                | 0.1 for each input             |
/// | [`Self::c_s`]                | 1 for each state               |
/// | [`Self::c_s_end`]            | `c_s`                          |
/// | [`Self::bounds`]             | -1 and 1 for each input, whatever its unit |
/// | [`Self::input_cost`]         | [`InputCost::Absolute`]        |
/// | [`Self::stages`]             | every step is a stage          |
/// | [`Self::solver`]             | [`SolverTable::default`]       |
#[derive(Debug, Clone)]
pub struct MpcBuilder<const NS: usize, const NU: usize> {
    table: MpcTable,
    c_s_end: Option<[f64; NS]>,
}

impl<const NS: usize, const NU: usize> MpcSettings<NS, NU> {
    /// Settings for a horizon of this many steps, 1..=500, everything else by default.
    ///
    /// ```
    /// use horizon_control::MpcSettings;
    /// use horizon_model::Kinematic;
    ///
    /// let settings = MpcSettings::builder(25)
    ///     .c_s([10.0, 10.0, 10.0, 5.0])
    ///     .bounds([-0.8; 4], [0.8; 4])
    ///     .build(&Kinematic)?;
    /// assert_eq!(settings.horizon_steps(), 25);
    /// # Ok::<(), horizon_model::setting::SettingError>(())
    /// ```
    pub fn builder(horizon_steps: usize) -> MpcBuilder<NS, NU> {
        let table = MpcTable {
            horizon_steps,
            stages: Vec::new(),
            input_cost: InputCost::Absolute,
            c_u: vec![0.1; NU],
            c_s: vec![1.0; NS],
            c_s_end: Vec::new(),
            u_lb: vec![-1.0; NU],
            u_ub: vec![1.0; NU],
            solver: SolverTable::default(),
        };
        MpcBuilder { table, c_s_end: None }
    }
}

impl<const NS: usize, const NU: usize> MpcBuilder<NS, NU> {
    /// Weight of each input, or of its change. 1/unit, 1e-6..=1e6
    #[must_use]
    pub fn c_u(mut self, c_u: [f64; NU]) -> Self {
        self.table.c_u = c_u.into();
        self
    }

    /// Weight of each state's distance to the reference, all steps but the last. 1/unit, 0 or 1e-6..=1e6
    #[must_use]
    pub fn c_s(mut self, c_s: [f64; NS]) -> Self {
        self.table.c_s = c_s.into();
        self
    }

    /// Weight of each state's distance to the reference after the last step. 1/unit, 0 or 1e-6..=1e6
    #[must_use]
    pub fn c_s_end(mut self, c_s_end: [f64; NS]) -> Self {
        self.c_s_end = Some(c_s_end);
        self
    }

    /// Lower and upper bound of each input, lower <= upper. Unit of the row
    #[must_use]
    pub fn bounds(mut self, u_lb: [f64; NU], u_ub: [f64; NU]) -> Self {
        (self.table.u_lb, self.table.u_ub) = (u_lb.into(), u_ub.into());
        self
    }

    /// What the weights of the input multiply.
    #[must_use]
    pub fn input_cost(mut self, input_cost: InputCost) -> Self {
        self.table.input_cost = input_cost;
        self
    }

    /// Move blocking: pairs of how many stages, and how many steps each of them lasts; the horizon in all. The model is
    /// asked for a step of so many periods at once.
    #[must_use]
    pub fn stages(mut self, stages: &[(usize, u32)]) -> Self {
        self.table.stages = stages.into();
        self
    }

    /// Tolerances and limits of iterations at which the solver stops.
    #[must_use]
    pub fn solver(mut self, solver: SolverTable) -> Self {
        self.table.solver = solver;
        self
    }

    /// The settings, checked against the rows of `model`.
    ///
    /// # Errors
    /// The first value that breaks its rule, by its key in a file.
    pub fn build<M, const NO: usize, const NP: usize>(
        self,
        _model: &M,
    ) -> Result<MpcSettings<NS, NU>, SettingError>
    where
        M: Model<NS, NU, NO, NP>,
    {
        let c_s_end = self.c_s_end.map_or_else(|| self.table.c_s.clone(), Vec::from);
        MpcTable { c_s_end, ..self.table }.check::<M, NS, NU, NO, NP>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use horizon_model::Kinematic;
    use horizon_model::Vector;

    #[test]
    fn what_is_not_set_has_its_default() {
        let settings = MpcSettings::builder(6).c_s([1.0, 2.0, 3.0, 0.0]).build(&Kinematic).unwrap();
        assert_eq!(settings.c_s_end, Vector::from([1.0, 2.0, 3.0, 0.0]));
        assert_eq!(settings.c_u, Vector::from([0.1; 4]));
        assert_eq!((settings.u_lb()[2], settings.u_ub()[2]), (-1.0, 1.0));
        assert_eq!(settings.stage_steps(), [1; 6]);
        assert_eq!(settings.input_cost, InputCost::Absolute);
    }

    #[test]
    fn what_is_set_arrives_and_is_checked() {
        let builder = MpcSettings::builder(6).c_u([0.5; 4]).c_s_end([7.0; 4]);
        let builder = builder.bounds([0.2; 4], [0.2; 4]).stages(&[(2, 1), (1, 4)]);
        let solver = SolverTable { iterations_max: 3, ..SolverTable::default() };
        let builder = builder.input_cost(InputCost::Difference).solver(solver);
        let settings = builder.clone().build(&Kinematic).unwrap();
        assert_eq!(settings.c_u, Vector::from([0.5; 4]));
        assert_eq!(settings.c_s_end, Vector::from([7.0; 4]));
        assert_eq!((*settings.u_lb(), *settings.u_ub()), ([0.2; 4].into(), [0.2; 4].into()));
        assert_eq!(settings.stage_steps(), [1, 1, 4]);
        assert_eq!(settings.input_cost, InputCost::Difference);
        assert_eq!(settings.solver.iterations_max, 3);
        let refusal = builder.bounds([0.3; 4], [0.2; 4]).build(&Kinematic).unwrap_err();
        assert_eq!(refusal.to_string(), "u_lb[0] = 0.3: expected at most u_ub[0] = 0.2");
    }
}
