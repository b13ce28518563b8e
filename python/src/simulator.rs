//! Many simulated drones step by step, and the controllers that can steer them.

use std::sync::{Mutex, PoisonError};

use horizon_model::rows::{Pose, Sticks, pose, stick};
use horizon_model::setting::SettingError;
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use tello_flight::Sighting;
use tello_flight::cycle::{self, FlightTable, Inbox, Operator, Outcome, Tick, Unwatched};
use tello_flight::drone::DroneStatus;
use tello_flight::time::{SpanNs, TimeNs};
use tello_io::clock::TimeOfDay;
use tello_io::tello::protocol::HostPacket;
use tello_sim::{DT_S, MocapReport, SimTable, Truth, World};

use crate::{TelloError, array, raised};

/// Drones or controllers that a thread takes at a time.
pub(crate) const CHUNK: usize = 64;

/// Ticks between two reports of a drone.
const STATUS_EVERY: u64 = 5;

/// Time of day in stick packets, which the simulated drone ignores.
const MIDNIGHT: TimeOfDay = TimeOfDay { hour: 0, minute: 0, second: 0, millisecond: 0 };

/// Observations of all drones after a step: measured poses, their ages, true poses, true velocities, whether commands
/// arrive.
pub(crate) type Seen<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<bool>>,
);

/// See `tello_ctl.Simulators`.
#[pyclass(module = "tello_ctl", subclass)]
pub(crate) struct Simulators {
    table: SimTable,
    drones: Vec<Drone>,
}

/// One drone and what motion capture reported of it last.
#[derive(Clone)]
pub(crate) struct Drone {
    world: World,
    measured: Pose,
    age_steps: u32,
}

/// Observation of one drone after a step.
#[derive(Clone, Copy)]
pub(crate) struct Shown {
    measured: Pose,
    age_s: f64,
    pose: Pose,
    /// World frame. m/s, rad/s
    velocity_w: Pose,
    link_is_up: bool,
}

impl Drone {
    pub(crate) fn new(table: &SimTable, seed: u64) -> Result<Self, SettingError> {
        let world = World::new(table, seed)?;
        let measured = world.truth().pose;
        let mut drone = Self { world, measured, age_steps: 0 };
        drone.measure();
        Ok(drone)
    }

    pub(crate) fn step(&mut self, u: Sticks) {
        self.world.receive(&HostPacket::Sticks { u, is_fast: false, time: MIDNIGHT });
        self.world.advance();
        self.measure();
    }

    /// Takes the newest pose, if there is one.
    fn measure(&mut self) {
        match self.world.report() {
            MocapReport::Pose(pose) => (self.measured, self.age_steps) = (pose, 0),
            MocapReport::Lost | MocapReport::Silent => {
                self.age_steps = self.age_steps.saturating_add(1);
            }
        }
    }

    /// The newest measured pose.
    pub(crate) fn measured(&self) -> Pose {
        self.measured
    }

    /// How old the newest measured pose is. s
    pub(crate) fn age_s(&self) -> f64 {
        f64::from(self.age_steps) * DT_S
    }

    /// The drone as it really is.
    pub(crate) fn truth(&self) -> Truth {
        self.world.truth()
    }

    pub(crate) fn shown(&self) -> Shown {
        let Truth { pose, velocity: v, link_is_up, .. } = self.truth();
        let velocity_w = Pose::new(v.x_mps, v.y_mps, v.z_mps, v.yaw_radps);
        Shown { measured: self.measured, age_s: self.age_s(), pose, velocity_w, link_is_up }
    }
}

/// Observations of all drones, as arrays.
pub(crate) fn seen<'py>(py: Python<'py>, shown: &[Shown]) -> PyResult<Seen<'py>> {
    let poses = |of: fn(&Shown) -> &Pose| {
        let rows: Vec<f64> = shown.iter().flat_map(|shown| of(shown).iter().copied()).collect();
        array::owned(py, pose::COUNT, rows)
    };
    Ok((
        poses(|shown| &shown.measured)?,
        PyArray1::from_iter(py, shown.iter().map(|shown| shown.age_s)),
        poses(|shown| &shown.pose)?,
        poses(|shown| &shown.velocity_w)?,
        PyArray1::from_iter(py, shown.iter().map(|shown| shown.link_is_up)),
    ))
}

