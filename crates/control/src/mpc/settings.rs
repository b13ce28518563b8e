//! Settings of the controller: as written, and checked. Thesis appendix C.3.

use horizon_model::setting::{SettingError, bounds, in_range, vector, weight, weight_or_zero};
use horizon_model::{Bounds, Model, Vector};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What the input weight multiplies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum InputCost {
    /// The input `u_k`; the published controller does so.
    Absolute,
    /// The change `u_k - u_{k-1}`, thesis equation 3.47.
    Difference,
}

/// Who solves the quadratic subproblems.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum QpKind {
    /// Active-set method with backward Riccati recursions, exact to rounding. An iteration is a recursion;
    /// what takes too many goes to Clarabel.
    Riccati,
    /// The interior point of Clarabel.
    Clarabel,
}

/// Settings of the model predictive controller. Weights multiply residuals, they are not squared.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MpcTable {
    /// Length of the horizon. steps, 1..=500
    pub horizon_steps: usize,
    /// Stages of the horizon from its beginning, as pairs: how many, and how many steps each of them lasts.
    /// Inputs are constant within a stage. Empty: every step is a stage. `horizon_steps` in all
    #[serde(default)]
    pub stages: Vec<(usize, u32)>,
    /// What `C_u` multiplies.
    pub input_cost: InputCost,
    /// Weight of each input, or of its change. 1/unit, 1e-6..=1e6
    #[serde(rename = "C_u")]
    pub c_u: Vec<f64>,
    /// Weight of each state's distance to the reference, all steps but the last. 1/unit, 0 or 1e-6..=1e6
    #[serde(rename = "C_s")]
    pub c_s: Vec<f64>,
    /// Weight of each state's distance to the reference after the last step. 1/unit, 0 or 1e-6..=1e6
    #[serde(rename = "C_s_end")]
    pub c_s_end: Vec<f64>,
    /// Lower bound of each input. Unit of the row
    pub u_lb: Vec<f64>,
    /// Upper bound of each input, at least `u_lb`. Unit of the row
    pub u_ub: Vec<f64>,
    /// When the solver stops.
    pub solver: SolverTable,
}

/// When the solver stops.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SolverTable {
    /// Who solves the quadratic subproblems.
    pub qp: QpKind,
    /// Predicted relative drop of the cost below which the plan is optimal. 1, 1e-15..=0.1
    pub cost_tolerance: f64,
    /// Iterations per solve, each of one quadratic subproblem or, where the exact Hessian is indefinite, of up to
    /// three. 1..=1000
    pub iterations_max: u32,
    /// Gap and feasibility tolerance of Clarabel. 1, 1e-14..=1e-3
    pub qp_tolerance: f64,
    /// Iterations per subproblem, of each solver that gets it. 1..=200
    pub qp_iterations_max: u32,
}

/// Checked form of [`MpcTable`].
#[derive(Debug, Clone, PartialEq)]
pub struct MpcSettings<const NS: usize, const NU: usize> {
    horizon_steps: usize,
    stage_steps: Vec<u32>,
    /// Whether `c_u` weighs the inputs or their changes.
    pub(super) input_cost: InputCost,
    /// Weight of each input, or of its change. 1/unit
    pub(super) c_u: Vector<NU>,
    /// Weight of each state's distance to the reference, all steps but the last. 1/unit
    pub(super) c_s: Vector<NS>,
    /// Weight of each state's distance to the reference after the last step. 1/unit
    pub(super) c_s_end: Vector<NS>,
    u_lb: Vector<NU>,
    u_ub: Vector<NU>,
    /// Soft constraints after each stage, at most; 0 without [`MpcSettings::with_constraints`].
    pub(super) constraints_max: usize,
    pub(super) solver: SolverTable,
}

impl MpcTable {
    /// The settings, checked against the rows of a model.
    ///
    /// # Errors
    /// The first value that breaks its rule, with its key below this table.
    pub fn check<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
        &self,
    ) -> Result<MpcSettings<NS, NU>, SettingError>
    where
        M: Model<NS, NU, NO, NP>,
    {
        let (u_lb, u_ub) = bounds(("u_lb", &self.u_lb), ("u_ub", &self.u_ub), &M::INPUT)?;
        Ok(MpcSettings {
            horizon_steps: in_range("horizon_steps", self.horizon_steps, 1..=500)?,
            stage_steps: self.stage_steps()?,
            input_cost: self.input_cost,
            c_u: vector("C_u", &self.c_u, &M::INPUT, weight)?,
            c_s: vector("C_s", &self.c_s, &M::STATE, weight_or_zero)?,
            c_s_end: vector("C_s_end", &self.c_s_end, &M::STATE, weight_or_zero)?,
            u_lb,
            u_ub,
            constraints_max: 0,
            solver: self.solver.check().map_err(|error| error.under("solver"))?,
        })
    }
}

