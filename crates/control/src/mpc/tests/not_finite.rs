//! Models and constraints that are not finite are errors that name the place, and leave the plan as it was.

use super::*;
use crate::{Excess, SoftConstraints};
use horizon_model::{Matrix, Vector};

/// `s' = s + dt u`, with a factor on its derivatives from `s = 0.3` on.
#[derive(Debug, Clone, Copy)]
struct Spoilt {
    by_state: f64,
    by_input: f64,
}

impl Model<1, 1, 1, 0> for Spoilt {
    fn step(&self, s: &Vector1<f64>, u: &Vector1<f64>, _p: &Vector<0>, dt_s: f64) -> Vector1<f64> {
        s + u * dt_s
    }

    fn step_by_state(
        &self,
        s: &Vector1<f64>,
        _u: &Vector1<f64>,
        _p: &Vector<0>,
        _dt_s: f64,
    ) -> Matrix<1, 1> {
        Vector1::new(if s[0] > 0.3 { self.by_state } else { 1.0 })
    }

    fn step_by_input(
        &self,
        s: &Vector1<f64>,
        _u: &Vector1<f64>,
        _p: &Vector<0>,
        dt_s: f64,
    ) -> Matrix<1, 1> {
        Vector1::new(if s[0] > 0.3 { self.by_input * dt_s } else { dt_s })
    }

    fn observe(&self, s: &Vector1<f64>) -> Vector1<f64> {
        *s
    }
}

const STAGES: usize = 5;

fn solve(spoilt: Spoilt, s_0: f64) -> (Result<MpcReport, SqpError>, [Vec<Vector1<f64>>; 2]) {
    let settings = MpcSettings::builder(STAGES).build(&spoilt).unwrap();
    let mut mpc = Mpc::<_, 1, 1, 1, 0, 1>::new(spoilt, settings, 0.1).unwrap();
    mpc.plan.u.fill(Vector1::new(0.25));
    let before = mpc.plan().to_vec();
    let (s_0, p, u) = (Vector1::new(s_0), Vector::zeros(), Vector1::zeros());
    let report =
        mpc.solve(&MpcProblem::new(&s_0, &p, &u, &[Vector1::new(1.0); STAGES]), &mut || false);
    (report, [before, mpc.plan().to_vec()])
}

#[test]
fn a_derivative_that_is_not_finite_is_an_error_that_names_its_stage() {
    let spoils = [(f64::NAN, 1.0), (1.0, f64::NAN), (f64::INFINITY, 1.0), (1.0, f64::INFINITY)];
    for (by_state, by_input) in spoils {
        // The plan passes 0.3 in stage 3.
        let (report, [before, after]) = solve(Spoilt { by_state, by_input }, 0.26);
        let error = report.unwrap_err();
        assert_eq!(error, SqpError::Derivative { stage: 2 });
        assert_eq!(error.to_string(), "a derivative of the model is not finite in stage 2");
        assert_eq!(before, after);
    }
    let (report, _) = solve(Spoilt { by_state: 1.0, by_input: 1.0 }, 0.26);
    assert_eq!(report.unwrap().stop, SqpStop::CostTolerance);
}

#[test]
fn a_derivative_that_is_not_finite_along_an_improved_plan_ends_the_solve_with_it() {
    let (report, [before, after]) = solve(Spoilt { by_state: f64::NAN, by_input: 1.0 }, 0.0);
    let report = report.unwrap();
    assert!(report.has_new_plan() && report.cost < report.cost_start, "{report:?}");
    assert_ne!(before, after);
}

/// Two equal constraints that are met, of which the second one is spoilt from the third stage on.
struct Wrong(Excess<4>);

impl SoftConstraints<4> for Wrong {
    fn count(&self) -> usize {
        2
    }

    fn excess(&self, i: usize, _s: &Pose, ahead_s: f64) -> Option<Excess<4>> {
        let is_wrong = i == 1 && ahead_s > 2.5 * DT_S;
        Some(if is_wrong { self.0 } else { GOOD })
    }
}

const GOOD: Excess<4> =
    Excess { value: -1.0, gradient: Pose::new(0.0, 0.0, 1.0, 0.0), weight: 1.0 };

#[test]
fn a_constraint_that_is_not_finite_or_has_a_negative_weight_is_an_error_that_names_it() {
    let bad_gradient = Pose::new(0.0, f64::INFINITY, 0.0, 0.0);
    for (excess, what, value) in [
        (Excess { value: f64::NAN, ..GOOD }, "value", f64::NAN),
        (Excess { value: f64::INFINITY, ..GOOD }, "value", f64::INFINITY),
        (Excess { gradient: bad_gradient, ..GOOD }, "gradient", f64::INFINITY),
        (Excess { weight: f64::NAN, ..GOOD }, "weight", f64::NAN),
        (Excess { weight: -5.0, ..GOOD }, "weight", -5.0),
        (Excess { weight: 1e200, ..GOOD }, "squared weight", f64::INFINITY),
    ] {
        let mut case = Case::new(&table(6, 0.8));
        let settings = case.mpc.settings().clone().with_constraints(2);
        case.mpc = Mpc::new(Kinematic, settings, DT_S).unwrap();
        let before = case.mpc.plan().to_vec();
        let Case { mpc, s_0, p, u_before, s_ref, .. } = &mut case;
        let problem = MpcProblem::new(s_0, p, u_before, s_ref);
        let error = mpc.solve_with(&problem, Some(&Wrong(excess)), &mut || false).unwrap_err();
        let reason = if value < 0.0 { "negative" } else { "not finite" };
        let shown = format!("{what} of constraint 1 after stage 2: {value} is {reason}");
        assert_eq!(error.to_string(), shown);
        assert_eq!(mpc.plan(), before);
        // The next problem is answered.
        let good = mpc.solve_with(&problem, Some(&Wrong(GOOD)), &mut || false).unwrap();
        assert_eq!(good.stop, SqpStop::CostTolerance);
    }
}

#[test]
fn more_places_for_constraints_than_memory_are_refused() {
    let settings = MpcSettings::builder(5).build(&Kinematic).unwrap();
    let error = Mpc::<_, 4, 4, 4, 4, 4>::new(Kinematic, settings.with_constraints(1 << 40), DT_S);
    let error = error.unwrap_err().to_string();
    assert_eq!(error, "constraints_max = 1099511627776: expected 0..=1000");
}
