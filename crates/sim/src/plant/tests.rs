use horizon_model::check::maximum;
use nalgebra::SVector;

use super::*;

/// The nominal vehicle without disturbance.
pub(super) fn still() -> PlantTable {
    PlantTable { disturbance_h_mps: 0.0, disturbance_v_mps: 0.0, ..NOMINAL }
}

pub(super) fn plant(table: PlantTable, theta: f64) -> Plant {
    let params = PlantParams::try_from(table).unwrap();
    Plant::new(params, Pose::new(0.3, -0.2, 1.3, theta), Velocity::default(), 1).unwrap()
}

pub(super) fn steps_of(duration_s: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few seconds")]
    let steps = (duration_s / DT_S).round() as usize;
    steps
}

#[test]
fn a_constant_stick_leads_to_its_velocity() {
    let mut vehicle = plant(still(), 0.06);
    for _ in 0..steps_of(10.0) {
        vehicle.step(&Sticks::new(-0.3, 0.4, 0.5, 0.6), true);
        // Hold the heading: a turning vehicle has no constant world velocity.
        vehicle.pose[pose::THETA] = 0.06;
    }
    let velocity = vehicle.velocity();
    // psi = 0: forward is +x, right is -y. 15 time constants leave 3e-7 of the way.
    for (got, expected) in [
        (velocity.x_mps, 1.9 * (0.4 - 0.07)),
        (velocity.y_mps, 1.9 * (0.3 - 0.07)),
        (velocity.z_mps, 0.89 * (0.6 - 0.12)),
        (velocity.yaw_radps, 1.4 * (0.5 - 0.08)),
    ] {
        assert!((got - expected).abs() < 1e-6, "{got} instead of {expected}: {velocity:?}");
    }
}

#[test]
fn the_direction_of_flight_is_that_of_the_thesis_model() {
    // Equation 4.1 with the same sticks, less the dead zone, heading and offset.
    for theta in [-3.0, -1.2, 0.0, 0.4, 2.0, 9.0] {
        for (roll, pitch) in [(0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.2, -0.35)] {
            let mut vehicle = plant(still(), theta);
            for _ in 0..steps_of(10.0) {
                vehicle.step(&Sticks::new(roll, pitch, 0.0, 0.5), true);
                vehicle.pose[pose::THETA] = theta;
            }
            let shrink = |u: f64| u.signum() * (u.abs() - 0.07).max(0.0);
            let u = Sticks::new(shrink(roll), shrink(pitch), 0.0, 0.5 - 0.12);
            let p = SVector::<f64, 4>::new(1.9, 0.89, 1.4, -0.06);
            let model = Kinematic.step(&Pose::new(0.0, 0.0, 0.0, theta), &u, &p, 1.0);
            let velocity = vehicle.velocity();
            for (got, expected) in [
                (velocity.x_mps, model[pose::X]),
                (velocity.y_mps, model[pose::Y]),
                (velocity.z_mps, model[pose::Z]),
            ] {
                assert!((got - expected).abs() < 1e-6, "{velocity:?} instead of {model}");
            }
        }
    }
}

#[test]
fn sticks_act_after_their_dead_time_to_the_step() {
    let mut vehicle = plant(still(), 0.0);
    let (mut first_h, mut first_v, mut first_yaw) = (None, None, None);
    for k in 0..50 {
        vehicle.step(&Sticks::new(0.0, 1.0, 1.0, 1.0), true);
        let velocity = vehicle.velocity();
        let note = |first: &mut Option<u32>, v: f64| {
            if v > 0.0 {
                first.get_or_insert(k);
            }
        };
        note(&mut first_h, velocity.x_mps);
        note(&mut first_v, velocity.z_mps);
        note(&mut first_yaw, velocity.yaw_radps);
    }
    // 0.32 s and 0.04 s are 16 and 2 whole steps; 0.19 s are 9.5: half of the stick acts in step 9.
    assert_eq!((first_h, first_v, first_yaw), (Some(16), Some(9), Some(2)));
}

#[test]
fn velocity_rises_to_63_percent_in_one_time_constant() {
    let mut vehicle = plant(still(), 0.06);
    // Within the acceleration limit: 1.9 * 0.33 / 0.64 = 0.98 m/s^2.
    for _ in 0..steps_of(0.32 + 0.64) {
        vehicle.step(&Sticks::new(0.0, 0.4, 0.0, 0.0), true);
    }
    let fraction = vehicle.velocity().x_mps / (1.9 * 0.33);
    let expected = 1.0 - (-1.0_f64).exp();
    assert!((fraction - expected).abs() < 1e-12, "{fraction} instead of {expected}");
}

#[test]
fn acceleration_never_exceeds_its_limit() {
    let mut vehicle = plant(still(), 0.0);
    let mut random = Random::new(4, Purpose::Start);
    let (mut before, mut largest) = (vehicle.velocity(), 0.0_f64);
    for k in 0..5000 {
        let roll = if k / 40 % 2 == 0 { 1.0 } else { -1.0 };
        vehicle.step(&Sticks::new(roll, random.between(-1.0, 1.0), 0.3, 0.0), true);
        let now = vehicle.velocity();
        largest =
            maximum(largest, (now.x_mps - before.x_mps).hypot(now.y_mps - before.y_mps) / DT_S);
        before = now;
    }
    assert!(largest <= 1.1 * (1.0 + 1e-12), "{largest} m/s^2");
    assert!(largest > 1.09, "the limit was never met: {largest} m/s^2");
}

