//! Where the time of a tick went.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Times of one tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Timing {
    /// Ticks since the start of the log.
    pub step: u64,
    /// From when the tick was due to when it began. ns
    pub late_ns: i64,
    /// From the stage before to the estimate. ns
    pub estimate_ns: i64,
    /// From the stage before to the plan. ns
    pub plan_ns: i64,
    /// From its begin to when its sticks were handed over to the link. ns
    #[serde(default)]
    pub sent_ns: i64,
    /// From the hand-over of the sticks of the tick before to the socket. ns
    #[serde(default, rename = "way_ns")]
    pub socket_latency_ns: i64,
    /// From its begin to its end. ns
    pub tick_ns: i64,
}
