use horizon_model::check::amax;
use horizon_model::{Kinematic, Matrix, Vector};

use super::super::tests::{pieces, solved};
use super::*;

type M4 = Matrix<4, 4>;

#[test]
fn a_positive_definite_matrix_times_its_inverse_is_one_and_another_has_none() {
    let matrix = Matrix::<3, 3>::new(4.0, 1.0, 0.5, 1.0, 3.0, -0.25, 0.5, -0.25, 2.0);
    let inverse_of = inverse(&matrix).unwrap();
    assert!(amax(&(matrix * inverse_of - Matrix::identity())) < 1e-12);
    assert!(inverse(&Matrix::<2, 2>::new(1.0, 2.0, 2.0, 1.0)).is_err());
}

#[test]
fn the_covariances_are_symmetric_and_the_scaled_one_is_the_plain_one_by_the_residuals() {
    let ident = solved(pieces());
    let Laplace { plain, scaled, clustered, by_prior, residual_variance } =
        Laplace::of(&ident).unwrap();
    for covariance in [plain, scaled, clustered, by_prior] {
        assert!(amax(&(covariance - covariance.transpose())) < 1e-12 * amax(&covariance));
        assert!(inverse(&covariance).is_ok(), "{covariance}");
    }
    assert!(amax(&(scaled - plain * residual_variance)) < 1e-12 * amax(&scaled));
    assert!(residual_variance > 0.0);
}

#[test]
fn what_no_piece_tells_has_the_deviation_of_its_prior() {
    let mut ident = solved(pieces());
    // No piece: all that is known is the prior.
    ident.set_multiplicities(&vec![0; ident.multiplicities().len()]);
    let laplace = Laplace::of(&ident).unwrap();
    assert!(amax(&(laplace.by_prior - laplace.plain)) < 1e-12 * amax(&laplace.plain));
}

#[test]
fn standard_deviations_are_those_of_the_covariance() {
    let ident = solved(pieces());
    let plain = Laplace::of(&ident).unwrap().plain.diagonal().map(f64::sqrt);
    let deviations = standard_deviations(&ident.information().unwrap());
    assert!(amax(&(deviations - plain)) < 1e-9 * amax(&plain), "{deviations} instead of {plain}");
}

#[test]
fn a_parameter_that_is_not_determined_has_no_standard_deviation() {
    // The sum of the first two parameters by 200 observations, and the third one by 30.
    let row = Vector::<4>::new(0.3, 0.7, 0.0, 0.0);
    let mut information = M4::zeros();
    for k in 1..=200 {
        information += row * row.transpose() * f64::from(k).sin().powi(2);
    }
    information[(2, 2)] = 30.0;
    let deviations = standard_deviations(&information);
    assert!(deviations[0].is_nan() && deviations[1].is_nan(), "{deviations}");
    assert!((deviations[2] - 30.0_f64.sqrt().recip()).abs() < 1e-12, "{deviations}");
    assert!(deviations[3].is_nan(), "nothing is known of it: {deviations}");
    // A weak prior on one of the two determines both.
    information[(0, 0)] += 1e-4;
    let deviations = standard_deviations(&information);
    assert!((deviations[0] - 100.0).abs() < 0.01 && deviations[1].is_finite(), "{deviations}");
    for bad in [-30.0, f64::NAN] {
        information[(2, 2)] = bad;
        assert!(standard_deviations(&information).iter().all(|value| value.is_nan()), "{bad}");
    }
}

#[test]
fn pieces_that_count_twice_halve_the_covariance_but_not_the_sandwich_of_copies() {
    let once = Laplace::of(&solved(pieces())).unwrap();
    let twice = Laplace::of(&solved([pieces(), pieces()].concat())).unwrap();
    // The prior, which counts once in both, is weak.
    let ratio = |a: &M4, b: &M4, row: usize| a[(row, row)] / b[(row, row)];
    for row in 0..4 {
        let plain = ratio(&twice.plain, &once.plain, row);
        assert!((plain - 0.5).abs() < 0.02, "row {row}: {plain}");
        // n / (n - 1) of 24 and of 12 pieces.
        let clustered = ratio(&twice.clustered, &once.clustered, row);
        let expected = 0.5 * (24.0 / 23.0) / (12.0 / 11.0);
        assert!((clustered - expected).abs() < 0.02, "row {row}: {clustered}");
    }
}

