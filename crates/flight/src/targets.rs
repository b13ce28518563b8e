//! A list of target poses, and the target that the thesis' controller is given, clipped to a distance.

use horizon_model::angle::unwrap_near;
use horizon_model::rows::{Pose, pose};
use horizon_model::setting::{SettingError, finite};
use nalgebra::SVector;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::mission::{FollowTable, near};

/// `o_ref`, moved along the straight line to `o_0` until it is at most `distance_max` away,
/// thesis equation 4.20.
///
/// The distance is the norm over all rows, metres and radians alike, as in the thesis. The caller
/// has moved the angles of `o_ref` to the turn nearest to `o_0`.
///
/// Real time: no allocation, cost linear in the number of rows.
pub fn clip_target<const NO: usize>(
    o_ref: &SVector<f64, NO>,
    o_0: &SVector<f64, NO>,
    distance_max: f64,
) -> SVector<f64, NO> {
    let displacement = o_ref - o_0;
    let distance = displacement.norm();
    if distance > distance_max { o_0 + displacement * (distance_max / distance) } else { *o_ref }
}

/// `|target - at|` over x, y, z and theta, metres and radians alike, theta on the circle.
pub(crate) fn pose_distance(target: &Pose, at: &Pose) -> f64 {
    let mut displacement = target - at;
    displacement[pose::THETA] = unwrap_near(displacement[pose::THETA], 0.0);
    displacement.norm()
}

/// A list of targets as written in JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TargetTable {
    /// A target counts as reached within this distance, the norm over x, y, z and theta.
    /// m and rad, >= 0.02
    #[serde(default = "reach")]
    pub reach: f64,
    /// Poses to reach one after the other, at least one: x, y, z in m, theta in rad.
    pub targets: Vec<[f64; pose::COUNT]>,
}

/// What a list of targets without `reach` has: that of a path.
fn reach() -> f64 {
    FollowTable::default().reach
}

impl TargetTable {
    /// The targets, checked. m, rad
    ///
    /// # Errors
    /// The list is empty or an entry is not finite.
    pub fn poses(&self) -> Result<Vec<Pose>, SettingError> {
        if self.targets.is_empty() {
            return Err(SettingError::new("targets", "[]", "at least one target"));
        }
        for (k, target) in self.targets.iter().enumerate() {
            for (row, value) in target.iter().enumerate() {
                finite(&format!("targets[{k}][{row}]"), *value)?;
            }
        }
        Ok(self.targets.iter().map(|target| Pose::from(*target)).collect())
    }
}

/// A checked list of targets and how far it is flown.
#[derive(Debug, Clone, PartialEq)]
pub struct Targets {
    /// Largest distance, norm over x, y, z and theta, at which a target counts as reached. m and rad
    reach: f64,
    /// At least one.
    poses: Vec<Pose>,
    reached: usize,
}

impl Targets {
    /// The list of `table` with nothing reached.
    ///
    /// # Errors
    /// `reach` is too small, the list is empty or an entry is not finite.
    pub fn new(table: &TargetTable) -> Result<Self, SettingError> {
        Ok(Self { reach: near("reach", table.reach)?, poses: table.poses()?, reached: 0 })
    }

    /// Moves on to the next target if the current one is reached, and returns whether it was: step 9
    /// of the thesis' section 4.3.11.
    ///
    /// Reached means `|target - pose_hat| <= reach` over x, y, z and theta, theta on the circle.
    /// At most one target is reached per call; after the last one the answer is `false`.
    ///
    /// Real time: no allocation, constant cost.
    pub fn advance(&mut self, pose_hat: &Pose) -> bool {
        if self.is_finished() {
            return false;
        }
        let is_reached = pose_distance(self.current(), pose_hat) <= self.reach;
        self.reached += usize::from(is_reached);
        is_reached
    }

    /// The target to fly to; the last one when all are reached. m, rad
    pub fn current(&self) -> &Pose {
        &self.poses[self.reached.min(self.poses.len() - 1)]
    }

    /// The targets, at least one. m, rad
    pub fn poses(&self) -> &[Pose] {
        &self.poses
    }

    /// Number of targets reached, the index of the next one.
    pub fn reached(&self) -> usize {
        self.reached
    }

