//! The controller against 190 problems solved by Ceres and polished to a KKT residual below 3e-11.

#[path = "reference_mpc/problem.rs"]
mod problem;

use crate::support;

use horizon_control::{Mpc, MpcProblem, MpcSettings, QpKind, SolverTable, SqpStop};
use horizon_model::Kinematic;
use horizon_model::check::{amax, maximum};
use horizon_model::rows::{Pose, Sticks};
use nalgebra::SVector;
use serde::Deserialize;

use self::problem::Problem;

/// Period of the reference problems. s
const DT_S: f64 = 0.02;

/// Relative gap in cost that is allowed above the reference.
const COST_TOLERANCE: f64 = 1e-6;

/// The reference cost is printed with 17 digits; its solution is optimal to 3e-11 in the gradient,
/// which is far below this in the cost.
const ROUNDING: f64 = 1e-12;

/// The solution in a line of the file.
#[derive(Deserialize)]
struct Solution {
    u: Vec<[f64; 4]>,
}

/// Weights and bounds of the reference problems.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn settings(problem: &Problem, qp: QpKind) -> MpcSettings<4, 4> {
    let u_max = [0.8, 0.8, 1.0, 1.0];
    MpcSettings::builder(problem.horizon_steps)
        .input_cost(problem.input_cost)
        .c_u([1.2, 1.2, 0.8, 0.8])
        .c_s([1.5, 1.5, 1.0, 1.0])
        .c_s_end([15.0, 15.0, 10.0, 10.0])
        .bounds(u_max.map(|max: f64| -max), u_max)
        .solver(SolverTable {
            qp,
            cost_tolerance: 1e-9,
            iterations_max: 100,
            qp_tolerance: 1e-10,
            qp_iterations_max: 50,
        })
        .build(&Kinematic)
        .unwrap()
}

/// Worst values over problems of one kind.
#[derive(Default)]
struct Worst {
    count: u32,
    gap: f64,
    u_gap: f64,
    iterations_max: u32,
    iterations_sum: u32,
    qp_iterations_sum: u32,
}

#[test]
fn every_reference_problem_is_solved_from_zero_inputs() {
    let Some(path) = support::data("mpc_problems.jsonl") else { return };
    let text = std::fs::read_to_string(path).unwrap();
    let mut worst: std::collections::BTreeMap<String, Worst> = std::collections::BTreeMap::new();
    let by_both = |line| [QpKind::Riccati, QpKind::Clarabel].map(|qp| (line, qp));
    for ((line, text), qp) in text.lines().enumerate().flat_map(by_both) {
        let problem: Problem = serde_json::from_str(text).unwrap();
        let solution: Solution = serde_json::from_str(text).unwrap();
        let settings = settings(&problem, qp);
        let mut mpc = Mpc::<_, 4, 4, 4, 4, 4>::new(Kinematic, settings, DT_S).unwrap();
        let s_ref = vec![Pose::from(problem.s_ref); problem.horizon_steps];
        let mpc_problem = MpcProblem {
            s_0: &Pose::from(problem.s0),
            p: &SVector::from(problem.p),
            u_before: &Sticks::from(problem.u_prev),
            s_ref: &s_ref,
            u_given: &[],
            given_steps: [0; 4],
        };
        let report = mpc.solve(&mpc_problem, &mut || false).unwrap();

        let gap = report.cost / problem.cost - 1.0;
        let u_gap = mpc
            .plan()
            .iter()
            .zip(&solution.u)
            .map(|(u, reference)| amax(&(u - Sticks::from(*reference))))
            .fold(0.0, maximum);
        let key = format!("{qp:?} {:?} {}", problem.input_cost, problem.horizon_steps);
        let worst = worst.entry(key).or_default();
        worst.count += 1;
        worst.gap = maximum(worst.gap, gap.abs());
        worst.u_gap = maximum(worst.u_gap, u_gap);
        worst.iterations_max = worst.iterations_max.max(report.iterations);
        worst.iterations_sum += report.iterations;
        worst.qp_iterations_sum += report.qp_iterations;
        assert_eq!(report.stop, SqpStop::CostTolerance, "{qp:?}, line {line}: {report:?}");
        assert!(
            gap <= COST_TOLERANCE,
            "{qp:?}, line {line}: {gap:e} above the reference, {report:?}"
        );
        assert!(gap >= -ROUNDING, "{qp:?}, line {line}: {gap:e} below the reference, {report:?}");
    }
    for (kind, worst) in worst {
        let Worst { count, gap, u_gap, iterations_max, .. } = worst;
        let mean = |sum: u32| f64::from(sum) / f64::from(count);
        println!(
            "{kind}: {count} problems, cost gap {gap:.1e}, input gap {u_gap:.1e}, \
             steps {:.1} (max {iterations_max}), inner iterations {:.1}",
            mean(worst.iterations_sum),
            mean(worst.qp_iterations_sum),
        );
    }
}
