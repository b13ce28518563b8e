//! The model predictive controller, beside Ceres.
//!
//! Owns the problems and their judge. Cold: the reference problems from zero inputs. Warm: the closed
//! loop along a square, each solve from the plan before, moved on by one step; ours is timed with that
//! shift, the peer without.

#[path = "../../../tests/reference_mpc/problem.rs"]
mod problem;

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use horizon_control::{InputCost, Mpc, MpcProblem, MpcReport, MpcSettings, QpKind, SolverTable};
use horizon_model::rows::{Pose, Sticks};
use horizon_model::{Kinematic, Model};
use nalgebra::SVector;
use tello_io::clock::Clock;

use self::problem::Problem;
use super::comparison::{Comparison, Program, Solve, findings};
use super::mhe::write_row;
use super::peer::{Answer, Peer};
use super::{Bench, Findings, square};

pub(crate) const DT_S: f64 = 0.02;

/// Relative drop of the cost at which a solve ends.
const TOLERANCE: f64 = 1e-6;

/// Relative drop of the cost at which a solve to the last digits ends: the projected gradient is then below 1e-6.
const TIGHT: f64 = 1e-13;

pub(super) const C_U: [f64; 4] = [1.2, 1.2, 0.8, 0.8];
pub(super) const C_S: [f64; 4] = [1.5, 1.5, 1.0, 1.0];
pub(super) const C_S_END: [f64; 4] = [15.0, 15.0, 10.0, 10.0];
pub(super) const U_MAX: [f64; 4] = [0.8, 0.8, 1.0, 1.0];

/// One problem: from `s_0` to a pose.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Case {
    pub(crate) p: SVector<f64, 4>,
    pub(crate) u_before: Sticks,
    pub(crate) s_0: Pose,
    pub(crate) s_ref: Pose,
}

pub(crate) type Controller = Mpc<Kinematic, 4, 4, 4, 4, 4>;

/// A horizon, how much of the square is flown with it, and the goal of its cold solve.
struct Size {
    horizon_steps: usize,
    ticks: usize,
    cold_goal: Option<f64>,
}

/// The peer takes a tenth of a second at the longest horizon.
const SIZES: [Size; 4] = [
    Size { horizon_steps: 13, ticks: 1200, cold_goal: Some(0.02) },
    Size { horizon_steps: 25, ticks: 600, cold_goal: Some(0.006) },
    Size { horizon_steps: 50, ticks: 200, cold_goal: Some(0.002) },
    Size { horizon_steps: 100, ticks: 40, cold_goal: None },
];

/// Ticks along the square where no peer has to follow.
const SQUARE_TICKS: usize = 1000;

/// All comparisons of this part.
///
/// # Errors
/// Missing data, a problem that is refused, a peer that fails.
pub(super) fn run(bench: &Bench) -> Result<Findings> {
    let peer = bench.workshop.ceres("mpc_ceres")?;
    let path = bench.data.join("mpc_problems.jsonl");
    let mut comparisons = Vec::new();
    for size in &SIZES {
        let (cases, _) = reference(&path, size.horizon_steps, InputCost::Absolute)?;
        comparisons.push(compare(bench, peer.as_ref(), (size, &cases, Start::Cold))?);
    }
    for size in &SIZES {
        let cases = square::record(size.horizon_steps, size.ticks)?;
        comparisons.push(compare(bench, peer.as_ref(), (size, &cases, Start::Warm))?);
    }
    for horizon_steps in [13, 25, 50] {
        comparisons.push(difference(bench, &path, horizon_steps)?);
    }
    Ok(findings(&comparisons)?)
}

/// Makes passes of warm solves along the square: each returns their times. us
///
/// # Errors
/// A solve that fails.
pub(super) fn square_us(horizon_steps: usize) -> Result<impl FnMut() -> Result<Vec<f64>>> {
    let cases = square::record(horizon_steps, SQUARE_TICKS)?;
    Ok(move || {
        let solves = ours(&cases, horizon_steps, Start::Warm, (InputCost::Absolute, TOLERANCE))?;
        Ok(solves.iter().map(|solve| solve.us).collect())
    })
}

/// Weights as they enter the cost.
pub(super) fn squared(weights: [f64; 4]) -> SVector<f64, 4> {
    SVector::from(weights.map(|weight| weight * weight))
}

/// Where a solve starts.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Start {
    /// From zero inputs.
    Cold,
    /// From the last plan moved on by one step.
    Warm,
}

/// A controller whose solves end at this relative drop of the cost.
///
/// # Errors
/// A setting that breaks its rule.
pub(crate) fn controller(
    horizon_steps: usize,
    input_cost: InputCost,
    cost_tolerance: f64,
) -> Result<Controller> {
    controller_of(horizon_steps, input_cost, (cost_tolerance, 100))
}

