//! Settings of the planning: those of the controller, and what the thesis' baseline adds to them.

use horizon_control::{InputCost, MpcSettings, MpcTable, SolverTable};
use horizon_model::rows::stick;
use horizon_model::setting::SettingError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Vehicle;
use super::baseline::Baseline;
use super::walls::WallTable;

/// Model predictive controller of the vehicle, as written in a file: [`MpcTable`] with the clipping of targets and
/// the correction of the parameter. Weights multiply residuals, they are not squared.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanningTable {
    /// Length of the horizon. steps, 1..=500
    pub horizon_steps: usize,
    /// Stages of the horizon from its beginning, as pairs: how many, and how many steps each of them lasts.
    /// Inputs are constant within a stage. Empty: every step is a stage. `horizon_steps` in all
    #[serde(default)]
    pub stages: Vec<(usize, u32)>,
    /// What `C_u` multiplies.
    pub input_cost: InputCost,
    /// Weight of each effective input, or of its change. 1, 1e-6..=1e6
    #[serde(rename = "C_u")]
    pub c_u: Vec<f64>,
    /// Weight of each state's distance to the reference, all steps but the last. 1/unit, 0 or 1e-6..=1e6
    #[serde(rename = "C_s")]
    pub c_s: Vec<f64>,
    /// Weight of each state's distance to the reference after the last step. 1/unit, 0 or 1e-6..=1e6
    #[serde(rename = "C_s_end")]
    pub c_s_end: Vec<f64>,
    /// Lower bound of each input. 1, <= 0
    pub u_lb: Vec<f64>,
    /// Upper bound of each input, above the lower one. 1, >= 0
    pub u_ub: Vec<f64>,
    /// Distance to which the target is clipped, thesis equation 4.20: the norm over the pose, m and rad alike. > 0
    pub max_target_distance: f64,
    /// Added to the estimated parameters. Unit of each row
    pub p_correction: Vec<f64>,
    /// Walls of the room and obstacles as soft constraints; null or missing, as in older logs: the plan knows none.
    #[serde(default)]
    pub walls: Option<WallTable>,
    /// When the solver stops.
    pub solver: SolverTable,
}

impl PlanningTable {
    /// The settings of the controller alone.
    pub fn mpc(&self) -> MpcTable {
        let Self { horizon_steps, input_cost, .. } = *self;
        MpcTable {
            horizon_steps,
            stages: self.stages.clone(),
            input_cost,
            c_u: self.c_u.clone(),
            c_s: self.c_s.clone(),
            c_s_end: self.c_s_end.clone(),
            u_lb: self.u_lb.clone(),
            u_ub: self.u_ub.clone(),
            solver: self.solver,
        }
    }

    /// The settings, checked against the rows of a model. Inputs can be zero within their bounds: a plan must be
    /// able to let go of the sticks.
    ///
    /// # Errors
    /// The first value that breaks its rule, with its key below this table.
    pub(super) fn check<M: Vehicle<NS, NP>, const NS: usize, const NP: usize>(
        &self,
    ) -> Result<(MpcSettings<NS, { stick::COUNT }>, Baseline<NP>), SettingError> {
        let settings = self.mpc().check::<M, _, _, _, _>()?;
        let (u_lb, u_ub) = (settings.u_lb(), settings.u_ub());
        for i in 0..stick::COUNT {
            if u_lb[i] >= u_ub[i] {
                let rule = format!("below u_ub[{i}] = {}", u_ub[i]);
                return Err(SettingError::new(format!("u_lb[{i}]"), u_lb[i], rule));
            }
            if u_lb[i] > 0.0 {
                return Err(SettingError::new(format!("u_lb[{i}]"), u_lb[i], "at most 0"));
            }
            if u_ub[i] < 0.0 {
                return Err(SettingError::new(format!("u_ub[{i}]"), u_ub[i], "at least 0"));
            }
        }
        Ok((settings, Baseline::new::<M, NS>(self)?))
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::Kinematic;
    use nalgebra::SVector;

    use super::*;

    const GOOD: &str = r#"{
        "horizon_steps": 13, "input_cost": "absolute",
        "C_u": [1.2, 1.2, 0.8, 0.8], "C_s": [1.5, 1.5, 1.0, 0.0], "C_s_end": [15, 15, 10, 0],
        "u_lb": [-0.8, -0.8, -1, -1], "u_ub": [0.8, 0.8, 1, 1],
        "max_target_distance": 0.3, "p_correction": [0, 0, 0, -0.3],
        "solver": { "qp": "riccati", "cost_tolerance": 1e-6, "iterations_max": 20,
                    "qp_tolerance": 1e-8, "qp_iterations_max": 50 }
    }"#;

    fn check(text: &str) -> Result<Baseline<4>, String> {
        let table: PlanningTable = serde_json::from_str(text).map_err(|error| error.to_string())?;
        let checked = table.check::<Kinematic, 4, 4>().map_err(|error| error.to_string())?;
        let mpc = table.mpc().check::<Kinematic, 4, 4, 4, 4>().unwrap();
        assert_eq!(checked.0, mpc);
        Ok(checked.1)
    }

    #[test]
    fn a_good_table_becomes_settings_with_the_same_values() {
        let baseline = check(GOOD).unwrap();
        assert_eq!(baseline.p_correction, SVector::from([0.0, 0.0, 0.0, -0.3]));
        assert!((baseline.max_target_distance - 0.3).abs() < f64::EPSILON);
        let table: PlanningTable = serde_json::from_str(GOOD).unwrap();
        let written = serde_json::to_string(&table).unwrap();
        assert_eq!(serde_json::from_str::<PlanningTable>(&written).unwrap(), table);
    }

    #[test]
    fn each_bad_value_is_refused_with_key_value_and_rule() {
        for (good, bad, refusal) in [
            ("[0.8, 0.8, 1, 1]", "[0.8, 0.8, -1, 1]", "u_lb[2] = -1: expected below u_ub[2] = -1"),
            ("[-0.8, -0.8, -1, -1]", "[-0.8, 0.1, -1, -1]", "u_lb[1] = 0.1: expected at most 0"),
            ("[0.8, 0.8, 1, 1]", "[0.8, 0.8, 1, -0.1]", "u_ub[3] = -0.1: expected at least 0"),
            (
                "distance\": 0.3",
                "distance\": 0",
                "max_target_distance = 0: expected finite and > 0",
            ),
            (
                "\"p_correction\": [0, 0, 0, -0.3]",
                "\"p_correction\": [0]",
                "p_correction = [0.0]: expected 4 entries (lambda_h, lambda_v, lambda_a, theta_0)",
            ),
            (
                "\"horizon_steps\": 13",
                "\"horizon_steps\": 0",
                "horizon_steps = 0: expected 1..=500",
            ),
        ] {
            let text = GOOD.replacen(good, bad, 1);
            assert_ne!(text, GOOD, "{good} is not in the table");
            assert_eq!(check(&text).unwrap_err(), refusal);
        }
        let unknown = GOOD.replacen("\"horizon_steps\"", "\"colour\": 1, \"horizon_steps\"", 1);
        assert!(check(&unknown).unwrap_err().starts_with("unknown field `colour`"));
    }
}
