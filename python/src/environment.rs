//! Tasks over many simulated drones: observations, rewards and ends of episodes.
//!
//! Owns what `tello_ctl.envs` documents, except where the targets are: they come as a table.

use horizon_model::angle::wrap;
use horizon_model::rows::{Pose, Sticks, pose, stick};
use horizon_model::setting::SettingError;
use numpy::{PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use tello_sim::{DT_S, SimTable, Truth};

use crate::simulator::{CHUNK, Drone, Seen, Shown, seen};
use crate::{TelloError, array, raised};

/// Actions in an observation: 0.4 s, more than the nominal dead time.
pub(crate) const HISTORY: usize = 20;
/// Numbers of an observation before the actions.
const MEASURED: usize = 12;
/// Numbers of an observation.
pub(crate) const OBSERVATIONS: usize = MEASURED + HISTORY * stick::COUNT;
/// Box that ends an episode. m
const LOW_W_M: [f64; 3] = [-3.5, -3.5, 0.2];
const HIGH_W_M: [f64; 3] = [3.5, 3.5, 3.0];
/// Part of each new difference in the filtered velocity.
const SMOOTHING: f64 = 0.3;
/// Limit of each number of an observation, positive and negative.
pub(crate) const LARGEST: f32 = 100.0;
/// Distance (m) and heading error (rad) in which a corner counts as reached.
const REACH: f64 = 0.2;
/// Weight of the heading error beside the distance. m/rad
const HEADING_WEIGHT: f64 = 0.3;
/// Weight of the squared norm of the sticks beside the distance. m
const EFFORT_WEIGHT: f64 = 0.002;
/// Reward that leaving the box costs. m s, as the distance over time
const BOX_PENALTY: f64 = 5.0;
/// Reward for a corner that is reached. m s
const CORNER_REWARD: f64 = 1.0;

/// See `tello_ctl.envs.TelloVectorEnv`.
#[pyclass(module = "tello_ctl", subclass)]
pub(crate) struct Environments {
    table: SimTable,
    rules: Rules,
    vehicles: Vec<Environment>,
    /// Whether the episode of each is over: it starts anew in the next step.
    are_over: Vec<bool>,
}

/// Rules that are common to the environments.
struct Rules {
    targets: Vec<Target>,
    /// How many targets at the end repeat, if they follow one another by the step; else one follows another that was
    /// reached.
    period: Option<usize>,
    steps_max: usize,
}

/// Where a vehicle is to be and how fast, world frame.
struct Target {
    pos_w_m: [f64; 3],
    velocity_w_mps: [f64; 3],
}

/// One vehicle and its episode.
struct Environment {
    drone: Drone,
    /// Newest first.
    sent: [f32; HISTORY * stick::COUNT],
    /// By filtered differences of measured poses, world frame. m/s, rad/s
    velocity_w: Pose,
    /// Newest measured pose and the time since.
    last: Pose,
    since_s: f64,
    elapsed: usize,
    reached: usize,
}

/// Result of a step.
#[derive(Clone, Copy, Default)]
struct Outcome {
    reward: f64,
    is_terminated: bool,
    is_truncated: bool,
    distance_m: f64,
    link_is_up: bool,
    reached: usize,
}

/// Result of a step of all environments: observations, rewards, terminated, truncated, distances, links, corners.
type Stepped<'py> = (
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<i64>>,
);

impl Environment {
    fn new(table: &SimTable, seed: u64) -> Result<Self, SettingError> {
        let drone = Drone::new(table, seed)?;
        Ok(Self {
            sent: [0.0; HISTORY * stick::COUNT],
            velocity_w: Pose::zeros(),
            last: drone.measured(),
            drone,
            since_s: 0.0,
            elapsed: 0,
            reached: 0,
        })
    }

    /// Flies one period.
    fn step(&mut self, u: &Sticks, rules: &Rules) -> Outcome {
        self.drone.step(*u);
        self.sent.copy_within(..(HISTORY - 1) * stick::COUNT, stick::COUNT);
        for (sent, u) in self.sent.iter_mut().zip(u.iter()) {
            *sent = single(*u);
        }
        self.elapsed += 1;
        self.filter_velocity();
        let mut outcome = self.judge(u, rules);
        outcome.is_truncated = self.elapsed >= rules.steps_max && !outcome.is_terminated;
        outcome
    }

    /// The first step of a new episode, in which the vehicle does not fly yet: what it shows is what
    /// [`Environments::reset`] shows, and nothing is judged.
    fn restart(
        &mut self,
        table: &SimTable,
        seed: u64,
        rules: &Rules,
    ) -> Result<Outcome, SettingError> {
        *self = Self::new(table, seed)?;
        let Truth { pose, link_is_up, .. } = self.drone.truth();
        let distance_m = self.distance_m(&pose, rules);
        Ok(Outcome { distance_m, link_is_up, ..Outcome::default() })
    }