/// The influence of a dead time on the first parameter alone.
fn influence(by_piece_s: Vec<f64>) -> DelayInfluence<4> {
    let parameter_by_dead_time = Vector::from([2.0, 0.0, 0.0, 0.0]);
    DelayInfluence { by_piece_s, parameter_by_dead_time, information: 100.0 }
}

#[test]
fn a_dead_time_that_was_estimated_adds_its_variance_through_the_parameter() {
    let ident = solved(pieces());
    let given = Laplace::of(&ident).unwrap();
    // No piece shows more of it than another: the sandwich stays.
    let found = Laplace::with_dead_times(&ident, &[influence(vec![0.0; 12])]).unwrap();
    let mut expected = given.plain;
    expected[(0, 0)] += 2.0 * 2.0 / 100.0;
    assert!(amax(&(found.plain - expected)) < 1e-12 * amax(&expected));
    assert!(amax(&(found.clustered - given.clustered)) < 1e-12 * amax(&given.clustered));
    // Two dead times add.
    let both = [influence(vec![0.0; 12]), influence(vec![0.0; 12])];
    let found = Laplace::with_dead_times(&ident, &both).unwrap();
    expected[(0, 0)] += 2.0 * 2.0 / 100.0;
    assert!(amax(&(found.plain - expected)) < 1e-12 * amax(&expected));
}

#[test]
fn pieces_that_move_the_dead_time_move_the_parameter_with_it() {
    let ident = solved(pieces());
    let moved_s = 10.0;
    let far = |piece: usize| if piece == 0 { moved_s } else { 0.0 };
    let found = Laplace::with_dead_times(&ident, &[influence((0..12).map(far).collect())]).unwrap();
    // Beside it what the pieces move at given dead times is small.
    let expected = 12.0 / 11.0 * (2.0 * moved_s).powi(2);
    let found = found.clustered[(0, 0)];
    assert!((found / expected - 1.0).abs() < 0.1, "{found} instead of {expected}");
}

/// The reference needs no gradient: a piece moves the parameter against what leaving it out does (jackknife).
#[test]
fn a_dead_time_may_undo_or_double_what_a_piece_does_to_the_parameter() {
    let all = solved(pieces());
    let without = |piece: usize| {
        let mut others = pieces();
        others.remove(piece);
        solved(others).parameter()[0] - all.parameter()[0]
    };
    let left_out: Vec<f64> = (0..pieces().len()).map(without).collect();
    let variance = |sign: f64| {
        let by_piece_s = left_out.iter().map(|moved| sign * moved / 2.0).collect();
        Laplace::with_dead_times(&all, &[influence(by_piece_s)]).unwrap().clustered[(0, 0)]
    };
    let given = Laplace::of(&all).unwrap().clustered[(0, 0)];
    let [undone, doubled] = [1.0, -1.0].map(|sign| variance(sign) / given);
    assert!(undone < 0.05, "{undone}");
    assert!((doubled - 4.0).abs() < 0.5, "{doubled}");
}

#[test]
fn the_spread_is_normal_around_the_estimate_by_the_sandwich_and_the_prior() {
    let ident: Ident<Kinematic, 4, 4, 4, 4> = solved(pieces());
    let laplace = Laplace::of(&ident).unwrap();
    let spread = laplace.spread(ident.parameter());
    assert!(amax(&(spread.mean - ident.parameter())) < 1e-12);
    for row in 0..4 {
        let std = (laplace.clustered + laplace.by_prior)[(row, row)].sqrt();
        assert!((spread.std[row] / std - 1.0).abs() < 1e-12, "row {row}");
    }
}
