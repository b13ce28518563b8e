//! Walls and obstacles as soft constraints of the controller.

use horizon_control::{Excess, SoftConstraints};
use horizon_model::rows::{Pose, pos_w, pose};
use nalgebra::SVector;

use super::{BEYOND_MARGIN_M, Walls};
use crate::cycle::Vehicle;
use crate::obstacle::SignedDistance;

/// The soft constraints `c_i(s) <= 0` of `docs/control.md`, section 3, on the states of a model with this parameter.
#[derive(Debug)]
pub(in crate::cycle) struct PlanWalls<'a, M, const NP: usize> {
    /// Model of the states.
    pub(in crate::cycle) model: &'a M,
    /// Parameter of `model`. In the units of its rows
    pub(in crate::cycle) p: &'a SVector<f64, NP>,
    /// Walls and obstacles with their margins.
    pub(in crate::cycle) walls: &'a Walls,
}

impl<M: Vehicle<NS, NP>, const NS: usize, const NP: usize> SoftConstraints<NS>
    for PlanWalls<'_, M, NP>
{
    fn count(&self) -> usize {
        self.walls.count()
    }

    fn excess(&self, i: usize, s: &SVector<f64, NS>, ahead_s: f64) -> Option<Excess<NS>> {
        let Self { model, p, walls } = self;
        let constraint = walls.constraints.get(i)?;
        let (at_w, coasting) = (pos_w(&model.observe(s)), walls.table.coasting);
        let coasting_w = pos_w(&model.coasting(s, p)) * coasting;
        let ends_w = [at_w, at_w + coasting_w];
        if ends_w.iter().all(|end_w| walls.is_far_wall(constraint, end_w, ahead_s)) {
            return None;
        }
        let (SignedDistance { distance_m, gradient_w }, is_at_rest) =
            walls.least_distance(constraint, &at_w, &coasting_w, ahead_s);
        let value = walls.margin_m(constraint, &gradient_w, ahead_s) - distance_m;
        if value < -BEYOND_MARGIN_M {
            return None;
        }
        let mut by_pose = Pose::zeros();
        by_pose.fixed_rows_mut::<3>(pose::X).copy_from(&-gradient_w);
        let mut gradient = model.observe_by_state(s).tr_mul(&by_pose);
        if is_at_rest {
            gradient += model.coasting_by_state(s, p).tr_mul(&by_pose) * coasting;
        }
        Some(Excess { value, gradient, weight: walls.table.weight })
    }
}

#[cfg(test)]
mod tests;
