//! Values of the faults and switches of a family.
//!
//! Owns their ranges.

use std::f64::consts::{PI, TAU};

use crate::random::Random;
use crate::{
    Axes, CancelledBy, FlyingFlag, InjectedFault, Measured, OutageBehaviour, Profile, SimStart,
    SimTable,
};

/// Height of a drone that flies at the start. m
const ALOFT_M: f64 = 1.2;
/// Bytes that the relay sends, in the mean. 1/s
const RELAY_BYTES_PER_S: f64 = 4e3;

/// Another object at rest.
pub(super) fn still(random: &mut Random) -> InjectedFault {
    InjectedFault::MocapStill {
        offset_w_m: vector(random, 0.0, 3.0),
        turn_rad: if random.chance(0.5) { random.between(-PI, PI) } else { 0.0 },
        noise_m: random.between(0.0, 5e-3),
        noise_rad: random.between(0.0, 0.02),
    }
}

/// The pose at the onset under noise.
pub(super) fn stuck(random: &mut Random) -> InjectedFault {
    InjectedFault::MocapStill {
        offset_w_m: [0.0; 3],
        turn_rad: 0.0,
        noise_m: log_between(random, 1e-5, 5e-3),
        noise_rad: log_between(random, 1e-5, 0.02),
    }
}

/// Another object on a circle.
pub(super) fn walker(random: &mut Random) -> InjectedFault {
    InjectedFault::MocapWalker {
        offset_w_m: vector(random, 0.0, 2.0),
        radius_m: random.between(0.3, 2.0),
        speed_mps: random.between(0.05, 1.5),
        noise_m: random.between(0.0, 5e-3),
        noise_rad: random.between(0.0, 0.02),
    }
}

/// Another object that leaves the place of the drone.
pub(super) fn leaving(random: &mut Random) -> InjectedFault {
    InjectedFault::MocapWalker {
        offset_w_m: [0.0; 3],
        radius_m: random.between(5.0, 20.0),
        speed_mps: log_between(random, 0.05, 1.5),
        noise_m: random.between(0.0, 5e-3),
        noise_rad: random.between(0.0, 0.02),
    }
}

/// Drift along the floor.
pub(super) fn drift(random: &mut Random) -> InjectedFault {
    let speed_mps = log_between(random, 0.02, 1.0);
    let (sin, cos) = random.between(0.0, TAU).sin_cos();
    InjectedFault::MocapDrift {
        velocity_w_mps: [speed_mps * cos, speed_mps * sin, 0.0],
        yaw_radps: 0.0,
    }
}

pub(super) fn height_drift(random: &mut Random) -> InjectedFault {
    let velocity_w_mps = [0.0, 0.0, sign(random) * log_between(random, 0.02, 0.5)];
    InjectedFault::MocapDrift { velocity_w_mps, yaw_radps: 0.0 }
}

pub(super) fn heading_drift(random: &mut Random) -> InjectedFault {
    let yaw_radps = sign(random) * log_between(random, 0.02, 1.0);
    InjectedFault::MocapDrift { velocity_w_mps: [0.0; 3], yaw_radps }
}

/// A step of the heading by `low_rad` to pi, to either side.
pub(super) fn heading_turn(low_rad: f64, random: &mut Random) -> InjectedFault {
    InjectedFault::MocapHeading { turn_rad: sign(random) * random.between(low_rad, PI) }
}

pub(super) fn noise(random: &mut Random) -> InjectedFault {
    InjectedFault::MocapNoise {
        growth_mps: random.between(0.0, 0.2),
        growth_radps: random.between(0.0, 0.4),
    }
}

pub(super) fn occluded(random: &mut Random) -> InjectedFault {
    let period_s = random.between(0.1, 4.0);
    let lost_s = period_s * random.between(0.2, 0.95);
    InjectedFault::MocapOccluded { period_s, lost_s }
}

pub(super) fn slow_link(random: &mut Random) -> InjectedFault {
    InjectedFault::MocapSlowLink { bytes_per_s: RELAY_BYTES_PER_S * random.between(0.1, 0.98) }
}

