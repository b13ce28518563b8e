//! Soft constraints on the states of a plan.

use horizon_model::Vector;
use horizon_model::check::{amax, jacobian_gap, maximum};

use super::*;
use crate::qp::tests::case::Numbers;
use crate::{Excess, SoftConstraints, StateBounds};

/// A pole in the plane of the first two rows that is not to be nearer than `radius`, and the half-plane `x <= wall`.
#[derive(Debug, Clone, Copy)]
struct Pole {
    at: [f64; 2],
    radius: f64,
    wall: f64,
    weight: f64,
}

impl SoftConstraints<4> for Pole {
    fn count(&self) -> usize {
        2
    }

    fn excess(&self, i: usize, s: &Pose, _ahead_s: f64) -> Option<Excess<4>> {
        let mut gradient = Pose::zeros();
        if i == 0 {
            gradient[pose::X] = 1.0;
            return Some(Excess { value: s[pose::X] - self.wall, gradient, weight: self.weight });
        }
        let [x, y] = [s[pose::X] - self.at[0], s[pose::Y] - self.at[1]];
        let distance = x.hypot(y);
        (gradient[pose::X], gradient[pose::Y]) = (-x / distance, -y / distance);
        Some(Excess { value: self.radius - distance, gradient, weight: self.weight })
    }
}

fn case(qp: QpKind, steps: usize) -> Case {
    let table = table(steps, 0.8);
    let mut case = Case::new(&MpcTable { solver: SolverTable { qp, ..table.solver }, ..table });
    let settings = case.mpc.settings().clone().with_constraints(2);
    case.mpc = Mpc::new(Kinematic, settings, DT_S).unwrap();
    case
}

fn solve_with(case: &mut Case, constraints: &dyn SoftConstraints<4>) -> MpcReport {
    let Case { mpc, s_0, p, u_before, s_ref, u_given, given_steps } = case;
    let given_steps = *given_steps;
    let problem = MpcProblem { s_0, p, u_before, s_ref, u_given, given_steps };
    mpc.solve_with(&problem, Some(constraints), &mut || false).unwrap()
}

/// The target of [`Case`] lies behind both.
const POLE: Pole = Pole { at: [0.2, -0.52], radius: 0.09, wall: 0.25, weight: 300.0 };

#[test]
fn both_solvers_plan_the_same_around_a_pole() {
    let [(riccati, by_riccati), (interior, by_interior)] =
        [QpKind::Riccati, QpKind::Clarabel].map(|qp| {
            let mut case = case(qp, 40);
            (solve_with(&mut case, &POLE), case.mpc.plan().to_vec())
        });
    assert_eq!((riccati.stop, interior.stop), (SqpStop::CostTolerance, SqpStop::CostTolerance));
    assert!((riccati.cost / interior.cost - 1.0).abs() < 1e-7, "{riccati:?}, {interior:?}");
    for (a, b) in by_riccati.iter().zip(&by_interior) {
        assert!(amax(&(a - b)) < 2e-3, "{a} beside {b}");
    }
}

#[test]
fn a_plan_keeps_off_what_it_would_run_into() {
    let excess_max = |case: &Case| {
        let excess = |s: &Pose| {
            (0..2).filter_map(|i| POLE.excess(i, s, 0.0)).map(|one| one.value).fold(-1.0, maximum)
        };
        case.mpc.planned_states().iter().map(excess).fold(-1.0, maximum)
    };
    let mut free = case(QpKind::Riccati, 40);
    assert!(free.solve().has_new_plan());
    let free_m = excess_max(&free);
    let mut held = case(QpKind::Riccati, 40);
    assert!(solve_with(&mut held, &POLE).has_new_plan());
    let held_m = excess_max(&held);
    assert!(free_m > 0.05 && held_m < 0.003, "{free_m} m without, {held_m} m with");
}

#[test]
fn constraints_that_are_met_leave_the_bits_of_the_plan() {
    let far = Pole { at: [50.0, 50.0], wall: 50.0, ..POLE };
    let (mut with, mut without) = (case(QpKind::Riccati, 40), case(QpKind::Riccati, 40));
    assert_eq!(solve_with(&mut with, &far), without.solve());
    assert_eq!(with.mpc.plan(), without.mpc.plan());
}

