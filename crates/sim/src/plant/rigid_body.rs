//! A second vehicle: a rigid body with attitude and velocity loops.
//!
//! Owns what the fitted plant does not have: tilt that takes time and overshoots, an integrator in the
//! velocity loop, optical flow that is filtered and drifts, drag, wind, and motors that weaken with the
//! battery. No result of the controller may rest on a plant with the structure of its own model. Input
//! delay, dead zone, gains and direction of flight are those of [`PlantTable`].

use horizon_model::rows::{Pose, pose};
use horizon_model::setting::{SettingError, in_range, not_negative, positive};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{GRAVITY_MPS2, PlantTable, Velocity};
use crate::DT_S;
use crate::random::{Purpose, Random};

/// Steps of the integration within a step of the world.
const SUBSTEPS: u32 = 10;
/// Length of such a step. s
const H_S: f64 = DT_S / SUBSTEPS as f64;
/// Bandwidth of the loop of the vertical velocity. 1/s
const CLIMB_KP: f64 = 3.0;
/// Integral gain of that loop. 1/s^2
const CLIMB_KI: f64 = 2.0;
/// Largest change of the collective thrust, as a fraction of the weight. 1
const THRUST_MARGIN: f64 = 0.5;
/// Natural frequency of the yaw rate loop times the time constant of the yaw axis. 1
const YAW_STIFFNESS: f64 = 1.6;
/// Damping of the yaw rate loop. 1
const YAW_DAMPING: f64 = 0.7;

/// Numbers of the rigid body that the fitted plant does not have.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RigidBodyTable {
    /// Natural frequency of the attitude loop. rad/s, 2..=60
    pub attitude_radps: f64,
    /// Damping ratio of the attitude loop. 1, 0.1..=2
    pub attitude_damping: f64,
    /// Integral gain of the loop of the horizontal velocity; its proportional gain is `1 / tau_s` of
    /// `plant.horizontal`. 1/s^2, 0..=10
    pub velocity_ki: f64,
    /// Time constant of the filter of the optical flow. s, > 0
    pub flow_tau_s: f64,
    /// Standard deviation of the error of the optical flow, per axis. m/s, >= 0
    pub flow_drift_mps: f64,
    /// Correlation time of that error. s, > 0
    pub flow_drift_tau_s: f64,
    /// Linear drag by mass. 1/s, 0..=5
    pub drag_per_s: f64,
    /// Mean speed of the wind, whose direction each seed draws. m/s, >= 0
    pub wind_mps: f64,
    /// Standard deviation of the gusts, per axis. m/s, >= 0
    pub gust_mps: f64,
    /// Correlation time of the gusts. s, > 0
    pub gust_tau_s: f64,
    /// Time constant of the motors. s, > 0
    pub motor_tau_s: f64,
    /// Thrust that is lost in ten minutes of flight, as a fraction. 1, 0..=0.4
    pub sag: f64,
}

/// A small quadrotor indoors.
pub const RIGID_BODY: RigidBodyTable = RigidBodyTable {
    attitude_radps: 14.0,
    attitude_damping: 0.5,
    velocity_ki: 0.4,
    flow_tau_s: 0.06,
    flow_drift_mps: 0.04,
    flow_drift_tau_s: 10.0,
    drag_per_s: 0.25,
    wind_mps: 0.0,
    gust_mps: 0.1,
    gust_tau_s: 1.5,
    motor_tau_s: 0.05,
    sag: 0.15,
};