/// A controller whose solves end at a relative drop of the cost or a number of iterations.
///
/// # Errors
/// A setting that breaks its rule.
pub(super) fn controller_of(
    horizon_steps: usize,
    input_cost: InputCost,
    (cost_tolerance, iterations_max): (f64, u32),
) -> Result<Controller> {
    let settings = MpcSettings::builder(horizon_steps)
        .input_cost(input_cost)
        .c_u(C_U)
        .c_s(C_S)
        .c_s_end(C_S_END)
        .bounds(U_MAX.map(|max| -max), U_MAX)
        .solver(SolverTable {
            qp: QpKind::Riccati,
            cost_tolerance,
            iterations_max,
            qp_tolerance: 1e-10,
            qp_iterations_max: 50,
        })
        .build(&Kinematic)?;
    Ok(Mpc::new(Kinematic, settings, DT_S)?)
}

/// Solves from where the controller stands; `s_ref` is that of the case, once for each step.
///
/// # Errors
/// The controller refuses the case.
pub(crate) fn solve(mpc: &mut Controller, case: &Case, s_ref: &[Pose]) -> Result<MpcReport> {
    let problem = MpcProblem {
        s_0: &case.s_0,
        p: &case.p,
        u_before: &case.u_before,
        s_ref,
        u_given: &[],
        given_steps: [0; 4],
    };
    Ok(mpc.solve(&problem, &mut || false)?)
}

/// The reference problems with this input cost, and their least costs. The file has none of 100 steps:
/// those of 50, seen further ahead, stand for them.
fn reference(
    path: &Path,
    horizon_steps: usize,
    input_cost: InputCost,
) -> Result<(Vec<Case>, Vec<f64>)> {
    let text = fs::read_to_string(path).with_context(|| path.display().to_string())?;
    let (mut cases, mut best) = (Vec::new(), Vec::new());
    for line in text.lines() {
        let given: Problem = serde_json::from_str(line)?;
        if given.horizon_steps == horizon_steps.min(50) && given.input_cost == input_cost {
            let [p, s_0, u_before, s_ref] =
                [given.p, given.s0, given.u_prev, given.s_ref].map(SVector::from);
            cases.push(Case { p, u_before, s_0, s_ref });
            best.push(given.cost);
        }
    }
    Ok((cases, best))
}

/// Cold solves of the problems in which changes of the inputs cost, ours alone.
fn difference(bench: &Bench, path: &Path, horizon_steps: usize) -> Result<Comparison> {
    let (cases, best) = reference(path, horizon_steps, InputCost::Difference)?;
    let programs =
        [("ours", TOLERANCE), ("ours, to the last digits", TIGHT)].map(|(name, tolerance)| {
            let how = (InputCost::Difference, tolerance);
            let cases = &cases;
            Program::new(name, move || ours(cases, horizon_steps, Start::Cold, how))
        });
    let name = format!("MPC {horizon_steps}, difference cost, cold");
    Comparison::run(name, best, programs.into(), bench.repetitions)
}

fn compare(
    bench: &Bench,
    peer: Option<&Peer>,
    (size, cases, start): (&Size, &[Case], Start),
) -> Result<Comparison> {
    let Size { horizon_steps, cold_goal, .. } = *size;
    let best = ours(cases, horizon_steps, start, (InputCost::Absolute, TIGHT))?;
    let best = best.into_iter().map(|solve| solve.cost).collect();
    let kinds = [("ours", TOLERANCE), ("ours, to the last digits", TIGHT)];
    let mut programs: Vec<Program<'_>> = kinds
        .map(|(name, tolerance)| {
            let how = (InputCost::Absolute, tolerance);
            Program::new(name, move || ours(cases, horizon_steps, start, how))
        })
        .into();
    if let Some(peer) = peer {
        let mut text = format!("{} {horizon_steps}\n", cases.len());
        for case in cases {
            [case.p, case.s_0, case.s_ref].iter().try_for_each(|row| write_row(&mut text, row))?;
        }
        let file = bench.workshop.write(&format!("mpc_{start:?}_{horizon_steps}"), &text)?;
        for solver in ["dense_qr", "dense_normal_cholesky"] {
            let file = file.clone();
            let run = move || {
                let name = if start == Start::Cold { "cold" } else { "warm" };
                let answers = peer.run(&file, &[name, &TOLERANCE.to_string(), solver, "1e4"])?;
                Ok(judged(cases, &answers))
            };
            let goal = cold_goal.filter(|_| start == Start::Cold && solver == "dense_qr");
            programs.push(Program::new(format!("Ceres 2.1, {solver}"), run).with_goal(goal));
        }
    }
    let start = if start == Start::Cold { "cold" } else { "warm along the square" };
    let name = format!("MPC {horizon_steps}, {start}");
    Comparison::run(name, best, programs, bench.repetitions)
}

