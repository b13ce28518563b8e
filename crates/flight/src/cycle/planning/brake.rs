//! Where a braking vehicle is brought to rest, and down before a landing.
//!
//! Owns the reference of a brake. It follows the vehicle, which stops as fast as it can, only as far as the vehicle was
//! predicted to fly: one that flies on further, since neutral sticks do not brake it or it keeps an old command, is
//! pulled back.

use horizon_control::predict;
use horizon_model::rows::{Pose, Sticks, pos_w, pose};

use super::{PlanStart, Planner};
use crate::cycle::Vehicle;
use crate::supervisor::SLOW_MPS;

/// A braking vehicle is held at its position once its horizontal speed is below the first value, one that is to come
/// down below [`SLOW_MPS`], until its horizontal distance from there exceeds the second. m/s, m
const REST_MPS: f64 = 0.1;
const REST_M: f64 = 0.5;

/// Speed at which a vehicle that is held comes down before a landing: that of a Tello that lands. m/s
const DESCENT_MPS: f64 = 0.4;

/// Most by which the reference of a vehicle that comes down is below it: more than the vehicle lags behind, 0.18 m by
/// a dead time of 0.19 s and a lag of 0.25 s, and a small step for one that stands on something or receives nothing. m
const BELOW_M: f64 = 0.3;

/// Allowance on the predicted displacement and turn of a brake. m, rad
const BEYOND_M: f64 = 0.1;
const BEYOND_RAD: f64 = 0.1;

/// Order to a brake.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::cycle) struct BrakeOrder {
    /// Whether the vehicle brakes.
    pub(in crate::cycle) is_on: bool,
    /// Height to which a vehicle that is held comes down; `None`: it stays. World frame. m
    pub(in crate::cycle) descends_to_m: Option<f64>,
    /// Whether the place at which it is held follows a vehicle that the moving obstacle drives away.
    pub(in crate::cycle) may_move: bool,
}

/// The brake of a vehicle.
#[derive(Debug, Clone, Default)]
pub(super) struct Brake {
    order: BrakeOrder,
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
    /// Predicted displacement and turn to rest, and the allowance. m, rad
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
    /// Obeys `order`; where the brake began and holds the vehicle is forgotten when it ends.
    pub(super) fn set(&mut self, order: BrakeOrder) {
        *self = if order.is_on { Self { order, ..*self } } else { Self::default() };
    }

    /// Whether the vehicle brakes.
    pub(super) fn is_on(&self) -> bool {
        self.order.is_on
    }

    /// Whether the vehicle is held at one position.
    pub(super) fn is_at_rest(&self) -> bool {
        self.rest.is_some()
    }

    /// Where a vehicle at `from` is held, or the pose within reach that is nearest to it; `None` before the brake has
    /// begun. World frame. m, rad
    pub(super) fn held(&self, from: &Pose) -> Option<Pose> {
        self.rest.or(self.start.map(|start| start.clip(from)))
    }

    /// The brake of a vehicle at `from`, which is at rest after `displacement` with the sticks in transit and neutral
    /// ones behind them, begins here, or goes on from here: one that is held keeps its height and heading. World frame.
    /// m, rad
    pub(super) fn begin(&mut self, from: &Pose, displacement: &Pose) {
        self.start = Some(Start {
            at: *from,
            reach_m: pos_w(displacement).xy().norm() + BEYOND_M,
            reach_rad: displacement[pose::THETA].abs() + BEYOND_RAD,
        });
        if let Some(rest) = &mut self.rest {
            (rest[pose::X], rest[pose::Y]) = (from[pose::X], from[pose::Y]);
        }
    }

