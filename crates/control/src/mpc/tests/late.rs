//! Solves that run out of time.

use super::*;

#[test]
fn a_late_solve_keeps_what_it_has_and_says_so() {
    let mut case = Case::new(&table(13, 0.8));
    let report = case.solve_while(&mut || true).unwrap();
    assert_eq!((report.stop, report.iterations, report.qp_iterations), (SqpStop::Late, 0, 0));
    assert!(!report.has_new_plan());
    assert_eq!(*case.mpc.plan(), [Sticks::zeros(); 13]);

    let mut questions = 0;
    let mut late_at_third = || {
        questions += 1;
        questions == 3
    };
    let report = case.solve_while(&mut late_at_third).unwrap();
    assert_eq!((report.stop, report.iterations, questions), (SqpStop::Late, 2, 3));
    assert!(report.has_new_plan() && report.cost < report.cost_start);
}

#[test]
fn the_fall_back_is_not_begun_late() {
    let solver = SolverTable { qp: QpKind::Riccati, qp_iterations_max: 1, ..table(1, 1.0).solver };
    let mut case = Case::new(&MpcTable { solver, ..table(13, 0.05) });
    // Active bounds take more than one iteration: the second question is the fall-back's.
    let mut answers = [false, true].into_iter();
    let report = case.solve_while(&mut || answers.next().unwrap()).unwrap();
    assert_eq!((report.stop, report.iterations, report.qp_iterations), (SqpStop::Late, 0, 1));
    assert_eq!(answers.next(), None);
    assert_eq!(*case.mpc.plan(), [Sticks::zeros(); 13]);
}
