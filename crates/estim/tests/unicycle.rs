//! The estimator on a model that is no drone: a planar unicycle of which only the position is seen.

use horizon_estim::{
    ArrivalTable, Curvature, Ident, IdentTable, LmTable, LossTable, Mhe, MheTable, Observed, Piece,
};
use horizon_model::check::{Point, model_gap};
use horizon_model::{Model, Row};
use nalgebra::{SMatrix, SVector};

/// Rows of the state.
mod state {
    pub(super) const X: usize = 0;
    pub(super) const Y: usize = 1;
    pub(super) const HEADING: usize = 2;
    pub(super) const COUNT: usize = 3;
}

/// Rows of the input.
mod input {
    pub(super) const SPEED: usize = 0;
    pub(super) const TURN: usize = 1;
    pub(super) const COUNT: usize = 2;
}

/// Rows of the parameter.
mod gain {
    pub(super) const SPEED: usize = 0;
    pub(super) const TURN: usize = 1;
    pub(super) const COUNT: usize = 2;
}

const SEEN: usize = 2;
const DT_S: f64 = 0.1;

type State = SVector<f64, { state::COUNT }>;
type Input = SVector<f64, { input::COUNT }>;
type Position = SVector<f64, SEEN>;
type Gains = SVector<f64, { gain::COUNT }>;

/// `x' = k_v v cos(heading)`, `y' = k_v v sin(heading)`, `heading' = k_w w`.
#[derive(Debug, Clone, Copy)]
struct Unicycle;

impl Model<{ state::COUNT }, { input::COUNT }, SEEN, { gain::COUNT }> for Unicycle {
    const NAME: &'static str = "unicycle";
    const STATE: [Row; state::COUNT] =
        [Row::linear("x", "m"), Row::linear("y", "m"), Row::angle("heading")];
    const INPUT: [Row; input::COUNT] = [Row::linear("speed", "m/s"), Row::linear("turn", "rad/s")];
    const OBSERVATION: [Row; SEEN] = [Row::linear("x", "m"), Row::linear("y", "m")];
    const PARAMETER: [Row; gain::COUNT] = [Row::linear("k_v", "1"), Row::linear("k_w", "1")];

    fn step(&self, s: &State, u: &Input, p: &Gains, dt_s: f64) -> State {
        let (sin, cos) = s[state::HEADING].sin_cos();
        let way = dt_s * p[gain::SPEED] * u[input::SPEED];
        s + State::new(way * cos, way * sin, dt_s * p[gain::TURN] * u[input::TURN])
    }

    fn step_by_state(&self, s: &State, u: &Input, p: &Gains, dt_s: f64) -> SMatrix<f64, 3, 3> {
        let (sin, cos) = s[state::HEADING].sin_cos();
        let way = dt_s * p[gain::SPEED] * u[input::SPEED];
        let mut j = SMatrix::identity();
        j[(state::X, state::HEADING)] = -way * sin;
        j[(state::Y, state::HEADING)] = way * cos;
        j
    }

    fn step_by_input(&self, s: &State, _: &Input, p: &Gains, dt_s: f64) -> SMatrix<f64, 3, 2> {
        let (sin, cos) = s[state::HEADING].sin_cos();
        let mut j = SMatrix::zeros();
        j[(state::X, input::SPEED)] = dt_s * p[gain::SPEED] * cos;
        j[(state::Y, input::SPEED)] = dt_s * p[gain::SPEED] * sin;
        j[(state::HEADING, input::TURN)] = dt_s * p[gain::TURN];
        j
    }

    fn step_by_parameter(&self, s: &State, u: &Input, _: &Gains, dt_s: f64) -> SMatrix<f64, 3, 2> {
        let (sin, cos) = s[state::HEADING].sin_cos();
        let mut j = SMatrix::zeros();
        j[(state::X, gain::SPEED)] = dt_s * u[input::SPEED] * cos;
        j[(state::Y, gain::SPEED)] = dt_s * u[input::SPEED] * sin;
        j[(state::HEADING, gain::TURN)] = dt_s * u[input::TURN];
        j
    }

    fn observe(&self, s: &State) -> Position {
        Position::new(s[state::X], s[state::Y])
    }

    fn observe_by_state(&self, _: &State) -> SMatrix<f64, SEEN, 3> {
        SMatrix::identity()
    }

    fn at_rest(&self, o: &Position) -> State {
        State::new(o.x, o.y, 0.0)
    }
}

#[test]
fn the_model_meets_its_numeric_twin() {
    for heading in [-4.0, 0.0, 1.0, 3.2] {
        let at = Point {
            s: State::new(1.0, -2.0, heading),
            u: Input::new(0.8, -0.5),
            p: Gains::new(1.2, 0.9),
            dt_s: DT_S,
        };
        let gap = model_gap(&Unicycle, &at).gap;
        assert!(gap < 1e-8, "gap {gap:e} at heading {heading}");
    }
}

