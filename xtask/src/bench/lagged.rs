//! Estimator and controller of the vehicle that flies by default, with the settings that it flies with.
//!
//! Owns the flight: a lagged vehicle with noise goes round a square of 1.5 m, steered by converged solves.
//! The requests and observations are recorded once. There is no peer: the published
//! ones know the kinematic vehicle.

use std::path::Path;

use anyhow::Result;
use horizon_control::{Mpc, MpcProblem, MpcTable, SolverTable};
use horizon_estim::{ArrivalTable, LmTable, Mhe, MheTable, Observed};
use horizon_model::rows::{Motion, Pose, Sticks, lag, motion, pose, stick};
use horizon_model::{Lagged, Model};
use nalgebra::SVector;
use tello_flight::clip_target;
use tello_flight::cycle::CycleTable;
use tello_io::clock::Clock;
use tello_io::config;

use super::comparison::{Comparison, Program, Solve, findings};
use super::square::{Corners, Noise};
use super::{Bench, Findings};

/// The settings.
const SETTINGS: &str = "configs/fly.json";

/// Horizons of the controller, each step a stage. steps
const HORIZONS: [usize; 3] = [13, 50, 80];

/// Window of the estimator. steps
const WINDOW_STEPS: usize = 30;

/// Iterations of a solve that is to converge in most ticks.
const ITERATIONS_MAX: u32 = 4;

/// Ticks along the square.
const TICKS: usize = 300;

/// Standard deviation of what disturbs each step of the vehicle: pose, velocities, disturbance.
const NOISE: [f64; motion::COUNT] =
    [5e-4, 5e-4, 5e-4, 5e-4, 5e-3, 5e-3, 5e-3, 5e-3, 2e-3, 2e-3, 2e-3];

/// Standard deviation of an observation. m, rad
const NOISE_SEEN: [f64; pose::COUNT] = [1e-3, 1e-3, 1e-3, 3e-3];

/// Seed of the noise.
const SEED: u64 = 11;

/// Relative drop of the cost at which solves end: as compared with others, and to the last digits.
const TOLERANCES: [f64; 2] = [1e-6, 1e-13];

type Controller = Mpc<
    Lagged,
    { motion::COUNT },
    { stick::COUNT },
    { pose::COUNT },
    { lag::COUNT },
    { motion::CONTROLLABLE },
>;
type Estimator = Mhe<Lagged, { motion::COUNT }, { stick::COUNT }, { pose::COUNT }, { lag::COUNT }>;

/// One tick of the flight.
#[derive(Debug, Clone, Copy)]
struct Tick {
    /// Where the plan begins, the inputs applied before, and where to.
    s_0: Motion,
    u_before: Sticks,
    s_ref: Motion,
    /// The stick that the vehicle was given, and what was seen after it.
    u: Sticks,
    o: Pose,
}

/// All comparisons of this part.
///
/// # Errors
/// Settings that are refused, a solve that fails.
pub(super) fn run(bench: &Bench) -> Result<Findings> {
    let (fly, _) = config::fly(Some(Path::new(SETTINGS)), None)?;
    let mut cycle = fly.cycle;
    cycle.mhe.window_steps = WINDOW_STEPS;
    let p = SVector::from_column_slice(&cycle.mhe.p_prior);
    let mut comparisons = vec![estimate(bench, &cycle, &record(&cycle, &p, HORIZONS[1])?)?];
    for horizon_steps in HORIZONS {
        let flight = record(&cycle, &p, horizon_steps)?;
        let [usual, tight] = TOLERANCES.map(|cost_tolerance| SolverTable {
            cost_tolerance,
            iterations_max: 100,
            ..cycle.mpc.solver
        });
        let best = steer(&cycle, &p, &flight, (horizon_steps, &tight))?;
        let best = best.into_iter().map(|solve| solve.cost).collect();
        let few = SolverTable { iterations_max: ITERATIONS_MAX, ..cycle.mpc.solver };
        let programs = [
            ("ours, up to four iterations", &few),
            ("ours, one iteration as flown", &cycle.mpc.solver),
            ("ours, to 1e-6", &usual),
            ("ours, to the last digits", &tight),
        ];
        let programs = programs.map(|(name, solver)| {
            let (cycle, p, flight) = (&cycle, &p, &flight);
            Program::new(name, move || steer(cycle, p, flight, (horizon_steps, solver)))
        });
        let name = format!("MPC {horizon_steps}, lagged, difference cost, warm");
        comparisons.push(Comparison::run(name, best, programs.into(), bench.repetitions)?);
    }
    Ok(findings(&comparisons)?)
}

