//! A car (kinematic bicycle): its wheelbase from recorded positions, then to a parking place.

use std::error::Error;

use horizon_control::{Mpc, MpcProblem, MpcSettings};
use horizon_estim::{Ident, IdentSettings, Mhe, MheSettings, Observed, Piece};
use horizon_model::nalgebra::SVector;
use horizon_model::{Dual, DualModel, Model, Scalar};

type V<D, const N: usize> = SVector<D, N>;

const DT_S: f64 = 0.1;
const STEPS: usize = 30;

/// State (x, y, heading psi, speed v), input (acceleration, steering angle), observation (x, y), parameter (wheelbase).
#[derive(Debug, Clone, Copy)]
struct Car;

impl DualModel<4, 2, 2, 1> for Car {
    fn step<D: Scalar>(&self, s: &V<D, 4>, u: &V<D, 2>, p: &V<D, 1>, dt_s: f64) -> V<D, 4> {
        let ([_, _, psi, v], [accel, steering]): ([D; 4], [D; 2]) = ((*s).into(), (*u).into());
        let [wheelbase]: [D; 1] = (*p).into();
        let rate = [v * psi.cos(), v * psi.sin(), v * steering.tan() / wheelbase, accel];
        s + SVector::from(rate.map(|rate| rate * dt_s))
    }

    fn observe<D: Scalar>(&self, s: &V<D, 4>) -> V<D, 2> {
        s.xy()
    }
}

/// Errors of the parameter (m), of the estimated state at the end, and distance to the goal (mixed units).
fn run() -> Result<[f64; 3], Box<dyn Error>> {
    let (car, truth) = (Dual(Car), SVector::from([2.7]));
    // Measurements that are up to 1 cm off.
    let measure = |s: &SVector<f64, 4>, k: usize| {
        let t = k as f64;
        Observed::full(car.observe(s) + 0.01 * SVector::from([(7.3 * t).sin(), (9.1 * t).cos()]))
    };

    // Identification from one recorded drive.
    let mut s = SVector::from([0.0, 0.0, 0.2, 1.0]);
    let (mut us, mut os) = (Vec::new(), Vec::new());
    for k in 0..200 {
        let t = DT_S * k as f64;
        let u = SVector::from([0.4 * (0.9 * t).sin(), 0.4 * (0.5 * t).sin()]);
        os.push(measure(&s, k));
        us.push(u);
        s = car.step(&s, &u, &truth, DT_S);
    }
    let settings =
        IdentSettings::builder([2.0]).c_o([100.0; 2]).c_s([10.0; 4]).bounds([1.0], [5.0]);
    let mut ident = Ident::new(car, &settings.build(&car)?, DT_S, vec![Piece { u: us, o: os }])?;
    assert!(ident.solve(&mut || false)?.is_converged());
    let p = *ident.parameter();
    // One metre of the way is to the left, where the car cannot move: it has to turn there and back.
    let settings = MheSettings::builder(p.into()).c_o([100.0; 2]).c_s([10.0; 4]).c_p([100.0]);
    let mut mhe = Mhe::new(car, settings.window_steps(20).build(&car)?, DT_S)?;
    let settings = MpcSettings::builder(STEPS).c_s([3.0, 3.0, 1.0, 0.5]).c_s_end([20.0; 4]);
    let settings = settings.bounds([-1.5, -0.5], [1.5, 0.5]).build(&car)?;
    let mut mpc = Mpc::<_, 4, 2, 2, 1, 4>::new(car, settings, DT_S)?;
    let goal = SVector::from([4.0, 1.0, 0.0, 0.0]);
    let (mut s, mut u) = (SVector::zeros(), SVector::zeros());
    mhe.start(&measure(&s, 0).o)?;
    for k in 0..150 {
        let report =
            mpc.solve(&MpcProblem::new(mhe.s_hat(), &p, &u, &[goal; STEPS]), &mut || false)?;
        assert!(report.has_new_plan());
        u = mpc.plan()[0];
        mpc.shift();
        s = car.step(&s, &u, &truth, DT_S);
        assert!(mhe.update(&u, &measure(&s, k), &mut || false)?.is_converged());
    }
    Ok([(p - truth).norm(), (mhe.s_hat() - s).norm(), (s - goal).norm()])
}

fn main() -> Result<(), Box<dyn Error>> {
    run().map(|errors| println!("car: wheelbase, estimate and goal off by {errors:.4?}"))
}

#[test]
fn it_identifies_estimates_and_arrives() -> Result<(), Box<dyn Error>> {
    let (errors, bounds) = (run()?, [0.03, 0.1, 0.1]);
    assert!(errors.iter().zip(bounds).all(|(error, bound)| *error < bound), "{errors:?}");
    Ok(())
}