pub(super) fn second_controller(random: &mut Random) -> InjectedFault {
    InjectedFault::SecondController {
        sticks: [(); 4].map(|()| random.between(-0.6, 0.6)),
        rate_hz: random.between(2.0, 50.0),
    }
}

pub(super) fn set_land_unheard(sim: &mut SimTable, random: &mut Random) {
    let landing = &mut sim.drone.landing;
    if random.chance(0.5) {
        landing.deaf_s = random.between(0.2, 10.0);
    } else {
        landing.deaf_count = pick(&[1, 2, 3, 5, 10], random);
    }
}

pub(super) fn set_landing_cancelled(sim: &mut SimTable, random: &mut Random) {
    sim.drone.landing.cancelled_by =
        pick(&[CancelledBy::Deflection, CancelledBy::AnySticks], random);
}

pub(super) fn set_flying_flag(sim: &mut SimTable, random: &mut Random) {
    let right = FlyingFlag::Right;
    let all = [right, FlyingFlag::Inverted, FlyingFlag::Standing, FlyingFlag::Flying];
    sim.drone.status.flying = pick(&all, random);
    sim.drone.status.flying_late_s = random.between(0.0, 8.0);
}

pub(super) fn set_velocity(sim: &mut SimTable, random: &mut Random) {
    let velocity = &mut sim.drone.status.velocity;
    velocity.is_present = random.chance(0.7);
    velocity.axes = pick(&[Axes::World, Axes::Body], random);
    velocity.turn_rad = random.between(-PI, PI);
    velocity.is_mirrored = random.chance(0.5);
    velocity.is_upside_down = random.chance(0.5);
    velocity.late_s = random.between(0.0, 0.6);
    velocity.measured = pick(&[Measured::True, Measured::Own], random);
}

pub(super) fn set_height(sim: &mut SimTable, random: &mut Random) {
    sim.drone.status.has_height = random.chance(0.5);
    sim.drone.status.height_drift_mps = random.between(-0.1, 0.1);
}

pub(super) fn set_heading_report(sim: &mut SimTable, random: &mut Random) {
    let heading = &mut sim.drone.status.heading;
    heading.is_present = random.chance(0.7);
    heading.is_mirrored = random.chance(0.5);
    heading.drift_radps = random.between(-0.1, 0.1);
    heading.late_s = random.between(0.0, 0.6);
}

pub(super) fn set_held_outages(sim: &mut SimTable, random: &mut Random) {
    sim.profile = Profile::Outages;
    sim.drone.outage = pick(&[OutageBehaviour::Held, OutageBehaviour::Mixed], random);
}

pub(super) fn set_already_flying(sim: &mut SimTable) {
    if let SimStart::Ground { x, y, theta } = sim.start {
        sim.start = SimStart::Air { x, y, z: ALOFT_M, theta };
    }
}

pub(super) fn frame(turn_rad: f64, is_mirrored: bool, scale: f64) -> InjectedFault {
    InjectedFault::MocapFrame { turn_rad, is_mirrored, scale }
}

/// One of `all`, which are not none.
pub(super) fn pick<T: Copy>(all: &[T], random: &mut Random) -> T {
    let place = horizon_model::whole(random.between(0.0, all.len() as f64));
    all[place.min(all.len() - 1)]
}

pub(super) fn sign(random: &mut Random) -> f64 {
    if random.chance(0.5) { 1.0 } else { -1.0 }
}

/// The logarithm is uniform.
pub(super) fn log_between(random: &mut Random, low: f64, high: f64) -> f64 {
    random.between(low.ln(), high.ln()).exp()
}

/// One axis of the position stands still, or both of the floor.
pub(super) fn axes_stuck(random: &mut Random) -> InjectedFault {
    let all =
        [[true, false, false], [false, true, false], [false, false, true], [true, true, false]];
    let axes = pick(&all, random);
    InjectedFault::MocapAxesStuck { axes, noise_m: log_between(random, 1e-5, 5e-3) }
}

