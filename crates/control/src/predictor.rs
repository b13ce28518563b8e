//! State of the system when an input sent now begins to act.

use horizon_model::{Model, Vector};

/// State after `inputs` were applied for one period each, beginning at `s`, thesis equation 4.26.
///
/// `inputs` (`NU` rows each, units of [`Model::INPUT`]) are the ones that act between the newest estimate and the step
/// whose input is about to be decided; they are sent already. `s` and the result have `NS` rows, units of
/// [`Model::STATE`]; without inputs the result is `s`. `dt_s` is the period. s, > 0
///
/// Real time: no allocation, one model step per input.
pub fn predict<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
    model: &M,
    s: &Vector<NS>,
    p: &Vector<NP>,
    inputs: impl IntoIterator<Item = Vector<NU>>,
    dt_s: f64,
) -> Vector<NS>
where
    M: Model<NS, NU, NO, NP>,
{
    inputs.into_iter().fold(*s, |s, u| model.step(&s, &u, p, dt_s))
}

#[cfg(test)]
mod tests {
    use horizon_model::Vector;
    use horizon_model::rows::{Pose, Sticks};
    use horizon_model::{InputFifo, Kinematic};

    use super::*;

    const DT_S: f64 = 0.02;

    #[test]
    fn prediction_over_the_fifo_meets_the_vehicle_one_dead_time_later() {
        let p = Vector::<4>::new(1.29, 0.445, 0.994, 0.03);
        let dead_time_s = [0.1, 0.1, 0.04, 0.06];
        let rows = <Kinematic as Model<4, 4, 4, 4>>::INPUT;
        let mut fifo = InputFifo::new(&dead_time_s, &rows, DT_S).unwrap();
        let wish = |k: u32| Sticks::from_fn(|i, _| (f64::from(k) * 0.3 + i as f64).sin());

        let mut s = Pose::new(0.4, -1.2, 1.3, 3.0);
        let mut s_pred = None;
        for k in 0..40 {
            if k == 30 {
                s_pred = Some((k + 2, predict(&Kinematic, &s, &p, fifo.in_transit(), DT_S)));
            }
            if let Some((at, s_pred)) = s_pred
                && at == k
            {
                // The same steps with the same numbers: equal bits.
                assert_eq!(s, s_pred);
                return;
            }
            let u_applied = fifo.applied(0);
            fifo.push(&wish(k));
            s = Kinematic.step(&s, &u_applied, &p, DT_S);
        }
        panic!("the predicted step never came");
    }

    #[test]
    fn without_inputs_nothing_moves() {
        let s = Pose::new(1.0, 2.0, 3.0, 4.0);
        assert_eq!(predict(&Kinematic, &s, &Vector::from([1.0; 4]), [], DT_S), s);
    }
}
