//! Velocity that sticks command along the floor, without dead time and lag.

use horizon_model::rows::{Sticks, stick};
use horizon_model::world_from_sticks;
use nalgebra::Vector2;

/// What is left of a stick above its dead zone, with the stick's sign. 1
pub(crate) fn excess(u: f64, dead: f64) -> f64 {
    (u.abs() - dead).max(0.0).copysign(u)
}

/// Pitch and roll as a vector along the floor in the direction of flight `psi_rad`, world frame. 1
pub(crate) fn inputs_w(u: &Sticks, psi_rad: f64) -> Vector2<f64> {
    world_from_sticks(psi_rad.sin_cos(), u[stick::PITCH], u[stick::ROLL])
}

/// `c`: velocity along the floor that the sticks command in the direction of flight `psi_rad`, world frame. m/s
///
/// `lambda_h_mps` is the velocity of a full stick, `dead_h` the dead zone of roll and pitch (1).
pub fn commanded_w_mps(u: &Sticks, psi_rad: f64, lambda_h_mps: f64, dead_h: f64) -> Vector2<f64> {
    let forward_mps = lambda_h_mps * excess(u[stick::PITCH], dead_h);
    let right_mps = lambda_h_mps * excess(u[stick::ROLL], dead_h);
    world_from_sticks(psi_rad.sin_cos(), forward_mps, right_mps)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use horizon_model::check::amax;

    use super::*;

    /// Pitch and roll, the others neutral.
    fn sticks(pitch: f64, roll: f64) -> Sticks {
        let mut u = Sticks::zeros();
        (u[stick::PITCH], u[stick::ROLL]) = (pitch, roll);
        u
    }

    #[test]
    fn pitch_flies_forward_and_roll_to_the_right_of_the_direction_of_flight() {
        for ((pitch, roll), psi_rad, expected_w) in [
            ((0.6, 0.0), 0.0, [0.6, 0.0]),
            ((0.0, 0.6), 0.0, [0.0, -0.6]),
            ((0.6, 0.0), FRAC_PI_2, [0.0, 0.6]),
            ((0.0, 0.6), FRAC_PI_2, [0.6, 0.0]),
            ((-0.6, -0.3), 2.0 * FRAC_PI_2, [0.6, -0.3]),
        ] {
            let gap = inputs_w(&sticks(pitch, roll), psi_rad) - Vector2::from(expected_w);
            assert!(amax(&gap) < 1e-12, "{pitch}, {roll}, {psi_rad}: {gap}");
        }
    }

    #[test]
    fn a_dead_zone_shortens_each_stick_and_keeps_its_sign() {
        for (u, expected) in [(0.6, 0.5), (-0.6, -0.5), (0.1, 0.0), (-0.05, -0.0)] {
            assert!((excess(u, 0.1) - expected).abs() < 1e-12, "{u}");
        }
        let found_mps = commanded_w_mps(&sticks(0.6, -0.05), 0.0, 2.0, 0.1);
        assert!(amax(&(found_mps - Vector2::new(1.0, 0.0))) < 1e-12, "{found_mps}");
    }
}
