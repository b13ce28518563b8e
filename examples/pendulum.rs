//! A pendulum on a cart: its length from swings below the cart, then balanced upright at another place.

use std::error::Error;
use std::f64::consts::PI;

use horizon_control::{Mpc, MpcProblem, MpcSettings};
use horizon_estim::{Ident, IdentSettings, Mhe, MheSettings, Observed, Piece};
use horizon_model::nalgebra::SVector;
use horizon_model::{Dual, DualModel, Model, Scalar};

type V<D, const N: usize> = SVector<D, N>;

const DT_S: f64 = 0.04;
const STEPS: usize = 30;

/// State (x, angle from upright, v, rate), input (cart's acceleration), observation (x, angle), parameter (length).
#[derive(Debug, Clone, Copy)]
struct Pendulum;

impl DualModel<4, 1, 2, 1> for Pendulum {
    fn step<D: Scalar>(&self, s: &V<D, 4>, u: &V<D, 1>, p: &V<D, 1>, dt_s: f64) -> V<D, 4> {
        let ([x, angle, v, rate], [accel], [length]): ([D; 4], [D; 1], [D; 1]) =
            ((*s).into(), (*u).into(), (*p).into());
        let rate = rate + (angle.sin() * 9.81 - angle.cos() * accel) / length * dt_s;
        let v = v + accel * dt_s;
        SVector::from([x + v * dt_s, angle + rate * dt_s, v, rate])
    }

    fn observe<D: Scalar>(&self, s: &V<D, 4>) -> V<D, 2> {
        s.xy()
    }
}

/// Errors of the parameter (m), of the estimated state at the end, and distance to the goal (mixed units).
fn run() -> Result<[f64; 3], Box<dyn Error>> {
    let (pendulum, truth) = (Dual(Pendulum), SVector::from([0.45]));
    // Measurements that are up to 2 mm and 2 mrad off.
    let noise = |t: f64| 0.002 * SVector::from([(7.3 * t).sin(), (9.1 * t).cos()]);
    let measure = |s: &V<f64, 4>, k: usize| Observed::full(pendulum.observe(s) + noise(k as f64));

    // Identification from swings below the cart.
    let mut s = SVector::from([0.0, PI, 0.0, 0.0]);
    let (mut swing_u, mut swing_o) = (Vec::new(), Vec::new());
    for k in 0..200 {
        let u = SVector::from([1.5 * (3.0 * DT_S * k as f64).sin()]);
        swing_o.push(measure(&s, k));
        swing_u.push(u);
        s = pendulum.step(&s, &u, &truth, DT_S);
    }
    let settings =
        IdentSettings::builder([0.6]).c_o([500.0; 2]).c_s([10.0; 4]).bounds([0.1], [2.0]);
    let pieces = vec![Piece { u: swing_u, o: swing_o }];
    let mut ident = Ident::new(pendulum, &settings.build(&pendulum)?, DT_S, pieces)?;
    assert!(ident.solve(&mut || false)?.is_converged());
    let p = *ident.parameter();
    // Estimation and control: caught at an angle of 0.2 rad, balanced half a metre aside.
    let settings = MheSettings::builder(p.into()).c_o([500.0; 2]).c_s([10.0; 4]).c_p([1000.0]);
    let mut mhe = Mhe::new(pendulum, settings.window_steps(20).build(&pendulum)?, DT_S)?;
    let settings = MpcSettings::builder(STEPS).c_s([1.0; 4]).c_s_end([3.0, 30.0, 3.0, 6.0]);
    let settings = settings.bounds([-8.0], [8.0]).build(&pendulum)?;
    let mut mpc = Mpc::<_, 4, 1, 2, 1, 4>::new(pendulum, settings, DT_S)?;
    let goal = SVector::from([0.5, 0.0, 0.0, 0.0]);
    let (mut s, mut u) = (SVector::from([0.0, 0.2, 0.0, 0.0]), SVector::zeros());
    mhe.start(&measure(&s, 0).o)?;
    for k in 0..250 {
        let report =
            mpc.solve(&MpcProblem::new(mhe.s_hat(), &p, &u, &[goal; STEPS]), &mut || false)?;
        assert!(report.has_new_plan());
        u = mpc.plan()[0];
        mpc.shift();
        s = pendulum.step(&s, &u, &truth, DT_S);
        assert!(mhe.update(&u, &measure(&s, k), &mut || false)?.is_converged());
    }
    Ok([(p - truth).norm(), (mhe.s_hat() - s).norm(), (s - goal).norm()])
}

fn main() -> Result<(), Box<dyn Error>> {
    run().map(|errors| println!("pendulum: length, estimate and goal off by {errors:.4?}"))
}

#[test]
fn it_identifies_estimates_and_arrives() -> Result<(), Box<dyn Error>> {
    let (errors, bounds) = (run()?, [0.003, 0.03, 0.05]);
    assert!(errors.iter().zip(bounds).all(|(error, bound)| *error < bound), "{errors:?}");
    Ok(())
}
