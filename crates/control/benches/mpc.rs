//! Time of one solve by horizon, from zeros and from the shifted plan.
//!
//! `cargo bench -p tello-control`. The problem is the published controller's: a target 0.3 m away,
//! thesis weights, absolute input cost. A solve ends at a predicted relative drop of 1e-6.

use divan::Bencher;
use nalgebra::SVector;
use tello_control::{Ask, InputCost, Mpc, MpcTable, QpKind, SolverTable};
use tello_model::rows::{Pose, Sticks};
use tello_model::{Kinematic, Model};

const DT_S: f64 = 0.02;
const HORIZONS: [usize; 3] = [13, 25, 50];

type VehicleMpc = Mpc<Kinematic, 4, 4, 4, 4>;

fn main() {
    for horizon_steps in HORIZONS {
        let mut mpc = vehicle_mpc(horizon_steps);
        let cold = solve(&mut mpc, &start());
        let next = follow(&mut mpc, &start());
        let warm = solve(&mut mpc, &next);
        println!("horizon {horizon_steps}: from zeros {cold:?}, shifted {warm:?}");
    }
    divan::main();
}

#[expect(clippy::unwrap_used, reason = "a benchmark that cannot run has nothing to say")]
fn vehicle_mpc(horizon_steps: usize) -> VehicleMpc {
    let table = MpcTable {
        horizon_steps,
        input_cost: InputCost::Absolute,
        c_u: vec![1.2, 1.2, 0.8, 0.8],
        c_s: vec![1.5, 1.5, 1.0, 1.0],
        c_s_end: vec![15.0, 15.0, 10.0, 10.0],
        u_lb: vec![-0.8, -0.8, -1.0, -1.0],
        u_ub: vec![0.8, 0.8, 1.0, 1.0],
        max_target_distance: 0.3,
        p_correction: vec![0.0; 4],
        solver: SolverTable {
            qp: QpKind::Clarabel,
            cost_tolerance: 1e-6,
            iterations_max: 50,
            qp_tolerance: 1e-8,
            qp_iterations_max: 50,
        },
    };
    let settings = table.check::<Kinematic, 4, 4, 4, 4>().unwrap();
    Mpc::new(Kinematic, settings, DT_S).unwrap()
}

fn parameter() -> SVector<f64, 4> {
    SVector::from([1.29, 0.445, 0.994, 0.033])
}

fn start() -> Pose {
    Pose::new(0.0, 0.0, 0.9, 0.5)
}

/// One solve for a target 0.3 m from `s_0`. Accepted steps and interior-point iterations come back.
#[expect(clippy::unwrap_used, reason = "a benchmark that cannot run has nothing to say")]
fn solve(mpc: &mut VehicleMpc, s_0: &Pose) -> (u32, u32) {
    let s_ref = vec![s_0 + Pose::new(0.2, 0.15, 0.1, -0.13); mpc.plan().len()];
    let (p, u_before) = (parameter(), Sticks::zeros());
    let ask =
        Ask { s_0, p: &p, u_before: &u_before, s_ref: &s_ref, u_given: &[], given_steps: [0; 4] };
    let report = mpc.solve(&ask, &mut || false).unwrap();
    (report.iterations, report.qp_iterations)
}

/// Shifts the plan and says where the vehicle is then, a little beside what was planned.
fn follow(mpc: &mut VehicleMpc, s_0: &Pose) -> Pose {
    let s = Kinematic.step(s_0, &mpc.plan()[0], &parameter(), DT_S);
    mpc.shift();
    s + Pose::new(2e-3, -2e-3, 2e-3, 3e-3)
}

#[divan::bench(args = HORIZONS)]
fn from_zeros(bencher: Bencher<'_, '_>, horizon_steps: usize) {
    let mut mpc = vehicle_mpc(horizon_steps);
    bencher.bench_local(|| {
        mpc.reset();
        solve(&mut mpc, &start())
    });
}

#[divan::bench(args = HORIZONS)]
fn from_the_shifted_plan(bencher: Bencher<'_, '_>, horizon_steps: usize) {
    let mut mpc = vehicle_mpc(horizon_steps);
    let mut s = start();
    bencher.bench_local(|| {
        s = follow(&mut mpc, &s);
        solve(&mut mpc, &s)
    });
}
