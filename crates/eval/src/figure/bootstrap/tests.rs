use super::*;

fn row(estimate: f64, samples: &[f64], laplace_std: Option<f64>) -> BootstrapRow {
    BootstrapRow {
        row: Row::linear("tau_h", "s"),
        estimate,
        samples: samples.to_vec(),
        laplace_std,
    }
}

#[test]
fn the_interval_by_laplace_holds_95_percent_of_the_normal_distribution() {
    let [low, high] = laplace_interval(&row(1.5, &[], Some(0.25)));
    assert!((low - 1.010).abs() < 1e-4 && (high - 1.990).abs() < 1e-4, "{low} {high}");
    assert!(laplace_interval(&row(1.5, &[], None)).iter().all(|end| end.is_nan()));
}

#[test]
fn the_deviation_in_the_heading_has_two_digits_and_the_estimate_as_many_decimals() {
    for (samples, expected) in [
        (&[1.0, 3.0][..], "1.5 (std 1.4)"),
        (&[1.0, 1.03], "1.500 (std 0.021)"),
        (&[0.0, 200.0], "2 (std 141)"),
        (&[1.0, f64::NAN, 3.0, f64::INFINITY], "1.5 (std 1.4)"),
        (&[2.0, 2.0], "1.5000"),
        (&[2.0], "1.5000"),
        (&[], "1.5000"),
    ] {
        let [name, value] = heading(&row(1.5, samples, None));
        assert_eq!((name.as_str(), value.as_str()), ("tau_h [s]", expected), "{samples:?}");
    }
}

#[test]
fn a_violin_is_symmetric_within_its_width_and_widest_where_most_samples_are() {
    let samples = [0.0, 0.9, 1.0, 1.0, 1.1, 4.0];
    let outline = violin(&samples, 0.2);
    let (left, right) = outline.split_at(outline.len() / 2);
    for ((x_left, at), (x_right, at_right)) in left.iter().zip(right.iter().rev()) {
        assert!((x_left + x_right - 2.0 * BOOTSTRAP_X).abs() < 1e-12);
        assert!((at - at_right).abs() < 1e-12 && (0.0..=4.0).contains(at));
    }
    let widest = right.iter().max_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
    assert!((widest.0 - BOOTSTRAP_X - VIOLIN_X).abs() < 1e-12, "{widest:?}");
    assert!((widest.1 - 1.0).abs() < 0.1, "{widest:?}");
    assert!(violin(&[], 0.0).is_empty());
}