#[test]
fn the_reduced_gradient_with_penalties_meets_its_numeric_twin() {
    for (wall, radius) in [(0.0, 0.09), (0.05, 0.3), (0.25, 0.4), (0.08, 0.2)] {
        let pole = Pole { radius, wall, ..POLE };
        let mut case = case(QpKind::Riccati, 6);
        let Case { mpc, s_0, p, u_before, s_ref, .. } = &mut case;
        let problem = MpcProblem::new(s_0, p, u_before, s_ref);
        let context = CostContext {
            u_before: problem.u_before,
            s_ref: problem.s_ref,
            constraints: Some(&pole),
        };
        let plan = |x: &Vector<24>| -> Vec<Sticks> {
            x.as_slice().chunks(4).map(Vector::from_column_slice).collect()
        };
        let at = Vector::<24>::from_fn(|i, _| 0.3 * (i as f64).sin());
        mpc.trial.u = plan(&at);
        mpc.roll_out(&problem, &context, RollOut::StatesAndDynamics);
        mpc.take_trial();
        mpc.fill_gradients(&context).unwrap();
        let gradient = mpc.expansion.reduced_gradient.clone();
        let gradient = Vector::<24>::from_iterator(gradient.iter().flat_map(|g| g.iter()).copied());
        assert!(mpc.expansion.penalties.iter().any(|one| one.excess > 0.0), "{pole:?}");
        let cell = std::cell::RefCell::new(mpc);
        let cost = |x: &Vector<24>| {
            let mut mpc = cell.borrow_mut();
            mpc.trial.u = plan(x);
            Vector1::new(mpc.roll_out(&problem, &context, RollOut::States))
        };
        let gap = jacobian_gap(cost, &at, &gradient.transpose());
        assert!(gap < 1e-6, "gap {gap:e} at {pole:?}");
    }
}

#[test]
fn the_predicted_decrease_with_penalties_is_exact_for_a_linear_motion() {
    // Without a turn the motion is linear in the sticks; the wall is linear anyway, and the pole is far away.
    let pole = Pole { at: [50.0, 50.0], wall: 0.09, ..POLE };
    let mut case = case(QpKind::Riccati, 6);
    let Case { mpc, s_0, p, u_before, s_ref, .. } = &mut case;
    let problem = MpcProblem::new(s_0, p, u_before, s_ref);
    let context =
        CostContext { u_before: problem.u_before, s_ref: problem.s_ref, constraints: Some(&pole) };
    let sticks = |k: usize, length: f64| {
        let mut u = Sticks::from_fn(|i, _| length * (3.0 * k as f64 + i as f64).sin());
        u[stick::YAW] = 0.0;
        u
    };
    let bounds = [Bounds { lo: Sticks::repeat(-1.0), hi: Sticks::repeat(1.0) }; 6];
    for direction in [-0.6, -0.2, 0.2, 0.6] {
        let before: Vec<Sticks> = (0..6).map(|k| sticks(k, 0.3)).collect();
        mpc.trial.u.clone_from(&before);
        let cost = mpc.roll_out(&problem, &context, RollOut::StatesAndDynamics);
        mpc.take_trial();
        mpc.fill_gradients(&context).unwrap();
        mpc.expansion.du = (0..6).map(|k| sticks(k + 1, direction)).collect();
        let predicted = mpc.expansion.complete_step(&before, &bounds, false).decrease;
        mpc.trial.u = before.iter().zip(&mpc.expansion.du).map(|(u, du)| u + du).collect();
        let decrease = cost - mpc.roll_out(&problem, &context, RollOut::States);
        assert!(
            (predicted - decrease).abs() < 1e-9 * cost,
            "{predicted} instead of {decrease} of {cost}"
        );
        assert!(mpc.expansion.penalties.iter().any(|one| one.excess > 0.0));
    }
}

#[test]
fn more_constraints_than_places_are_refused() {
    let mut case = Case::new(&table(5, 0.8));
    let Case { mpc, s_0, p, u_before, s_ref, .. } = &mut case;
    let problem = MpcProblem::new(s_0, p, u_before, s_ref);
    let error = mpc.solve_with(&problem, Some(&POLE), &mut || false).unwrap_err();
    assert_eq!(error.to_string(), "2 constraints, but the settings have places for 0");
}

