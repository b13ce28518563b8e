//! Whether a log shows a vehicle that flies against its sticks.
//!
//! Owns the sign of each stick. The search for lost commands cannot distinguish an inverted stick from an outage: it
//! leaves out what shows it, and the rest is fitted as if nothing were wrong.

use horizon_estim::Observed;
use horizon_model::rows::{Pose, Sticks, pose, stick};
use horizon_model::{Lagged, Model as _};
use nalgebra::{Rotation2, Vector2};

use super::flights::Flight;

/// Half of the time over which a velocity is taken. s
const HALF_S: f64 = 0.2;

/// Lag of the velocity behind each stick, and stick up to which it does nothing: those of a Tello. s, 1
const TAU_S: Sticks = Sticks::new(0.6, 0.6, 0.12, 0.25);
const DEAD: Sticks = Sticks::new(0.07, 0.07, 0.08, 0.12);

/// A correlation below is one of an inverted axis: 191 recordings of the thesis have -0.43 at least of roll and pitch,
/// -0.03 of yaw and -0.30 of throttle, those with the object turned by half a turn -0.74 at most. 1
const CORRELATION_MIN: f64 = -0.6;

/// Least root mean square of the lagged stick, and least number of velocities. 1
const EXCITATION_MIN: f64 = 0.1;
const VELOCITIES_MIN: usize = 500;

/// Of gentle sticks the excess over the dead zone counts, down to its least root mean square: within the zone the
/// vehicle drifts whatever the stick is. The whole stick must be against the motion, too: 191 recordings of the thesis
/// have -0.18 at least, and -0.13 beyond the zone. 1
const GENTLE_MIN: f64 = 0.05;
const GENTLE_BEYOND_MIN: f64 = 0.004;
const GENTLE_CORRELATION_MIN: f64 = -0.4;

/// No velocity of a vehicle: a jump of the poses. m/s
const SPEED_MAX_MPS: f64 = 3.0;

/// Sums of `u v`, `u^2` and `v^2` over the velocities `v` along one axis of the body, with the lagged stick `u`. m/s or
/// rad/s; 1; the square of the former
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    count: usize,
    stick_velocity: f64,
    stick: f64,
    velocity: f64,
}

/// Sums of a stick, and of its excess over the dead zone.
#[derive(Debug, Clone, Copy, Default)]
struct Axis {
    whole: Sums,
    beyond: Sums,
}

/// Why `flight` cannot be fitted; `None` if its motion does not contradict its sticks.
///
/// Correlates each velocity of the body with its applied stick behind a lag, about zero.
pub(super) fn inverted_axis(flight: &Flight, dead_time_s: &Sticks, dt_s: f64) -> Option<String> {
    let applied = flight.applied(dead_time_s, dt_s);
    let gain = TAU_S.map(|tau_s| 1.0 - (-dt_s / tau_s).exp());
    let (mut lagged, mut beyond) = (Sticks::zeros(), Sticks::zeros());
    let mut axes = [Axis::default(); stick::COUNT];
    for (k, u) in applied.iter().enumerate() {
        lagged += (u - lagged).component_mul(&gain);
        let effective = u.zip_map(&DEAD, |u, dead| u - u.clamp(-dead, dead));
        beyond += (effective - beyond).component_mul(&gain);
        let Some(velocity) = velocity_by_stick(&flight.o, k, dt_s) else { continue };
        for (row, axis) in axes.iter_mut().enumerate() {
            axis.whole.add(lagged[row], velocity[row]);
            axis.beyond.add(beyond[row], velocity[row]);
        }
    }
    let against = axes.map(|axis| axis.against());
    let rows = (0..stick::COUNT).zip(&against);
    let named = rows.filter_map(|(row, correlation)| {
        let correlation = (*correlation)?;
        Some(format!("{} (correlation {correlation:.2})", Lagged::INPUT[row].name))
    });
    let named: Vec<String> = named.collect();
    let cause = cause(against.map(|correlation| correlation.is_some()));
    (!named.is_empty())
        .then(|| format!("the vehicle flies against {}: {cause}", named.join(" and ")))
}

