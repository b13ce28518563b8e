use std::f64::consts::PI;

use super::*;
use crate::check::{Point, amax, maximum, model_gap};
use crate::differences;
use crate::model::HessianKind;
use crate::{Matrix, Vector};

const DT_S: f64 = 0.02;

/// The vehicle of the thesis' flights.
fn flown() -> Parameter {
    let mut p = Parameter::zeros();
    (p[lag::LAMBDA_H], p[lag::TAU_H], p[lag::DEAD_H]) = (1.9, 0.64, 0.07);
    (p[lag::LAMBDA_V], p[lag::TAU_V], p[lag::DEAD_V]) = (0.89, 0.25, 0.12);
    (p[lag::LAMBDA_A], p[lag::TAU_A], p[lag::DEAD_A]) = (1.4, 0.12, 0.08);
    (p[lag::THETA_0], p[lag::A_MAX]) = (-0.06, 1.1);
    p
}

/// A state at `pose` with driven velocity `v` and disturbance `d`.
fn moving(o: Pose, v: [f64; 4], d: [f64; 3]) -> Motion {
    let mut s = Lagged::default().at_rest(&o);
    [s[motion::V_X], s[motion::V_Y], s[motion::V_Z], s[motion::OMEGA]] = v;
    [s[motion::D_X], s[motion::D_Y], s[motion::D_Z]] = d;
    s
}

/// The vehicle with its corners, without a line of the model.
struct Sharp {
    o: Pose,
    v: [f64; 4],
    d: [f64; 3],
}

impl Sharp {
    fn step(&mut self, u: &Sticks, p: &Parameter) {
        let dead = |u: f64, zone: f64| f64::max(u.abs() - zone, 0.0).copysign(u);
        let psi = self.o[pose::THETA] + p[lag::THETA_0];
        let forward = p[lag::LAMBDA_H] * dead(u[stick::PITCH], p[lag::DEAD_H]);
        let right = p[lag::LAMBDA_H] * dead(u[stick::ROLL], p[lag::DEAD_H]);
        let climb = p[lag::LAMBDA_V] * dead(u[stick::THROTTLE], p[lag::DEAD_V]);
        let turn = p[lag::LAMBDA_A] * dead(u[stick::YAW], p[lag::DEAD_A]);
        let fraction = |tau_s: f64| 1.0 - f64::exp(-DT_S / tau_s);

        let [v_x, v_y, v_z, omega] = &mut self.v;
        let change_x = fraction(p[lag::TAU_H]) * (psi.cos() * forward + psi.sin() * right - *v_x);
        let change_y = fraction(p[lag::TAU_H]) * (psi.sin() * forward - psi.cos() * right - *v_y);
        let scale = f64::min(1.0, p[lag::A_MAX] * DT_S / change_x.hypot(change_y));
        *v_x += scale * change_x;
        *v_y += scale * change_y;
        *v_z += fraction(p[lag::TAU_V]) * (climb - *v_z);
        *omega += fraction(p[lag::TAU_A]) * (turn - *omega);
        let [d_x, d_y, d_z] = &mut self.d;
        *d_x *= f64::exp(-DT_S / 1.2);
        *d_y *= f64::exp(-DT_S / 1.2);
        *d_z *= f64::exp(-DT_S / 1.0);
        self.o += DT_S * Pose::new(*v_x + *d_x, *v_y + *d_y, *v_z + *d_z, *omega);
    }
}

