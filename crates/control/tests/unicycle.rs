//! The controller knows no vehicle: it steers a planar unicycle to a place beside it.

use horizon_control::{InputCost, Mpc, MpcProblem, MpcTable, QpKind, SolverTable, SqpStop};
use horizon_model::check::{Point, amax, model_gap};
use horizon_model::{Model, Row};
use nalgebra::{SMatrix, SVector};

const DT_S: f64 = 0.1;
const X: usize = 0;
const Y: usize = 1;
const HEADING: usize = 2;
const SPEED: usize = 0;
const TURN: usize = 1;
const GRIP: usize = 0;

/// `x' = x + dt grip speed cos(heading)`, `y' = y + dt grip speed sin(heading)`,
/// `heading' = heading + dt turn`; it cannot move sideways.
#[derive(Debug, Clone, Copy)]
struct Unicycle;

impl Model<3, 2, 2, 1> for Unicycle {
    const NAME: &'static str = "unicycle";
    const STATE: [Row; 3] = [Row::linear("x", "m"), Row::linear("y", "m"), Row::angle("heading")];
    const INPUT: [Row; 2] = [Row::linear("speed", "m/s"), Row::linear("turn", "rad/s")];
    const OBSERVATION: [Row; 2] = [Row::linear("x", "m"), Row::linear("y", "m")];
    const PARAMETER: [Row; 1] = [Row::linear("grip", "1")];

    fn step(
        &self,
        s: &SVector<f64, 3>,
        u: &SVector<f64, 2>,
        p: &SVector<f64, 1>,
        dt_s: f64,
    ) -> SVector<f64, 3> {
        let (sin, cos) = s[HEADING].sin_cos();
        let way = dt_s * p[GRIP] * u[SPEED];
        s + SVector::from([way * cos, way * sin, dt_s * u[TURN]])
    }

    fn step_by_state(
        &self,
        s: &SVector<f64, 3>,
        u: &SVector<f64, 2>,
        p: &SVector<f64, 1>,
        dt_s: f64,
    ) -> SMatrix<f64, 3, 3> {
        let (sin, cos) = s[HEADING].sin_cos();
        let way = dt_s * p[GRIP] * u[SPEED];
        let mut j = SMatrix::identity();
        j[(X, HEADING)] = -way * sin;
        j[(Y, HEADING)] = way * cos;
        j
    }

    fn step_by_input(
        &self,
        s: &SVector<f64, 3>,
        _u: &SVector<f64, 2>,
        p: &SVector<f64, 1>,
        dt_s: f64,
    ) -> SMatrix<f64, 3, 2> {
        let (sin, cos) = s[HEADING].sin_cos();
        let mut j = SMatrix::zeros();
        j[(X, SPEED)] = dt_s * p[GRIP] * cos;
        j[(Y, SPEED)] = dt_s * p[GRIP] * sin;
        j[(HEADING, TURN)] = dt_s;
        j
    }

    fn step_by_parameter(
        &self,
        s: &SVector<f64, 3>,
        u: &SVector<f64, 2>,
        _p: &SVector<f64, 1>,
        dt_s: f64,
    ) -> SMatrix<f64, 3, 1> {
        let (sin, cos) = s[HEADING].sin_cos();
        let mut j = SMatrix::zeros();
        j[(X, GRIP)] = dt_s * u[SPEED] * cos;
        j[(Y, GRIP)] = dt_s * u[SPEED] * sin;
        j
    }

    fn observe(&self, s: &SVector<f64, 3>) -> SVector<f64, 2> {
        SVector::from([s[X], s[Y]])
    }

    fn observe_by_state(&self, _s: &SVector<f64, 3>) -> SMatrix<f64, 2, 3> {
        SMatrix::identity()
    }

    fn at_rest(&self, o: &SVector<f64, 2>) -> SVector<f64, 3> {
        SVector::from([o[X], o[Y], 0.0])
    }
}

#[test]
fn the_unicycle_is_a_right_model() {
    for heading in [-4.0, 0.0, 1.0, 3.2] {
        let at = Point {
            s: SVector::from([0.3, -0.2, heading]),
            u: SVector::from([0.7, -0.4]),
            p: SVector::from([0.9]),
            dt_s: DT_S,
        };
        let gap = model_gap(&Unicycle, &at).gap;
        assert!(gap < 1e-8, "gap {gap:e} at {heading}");
    }
}

#[test]
fn a_unicycle_parks_beside_where_it_stood_within_its_bounds() {
    let table = MpcTable {
        horizon_steps: 40,
        stages: Vec::new(),
        input_cost: InputCost::Absolute,
        c_u: vec![0.1, 0.1],
        c_s: vec![1.0, 2.0, 0.3],
        c_s_end: vec![10.0, 10.0, 3.0],
        u_lb: vec![-0.5, -1.2],
        u_ub: vec![0.8, 1.2],
        solver: SolverTable {
            qp: QpKind::Riccati,
            cost_tolerance: 1e-6,
            iterations_max: 50,
            qp_tolerance: 1e-9,
            qp_iterations_max: 50,
        },
    };
    let settings = table.check::<Unicycle, 3, 2, 2, 1>().unwrap();
    let mut mpc = Mpc::<_, 3, 2, 2, 1, 3>::new(Unicycle, settings, DT_S).unwrap();
    let p = SVector::from([0.9]);
    // One metre to its left, heading as before.
    let s_ref = [SVector::from([0.0, 1.0, 0.0]); 40];
    let mut s = SVector::from([0.0, 0.0, 0.1]);
    let mut u_before = SVector::zeros();
    let mut bound_hits = 0;
    for step in 0..150 {
        let problem = MpcProblem {
            s_0: &s,
            p: &p,
            u_before: &u_before,
            s_ref: &s_ref,
            u_given: &[],
            given_steps: [0; 2],
        };
        let report = mpc.solve(&problem, &mut || false).unwrap();
        assert_eq!(report.stop, SqpStop::CostTolerance, "step {step}: {report:?}");
        let u = mpc.plan()[0];
        assert!((-0.5..=0.8).contains(&u[SPEED]), "step {step}: {u}");
        assert!((-1.2..=1.2).contains(&u[TURN]), "step {step}: {u}");
        bound_hits += u32::from(u[SPEED] > 0.799 || u[TURN].abs() > 1.199);
        s = Unicycle.step(&s, &u, &p, DT_S);
        u_before = u;
        mpc.shift();
    }
    let miss = amax(&(s - s_ref[0]));
    assert!(miss < 0.02, "ends at {s}");
    assert!(bound_hits > 0, "the bounds were never met");
}
