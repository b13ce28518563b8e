//! A model written in the type of the scalar has exact derivatives, and needs no other function.

use horizon_model::check::{Point, maximum, model_gap};
use horizon_model::{Dual, DualModel, Model, Row, Scalar, VisitSubsystems};
use nalgebra::SVector;

/// Pendulum on a cart, of which position and angle are observed.
///
/// State (position, angle, velocity, rate), input (acceleration of the cart), parameter (1 / length).
#[derive(Debug, Clone, Copy)]
struct Cart;

impl DualModel<4, 1, 2, 1> for Cart {
    const STATE: [Row; 4] = [
        Row::linear("x", "m"),
        Row::angle("angle"),
        Row::linear("v", "m/s"),
        Row::linear("rate", "rad/s"),
    ];

    fn step<D: Scalar>(
        &self,
        s: &SVector<D, 4>,
        u: &SVector<D, 1>,
        p: &SVector<D, 1>,
        dt_s: f64,
    ) -> SVector<D, 4> {
        let rate = s[3] + p[0] * (s[1].sin() * 9.81 - s[1].cos() * u[0]) * dt_s;
        let v = s[2] + u[0] * dt_s;
        SVector::from([s[0] + v * dt_s, s[1] + rate * dt_s, v, rate])
    }

    fn observe<D: Scalar>(&self, s: &SVector<D, 4>) -> SVector<D, 2> {
        SVector::from([s[0], s[1]])
    }
}

/// The same with what [`Model`] does by default.
#[derive(Debug, Clone, Copy)]
struct Plain;

impl Model<4, 1, 2, 1> for Plain {
    fn step(
        &self,
        s: &SVector<f64, 4>,
        u: &SVector<f64, 1>,
        p: &SVector<f64, 1>,
        dt_s: f64,
    ) -> SVector<f64, 4> {
        DualModel::step(&Cart, s, u, p, dt_s)
    }

    fn observe(&self, s: &SVector<f64, 4>) -> SVector<f64, 2> {
        DualModel::observe(&Cart, s)
    }
}

const DT_S: f64 = 0.02;

fn point() -> Point<4, 1, 1> {
    let (s, u, p) = ([0.3, 0.8, -0.2, 1.1].into(), [1.7].into(), [2.2].into());
    Point { s, u, p, dt_s: DT_S }
}

#[test]
fn dual_numbers_agree_with_the_derivative_on_paper_and_differences_nearly() {
    let Point { s, u, p, dt_s } = point();
    let by_angle = dt_s * p[0] * (9.81 * s[1].cos() + u[0] * s[1].sin());
    let by_length = dt_s * (9.81 * s[1].sin() - u[0] * s[1].cos());
    let errors = |by_state: f64, by_parameter: f64| {
        maximum((by_state - by_angle).abs(), (by_parameter - by_length).abs())
    };
    let dual = Dual(Cart).linearize(&s, &u, &p, dt_s);
    let plain = Plain.linearize(&s, &u, &p, dt_s);
    let error = errors(dual.by_state[(3, 1)], dual.by_parameter[(3, 0)]);
    assert!(error < 1e-15, "dual numbers: error {error:e}");
    let error = errors(plain.by_state[(3, 1)], plain.by_parameter[(3, 0)]);
    assert!(error > 0.0 && error < 1e-9, "differences: error {error:e}");
}

#[test]
fn every_derivative_meets_its_numeric_twin() {
    let gap = model_gap(&Dual(Cart), &point());
    assert!(gap.gap < 1e-8, "{gap}");
    assert_eq!(Dual(Cart).observe_by_state(&point().s).sum().to_bits(), 2.0_f64.to_bits());
}

#[test]
fn rest_is_found_without_being_written() {
    for rest in [Dual(Cart).at_rest(&[0.4, -3.0].into()), Plain.at_rest(&[0.4, -3.0].into())] {
        assert!((rest - SVector::from([0.4, -3.0, 0.0, 0.0])).norm() < 1e-9, "{rest}");
    }
}

/// Distance and direction of a boat at sea that does not steer its drift, the third row.
#[derive(Debug, Clone, Copy)]
struct Boat;

impl DualModel<3, 2, 2, 0> for Boat {
    const CONTROLLABLE: usize = 2;

    fn subsystems(visit: &mut impl VisitSubsystems) {
        visit.visit(&[0, 1, 2], &[0, 1], &[]);
    }

    fn step<D: Scalar>(
        &self,
        s: &SVector<D, 3>,
        u: &SVector<D, 2>,
        _p: &SVector<D, 0>,
        dt_s: f64,
    ) -> SVector<D, 3> {
        SVector::from([s[0] + (u[0] + s[2]) * dt_s, s[1] + u[1] * dt_s, s[2]])
    }

    fn observe<D: Scalar>(&self, s: &SVector<D, 3>) -> SVector<D, 2> {
        SVector::from([(s[0] * s[0] + s[1] * s[1]).sqrt(), s[1].atan2(s[0])])
    }
}

/// [`Boat`] with rest in closed form.
#[derive(Debug, Clone, Copy)]
struct BoatAtRest;

impl DualModel<3, 2, 2, 0> for BoatAtRest {
    fn at_rest(&self, o: &SVector<f64, 2>) -> Option<SVector<f64, 3>> {
        Some([o[0] * o[1].cos(), o[0] * o[1].sin(), 0.0].into())
    }

    fn step<D: Scalar>(
        &self,
        s: &SVector<D, 3>,
        u: &SVector<D, 2>,
        p: &SVector<D, 0>,
        dt_s: f64,
    ) -> SVector<D, 3> {
        DualModel::step(&Boat, s, u, p, dt_s)
    }

    fn observe<D: Scalar>(&self, s: &SVector<D, 3>) -> SVector<D, 2> {
        DualModel::observe(&Boat, s)
    }
}

#[test]
fn rest_is_found_by_distance_and_direction_or_as_written() {
    let o = [2.0, 0.7].into();
    let exact = SVector::from([2.0 * f64::cos(0.7), 2.0 * f64::sin(0.7), 0.0]);
    for rest in [Dual(Boat).at_rest(&o), Dual(BoatAtRest).at_rest(&o)] {
        assert!((rest - exact).norm() < 1e-9, "{rest}");
    }
}

#[test]
fn structure_is_that_of_the_dual_model() {
    let mut subsystems = Vec::new();
    <Dual<Boat> as Model<3, 2, 2, 0>>::subsystems(&mut subsystems);
    assert_eq!(subsystems.len(), 1);
    assert_eq!(<Dual<Boat> as Model<3, 2, 2, 0>>::CONTROLLABLE, 2);
    let (s, u, p) = ([3.0, -1.0, 0.2].into(), [0.4, 0.5].into(), SVector::zeros());
    let gap = model_gap(&Dual(Boat), &Point { s, u, p, dt_s: DT_S });
    assert!(gap.gap < 1e-8, "{gap}");
}
