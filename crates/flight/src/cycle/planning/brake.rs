//! Where a braking vehicle is brought to rest, and down before a landing.
//!
//! Owns the reference of a brake. It follows the vehicle, which stops as fast as it can, only as far as the vehicle was
//! predicted to fly: one that flies on further, since neutral sticks do not brake it or it keeps an old command, is
//! pulled back.

use horizon_model::rows::{Pose, pos_w, pose};

/// A braking vehicle is held at its position once its horizontal speed is below the first value, until its horizontal
/// distance from there exceeds the second. m/s, m
const REST_MPS: f64 = 0.1;
const REST_M: f64 = 0.5;

/// Speed at which a vehicle that is held comes down before a landing: that of a Tello that lands. m/s
const DESCENT_MPS: f64 = 0.4;

/// Allowance on the predicted displacement and turn of a brake. m, rad
const BEYOND_M: f64 = 0.1;
const BEYOND_RAD: f64 = 0.1;

/// The brake of a vehicle.
#[derive(Debug, Clone, Default)]
pub(super) struct Brake {
    /// Whether the vehicle brakes.
    is_on: bool,
    /// Height to which a vehicle that is held comes down; `None`: it stays. World frame. m
    descends_to_m: Option<f64>,
    /// Where the brake began; `None` before.
    start: Option<Start>,
    /// Where the vehicle is held; `None` before it is slow. World frame. m, rad
    rest: Option<Pose>,
}

/// The beginning of a brake.
#[derive(Debug, Clone, Copy)]
struct Start {
    /// Pose at the beginning. World frame. m, rad
    at: Pose,
    /// Predicted displacement and turn to rest with neutral sticks, and the allowance. m, rad
    reach_m: f64,
    reach_rad: f64,
}

impl Start {
    /// The pose nearest to `from` within reach. World frame. m, rad
    fn clip(&self, from: &Pose) -> Pose {
        let mut gone = from - self.at;
        let gone_m = pos_w(&gone).xy().norm();
        let fraction = if gone_m > self.reach_m { self.reach_m / gone_m } else { 1.0 };
        gone[pose::X] *= fraction;
        gone[pose::Y] *= fraction;
        gone[pose::THETA] = gone[pose::THETA].clamp(-self.reach_rad, self.reach_rad);
        self.at + gone
    }
}

impl Brake {
    /// Brakes or not. A vehicle that has come to rest is brought down to the height `descends_to_m`, world frame. m
    pub(super) fn set(&mut self, is_on: bool, descends_to_m: Option<f64>) {
        *self = if is_on { Self { is_on, descends_to_m, ..*self } } else { Self::default() };
    }

    /// Whether the vehicle brakes.
    pub(super) fn is_on(&self) -> bool {
        self.is_on
    }

    /// Whether the vehicle is held at one position.
    pub(super) fn is_at_rest(&self) -> bool {
        self.rest.is_some()
    }