    fn filter_velocity(&mut self) {
        self.since_s += DT_S;
        if self.drone.age_s() > 0.0 {
            return;
        }
        let measured = self.drone.measured();
        let mut change = measured - self.last;
        change[pose::THETA] = wrap(change[pose::THETA]);
        let rate = change / self.since_s.max(DT_S);
        self.velocity_w += SMOOTHING * (rate - self.velocity_w);
        (self.last, self.since_s) = (measured, 0.0);
    }

    /// Reward and end of a step with these sticks, by the true pose; notes a corner that was reached.
    fn judge(&mut self, u: &Sticks, rules: &Rules) -> Outcome {
        let truth = self.drone.truth();
        let distance_m = self.distance_m(&truth.pose, rules);
        let turned_rad = wrap(truth.pose[pose::THETA]).abs();
        let effort: f64 = u.iter().map(|u| u * u).sum();
        let mut reward =
            -DT_S * (distance_m + HEADING_WEIGHT * turned_rad + EFFORT_WEIGHT * effort);
        let is_out = |row: usize| truth.pose[row] < LOW_W_M[row] || truth.pose[row] > HIGH_W_M[row];
        let has_left = (pose::X..=pose::Z).any(is_out);
        if has_left {
            reward -= BOX_PENALTY;
        }
        let corners = rules.targets.len();
        let is_tour = rules.period.is_none() && corners > 1;
        if is_tour && distance_m.hypot(turned_rad) < REACH && self.reached < corners {
            self.reached += 1;
            reward += CORNER_REWARD;
        }
        Outcome {
            reward,
            is_terminated: has_left || is_tour && self.reached >= corners,
            is_truncated: false,
            distance_m,
            link_is_up: truth.link_is_up,
            reached: self.reached,
        }
    }

    /// From this pose to the target. m
    fn distance_m(&self, at: &Pose, rules: &Rules) -> f64 {
        let [x, y, z] = self.target(rules).pos_w_m;
        let [dx, dy, dz] = [x - at[pose::X], y - at[pose::Y], z - at[pose::Z]];
        (dx * dx + dy * dy + dz * dz).sqrt()
    }

    fn target<'a>(&self, rules: &'a Rules) -> &'a Target {
        let (at, period) = rules.period.map_or((self.reached, 1), |period| (self.elapsed, period));
        let count = rules.targets.len();
        let at = if at < count { at } else { count - period + (at - count) % period };
        &rules.targets[at]
    }

    /// Writes the observation.
    fn observe(&self, rules: &Rules, into: &mut [f32]) {
        let measured = self.drone.measured();
        let heading = measured[pose::THETA];
        let (sin, cos) = heading.sin_cos();
        let body_from_world = |[x, y, z]: [f64; 3]| [cos * x + sin * y, cos * y - sin * x, z];
        let Target { pos_w_m: [x, y, z], velocity_w_mps } = *self.target(rules);
        let way_w_m = [x - measured[pose::X], y - measured[pose::Y], z - measured[pose::Z]];
        let v = self.velocity_w;
        let own_w_mps = [v[pose::X], v[pose::Y], v[pose::Z]];
        let [dx, dy, dz] = body_from_world(way_w_m);
        let [own_x, own_y, own_z] = body_from_world(own_w_mps);
        let [vx, vy, vz] = body_from_world(velocity_w_mps);
        let age_s = self.drone.age_s();
        let yaw = v[pose::THETA];
        let numbers = [dx, dy, dz, wrap(-heading), own_x, own_y, own_z, yaw, age_s, vx, vy, vz];
        let (head, tail) = into.split_at_mut(MEASURED);
        for (into, value) in head.iter_mut().zip(numbers) {
            *into = single(value).clamp(-LARGEST, LARGEST);
        }
        tail.copy_from_slice(&self.sent);
    }
}

impl Environments {
    /// Steps every environment. Those that are over start anew instead, each with the next of `seeds`.
    fn advance(
        &mut self,
        sticks: &[Sticks],
        seeds: &[u64],
        observations: &mut [f32],
    ) -> Result<Vec<Outcome>, SettingError> {
        let mut outcomes = vec![Outcome::default(); sticks.len()];
        let Self { table, rules, vehicles, are_over } = self;
        let mut seeds = seeds.iter().copied();
        let fresh: Vec<Option<u64>> =
            are_over.iter().map(|is_over| is_over.then(|| seeds.next()).flatten()).collect();
        let given = sticks.par_iter().zip(fresh.par_iter());
        let shown = observations.par_chunks_mut(OBSERVATIONS).zip(outcomes.par_iter_mut());
        vehicles.par_iter_mut().zip(given).zip(shown).with_min_len(CHUNK).try_for_each(
            |((environment, (u, seed)), (observation, outcome))| {
                *outcome = match seed {
                    Some(seed) => environment.restart(table, *seed, rules)?,
                    None => environment.step(&u.map(|u| u.clamp(-1.0, 1.0)), rules),
                };
                environment.observe(rules, observation);
                Ok(())
            },
        )?;
        Ok(outcomes)
    }
}

