//! A carriage on a rail that follows its input 0.17 s late: gain, lag and dead time from a recording, then to a
//! place below a speed.

use std::borrow::Cow;
use std::error::Error;

use horizon_control::{Mpc, MpcProblem, MpcSettings, StateBounds, predict};
use horizon_estim::{DelayTable, Flights, Ident, IdentSettings, Mhe, MheSettings};
use horizon_estim::{Observed, Recording, Span};
use horizon_model::nalgebra::SVector;
use horizon_model::{Dual, DualModel, InputFifo, Model, Row, Scalar};

type V<D, const N: usize> = SVector<D, N>;
const DT_S: f64 = 0.05;

/// State (x, speed v), input (speed that is asked for), observation (x), parameter (gain, time constant).
#[derive(Debug, Clone, Copy)]
struct Carriage;

impl DualModel<2, 1, 1, 2> for Carriage {
    fn step<D: Scalar>(&self, s: &V<D, 2>, u: &V<D, 1>, p: &V<D, 2>, dt_s: f64) -> V<D, 2> {
        let ([x, v], [u], [gain, tau]): ([D; 2], [D; 1], [D; 2]) =
            ((*s).into(), (*u).into(), (*p).into());
        let v = v + (gain * u - v) / tau * dt_s;
        SVector::from([x + v * dt_s, v])
    }

    fn observe<D: Scalar>(&self, s: &V<D, 2>) -> V<D, 1> {
        let [x, _]: [D; 2] = (*s).into();
        SVector::from([x])
    }
}

/// Errors of parameter and dead time, of the estimated state at the end, and distance to the goal (mixed units).
fn run() -> Result<[f64; 3], Box<dyn Error>> {
    let (carriage, truth, dead_s) = (Dual(Carriage), [0.9, 0.3].into(), SVector::from([0.17]));
    let noise = |k: usize| 0.001 * SVector::from([(7.3 * k as f64).sin()]);
    let measure = |s: &V<f64, 2>, k: usize| Observed::full(carriage.observe(s) + noise(k));
    // A recording has the inputs that were sent; the plant applies them later.
    let u = (0..300).map(|k| SVector::from([if k / 25 % 2 == 0 { 0.4 } else { -0.4 }])).collect();
    let mut recording = Recording { u, o: Vec::new() };
    let (mut s, mut found_s) = (SVector::zeros(), SVector::from([0.3]));
    for (k, u_applied) in recording.applied(&dead_s, DT_S).iter().enumerate() {
        recording.o.push(measure(&s, k));
        s = carriage.step(&s, u_applied, &truth, DT_S);
    }
    let (recordings, spans) = ([Cow::Owned(recording)], [Span { recording: 0, steps: 0..300 }]);
    let flights = Flights { recordings: &recordings, spans: &spans, dt_s: DT_S };
    let settings = IdentSettings::builder([1.0, 0.5]).c_o([1e3]).c_s([10.0; 2]).build(&carriage)?;
    let mut ident = Ident::new(carriage, &settings, DT_S, flights.pieces(&found_s))?;
    let table = DelayTable { dead_time_max_s: 0.6, grid_s: 0.05, tolerance_s: 0.001, rounds: 20 };
    flights.search(&mut ident, &[&[0]], &mut found_s, &(&table).try_into()?, &mut || false)?;
    let p = *ident.parameter();
    // The plan begins when an input sent now begins to act: at the state to which those in transit lead.
    let settings = MheSettings::builder(p.into()).c_o([1e3]).c_s([10.0; 2]).c_p([100.0; 2]);
    let mut mhe = Mhe::new(carriage, settings.build(&carriage)?, DT_S)?;
    let limit = StateBounds::new([-9.0, -0.5].into(), [9.0, 0.5].into(), [1.0, 100.0].into())?;
    let settings = MpcSettings::builder(40).c_s_end([10.0; 2]).build(&carriage)?;
    let mut mpc = Mpc::<_, 2, 1, 1, 2, 2>::new(carriage, settings.with_constraints(4), DT_S)?;
    let goal = SVector::from([2.0, 0.0]);
    let fifo = |at_s: &V<f64, 1>| InputFifo::new(at_s.as_slice(), &[Row::UNNAMED], DT_S);
    let (mut s, mut sent, mut plant) = (SVector::zeros(), fifo(&found_s)?, fifo(&dead_s)?);
    mhe.start(&measure(&s, 0).o)?;
    for k in 0..200 {
        let s_0 = predict(&carriage, mhe.s_hat(), &p, sent.in_transit(), DT_S);
        let (u_before, s_ref) = (sent.last_in_transit(), [goal; 40]);
        let problem = MpcProblem::new(&s_0, &p, &u_before, &s_ref);
        assert!(mpc.solve_with(&problem, Some(&limit), &mut || false)?.has_new_plan());
        let u = sent.to_send(mpc.plan());
        sent.push(&u);
        plant.push(&u);
        mpc.shift();
        s = carriage.step(&s, &plant.applied(-1), &truth, DT_S);
        assert!(mhe.update(&sent.applied(-1), &measure(&s, k), &mut || false)?.is_converged());
        let [_, v_mps] = s.into();
        assert!(v_mps < 0.52, "{v_mps} m/s in step {k}");
    }
    let found = (p - truth).norm() + (found_s - dead_s).norm();
    Ok([found, (mhe.s_hat() - s).norm(), (s - goal).norm()])
}

fn main() -> Result<(), Box<dyn Error>> {
    run().map(|errors| println!("carriage: parameter, estimate and goal off by {errors:.4?}"))
}

#[test]
fn it_identifies_estimates_and_arrives() -> Result<(), Box<dyn Error>> {
    let (errors, bounds) = (run()?, [0.02, 0.03, 0.02]);
    assert!(errors.iter().zip(bounds).all(|(error, bound)| *error < bound), "{errors:?}");
    Ok(())
}
