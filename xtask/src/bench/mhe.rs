//! The moving horizon estimator along a real flight, beside Ceres.
//!
//! Owns the windows. Warm: every window of a flight, each solve from the one before; ours is timed with
//! the shift of the window, the peer without. Cold: 200 windows of the same flight from where the model
//! leads with the prior parameter.

use std::fmt::Write as _;
use std::fs;

use anyhow::{Context, Result, ensure};
use horizon_estim::{
    ArrivalSettings, ArrivalTable, LmSettings, LmTable, Loss, LossTable, Mhe, MheSettings,
    Observed, Prior, Residuals, WindowProblem,
};
use horizon_model::rows::{Pose, Sticks};
use horizon_model::{Bounds, Kinematic};
use nalgebra::SVector;
use serde::Deserialize;
use tello_io::clock::Clock;
use tello_io::log::csv;

use super::comparison::{Comparison, Program, Solve, findings};
use super::peer::Peer;
use super::{Bench, Findings};

const DT_S: f64 = 0.02;

/// Steps until a stick acts in the thesis' flights.
const DEAD_STEPS: usize = 30;

/// Relative drop of the cost at which a solve ends.
const TOLERANCE: f64 = 1e-6;

/// Options of the peer; the wide trust region saves it an iteration, as small damping does in this solver.
const CERES: [&str; 2] = ["sparse_normal_cholesky", "1e8"];

/// Our time over that of Ceres that was aimed at.
const GOAL: f64 = 0.1;

const C_O: [f64; 4] = [3.0, 3.0, 2.0, 0.5];
const C_S: [f64; 4] = [0.4, 0.4, 0.4, 0.2];
const C_P: [f64; 4] = [20.0, 20.0, 20.0, 100.0];
const P_PRIOR: [f64; 4] = [1.29, 0.445, 0.994, 0.033];
const P_LB: [f64; 4] = [0.1, 0.1, 0.1, -3.0];
const P_UB: [f64; 4] = [10.0, 10.0, 10.0, 3.0];

/// A step: the applied input and the observation after it.
pub(super) type Step = (Sticks, Observed<4>);

/// A window as the reference file has it.
#[derive(Deserialize)]
struct Given {
    s0: [f64; 4],
    o: Vec<[f64; 4]>,
    u: Vec<[f64; 4]>,
    cost: f64,
}

/// A window with its fixed state.
struct Window {
    s_0: Pose,
    steps: Vec<Step>,
}

pub(crate) type Estimator = Mhe<Kinematic, 4, 4, 4, 4>;

/// All comparisons of this part.
///
/// # Errors
/// Missing data, a window that is refused, a peer that fails.
pub(super) fn run(bench: &Bench) -> Result<Findings> {
    let peer = bench.workshop.ceres("mhe_ceres")?;
    let flight = flight(bench)?;
    let mut comparisons = vec![cold(bench, peer.as_ref())?];
    for window_steps in [30, 60, 120] {
        comparisons.push(warm(bench, peer.as_ref(), &flight, window_steps)?);
    }
    Ok(findings(&comparisons)?)
}

/// Levenberg-Marquardt that ends at this relative drop of the cost.
pub(crate) fn solver(cost_tolerance: f64) -> LmTable {
    LmTable { damping_start: 1e-8, cost_tolerance, step_tolerance: 0.0, iterations_max: 100 }
}

/// The estimator that is measured, not started.
///
/// # Errors
/// A window that is out of range.
pub(crate) fn estimator(window_steps: usize) -> Result<Estimator> {
    let settings = MheSettings::builder(P_PRIOR)
        .window_steps(window_steps)
        .c_o(C_O)
        .c_s(C_S)
        .c_p(C_P)
        .bounds(P_LB, P_UB)
        .losses(LossTable::Huber { scale: 1.0 }, LossTable::None {})
        .arrival(ArrivalTable::Fixed)
        .solver(solver(TOLERANCE))
        .build(&Kinematic)?;
    Ok(Mhe::new(Kinematic, settings, DT_S)?)
}