impl MpcTable {
    /// The steps of each stage.
    fn stage_steps(&self) -> Result<Vec<u32>, SettingError> {
        if self.stages.is_empty() {
            return Ok(vec![1; self.horizon_steps]);
        }
        let lasts = |(count, steps): &(usize, u32)| count.saturating_mul(*steps as usize);
        let total = self.stages.iter().map(lasts).fold(0, usize::saturating_add);
        if total != self.horizon_steps || self.stages.iter().any(|stage| lasts(stage) == 0) {
            let rule = format!(
                "pairs of [stages, steps of each] above 0 that last horizon_steps = {} in all",
                self.horizon_steps
            );
            let shown = self.stages.iter().map(|(count, steps)| format!("[{count}, {steps}]"));
            let shown = shown.collect::<Vec<_>>().join(", ");
            return Err(SettingError::new("stages", format!("[{shown}]"), rule));
        }
        let stages = self.stages.iter().flat_map(|(count, steps)| vec![*steps; *count]);
        Ok(stages.collect())
    }
}

impl SolverTable {
    fn check(&self) -> Result<Self, SettingError> {
        Ok(Self {
            qp: self.qp,
            cost_tolerance: in_range("cost_tolerance", self.cost_tolerance, 1e-15..=0.1)?,
            iterations_max: in_range("iterations_max", self.iterations_max, 1..=1000)?,
            qp_tolerance: in_range("qp_tolerance", self.qp_tolerance, 1e-14..=1e-3)?,
            qp_iterations_max: in_range("qp_iterations_max", self.qp_iterations_max, 1..=200)?,
        })
    }
}

impl<const NS: usize, const NU: usize> MpcSettings<NS, NU> {
    /// Length of the horizon. steps
    pub fn horizon_steps(&self) -> usize {
        self.horizon_steps
    }

    /// How many steps each stage of the horizon lasts.
    pub fn stage_steps(&self) -> &[u32] {
        &self.stage_steps
    }

    /// By stage, the step after its last one.
    fn stage_ends(&self) -> impl Iterator<Item = usize> {
        self.stage_steps.iter().scan(0, |end, steps| {
            *end += *steps as usize;
            Some(*end)
        })
    }

    /// Splits the stage in which `step` lies, 0 being the first of the horizon, so that a stage begins with `step`; the
    /// sum of the steps stays. Nothing changes if a stage begins there, or if `step` lies behind the end.
    ///
    /// Allocates: a split inserts a stage.
    pub fn begin_stage_at(&mut self, step: usize) {
        let Some((k, end)) = self.stage_ends().enumerate().find(|(_, end)| step < *end) else {
            return;
        };
        // At most the steps of this stage.
        let rest = u32::try_from(end - step).unwrap_or(u32::MAX).min(self.stage_steps[k]);
        if rest < self.stage_steps[k] {
            self.stage_steps[k] -= rest;
            self.stage_steps.insert(k + 1, rest);
        }
    }

    /// The stage in which `step` lies, the last one for steps behind the end.
    pub fn stage_of(&self, step: usize) -> usize {
        self.stage_ends().position(|end| step < end).unwrap_or(self.stage_steps.len() - 1)
    }

    /// The step nearest to `step` with which a stage, or what follows the horizon, begins; of two the earlier one.
    pub fn nearest_boundary(&self, step: usize) -> usize {
        let begins = std::iter::once(0).chain(self.stage_ends());
        begins.min_by_key(|begin| begin.abs_diff(step)).unwrap_or(0)
    }

    /// Whether a stage, or what follows the horizon, begins with `step`.
    pub fn is_boundary(&self, step: usize) -> bool {
        step == 0 || self.stage_ends().any(|end| end == step)
    }

    /// Lower bound of each input. Unit of the row
    pub fn u_lb(&self) -> &Vector<NU> {
        &self.u_lb
    }

    /// Upper bound of each input. Unit of the row
    pub fn u_ub(&self) -> &Vector<NU> {
        &self.u_ub
    }

    /// The bounds of the inputs where none is given.
    pub(super) fn bounds(&self) -> Bounds<NU> {
        Bounds { lo: self.u_lb, hi: self.u_ub }
    }

    /// Settings for a controller whose plans may have up to `count` soft constraints after each stage, 0..=1000;
    /// [`Mpc::new`](crate::Mpc::new) refuses more.
    #[must_use]
    pub fn with_constraints(self, count: usize) -> Self {
        Self { constraints_max: count, ..self }
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::Kinematic;
    use horizon_model::Vector;

    use super::*;

    const GOOD: &str = r#"{
        "horizon_steps": 13, "input_cost": "absolute",
        "C_u": [1.2, 1.2, 0.8, 0.8], "C_s": [1.5, 1.5, 1.0, 0.0], "C_s_end": [15, 15, 10, 0],
        "u_lb": [-0.8, -0.8, -1, -1], "u_ub": [0.8, 0.8, 1, 1],
        "solver": { "qp": "riccati", "cost_tolerance": 1e-6, "iterations_max": 20,
                    "qp_tolerance": 1e-8, "qp_iterations_max": 50 }
    }"#;

