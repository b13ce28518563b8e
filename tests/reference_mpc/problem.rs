//! The problems of the controller that were solved by others: a line of `mpc_problems.jsonl` each.

use horizon_control::InputCost;
use serde::Deserialize;

/// A problem and its least cost; weights and bounds are the same for all.
#[derive(Deserialize)]
pub(crate) struct Problem {
    /// Length of the horizon. steps
    pub(crate) horizon_steps: usize,
    /// Quantity that the input weight multiplies.
    pub(crate) input_cost: InputCost,
    /// Parameter. Rows of `Kinematic`
    pub(crate) p: [f64; 4],
    /// First state, world frame. m, rad
    pub(crate) s0: [f64; 4],
    /// Inputs before the first. 1
    pub(crate) u_prev: [f64; 4],
    /// Reference of all steps, world frame. m, rad
    pub(crate) s_ref: [f64; 4],
    /// Cost of the solution. 1
    pub(crate) cost: f64,
}