/// The window as a problem at its cold start.
fn problem(window: &Window) -> WindowProblem<Kinematic, 4, 4, 4, 4> {
    let residuals = Residuals {
        model: Kinematic,
        dt_s: DT_S,
        c_o: C_O.into(),
        c_s: C_S.into(),
        observation_loss: Loss::Huber { scale: 1.0 },
        transition_loss: Loss::None,
    };
    let prior = Prior {
        c_p: C_P.into(),
        p_prior: P_PRIOR.into(),
        bounds: Bounds { lo: P_LB.into(), hi: P_UB.into() },
    };
    let arrival = ArrivalSettings::Fixed;
    let mut problem = WindowProblem::new(residuals, prior, arrival, window.steps.len());
    problem.start(window.s_0);
    window.steps.iter().for_each(|(u, observed)| problem.push(u, observed));
    problem
}

/// The cost of a window as far down as it goes.
fn least_cost(window: &Window) -> Result<f64> {
    let settings = LmSettings::try_from(&solver(1e-14))?;
    Ok(problem(window).solve(&settings, &mut || false)?.cost)
}

/// The first identification flight, inputs shifted to where they act: the first pose, then the steps.
///
/// # Errors
/// The recording is missing or too short.
pub(super) fn flight(bench: &Bench) -> Result<(Pose, Vec<Step>)> {
    let path = bench.data.join("thesis/ident/filt/1.log");
    let rows = csv::read(&path)?.rows;
    let o: Vec<Pose> = rows.iter().filter_map(|row| row.pos).collect();
    let u: Vec<Sticks> = rows.iter().filter_map(|row| row.input).collect();
    let (first, later) =
        o.get(DEAD_STEPS..).and_then(<[Pose]>::split_first).context("too short")?;
    Ok((*first, u.into_iter().zip(later.iter().map(|o| Observed::full(*o))).collect()))
}

fn cold(bench: &Bench, peer: Option<&Peer>) -> Result<Comparison> {
    let path = bench.data.join("mhe_windows.jsonl");
    let text = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
    let (mut windows, mut best) = (Vec::new(), Vec::new());
    for line in text.lines() {
        let Given { s0, o, u, cost } = serde_json::from_str(line)?;
        let observed = o.into_iter().map(|o| Observed::full(Pose::from(o)));
        let steps = u.into_iter().map(Sticks::from).zip(observed).collect();
        windows.push(Window { s_0: s0.into(), steps });
        best.push(cost);
    }
    let settings = LmSettings::try_from(&solver(TOLERANCE))?;
    let ours = || {
        let clock = Clock::start();
        let solved = windows.iter().map(|window| {
            let mut problem = problem(window);
            let start = clock.now();
            let report = problem.solve(&settings, &mut || false)?;
            let us = clock.now().since(start).seconds() * 1e6;
            Ok(Solve { us, iterations: report.iterations, cost: report.cost, kkt: f64::NAN })
        });
        solved.collect()
    };
    let mut programs = vec![Program::new("ours", ours)];
    programs.extend(ceres(bench, peer, "mhe_cold", "cold", &windows)?);
    Comparison::run("MHE 30, cold", best, programs, bench.repetitions)
}

fn warm(
    bench: &Bench,
    peer: Option<&Peer>,
    flight: &(Pose, Vec<Step>),
    window_steps: usize,
) -> Result<Comparison> {
    let windows = windows(flight, window_steps)?;
    let best: Result<Vec<f64>> = windows.iter().map(least_cost).collect();
    let ours = || follow(flight, window_steps);
    let mut programs = vec![Program::new("ours", ours)];
    if window_steps == DEAD_STEPS {
        programs.extend(ceres(bench, peer, "mhe_warm", "warm", &windows)?);
    }
    let name = format!("MHE {window_steps}, warm along a flight");
    Comparison::run(name, best?, programs, bench.repetitions)
}

/// One pass of our estimator along a flight: its updates with a full window.
fn follow((first, steps): &(Pose, Vec<Step>), window_steps: usize) -> Result<Vec<Solve>> {
    let mut mhe = estimator(window_steps)?;
    mhe.start(first)?;
    let clock = Clock::start();
    let mut solves = Vec::with_capacity(steps.len());
    for (u, observed) in steps {
        let start = clock.now();
        let report = mhe.update(u, observed, &mut || false)?;
        let us = clock.now().since(start).seconds() * 1e6;
        let (iterations, cost) = (report.iterations, report.cost);
        solves.push(Solve { us, iterations, cost, kkt: f64::NAN });
    }
    Ok(solves.split_off(window_steps - 1))
}