/// One pass of our controller.
fn ours(
    cases: &[Case],
    horizon_steps: usize,
    start: Start,
    (input_cost, tolerance): (InputCost, f64),
) -> Result<Vec<Solve>> {
    let mut mpc = controller(horizon_steps, input_cost, tolerance)?;
    let clock = Clock::start();
    let mut s_ref = vec![Pose::zeros(); horizon_steps];
    let mut solves = Vec::with_capacity(cases.len());
    for case in cases {
        s_ref.fill(case.s_ref);
        let begin = clock.now();
        match start {
            Start::Cold => mpc.reset(),
            Start::Warm => mpc.shift(),
        }
        let report = solve(&mut mpc, case, &s_ref)?;
        let us = clock.now().since(begin).seconds() * 1e6;
        let kkt = match input_cost {
            InputCost::Absolute => judge(case, mpc.plan()).1,
            InputCost::Difference => f64::NAN,
        };
        solves.push(Solve { us, iterations: report.iterations, cost: report.cost, kkt });
    }
    Ok(solves)
}

/// Answers of a peer as solves of this program.
fn judged(cases: &[Case], answers: &[Answer]) -> Vec<Solve> {
    let judged = cases.iter().zip(answers).map(|(case, answer)| {
        let u: Vec<Sticks> =
            answer.solution.chunks_exact(4).map(Sticks::from_column_slice).collect();
        let (cost, kkt) = judge(case, &u);
        Solve { cost, kkt, ..answer.solve }
    });
    judged.collect()
}

/// Cost of the inputs `u`, and the largest entry of the gradient where the bounds leave a choice.
///
/// Written without the controller: one roll-out, and the gradients of the cost back along it.
fn judge(case: &Case, u: &[Sticks]) -> (f64, f64) {
    let [c_u, c_s, c_s_end] = [C_U, C_S, C_S_END].map(squared);
    let mut s = vec![case.s_0];
    for u in u {
        s.extend(s.last().map(|s| Kinematic.step(s, u, &case.p, DT_S)));
    }
    let (mut cost, mut kkt, mut costate) = (0.0, 0.0_f64, Pose::zeros());
    for (k, u) in u.iter().enumerate().rev() {
        let weight = if k + 1 == s.len() - 1 { c_s_end } else { c_s };
        let way = s[k + 1] - case.s_ref;
        cost += 0.5 * (weight.dot(&way.component_mul(&way)) + c_u.dot(&u.component_mul(u)));
        costate += weight.component_mul(&way);
        let driven = Kinematic.linearize_by_input(&s[k], u, &case.p, DT_S);
        let gradient = c_u.component_mul(u) + driven.by_input.tr_mul(&costate);
        let max = Sticks::from(U_MAX);
        kkt = kkt.max((u - (u - gradient).sup(&-max).inf(&max)).amax());
        costate = driven.by_state.tr_mul(&costate);
    }
    (cost, kkt)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// These problems with targets ten times as far away.
    pub(crate) fn far(cases: &[Case]) -> Vec<Case> {
        let far = |case: &Case| Case { s_ref: case.s_0 + 10.0 * (case.s_ref - case.s_0), ..*case };
        cases.iter().map(far).collect()
    }

    #[test]
    fn solves_along_the_square_are_optimal_by_a_judge_that_knows_no_controller() {
        let horizon_steps = 50;
        let mut cases = square::record(horizon_steps, 60).unwrap();
        // No plan to a target that is near reaches a bound: so do some of these.
        cases.extend(far(&cases));
        let mut mpc = controller(horizon_steps, InputCost::Absolute, TIGHT).unwrap();
        let mut bounded = 0;
        for case in &cases {
            mpc.shift();
            let report = solve(&mut mpc, case, &vec![case.s_ref; horizon_steps]).unwrap();
            let (cost, kkt) = judge(case, mpc.plan());
            assert!((cost - report.cost).abs() < 1e-9 * cost, "{cost}, {}", report.cost);
            assert!(kkt < 1e-6, "{kkt}");
            let is_bound = |u: &Sticks| (0..4).any(|row| (u[row].abs() - U_MAX[row]).abs() < 1e-12);
            bounded += usize::from(mpc.plan().iter().any(is_bound));
            // Less of an input costs more, and the judge sees that the gradient is not zero.
            let mut other = mpc.plan().to_vec();
            other[3] *= 0.9;
            let (other_cost, other_kkt) = judge(case, &other);
            assert!(other_cost > cost && other_kkt > 1e-3, "{other_cost}, {other_kkt}");
        }
        assert!(bounded > 10, "{bounded} plans with a bound");
    }
}