    /// Reference, world frame, of a vehicle at `from` that is at `next` a period of `dt_s` later and comes to rest
    /// with neutral sticks after the displacement `coasting`: its own pose within reach, or once it is slow the pose
    /// at which it is held, so that it does not drift on. m, rad
    ///
    /// Real time: no allocation, constant cost.
    pub(super) fn reference(
        &mut self,
        from: &Pose,
        next: &Pose,
        coasting: &Pose,
        dt_s: f64,
    ) -> Pose {
        let distance_m = |to: &Pose| (pos_w(to) - pos_w(from)).xy().norm();
        let start = self.start.get_or_insert_with(|| Start {
            at: *from,
            reach_m: pos_w(coasting).xy().norm() + BEYOND_M,
            reach_rad: coasting[pose::THETA].abs() + BEYOND_RAD,
        });
        let within = start.clip(from);
        let is_slow = distance_m(next) < REST_MPS * dt_s;
        let kept = self.rest.filter(|rest| distance_m(rest) < REST_M);
        self.rest = kept.or_else(|| is_slow.then_some(within));
        if let Some((rest, to_m)) = self.rest.as_mut().zip(self.descends_to_m) {
            let z_m = rest[pose::Z];
            rest[pose::Z] = (z_m - DESCENT_MPS * dt_s).max(to_m.min(z_m));
        }
        self.rest.unwrap_or(within)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT_S: f64 = 0.02;

    /// A brake that began at the origin, of a vehicle that was to coast by 0.7 m.
    fn begun(descends_to_m: Option<f64>) -> Brake {
        let mut brake = Brake::default();
        brake.set(true, descends_to_m);
        let coasting = Pose::new(0.7, 0.0, 0.0, 0.2);
        let from = Pose::new(0.0, 0.0, 1.3, 0.0);
        let next = Pose::new(0.02, 0.0, 1.3, 0.0);
        assert_eq!(brake.reference(&from, &next, &coasting, DT_S), from);
        brake
    }

    /// Reference of a vehicle at `from` that flies on at 1 m/s.
    fn flies_on(brake: &mut Brake, from: Pose) -> Pose {
        brake.reference(&from, &(from + Pose::new(0.02, 0.0, 0.0, 0.0)), &Pose::zeros(), DT_S)
    }

    #[test]
    fn the_reference_follows_the_vehicle_as_far_as_the_brake_was_predicted_to_lead() {
        let mut brake = begun(None);
        let near = Pose::new(0.79, 0.0, 1.1, -0.29);
        assert_eq!(flies_on(&mut brake, near), near);
        let far = flies_on(&mut brake, Pose::new(1.6, 0.0, 1.1, 0.5));
        assert!((far - Pose::new(0.8, 0.0, 1.1, 0.3)).norm() < 1e-12, "{far}");
        assert!(!brake.is_at_rest());
        brake.set(false, None);
        brake.set(true, None);
        let anew = Pose::new(5.0, 0.0, 1.0, 0.0);
        assert_eq!(flies_on(&mut brake, anew), anew, "a new brake begins where it begins");
    }

    #[test]
    fn a_slow_vehicle_is_held_and_comes_down_at_the_speed_of_a_landing_if_it_shall() {
        for (to_m, after_1_s, after_4_s) in
            [(None, 1.3, 1.3), (Some(0.45), 0.9, 0.45), (Some(1.5), 1.3, 1.3)]
        {
            let mut brake = begun(to_m);
            let slow = Pose::new(0.3, 0.0, 1.3, 0.0);
            let mut heights_m = (0..200).map(|_| {
                let reference = brake.reference(&slow, &slow, &Pose::zeros(), DT_S);
                assert_eq!((reference[pose::X], reference[pose::THETA]), (0.3, 0.0));
                reference[pose::Z]
            });
            let found = (heights_m.nth(49).unwrap(), heights_m.last().unwrap());
            assert!((found.0 - after_1_s).abs() < 1e-9, "{to_m:?}: {found:?}");
            assert!((found.1 - after_4_s).abs() < 1e-9, "{to_m:?}: {found:?}");
            assert!(brake.is_at_rest());
        }
    }

    #[test]
    fn a_vehicle_that_is_carried_away_is_held_within_reach() {
        let mut brake = begun(None);
        let slow = Pose::new(0.3, 0.0, 1.3, 0.0);
        let drifted = Pose::new(0.79, 0.0, 1.3, 0.0);
        let held = |brake: &mut Brake, at: &Pose| brake.reference(at, at, &Pose::zeros(), DT_S);
        assert_eq!(held(&mut brake, &slow), slow);
        assert_eq!(held(&mut brake, &drifted), slow, "nearer than 0.5 m");
        let carried = held(&mut brake, &Pose::new(1.5, 0.0, 1.3, 0.0));
        assert!((carried[pose::X] - 0.8).abs() < 1e-12, "{carried}");
    }
}
