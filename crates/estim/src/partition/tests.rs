use horizon_model::check::amax;
use horizon_model::rows::{Motion, Pose, Sticks, lag, motion, pose, stick};
use horizon_model::{Bounds, Lagged, Matrix, Vector};

use super::*;
use crate::arrival_cost::ArrivalSettings;
use crate::chain::Chain;
use crate::levenberg::{LmSettings, LmTable, solve};
use crate::loss::Loss;
use crate::residual::{Observed, Residuals};
use crate::window_problem::{Prior, WindowProblem};

const DT_S: f64 = 0.02;
const WINDOW: usize = 6;

type Parameter = Vector<{ lag::COUNT }>;
type Window = WindowProblem<Lagged, { motion::COUNT }, 4, { pose::COUNT }, { lag::COUNT }>;

fn window() -> Window {
    let p_prior = Parameter::from([1.9, 0.89, 1.4, -0.06, 0.64, 0.25, 0.12, 0.07, 0.12, 0.08, 1.1]);
    let residuals = Residuals {
        model: Lagged::default(),
        dt_s: DT_S,
        c_o: Vector::from([1000.0, 1000.0, 1000.0, 150.0]),
        c_s: Motion::from([200.0, 200.0, 200.0, 100.0, 1.0, 1.0, 5.0, 3.0, 1.5, 1.5, 5.0]),
        observation_loss: Loss::Huber { scale: 2.0 },
        transition_loss: Loss::None,
    };
    let bounds =
        Bounds { lo: p_prior - Parameter::repeat(0.05), hi: p_prior + Parameter::repeat(0.1) };
    let prior = Prior { c_p: Parameter::repeat(30.0), p_prior, bounds };
    let arrival = ArrivalSettings::Carried { c_0: Motion::repeat(20.0), forget_s: 2.0 };
    let mut window = WindowProblem::new(residuals, prior, arrival, WINDOW);
    window.start(Motion::zeros());
    window
}

/// Sticks and pose of step `k`: a flight that the prior does not explain, with jumps of height and heading.
fn recorded(k: u32) -> (Sticks, Observed<{ pose::COUNT }>) {
    let t = DT_S * f64::from(k);
    let u =
        Sticks::new((2.0 * t).sin(), (3.0 * t).cos(), 0.5 * (5.0 * t).sin(), 0.7 * (4.0 * t).cos());
    let mut o = Pose::new(0.4 * t * t, -0.2 * t, 1.0 + 0.3 * t.sin(), 0.5 * t);
    if k % 11 == 5 {
        o[pose::Z] += 0.1;
    }
    if k % 17 == 8 {
        o[pose::THETA] += 0.3;
    }
    (u, if k % 13 == 7 { Observed::missing() } else { Observed::full(o) })
}

#[test]
fn subsystems_are_estimated_as_the_whole() {
    let table = LmTable {
        damping_start: 0.0,
        cost_tolerance: 0.0,
        step_tolerance: 1e-15,
        iterations_max: 2,
    };
    let settings = LmSettings::try_from(&table).unwrap();
    let partition = Partition::of::<Lagged, { stick::COUNT }, { pose::COUNT }>(1).unwrap();
    assert_eq!(partition.subsystems.len(), 2);
    let (mut apart, mut whole) = (window(), window().undivided());
    for k in 0..200 {
        let (u, observed) = recorded(k);
        for window in [&mut apart, &mut whole] {
            // As while a link is down.
            window.hold_parameter((90..120).contains(&k));
            if window.states().len() > WINDOW {
                window.pop();
            }
            window.push(&u, &observed);
            let report = solve(window, &settings, &mut || false).unwrap();
            assert!(report.cost.is_finite(), "{report:?}");
        }
        let gap = amax(&(apart.newest() - whole.newest()));
        let p_gap = amax(&(apart.parameter() - whole.parameter()));
        // Rounding alone; the conditions of the two differ.
        assert!(gap < 1e-9 && p_gap < 1e-9, "{gap:e}, {p_gap:e} in step {k}");
        let [found, expected] = [&apart, &whole].map(|one| one.newest_covariance().unwrap());
        let gap = amax(&(found - expected)) / amax(&expected);
        assert!(gap < 1e-9, "covariance gap {gap:e} in step {k}");
    }
    assert!(amax(&(whole.parameter() - window().parameter())) > 0.01, "there was no information");
}