/// What inverts these sticks and no others.
fn cause(is_against: [bool; stick::COUNT]) -> &'static str {
    let [roll, pitch, yaw, throttle] =
        [stick::ROLL, stick::PITCH, stick::YAW, stick::THROTTLE].map(|row| is_against[row]);
    match (roll, pitch, yaw, throttle) {
        (true, true, false, false) => {
            "the object is defined the other way round (--turn 3.1416), or both sticks are inverted"
        }
        (true, false, true, false) | (false, true, true, false) => {
            "the frame of the motion capture is left-handed (one axis and theta have the wrong sign), or both sticks \
             are inverted"
        }
        (true, true, true, true) => "all sticks are inverted",
        _ if is_against.iter().filter(|is_against| **is_against).count() == 1 => {
            "the stick, or its axis of the motion capture, is inverted"
        }
        _ => "these sticks, or their axes of the motion capture, are inverted",
    }
}

impl Axis {
    /// Correlation if the vehicle flies against the stick. 1
    fn against(&self) -> Option<f64> {
        let Self { whole, beyond } = self;
        let correlation = whole.correlation(GENTLE_MIN)?;
        let is_against = if whole.rms() > EXCITATION_MIN {
            correlation < CORRELATION_MIN
        } else {
            correlation < GENTLE_CORRELATION_MIN
                && beyond.correlation(GENTLE_BEYOND_MIN).is_some_and(|of| of < CORRELATION_MIN)
        };
        is_against.then_some(correlation)
    }
}

impl Sums {
    fn add(&mut self, stick: f64, velocity: f64) {
        self.count += 1;
        self.stick_velocity += stick * velocity;
        self.stick += stick * stick;
        self.velocity += velocity * velocity;
    }

    /// Root mean square of the stick. 1
    fn rms(&self) -> f64 {
        (self.stick / self.count.max(1) as f64).sqrt()
    }

    /// `None` if the stick moved less than `rms_min`. 1
    fn correlation(&self, rms_min: f64) -> Option<f64> {
        let is_excited = self.count >= VELOCITIES_MIN && self.rms() > rms_min;
        is_excited.then(|| self.stick_velocity / (self.stick * self.velocity).sqrt())
    }
}