#[pymethods]
#[expect(clippy::needless_pass_by_value, reason = "arguments come from Python by value")]
impl Simulators {
    #[new]
    #[pyo3(signature = (seeds, settings))]
    fn new(seeds: Vec<u64>, settings: &str) -> PyResult<Self> {
        let table: SimTable = crate::settings::merged(
            "settings",
            &tello_sim::settings(None).map_err(raised)?,
            settings,
        )?;
        if seeds.is_empty() {
            return Err(TelloError::new_err("seeds: expected at least one"));
        }
        let drones = seeds.iter().map(|seed| Drone::new(&table, *seed));
        let drones = drones.collect::<Result<_, _>>().map_err(raised)?;
        Ok(Self { table, drones })
    }

    /// Starts the drones at these positions anew, each with its seed.
    fn reset<'py>(
        &mut self,
        py: Python<'py>,
        drones: Vec<usize>,
        seeds: Vec<u64>,
    ) -> PyResult<Seen<'py>> {
        if drones.len() != seeds.len() {
            let message = format!("seeds: expected {} values, given {}", drones.len(), seeds.len());
            return Err(TelloError::new_err(message));
        }
        for (position, seed) in drones.into_iter().zip(seeds) {
            let count = self.drones.len();
            let Some(drone) = self.drones.get_mut(position) else {
                let message = format!("drones: expected numbers below {count}, given {position}");
                return Err(TelloError::new_err(message));
            };
            *drone = Drone::new(&self.table, seed).map_err(raised)?;
        }
        self.observe(py)
    }

    /// Flies one period of 20 ms with these sticks, one row per drone.
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        sticks: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Seen<'py>> {
        let sticks = array::fixed_rows("sticks", &sticks, self.drones.len())?;
        let drones = &mut self.drones;
        let step = |(drone, u): (&mut Drone, &Sticks)| {
            drone.step(u.map(|u| u.clamp(-1.0, 1.0)));
            drone.shown()
        };
        let shown: Vec<Shown> = py.detach(|| {
            let steps = drones.par_iter_mut().zip(sticks.par_iter()).with_min_len(CHUNK);
            steps.map(step).collect()
        });
        seen(py, &shown)
    }

    /// Observations after the last step.
    fn observe<'py>(&self, py: Python<'py>) -> PyResult<Seen<'py>> {
        let shown = |drone: &Drone| drone.shown();
        let drones = self.drones.par_iter().with_min_len(CHUNK);
        let shown: Vec<Shown> = py.detach(|| drones.map(shown).collect());
        seen(py, &shown)
    }

    fn __len__(&self) -> usize {
        self.drones.len()
    }
}

/// See `tello_ctl.Controllers`.
#[pyclass(module = "tello_ctl", subclass)]
pub(crate) struct Controllers {
    flight: FlightTable,
    controllers: Vec<Controller>,
}

/// One controller of the flight program, in virtual time.
struct Controller {
    /// Used by one thread at a time; the lock is what Python asks of its objects.
    cycle: Mutex<Box<dyn Tick>>,
    inbox: Inbox,
    out: Outcome,
    step: u64,
}

impl Controller {
    fn new(flight: &FlightTable) -> PyResult<Self> {
        let cycle = cycle::build(flight).map_err(raised)?;
        let out = cycle.new_outcome();
        let mut inbox = Inbox::new();
        inbox.operator = Operator::Fly;
        Ok(Self { cycle: Mutex::new(cycle), inbox, out, step: 0 })
    }

    /// The sticks after a tick with this pose, if there is a new one, and the drone's report of its own motion.
    fn act(&mut self, measured: Option<Pose>, drone: &OwnMotion) -> Sticks {
        let now = TimeNs(self.step.cast_signed().saturating_mul(SpanNs::from_seconds(DT_S).0));
        self.inbox.open(self.step, now);
        if let Some(pose) = measured {
            let frame = self.step.cast_signed();
            self.inbox.sightings.push(Sighting {
                frame,
                measured_at: now,
                received_at: now,
                pose: Some(pose),
            });
        }
        self.inbox.drone = self.step.is_multiple_of(STATUS_EVERY).then(|| drone.status(now));
        let cycle = self.cycle.get_mut().unwrap_or_else(PoisonError::into_inner);
        cycle.tick(&self.inbox, &mut Unwatched::without_plan(), &mut self.out);
        self.step += 1;
        self.out.u_sent
    }
}

