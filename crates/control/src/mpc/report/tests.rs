use horizon_model::Kinematic;
use horizon_model::rows::{Pose, Sticks};

use super::*;

/// Stages of one, two and one steps.
fn settings() -> MpcSettings<4, 4> {
    MpcSettings::builder(4).stages(&[(1, 1), (1, 2), (1, 1)]).build(&Kinematic).unwrap()
}

/// The entries of a problem.
struct Entries {
    s_0: Pose,
    p: Pose,
    u_before: Sticks,
    s_ref: Vec<Pose>,
    u_given: Vec<Sticks>,
    given_steps: [usize; 4],
}

/// The answer to a problem without fault, once `spoil` has changed it.
fn check(spoil: impl FnOnce(&mut Entries)) -> Result<(), SqpError> {
    let mut entries = Entries {
        s_0: Pose::zeros(),
        p: Pose::zeros(),
        u_before: Sticks::zeros(),
        s_ref: vec![Pose::zeros(); 3],
        u_given: vec![Sticks::zeros(); 3],
        given_steps: [0, 1, 3, 0],
    };
    spoil(&mut entries);
    let Entries { s_0, p, u_before, s_ref, u_given, given_steps } = &entries;
    let problem = MpcProblem { s_0, p, u_before, s_ref, u_given, given_steps: *given_steps };
    problem.check(&settings())
}

#[test]
fn an_ask_needs_a_reference_for_each_stage_and_given_inputs_that_end_with_one() {
    assert_eq!(check(|_| ()), Ok(()));
    assert_eq!(
        check(|problem| problem.s_ref.truncate(2)),
        Err(SqpError::Horizon { given: 2, stages: 3 })
    );
    assert_eq!(
        check(|problem| problem.s_ref.clear()),
        Err(SqpError::Horizon { given: 0, stages: 3 })
    );
    assert_eq!(
        check(|problem| problem.given_steps[2] = 2),
        Err(SqpError::Inside { row: 2, given_steps: 2 })
    );
    let refused = |row, given_steps, given| {
        Err(SqpError::Given { row, given_steps, given, horizon_steps: 4 })
    };
    assert_eq!(check(|problem| problem.given_steps[3] = 4), refused(3, 4, 3));
    let many = |given_steps| {
        move |problem: &mut Entries| {
            problem.u_given.resize(9, Sticks::zeros());
            problem.given_steps[0] = given_steps;
        }
    };
    assert_eq!(check(many(4)), Ok(()));
    assert_eq!(check(many(5)), refused(0, 5, 9));
}

#[test]
fn every_number_has_to_be_finite_and_the_first_that_is_not_is_named() {
    let mut bad = Pose::zeros();
    bad[2] = f64::INFINITY;
    let value = f64::INFINITY;
    let refused = |what, at| Err(SqpError::NotFinite { what, at, row: 2, value });
    assert_eq!(check(|problem| problem.s_0 = bad), refused("s_0", None));
    assert_eq!(check(|problem| problem.p = bad), refused("p", None));
    assert_eq!(check(|problem| problem.u_before = bad), refused("u_before", None));
    assert_eq!(check(|problem| problem.s_ref[1] = bad), refused("s_ref", Some(1)));
    assert_eq!(check(|problem| problem.u_given[2] = bad), refused("u_given", Some(2)));
    assert_eq!(refused("p", None).unwrap_err().to_string(), "p[2] = inf is not finite");
    let error = refused("s_ref", Some(1)).unwrap_err();
    assert_eq!(error.to_string(), "s_ref[1][2] = inf is not finite");
}

#[test]
fn a_plan_is_new_if_it_was_improved_or_found_optimal() {
    let report = |stop, iterations| MpcReport {
        stop,
        iterations,
        qp_iterations: 7,
        qp_fallbacks: 0,
        cost_start: 2.0,
        cost: 1.0,
    };
    for (stop, is_new_at_once) in [
        (SqpStop::CostTolerance, true),
        (SqpStop::IterationLimit, false),
        (SqpStop::Late, false),
        (SqpStop::QpUnsolved, false),
        (SqpStop::Stalled, false),
    ] {
        assert_eq!(report(stop, 0).has_new_plan(), is_new_at_once, "{stop:?}");
        assert!(report(stop, 1).has_new_plan(), "{stop:?}");
    }
}