/// A vector in any direction with a length that is uniform.
pub(super) fn vector(random: &mut Random, low_m: f64, high_m: f64) -> [f64; 3] {
    let length_m = random.between(low_m, high_m);
    let (sin, cos) = random.between(0.0, TAU).sin_cos();
    let up = random.between(-1.0, 1.0);
    let level = (1.0 - up * up).sqrt();
    [length_m * level * cos, length_m * level * sin, length_m * up]
}

#[cfg(test)]
mod tests {
    use horizon_model::check::{maximum, minimum};

    use super::*;
    use crate::random::Purpose;

    const COUNT: usize = 4_000;

    fn random() -> Random {
        Random::new(1, Purpose::Campaign)
    }

    /// Least, mean and greatest of [`COUNT`] draws.
    fn statistics(mut draw: impl FnMut(&mut Random) -> f64) -> [f64; 3] {
        let mut random = random();
        let drawn: Vec<f64> = (0..COUNT).map(|_| draw(&mut random)).collect();
        let fold = |f: fn(f64, f64) -> f64, start| drawn.iter().copied().fold(start, f);
        let mean = drawn.iter().sum::<f64>() / COUNT as f64;
        [fold(minimum, f64::INFINITY), mean, fold(maximum, f64::NEG_INFINITY)]
    }

    #[test]
    fn one_of_several_and_both_signs_are_drawn_equally_often() {
        let near = |[low, mean, high]: [f64; 3], [least, middle, most]: [f64; 3]| {
            assert!((low - least).abs() < 1e-12 && (high - most).abs() < 1e-12, "{low}, {high}");
            assert!((mean - middle).abs() < 0.06, "{mean}");
        };
        near(statistics(|random| f64::from(pick(&[0, 1, 2, 3], random))), [0.0, 1.5, 3.0]);
        near(statistics(sign), [-1.0, 0.0, 1.0]);
    }

    #[test]
    fn a_logarithm_that_is_uniform_has_the_geometric_mean_in_its_middle() {
        let [low, mean, high] = statistics(|random| log_between(random, 1e-5, 1e-1).ln());
        let [least, most] = [1e-5_f64, 1e-1].map(f64::ln);
        assert!(low >= least && low < least + 0.02 && high <= most && high > most - 0.02);
        assert!((mean - 1e-3_f64.ln()).abs() < 0.15, "{mean}");
    }

    #[test]
    fn a_vector_has_any_direction_and_a_length_in_its_range() {
        let norm = |vector: [f64; 3]| vector.iter().map(|x| x * x).sum::<f64>().sqrt();
        let [low, mean, high] = statistics(|random| norm(vector(random, 1.0, 3.0)));
        assert!((1.0 - 1e-12..1.01).contains(&low), "{low}");
        assert!((2.99..3.0 + 1e-12).contains(&high), "{high}");
        assert!((mean - 2.0).abs() < 0.04, "{mean}");
        for axis in 0..3 {
            // Of a unit vector each row is uniform in -1..=1.
            let [low, mean, high] = statistics(|random| vector(random, 1.0, 1.0)[axis]);
            assert!(low < -0.99 && high > 0.99 && mean.abs() < 0.04, "axis {axis}: {mean}");
        }
    }

    #[test]
    fn an_occlusion_leaves_some_of_each_period() {
        let [low, _, high] = statistics(|random| match occluded(random) {
            InjectedFault::MocapOccluded { period_s, lost_s } => lost_s / period_s,
            other => panic!("{other:?}"),
        });
        assert!((0.2..0.21).contains(&low), "{low}");
        assert!((0.94..0.95).contains(&high), "{high}");
    }

    #[test]
    fn a_drone_on_the_ground_starts_in_the_air_and_one_in_the_air_stays() {
        let mut sim = crate::settings(None).unwrap();
        sim.start = SimStart::Ground { x: 1.0, y: 2.0, theta: 3.0 };
        let aloft = SimStart::Air { x: 1.0, y: 2.0, z: 1.2, theta: 3.0 };
        for _ in 0..2 {
            set_already_flying(&mut sim);
            assert_eq!(sim.start, aloft);
        }
    }
}
