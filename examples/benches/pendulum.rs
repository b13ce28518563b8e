//! Time of MHE and MPC of the pendulum on a cart, its model with derivatives by hand and as compiled expressions.
//!
//! `cargo bench -p horizon-examples --bench pendulum` prints the times of both models, in turn, and their ratios. The
//! flight is that of the notebook `pendulum` of the Python package. Iterations and the final state must be equal.

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use horizon_control::{Mpc, MpcProblem, MpcSettings};
use horizon_estim::{Mhe, MheSettings, Observed};
use horizon_model::check::amax;
use horizon_model::expression::{Binary, Compiled, Graph, Program, Unary, Variable};
use horizon_model::nalgebra::{SMatrix, SVector};
use horizon_model::{Linearized, LinearizedByInput, Model};

const DT_S: f64 = 0.04;
const STAGES: usize = 30;
const STEPS: u32 = 250;
const FLIGHTS: usize = 200;
const CALLS: u32 = 200_000;
const GRAVITY_MPS2: f64 = 9.81;

/// Rows of the state.
mod row {
    /// Place of the cart. m
    pub(super) const X: usize = 0;
    /// Angle from upright. rad
    pub(super) const ANGLE: usize = 1;
    /// Velocity of the cart. m/s
    pub(super) const V: usize = 2;
    /// Rate of the angle. rad/s
    pub(super) const RATE: usize = 3;
}

/// State [`row`], input (acceleration of the cart, m/s^2), parameter (length, m).
#[derive(Debug, Clone, Copy)]
struct ByHand;

impl ByHand {
    /// Step, derivatives of rate and angle by the angle, derivatives of the rate by input and by parameter.
    fn terms(
        s: &SVector<f64, 4>,
        u: SVector<f64, 1>,
        p: SVector<f64, 1>,
        dt_s: f64,
    ) -> (SVector<f64, 4>, [f64; 3]) {
        let ([accel], [length]): ([f64; 1], [f64; 1]) = (u.into(), p.into());
        let [x, angle, v, rate]: [f64; 4] = (*s).into();
        let (sin, cos) = angle.sin_cos();
        let turn = (GRAVITY_MPS2 * sin - cos * accel) / length;
        let rate = rate + turn * dt_s;
        let v = v + accel * dt_s;
        let s_next = [x + v * dt_s, angle + rate * dt_s, v, rate].into();
        let by_angle = (GRAVITY_MPS2 * cos + sin * accel) / length * dt_s;
        (s_next, [by_angle, -cos / length * dt_s, -turn / length * dt_s])
    }

    fn by_state(rate_by_angle: f64, dt_s: f64) -> SMatrix<f64, 4, 4> {
        let mut by_state = SMatrix::identity();
        by_state[(row::X, row::V)] = dt_s;
        by_state[(row::ANGLE, row::ANGLE)] = 1.0 + rate_by_angle * dt_s;
        by_state[(row::ANGLE, row::RATE)] = dt_s;
        by_state[(row::RATE, row::ANGLE)] = rate_by_angle;
        by_state
    }
}

impl Model<4, 1, 2, 1> for ByHand {
    fn step(
        &self,
        s: &SVector<f64, 4>,
        u: &SVector<f64, 1>,
        p: &SVector<f64, 1>,
        dt_s: f64,
    ) -> SVector<f64, 4> {
        Self::terms(s, *u, *p, dt_s).0
    }

    fn linearize(
        &self,
        s: &SVector<f64, 4>,
        u: &SVector<f64, 1>,
        p: &SVector<f64, 1>,
        dt_s: f64,
    ) -> Linearized<4, 1> {
        let (s_next, [by_angle, _, by_length]) = Self::terms(s, *u, *p, dt_s);
        let by_parameter = [0.0, by_length * dt_s, 0.0, by_length].into();
        Linearized { s_next, by_state: Self::by_state(by_angle, dt_s), by_parameter }
    }