impl RigidBodyTable {
    /// # Errors
    /// The first value that breaks its rule.
    pub(super) fn check(&self) -> Result<(), SettingError> {
        in_range("attitude_radps", self.attitude_radps, 2.0..=60.0)?;
        in_range("attitude_damping", self.attitude_damping, 0.1..=2.0)?;
        in_range("velocity_ki", self.velocity_ki, 0.0..=10.0)?;
        positive("flow_tau_s", self.flow_tau_s)?;
        not_negative("flow_drift_mps", self.flow_drift_mps)?;
        positive("flow_drift_tau_s", self.flow_drift_tau_s)?;
        in_range("drag_per_s", self.drag_per_s, 0.0..=5.0)?;
        not_negative("wind_mps", self.wind_mps)?;
        not_negative("gust_mps", self.gust_mps)?;
        positive("gust_tau_s", self.gust_tau_s)?;
        positive("motor_tau_s", self.motor_tau_s)?;
        in_range("sag", self.sag, 0.0..=0.4)?;
        Ok(())
    }
}

/// Velocities that the inputs ask for, in the frame of the direction of flight.
#[derive(Debug, Clone, Copy)]
pub(super) struct VelocitySetpoint {
    /// Velocity forward. m/s
    pub(super) forward_mps: f64,
    /// Velocity to the right. m/s
    pub(super) right_mps: f64,
    /// Velocity upwards. m/s
    pub(super) climb_mps: f64,
    /// Yaw rate, counter-clockwise from above. rad/s
    pub(super) yaw_radps: f64,
}

/// Tilt towards one horizontal direction of the vehicle.
#[derive(Debug, Clone, Copy, Default)]
struct Tilt {
    angle_rad: f64,
    rate_radps: f64,
}

/// State of the rigid body beside pose and velocity. Components `fr`: forward, right, as the sticks have them, and
/// `fru`: up beside them; frame `w`: world x and y.
#[derive(Debug, Clone)]
pub(super) struct RigidBody {
    table: RigidBodyTable,
    random: Random,
    tilt: [Tilt; 2],
    yaw_accel_radps2: f64,
    /// Collective thrust by mass. m/s^2
    thrust_mps2: f64,
    /// Integrators of the velocity loops. m/s^2
    integral_fru_mps2: [f64; 3],
    /// Filtered velocity of the optical flow. m/s
    flow_fr_mps: [f64; 2],
    /// Error of the optical flow. m/s
    drift_fr_mps: [f64; 2],
    wind_w_mps: [f64; 2],
    gust_w_mps: [f64; 2],
    aloft_s: f64,
}

impl RigidBody {
    /// A body at hover. `seed` selects wind, gusts and the drift of the optical flow.
    pub(super) fn new(table: RigidBodyTable, seed: u64) -> Self {
        let mut random = Random::new(seed, Purpose::RigidBody);
        let (sin, cos) = random.between(0.0, std::f64::consts::TAU).sin_cos();
        let drift_fr_mps = [0, 1].map(|_| table.flow_drift_mps * random.normal());
        Self {
            random,
            tilt: [Tilt::default(); 2],
            yaw_accel_radps2: 0.0,
            thrust_mps2: GRAVITY_MPS2,
            integral_fru_mps2: [0.0; 3],
            flow_fr_mps: [0.0; 2],
            drift_fr_mps,
            wind_w_mps: [table.wind_mps * cos, table.wind_mps * sin],
            gust_w_mps: [0.0; 2],
            aloft_s: 0.0,
            table,
        }
    }

    /// At rest with level attitude; the battery stays as it is.
    pub(super) fn rest(&mut self) {
        self.tilt = [Tilt::default(); 2];
        self.yaw_accel_radps2 = 0.0;
        self.thrust_mps2 = GRAVITY_MPS2;
        self.integral_fru_mps2 = [0.0; 3];
        self.flow_fr_mps = [0.0; 2];
        self.gust_w_mps = [0.0; 2];
    }

    /// Error of the optical flow, world x and y, of a body that heads for `psi`. m/s
    pub(super) fn drift_w_mps(&self, psi: f64) -> [f64; 2] {
        let ((sin, cos), [forward_mps, right_mps]) = (psi.sin_cos(), self.drift_fr_mps);
        [cos * forward_mps + sin * right_mps, sin * forward_mps - cos * right_mps]
    }