/// Largest horizontal, vertical and heading gap after 1 s between [`Lagged`] and [`Sharp`], from rest
/// and from flight, with every pair of constant and of reversed sticks on a grid.
fn gap_after_1_s(p: &Parameter) -> [f64; 3] {
    let mut worst = [0.0_f64; 3];
    let grid = [-1.0, -0.5, -0.2, -0.1, -0.07, -0.03, 0.0, 0.05, 0.07, 0.08, 0.12, 0.3, 0.7, 1.0];
    for (roll, pitch) in grid.iter().flat_map(|a| grid.iter().map(move |b| (*a, *b))) {
        for (v, reversal) in [([0.0; 4], 50), ([0.6, -0.4, 0.2, 0.3], 50), ([0.0; 4], 25)] {
            let (o, d) = (Pose::new(0.0, 0.0, 1.0, 0.4), [0.05, -0.05, 0.02]);
            let mut sharp = Sharp { o, v, d };
            let mut s = moving(o, v, d);
            for k in 0..50 {
                let u =
                    Sticks::new(roll, pitch, pitch, roll) * if k < reversal { 1.0 } else { -1.0 };
                sharp.step(&u, p);
                s = Lagged::default().step(&s, &u, p, DT_S);
            }
            let gap = Lagged::default().observe(&s) - sharp.o;
            let gaps =
                [gap[pose::X].hypot(gap[pose::Y]), gap[pose::Z].abs(), gap[pose::THETA].abs()];
            worst = std::array::from_fn(|i| maximum(worst[i], gaps[i]));
        }
    }
    worst
}

#[test]
fn every_jacobian_meets_its_numeric_twin() {
    let p = flown();
    let sticks = [
        Sticks::zeros(),
        Sticks::new(0.7, -0.6, 0.5, -0.9),
        // On the corners of the dead zones.
        Sticks::new(0.07, -0.07, 0.08, 0.12),
        Sticks::new(-0.07, 0.0, -0.08, -0.12),
        Sticks::new(0.0, 0.075, 0.0, 0.1),
        Sticks::new(1.0, 1.0, -1.0, 1.0),
    ];
    let velocities = [[0.0; 4], [0.3, -0.5, 0.2, 1.1], [-1.5, 1.2, -0.4, -0.3]];
    for theta in [-9.0, -PI, -1.0, 0.0, PI - 1e-9, PI + 1e-9, 7.0] {
        for u in sticks {
            for v in velocities {
                let s = moving(Pose::new(0.4, -1.2, 1.3, theta), v, [0.05, -0.1, 0.02]);
                for dt_s in [DT_S, 7.0 * DT_S] {
                    assert_twins(&Point { s, u, p, dt_s });
                }
            }
        }
    }
}

#[test]
fn jacobians_are_exact_on_the_corner_of_the_limit_and_without_any_change() {
    let (p, pitch) = (flown(), Sticks::new(0.0, 0.5, 0.0, 0.0));
    let o = Pose::new(0.0, 0.0, 1.0, 3.5);
    let [asked_x, asked_y] = asked_velocity(&o, &pitch, &p);
    // The velocity that misses `asked` by exactly what the limit admits in one period.
    let fraction = 1.0 - f64::exp(-DT_S / p[lag::TAU_H]);
    let margin = p[lag::A_MAX] * DT_S / fraction;
    for missing in [0.0, 0.5 * margin, 0.99 * margin, margin, 1.01 * margin, 4.0 * margin] {
        let v = [asked_x - 0.6 * missing, asked_y + 0.8 * missing, 0.0, 0.0];
        let s = moving(o, v, [0.0; 3]);
        assert_twins(&Point { s, u: pitch, p, dt_s: DT_S });
    }
}

/// The velocity at which `u` changes nothing, by the model itself.
fn asked_velocity(o: &Pose, u: &Sticks, p: &Parameter) -> [f64; 2] {
    let mut s = Lagged::default().at_rest(o);
    for _ in 0..5000 {
        let next = Lagged::default().step(&s, u, p, DT_S);
        (s[motion::V_X], s[motion::V_Y]) = (next[motion::V_X], next[motion::V_Y]);
    }
    [s[motion::V_X], s[motion::V_Y]]
}

fn assert_twins(at: &Point<11, 4, 11>) {
    // Third derivatives are of order 1 / width^2 = 1e4 at the corners of the dead zones; central
    // differences over 6e-6 leave that times the squared step, 6e-8, and rounding about 1e-9. At a
    // heading of 9 rad the step is 5e-5, and fourth derivatives of 1.3e3 leave 7e-7 of the second ones.
    let gap = model_gap(&Lagged::default(), at).gap;
    assert!(gap < 1e-6, "gap {gap:e} at {at:?}");
}