    /// Whether the last target was reached.
    pub fn is_finished(&self) -> bool {
        self.reached == self.poses.len()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use super::*;

    fn two_targets() -> Targets {
        let targets = vec![[1.0, 0.0, 1.0, 3.1], [1.0, 1.0, 1.0, 0.0]];
        Targets::new(&TargetTable { reach: 0.25, targets }).unwrap()
    }

    #[test]
    fn a_far_target_is_clipped_along_the_straight_line() {
        let s_0 = Pose::new(1.0, 2.0, 3.0, 4.0);
        let displacement = Pose::new(0.1, -0.7, 0.5, 0.5);
        let clipped = clip_target(&(s_0 + displacement), &s_0, 0.25);
        assert!((clipped - s_0 - displacement * 0.25).norm() < 1e-15, "{clipped}");
    }

    #[test]
    fn a_target_within_the_distance_stays() {
        let s_0 = Pose::new(1.0, 0.0, 0.0, 0.0);
        let at_limit = Pose::new(1.5, 0.0, 0.0, 0.0);
        assert_eq!(clip_target(&at_limit, &s_0, 0.5), at_limit);
        assert_eq!(clip_target(&s_0, &s_0, 0.5), s_0);
        // Rounding moves the clipped target by less than a bit of 1.75.
        let outside = Pose::new(1.75, 0.0, 0.0, 0.0);
        assert!((clip_target(&outside, &s_0, 0.5) - at_limit).norm() < 1e-15);
    }

    #[test]
    fn a_target_is_reached_within_the_four_dimensional_norm_and_not_beyond() {
        for (pose_hat, is_reached) in [
            (Pose::new(1.25, 0.0, 1.0, 3.1), true),
            (Pose::new(1.2501, 0.0, 1.0, 3.1), false),
            // 0.15^2 + 0.15^2 + 0.15^2 > 0.25^2, though each row is near.
            (Pose::new(1.15, 0.15, 1.15, 3.1), false),
            (Pose::new(1.0, 0.0, 1.0, 2.8), false),
            (Pose::new(f64::NAN, 0.0, 1.0, 3.1), false),
        ] {
            let mut targets = two_targets();
            assert_eq!(targets.advance(&pose_hat), is_reached, "{pose_hat}");
            assert_eq!(targets.reached(), usize::from(is_reached));
        }
    }

    #[test]
    fn heading_is_compared_on_the_circle() {
        for turns in [-TAU, 0.0, TAU, 3.0 * TAU] {
            // -3.1 rad lies 0.083 rad beyond 3.1 rad.
            assert!(two_targets().advance(&Pose::new(1.0, 0.0, 1.0, turns - 3.1)), "{turns}");
            assert!(!two_targets().advance(&Pose::new(1.0, 0.0, 1.0, turns + 3.1 - PI)), "{turns}");
        }
    }

    #[test]
    fn targets_follow_one_another_and_the_last_one_stays() {
        let mut targets = two_targets();
        let [first, second] = [*targets.current(), Pose::new(1.0, 1.0, 1.0, 0.0)];
        assert!(targets.advance(&first) && !targets.is_finished());
        assert_eq!(*targets.current(), second);
        assert!(!targets.advance(&first));
        assert!(targets.advance(&second) && targets.is_finished());
        assert_eq!((*targets.current(), targets.reached()), (second, 2));
        assert!(!targets.advance(&second));
        assert_eq!(targets.reached(), 2);
    }

    #[test]
    fn one_call_reaches_one_target() {
        let targets = vec![[0.0; 4]; 3];
        let mut targets = Targets::new(&TargetTable { reach: 0.1, targets }).unwrap();
        targets.advance(&Pose::zeros());
        assert_eq!(targets.reached(), 1);
    }

    #[test]
    fn a_bad_list_is_refused_with_key_value_and_rule() {
        let refusal =
            |reach, targets| Targets::new(&TargetTable { reach, targets }).unwrap_err().to_string();
        assert_eq!(refusal(0.0, vec![[0.0; 4]]), "reach = 0: expected finite and >= 0.02");
        assert_eq!(refusal(0.2, vec![]), "targets = []: expected at least one target");
        let nan = [0.0, 0.0, f64::NAN, 0.0];
        assert_eq!(refusal(0.2, vec![[0.0; 4], nan]), "targets[1][2] = NaN: expected finite");
    }
}
