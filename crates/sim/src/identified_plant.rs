//! Identified parameters as a simulated vehicle.

use anyhow::{Result, bail};
use horizon_model::rows::{lag, stick};
use tello_eval::parameter_file::{ParameterFile, TakesParameters};
use tello_flight::cycle::ModelKind;

use crate::plant::{AxisTable, PlantParams, PlantTable};

impl TakesParameters for PlantTable {
    /// Everything but the disturbance. Roll and pitch have one dead time: the mean of theirs.
    fn take(&mut self, file: &ParameterFile) -> Result<()> {
        if file.model != ModelKind::Lagged {
            let (model, lagged) = (file.model.name(), ModelKind::Lagged.name());
            bail!(
                "they are of the model {model}, and the simulated vehicle can use {lagged} only: \
                 identify {lagged}; fly and replay can use {model}"
            );
        }
        let p = file.values();
        let sticks = [&[stick::ROLL, stick::PITCH][..], &[stick::THROTTLE], &[stick::YAW]];
        let [dead_h_s, dead_v_s, dead_a_s] = sticks.map(|sticks| {
            sticks.iter().map(|stick| file.dead_time_s[*stick]).sum::<f64>() / sticks.len() as f64
        });
        let axis = |gain: usize, dead_time_s, tau: usize, dead_zone: usize| AxisTable {
            gain: p[gain],
            dead_time_s,
            tau_s: p[tau],
            dead_zone: p[dead_zone],
        };
        let table = Self {
            horizontal: axis(lag::LAMBDA_H, dead_h_s, lag::TAU_H, lag::DEAD_H),
            vertical: axis(lag::LAMBDA_V, dead_v_s, lag::TAU_V, lag::DEAD_V),
            yaw: axis(lag::LAMBDA_A, dead_a_s, lag::TAU_A, lag::DEAD_A),
            theta_0: p[lag::THETA_0],
            accel_max_mps2: p[lag::A_MAX],
            ..*self
        };
        PlantParams::try_from(table)?;
        *self = table;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
