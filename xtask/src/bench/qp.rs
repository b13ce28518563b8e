//! The quadratic subproblems of the controller beside packaged solvers of quadratic programs.
//!
//! Owns the sequence: linearized around the plans of a controller that makes one iteration a tick, warm
//! along the square. All programs get the same subproblems without second derivatives, linearized and for
//! DAQP condensed for them; their time is that of update and solution alone. The same again with walls as one-sided
//! penalties, for the peers with a slack variable each. A whole iteration of the controller stands beside: shift,
//! roll-out, linearization, the subproblem with second derivatives, line search.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use horizon_control::InputCost;
use horizon_control::qp::{CostHessian, Horizon, Limits, Penalty, Problem, Qp, Stage};
use horizon_model::rows::{Pose, Sticks, pose};
use horizon_model::{Bounds, Kinematic, Model};
use nalgebra::{SMatrix, SVector};
use tello_io::clock::Clock;

use super::comparison::{Comparison, Program, Solve, findings};
use super::mhe::write_row;
use super::mpc::{self, C_S, C_S_END, C_U, Case, DT_S, U_MAX, squared};
use super::peer::Peer;
use super::{Bench, Findings, square};

/// Horizons, ticks along the square, and the best packaged solver there with the ratio aimed at.
const SIZES: [(usize, usize, &str); 2] = [(13, 400, "daqp"), (50, 200, "piqp")];

/// Packaged solvers.
const PEERS: [&str; 4] = ["daqp", "hpipm", "osqp", "piqp"];

/// Those that solve the problems with walls, sparse.
const PEERS_WALLS: [&str; 3] = ["hpipm", "osqp", "piqp"];

/// Our time over that of the best of them that was aimed at.
const GOAL: f64 = 0.1;

/// Walls 0.1 m inside of the sides of the square: row, outward direction, and the wall along it. m
const WALLS: [(usize, f64, f64); 4] =
    [(pose::X, 1.0, 1.4), (pose::X, -1.0, -0.1), (pose::Y, 1.0, 1.4), (pose::Y, -1.0, -0.1)];

/// Squared weight of each metre beyond a wall. 1/m^2
const WALL_SQUARED_WEIGHT: f64 = 1e4;

/// Both horizons.
///
/// # Errors
/// A solve that fails, a peer that fails.
pub(super) fn run(bench: &Bench) -> Result<Findings> {
    let peer = bench.workshop.python("qp")?;
    let mut comparisons = Vec::new();
    for (horizon_steps, ticks, best) in SIZES {
        let cases = square::record(horizon_steps, ticks)?;
        let mut subproblems = Vec::with_capacity(ticks);
        iterate(&cases, horizon_steps, |case, plan| subproblems.push(Subproblem::new(case, plan)))?;
        let mut text = format!("{ticks} {horizon_steps}\n");
        subproblems.iter().try_for_each(|subproblem| subproblem.write(&mut text))?;
        let file = bench.workshop.write(&format!("qp_{horizon_steps}"), &text)?;
        let (best_costs, mut programs) =
            side_by_side(&subproblems, peer.as_ref(), &file, (&PEERS, Some(best)))?;
        let whole = || {
            let solves = iterate(&cases, horizon_steps, |_, _| ())?;
            // It minimizes another function: its cost is not comparable.
            Ok(solves.into_iter().map(|solve| Solve { cost: f64::NAN, ..solve }).collect())
        };
        programs.push(Program::new("a whole iteration of ours", whole));
        let name = format!("MPC QP {horizon_steps}, warm along the square");
        comparisons.push(Comparison::run(name, best_costs, programs, bench.repetitions)?);
        subproblems.iter_mut().for_each(Subproblem::add_walls);
        let (best_costs, programs) =
            side_by_side(&subproblems, peer.as_ref(), &file, (&PEERS_WALLS, None))?;
        let active = subproblems
            .iter()
            .filter(|one| one.penalties.iter().any(|one| one.excess > 0.0))
            .count();
        let name =
            format!("MPC QP {horizon_steps} with walls, violated at first in {active} of {ticks}");
        comparisons.push(Comparison::run(name, best_costs, programs, bench.repetitions)?);
    }
    Ok(findings(&comparisons)?)
}

