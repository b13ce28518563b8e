//! The vehicle that the simulator flies.
//!
//! Owns the plant fitted to real flights: dead time, dead zone, first-order velocity lag in the world
//! frame, acceleration limit and a wandering disturbance velocity; and, by a setting, a rigid body
//! behind the same dead time and dead zone. It is deliberately not a
//! [`horizon_model::Model`]: its motion must not use code of the controller. Dead times are those of [`InputFifo`],
//! which its own tests hold. What is on the wire, on the ground or in the measurement is not known here.

mod params;
mod rigid_body;
mod variation;

use horizon_model::rows::{Pose, Sticks, pose, stick};
use horizon_model::setting::SettingError;
use horizon_model::{InputFifo, Kinematic, Model};

use crate::DT_S;
use crate::random::{Purpose, Random};

pub use params::{AxisTable, NOMINAL, PlantParams, PlantTable};
pub use rigid_body::{RIGID_BODY, RigidBodyTable};
use rigid_body::{RigidBody, VelocitySetpoint};
pub use variation::{UNVARIED, VariationTable};

/// Height of the markers of a drone that stands on the floor. m
pub const STANDING_M: f64 = 0.05;

/// Time in which the horizontal disturbance velocity forgets. s
const DISTURBANCE_H_TAU_S: f64 = 1.2;
/// Time in which the vertical disturbance velocity forgets. s
const DISTURBANCE_V_TAU_S: f64 = 1.0;

/// Standard gravity. m/s^2
const GRAVITY_MPS2: f64 = 9.806_65;

/// The vehicle does not follow sticks further down than this. m
const FLOOR_M: f64 = 0.28;

/// Velocity of the vehicle in the world frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Velocity {
    /// Along world x. m/s
    pub x_mps: f64,
    /// Along world y. m/s
    pub y_mps: f64,
    /// Upwards. m/s
    pub z_mps: f64,
    /// Counter-clockwise from above. rad/s
    pub yaw_radps: f64,
}

/// The vehicle of one flight.
#[derive(Debug, Clone)]
pub struct Plant {
    params: PlantParams,
    factors: Factors,
    fifo: InputFifo<{ stick::COUNT }>,
    random: Random,
    pose: Pose,
    /// Velocity driven by the sticks.
    driven: Velocity,
    /// Disturbance velocity; its yaw rate stays zero. None for a rigid body.
    disturbance: Velocity,
    /// The second structure, in place of the first-order lags.
    rigid_body: Option<RigidBody>,
    external: External,
}

/// External action on the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) enum External {
    /// Nothing.
    #[default]
    None,
    /// The vehicle moves with this velocity, whatever its inputs.
    Held {
        /// World x, y, z. m/s
        velocity_w_mps: [f64; 3],
    },
    /// The vehicle is carried on with this velocity.
    Pushed {
        /// World x, y, z. m/s
        velocity_w_mps: [f64; 3],
    },
}

/// Constants of a step, computed once from the parameters.
#[derive(Debug, Clone, Copy)]
struct Factors {
    /// Fraction of the way to its target that each velocity covers in a step. 1
    horizontal: f64,
    vertical: f64,
    yaw: f64,
    /// Fraction of the disturbance that stays, and standard deviation of what is added. 1, m/s
    keep_h: f64,
    noise_sd_h: f64,
    keep_v: f64,
    noise_sd_v: f64,
}

impl Factors {
    fn new(table: &PlantTable) -> Self {
        let approach = |tau_s: f64| 1.0 - (-DT_S / tau_s).exp();
        let (keep_h, keep_v) =
            ((-DT_S / DISTURBANCE_H_TAU_S).exp(), (-DT_S / DISTURBANCE_V_TAU_S).exp());
        Self {
            horizontal: approach(table.horizontal.tau_s),
            vertical: approach(table.vertical.tau_s),
            yaw: approach(table.yaw.tau_s),
            keep_h,
            noise_sd_h: table.disturbance_h_mps * (1.0 - keep_h * keep_h).sqrt(),
            keep_v,
            noise_sd_v: table.disturbance_v_mps * (1.0 - keep_v * keep_v).sqrt(),
        }
    }
}

impl External {
    /// Its own velocity. m/s
    fn velocity_w_mps(self) -> [f64; 3] {
        match self {
            Self::None => [0.0; 3],
            Self::Held { velocity_w_mps } | Self::Pushed { velocity_w_mps } => velocity_w_mps,
        }
    }
}