    /// Reference, world frame, of a vehicle at `from` that is at `next` a period of `dt_s` later with neutral sticks:
    /// its own pose within reach, or once it is slow the pose at which it is held, so that it does not drift on. m, rad
    ///
    /// Real time: no allocation, constant cost.
    pub(super) fn reference(&mut self, from: &Pose, next: &Pose, dt_s: f64) -> Pose {
        let distance_m = |to: &Pose| (pos_w(to) - pos_w(from)).xy().norm();
        let within = self.start.map_or(*from, |start| start.clip(from));
        let rest_mps = if self.order.descends_to_m.is_some() { SLOW_MPS } else { REST_MPS };
        let is_slow = distance_m(next) < rest_mps * dt_s;
        let kept = self.rest.filter(|rest| distance_m(rest) < REST_M);
        self.rest = kept.or_else(|| is_slow.then_some(within));
        if let Some((rest, to_m)) = self.rest.as_mut().zip(self.order.descends_to_m) {
            let z_m = rest[pose::Z];
            let least_m = to_m.max(from[pose::Z] - BELOW_M);
            rest[pose::Z] = (z_m - DESCENT_MPS * dt_s).max(least_m.min(z_m));
        }
        self.rest.unwrap_or(within)
    }
}

impl<M: Vehicle<NS, NP>, const NS: usize, const NP: usize, const NR: usize> Planner<M, NS, NP, NR> {
    /// Reference of a brake for a plan that begins at the pose `from`. Where the moving obstacle drives the vehicle
    /// away, the brake begins anew, if it may: else the vehicle would return to an obstacle that is forgotten.
    pub(super) fn brake_reference(&mut self, from: &Pose, start: &PlanStart<'_, NS, NP>) -> Pose {
        let is_driven = |held: Pose| {
            let walls = self.walls.as_ref();
            walls.is_some_and(|walls| walls.moving_blocks_path(&pos_w(from), &pos_w(&held)))
        };
        let may_move = self.brake.order.may_move;
        if self.brake.held(from).is_none_or(|held| may_move && is_driven(held)) {
            self.brake.begin(from, &(self.rest_by_neutral(start) - from));
        }
        let next = self.model.step(&self.s_0, &Sticks::zeros(), &self.p, self.dt_s);
        self.brake.reference(from, &self.model.observe(&next), self.dt_s)
    }