/// The estimator along the flight: as it flies, and with a fixed first state to the usual tolerance.
fn estimate(bench: &Bench, cycle: &CycleTable, flight: &[Tick]) -> Result<Comparison> {
    let solver =
        LmTable { cost_tolerance: TOLERANCES[0], iterations_max: 100, ..cycle.mhe.solver.clone() };
    let fixed = MheTable { arrival: ArrivalTable::Fixed, solver, ..cycle.mhe.clone() };
    let kinds = [("ours, as flown", &cycle.mhe), ("ours, first state fixed, to 1e-6", &fixed)];
    let programs =
        kinds.map(|(name, table)| Program::new(name, || follow(table, cycle.dt_s, flight)));
    let name = format!("MHE {}, lagged, warm along a flight", cycle.mhe.window_steps);
    Comparison::run(name, Vec::new(), programs.into(), bench.repetitions)
}

fn controller(cycle: &CycleTable, (steps, solver): (usize, &SolverTable)) -> Result<Controller> {
    let table =
        MpcTable { horizon_steps: steps, stages: Vec::new(), solver: *solver, ..cycle.mpc.mpc() };
    Ok(Mpc::new(Lagged::default().core(), table.check::<Lagged, _, _, _, _>()?, cycle.dt_s)?)
}

fn solve(mpc: &mut Controller, p: &SVector<f64, { lag::COUNT }>, tick: &Tick) -> Result<Solve> {
    let s_ref = vec![tick.s_ref; mpc.plan().len()];
    let problem = MpcProblem {
        s_0: &tick.s_0,
        p,
        u_before: &tick.u_before,
        s_ref: &s_ref,
        u_given: &[],
        given_steps: [0; stick::COUNT],
    };
    let clock = Clock::start();
    mpc.shift();
    let report = mpc.solve(&problem, &mut || false)?;
    let us = clock.now().seconds() * 1e6;
    Ok(Solve { us, iterations: report.iterations, cost: report.cost, kkt: f64::NAN })
}

/// One pass of the controller along the flight.
fn steer(
    cycle: &CycleTable,
    p: &SVector<f64, { lag::COUNT }>,
    flight: &[Tick],
    how: (usize, &SolverTable),
) -> Result<Vec<Solve>> {
    let mut mpc = controller(cycle, how)?;
    flight.iter().map(|tick| solve(&mut mpc, p, tick)).collect()
}

/// One pass of the estimator along the flight: its updates with a full window.
fn follow(table: &MheTable, dt_s: f64, flight: &[Tick]) -> Result<Vec<Solve>> {
    let settings = table.check::<Lagged, _, _, _, _>()?;
    let mut mhe = Estimator::new(Lagged::default(), settings, dt_s)?;
    mhe.start(&Lagged::default().observe(&flight[0].s_0))?;
    let clock = Clock::start();
    let mut solves = Vec::with_capacity(flight.len());
    for tick in flight {
        let start = clock.now();
        let report = mhe.update(&tick.u, &Observed::full(tick.o), &mut || false)?;
        let us = clock.now().since(start).seconds() * 1e6;
        let (iterations, cost) = (report.iterations, report.cost);
        solves.push(Solve { us, iterations, cost, kkt: f64::NAN });
    }
    Ok(solves.split_off(table.window_steps - 1))
}

/// The flight that converged solves with this horizon steer.
fn record(
    cycle: &CycleTable,
    p: &SVector<f64, { lag::COUNT }>,
    horizon_steps: usize,
) -> Result<Vec<Tick>> {
    let vehicle = Lagged::default();
    let solver =
        SolverTable { cost_tolerance: TOLERANCES[1], iterations_max: 100, ..cycle.mpc.solver };
    let mut mpc = controller(cycle, (horizon_steps, &solver))?;
    let (mut noise, mut corners) = (Noise::new(SEED), Corners::default());
    let mut s = vehicle.at_rest(&Pose::new(0.0, 0.0, 0.9, 0.5));
    let mut u_before = Sticks::zeros();
    let mut flight = Vec::with_capacity(TICKS);
    for _ in 0..TICKS {
        let at = vehicle.observe(&s);
        let target = clip_target(&corners.next(&at), &at, cycle.mpc.max_target_distance);
        let s_ref = vehicle.moving(&target, &Pose::zeros(), &s);
        let mut tick = Tick { s_0: s, u_before, s_ref, u: Sticks::zeros(), o: at };
        solve(&mut mpc, p, &tick)?;
        u_before = mpc.plan()[0];
        tick.u = vehicle.input_for(&u_before, p);
        s = vehicle.step(&s, &tick.u, p, cycle.dt_s) + noise.vector(&NOISE);
        tick.o = vehicle.observe(&s) + noise.vector(&NOISE_SEEN);
        flight.push(tick);
    }
    Ok(flight)
}
