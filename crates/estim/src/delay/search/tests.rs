//! Steps of the refinement, verdicts and standard deviations of single groups.

use horizon_model::rows::Sticks;

use super::super::tests::{flights, settings, with_search};
use super::*;

const TRUTH_S: f64 = 0.3;

/// Two flights in which all sticks act [`TRUTH_S`] late, and their noise.
fn recordings(noise: f64) -> [crate::Recording<4, 4>; 2] {
    flights(Sticks::repeat(TRUTH_S), 0.015, noise, 1)
}

/// Dead times after `rounds` steps from `start_s` with a `curvature` that is no information, and the last one stays.
fn refined_s(start_s: f64, rounds: u32) -> [f64; 3] {
    let mut minima =
        [Some(1e-9), Some(1e-9), None].map(|curvature| LocalMinimum { at_s: start_s, curvature });
    let settings = DelaySettings { rounds, ..settings() };
    with_search(&recordings(0.0), 50, Sticks::repeat(start_s), &settings, |search| {
        search.refine(&mut minima).ok().unwrap();
    });
    minima.map(|minimum| minimum.at_s)
}

#[test]
fn a_first_step_is_half_of_the_grid_and_half_a_step_follows_a_change_of_sign() {
    let close = |found_s: [f64; 3], expected_s: [f64; 3]| {
        let gaps_s = found_s.iter().zip(expected_s).map(|(found_s, right_s)| found_s - right_s);
        assert!(gaps_s.into_iter().all(|gap_s| gap_s.abs() < 1e-9), "{found_s:?}");
    };
    close(refined_s(0.25, 1), [0.28, 0.28, 0.25]);
    // Past the minimum: the secant would lead back by 20 ms.
    close(refined_s(0.29, 1), [0.32, 0.32, 0.29]);
    close(refined_s(0.29, 2), [0.305, 0.305, 0.29]);
}

#[test]
fn the_secant_leads_to_the_minimum() {
    let [horizontal_s, yaw_s, throttle_s] = refined_s(0.25, 20);
    for at_s in [horizontal_s, yaw_s] {
        assert!((at_s - TRUTH_S).abs() < 1e-3, "{at_s} s");
    }
    assert_eq!(throttle_s.to_bits(), 0.25_f64.to_bits(), "without a curvature it stays");
}

#[test]
fn a_minimum_within_a_period_of_an_end_of_the_range_is_none() {
    with_search(&recordings(0.0), 50, Sticks::repeat(TRUTH_S), &settings(), |search| {
        let cost = search.solve().ok().unwrap();
        let solved = Solved { ident: search.ident.clone(), cost };
        let verdicts = [0.019, 0.021, 0.579, 0.581].map(|at_s| {
            let (uncertainty, verdict) = search.uncertainty(1, at_s, &solved).ok().unwrap();
            assert_eq!(uncertainty.is_some(), verdict == DelayVerdict::Minimum, "{at_s} s");
            verdict
        });
        assert_eq!((verdicts[0], verdicts[3]), (DelayVerdict::Zero, DelayVerdict::EndOfRange));
        for verdict in &verdicts[1..3] {
            assert!(![verdicts[0], verdicts[3]].contains(verdict), "{verdicts:?}");
        }
    });
}

#[test]
fn after_a_descent_that_diverged_a_group_returns_to_its_start() {
    with_search(&recordings(0.0), 50, Sticks::repeat(TRUTH_S), &settings(), |search| {
        let cost = search.solve().ok().unwrap();
        let start = search.ident.clone();
        let mut solved = Solved { ident: start.clone(), cost };
        let mut judge = |diverged_from| {
            let curve = [0.24, 0.3, 0.36]
                .map(|at_s| ProfilePoint { dead_time_s: at_s, cost: 1e9 * (at_s - TRUTH_S).abs() });
            let profile = GroupProfile { curve: curve.to_vec(), at_s: TRUTH_S };
            search.judge_group(1, profile, 0.22, diverged_from, &mut solved).ok().unwrap()
        };
        let found = judge(None);
        assert_eq!((found.verdict, found.dead_time_s), (DelayVerdict::Minimum, TRUTH_S));
        let found = judge(Some(&start));
        assert_eq!((found.verdict, found.dead_time_s), (DelayVerdict::Undecided, 0.22));
        assert!(found.spread.is_none() && found.influence.is_none(), "{found:?}");
        assert_eq!(search.dead_time_of(1).to_bits(), 0.22_f64.to_bits());
        assert!(solved.cost > cost, "{} at 0.22 s", solved.cost);
    });
}

/// Standard deviation of a dead time, that by the scatter of its `pieces` alone, and that by the residual variance, or
/// 1 if that is more.
fn deviations_s(noise: f64, pieces: usize) -> [f64; 3] {
    // 350 steps of one flight.
    let [recording, _] = recordings(noise);
    let (start_s, steps) = (Sticks::repeat(TRUTH_S), 350 / pieces);
    with_search(&[recording], steps, start_s, &settings(), |search| {
        let cost = search.solve().ok().unwrap();
        let solved = Solved { ident: search.ident.clone(), cost };
        let (uncertainty, _) = search.uncertainty(1, TRUTH_S, &solved).ok().unwrap();
        let DeadTimeUncertainty { spread, influence } = uncertainty.unwrap();
        let DelayInfluence { by_piece_s, information, .. } = influence.unwrap();
        assert_eq!(by_piece_s.len(), pieces);
        let scatter_s = by_piece_s.iter().map(|by| by * by).sum::<f64>().sqrt();
        let variance = spread.std_white_s.powi(2) * information;
        [spread.std_s, scatter_s, (variance.max(1.0) / information).sqrt()]
    })
}

#[test]
fn fewer_than_ten_pieces_have_no_deviation_below_that_of_the_residuals() {
    for noise in [0.0, 0.5] {
        let [std_s, scatter_s, white_s] = deviations_s(noise, 9);
        let expected_s = (scatter_s * 1.125_f64.sqrt()).max(white_s);
        assert!((std_s / expected_s - 1.0).abs() < 1e-9, "{std_s}: {scatter_s}, {white_s}");
        let [std_s, scatter_s, white_s] = deviations_s(noise, 10);
        assert!((std_s / scatter_s - 1.0).abs() < 1e-9, "{std_s}: {scatter_s}, {white_s}");
    }
    let [std_s, _, white_s] = deviations_s(0.0, 10);
    assert!(std_s < 0.5 * white_s, "{std_s}, {white_s}");
}