    /// Flies one step of [`DT_S`] from pose `at` and velocity `v`, which it moves on (`docs/model.md`, section 1).
    ///
    /// | symbol | equation, steps of 2 ms |
    /// |--------|-------------------------|
    /// | `R`    | columns forward `(cos psi, sin psi)` and right `(sin psi, -cos psi)`, `psi = theta + theta_0` |
    /// | `m`    | `m' = (R^T v + b - m) / tau_flow`, `b` the drift |
    /// | `a_sp` | `(c - m) / tau_h + i`, norm at most `a_max`; `i' = k_i (c - m)` unless limited |
    /// | tilt   | `phi'' = w^2 (atan(a_sp / g) - phi) - 2 z w phi'` |
    /// | thrust | `T' = (e (g + l(3 (c_z - v_z) + i_z)) - T) / tau_motor`, exactly over a step; `e = max(1 - sag t / 600 s, 1/2)` |
    /// | `i_z`  | `i_z = l(i_z)`, `i_z' = 2 (c_z - v_z)`; `l` limits to `g / 2` |
    /// | `v'`   | `T R (sin phi_f cos phi_r, sin phi_r) - drag (v - wind)`; `z`: `T cos phi_f cos phi_r - g - drag v_z` |
    /// | yaw    | `omega'' = w^2 (c_a - omega) - 2 z w omega'`, `w = 1.6 / tau_a`, `z = 0.7` |
    /// | `wind` | constant, plus `gust`: `gust' = k gust + sd sqrt(1 - k^2) n`, `n ~ N(0, 1)`, `k = exp(-20 ms / tau_gust)` |
    /// | `b`    | likewise, with `flow_drift_mps` and `flow_drift_tau_s`; both once in 20 ms |
    pub(super) fn step(
        &mut self,
        plant: &PlantTable,
        setpoint: VelocitySetpoint,
        at: &mut Pose,
        v: &mut Velocity,
    ) {
        self.step_gusts();
        for _ in 0..SUBSTEPS {
            self.substep(plant, setpoint, at, v);
        }
        self.aloft_s += DT_S;
    }

    fn substep(
        &mut self,
        plant: &PlantTable,
        setpoint: VelocitySetpoint,
        at: &mut Pose,
        v: &mut Velocity,
    ) {
        let (sin, cos) = (at[pose::THETA] + plant.theta_0).sin_cos();
        let accel_fr_mps2 = self.accel_asked(plant, setpoint, [cos, sin], v);
        let w = self.table.attitude_radps;
        for (tilt, accel_mps2) in self.tilt.iter_mut().zip(accel_fr_mps2) {
            let target_rad = (accel_mps2 / GRAVITY_MPS2).atan();
            let damping = 2.0 * self.table.attitude_damping * w * tilt.rate_radps;
            tilt.rate_radps += H_S * (w * w * (target_rad - tilt.angle_rad) - damping);
            tilt.angle_rad += H_S * tilt.rate_radps;
        }
        self.collective(setpoint.climb_mps - v.z_mps);

        let [(sin_f, cos_f), (sin_r, cos_r)] = self.tilt.map(|tilt| tilt.angle_rad.sin_cos());
        let (forward, right) = (self.thrust_mps2 * sin_f * cos_r, self.thrust_mps2 * sin_r);
        let [air_x_mps, air_y_mps] =
            [pose::X, pose::Y].map(|axis| self.wind_w_mps[axis] + self.gust_w_mps[axis]);
        let drag = self.table.drag_per_s;
        v.x_mps += H_S * (cos * forward + sin * right - drag * (v.x_mps - air_x_mps));
        v.y_mps += H_S * (sin * forward - cos * right - drag * (v.y_mps - air_y_mps));
        let up_mps2 = self.thrust_mps2 * cos_f * cos_r - GRAVITY_MPS2;
        v.z_mps += H_S * (up_mps2 - drag * v.z_mps);

        let w_yaw = YAW_STIFFNESS / plant.yaw.tau_s;
        let error_radps = setpoint.yaw_radps - v.yaw_radps;
        let damping = 2.0 * YAW_DAMPING * w_yaw * self.yaw_accel_radps2;
        self.yaw_accel_radps2 += H_S * (w_yaw * w_yaw * error_radps - damping);
        v.yaw_radps += H_S * self.yaw_accel_radps2;

        at[pose::X] += H_S * v.x_mps;
        at[pose::Y] += H_S * v.y_mps;
        at[pose::Z] = (at[pose::Z] + H_S * v.z_mps).max(0.0);
        at[pose::THETA] += H_S * v.yaw_radps;
    }