#[test]
fn neutral_sticks_and_a_lost_link_let_the_velocity_decay() {
    let start = Velocity { x_mps: 0.5, y_mps: -0.2, z_mps: 0.1, yaw_radps: 0.4 };
    for (u, link_is_up) in [(Sticks::zeros(), true), (Sticks::new(1.0, 1.0, 1.0, 1.0), false)] {
        let params = PlantParams::try_from(still()).unwrap();
        let mut vehicle = Plant::new(params, Pose::zeros(), start, 1).unwrap();
        for _ in 0..steps_of(0.64) {
            vehicle.step(&u, link_is_up);
        }
        let fraction = vehicle.velocity().x_mps / start.x_mps;
        assert!((fraction - (-1.0_f64).exp()).abs() < 1e-12, "{fraction} left after one tau");
        for _ in 0..steps_of(20.0) {
            vehicle.step(&u, link_is_up);
        }
        let rest = vehicle.velocity();
        assert!(rest.x_mps.abs() + rest.z_mps.abs() + rest.yaw_radps.abs() < 1e-12, "{rest:?}");
    }
}

#[test]
fn the_disturbance_has_its_deviation_and_memory() {
    let mut vehicle = plant(NOMINAL, 0.0);
    // 8000 s are 6700 time constants; an estimate of the variance is good to 2.5 % (three
    // deviations: sqrt(2 / (T / tau)) times three is 5 %), of the deviation to half of it.
    let steps = 400_000;
    let lag = steps_of(DISTURBANCE_H_TAU_S);
    let mut x = Vec::with_capacity(steps);
    let mut square_z = 0.0;
    for _ in 0..steps {
        vehicle.step(&Sticks::zeros(), true);
        x.push(vehicle.velocity().x_mps);
        square_z += vehicle.velocity().z_mps.powi(2);
    }
    let square = x.iter().map(|v| v * v).sum::<f64>() / steps as f64;
    assert!((square.sqrt() / 0.05 - 1.0).abs() < 0.03, "horizontal sd {}", square.sqrt());
    let sd_z = (square_z / steps as f64).sqrt();
    assert!((sd_z / 0.02 - 1.0).abs() < 0.03, "vertical sd {sd_z}");
    let lagged = x.iter().zip(&x[lag..]).map(|(a, b)| a * b).sum::<f64>();
    let correlation = lagged / (steps - lag) as f64 / square;
    assert!((correlation - (-1.0_f64).exp()).abs() < 0.05, "{correlation} after one tau");
}

/// Poses over ten seconds of changing sticks, one second of them lost.
fn fly(mut vehicle: Plant) -> Vec<Pose> {
    (0..500)
        .map(|k| {
            let phase = 0.02 * f64::from(k);
            let u = Sticks::new(phase.sin(), (2.0 * phase).cos(), 0.5 * phase.cos(), phase.sin());
            vehicle.step(&(0.6 * u), !(200..260).contains(&k));
            *vehicle.pose()
        })
        .collect()
}

fn drawn_flight(seed: u64) -> Vec<Pose> {
    let nominal = PlantParams::try_from(NOMINAL).unwrap();
    let params = nominal.draw(&mut Random::new(seed, Purpose::Vehicle));
    let start = Pose::new(0.0, 0.0, 1.0, 0.0);
    fly(Plant::new(params, start, Velocity::default(), seed).unwrap())
}

/// Nine digits are written down; another platform's sine or logarithm changes the sixteenth.
fn assert_flown(flight: &[Pose], expected: [(usize, [f64; 4]); 3]) {
    for (k, expected) in expected {
        let gap = (flight[k] - Pose::from(expected)).norm();
        assert!(gap < 2e-9, "step {k}: {:?} is {gap:e} off", flight[k].as_slice());
    }
}

#[test]
fn the_same_seed_flies_the_same_bits() {
    let bits = |seed| -> Vec<u64> {
        drawn_flight(seed).iter().flat_map(|pose| pose.iter().map(|v| v.to_bits())).collect()
    };
    assert_eq!(bits(11), bits(11));
    assert_ne!(bits(11), bits(12));
}

#[test]
fn an_independent_program_flies_the_same_path() {
    // The equations written a second time, in Python with 64-bit floats.
    assert_flown(
        &fly(plant(still(), 0.5)),
        [
            (99, [0.824_826_616, -0.537_376_863, 1.674_991_645, 0.761_411_464]),
            (249, [1.815_244_915, -1.481_876_311, 1.955_727_655, 0.283_008_345]),
            (499, [3.239_542_787, -2.184_711_585, 2.521_799_293, 0.411_708_869]),
        ],
    );
}

#[test]
fn the_golden_flight_stays_where_it_was() {
    assert_flown(
        &drawn_flight(11),
        [
            (99, [0.303_926_564, -0.439_783_611, 1.348_098_824, 0.251_168_934]),
            (249, [0.663_569_001, -1.561_409_558, 1.666_017_669, -0.208_489_566]),
            (499, [1.663_912_910, -2.522_890_587, 2.242_614_246, -0.084_831_739]),
        ],
    );
}