    fn linearize_by_input(
        &self,
        s: &SVector<f64, 4>,
        u: &SVector<f64, 1>,
        p: &SVector<f64, 1>,
        dt_s: f64,
    ) -> LinearizedByInput<4, 1> {
        let (s_next, [by_angle, by_input, _]) = Self::terms(s, *u, *p, dt_s);
        let by_input = [dt_s * dt_s, by_input * dt_s, dt_s, by_input].into();
        LinearizedByInput { s_next, by_state: Self::by_state(by_angle, dt_s), by_input }
    }

    fn observe(&self, s: &SVector<f64, 4>) -> SVector<f64, 2> {
        [s[row::X], s[row::ANGLE]].into()
    }

    fn observe_by_state(&self, _s: &SVector<f64, 4>) -> SMatrix<f64, 2, 4> {
        SMatrix::identity()
    }
}

/// The same equations as a graph, as the Python package traces them.
fn compiled() -> Result<Compiled<4, 1, 2, 1>, Box<dyn Error>> {
    use Binary::{Add, Div, Mul, Sub};
    let mut graph = Graph::default();
    let [x, angle, v, rate] =
        [row::X, row::ANGLE, row::V, row::RATE].map(|row| graph.variable(Variable::State(row)));
    let u = graph.variable(Variable::Input(0));
    let length = graph.variable(Variable::Parameter(0));
    let dt = graph.variable(Variable::Period);
    let gravity = graph.constant(GRAVITY_MPS2);
    let (sin, cos) = (graph.unary(Unary::Sin, angle), graph.unary(Unary::Cos, angle));
    let (down, aside) = (graph.binary(Mul, gravity, sin), graph.binary(Mul, cos, u));
    let torque = graph.binary(Sub, down, aside);
    let turn = graph.binary(Div, torque, length);
    let mut moved = |from, rate| {
        let change = graph.binary(Mul, rate, dt);
        graph.binary(Add, from, change)
    };
    let (rate, v) = (moved(rate, turn), moved(v, u));
    let next = [moved(x, v), moved(angle, rate), v, rate];
    let program = Program::compile(&mut graph, &next, &[x, angle], (1, 1))?;
    println!("{} terms", program.terms());
    Compiled::new(Box::leak(Box::new(program))).ok_or_else(|| "the program is too large".into())
}

/// Times and iterations of both solvers in a flight, and its last state.
#[derive(Debug, Clone, Copy)]
struct Flight {
    mpc_s: f64,
    mhe_s: f64,
    mpc_iterations: u32,
    mhe_iterations: u32,
    s: SVector<f64, 4>,
}

/// From an angle of 0.2 rad to half a metre aside, upright.
#[expect(clippy::disallowed_methods, reason = "a bench measures time")]
fn fly<M: Model<4, 1, 2, 1>>(model: M) -> Result<Flight, Box<dyn Error>> {
    let settings = MheSettings::builder([0.6]).c_o([500.0; 2]).c_s([10.0; 4]).window_steps(20);
    let mut mhe = Mhe::new(model, settings.bounds([0.1], [2.0]).build(&model)?, DT_S)?;
    let settings = MpcSettings::builder(STAGES).c_s_end([3.0, 30.0, 3.0, 6.0]);
    let settings = settings.bounds([-8.0], [8.0]).build(&model)?;
    let mut mpc = Mpc::<_, 4, 1, 2, 1, 4>::new(model, settings, DT_S)?;
    let goal = [SVector::from([0.5, 0.0, 0.0, 0.0]); STAGES];
    let (mut s, mut u) = (SVector::from([0.0, 0.2, 0.0, 0.0]), SVector::zeros());
    let mut flight = Flight { mpc_s: 0.0, mhe_s: 0.0, mpc_iterations: 0, mhe_iterations: 0, s };
    mhe.start(&[0.0, 0.2].into())?;
    for k in 0..STEPS {
        let start = Instant::now();
        let problem = MpcProblem::new(mhe.s_hat(), mhe.p_hat(), &u, &goal);
        flight.mpc_iterations += mpc.solve(&problem, &mut || false)?.iterations;
        u = mpc.plan()[0];
        mpc.shift();
        flight.mpc_s += start.elapsed().as_secs_f64();
        s = ByHand.step(&s, &u, &[0.45].into(), DT_S);
        // Uniform noise with a standard deviation of 1 mm and 1 mrad.
        let noise = |factor: u32| 0.0017 * (f64::from(k * factor % 101) / 50.0 - 1.0);
        let o = SVector::from([s[row::X] + noise(7919), s[row::ANGLE] + noise(6101)]);
        let start = Instant::now();
        flight.mhe_iterations += mhe.update(&u, &Observed::full(o), &mut || false)?.iterations;
        flight.mhe_s += start.elapsed().as_secs_f64();
    }
    Ok(Flight { s, ..flight })
}

