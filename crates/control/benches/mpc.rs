//! Time of one solve by model, horizon and solver of the subproblems.
//!
//! `cargo bench -p horizon-control`. Two flights: that of the published controller (thesis weights,
//! absolute input cost, a target 0.3 m away), and one of the lagged vehicle along a square, where roll,
//! pitch and throttle are given for the first steps and the changes of the inputs are weighed. A
//! solve ends at a predicted relative drop of 1e-6; a warm one includes the shift and one model step.

use std::fmt::{self, Display, Formatter};

use divan::Bencher;
use horizon_control::{Ask, InputCost, Mpc, MpcReport, MpcTable, QpKind, SolverTable};
use horizon_model::rows::{Motion, Pose, Sticks, motion};
use horizon_model::{Kinematic, Lagged, Model};
use nalgebra::SVector;

const DT_S: f64 = 0.02;

/// What one row of the result is about.
#[derive(Debug, Clone, Copy)]
struct Case {
    horizon_steps: usize,
    iterations_max: u32,
    qp: QpKind,
}

impl Display for Case {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self { horizon_steps, iterations_max, qp } = self;
        write!(f, "{horizon_steps} steps, up to {iterations_max} x {qp:?}")
    }
}

/// Both solvers at each of the horizons and limits of iterations.
fn cases<const N: usize>(sizes: [(usize, u32); N]) -> impl Iterator<Item = Case> {
    sizes.into_iter().flat_map(|(horizon_steps, iterations_max)| {
        [QpKind::Riccati, QpKind::Clarabel].map(|qp| Case { horizon_steps, iterations_max, qp })
    })
}

/// Ticks of the lagged flight: around the square once.
const TICKS: u32 = 4 * SIDE_TICKS;

fn main() {
    for case in cases([(13, 50), (50, 50)]) {
        let mut flight = KinematicFlight::new(case);
        println!("kinematic, {case}, from zeros: {:?}", flight.solve());
        println!("kinematic, {case}, shifted: {:?}", flight.tick());
    }
    for case in cases([(70, 1), (70, 5)]) {
        let mut flight = LaggedFlight::new(case);
        let (mut iterations, mut qp_iterations, mut qp_fallbacks) = (0, 0, 0);
        for _ in 0..TICKS {
            let report = flight.tick();
            iterations += report.iterations;
            qp_iterations += report.qp_iterations;
            qp_fallbacks += report.qp_fallbacks;
        }
        println!(
            "lagged, {case}, {TICKS} ticks: {iterations} iterations, {qp_iterations} inner ones, \
             {qp_fallbacks} fall-backs"
        );
    }
    divan::main();
}

fn solver(case: Case) -> SolverTable {
    SolverTable {
        qp: case.qp,
        cost_tolerance: 1e-6,
        iterations_max: case.iterations_max,
        qp_tolerance: 1e-8,
        qp_iterations_max: 50,
    }
}

/// The published controller on its way to a target that stays ahead of it.
struct KinematicFlight {
    mpc: Mpc<Kinematic, 4, 4, 4, 4, 4>,
    s: Pose,
}

impl KinematicFlight {
    #[expect(clippy::unwrap_used, reason = "a benchmark that cannot run has nothing to say")]
    fn new(case: Case) -> Self {
        let table = MpcTable {
            horizon_steps: case.horizon_steps,
            stages: Vec::new(),
            input_cost: InputCost::Absolute,
            c_u: vec![1.2, 1.2, 0.8, 0.8],
            c_s: vec![1.5, 1.5, 1.0, 1.0],
            c_s_end: vec![15.0, 15.0, 10.0, 10.0],
            u_lb: vec![-0.8, -0.8, -1.0, -1.0],
            u_ub: vec![0.8, 0.8, 1.0, 1.0],
            solver: solver(case),
        };
        let settings = table.check::<Kinematic, 4, 4, 4, 4>().unwrap();
        let s = Pose::new(0.0, 0.0, 0.9, 0.5);
        Self { mpc: Mpc::new(Kinematic, settings, DT_S).unwrap(), s }
    }

    fn p() -> SVector<f64, 4> {
        SVector::from([1.29, 0.445, 0.994, 0.033])
    }

    #[expect(clippy::unwrap_used, reason = "a benchmark that cannot run has nothing to say")]
    fn solve(&mut self) -> MpcReport {
        let s_ref = vec![self.s + Pose::new(0.2, 0.15, 0.1, -0.13); self.mpc.plan().len()];
        let ask = Ask {
            s_0: &self.s,
            p: &Self::p(),
            u_before: &Sticks::zeros(),
            s_ref: &s_ref,
            u_given: &[],
            given_steps: [0; 4],
        };
        self.mpc.solve(&ask, &mut || false).unwrap()
    }

    /// One step on, a little beside what was planned.
    fn tick(&mut self) -> MpcReport {
        self.s = Kinematic.step(&self.s, &self.mpc.plan()[0], &Self::p(), DT_S);
        self.s += Pose::new(2e-3, -2e-3, 2e-3, 3e-3);
        self.mpc.shift();
        self.solve()
    }
}