#[test]
fn bounded_rows_stop_at_their_bounds() {
    // The plan leads from (0.1, -0.4) to (0.4, -0.6).
    let (mut lo, mut hi) = (Pose::repeat(f64::NEG_INFINITY), Pose::repeat(f64::INFINITY));
    (hi[pose::X], lo[pose::Y]) = (0.2, -0.45);
    let bounds = StateBounds::new(lo, hi, Pose::repeat(300.0)).unwrap();
    let beyond = |case: &Case| {
        let of_state = |s: &Pose| maximum(s[pose::X] - 0.2, -0.45 - s[pose::Y]);
        case.mpc.planned_states().iter().map(of_state).fold(-1.0, maximum)
    };
    let mut free = case(QpKind::Riccati, 40);
    assert!(free.solve().has_new_plan());
    let mut held = case(QpKind::Riccati, 40);
    let settings = held.mpc.settings().clone().with_constraints(bounds.count());
    held.mpc = Mpc::new(Kinematic, settings, DT_S).unwrap();
    assert!(solve_with(&mut held, &bounds).has_new_plan());
    let (free, held) = (beyond(&free), beyond(&held));
    assert!(free > 0.05 && held < 0.005, "{free} m without bounds, {held} m with them");
    let at = Pose::new(0.3, -0.2, 0.1, 3.3);
    let bounded = (0..bounds.count()).filter(|i| {
        let Some(found) = bounds.excess(*i, &at, 0.0) else { return false };
        let value = |s: &Pose| Vector1::new(bounds.excess(*i, s, 0.0).unwrap().value);
        let gap = jacobian_gap(value, &at, &found.gradient.transpose());
        assert!(gap < 1e-8, "gap {gap:e} of constraint {i}");
        true
    });
    assert!(bounded.eq([pose::X, 4 + pose::Y]));
}

/// Start and target anywhere, some of them beyond the bounds of rows that weigh 1e4.
#[test]
fn stiff_bounds_of_the_state_always_leave_a_plan() {
    for (qp, steps) in [QpKind::Riccati, QpKind::Clarabel].into_iter().zip([20, 80]) {
        let table = table(steps, 0.8);
        let solver = SolverTable { qp, cost_tolerance: 1e-6, qp_tolerance: 1e-8, ..table.solver };
        let table = MpcTable { solver, ..table };
        let (mut fallbacks, mut violated) = (0, 0);
        for seed in 0..30 {
            let mut numbers = Numbers::new(seed);
            let mut case = Case::new(&table);
            let settings = case.mpc.settings().clone().with_constraints(8);
            case.mpc = Mpc::new(Kinematic, settings, DT_S).unwrap();
            case.s_0 = numbers.fill();
            case.s_ref.fill(numbers.fill());
            let hi = Pose::repeat(0.5) + numbers.fill() * 0.4;
            let bounds = StateBounds::new(-hi, hi, Pose::repeat(1e4)).unwrap();
            let report = solve_with(&mut case, &bounds);
            assert!(report.has_new_plan(), "seed {seed}, {qp:?}: {report:?}");
            fallbacks += report.qp_fallbacks;
            violated += u32::from(case.s_0.iter().zip(&hi).any(|(s, hi)| s.abs() > *hi));
        }
        let falls_back = qp == QpKind::Riccati;
        assert!((fallbacks > 0) == falls_back && violated > 10, "{fallbacks}, {violated}");
    }
}

#[test]
fn the_plan_that_is_set_decides_on_which_side_a_pole_is_passed() {
    let pole = Pole { at: [0.2, 0.0], radius: 0.09, wall: 50.0, weight: 300.0 };
    let passed_m = [0.5, -0.5].map(|roll| {
        let mut case = case(QpKind::Riccati, 40);
        (case.s_0, case.p[gain::THETA_0]) = (Pose::new(0.0, 0.0, 1.0, 0.0), 0.0);
        case.s_ref.fill(Pose::new(0.4, 0.0, 1.0, 0.0));
        case.mpc.set_plan(&[Sticks::new(roll, 0.5, 0.0, 0.0); 40]).unwrap();
        assert!(solve_with(&mut case, &pole).has_new_plan());
        let beside = |s: &&Pose| (s[pose::X] - 0.2).abs() < 0.02;
        case.mpc.planned_states().iter().find(beside).unwrap()[pose::Y]
    });
    assert!(passed_m[0] < -0.08 && passed_m[1] > 0.08, "{passed_m:?} m beside the pole's middle");
}
