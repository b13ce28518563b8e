//! One quadratic subproblem of the controller beside packaged solvers of quadratic programs.
//!
//! Owns the sequence. Ours is one whole iteration of the controller, warm along the square: shift, roll-out,
//! linearization, the subproblem with second derivatives, line search. Peers get the subproblems
//! without second derivatives, linearized and condensed for them; their time is that of update and
//! solution alone.

use std::fmt::Write as _;

use anyhow::Result;
use tello_control::InputCost;
use tello_io::clock::Clock;
use tello_model::rows::Pose;

use super::comparison::{Comparison, Program, Solve, findings};
use super::mhe::write_row;
use super::mpc::{self, Case};
use super::{Bench, Findings, square};

/// Horizons, ticks along the square, and the best packaged solver there with the ratio aimed at.
const SIZES: [(usize, usize, &str); 2] = [(13, 400, "daqp"), (50, 200, "piqp")];

/// Packaged solvers.
const PEERS: [&str; 3] = ["daqp", "osqp", "piqp"];

/// Our time over that of the best of them that was aimed at.
const GOAL: f64 = 0.1;

/// Both horizons.
///
/// # Errors
/// A solve that fails, a peer that fails.
pub(super) fn run(bench: &Bench) -> Result<Findings> {
    let peer = bench.workshop.python("qp")?;
    let mut comparisons = Vec::new();
    for (horizon_steps, ticks, best) in SIZES {
        let cases = square::record(horizon_steps, ticks)?;
        let mut text = format!("{ticks} {horizon_steps}\n");
        iterate(&cases, horizon_steps, &mut text)?;
        let file = bench.workshop.write(&format!("qp_{horizon_steps}"), &text)?;
        let ours = || iterate(&cases, horizon_steps, &mut String::new());
        let mut programs = vec![Program::new("ours, a whole iteration", ours)];
        for name in PEERS.into_iter().filter(|_| peer.is_some()) {
            let (peer, file) = (peer.clone(), file.clone());
            let run = move || {
                let answers = peer.as_ref().map(|peer| peer.run(&file, &[name])).transpose()?;
                Ok(answers.into_iter().flatten().map(|answer| answer.solve).collect())
            };
            programs.push(Program::new(name, run).with_goal((name == best).then_some(GOAL)));
        }
        let name = format!("MPC QP {horizon_steps}, warm along the square");
        comparisons.push(Comparison::run(name, Vec::new(), programs, bench.repetitions)?);
    }
    Ok(findings(&comparisons)?)
}

/// One iteration of the controller for each case; writes the problems around the plans that it starts
/// from.
fn iterate(cases: &[Case], horizon_steps: usize, problems: &mut String) -> Result<Vec<Solve>> {
    let mut mpc = mpc::controller_of(horizon_steps, InputCost::Absolute, (1e-15, 1))?;
    let clock = Clock::start();
    let mut s_ref = vec![Pose::zeros(); horizon_steps];
    let mut solves = Vec::with_capacity(cases.len());
    for case in cases {
        s_ref.fill(case.s_ref);
        let mut plan = mpc.plan().to_vec();
        plan.rotate_left(1);
        plan.last_mut().zip(mpc.plan().last()).into_iter().for_each(|(u, last)| *u = *last);
        [case.p, case.s_0, case.s_ref].iter().try_for_each(|row| write_row(problems, row))?;
        plan.iter().try_for_each(|u| write_row(problems, u))?;
        writeln!(problems)?;
        let start = clock.now();
        mpc.shift();
        let report = mpc::solve(&mut mpc, case, &s_ref)?;
        let us = clock.now().since(start).seconds() * 1e6;
        solves.push(Solve {
            us,
            iterations: report.qp_iterations,
            cost: report.cost,
            kkt: f64::NAN,
        });
    }
    Ok(solves)
}