#[test]
fn heading_and_gains_are_found_from_positions_alone() {
    // A long window that starts where the last one ended, and a short one that remembers.
    let carried = ArrivalTable::Carried { c_0: vec![10.0, 10.0, 1.0], forget_s: 100.0 };
    for (window_steps, arrival, shift_prior) in
        [(60, ArrivalTable::Fixed, true), (10, carried, false)]
    {
        let table = MheTable { window_steps, arrival, shift_prior, ..mhe_table() };
        let settings = table.check::<Unicycle, 3, 2, SEEN, 2>().unwrap();
        let mut mhe = Mhe::new(Unicycle, settings, DT_S).unwrap();
        let truth = Gains::new(1.3, 0.8);
        // The estimator starts with a heading of zero and must find out.
        let mut s = State::new(0.5, -0.5, 0.6);
        mhe.start(&Unicycle.observe(&s)).unwrap();
        for k in 0..400 {
            let t = f64::from(k) * DT_S;
            let u = Input::new(1.0 + 0.3 * t.sin(), 0.7 * (0.7 * t).cos() + 0.2);
            s = Unicycle.step(&s, &u, &truth, DT_S);
            let observed = match k % 4 {
                3 => Observed::missing(),
                _ => Observed::full(Unicycle.observe(&s)),
            };
            let report = mhe.update(&u, &observed, &mut || false).unwrap();
            assert!(report.cost.is_finite(), "{report:?}");
        }
        let gap = (mhe.s_hat() - s).norm();
        assert!(gap < 1e-3, "{:?}: state off by {gap}", table.arrival);
        let gap = (mhe.p_hat() - truth).norm();
        assert!(gap < 1e-3, "{:?}: gains {} instead of {truth}", table.arrival, mhe.p_hat());
    }
}

fn mhe_table() -> MheTable {
    MheTable {
        window_steps: 60,
        c_o: vec![10.0, 10.0],
        c_s: vec![5.0, 5.0, 5.0],
        c_p: vec![0.1, 0.1],
        p_prior: vec![1.0, 1.0],
        p_lb: vec![0.2, 0.2],
        p_ub: vec![3.0, 3.0],
        observation_loss: LossTable::Huber { scale: 5.0 },
        transition_loss: LossTable::None {},
        arrival: ArrivalTable::Fixed,
        shift_prior: true,
        solver: LmTable {
            damping_start: 1e-6,
            cost_tolerance: 1e-10,
            step_tolerance: 1e-10,
            iterations_max: 50,
        },
    }
}

#[test]
fn identification_finds_the_gains_and_every_heading() {
    let table = IdentTable {
        c_o: vec![10.0, 10.0],
        c_s: vec![5.0, 5.0, 5.0],
        c_p: vec![0.0, 0.0],
        c_0: vec![0.0, 0.0, 0.0],
        p_prior: vec![1.0, 1.0],
        p_lb: vec![0.2, 0.2],
        p_ub: vec![3.0, 3.0],
        observation_loss: LossTable::Huber { scale: 5.0 },
        transition_loss: LossTable::None {},
        curvature: Curvature::Exact,
        solver: LmTable {
            damping_start: 1e-6,
            cost_tolerance: 1e-12,
            step_tolerance: 1e-12,
            iterations_max: 100,
        },
    };
    let settings = table.check::<Unicycle, 3, 2, SEEN, 2>().unwrap();
    let truth = Gains::new(1.3, 0.8);
    let mut driven = Vec::new();
    let piece = |heading: f64| {
        let mut s = State::new(0.5, -0.5, heading);
        let (mut u, mut o) = (Vec::new(), Vec::new());
        for k in 0..100 {
            let t = f64::from(k) * DT_S;
            let input = Input::new(1.0 + 0.3 * t.sin(), 0.7 * (0.7 * t).cos() + 0.2);
            o.push(Observed::full(Unicycle.observe(&s)));
            driven.push(s);
            s = Unicycle.step(&s, &input, &truth, DT_S);
            u.push(input);
        }
        Piece { u, o }
    };
    let pieces: Vec<_> = [-0.6, 0.2, 0.9].map(piece).into();
    let mut ident = Ident::new(Unicycle, &settings, DT_S, pieces).unwrap();
    let report = ident.solve(&mut || false).unwrap();
    let gap = (ident.parameter() - truth).norm();
    // Noise-free: the cost is 0 at the truth.
    assert!(gap < 1e-4, "gains {} instead of {truth}, {report:?}", ident.parameter());
    let estimated = (0..ident.pieces()).flat_map(|piece| ident.states(piece));
    for (k, (s, expected)) in estimated.zip(&driven).enumerate() {
        let gap = (s - expected).norm();
        assert!(gap < 1e-4, "state {k} off by {gap:e}");
    }
}