impl Plant {
    /// A vehicle at `pose` (world frame, m and rad) with velocity `driven`, hovering under neutral sticks so far.
    ///
    /// `seed` selects the disturbance. The disturbance starts at zero.
    ///
    /// # Errors
    /// A dead time that [`InputFifo`] refuses.
    pub fn new(
        params: PlantParams,
        pose: Pose,
        driven: Velocity,
        seed: u64,
    ) -> Result<Self, SettingError> {
        Ok(Self {
            fifo: InputFifo::new(&params.dead_times_s(), &Kinematic::INPUT, DT_S)?,
            random: Random::new(seed, Purpose::Disturbance),
            rigid_body: params.0.rigid_body.map(|table| RigidBody::new(table, seed)),
            factors: Factors::new(&params.0),
            params,
            pose,
            driven,
            disturbance: Velocity::default(),
            external: External::None,
        })
    }

    /// From the next step on `external` acts on the vehicle.
    pub(crate) fn set_external(&mut self, external: External) {
        self.external = external;
    }

    /// Flies one step of [`DT_S`] with the sticks `u_sent`, which count as neutral while the link is
    /// down (`docs/model.md`, section 1).
    ///
    /// | symbol  | equation |
    /// |---------|----------|
    /// | `u`     | sent sticks one dead time `D` ago, per axis, linear between steps |
    /// | `n(u)`  | `sign(u) max(abs(u) - dead, 0)` |
    /// | `psi`   | `theta + theta_0` |
    /// | `c`     | `lambda_h (cos psi n(pitch) + sin psi n(roll), sin psi n(pitch) - cos psi n(roll))` |
    /// | `v'`    | `v + (1 - exp(-dt / tau_h)) (c - v)`, the change limited to `a_max dt` |
    /// | `v_z'`  | `v_z + (1 - exp(-dt / tau_v)) (lambda_v n(throttle) - v_z)` |
    /// | `omega'`| `omega + (1 - exp(-dt / tau_a)) (lambda_a n(yaw) - omega)` |
    /// | `d'`    | `keep d + sqrt(1 - keep^2) N(0, sd^2)`, `keep = exp(-dt / tau_d)` |
    /// | pose    | `x' = x + dt (v' + d')`, `theta' = theta + dt omega'` |
    ///
    /// Allocates nothing.
    pub fn step(&mut self, u_sent: &Sticks, link_is_up: bool) {
        self.fifo.push(&if link_is_up { *u_sent } else { Sticks::zeros() });
        let u_applied = self.fifo.applied(-1);
        let mut climb_mps = self.params.0.vertical.answer(u_applied[stick::THROTTLE]);
        if self.pose[pose::Z] < FLOOR_M {
            climb_mps = climb_mps.max(0.0);
        }
        self.fly(&u_applied, climb_mps);
    }

    /// Flies one step by itself, as while taking off and landing: sticks neutral, climbing towards
    /// `climb_mps`, upwards. m/s
    pub(crate) fn step_automatic(&mut self, climb_mps: f64) {
        self.fifo.push(&Sticks::zeros());
        self.fly(&Sticks::zeros(), climb_mps);
    }

    /// Flies one step of a landing in which the sticks `u_sent` (1) stay applied horizontally and in yaw, climbing
    /// towards `climb_mps`, which is negative. m/s
    pub(crate) fn step_sinking(&mut self, u_sent: &Sticks, climb_mps: f64) {
        self.fifo.push(u_sent);
        let u_applied = self.fifo.applied(-1);
        self.fly(&u_applied, climb_mps);
    }

    /// Falls for one step, without drag: from the heights of a room it hardly matters.
    pub(crate) fn step_falling(&mut self) {
        self.fifo.push(&Sticks::zeros());
        let before = self.pose;
        self.driven.z_mps -= GRAVITY_MPS2 * DT_S;
        self.integrate();
        self.act_from_outside(before);
    }

    /// Stands on the floor for one step.
    pub(crate) fn step_grounded(&mut self) {
        self.fifo.push(&Sticks::zeros());
        self.pose[pose::Z] = STANDING_M;
        self.external = External::None;
        self.rest();
    }

    /// True pose, world frame; the heading is continuous. m, rad
    pub fn pose(&self) -> &Pose {
        &self.pose
    }

    /// True velocity.
    pub fn velocity(&self) -> Velocity {
        let Velocity { x_mps, y_mps, z_mps, yaw_radps } = self.flown();
        let [push_x_mps, push_y_mps, push_z_mps] = self.external.velocity_w_mps();
        Velocity {
            x_mps: x_mps + push_x_mps,
            y_mps: y_mps + push_y_mps,
            z_mps: z_mps + push_z_mps,
            yaw_radps,
        }
    }

    /// By how much the velocity that the drone measures itself, and holds its place by, differs from the true one,
    /// world x and y. m/s
    pub(crate) fn own_error_w_mps(&self) -> [f64; 2] {
        match &self.rigid_body {
            Some(body) => body.drift_w_mps(self.pose[pose::THETA] + self.params.0.theta_0),
            None => [-self.disturbance.x_mps, -self.disturbance.y_mps],
        }
    }