/// Time of one call of each function of a model. s
#[expect(clippy::disallowed_methods, reason = "a bench measures time")]
fn calls<M: Model<4, 1, 2, 1>>(model: M) -> [f64; 5] {
    let (s, u, p) = (SVector::from([0.1, 0.2, 0.3, -0.4]), [0.7].into(), [0.45].into());
    let time = |call: &dyn Fn(&SVector<f64, 4>)| {
        let start = Instant::now();
        for _ in 0..CALLS {
            call(black_box(&s));
        }
        start.elapsed().as_secs_f64() / f64::from(CALLS)
    };
    [
        time(&|s| {
            _ = black_box(model.step(s, &u, &p, DT_S));
        }),
        time(&|s| {
            _ = black_box(model.linearize(s, &u, &p, DT_S));
        }),
        time(&|s| {
            _ = black_box(model.linearize_by_input(s, &u, &p, DT_S));
        }),
        time(&|s| {
            _ = black_box(model.observe(s));
        }),
        time(&|s| {
            _ = black_box(model.observe_by_state(s));
        }),
    ]
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

fn main() -> Result<(), Box<dyn Error>> {
    let compiled = compiled()?;
    let mut flights = Vec::new();
    for _ in 0..FLIGHTS {
        flights.push((fly(ByHand)?, fly(compiled)?));
    }
    let Some((hand, other)) = flights.last() else { return Ok(()) };
    let iterations = |flight: &Flight| [flight.mpc_iterations, flight.mhe_iterations];
    assert_eq!(iterations(hand), iterations(other));
    assert!(amax(&(hand.s - other.s)) < 1e-9, "{} {}", hand.s, other.s);
    println!("iterations of MPC and MHE: {:?}", iterations(hand));
    let calls: Vec<_> = (0..9).map(|_| (calls(ByHand), calls(compiled))).collect();
    let row = |name: &str, scale: f64, hand: Vec<f64>, compiled: Vec<f64>| {
        let ratio = median(hand.iter().zip(&compiled).map(|(hand, compiled)| compiled / hand));
        let [hand, compiled] = [hand, compiled].map(|times| scale * median(times.into_iter()));
        println!("{name:<24} {hand:>8.2} {compiled:>9.2} {ratio:>6.2}");
    };
    println!("{:<24} {:>8} {:>9} {:>6}", "median", "by hand", "compiled", "ratio");
    for (name, of) in [
        ("MPC, us a step", (|flight| flight.mpc_s) as fn(&Flight) -> f64),
        ("MHE, us a step", |flight| flight.mhe_s),
    ] {
        let [a, b] = [
            flights.iter().map(|pair| of(&pair.0)).collect(),
            flights.iter().map(|pair| of(&pair.1)).collect(),
        ];
        row(name, 1e6 / f64::from(STEPS), a, b);
    }
    for (at, name) in
        ["step, ns", "step by s, p, ns", "step by s, u, ns", "observe, ns", "observe by s, ns"]
            .iter()
            .enumerate()
    {
        let [a, b] = [
            calls.iter().map(|pair| pair.0[at]).collect(),
            calls.iter().map(|pair| pair.1[at]).collect(),
        ];
        row(name, 1e9, a, b);
    }
    Ok(())
}
