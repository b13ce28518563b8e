use horizon_model::check::{Point, amax, model_gap};
use horizon_model::rows::{Pose, Sticks};
use horizon_model::{Kinematic, Lagged, Vector};

use super::*;
use crate::loss::Loss;
use crate::residual::Observed;

const DT_S: f64 = 0.02;
const P: [f64; 4] = [1.1, 0.5, 0.9, 0.15];

fn terms() -> Terms<Kinematic, 4, 4, 4, 4> {
    let residuals = Residuals {
        model: Kinematic,
        dt_s: DT_S,
        c_o: Vector::repeat(30.0),
        c_s: Vector::repeat(2.0),
        observation_loss: Loss::None,
        transition_loss: Loss::None,
    };
    Terms { residuals, c_0: Vector::zeros() }
}

/// A piece with a candidate beside what was seen.
fn piece() -> Segment<4, 4, 4, 4> {
    let wave = |k: usize, at: f64| (0.7 * k as f64 + at).sin();
    let u = (0..9).map(|k| Sticks::from_fn(|row, _| wave(k, row as f64))).collect();
    let seen = |k: usize| Observed::full(Pose::from_fn(|row, _| wave(k, 3.0 + row as f64)));
    let mut piece = Segment::new(&Kinematic, u, (0..10).map(seen).collect());
    piece.s_candidate = piece.o.iter().map(|observed| observed.o.add_scalar(0.05)).collect();
    piece
}

/// Cost after the states were re-optimized, and the candidate.
fn reoptimized(cost: f64, expected: f64, tolerance: f64) -> (f64, Vec<Pose>) {
    let (mut piece, terms, p) = (piece(), terms(), P.into());
    let start = Start { cost, expected, damping: 0.0, tolerance };
    let scratch = &mut Scratch::of::<Kinematic, 4, 4, 4>(10);
    let cost = piece.reoptimize_states(&terms, &p, Curvature::Exact, start, scratch);
    (cost, piece.s_candidate)
}

#[test]
fn a_candidate_that_costs_what_was_expected_or_is_not_finite_stays() {
    let before = piece().s_candidate;
    let cost = piece().contribution(&terms(), &P.into()).cost;
    let (after, s) = reoptimized(cost, 1.009 * cost, 0.01);
    assert!((after - cost).abs() <= 0.0 && s == before, "{after}");
    for bad in [f64::NAN, f64::INFINITY] {
        let (after, s) = reoptimized(bad, cost, 0.01);
        assert!(!after.is_finite() && s == before, "{after}");
    }
    // Off by more than the tolerance, to either side, or nothing was expected.
    for expected in [1.011 * cost, 0.989 * cost, f64::NAN] {
        let (after, s) = reoptimized(cost, expected, 0.01);
        assert!(after < 0.5 * cost && s != before, "{after} of {cost}");
    }
}

#[test]
fn reoptimized_states_have_no_gradient() {
    let (least, s) = reoptimized(piece().contribution(&terms(), &P.into()).cost, f64::NAN, 1e-12);
    let cost = |s: &[Pose]| {
        let mut piece = piece();
        piece.s_candidate = s.to_vec();
        piece.contribution(&terms(), &P.into()).cost
    };
    assert!((cost(&s) / least - 1.0).abs() < 1e-12, "{least}");
    for (k, row) in (0..10).flat_map(|k| (0..4).map(move |row| (k, row))) {
        let [there, back] = [1e-4, -1e-4].map(|aside| {
            let mut s = s.clone();
            s[k][row] += aside;
            cost(&s)
        });
        // Beside the curvature, of about 1e4, nothing is left.
        let gradient = (there - back) / 2e-4;
        assert!(gradient.abs() < 1e-4, "{gradient} of state {k}, row {row}");
    }
}

#[test]
fn a_model_at_one_parameter_has_its_derivatives_and_nothing_to_identify() {
    let p = Vector::from(P);
    let fixed = FixedParameter { model: Kinematic, p: &p };
    let (s, u) = (Pose::new(0.4, -1.0, 1.2, 2.0), Sticks::new(0.3, -0.6, 0.2, 0.5));
    let gap = model_gap(&fixed, &Point { s, u, p: Vector::zeros(), dt_s: DT_S });
    assert!(gap.gap < 1e-8, "{gap}");
    assert_eq!(fixed.step(&s, &u, &Vector::zeros(), DT_S), Kinematic.step(&s, &u, &p, DT_S));
    let w = Vector::from([1.0, -0.5, 0.3, 2.0]);
    let second = fixed.hessian_by_parameter(&s, &u, &Vector::zeros(), DT_S, &w).unwrap();
    assert!(amax(&second.by_state) > 1e-4, "{second:?}");
}

#[test]
fn the_subsystems_of_a_model_stay_without_their_parameters() {
    /// States, inputs and number of parameters of each subsystem.
    #[derive(Default)]
    struct Seen(Vec<(Vec<usize>, Vec<usize>, usize)>);

    impl VisitSubsystems for Seen {
        fn visit<const S: usize, const P: usize>(
            &mut self,
            states: &'static [usize; S],
            inputs: &'static [usize],
            _parameters: &'static [usize; P],
        ) {
            self.0.push((states.to_vec(), inputs.to_vec(), P));
        }
    }

    let (mut whole, mut without) = (Seen::default(), Seen::default());
    Lagged::subsystems(&mut whole);
    <FixedParameter<'_, Lagged, 11> as Model<11, 4, 4, 0>>::subsystems(&mut without);
    assert_eq!(whole.0.iter().map(|group| group.2).collect::<Vec<_>>(), [8, 3]);
    for group in &mut whole.0 {
        group.2 = 0;
    }
    assert_eq!(whole.0, without.0);
}