#[test]
fn a_second_of_flight_stays_beside_the_sharp_vehicle() {
    let gap = gap_after_1_s(&flown());
    let [horizontal_m, vertical_m, heading_rad] = gap;
    assert!(horizontal_m < 0.01, "{horizontal_m} m");
    assert!(vertical_m < 0.005, "{vertical_m} m");
    assert!(heading_rad < 0.007, "{heading_rad} rad");
}

/// Largest distance between one step of seven periods and seven steps, 16 directions of flight and of sticks.
fn gap_of_a_long_step(model: &Lagged) -> f64 {
    let (p, mut worst) = (flown(), 0.0_f64);
    for (flight, stick) in (0..16).flat_map(|a| (0..16).map(move |b| (a, b))) {
        let (flight, stick) = (0.4 * f64::from(flight), 0.4 * f64::from(stick));
        let v = [0.6 * flight.cos(), 0.6 * flight.sin(), -0.3, 0.2];
        let s = moving(Pose::new(0.0, 0.0, 1.0, 0.7), v, [0.05, -0.05, 0.02]);
        let u = Sticks::new(0.8 * stick.cos(), 0.8 * stick.sin(), 0.3, 0.5);
        let long = model.step(&s, &u, &p, 7.0 * DT_S);
        let short = (0..7).fold(s, |s, _| model.step(&s, &u, &p, DT_S));
        let gap = model.observe(&long) - model.observe(&short);
        worst =
            [gap[pose::X].hypot(gap[pose::Y]), gap[pose::Z].abs()].into_iter().fold(worst, maximum);
    }
    worst
}

#[test]
fn a_long_step_leads_where_short_ones_lead() {
    let gap = gap_of_a_long_step(&Lagged::default());
    // The heading turns on by 1.5 degrees meanwhile, and velocities do not change quite evenly.
    assert!(gap < 0.005, "{gap} m");
    // As if the last velocity had been there all the time.
    let shape = LaggedShape { period_s: 1.0, ..LaggedShape::default() };
    let gap = gap_of_a_long_step(&Lagged::new(shape).unwrap());
    assert!(gap > 0.01, "{gap} m");
}

#[test]
fn a_prepared_model_gives_equal_bits_whatever_it_was_prepared_for() {
    let (model, p) = (Lagged::default(), flown());
    let s = moving(Pose::new(0.3, -1.0, 1.2, 2.0), [0.4, -0.2, 0.1, 0.3], [0.02, 0.05, -0.01]);
    let u = Sticks::new(0.05, -0.4, 0.09, 0.3);
    let mut other = p;
    other[lag::TAU_V] *= 1.5;
    for prepared in
        [model.prepared(&p, DT_S), model.prepared(&other, DT_S), model.prepared(&p, 0.1)]
    {
        for dt_s in [DT_S, 0.1] {
            assert_eq!(prepared.linearize(&s, &u, &p, dt_s), model.linearize(&s, &u, &p, dt_s));
        }
    }
}

#[test]
fn a_vehicle_at_rest_stays_where_it_was_seen() {
    let o = Pose::new(0.4, -1.2, 1.3, 7.0);
    let s = Lagged::default().at_rest(&o);
    assert_eq!(Lagged::default().observe(&s), o);
    let next = Lagged::default().step(&s, &Sticks::zeros(), &flown(), DT_S);
    assert!((next - s).norm() < 1e-15, "{next}");
}

#[test]
fn a_width_of_zero_is_refused() {
    let error = Lagged::new(LaggedShape { dead_width: 0.0, ..LaggedShape::default() }).unwrap_err();
    assert_eq!(error.to_string(), "dead_width = 0: expected finite and > 0");
    assert!(Lagged::new(LaggedShape { decay_h_s: f64::NAN, ..LaggedShape::default() }).is_err());
}

