use super::*;
use crate::{Matrix, Vector};

/// `s' = s + dt (p s + u)` with two states of which the sum is observed; all else by default.
#[derive(Debug, Clone, Copy)]
struct Plain;

impl Model<2, 2, 1, 1> for Plain {
    fn step(&self, s: &Vector<2>, u: &Vector<2>, p: &Vector<1>, dt_s: f64) -> Vector<2> {
        s + dt_s * (p[0] * s + u)
    }

    fn observe(&self, s: &Vector<2>) -> Vector<1> {
        Vector::from([s.sum()])
    }
}

const DT_S: f64 = 0.1;

fn point() -> (Vector<2>, Vector<2>, Vector<1>) {
    (Vector::from([1.0, -2.0]), Vector::from([0.5, 0.25]), Vector::from([3.0]))
}

#[test]
fn a_step_and_its_default_derivatives_come_together_for_estimator_and_controller() {
    let (s, u, p) = point();
    let identity = Matrix::<2, 2>::identity();
    let estimator = Plain.linearize(&s, &u, &p, DT_S);
    assert_eq!(estimator.s_next, Plain.step(&s, &u, &p, DT_S));
    assert!((estimator.by_state - identity * 1.3).norm() < 1e-8, "{estimator:?}");
    assert!((estimator.by_parameter - s * DT_S).norm() < 1e-8, "{estimator:?}");
    let controller = Plain.linearize_by_input(&s, &u, &p, DT_S);
    assert_eq!((controller.s_next, controller.by_state), (estimator.s_next, estimator.by_state));
    assert!((controller.by_input - identity * DT_S).norm() < 1e-8, "{controller:?}");
    let by_state = Plain.observe_by_state(&s);
    assert!((by_state - Matrix::<1, 2>::repeat(1.0)).norm() < 1e-8, "{by_state}");
}

#[test]
fn a_model_that_names_nothing_has_rows_all_controllable_and_no_subsystems() {
    struct Count(usize);

    impl VisitSubsystems for Count {
        fn visit<const S: usize, const P: usize>(
            &mut self,
            _states: &'static [usize; S],
            _inputs: &'static [usize],
            _parameters: &'static [usize; P],
        ) {
            self.0 += 1;
        }
    }
    assert_eq!((Plain::NAME, Plain::CONTROLLABLE), ("unnamed", 2));
    assert_eq!(Plain::STATE, [Row::UNNAMED; 2]);
    let mut count = Count(0);
    Plain::subsystems(&mut count);
    assert_eq!(count.0, 0);
}

#[test]
fn rest_is_the_shortest_state_that_is_observed_and_motion_does_not_change_it() {
    let o = Vector::from([3.0]);
    let rest = Plain.at_rest(&o);
    assert!((rest - Vector::from([1.5, 1.5])).norm() < 1e-9, "{rest}");
    let (s, ..) = point();
    assert_eq!(Plain.moving(&o, &Vector::from([9.0]), &s), rest);
}

#[test]
fn a_model_without_velocities_does_not_coast_and_has_no_curvature() {
    let (s, u, p) = point();
    assert_eq!(Plain.coasting(&s, &p), Vector::<1>::zeros());
    assert_eq!(Plain.coasting_by_state(&s, &p), Matrix::<1, 2>::zeros());
    assert_eq!(Plain.hessian_by_parameter(&s, &u, &p, DT_S, &s), None);
    let by_input = &Plain.step_by_input(&s, &u, &p, DT_S);
    let kind = HessianKind::Exact;
    let request = HessianRequest { s: &s, u: &u, p: &p, dt_s: DT_S, by_input, w: &s, kind };
    assert_eq!(Plain.hessian_by_input(&request), None);
}

#[test]
fn without_an_input_nonlinearity_effect_and_input_are_the_same() {
    let (s, u, p) = point();
    assert_eq!((Plain.effect(&u, &p), Plain.input_for(&u, &p)), (u, u));
    let step = Plain.step(&s, &u, &p, DT_S);
    assert_eq!(Plain.core().step(&s, &u, &p, DT_S), step);
    assert_eq!(Plain.prepared(&p, DT_S).step(&s, &u, &p, DT_S), step);
}