#[pymethods]
#[expect(clippy::needless_pass_by_value, reason = "arguments come from Python by value")]
impl Environments {
    /// `targets`: one row per corner; or one row per step, the last `period` of which repeat.
    #[new]
    #[pyo3(signature = (settings, targets, period, steps_max))]
    fn new(
        settings: &str,
        targets: PyReadonlyArray2<'_, f64>,
        period: Option<usize>,
        steps_max: usize,
    ) -> PyResult<Self> {
        let table: SimTable =
            crate::settings::merged("sim", &tello_sim::settings(None).map_err(raised)?, settings)?;
        let targets = array::matrix("targets", &targets, (None, 6))?;
        let target = |row: &Vec<f64>| {
            let (pos, velocity) = row.split_at(3);
            Target {
                pos_w_m: std::array::from_fn(|axis| pos[axis]),
                velocity_w_mps: std::array::from_fn(|axis| velocity[axis]),
            }
        };
        let targets: Vec<Target> = targets.iter().map(target).collect();
        if targets.is_empty() || steps_max == 0 {
            return Err(TelloError::new_err(
                "targets, max_episode_steps: expected at least one of each",
            ));
        }
        if !(1..=targets.len()).contains(&period.unwrap_or(1)) {
            let message = format!("period: expected 1..={}, given {period:?}", targets.len());
            return Err(TelloError::new_err(message));
        }
        let rules = Rules { targets, period, steps_max };
        Ok(Self { table, rules, vehicles: Vec::new(), are_over: Vec::new() })
    }

    /// Starts as many environments as there are seeds; observations come back.
    fn reset<'py>(
        &mut self,
        py: Python<'py>,
        seeds: Vec<u64>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let Self { table, rules, .. } = self;
        let mut observations = vec![0.0; seeds.len() * OBSERVATIONS];
        let begun: Result<Vec<_>, _> = py.detach(|| {
            let shown = observations.par_chunks_mut(OBSERVATIONS);
            let begin = |(seed, observation): (&u64, &mut [f32])| {
                let environment = Environment::new(table, *seed)?;
                environment.observe(rules, observation);
                Ok(environment)
            };
            seeds.par_iter().zip(shown).map(begin).collect()
        });
        self.vehicles = begun.map_err(|error: SettingError| raised(error))?;
        self.are_over = vec![false; seeds.len()];
        array::owned(py, OBSERVATIONS, observations)
    }

    /// Flies one period of 20 ms with these sticks, one row per environment, and `seeds` for those that were over.
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        sticks: PyReadonlyArray2<'_, f64>,
        seeds: Vec<u64>,
    ) -> PyResult<Stepped<'py>> {
        let sticks = array::fixed_rows("sticks", &sticks, self.vehicles.len())?;
        let over = self.are_over.iter().filter(|is_over| **is_over).count();
        if seeds.len() != over {
            let message = format!("seeds: expected {over} values, given {}", seeds.len());
            return Err(TelloError::new_err(message));
        }
        let mut observations = vec![0.0; self.vehicles.len() * OBSERVATIONS];
        let outcomes = py.detach(|| self.advance(&sticks, &seeds, &mut observations));
        let outcomes = outcomes.map_err(raised)?;
        for (is_over, outcome) in self.are_over.iter_mut().zip(&outcomes) {
            *is_over = outcome.is_terminated || outcome.is_truncated;
        }
        let numbers = |of: fn(&Outcome) -> f64| PyArray1::from_iter(py, outcomes.iter().map(of));
        let flags = |of: fn(&Outcome) -> bool| PyArray1::from_iter(py, outcomes.iter().map(of));
        Ok((
            array::owned(py, OBSERVATIONS, observations)?,
            numbers(|outcome| outcome.reward),
            flags(|outcome| outcome.is_terminated),
            flags(|outcome| outcome.is_truncated),
            numbers(|outcome| outcome.distance_m),
            flags(|outcome| outcome.link_is_up),
            PyArray1::from_iter(
                py,
                outcomes.iter().map(|outcome| outcome.reached.cast_signed() as i64),
            ),
        ))
    }

    /// Observation of the vehicles after the last step.
    fn observe<'py>(&self, py: Python<'py>) -> PyResult<Seen<'py>> {
        let shown = |environment: &Environment| environment.drone.shown();
        let shown: Vec<Shown> = py.detach(|| self.vehicles.par_iter().map(shown).collect());
        seen(py, &shown)
    }

    /// Target position of the first environment. m
    fn first_target(&self) -> [f64; 3] {
        let target = self.vehicles.first().map(|first| first.target(&self.rules));
        target.map_or([0.0; 3], |target| target.pos_w_m)
    }
}

/// A number of an observation.
fn single(value: f64) -> f32 {
    #[expect(clippy::cast_possible_truncation, reason = "observations are single precision")]
    let single = value as f32;
    single
}