/// Our costs of the problems, and our solver and the peers `names` on them; with walls, if the problems have some. One
/// of them may have a goal.
fn side_by_side<'a>(
    subproblems: &'a [Subproblem],
    peer: Option<&Peer>,
    file: &Path,
    (names, best): (&[&'static str], Option<&str>),
) -> Result<(Vec<f64>, Vec<Program<'a>>)> {
    let walls = subproblems.iter().any(|one| !one.penalties.is_empty());
    let best_costs = solve_all(subproblems)?.iter().map(|solve| solve.cost).collect();
    let mut programs = vec![Program::new("ours", || solve_all(subproblems))];
    for (name, peer) in names.iter().copied().zip(peer.into_iter().cycle()) {
        let (peer, file) = (peer.clone(), file.to_owned());
        let run = move || {
            let arguments = [name, "walls"];
            let answers = peer.run(&file, &arguments[..=usize::from(walls)])?;
            // A peer says by how much the cost changes.
            let whole = answers.into_iter().zip(subproblems).map(|(answer, subproblem)| Solve {
                cost: subproblem.cost + answer.solve.cost,
                ..answer.solve
            });
            Ok(whole.collect())
        };
        let goal = (Some(name) == best).then_some(GOAL);
        programs.push(Program::new(name, run).with_goal(goal));
    }
    Ok((best_costs, programs))
}

/// One iteration of the controller for each case; `see` gets the plans that they start from.
fn iterate(
    cases: &[Case],
    horizon_steps: usize,
    mut see: impl FnMut(&Case, Vec<Sticks>),
) -> Result<Vec<Solve>> {
    let mut mpc = mpc::controller_of(horizon_steps, InputCost::Absolute, (1e-15, 1))?;
    let clock = Clock::start();
    let mut s_ref = vec![Pose::zeros(); horizon_steps];
    let mut solves = Vec::with_capacity(cases.len());
    for case in cases {
        s_ref.fill(case.s_ref);
        let mut plan = mpc.plan().to_vec();
        plan.rotate_left(1);
        plan.last_mut().zip(mpc.plan().last()).into_iter().for_each(|(u, last)| *u = *last);
        see(case, plan);
        let start = clock.now();
        mpc.shift();
        let report = mpc::solve(&mut mpc, case, &s_ref)?;
        let us = clock.now().since(start).seconds() * 1e6;
        let iterations = report.qp_iterations;
        solves.push(Solve { us, iterations, cost: report.cost, kkt: f64::NAN });
    }
    Ok(solves)
}

/// A controller's problem, linearized around a plan.
struct Subproblem {
    case: Case,
    u: Vec<Sticks>,
    stages: Vec<Stage<4, 4>>,
    gradient: Horizon<4, 4>,
    /// In the order of their stages.
    penalties: Vec<Penalty<4>>,
    /// States of the plan, from the second on.
    s: Vec<Pose>,
    /// Of the plan.
    cost: f64,
}

impl Subproblem {
    fn new(case: &Case, u: Vec<Sticks>) -> Self {
        let steps = u.len();
        let mut gradient = Horizon::zeros(steps);
        let (mut stages, mut states) = (Vec::with_capacity(steps), Vec::with_capacity(steps));
        let (mut s, mut cost) = (case.s_0, 0.0);
        for (k, u) in u.iter().enumerate() {
            let driven = Kinematic.linearize_by_input(&s, u, &case.p, DT_S);
            stages.push(Stage { by_state: driven.by_state, by_input: driven.by_input });
            s = driven.s_next;
            states.push(s);
            let way = s - case.s_ref;
            gradient.u[k] = squared(C_U).component_mul(u);
            gradient.s[k] = state_weight(k, steps).component_mul(&way);
            cost += 0.5 * (gradient.u[k].dot(u) + gradient.s[k].dot(&way));
        }
        Self { case: *case, u, stages, gradient, penalties: Vec::new(), s: states, cost }
    }

    /// Puts the walls into the problem.
    fn add_walls(&mut self) {
        for (stage, s) in self.s.iter().enumerate() {
            for (row, outwards, wall_m) in WALLS {
                let mut gradient = Pose::zeros();
                gradient[row] = outwards;
                let excess = outwards * s[row] - wall_m;
                let penalty =
                    Penalty { stage, squared_weight: WALL_SQUARED_WEIGHT, excess, gradient };
                self.cost += penalty.cost(excess);
                self.penalties.push(penalty);
            }
        }
    }

    /// Appends the problem in the text format of the peers.
    fn write(&self, text: &mut String) -> Result<()> {
        let Case { p, s_0, s_ref, .. } = self.case;
        [p, s_0, s_ref].iter().try_for_each(|row| write_row(text, row))?;
        self.u.iter().try_for_each(|u| write_row(text, u))?;
        Ok(writeln!(text)?)
    }

    /// Its cost after the steps `du`.
    fn cost_after(&self, du: &[Sticks]) -> f64 {
        let (mut cost, mut ds) = (self.cost, Pose::zeros());
        for (k, (stage, du)) in self.stages.iter().zip(du).enumerate() {
            ds = stage.next(&ds, du);
            let (by_u, by_s) =
                (squared(C_U).component_mul(du), state_weight(k, self.u.len()).component_mul(&ds));
            cost += du.dot(&(0.5 * by_u + self.gradient.u[k]));
            cost += ds.dot(&(0.5 * by_s + self.gradient.s[k]));
            for one in self.penalties.iter().filter(|one| one.stage == k) {
                cost += one.cost(one.excess_at(&ds)) - one.cost(one.excess);
            }
        }
        cost
    }
}

/// Squared weight of `s_{k+1}`.
fn state_weight(k: usize, steps: usize) -> SVector<f64, 4> {
    squared(if k + 1 < steps { C_S } else { C_S_END })
}

/// Solves all of them in their order, each from the active set of the one before, moved on by a step.
fn solve_all(subproblems: &[Subproblem]) -> Result<Vec<Solve>> {
    solve_each(subproblems, |_| ())
}

/// Solves `subproblems` as [`solve_all`]; `see` gets the step that solves each.
fn solve_each(subproblems: &[Subproblem], mut see: impl FnMut(&[Sticks])) -> Result<Vec<Solve>> {
    let steps = subproblems.first().map_or(0, |subproblem| subproblem.u.len());
    let mut diagonal = Horizon::zeros(steps);
    diagonal.u.fill(squared(C_U));
    (0..steps).for_each(|k| diagonal.s[k] = state_weight(k, steps));
    let limits = Limits { tolerance: 1e-10, iterations_max: 50, penalties_max: WALLS.len() };
    let mut qp = Qp::new(&CostHessian { diagonal, coupling: Vec::new() }, limits, true)?;
    let bounds = vec![Bounds { lo: -Sticks::from(U_MAX), hi: Sticks::from(U_MAX) }; steps];
    let mut du = vec![SMatrix::zeros(); steps];
    let clock = Clock::start();
    let mut solves = Vec::with_capacity(subproblems.len());
    for subproblem in subproblems {
        let Subproblem { u, stages, gradient, penalties, .. } = subproblem;
        let problem =
            Problem { stages, gradient, u, bounds: &bounds, second_derivatives: &[], penalties };
        let start = clock.now();
        qp.shift(|_| true);
        let solved = qp.solve(&problem, &mut du, &mut || false)?;
        let us = clock.now().since(start).seconds() * 1e6;
        let (iterations, cost) = (solved.iterations, subproblem.cost_after(&du));
        solves.push(Solve { us, iterations, cost, kkt: f64::NAN });
        see(&du);
    }
    Ok(solves)
}

#[cfg(test)]
mod tests {
    use super::super::mpc::tests::far;
    use super::*;

    /// Largest change of an input by a step against the gradient, central differences of the cost, within the bounds.
    fn projected_gradient(subproblem: &Subproblem, du: &[Sticks]) -> f64 {
        let (max, step) = (Sticks::from(U_MAX), 1e-5);
        let mut largest = 0.0_f64;
        for (k, u) in subproblem.u.iter().enumerate() {
            for row in 0..U_MAX.len() {
                let cost = |by: f64| {
                    let mut du = du.to_vec();
                    du[k][row] += by;
                    subproblem.cost_after(&du)
                };
                let derivative = (cost(step) - cost(-step)) / (2.0 * step);
                let at = u[row] + du[k][row];
                largest = largest.max((at - (at - derivative).clamp(-max[row], max[row])).abs());
            }
        }
        largest
    }

    #[test]
    fn subproblems_are_solved_with_walls_and_without() {
        let horizon_steps = 50;
        let mut cases = square::record(horizon_steps, 120).unwrap();
        cases.extend(far(&cases));
        let mut subproblems = Vec::new();
        let see = |case: &Case, plan| subproblems.push(Subproblem::new(case, plan));
        iterate(&cases, horizon_steps, see).unwrap();
        for with_walls in [false, true] {
            if with_walls {
                subproblems.iter_mut().for_each(Subproblem::add_walls);
            }
            let (mut beyond, mut bounded) = (0, 0);
            let mut steps = Vec::new();
            let solves = solve_each(&subproblems, |du| steps.push(du.to_vec())).unwrap();
            for ((subproblem, solve), du) in subproblems.iter().zip(&solves).zip(&steps) {
                assert!(solve.cost <= subproblem.cost + 1e-12, "{}", solve.cost);
                let gradient = projected_gradient(subproblem, du);
                assert!(gradient < 1e-5, "walls {with_walls}: {gradient}");
                beyond += usize::from(subproblem.penalties.iter().any(|one| one.excess > 0.0));
                let at = |k: usize| subproblem.u[k] + du[k];
                let is_bound =
                    |u: Sticks| (0..4).any(|row| (u[row].abs() - U_MAX[row]).abs() < 1e-9);
                bounded += usize::from((0..horizon_steps).any(|k| is_bound(at(k))));
            }
            assert_eq!(beyond > 10, with_walls, "{beyond} plans beyond a wall");
            assert!(bounded > 10, "{bounded} of {} with a bound", subproblems.len());
        }
    }
}