/// A chain of three integrators in three subsystems of any order; `HELD` of them are named.
#[derive(Debug, Clone, Copy)]
struct Integrators<const HELD: usize>;

impl<const HELD: usize> Model<3, 1, 3, 1> for Integrators<HELD> {
    fn subsystems(visit: &mut impl VisitSubsystems) {
        if HELD > 0 {
            visit.visit(&[2], &[], &[]);
            visit.visit(&[0], &[0], &[0]);
        }
        if HELD > 2 {
            visit.visit(&[1], &[], &[]);
        }
    }

    fn step(&self, s: &Vector<3>, u: &Vector<1>, p: &Vector<1>, dt_s: f64) -> Vector<3> {
        s + Vector::from([p.x * u.x, 0.0, 0.0]) * dt_s
    }

    fn observe(&self, s: &Vector<3>) -> Vector<3> {
        *s
    }
}

#[test]
fn any_number_of_subsystems_of_any_size_is_taken_if_they_hold_every_row() {
    assert!(Partition::of::<Integrators<0>, 1, 3>(1).is_none(), "one system");
    assert!(Partition::of::<Integrators<2>, 1, 3>(1).is_none(), "a row is in none of them");
    assert_eq!(Partition::of::<Integrators<3>, 1, 3>(1).unwrap().subsystems.len(), 3);
    let equations = |k: usize| {
        let k = k as f64;
        Block::<3, 1> {
            diagonal: Matrix::from_diagonal(&Vector::from([3.0 + k, 4.0, 5.0])),
            before: Matrix::from_diagonal(&Vector::from([-1.0, 0.5, -0.3 * k])),
            border: Matrix::from([[0.7, 0.0, 0.0]]),
            gradient: Vector::from([1.0, -k, 0.2]),
        }
    };
    let mut whole = Chain::<3, 1>::new(4);
    let mut apart = Chain::new(4).partitioned(Partition::of::<Integrators<3>, 1, 3>(4));
    for chain in [&mut whole, &mut apart] {
        chain.clear(4);
        for (k, block) in chain.blocks_mut().iter_mut().enumerate() {
            *block = equations(k);
        }
        chain.parameter_block.hessian.fill(9.0);
    }
    let (expected, reduced) = (whole.eliminate(0.1).unwrap(), apart.eliminate(0.1).unwrap());
    assert!(amax(&(expected.hessian - reduced.hessian)) < 1e-14);
    assert!((expected.decrease - reduced.decrease).abs() < 1e-14);
    let p_step = Vector::from([0.4]);
    let steps = apart.clone().back_substitute(&p_step).to_vec();
    for (step, expected) in steps.iter().zip(whole.back_substitute(&p_step)) {
        assert!(amax(&(step - expected)) < 1e-14, "{step} instead of {expected}");
    }
}

/// Two integrators whose subsystems have these rows of the state.
#[derive(Debug, Clone, Copy)]
struct Grouped<const FIRST: usize, const SECOND: usize>;

impl<const FIRST: usize, const SECOND: usize> Model<2, 2, 2, 2> for Grouped<FIRST, SECOND> {
    fn step(&self, s: &Vector<2>, u: &Vector<2>, p: &Vector<2>, dt_s: f64) -> Vector<2> {
        s + u.component_mul(p) * dt_s
    }

    fn observe(&self, s: &Vector<2>) -> Vector<2> {
        *s
    }

    fn subsystems(to: &mut impl VisitSubsystems) {
        to.visit(&const { [FIRST] }, &[0], &[0]);
        to.visit(&const { [SECOND] }, &[1], &[1]);
    }
}

#[test]
fn subsystems_that_do_not_hold_each_row_once_are_no_partition() {
    assert!(Partition::<2, 2>::of::<Grouped<0, 1>, 2, 2>(1).is_some());
    assert!(Partition::<2, 2>::of::<Grouped<0, 0>, 2, 2>(1).is_none(), "one twice");
    assert!(Partition::<2, 2>::of::<Grouped<0, 5>, 2, 2>(1).is_none(), "one beyond the state");
}
