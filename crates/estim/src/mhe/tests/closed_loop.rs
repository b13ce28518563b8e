//! Flights of a vehicle with lag whose parameters the estimator has to find out.

use horizon_model::rows::{Motion, Pose, Sticks, lag, motion, pose, stick};
use horizon_model::{Lagged, Matrix, Vector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::super::*;
use crate::levenberg::LeastSquares;

const DT_S: f64 = 0.02;
const FORGET_S: f64 = 60.0;

type Parameter = Vector<{ lag::COUNT }>;
type Estimator = Mhe<Lagged, { motion::COUNT }, { stick::COUNT }, { pose::COUNT }, { lag::COUNT }>;

/// What the estimator expects.
fn nominal() -> Parameter {
    let mut p = Parameter::zeros();
    (p[lag::LAMBDA_H], p[lag::TAU_H], p[lag::DEAD_H]) = (1.9, 0.64, 0.07);
    (p[lag::LAMBDA_V], p[lag::TAU_V], p[lag::DEAD_V]) = (0.89, 0.25, 0.12);
    (p[lag::LAMBDA_A], p[lag::TAU_A], p[lag::DEAD_A]) = (1.4, 0.12, 0.08);
    (p[lag::THETA_0], p[lag::A_MAX]) = (-0.06, 1.1);
    p
}

/// The vehicle that flies: 15 % stronger, and turned by 0.1 rad.
fn truth() -> Parameter {
    let mut p = nominal();
    p[lag::LAMBDA_H] *= 1.15;
    p[lag::THETA_0] += 0.1;
    p
}

/// Standard deviations of the parameter; what is not to adapt has a small one.
fn sd_parameter() -> Parameter {
    let mut sd = Parameter::repeat(1e-3);
    (sd[lag::LAMBDA_H], sd[lag::LAMBDA_V]) = (0.3, 0.1);
    (sd[lag::LAMBDA_A], sd[lag::THETA_0]) = (0.2, 0.1);
    sd
}

fn table() -> MheTable {
    let sd_observed = Pose::new(4e-4, 4e-4, 4e-4, 4e-3);
    let mut sd_step = Motion::repeat(2e-4);
    sd_step.fixed_rows_mut::<{ stick::COUNT }>(motion::V_X).fill(2e-3);
    (sd_step[motion::D_X], sd_step[motion::D_Y], sd_step[motion::D_Z]) = (9e-3, 9e-3, 4e-3);
    let mut sd_start = Motion::repeat(0.2);
    sd_start.fixed_rows_mut::<{ pose::COUNT }>(motion::X).fill(0.01);
    let p = nominal();
    let mut p_lb = 0.5 * p;
    p_lb[lag::THETA_0] = p[lag::THETA_0] - 0.25;
    MheTable {
        window_steps: 2,
        c_o: sd_observed.map(|sd| 1.0 / sd).as_slice().to_vec(),
        c_s: sd_step.map(|sd| DT_S / sd).as_slice().to_vec(),
        c_p: sd_parameter().map(|sd| 1.0 / sd).as_slice().to_vec(),
        p_prior: p.as_slice().to_vec(),
        p_lb: p_lb.as_slice().to_vec(),
        p_ub: p.map(|p| p + 0.5 * p.abs().max(0.5)).as_slice().to_vec(),
        observation_loss: LossTable::Huber { scale: 2.5 },
        transition_loss: LossTable::None {},
        arrival: ArrivalTable::Carried {
            c_0: sd_start.map(|sd| 1.0 / sd).as_slice().to_vec(),
            forget_s: FORGET_S,
        },
        shift_prior: false,
        solver: LmTable {
            damping_start: 0.0,
            cost_tolerance: 1e-3,
            step_tolerance: 1e-9,
            iterations_max: 3,
        },
    }
}

/// A vehicle in the air, its estimator and the noise of the motion capture.
struct Flight {
    s: Motion,
    mhe: Estimator,
    generator: ChaCha8Rng,
    /// Periods flown.
    k: u32,
}

impl Flight {
    fn new(seed: u64, window_steps: usize) -> Self {
        let table = MheTable { window_steps, ..table() };
        let settings = table.check::<Lagged, 11, 4, 4, 11>().unwrap();
        let mut mhe = Mhe::new(Lagged::default(), settings, DT_S).unwrap();
        let o = Pose::new(0.2, -0.3, 1.0, 0.1);
        mhe.start(&o).unwrap();
        let generator = ChaCha8Rng::seed_from_u64(seed);
        Self { s: Lagged::default().at_rest(&o), mhe, generator, k: 0 }
    }

    /// One period in which `u_applied` acts and `u_reported` is reported to the estimator.
    fn step(&mut self, u_applied: &Sticks, u_reported: &Sticks) {
        self.s = Lagged::default().step(&self.s, u_applied, &truth(), DT_S);
        let sd = Pose::new(3e-4, 3e-4, 3e-4, 3e-3);
        let noise = sd.map(|sd| sd * normal(&mut self.generator));
        let o = Lagged::default().observe(&self.s) + noise;
        let report = self.mhe.update(u_reported, &Observed::full(o), &mut || false).unwrap();
        assert!(report.rejected < report.iterations, "nothing gained: {report:?}");
        self.k += 1;
    }

    /// `steps` periods along the sides of a square of 1 s each.
    fn fly_square(&mut self, steps: u32) {
        for _ in 0..steps {
            let u = square(self.k);
            self.step(&u, &u);
        }
    }

    /// Distance of the estimated horizontal velocity from the true one, rows `rows` of it. m/s
    fn gap_mps(&self, rows: &[[usize; 2]]) -> f64 {
        let gap = self.mhe.s_hat() - self.s;
        let [x, y] = [0, 1].map(|axis| rows.iter().map(|row| gap[row[axis]]).sum::<f64>());
        x.hypot(y)
    }

    /// Of the whole velocity.
    fn velocity_gap_mps(&self) -> f64 {
        self.gap_mps(&[[motion::V_X, motion::V_Y], [motion::D_X, motion::D_Y]])
    }

    /// Of what the sticks drive.
    fn driven_gap_mps(&self) -> f64 {
        self.gap_mps(&[[motion::V_X, motion::V_Y]])
    }
}

/// Sticks that accelerate along one side for half of it and brake for the other.
fn square(k: u32) -> Sticks {
    let push = if k % 50 < 25 { 0.5 } else { -0.5 };
    let mut u = Sticks::zeros();
    match k / 50 % 4 {
        0 => u[stick::PITCH] = push,
        1 => u[stick::ROLL] = push,
        2 => u[stick::PITCH] = -push,
        _ => u[stick::ROLL] = -push,
    }
    u
}

/// Normal with variance 1, from twelve uniform numbers.
fn normal(generator: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| f64::from(generator.next_u32()) / f64::from(u32::MAX)).sum::<f64>() - 6.0
}

