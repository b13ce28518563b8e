use super::*;

/// Candidates 0.06 s apart, and the gradients of `3 (s - least_s)^2` there.
fn parabola(least_s: f64) -> (Vec<f64>, Vec<f64>) {
    let at_s: Vec<f64> = (0..8).map(|i| 0.06 * f64::from(i)).collect();
    let gradients = at_s.iter().map(|at_s| 6.0 * (at_s - least_s)).collect();
    (at_s, gradients)
}

#[test]
fn the_gradients_of_a_parabola_are_integrated_to_the_parabola() {
    // Left and right of the candidate nearest to it, and on it.
    for least_s in [0.2, 0.17, 0.18, 0.25] {
        let (candidates_s, gradients) = parabola(least_s);
        let (profile, minimum) = integrate(&candidates_s, &gradients);
        let curve = profile.above_lowest();
        assert!((minimum.at_s - least_s).abs() < 1e-12, "{minimum:?} instead of {least_s}");
        assert!((minimum.curvature.unwrap() - 6.0).abs() < 1e-12, "{minimum:?}");
        assert!(
            curve.is_sorted_by(|left, right| left.dead_time_s < right.dead_time_s),
            "{curve:?}"
        );
        assert!(
            curve.contains(&ProfilePoint { dead_time_s: minimum.at_s, cost: 0.0 }),
            "{curve:?}"
        );
        for ProfilePoint { dead_time_s: at_s, cost } in curve {
            // The trapezoidal rule is exact for a gradient that is linear.
            let expected = 3.0 * (at_s - least_s).powi(2);
            assert!((cost - expected).abs() < 1e-14, "{cost} at {at_s} s");
        }
    }
}

#[test]
fn a_profile_that_falls_to_an_end_has_its_minimum_there() {
    for (least_s, end_s) in [(-0.1, 0.0), (0.6, 0.42)] {
        let (at_s, gradients) = parabola(least_s);
        let (_, minimum) = integrate(&at_s, &gradients);
        assert!((minimum.at_s - end_s).abs() < 1e-12 && minimum.curvature.is_none(), "{minimum:?}");
    }
    // Beside a gradient that is not finite there is no parabola to follow.
    let (_, minimum) = integrate(&[0.0, 0.1, 0.2], &[-1.0, -1.0, f64::NAN]);
    assert!((minimum.at_s - 0.1).abs() < 1e-12 && minimum.curvature.is_none(), "{minimum:?}");
}

#[test]
fn a_minimum_lies_between_its_candidate_and_the_neighbour_that_it_falls_to() {
    let candidates_s = [0.0, 0.1, 0.2, 0.3];
    for (gradients, expected_s) in
        [([-4.0, -1.0, 3.0, 4.0], 0.125), ([-4.0, -3.0, 1.0, 4.0], 0.175)]
    {
        let (_, minimum) = integrate(&candidates_s, &gradients);
        assert!((minimum.at_s - expected_s).abs() < 1e-12, "{minimum:?}, not {expected_s}");
    }
}

#[test]
fn a_rise_is_the_highest_cost_on_its_side() {
    let point = |(dead_time_s, cost)| ProfilePoint { dead_time_s, cost };
    let curve = [(0.0, 0.5), (0.1, 2.0), (0.2, 0.0), (0.3, 0.25), (0.4, 1.0)].map(point);
    assert_eq!(rises(&curve, 0.2).map(f64::to_bits), [2.0, 1.0].map(f64::to_bits));
    assert_eq!(rises(&curve, 0.0).map(f64::to_bits), [0.0, 2.0].map(f64::to_bits));
    assert_eq!(rises(&curve, 0.35).map(f64::to_bits), [2.0, 1.0].map(f64::to_bits));
    let [left, right] = rises(&[(0.0, f64::NAN), (0.1, 1.0), (0.2, 3.0)].map(point), 0.15);
    assert!(left.is_nan() && (right - 3.0).abs() <= 0.0, "{left}, {right}");
}

#[test]
fn the_vertex_is_that_of_the_parabola() {
    let cost = |s: f64| 3.0 * (s - 0.31).powi(2) + 7.0;
    let parabola = |s: f64| ProfilePoint { dead_time_s: s, cost: cost(s) };
    let mut profile = CostProfile::new([0.1, 0.2, 0.3, 0.36].map(parabola).to_vec());
    let vertex_s = profile.vertex_s().unwrap();
    assert!((vertex_s - 0.31).abs() < 1e-12, "{vertex_s}");
    profile.insert_lowest(parabola(vertex_s));
    let curve = profile.above_lowest();
    assert!(curve.is_sorted_by(|a, b| a.dead_time_s < b.dead_time_s), "{curve:?}");
    assert!(curve[3].cost.abs() <= 0.0 && curve[4].cost > 0.0, "{curve:?}");
    let flipped = |s: f64| ProfilePoint { dead_time_s: s, cost: -cost(s) };
    assert!(super::vertex_s(flipped(0.2), flipped(0.3), flipped(0.36)).is_none());
    assert!(
        CostProfile::new([0.2, 0.3, 0.36].map(flipped).to_vec()).vertex_s().is_none(),
        "an end"
    );
}

#[test]
fn a_curve_has_risen_between_the_points_around_the_cost() {
    let point = |(dead_time_s, cost)| ProfilePoint { dead_time_s, cost };
    let curve = [(0.0, 0.0), (0.1, 4.0), (0.2, 3.0), (0.3, 12.0)].map(point);
    for (at_s, cost, expected) in [(0.0, 1.0, 0.05), (0.0, 4.0, 0.1), (0.05, 1.0, 0.075)] {
        let risen_s = risen_at_s(&curve, at_s, cost);
        assert!((risen_s - expected).abs() < 1e-12, "{at_s}, {cost}: {risen_s}");
    }
    assert!((risen_at_s(&curve, 0.0, 7.0) - (0.2 + 0.1 * (4.0_f64 / 9.0).sqrt())).abs() < 1e-12);
    assert!((risen_at_s(&curve, 0.0, 13.0) - 0.3).abs() < 1e-12, "never");
}