    /// Horizontal acceleration that the velocity loop asks for: forward, right. m/s^2
    fn accel_asked(
        &mut self,
        plant: &PlantTable,
        setpoint: VelocitySetpoint,
        [cos, sin]: [f64; 2],
        v: &Velocity,
    ) -> [f64; 2] {
        let seen_fr_mps = [cos * v.x_mps + sin * v.y_mps, sin * v.x_mps - cos * v.y_mps];
        let target_fr_mps = [setpoint.forward_mps, setpoint.right_mps];
        let mut accel_fr_mps2 = [0.0; 2];
        let mut error_fr_mps = [0.0; 2];
        for axis in 0..2 {
            let measured = seen_fr_mps[axis] + self.drift_fr_mps[axis];
            self.flow_fr_mps[axis] +=
                H_S / self.table.flow_tau_s * (measured - self.flow_fr_mps[axis]);
            error_fr_mps[axis] = target_fr_mps[axis] - self.flow_fr_mps[axis];
            let proportional = error_fr_mps[axis] / plant.horizontal.tau_s;
            accel_fr_mps2[axis] = proportional + self.integral_fru_mps2[axis];
        }
        let [forward_mps2, right_mps2] = accel_fr_mps2;
        let scale = (plant.accel_max_mps2 / forward_mps2.hypot(right_mps2)).min(1.0);
        if scale >= 1.0 {
            for (integral, error) in self.integral_fru_mps2.iter_mut().zip(error_fr_mps) {
                *integral += H_S * self.table.velocity_ki * error;
            }
        }
        accel_fr_mps2.map(|accel| scale * accel)
    }

    /// Moves the thrust towards what the vertical velocity loop asks for.
    fn collective(&mut self, error_mps: f64) {
        let [_, _, integral_mps2] = &mut self.integral_fru_mps2;
        let margin_mps2 = THRUST_MARGIN * GRAVITY_MPS2;
        *integral_mps2 =
            (*integral_mps2 + H_S * CLIMB_KI * error_mps).clamp(-margin_mps2, margin_mps2);
        let change = (CLIMB_KP * error_mps + *integral_mps2).clamp(-margin_mps2, margin_mps2);
        let strength = (1.0 - self.table.sag * self.aloft_s / 600.0).max(0.5);
        let target_mps2 = strength * (GRAVITY_MPS2 + change);
        let fraction = 1.0 - (-H_S / self.table.motor_tau_s).exp();
        self.thrust_mps2 += fraction * (target_mps2 - self.thrust_mps2);
    }

    /// One step of gusts and of the drift of the optical flow: Ornstein-Uhlenbeck processes.
    fn step_gusts(&mut self) {
        let RigidBodyTable { gust_mps, gust_tau_s, flow_drift_mps, flow_drift_tau_s, .. } =
            self.table;
        for (values, sd, tau_s) in [
            (&mut self.gust_w_mps, gust_mps, gust_tau_s),
            (&mut self.drift_fr_mps, flow_drift_mps, flow_drift_tau_s),
        ] {
            let keep = (-DT_S / tau_s).exp();
            let noise_sd = sd * (1.0 - keep * keep).sqrt();
            for value in values {
                *value = keep * *value + noise_sd * self.random.normal();
            }
        }
    }
}

#[cfg(test)]
mod tests;
