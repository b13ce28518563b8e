//! One piece: its start, its quadratic model, and what is not finite.

use horizon_model::rows::{Motion, Pose, Sticks, gain, lag, motion, pose, stick};
use horizon_model::{Kinematic, Lagged, Vector};

use super::*;
use crate::loss::Loss;

const DT_S: f64 = 0.02;

fn terms(transition_loss: Loss) -> Terms<Kinematic, 4, 4, 4, 4> {
    let residuals = Residuals {
        model: Kinematic,
        dt_s: DT_S,
        c_o: Vector::from([30.0, 30.0, 20.0, 10.0]),
        c_s: Vector::from([2.0, 2.0, 2.0, 1.0]),
        observation_loss: Loss::None,
        transition_loss,
    };
    Terms { residuals, c_0: Vector::from([0.5, 0.0, 1.0, 0.2]) }
}

/// A piece of which states and parameter are linear: yaw and throttle alone move the vehicle.
fn linear_piece() -> Segment<4, 4, 4, 4> {
    let wave = |k: usize, at: f64| (1.7 * k as f64 + at).sin();
    let sticks = |k: usize| {
        let mut u = Sticks::zeros();
        (u[stick::YAW], u[stick::THROTTLE]) = (wave(k, 0.1), wave(k, 2.0));
        u
    };
    let u = (0..11).map(sticks).collect();
    let o = (0..12).map(|k| Observed::full(Pose::from_fn(|row, _| wave(k, row as f64)))).collect();
    let mut piece = Segment::new(&Kinematic, u, o);
    for (k, s) in piece.s.iter_mut().enumerate() {
        *s = Pose::from_fn(|row, _| 0.3 * wave(k, 5.0 + row as f64));
    }
    piece
}

#[test]
fn the_quadratic_model_of_a_linear_piece_is_its_cost() {
    let terms = terms(Loss::None);
    let p = Vector::from([1.1, 0.5, 0.9, 0.15]);
    let mut p_step = Vector::zeros();
    (p_step[gain::LAMBDA_V], p_step[gain::LAMBDA_A]) = (-0.3, 0.4);
    // Damped or not: the model knows what a damped step does to the undamped cost.
    for (damping, p_step) in [(0.0, p_step), (500.0, p_step), (1e5, Vector::zeros())] {
        let mut piece = linear_piece();
        piece.eliminate(&terms, &p, Curvature::GaussNewton, damping).unwrap();
        let predicted = piece.back_substitute(&p_step);
        let contribution = piece.contribution(&terms, &(p + p_step));
        let gap = (predicted / contribution.cost - 1.0).abs();
        assert!(gap < 1e-10, "damping {damping}: {predicted}, it costs {}", contribution.cost);
        let step = |(s, s_candidate): (&Pose, &Pose)| (s_candidate - s).norm_squared();
        let step_squared: f64 = piece.s.iter().zip(&piece.s_candidate).map(step).sum();
        assert!(step_squared > 1e-3, "{step_squared}");
        assert!((contribution.step_squared / step_squared - 1.0).abs() < 1e-12);
    }
}

#[test]
fn the_states_of_an_undamped_step_leave_no_gradient() {
    let (terms, p) = (terms(Loss::None), Vector::from([1.1, 0.5, 0.9, 0.15]));
    let mut piece = linear_piece();
    piece.eliminate(&terms, &p, Curvature::GaussNewton, 0.0).unwrap();
    piece.back_substitute(&Vector::zeros());
    for (k, row) in (0..12).flat_map(|k| (0..4).map(move |row| (k, row))) {
        let [there, back] = [1e-3, -1e-3].map(|aside| {
            let mut beside = piece.clone();
            beside.s_candidate[k][row] += aside;
            beside.contribution(&terms, &p).cost
        });
        // Exact for a quadratic but for the rounding of a cost of about 1e4.
        let gradient = (there - back) / 2e-3;
        assert!(gradient.abs() < 1e-6, "{gradient} of state {k}, row {row}");
    }
}

#[test]
fn a_first_state_at_rest_costs_nothing() {
    let (terms, piece) = (terms(Loss::None), linear_piece());
    assert!(piece.s_rest.norm() > 0.1 && terms.first(&piece.s_rest, &piece.s_rest).norm() < 1e-15);
}