    /// Pose at which the vehicle comes to rest if nothing but neutral sticks follows the committed ones.
    pub(super) fn rest_by_neutral(&self, start: &PlanStart<'_, NS, NP>) -> Pose {
        let inputs = (0..self.committed.given_steps_max()).map(|k| {
            let sticks = start.applied(start.begin_ahead() + k.cast_signed());
            let is_given = |axis: usize| k < self.committed.given_steps[axis];
            Sticks::from_fn(|axis, _| if is_given(axis) { sticks[axis] } else { 0.0 })
        });
        let s = predict(&self.model, &self.s_0, &self.p, inputs, self.dt_s);
        self.model.observe(&s) + self.model.coasting(&s, &self.p)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT_S: f64 = 0.02;
    const ON: BrakeOrder = BrakeOrder { is_on: true, descends_to_m: None, may_move: true };

    /// A brake that began at the origin, of a vehicle that was to coast by 0.7 m.
    fn begun(descends_to_m: Option<f64>) -> Brake {
        let mut brake = Brake::default();
        brake.set(BrakeOrder { descends_to_m, ..ON });
        let coasting = Pose::new(0.7, 0.0, 0.0, 0.2);
        let from = Pose::new(0.0, 0.0, 1.3, 0.0);
        let next = Pose::new(0.02, 0.0, 1.3, 0.0);
        brake.begin(&from, &coasting);
        assert_eq!(brake.reference(&from, &next, DT_S), from);
        brake
    }

    /// Reference of a vehicle at `from` that flies on at 1 m/s.
    fn flies_on(brake: &mut Brake, from: Pose) -> Pose {
        brake.reference(&from, &(from + Pose::new(0.02, 0.0, 0.0, 0.0)), DT_S)
    }

    #[test]
    fn the_reference_follows_the_vehicle_as_far_as_the_brake_was_predicted_to_lead() {
        let mut brake = begun(None);
        let near = Pose::new(0.79, 0.0, 1.1, -0.29);
        assert_eq!(flies_on(&mut brake, near), near);
        let far = flies_on(&mut brake, Pose::new(1.6, 0.0, 1.1, 0.5));
        assert!((far - Pose::new(0.8, 0.0, 1.1, 0.3)).norm() < 1e-12, "{far}");
        assert!(!brake.is_at_rest());
        brake.set(BrakeOrder::default());
        brake.set(ON);
        let anew = Pose::new(5.0, 0.0, 1.0, 0.0);
        assert_eq!(brake.held(&anew), None);
        brake.begin(&anew, &Pose::zeros());
        assert_eq!(flies_on(&mut brake, anew), anew, "a new brake begins where it begins");
    }

    #[test]
    fn a_slow_vehicle_is_held_and_comes_down_at_the_speed_of_a_landing_if_it_shall() {
        for (to_m, after_1_s, after_4_s) in
            [(None, 1.3, 1.3), (Some(0.45), 0.9, 0.45), (Some(1.5), 1.3, 1.3)]
        {
            let mut brake = begun(to_m);
            let mut slow = Pose::new(0.3, 0.0, 1.3, 0.0);
            let mut heights_m = (0..200).map(|_| {
                slow = brake.reference(&slow, &slow, DT_S);
                assert_eq!((slow[pose::X], slow[pose::THETA]), (0.3, 0.0));
                slow[pose::Z]
            });
            let found = (heights_m.nth(49).unwrap(), heights_m.last().unwrap());
            assert!((found.0 - after_1_s).abs() < 1e-9, "{to_m:?}: {found:?}");
            assert!((found.1 - after_4_s).abs() < 1e-9, "{to_m:?}: {found:?}");
            assert!(brake.is_at_rest());
        }
        let (mut brake, stands) = (begun(Some(0.45)), Pose::new(0.3, 0.0, 1.3, 0.0));
        let last = (0..200).map(|_| brake.reference(&stands, &stands, DT_S)).last().unwrap();
        assert!((last[pose::Z] - 1.0).abs() < 1e-9, "{last} of a vehicle that stands on something");
    }

    #[test]
    fn a_vehicle_that_is_to_come_down_is_held_from_the_speed_on_at_which_its_descent_counts() {
        for (descends_to_m, speed_mps, is_held) in
            [(None, 0.15, false), (Some(0.45), 0.15, true), (Some(0.45), 0.25, false)]
        {
            let mut brake = begun(descends_to_m);
            let from = Pose::new(0.3, 0.0, 1.3, 0.0);
            brake.reference(&from, &(from + Pose::new(speed_mps * DT_S, 0.0, 0.0, 0.0)), DT_S);
            assert_eq!(brake.is_at_rest(), is_held, "{descends_to_m:?}, {speed_mps} m/s");
        }
    }

    #[test]
    fn a_brake_that_begins_anew_holds_the_vehicle_there_at_its_height_and_heading() {
        let mut brake = begun(Some(0.45));
        let slow = Pose::new(0.3, 0.0, 1.3, 0.1);
        let came_down = (0..50).map(|_| brake.reference(&slow, &slow, DT_S)).last().unwrap();
        assert!((came_down[pose::Z] - 1.0).abs() < 1e-9, "{came_down}");
        let evaded = Pose::new(0.3, 0.45, 1.25, 0.0);
        brake.begin(&evaded, &Pose::zeros());
        let gone_on = Pose::new(0.3, 0.6, 1.2, 0.0);
        let reference = flies_on(&mut brake, gone_on);
        let expected = Pose::new(0.3, 0.45, 0.992, 0.1);
        assert!((reference - expected).norm() < 1e-9, "{reference}");
        // One that is carried on from there finds no reach to where it was before.
        let carried = flies_on(&mut brake, Pose::new(0.3, 1.45, 1.2, 0.0));
        assert!((carried - Pose::new(0.3, 0.55, 1.2, 0.0)).norm() < 1e-9, "{carried}");
    }

    #[test]
    fn a_vehicle_that_is_carried_away_is_held_within_reach() {
        let mut brake = begun(None);
        let slow = Pose::new(0.3, 0.0, 1.3, 0.0);
        let drifted = Pose::new(0.79, 0.0, 1.3, 0.0);
        let held = |brake: &mut Brake, at: &Pose| brake.reference(at, at, DT_S);
        assert_eq!(held(&mut brake, &slow), slow);
        assert_eq!(held(&mut brake, &drifted), slow, "nearer than 0.5 m");
        let carried = held(&mut brake, &Pose::new(1.5, 0.0, 1.3, 0.0));
        assert!((carried[pose::X] - 0.8).abs() < 1e-12, "{carried}");
    }
}
