//! An obstacle that moves: where it is going to be.
//!
//! Owns the prediction with constant velocity; the velocity is that of an alpha-beta filter on the positions.

use nalgebra::Vector3;

/// Fractions of an innovation that correct place and velocity, per tick: critically damped,
/// `beta = 2 - alpha - 2 sqrt(1 - alpha)`. 90 % of a change of the velocity is known after 0.12 s; 0.5 mm of noise in
/// the places are 6 mm/s.
const PLACE_GAIN: f64 = 0.7;
const VELOCITY_GAIN: f64 = 0.205;

/// How long an obstacle that is not seen goes on as before. s
const FORGET_S: f64 = 0.5;

/// The motion of one obstacle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MovingObstacle {
    /// m
    pos_w: Vector3<f64>,
    /// m/s
    vel_w: Vector3<f64>,
    unseen_s: f64,
}

impl MovingObstacle {
    /// The motion after a period of `dt_s`, in which the obstacle was seen at `seen_w` (m) or not at all; `None` if
    /// nothing is known of it. Places that are not finite are not seen.
    pub(super) fn after(before: Option<Self>, seen_w: Option<[f64; 3]>, dt_s: f64) -> Option<Self> {
        let seen_w = seen_w.map(Vector3::from).filter(|at_w| at_w.iter().all(|x| x.is_finite()));
        let Some(before) = before else {
            return seen_w.map(|pos_w| Self { pos_w, vel_w: Vector3::zeros(), unseen_s: 0.0 });
        };
        let pos_w = before.pos_w + before.vel_w * dt_s;
        let Some(seen_w) = seen_w else {
            let unseen_s = before.unseen_s + dt_s;
            return (unseen_s <= FORGET_S).then_some(Self { pos_w, unseen_s, ..before });
        };
        let innovation_w = seen_w - pos_w;
        Some(Self {
            pos_w: pos_w + innovation_w * PLACE_GAIN,
            vel_w: before.vel_w + innovation_w * (VELOCITY_GAIN / dt_s),
            unseen_s: 0.0,
        })
    }

    /// Where it is after `ahead_s`, world frame. m
    pub(super) fn place(&self, ahead_s: f64) -> Vector3<f64> {
        self.pos_w + self.vel_w * ahead_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT_S: f64 = 0.02;

    /// After `count` periods along x with 1 m/s.
    fn followed(count: u32) -> Option<MovingObstacle> {
        (0..count).fold(None, |before, k| {
            MovingObstacle::after(before, Some([DT_S * f64::from(k), 2.0, 1.0]), DT_S)
        })
    }

    #[test]
    fn a_straight_motion_is_predicted_after_half_a_second() {
        let found = followed(26).unwrap().place(1.0);
        assert!((found - Vector3::new(1.5, 2.0, 1.0)).norm() < 0.05, "{found}");
    }

    #[test]
    fn what_is_not_seen_goes_on_for_half_a_second_and_is_forgotten() {
        let go_on = |count: u32| {
            (0..count).fold(followed(100), |before, k| {
                let nothing = if k % 2 == 0 { None } else { Some([f64::NAN, 0.0, 0.0]) };
                MovingObstacle::after(before, nothing, DT_S)
            })
        };
        let place = go_on(20).unwrap().place(0.0);
        assert!((place.x - 0.02 * 119.0).abs() < 0.02, "{place}");
        assert_eq!(go_on(27), None);
    }
}