    fn check(text: &str) -> Result<MpcSettings<4, 4>, String> {
        let table: MpcTable = serde_json::from_str(text).map_err(|error| error.to_string())?;
        table.check::<Kinematic, 4, 4, 4, 4>().map_err(|error| error.to_string())
    }

    #[test]
    fn a_good_table_becomes_settings_with_the_same_values() {
        let settings = check(GOOD).unwrap();
        assert_eq!(settings.horizon_steps(), 13);
        assert_eq!(settings.input_cost, InputCost::Absolute);
        assert_eq!(settings.c_u, Vector::from([1.2, 1.2, 0.8, 0.8]));
        assert_eq!(settings.c_s, Vector::from([1.5, 1.5, 1.0, 0.0]));
        assert_eq!(settings.c_s_end, Vector::from([15.0, 15.0, 10.0, 0.0]));
        assert_eq!(*settings.u_lb(), Vector::from([-0.8, -0.8, -1.0, -1.0]));
        assert_eq!(*settings.u_ub(), Vector::from([0.8, 0.8, 1.0, 1.0]));
        assert_eq!(settings.solver.qp, QpKind::Riccati);
        assert_eq!(settings.solver.iterations_max, 20);
        assert_eq!(settings.solver.qp_iterations_max, 50);
        let table: MpcTable = serde_json::from_str(GOOD).unwrap();
        let written = serde_json::to_string(&table).unwrap();
        assert_eq!(serde_json::from_str::<MpcTable>(&written).unwrap(), table);
    }

    #[test]
    fn stages_fill_the_horizon_and_can_be_split() {
        let with =
            |stages: &str| check(&GOOD.replacen("13,", &format!("13, \"stages\": {stages},"), 1));
        assert_eq!(check(GOOD).unwrap().stage_steps(), [1; 13]);
        let mut settings = with("[[2, 1], [1, 3], [2, 4]]").unwrap();
        assert_eq!(settings.stage_steps(), [1, 1, 3, 4, 4]);
        let stages = [0, 1, 2, 4, 5, 12, 13, 99].map(|step| settings.stage_of(step));
        assert_eq!(stages, [0, 1, 2, 2, 3, 4, 4, 4]);
        let boundaries: Vec<_> = (0..20).filter(|step| settings.is_boundary(*step)).collect();
        assert_eq!(boundaries, [0, 1, 2, 5, 9, 13]);
        for step in [0, 2, 6, 13, 20] {
            settings.begin_stage_at(step);
        }
        assert_eq!(settings.stage_steps(), [1, 1, 3, 1, 3, 4]);
        for stages in ["[[13, 2]]", "[[1, 12]]", "[[13, 1], [0, 3]]"] {
            let refusal = with(stages).unwrap_err();
            let expected = format!(
                "stages = {stages}: expected pairs of [stages, steps of each] above 0 that last \
                 horizon_steps = 13 in all"
            );
            assert_eq!(refusal, expected);
        }
    }

    #[test]
    fn each_bad_value_is_refused_with_key_value_and_rule() {
        for (good, bad, refusal) in [
            (
                "\"horizon_steps\": 13",
                "\"horizon_steps\": 0",
                "horizon_steps = 0: expected 1..=500",
            ),
            ("\"C_u\": [1.2", "\"C_u\": [0.0", "C_u[0] = 0: expected 1e-6..=1e6"),
            ("\"C_s\": [1.5", "\"C_s\": [-1.5", "C_s[0] = -1.5: expected 0 or 1e-6..=1e6"),
            ("[15, 15, 10, 0]", "[15, 15, -1, 0]", "C_s_end[2] = -1: expected 0 or 1e-6..=1e6"),
            ("[15, 15, 10, 0]", "[15]", "C_s_end = [15.0]: expected 4 entries (x, y, z, theta)"),
            (
                "[0.8, 0.8, 1, 1]",
                "[0.8, -0.9, 1, 1]",
                "u_lb[1] = -0.8: expected at most u_ub[1] = -0.9",
            ),
            ("1e-6", "0.2", "solver.cost_tolerance = 0.2: expected 1e-15..=0.1"),
            (
                "\"iterations_max\": 20",
                "\"iterations_max\": 0",
                "solver.iterations_max = 0: expected 1..=1000",
            ),
            ("1e-8", "0.5", "solver.qp_tolerance = 0.5: expected 1e-14..=0.001"),
            ("50 }", "500 }", "solver.qp_iterations_max = 500: expected 1..=200"),
        ] {
            let text = GOOD.replacen(good, bad, 1);
            assert_ne!(text, GOOD, "{good} is not in the table");
            assert_eq!(check(&text).unwrap_err(), refusal);
        }
    }

    #[test]
    fn unknown_and_missing_keys_are_refused() {
        let unknown = GOOD.replacen("\"horizon_steps\"", "\"colour\": 1, \"horizon_steps\"", 1);
        assert!(check(&unknown).unwrap_err().starts_with("unknown field `colour`"));
        let missing = GOOD.replacen("\"horizon_steps\": 13,", "", 1);
        assert!(check(&missing).unwrap_err().starts_with("missing field `horizon_steps`"));
    }
}
