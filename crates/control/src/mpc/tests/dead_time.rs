//! Closed loops over an input delay.

use horizon_model::{InputFifo, Row, Vector};

use super::models::Cart;
use super::*;
use crate::predict;

/// Period. s
const DT_S: f64 = 0.05;
const STEPS: usize = 40;

/// Range of the inputs from 50 s on, of a cart that is brought to 2 m over `dead_time_s` with an input weight at which
/// an error of a fraction of a period in the prediction makes the loop swing.
fn range_at_rest(dead_time_s: f64) -> [f64; 2] {
    let settings = MpcSettings::builder(STEPS).c_u([0.01]).c_s_end([10.0; 2]);
    let settings = settings.bounds([-1.0], [1.0]).build(&Cart).unwrap();
    let mut mpc = Mpc::<_, 2, 1, 2, 0, 2>::new(Cart, settings, DT_S).unwrap();
    let mut fifo = InputFifo::<1>::new(&[dead_time_s], &[Row::UNNAMED], DT_S).unwrap();
    let (mut s, s_ref) = (Vector::zeros(), [Vector::from([2.0, 0.0]); STEPS]);
    let p = Vector::zeros();
    let [mut low, mut high] = [f64::INFINITY, f64::NEG_INFINITY];
    for k in 0..1200 {
        let s_0 = predict(&Cart, &s, &p, fifo.in_transit(), DT_S);
        let u_before = fifo.last_in_transit();
        let report =
            mpc.solve(&MpcProblem::new(&s_0, &p, &u_before, &s_ref), &mut || false).unwrap();
        assert!(report.has_new_plan(), "step {k}: {report:?}");
        let u = fifo.to_send(mpc.plan());
        fifo.push(&u);
        mpc.shift();
        s = Cart.step(&s, &fifo.applied(-1), &p, DT_S);
        if k >= 1000 {
            [low, high] = [low.min(u[0]), high.max(u[0])];
        }
    }
    assert!((s - s_ref[0]).norm() < 1e-3, "{dead_time_s} s: {s}");
    [low, high]
}

#[test]
fn a_loop_comes_to_rest_whatever_the_fraction_of_a_period_in_its_dead_time() {
    for dead_time_s in [0.0, 0.15, 0.155, 0.16, 0.17, 0.185, 0.199] {
        let [low, high] = range_at_rest(dead_time_s);
        assert!(low > -1e-3 && high < 1e-3, "{dead_time_s} s: {low}..{high}");
    }
}