#[test]
fn gain_and_heading_of_a_new_vehicle_are_found_in_ten_seconds_and_kept_at_hover() {
    let mut flight = Flight::new(1, 5);
    flight.fly_square(500);
    let p_found = *flight.mhe.p_hat();
    let gain = p_found[lag::LAMBDA_H] / truth()[lag::LAMBDA_H] - 1.0;
    let heading = p_found[lag::THETA_0] - truth()[lag::THETA_0];
    assert!(gain.abs() < 0.03, "gain off by {gain}");
    assert!(heading.abs() < 0.02, "heading off by {heading} rad");

    // At hover there is no new information. The old one fades, and the prior comes back in its place.
    flight.mhe.problem.linearize().unwrap();
    let gathered = flight.mhe.problem.information_of_parameter();
    let hover_steps = 3000;
    for _ in 0..hover_steps {
        flight.step(&Sticks::zeros(), &Sticks::zeros());
    }
    let kept = (-f64::from(hover_steps) * DT_S / FORGET_S).exp();
    let prior = Matrix::from_diagonal(&sd_parameter().map(|sd| (1.0 - kept) / (sd * sd)));
    let information = gathered * kept + prior;
    let p_expected =
        information.try_inverse().unwrap() * (gathered * kept * p_found + prior * nominal());
    for row in [lag::LAMBDA_H, lag::THETA_0] {
        let moved = flight.mhe.p_hat()[row] - p_found[row];
        let expected = p_expected[row] - p_found[row];
        // The first second still brakes: a little is learned.
        assert!((moved / expected - 1.0).abs() < 0.1, "row {row}: {moved} instead of {expected}");
        let behind = p_found[row] - nominal()[row];
        assert!(moved.abs() < 0.1 * behind.abs(), "row {row}: {moved} of {behind}");
    }
}

#[test]
fn an_amended_window_forgets_sticks_that_did_not_act() {
    for seed in 1..=3 {
        let mut flight = Flight::new(seed, 30);
        flight.fly_square(500);
        let lost = 25;
        for _ in 0..lost {
            let u = square(flight.k);
            flight.step(&Sticks::zeros(), &u);
        }
        let before = flight.driven_gap_mps();
        assert!(before > 0.3, "seed {seed}: the lost sticks do no harm: {before} m/s");
        flight.mhe.amend(lost, |_| Sticks::zeros()).unwrap();
        flight.step(&Sticks::zeros(), &Sticks::zeros());
        let (whole, driven) = (flight.velocity_gap_mps(), flight.driven_gap_mps());
        assert!(whole < 0.03, "seed {seed}: velocity off by {whole} m/s");
        assert!(driven < 0.03, "seed {seed}: driven velocity off by {driven} m/s");
    }
}

#[test]
fn an_amendment_is_finite_and_ends_with_the_window() {
    let mut flight = Flight::new(1, 5);
    flight.fly_square(20);
    let twin = flight.mhe.clone();
    let bad = |age: usize| if age == 3 { Sticks::repeat(f64::NAN) } else { Sticks::zeros() };
    let error = flight.mhe.amend(20, bad).unwrap_err();
    assert_eq!(error.to_string(), "input is not finite at window step 1");
    assert_eq!(flight.mhe.problem.iterate().u, twin.problem.iterate().u);
    flight.mhe.amend(20, |age| Sticks::repeat(age as f64)).unwrap();
    let ages: Vec<_> = flight.mhe.problem.iterate().u.iter().map(|u| u[stick::PITCH]).collect();
    assert_eq!(ages, [4.0, 3.0, 2.0, 1.0, 0.0]);
}

#[test]
fn a_held_parameter_stays_while_the_flight_goes_on() {
    let mut flight = Flight::new(1, 5);
    flight.fly_square(100);
    let p = *flight.mhe.p_hat();
    flight.mhe.hold_parameter(true);
    flight.fly_square(100);
    assert_eq!(flight.mhe.p_hat(), &p);
    let gap = flight.velocity_gap_mps();
    assert!(gap < 0.05, "velocity off by {gap} m/s");
    flight.mhe.hold_parameter(false);
    flight.fly_square(1);
    assert_ne!(flight.mhe.p_hat(), &p);
}