    /// Velocity without a push.
    fn flown(&self) -> Velocity {
        Velocity {
            x_mps: self.driven.x_mps + self.disturbance.x_mps,
            y_mps: self.driven.y_mps + self.disturbance.y_mps,
            z_mps: self.driven.z_mps + self.disturbance.z_mps,
            yaw_radps: self.driven.yaw_radps,
        }
    }

    /// Dead time of the horizontal sticks and largest horizontal acceleration. s, m/s^2
    pub fn limits(&self) -> (f64, f64) {
        (self.params.0.horizontal.dead_time_s, self.params.0.accel_max_mps2)
    }

    /// Full deflection along the unit vector (`x_w`, `y_w`) of the world, at the measured heading `theta`.
    pub fn sticks_towards(&self, theta: f64, [x_w, y_w]: [f64; 2]) -> Sticks {
        let (sin, cos) = (theta + self.params.0.theta_0).sin_cos();
        let mut u = Sticks::zeros();
        u[stick::PITCH] = cos * x_w + sin * y_w;
        u[stick::ROLL] = sin * x_w - cos * y_w;
        u
    }

    /// One step with the applied sticks and the climb that is asked for.
    fn fly(&mut self, u_applied: &Sticks, climb_mps: f64) {
        let before = self.pose;
        if let Some(body) = &mut self.rigid_body {
            let PlantTable { horizontal, yaw, .. } = self.params.0;
            let setpoint = VelocitySetpoint {
                forward_mps: horizontal.answer(u_applied[stick::PITCH]),
                right_mps: horizontal.answer(u_applied[stick::ROLL]),
                climb_mps,
                yaw_radps: yaw.answer(u_applied[stick::YAW]),
            };
            body.step(&self.params.0, setpoint, &mut self.pose, &mut self.driven);
        } else {
            self.drive(u_applied, climb_mps);
            self.wander();
            self.integrate();
        }
        self.act_from_outside(before);
    }

    /// One step of what acts from outside on the vehicle, which flew here from `before`.
    fn act_from_outside(&mut self, before: Pose) {
        match self.external {
            External::None => return,
            External::Held { .. } => {
                self.pose = before;
                self.rest();
            }
            External::Pushed { .. } => {}
        }
        let velocity_w_mps = self.external.velocity_w_mps();
        for (axis, v_mps) in [pose::X, pose::Y, pose::Z].into_iter().zip(velocity_w_mps) {
            self.pose[axis] += DT_S * v_mps;
        }
        self.pose[pose::Z] = self.pose[pose::Z].max(0.0);
    }

    /// Neither speed nor tilt.
    fn rest(&mut self) {
        self.driven = Velocity::default();
        self.disturbance = Velocity::default();
        if let Some(body) = &mut self.rigid_body {
            body.rest();
        }
    }

    /// Moves the driven velocity towards what the applied sticks ask for.
    fn drive(&mut self, u_applied: &Sticks, climb_mps: f64) {
        let PlantTable { horizontal, yaw, theta_0, accel_max_mps2, .. } = self.params.0;
        let (sin, cos) = (self.pose[pose::THETA] + theta_0).sin_cos();
        let forward_mps = horizontal.answer(u_applied[stick::PITCH]);
        let right_mps = horizontal.answer(u_applied[stick::ROLL]);
        let fraction = self.factors.horizontal;
        let dx = fraction * (cos * forward_mps + sin * right_mps - self.driven.x_mps);
        let dy = fraction * (sin * forward_mps - cos * right_mps - self.driven.y_mps);
        let scale = (accel_max_mps2 * DT_S / dx.hypot(dy)).min(1.0);
        self.driven.x_mps += scale * dx;
        self.driven.y_mps += scale * dy;
        self.driven.z_mps += self.factors.vertical * (climb_mps - self.driven.z_mps);
        let turn_radps = yaw.answer(u_applied[stick::YAW]);
        self.driven.yaw_radps += self.factors.yaw * (turn_radps - self.driven.yaw_radps);
    }

    /// One step of the disturbance, an Ornstein-Uhlenbeck process.
    fn wander(&mut self) {
        let Factors { keep_h, noise_sd_h, keep_v, noise_sd_v, .. } = self.factors;
        self.disturbance.x_mps =
            keep_h * self.disturbance.x_mps + noise_sd_h * self.random.normal();
        self.disturbance.y_mps =
            keep_h * self.disturbance.y_mps + noise_sd_h * self.random.normal();
        self.disturbance.z_mps =
            keep_v * self.disturbance.z_mps + noise_sd_v * self.random.normal();
    }

    fn integrate(&mut self) {
        let velocity = self.flown();
        self.pose[pose::X] += DT_S * velocity.x_mps;
        self.pose[pose::Y] += DT_S * velocity.y_mps;
        // The floor holds what would sink below it.
        self.pose[pose::Z] = (self.pose[pose::Z] + DT_S * velocity.z_mps).max(0.0);
        self.pose[pose::THETA] += DT_S * velocity.yaw_radps;
    }
}

#[cfg(test)]
mod tests;