#[test]
fn an_elimination_without_damping_leaves_the_reduced_system() {
    let (terms, p) = (terms(Loss::Huber { scale: 0.5 }), Vector::from([1.1, 0.5, 0.9, 0.15]));
    for curvature in [Curvature::GaussNewton, Curvature::Exact] {
        let mut piece = linear_piece();
        let (reduced, cost) = piece.reduced_system(&terms, &p, curvature).unwrap();
        let eliminated = piece.eliminate(&terms, &p, curvature, 0.0).unwrap();
        let scale = reduced.hessian.norm();
        assert!((reduced.hessian - eliminated.hessian).norm() < 1e-12 * scale, "{curvature:?}");
        assert!((reduced.gradient - eliminated.gradient).norm() < 1e-10, "{curvature:?}");
        assert!((reduced.decrease / eliminated.decrease - 1.0).abs() < 1e-12, "{curvature:?}");
        let iterate = Iterate { s: &piece.s, u: &piece.u, o: &piece.o, p: &p };
        assert!((cost / terms.cost(&iterate, &piece.s_rest) - 1.0).abs() < 1e-12, "{curvature:?}");
    }
}

#[test]
fn a_derivative_by_the_parameter_that_is_not_finite_is_refused() {
    let p = Vector::zeros();
    // Squared they overflow, while no state depends on the parameter: a gain of zero.
    let u = vec![Sticks::repeat(1e160); 3];
    for (loss, aside, name) in [
        (Loss::None, 0.0, "infinite"),
        // The loss takes curvature off: infinity less infinity.
        (Loss::Huber { scale: 0.5 }, 1.0, "NaN"),
    ] {
        let observed = (0..4).map(|k| Observed::full(Pose::repeat(aside * f64::from(k))));
        let mut piece = Segment::new(&Kinematic, u.clone(), observed.collect());
        for (k, s) in (0..).zip(&mut piece.s) {
            *s = Pose::repeat(aside * f64::from(k));
        }
        let error = piece.measure(&terms(loss), &p).unwrap_err();
        assert_eq!(error, LmError::NonFinite { block: "derivative", k: 0 }, "{name}");
    }
}

#[test]
fn a_residual_that_is_not_finite_is_named_with_its_step() {
    let (terms, p) = (terms(Loss::None), Vector::from([1.1, 0.5, 0.9, 0.15]));
    for bad in [f64::NAN, f64::INFINITY] {
        let mut piece = linear_piece();
        piece.u[7][stick::THROTTLE] = bad;
        let error = piece.measure(&terms, &p).unwrap_err();
        assert_eq!(error, LmError::NonFinite { block: "residual", k: 7 });
    }
}

#[test]
fn a_start_is_where_it_was_observed_and_the_model_leads_through_the_gaps() {
    let p = [1.9, 0.89, 1.4, -0.06, 0.64, 0.25, 0.12, 0.07, 0.12, 0.08, 1.1].into();
    let (model, u) = (Lagged::default(), Sticks::new(0.2, 0.6, 0.5, 0.4));
    let seen = |k: usize| Pose::from_fn(|row, _| 0.1 * (k + 1) as f64 + row as f64);
    let mut o: Vec<_> = (0..6).map(|k| Observed::full(seen(k))).collect();
    o[2].is_present[pose::X] = false;
    o[3] = Observed::missing();
    // The first row that is seen is where the vehicle rests before.
    o[0].is_present[pose::Z] = false;
    let mut piece = Segment::<11, 4, 4, { lag::COUNT }>::new(&model, vec![u; 5], o);
    piece.start(&model, &p, DT_S);
    let mut s: Motion = model.at_rest(&seen(0));
    s[motion::Z] = seen(1)[pose::Z];
    for k in 0..6 {
        if k > 0 {
            s = model.step(&s, &u, &p, DT_S);
        }
        for row in (0..4).filter(|row| piece.o[k].is_present[*row]) {
            s[row] = seen(k)[row];
        }
        assert!((piece.s[k] - s).norm() < 1e-14, "{k}: {} instead of {s}", piece.s[k]);
    }
    assert!(s[motion::V_X].abs() > 0.01, "{s}");
}