/// Times of the same. us
///
/// # Errors
/// An update that is refused.
pub(super) fn flight_us(flight: &(Pose, Vec<Step>), window_steps: usize) -> Result<Vec<f64>> {
    Ok(follow(flight, window_steps)?.iter().map(|solve| solve.us).collect())
}

/// Every full window of a flight, with the fixed state that our estimator gives it.
fn windows((first, steps): &(Pose, Vec<Step>), window_steps: usize) -> Result<Vec<Window>> {
    ensure!(steps.len() >= window_steps, "a flight of {} steps", steps.len());
    let mut mhe = estimator(window_steps)?;
    mhe.start(first)?;
    let mut windows = Vec::new();
    for (i, (u, observed)) in steps.iter().enumerate() {
        let cost = mhe.update(u, observed, &mut || false)?.cost;
        ensure!(cost.is_finite(), "step {i} costs {cost}");
        if let Some(begin) = (i + 1).checked_sub(window_steps) {
            windows.push(Window { s_0: mhe.window()[0], steps: steps[begin..=i].to_vec() });
        }
    }
    Ok(windows)
}

/// The peer on `windows`, if it is there.
fn ceres<'a>(
    bench: &Bench,
    peer: Option<&Peer>,
    file: &str,
    start: &'static str,
    windows: &[Window],
) -> Result<Option<Program<'a>>> {
    let Some(peer) = peer.cloned() else { return Ok(None) };
    let steps = windows.first().map_or(0, |window| window.steps.len());
    let mut text = format!("{} {steps}\n", windows.len());
    for window in windows {
        write_row(&mut text, &window.s_0)?;
        for (u, observed) in &window.steps {
            write_row(&mut text, u)?;
            write_row(&mut text, &observed.o)?;
        }
    }
    let path = bench.workshop.write(file, &text)?;
    let tolerance = TOLERANCE.to_string();
    let run = move || {
        let [solver, radius] = CERES;
        let answers = peer.run(&path, &[start, &tolerance, solver, radius])?;
        Ok(answers.into_iter().map(|answer| answer.solve).collect())
    };
    Ok(Some(Program::new("Ceres 2.1", run).with_goal((start == "warm").then_some(GOAL))))
}

/// Four numbers, exactly, and a line's end.
pub(super) fn write_row(text: &mut String, row: &SVector<f64, 4>) -> Result<()> {
    for value in row {
        write!(text, "{value} ")?;
    }
    writeln!(text)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use horizon_model::Model;

    use super::super::square::Noise;
    use super::*;

    /// A flight with noise, in whose heading one observation is wrong.
    fn flown(count: usize) -> (Pose, Vec<Step>) {
        let (first, mut noise) = (Pose::new(1.0, -2.0, 1.3, 0.5), Noise::new(3));
        let (mut s, p) = (first, SVector::from([1.2, 0.5, 0.9, 0.1]));
        let steps = (0..count).map(|k| {
            let t = 0.1 * k as f64;
            let u = Sticks::new(t.sin(), (1.3 * t).cos(), (0.7 * t).sin(), 0.3);
            s = Kinematic.step(&s, &u, &p, DT_S);
            let mut o = s + noise.vector(&[2e-3, 2e-3, 2e-3, 5e-3]);
            o[3] += if k == 40 { 3.0 } else { 0.0 };
            (u, Observed::full(o))
        });
        (first, steps.collect())
    }

    #[test]
    fn warm_solves_of_the_estimator_reach_the_least_cost_of_the_same_window() {
        let flight = flown(70);
        let windows = windows(&flight, 30).unwrap();
        let solves = follow(&flight, 30).unwrap();
        assert_eq!((windows.len(), solves.len()), (41, 41));
        for (window, solve) in windows.iter().zip(&solves) {
            let least = least_cost(window).unwrap();
            let gap = solve.cost / least - 1.0;
            assert!((-1e-9..1e-3).contains(&gap), "{} instead of {least}", solve.cost);
        }
    }
}