/// Velocity at step `k` that each stick commands: to the right, forward, counter-clockwise, up; `None` where a pose is
/// missing or jumps. m/s, rad/s
fn velocity_by_stick(o: &[Observed<{ pose::COUNT }>], k: usize, dt_s: f64) -> Option<Sticks> {
    let half = horizon_model::steps(HALF_S, dt_s);
    let complete = |k: usize| -> Option<&Pose> {
        o.get(k).filter(|o| o.is_present.iter().all(|seen| *seen)).map(|o| &o.o)
    };
    let (before, now) = (complete(k.checked_sub(half)?)?, complete(k)?);
    let moved = (complete(k + half)? - before) / (2.0 * half as f64 * dt_s);
    let velocity_w_mps = Vector2::new(moved[pose::X], moved[pose::Y]);
    let is_flown = velocity_w_mps.norm() <= SPEED_MAX_MPS;
    let velocity_b_mps = Rotation2::new(-now[pose::THETA]) * velocity_w_mps;
    let mut by_stick = Sticks::zeros();
    by_stick[stick::ROLL] = -velocity_b_mps.y;
    by_stick[stick::PITCH] = velocity_b_mps.x;
    by_stick[stick::YAW] = moved[pose::THETA];
    by_stick[stick::THROTTLE] = moved[pose::Z];
    is_flown.then_some(by_stick)
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT_S: f64 = 0.02;

    const RIGHT: Sticks = Sticks::new(1.0, 1.0, 1.0, 1.0);

    fn inverted(row: usize) -> Sticks {
        let mut signs = RIGHT;
        signs[row] = -1.0;
        signs
    }

    fn flight(signs: Sticks, turn_rad: f64) -> Flight {
        flight_with(signs, turn_rad, 1.0)
    }

    /// 40 s of a flight with all sticks of this size, the recorded ones multiplied by `signs`, the heading turned by
    /// `turn_rad`.
    fn flight_with(signs: Sticks, turn_rad: f64, size: f64) -> Flight {
        let model = Lagged::default();
        let p = nalgebra::SVector::from_column_slice(
            &crate::ident::settings(None).unwrap().map.p_prior,
        );
        let mut s = model.at_rest(&Pose::new(0.0, 0.0, 1.0, 0.7));
        let (mut u, mut o) = (Vec::new(), Vec::new());
        for k in 0..2000 {
            let t_s = f64::from(k) * DT_S;
            let mut flown = Sticks::zeros();
            flown[stick::ROLL] = 0.5 * (1.3 * t_s).sin();
            flown[stick::PITCH] = 0.5 * (0.9 * t_s).cos();
            flown[stick::YAW] = 0.4 * (1.1 * t_s).sin();
            flown[stick::THROTTLE] = 0.4 * (1.7 * t_s).sin();
            flown *= size;
            s = model.step(&s, &flown, &p, DT_S);
            let mut seen = model.observe(&s);
            seen[pose::THETA] += turn_rad;
            o.push(Observed::full(seen));
            u.push(flown.component_mul(&signs));
        }
        Flight { u, o }
    }

    #[test]
    fn an_inverted_stick_and_half_a_turn_are_named_and_a_right_flight_and_a_rest_are_not() {
        let reason = |flight: &Flight| inverted_axis(flight, &Sticks::zeros(), DT_S);
        assert_eq!(reason(&flight(RIGHT, 0.0)), None);
        assert_eq!(reason(&flight(RIGHT, 0.8)), None, "theta_0 is identified");
        for (flight, name) in [
            (flight(inverted(stick::ROLL), 0.0), "against roll"),
            (flight(inverted(stick::PITCH), 0.0), "against pitch"),
            (flight(inverted(stick::YAW), 0.0), "against yaw"),
            (flight(inverted(stick::THROTTLE), 0.0), "against throttle"),
            (flight(RIGHT, std::f64::consts::PI), "--turn"),
        ] {
            let reason = reason(&flight).unwrap();
            assert!(reason.contains(name), "{reason}");
        }
        let [turned, one, mirrored] = [
            flight(RIGHT, std::f64::consts::PI),
            flight(inverted(stick::ROLL), 0.0),
            flight(inverted(stick::ROLL).component_mul(&inverted(stick::YAW)), 0.0),
        ]
        .map(|flight| reason(&flight).unwrap());
        assert!(turned.contains("roll (") && turned.contains("and pitch ("), "{turned}");
        assert!(!one.contains("pitch") && !one.contains("--turn"), "{one}");
        assert!(mirrored.contains("and yaw (") && mirrored.contains("left-handed"), "{mirrored}");
        assert_eq!(reason(&flight(0.1 * inverted(stick::ROLL), 0.0)), None, "hardly moved");
        let mut short = flight(inverted(stick::ROLL), 0.0);
        short.u.truncate(400);
        short.o.truncate(400);
        assert_eq!(reason(&short), None, "short");
    }

    #[test]
    fn an_inverted_stick_is_named_that_moved_gently_and_a_drift_within_the_dead_zone_is_none() {
        // The amplitude of yaw and throttle is 0.4.
        let gently = |row: usize, amplitude: f64, drift: f64| {
            let mut flown = flight_with(RIGHT, 0.0, amplitude / 0.4);
            for (k, (u, o)) in flown.u.iter_mut().zip(&mut flown.o).enumerate() {
                u[row] *= -1.0;
                let period = [1.0, 1.1, 1.1, 1.7][row];
                o.o[pose::Z] -= drift * (period * k as f64 * DT_S).sin();
            }
            inverted_axis(&flown, &Sticks::zeros(), DT_S)
        };
        for row in [stick::YAW, stick::THROTTLE] {
            let reason = gently(row, 0.2, 0.0).unwrap_or_default();
            assert!(reason.contains(Lagged::INPUT[row].name), "{reason}");
        }
        assert_eq!(gently(stick::THROTTLE, 0.11, 0.05), None, "the stick did nothing");
    }
}