#[test]
fn the_stick_for_an_effect_undoes_the_dead_zone() {
    let (model, p) = (Lagged::default(), flown());
    for size in [0.0, 1e-6, 1e-3, 0.01, 0.05, 0.3, 0.93] {
        for sign in [-1.0, 1.0] {
            let effect = Sticks::from_element(sign * size);
            let back = model.effect(&model.input_for(&effect, &p), &p);
            assert!((back - effect).norm() < 1e-14, "{back} instead of {effect}");
        }
    }
    for tiny in [0.0, 5e-324, 1e-320, 1e-300, 1e-160, 1e-12] {
        let stick = model.input_for(&Sticks::from_element(tiny), &p);
        // The derivative in the middle of the dead zones is above 0.003.
        assert!(stick.iter().all(|stick| (tiny..=tiny / 0.003).contains(stick)), "{tiny}: {stick}");
    }
    let full = Sticks::from_element(1.0);
    assert!((model.input_for(&model.effect(&full, &p), &p) - full).norm() < 1e-13);
}

#[test]
fn a_step_is_the_core_driven_by_the_effect() {
    let (model, p) = (Lagged::default(), flown());
    let s = moving(Pose::new(0.3, -1.0, 1.2, 2.0), [0.4, -0.2, 0.1, 0.3], [0.02, 0.05, -0.01]);
    for u in [Sticks::new(0.05, -0.4, 0.09, 0.3), Sticks::new(-0.9, 0.07, -0.01, 0.12)] {
        let by_core = model.core().step(&s, &model.effect(&u, &p), &p, DT_S);
        assert_eq!(model.step(&s, &u, &p, DT_S), by_core);
        let point = Point { s, u, p, dt_s: DT_S };
        let gap = model_gap(&model.core(), &point).gap;
        assert!(gap < 1e-7, "gap {gap:e} at {u}");
        assert_eq!(model.core().input_for(&u, &p), u);
    }
}

#[test]
fn a_moving_reference_leaves_room_for_the_disturbance() {
    let s = moving(Pose::zeros(), [0.0; 4], [0.1, -0.05, 0.02]);
    let (o, rate) = (Pose::new(1.0, 2.0, 1.3, 0.5), Pose::new(0.8, -0.6, 0.1, 0.2));
    let reference = Lagged::default().moving(&o, &rate, &s);
    assert_eq!(Lagged::default().observe(&reference), o);
    for (v, d, row) in [
        (motion::V_X, motion::D_X, pose::X),
        (motion::V_Y, motion::D_Y, pose::Y),
        (motion::V_Z, motion::D_Z, pose::Z),
    ] {
        assert!((reference[v] + reference[d] - rate[row]).abs() < 1e-15, "row {row}");
    }
    assert!((reference[motion::OMEGA] - rate[pose::THETA]).abs() < 1e-15);
}

/// Second derivatives by state and input in one matrix.
fn whole(curvature: &InputHessian<11, 4>) -> Matrix<15, 15> {
    let mut whole = Matrix::<15, 15>::zeros();
    whole.fixed_view_mut::<11, 11>(0, 0).copy_from(&curvature.by_state);
    whole.fixed_view_mut::<4, 11>(11, 0).copy_from(&curvature.by_input_state);
    whole.fixed_view_mut::<11, 4>(0, 11).copy_from(&curvature.by_input_state.transpose());
    whole.fixed_view_mut::<4, 4>(11, 11).copy_from(&curvature.by_input);
    whole
}

