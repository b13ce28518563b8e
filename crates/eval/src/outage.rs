//! Lost commands, found afterwards from the motion.
//!
//! Owns the decision, for every step of a recorded flight, whether the vehicle followed its sticks or
//! flew as if they were released. Only the horizontal motion is asked: it answers slowest and is driven
//! hardest. Both sides of a moment are known here; the decision in flight, from the past alone, is
//! `flight/link.rs`.

use horizon_model::rows::{Pose, Sticks, pose};
use horizon_model::setting::{SettingError, finite, in_range, positive};
use nalgebra::Vector2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use tello_flight::commanded_w_mps;

use crate::smooth::MotionTrack;

/// How lost commands are recognized, as written in a file.
///
/// The response is a typical vehicle's, not the one being identified: the choice of the samples must
/// not depend on the fit to them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OutageTable {
    /// Horizontal velocity per stick excess over the dead zone. m/s, > 0
    pub lambda_h_mps: f64,
    /// Direction of flight minus measured yaw. rad
    pub theta_0_rad: f64,
    /// Lag of the horizontal velocity. s, > 0
    pub tau_h_s: f64,
    /// Largest horizontal acceleration; `None`, as in older settings, is no limit. m/s^2, > 0
    #[serde(default)]
    pub a_max_mps2: Option<f64>,
    /// Dead zone of roll and pitch. 1 (stick), in 0..=0.5
    pub dead_h: f64,
    /// Standard deviation of the commanded velocity that the motion implies. m/s, > 0
    pub sd_mps: f64,
    /// Time over which its errors are alike: so much motion is one piece of evidence. s, > 0
    pub correlation_s: f64,
    /// Evidence from which on an outage counts. Negative log likelihood. 1, > 0
    #[serde(alias = "loss_cost")]
    pub outage_cost: f64,
    /// Evidence for the end of an outage. Negative log likelihood. 1, > 0
    pub return_cost: f64,
}

/// Checked [`OutageTable`].
#[derive(Debug, Clone, PartialEq)]
pub struct OutageSettings(OutageTable);

impl TryFrom<&OutageTable> for OutageSettings {
    type Error = SettingError;

    fn try_from(table: &OutageTable) -> Result<Self, SettingError> {
        positive("lambda_h_mps", table.lambda_h_mps)?;
        finite("theta_0_rad", table.theta_0_rad)?;
        positive("tau_h_s", table.tau_h_s)?;
        table.a_max_mps2.map(|a_max| positive("a_max_mps2", a_max)).transpose()?;
        in_range("dead_h", table.dead_h, 0.0..=0.5)?;
        positive("sd_mps", table.sd_mps)?;
        positive("correlation_s", table.correlation_s)?;
        positive("outage_cost", table.outage_cost)?;
        positive("return_cost", table.return_cost)?;
        Ok(Self(table.clone()))
    }
}

/// Squared error beyond which a step counts no more, in variances: what the smoother did not catch. 1
const ERROR_MAX: f64 = 100.0;

/// Whether the commands applied in each step of a flight were lost.
///
/// The motion implies a commanded velocity `v + tau dv/dt`. It is compared with the one of the applied
/// sticks `u_applied` and with zero, both no further from v than `tau a_max`: a vehicle at its limit of acceleration
/// shows the direction of its command alone. Dynamic programming finds the sequence of "link up" and "link down"
/// of least cost, half the squared error over variance and correlation time plus the cost of every
/// change. An outage with sticks near the dead zone cannot be seen.
///
/// `u_applied` (1) and `track`, world frame, have equal lengths, one entry per period of `dt_s` > 0 (s). Linear
/// in them.
pub fn lost_commands(
    settings: &OutageSettings,
    u_applied: &[Sticks],
    track: &MotionTrack,
    dt_s: f64,
) -> Vec<bool> {
    let OutageSettings(table) = settings;
    let scale = 0.5 * dt_s / table.correlation_s;
    let cost_of = |error_w_mps: Vector2<f64>| {
        scale * (error_w_mps.norm_squared() / table.sd_mps.powi(2)).min(ERROR_MAX)
    };
    let (mut up, mut down) = (0.0_f64, table.outage_cost);
    // Whether the best sequence that is up (down) in a step was down in the step before.
    let mut was_down = Vec::with_capacity(u_applied.len());
    for (k, u) in u_applied.iter().enumerate() {
        let implied_w_mps = implied_command(table, track, k);
        let shown_w_mps = |command_w_mps| shown_command(table, track, k, command_w_mps);
        let (lost, returned) = (up + table.outage_cost, down + table.return_cost);
        was_down.push([returned < up, down <= lost]);
        up = up.min(returned)
            + cost_of(implied_w_mps - shown_w_mps(command(table, u, track.pose[k][pose::THETA])));
        down = down.min(lost) + cost_of(implied_w_mps - shown_w_mps(Vector2::zeros()));
    }
    let mut is_down = down < up;
    let mut is_lost: Vec<bool> = was_down
        .iter()
        .rev()
        .map(|was_down| {
            let now = is_down;
            is_down = was_down[usize::from(now)];
            now
        })
        .collect();
    is_lost.reverse();
    is_lost
}

/// `v + tau dv/dt`, world frame. m/s
fn implied_command(table: &OutageTable, track: &MotionTrack, k: usize) -> Vector2<f64> {
    horizontal(&(track.velocity[k] + table.tau_h_s * track.acceleration[k]))
}

/// What the motion implies of a vehicle that follows `command_w_mps` (m/s) as fast as its acceleration allows. m/s
fn shown_command(
    table: &OutageTable,
    track: &MotionTrack,
    k: usize,
    command_w_mps: Vector2<f64>,
) -> Vector2<f64> {
    let Some(a_max_mps2) = table.a_max_mps2 else { return command_w_mps };
    let v_w_mps = horizontal(&track.velocity[k]);
    v_w_mps + (command_w_mps - v_w_mps).cap_magnitude(table.tau_h_s * a_max_mps2)
}

fn horizontal(rate: &Pose) -> Vector2<f64> {
    Vector2::new(rate[pose::X], rate[pose::Y])
}

fn command(table: &OutageTable, u: &Sticks, theta_rad: f64) -> Vector2<f64> {
    commanded_w_mps(u, theta_rad + table.theta_0_rad, table.lambda_h_mps, table.dead_h)
}

#[cfg(test)]
mod tests;