/// The lagged vehicle along a square of 1.5 m, without its dead zone.
struct LaggedFlight {
    model: Lagged,
    mpc: Mpc<Lagged, 11, 4, 4, 11, { motion::CONTROLLABLE }>,
    s: Motion,
    s_ref: Vec<Motion>,
    u_given: Vec<Sticks>,
    ticks: u32,
}

/// By axis, how many more steps are in transit than on the quickest axis.
const GIVEN_STEPS: [usize; 4] = [14, 14, 0, 7];

/// Ticks per side of the square.
const SIDE_TICKS: u32 = 95;

impl LaggedFlight {
    #[expect(clippy::unwrap_used, reason = "a benchmark that cannot run has nothing to say")]
    fn new(case: Case) -> Self {
        let model = Lagged::default().core();
        let weights = |pose: [f64; 4]| {
            let mut weights = vec![0.0; 11];
            weights[..4].copy_from_slice(&pose);
            weights
        };
        let table = MpcTable {
            horizon_steps: case.horizon_steps,
            stages: Vec::new(),
            input_cost: InputCost::Difference,
            c_u: vec![1.0, 1.0, 0.5, 0.5],
            c_s: weights([3.0, 3.0, 4.0, 1.0]),
            c_s_end: weights([10.0, 10.0, 10.0, 3.0]),
            u_lb: vec![-0.9; 4],
            u_ub: vec![0.9; 4],
            solver: solver(case),
        };
        let settings = table.check::<Lagged, 11, 4, 4, 11>().unwrap();
        let s = model.at_rest(&Self::target(0));
        Self {
            mpc: Mpc::new(model, settings, DT_S).unwrap(),
            s_ref: vec![s; case.horizon_steps],
            u_given: vec![Sticks::zeros(); case.horizon_steps.min(20)],
            model,
            s,
            ticks: 0,
        }
    }

    fn p() -> SVector<f64, 11> {
        [1.9, 0.89, 1.4, -0.06, 0.64, 0.25, 0.12, 0.07, 0.12, 0.08, 1.1].into()
    }

    /// Where the vehicle should be at a tick: along the side at 0.8 m/s, around the corner at once.
    fn target(tick: u32) -> Pose {
        let along = 1.5 * f64::from(tick % SIDE_TICKS) / f64::from(SIDE_TICKS);
        match (tick / SIDE_TICKS) % 4 {
            0 => Pose::new(along, 0.0, 1.3, 0.0),
            1 => Pose::new(1.5, along, 1.3, 0.0),
            2 => Pose::new(1.5 - along, 1.5, 1.3, 0.0),
            _ => Pose::new(0.0, 1.5 - along, 1.3, 0.0),
        }
    }

    #[expect(clippy::unwrap_used, reason = "a benchmark that cannot run has nothing to say")]
    fn solve(&mut self) -> MpcReport {
        for (k, s_ref) in (1..).zip(&mut self.s_ref) {
            *s_ref = self.model.at_rest(&Self::target(self.ticks + k));
        }
        let ask = Ask {
            s_0: &self.s,
            p: &Self::p(),
            u_before: &self.u_given[0],
            s_ref: &self.s_ref,
            u_given: &self.u_given[1..],
            given_steps: GIVEN_STEPS,
        };
        self.mpc.solve(&ask, &mut || false).unwrap()
    }

    /// One step on, a little beside what was planned.
    fn tick(&mut self) -> MpcReport {
        let plan = self.mpc.plan();
        let given_count = self.u_given.len();
        self.u_given.copy_from_slice(&plan[..given_count]);
        self.s = self.model.step(&self.s, &plan[0], &Self::p(), DT_S);
        let side = if self.ticks.is_multiple_of(2) { 1.0 } else { -0.8 };
        self.s += side * self.model.at_rest(&Pose::new(2e-3, -2e-3, 2e-3, 3e-3));
        self.ticks += 1;
        self.mpc.shift();
        self.solve()
    }
}

#[divan::bench(args = cases([(13, 50), (25, 50), (50, 50)]))]
fn kinematic_from_zeros(bencher: Bencher<'_, '_>, case: Case) {
    let mut flight = KinematicFlight::new(case);
    bencher.bench_local(|| {
        flight.mpc.reset();
        flight.solve()
    });
}

#[divan::bench(args = cases([(13, 50), (25, 50), (50, 50)]))]
fn kinematic_from_the_shifted_plan(bencher: Bencher<'_, '_>, case: Case) {
    let mut flight = KinematicFlight::new(case);
    bencher.bench_local(|| flight.tick());
}

#[divan::bench(args = cases([(35, 1), (70, 1), (70, 5)]), sample_count = TICKS)]
fn lagged_from_the_shifted_plan(bencher: Bencher<'_, '_>, case: Case) {
    let mut flight = LaggedFlight::new(case);
    bencher.bench_local(|| flight.tick());
}