/// Derivatives of the horizontal change of velocity, before its limit, by state and input: those of a vehicle without
/// a limit.
fn change_by_state_and_input(model: &Lagged, s: &Motion, u: &Sticks, dt_s: f64) -> Matrix<2, 15> {
    let mut p = flown();
    p[lag::A_MAX] = 1e9;
    let change_w = |x: &Vector<15>| {
        let (s, u) = (x.fixed_rows::<11>(0).into_owned(), x.fixed_rows::<4>(11).into_owned());
        let s_next = model.step(&s, &u, &p, dt_s);
        Vector::from([s_next[motion::V_X] - s[motion::V_X], s_next[motion::V_Y] - s[motion::V_Y]])
    };
    let at = Vector::<15>::from_iterator(s.iter().chain(u.iter()).copied());
    differences::jacobian(change_w, &at)
}

#[test]
fn the_convex_curvature_is_that_of_the_limit_without_its_signs() {
    let (model, p) = (Lagged::default().core(), flown());
    let mut saddles = 0;
    // A period, and the longest step of a plan.
    for (dt_s, k) in
        [DT_S, 3.0 * DT_S].into_iter().flat_map(|dt_s| (0..200).map(move |k| (dt_s, k)))
    {
        let angle = f64::from(k);
        let v = [0.8 * angle.sin(), 0.9 * (1.7 * angle).cos(), 0.1, -0.2];
        let s = moving(Pose::new(0.1, 0.2, 1.0, angle), v, [0.0; 3]);
        let u = Sticks::new((2.3 * angle).sin(), (3.1 * angle).cos(), 0.4, -0.6);
        let w = Motion::from_fn(|row, _| (0.7 * angle + row as f64).sin());
        let by_input = &Matrix::zeros();
        let of = |kind| {
            let request = HessianRequest { s: &s, u: &u, p: &p, dt_s, by_input, w: &w, kind };
            whole(&model.hessian_by_input(&request).unwrap())
        };
        let (exact, convex) = (of(HessianKind::Exact), of(HessianKind::Convexified));
        let scale = exact.norm();
        assert!(convex.symmetric_eigenvalues().min() > -1e-12 * scale, "{convex}");
        saddles += u32::from(exact.symmetric_eigenvalues().min() < -1e-3 * scale);
        // The change is e = k (c - v), and no other row is nonlinear in v: the block of the horizontal velocities, by
        // differences of the gradient, is k^2 times the Hessian by e.
        let fraction = 1.0 - (-dt_s / p[lag::TAU_H]).exp();
        let gradient = |v: &Vector<2>| {
            let mut s = s;
            (s[motion::V_X], s[motion::V_Y]) = (v.x, v.y);
            let by_state = model.step_by_state(&s, &u, &p, dt_s).tr_mul(&w);
            Vector::from([by_state[motion::V_X], by_state[motion::V_Y]])
        };
        let v = Vector::from([s[motion::V_X], s[motion::V_Y]]);
        let by_change = differences::jacobian(gradient, &v) / fraction.powi(2);
        let by_change = 0.5 * (by_change + by_change.transpose());
        let mut absolute = by_change.symmetric_eigen();
        absolute.eigenvalues.apply(|value| *value = value.abs());
        let by_both = change_by_state_and_input(&model, &s, &u, dt_s);
        let expected = by_both.transpose() * absolute.recompose() * by_both;
        let gap = amax(&(convex - expected));
        // At a heading of 200 rad the differences are good to 1e-6.
        assert!(gap < 1e-5 * scale, "gap {gap:e}: {convex} beside {expected}");
    }
    assert!(saddles > 100, "{saddles} saddles");
}

#[test]
fn neutral_sticks_bring_the_vehicle_to_rest_where_coasting_says() {
    let (model, p) = (Lagged::default(), flown());
    // Slow enough for the limit of the acceleration: 0.64 s at 1.1 m/s^2.
    let s = moving(Pose::zeros(), [0.4, -0.3, 0.2, 0.5], [0.05, 0.0, -0.1]);
    let rest = (0..1000).fold(s, |s, _| model.step(&s, &Sticks::zeros(), &p, DT_S));
    let gap = model.observe(&rest) - model.coasting(&s, &p);
    // Within half a period of the velocities.
    assert!(amax(&gap) < 0.01, "{gap}");
}
