use horizon_model::check::maximum;
use horizon_model::rows::Sticks;

use super::super::tests::{plant, steps_of};
use super::super::{NOMINAL, Plant, PlantParams};
use super::*;

/// The rigid body without anything that is drawn.
fn calm_body() -> PlantTable {
    let body = RigidBodyTable { flow_drift_mps: 0.0, gust_mps: 0.0, ..RIGID_BODY };
    PlantTable { rigid_body: Some(body), ..NOMINAL }
}

#[test]
fn a_rigid_body_reaches_the_velocity_that_is_asked_for() {
    let mut vehicle = plant(calm_body(), 0.06);
    for _ in 0..steps_of(25.0) {
        vehicle.step(&Sticks::new(-0.2, 0.4, 0.0, 0.0), true);
    }
    let Velocity { x_mps, y_mps, z_mps, .. } = vehicle.velocity();
    // psi = 0: forward is +x, right is -y; the integrator takes off the drag.
    let (asked_x, asked_y) = (1.9 * (0.4 - 0.07), 1.9 * (0.2 - 0.07));
    assert!((x_mps - asked_x).abs() < 0.01 * asked_x, "{x_mps} instead of {asked_x}");
    assert!((y_mps - asked_y).abs() < 0.01 * asked_x, "{y_mps} instead of {asked_y}");
    // The integrator follows the thrust that sags by 0.15 g in 600 s with a gain of 2/s^2.
    assert!((z_mps + 0.15 * 9.81 / 600.0 / 2.0).abs() < 2e-4, "{z_mps}");
}

#[test]
fn a_rigid_body_with_a_quick_velocity_loop_overshoots() {
    let mut table = calm_body();
    table.horizontal.tau_s = 0.2;
    let mut vehicle = plant(table, 0.06);
    let asked_mps = 1.9 * (0.3 - 0.07);
    let mut fastest_mps = 0.0_f64;
    for _ in 0..steps_of(5.0) {
        vehicle.step(&Sticks::new(0.0, 0.3, 0.0, 0.0), true);
        fastest_mps = maximum(fastest_mps, vehicle.velocity().x_mps);
    }
    assert!(fastest_mps > 1.05 * asked_mps, "{fastest_mps} of {asked_mps} m/s");
}

#[test]
fn a_rigid_body_is_late_by_the_dead_time_and_accelerates_within_its_limit() {
    let mut vehicle = plant(calm_body(), -0.2);
    let mut before = vehicle.velocity();
    for k in 0..steps_of(3.0) {
        vehicle.step(&Sticks::new(0.6, 1.0, 0.0, 0.0), true);
        let now = vehicle.velocity();
        let accel_mps2 = (now.x_mps - before.x_mps).hypot(now.y_mps - before.y_mps) / DT_S;
        // The attitude overshoots by the factor of a damping of 0.5.
        assert!(accel_mps2 < 1.2 * NOMINAL.accel_max_mps2, "step {k}: {accel_mps2} m/s^2");
        if k < steps_of(0.3) {
            assert!(now.x_mps.hypot(now.y_mps) < 1e-9, "step {k}: {now:?}");
        }
        before = now;
    }
    assert!(before.x_mps.hypot(before.y_mps) > 1.0, "{before:?}");
}

#[test]
fn wind_carries_a_rigid_body_until_its_integrator_holds_it_and_sag_does_not_let_it_fall() {
    let body = RigidBodyTable { wind_mps: 1.0, sag: 0.4, ..calm_body().rigid_body.unwrap() };
    let mut vehicle = plant(PlantTable { rigid_body: Some(body), ..NOMINAL }, 0.0);
    let start = *vehicle.pose();
    let mut fastest_mps = 0.0_f64;
    for _ in 0..steps_of(60.0) {
        vehicle.step(&Sticks::zeros(), true);
        let Velocity { x_mps, y_mps, .. } = vehicle.velocity();
        fastest_mps = maximum(fastest_mps, x_mps.hypot(y_mps));
    }
    let Velocity { x_mps, y_mps, .. } = vehicle.velocity();
    assert!(fastest_mps > 0.05, "no wind: {fastest_mps} m/s");
    assert!(x_mps.hypot(y_mps) < 0.01, "{x_mps}, {y_mps}");
    let fell_m = start[pose::Z] - vehicle.pose()[pose::Z];
    // A sag of 0.4 g in 600 s sinks it by 3.3 mm/s.
    assert!((fell_m - 60.0 * 0.4 * 9.81 / 600.0 / 2.0).abs() < 0.02, "{fell_m} m");
}

