//! Records of link and dead times in a log.

use horizon_model::rows::stick;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::LinkDecision;
use crate::cycle::DeadTimeChange;

/// Whether the sent sticks of a step act.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub struct LinkRecord {
    step: u64,
    /// Whether the sent sticks do not act.
    pub is_down: bool,
    /// Log likelihood ratio, less the evidence that a change takes: positive exactly while the link is down. 1
    score: f64,
    /// Correction of the dead time of roll and pitch; missing where they stay as configured. s
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dead_time_change_s: Option<f64>,
    /// What is missing from that by the latest motion that shows it; missing before. s
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dead_time_error_s: Option<f64>,
    /// Correction of the dead time of the throttle. s
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub throttle_change_s: Option<f64>,
    /// Correction of the dead time of yaw. s
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub yaw_change_s: Option<f64>,
}

impl LinkRecord {
    /// The record of `decision` and of the corrections of the dead times in step `step`.
    pub(super) fn new(step: u64, decision: &LinkDecision, change: Option<DeadTimeChange>) -> Self {
        let change_s = |axis: usize| change.map(|change| change.change_s[axis]);
        Self {
            step,
            is_down: decision.state.is_down(),
            score: decision.score,
            dead_time_change_s: change_s(stick::PITCH),
            dead_time_error_s: change.and_then(|change| change.error).map(|error| error.mean_s),
            throttle_change_s: change_s(stick::THROTTLE),
            yaw_change_s: change_s(stick::YAW),
        }
    }
}
