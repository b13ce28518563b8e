//! The Tello by the model of the thesis: its gains from a recorded flight, then to a pose.

use std::error::Error;

use horizon_control::{Mpc, MpcProblem, MpcSettings};
use horizon_estim::{Ident, IdentSettings, Mhe, MheSettings, Observed, Piece};
use horizon_model::nalgebra::SVector;
use horizon_model::rows::{Pose, Sticks};
use horizon_model::{Kinematic, Model};

const DT_S: f64 = 0.02;
const STEPS: usize = 40;
/// `lambda_h` (m/s), `lambda_v` (m/s), `lambda_a` (rad/s), `theta_0` (rad).
const PRIOR: [f64; 4] = [1.0, 0.7, 1.3, 0.0];

/// Errors of the parameter, of the estimated pose at the end, and distance to the goal (mixed units).
fn run() -> Result<[f64; 3], Box<dyn Error>> {
    let truth = SVector::from([1.29, 0.445, 0.994, 0.1]);
    // Poses that are up to 2 mm and 2 mrad off.
    let measure = |s: &Pose, k: usize| {
        let noise = Pose::from_fn(|row, _| ((7.3 + row as f64) * k as f64).sin());
        Observed::full(s + 0.002 * noise)
    };

    // Identification from one recorded flight.
    let mut s = Pose::new(0.0, 0.0, 1.0, 0.3);
    let (mut flight_u, mut flight_o) = (Vec::new(), Vec::new());
    for k in 0..400 {
        let t = DT_S * k as f64;
        let u = Sticks::from_fn(|row, _| 0.5 * ((1.0 + 0.3 * row as f64) * t).sin());
        flight_o.push(measure(&s, k));
        flight_u.push(u);
        s = Kinematic.step(&s, &u, &truth, DT_S);
    }
    let settings = IdentSettings::builder(PRIOR).c_o([500.0; 4]).c_s([10.0; 4]);
    let pieces = vec![Piece { u: flight_u, o: flight_o }];
    let mut ident = Ident::new(Kinematic, &settings.build(&Kinematic)?, DT_S, pieces)?;
    assert!(ident.solve(&mut || false)?.is_converged());
    let p = *ident.parameter();
    // Estimation and control: to a pose a metre aside, half a metre higher, turned by a quarter.
    let settings = MheSettings::builder(p.into()).c_o([500.0; 4]).c_s([10.0; 4]).c_p([100.0; 4]);
    let mut mhe = Mhe::new(Kinematic, settings.window_steps(20).build(&Kinematic)?, DT_S)?;
    let settings = MpcSettings::builder(STEPS).c_u([0.5; 4]).c_s([5.0; 4]).c_s_end([20.0; 4]);
    let settings = settings.bounds([-0.8; 4], [0.8; 4]).build(&Kinematic)?;
    let mut mpc = Mpc::<_, 4, 4, 4, 4, 4>::new(Kinematic, settings, DT_S)?;
    let goal = Pose::new(0.0, 1.0, 1.5, 1.5);
    let (mut s, mut u) = (Pose::new(0.0, 0.0, 1.0, 0.0), Sticks::zeros());
    mhe.start(&measure(&s, 0).o)?;
    for k in 0..300 {
        let report =
            mpc.solve(&MpcProblem::new(mhe.s_hat(), &p, &u, &[goal; STEPS]), &mut || false)?;
        assert!(report.has_new_plan());
        u = mpc.plan()[0];
        mpc.shift();
        s = Kinematic.step(&s, &u, &truth, DT_S);
        assert!(mhe.update(&u, &measure(&s, k), &mut || false)?.is_converged());
    }
    Ok([(p - truth).norm(), (mhe.s_hat() - s).norm(), (s - goal).norm()])
}

fn main() -> Result<(), Box<dyn Error>> {
    run().map(|errors| println!("Tello: gains, estimate and goal off by {errors:.4?}"))
}

#[test]
fn it_identifies_estimates_and_arrives() -> Result<(), Box<dyn Error>> {
    let (errors, bounds) = (run()?, [0.02, 0.01, 0.02]);
    assert!(errors.iter().zip(bounds).all(|(error, bound)| *error < bound), "{errors:?}");
    Ok(())
}