#[test]
fn numbers_of_a_rigid_body_are_checked_and_equal_seeds_fly_equally() {
    let bad = RigidBodyTable { attitude_damping: 0.0, ..RIGID_BODY };
    let error = PlantParams::try_from(PlantTable { rigid_body: Some(bad), ..NOMINAL }).unwrap_err();
    assert_eq!(error.key, "rigid_body.attitude_damping");
    let fly = |seed: u64| {
        let params = PlantParams::try_from(PlantTable { rigid_body: Some(RIGID_BODY), ..NOMINAL });
        let at = Pose::new(0.0, 0.0, 1.0, 0.0);
        let mut vehicle = Plant::new(params.unwrap(), at, Velocity::default(), seed).unwrap();
        for _ in 0..100 {
            vehicle.step(&Sticks::new(0.1, 0.3, -0.2, 0.2), true);
        }
        *vehicle.pose()
    };
    assert_eq!(fly(7), fly(7));
    assert_ne!(fly(7), fly(8));
}

/// A calm body by itself.
fn alone() -> RigidBody {
    RigidBody::new(calm_body().rigid_body.unwrap(), 1)
}

const HOVER: VelocitySetpoint =
    VelocitySetpoint { forward_mps: 0.0, right_mps: 0.0, climb_mps: 0.0, yaw_radps: 0.0 };

#[test]
fn a_velocity_loop_at_its_limit_does_not_wind_up() {
    let mut body = alone();
    let (cos_sin, still) = ([1.0, 0.0], Velocity::default());
    let fast = VelocitySetpoint { forward_mps: 3.0, right_mps: -4.0, ..HOVER };
    for _ in 0..100 {
        let [forward, right] = body.accel_asked(&NOMINAL, fast, cos_sin, &still);
        // Along the direction that is asked for, 3 to -4.
        assert!(
            (forward.hypot(right) - NOMINAL.accel_max_mps2).abs() < 1e-12,
            "{forward}, {right}"
        );
        assert!((4.0 * forward + 3.0 * right).abs() < 1e-12, "{forward}, {right}");
    }
    assert_eq!(body.integral_fru_mps2.map(f64::to_bits), [0; 3]);
    let slow = VelocitySetpoint { forward_mps: 0.1, ..HOVER };
    for _ in 0..100 {
        body.accel_asked(&NOMINAL, slow, cos_sin, &still);
    }
    // 0.4 / s^2 of 0.1 m/s over 0.2 s.
    assert!(
        (body.integral_fru_mps2[0] - 0.4 * 0.1 * 0.2).abs() < 1e-12,
        "{:?}",
        body.integral_fru_mps2
    );
    body.rest();
    assert_eq!(body.integral_fru_mps2.map(f64::to_bits), [0; 3]);
}

#[test]
fn the_velocity_loop_sees_the_velocity_in_the_direction_of_flight() {
    // Facing +y, a velocity along -x is to the left.
    let mut body = alone();
    let v = Velocity { x_mps: -0.2, ..Velocity::default() };
    for _ in 0..1000 {
        body.accel_asked(&NOMINAL, HOVER, [0.0, 1.0], &v);
    }
    // After 33 time constants of its filter the flow is the velocity.
    let [forward, right] = body.flow_fr_mps;
    assert!(forward.abs() < 1e-12 && (right + 0.2).abs() < 1e-9, "{forward}, {right}");
}

#[test]
fn the_thrust_stays_within_half_the_weight_of_hovering() {
    for (error_mps, limit) in [(100.0, 1.5), (-100.0, 0.5)] {
        let mut body = alone();
        for _ in 0..1000 {
            body.collective(error_mps);
        }
        let ratio = body.thrust_mps2 / GRAVITY_MPS2;
        assert!((ratio - limit).abs() < 1e-9, "{ratio} g");
    }
}

#[test]
fn gusts_have_their_deviation_and_memory() {
    let table = RigidBodyTable { gust_mps: 0.3, gust_tau_s: 0.2, ..RIGID_BODY };
    let mut body = RigidBody::new(table, 4);
    let gusts: Vec<f64> = (0..200_000)
        .map(|_| {
            body.step_gusts();
            body.gust_w_mps[1]
        })
        .collect();
    let square = gusts.iter().map(|gust| gust * gust).sum::<f64>() / gusts.len() as f64;
    // 20 000 correlation times: an estimate of the deviation is good to 0.5 %.
    assert!((square.sqrt() / 0.3 - 1.0).abs() < 0.02, "{}", square.sqrt());
    let lagged: f64 = gusts.iter().zip(&gusts[10..]).map(|(a, b)| a * b).sum();
    let correlation = lagged / gusts.len() as f64 / square;
    assert!((correlation - (-1.0_f64).exp()).abs() < 0.03, "{correlation} after 0.2 s");
}