/// Motion of a drone by its own report.
struct OwnMotion {
    pose: Pose,
    /// World frame. m/s, rad/s
    velocity_w: Pose,
}

impl OwnMotion {
    /// A status in flight, in the steps of the wire.
    fn status(&self, now: TimeNs) -> DroneStatus {
        let in_tenths = |value: f64| (value * 10.0).round() * 0.1;
        let Self { pose, velocity_w } = self;
        DroneStatus {
            received_at: now,
            is_flying: true,
            is_on_ground: false,
            takes_sticks: true,
            is_battery_low: Some(false),
            is_battery_critical: Some(false),
            battery_pct: 90,
            battery_v: None,
            height_m: Some(in_tenths(pose[pose::Z])),
            velocity_d_mps: Some([
                in_tenths(velocity_w[pose::X]),
                in_tenths(-velocity_w[pose::Y]),
                in_tenths(-velocity_w[pose::Z]),
            ]),
            heading_rad: Some(pose[pose::THETA]),
            flight_mode: None,
        }
    }
}

#[pymethods]
#[expect(clippy::needless_pass_by_value, reason = "arguments come from Python by value")]
impl Controllers {
    #[new]
    #[pyo3(signature = (count, mission, config))]
    fn new(count: usize, mission: Option<&str>, config: &str) -> PyResult<Self> {
        let flight = crate::flights::flight(config, mission, tello_flight::Start::Airborne)
            .map_err(raised)?;
        let controllers = (0..count).map(|_| Controller::new(&flight)).collect::<PyResult<_>>()?;
        Ok(Self { flight, controllers })
    }

    /// Starts the controllers at these positions anew.
    fn reset(&mut self, controllers: Vec<usize>) -> PyResult<()> {
        for position in controllers {
            let count = self.controllers.len();
            let Some(controller) = self.controllers.get_mut(position) else {
                let message =
                    format!("controllers: expected numbers below {count}, given {position}");
                return Err(TelloError::new_err(message));
            };
            *controller = Controller::new(&self.flight)?;
        }
        Ok(())
    }

    /// One tick of every controller: measured poses, whether each is new, and the drones' own poses and velocities;
    /// the sticks come back.
    fn act<'py>(
        &mut self,
        py: Python<'py>,
        measured: PyReadonlyArray2<'_, f64>,
        is_new: PyReadonlyArray1<'_, bool>,
        pose: PyReadonlyArray2<'_, f64>,
        velocity: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let measured = array::fixed_rows("measured", &measured, self.controllers.len())?;
        let poses = array::fixed_rows("pose", &pose, self.controllers.len())?;
        let velocities = array::fixed_rows("velocity", &velocity, self.controllers.len())?;
        let own = |(pose, velocity_w): (Pose, Pose)| OwnMotion { pose, velocity_w };
        let drones: Vec<OwnMotion> = poses.into_iter().zip(velocities).map(own).collect();
        let is_new: Vec<bool> = is_new.as_array().iter().copied().collect();
        if is_new.len() != measured.len() {
            let message =
                format!("is_new: expected {} values, given {}", measured.len(), is_new.len());
            return Err(TelloError::new_err(message));
        }
        let controllers = &mut self.controllers;
        let sticks: Vec<Sticks> = py.detach(|| {
            let given = measured.par_iter().zip(is_new.par_iter()).zip(drones.par_iter());
            let act = |(controller, ((pose, is_new), drone)): (_, ((&Pose, &bool), _))| {
                let controller: &mut Controller = controller;
                controller.act(is_new.then_some(*pose), drone)
            };
            controllers.par_iter_mut().zip(given).map(act).collect()
        });
        let flat: Vec<f64> = sticks.iter().flat_map(|u| u.iter().copied()).collect();
        array::owned(py, stick::COUNT, flat)
    }
}
