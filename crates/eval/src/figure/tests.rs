//! Each figure with data, without, and with the worst data.

use std::f64::consts::{PI, TAU};
use std::fs;
use std::ops::Range;

use proptest::prelude::*;

use super::*;

const DT_S: f64 = 0.02;
const ROWS: [Row; 4] =
    [Row::linear("x", "m"), Row::linear("y", "m"), Row::linear("ratio", "1"), Row::angle("theta")];

/// One figure of each kind from the same series.
pub(super) fn figures(values: &[f64]) -> Vec<(&'static str, Figure)> {
    let time_s: Vec<_> = (0..values.len()).map(|k| k as f64 * DT_S).collect();
    let half = values.len() / 2;
    let pieces: [Range<usize>; 2] = [0..half, half..values.len()];
    let owned = || values.to_vec();
    let fits =
        ROWS.map(|row| FitRow { row, observed: owned(), estimated: owned(), simulated: owned() });
    let first = values.first().copied().unwrap_or(f64::NAN);
    let resampled = ROWS.map(|row| BootstrapRow {
        row,
        estimate: first,
        samples: owned(),
        laplace_std: Some(0.1),
    });
    let profile = DelayCurve {
        name: "horizontal",
        dead_time_s: &time_s,
        cost: values,
        minimum_s: first,
        interval_s: [first - 0.1, first + 0.1],
    };
    let shifts = ROWS.map(|row| ShiftRow {
        row,
        moved: owned(),
        cumulative: owned(),
        shifted: owned(),
        dead_time_s: 0.32,
    });
    let halves = || vec![&values[..half], &values[half..]];
    let residual_rows = ROWS.map(|row| ResidualRow { row, pieces: halves() });
    let points = || time_s.iter().copied().zip(owned()).collect();
    let line = || ForecastLine { model: "kinematic", points: points() };
    let panels = ROWS.map(|row| ForecastPanel { row, lines: vec![line()] });
    vec![
        ("fit", fit("Fit", &time_s, &pieces, &fits)),
        ("bootstrap", bootstrap("Bootstrap", &resampled)),
        ("delay_profile", delay_profile("Profile", &[profile; 3])),
        ("delay_shift", delay_shift("Shift", &time_s, &shifts)),
        ("residuals", residuals("Residuals", DT_S, 20, &residual_rows)),
        ("forecast", forecast("Forecast", &[0.2, 0.6, 1.0], &panels)),
    ]
}

/// A flight of 27,000 samples: slow motion, noise, lost samples, two outliers.
pub(super) fn flight() -> Vec<f64> {
    let sample = |k: u32| {
        let (t_s, noise) = (f64::from(k) * DT_S, f64::from(k.wrapping_mul(2_654_435_761) >> 16));
        (0.3 * t_s).sin() + 2.0 * (0.071 * t_s).cos() + 1e-6 * noise
    };
    let mut values: Vec<_> = (0..27_000).map(sample).collect();
    values[5_000..5_050].fill(f64::NAN);
    values[13_777] = 9.0;
    values[20_001] = -8.0;
    values
}

/// Texts of an SVG document, which must be well-formed.
pub(super) fn texts(svg: &str) -> Vec<String> {
    let document = roxmltree::Document::parse(svg).expect("not XML");
    let texts = document.descendants().filter(|node| node.has_tag_name("text"));
    texts.filter_map(|node| node.text().map(str::to_owned)).collect()
}

#[test]
fn each_figure_is_xml_and_names_its_axes_with_units() {
    let expected: [(&str, &[&str]); 6] = [
        ("fit", &["Fit", "x [m]", "ratio", "theta [rad]", "time [s]", "observation", "estimate"]),
        ("bootstrap", &["x [m]", "ratio", "bootstrap", "Laplace", "estimate from all data"]),
        ("delay_profile", &["horizontal", "dead time [s]", "cost above the minimum", "minimum"]),
        ("delay_shift", &["theta [rad]", "time [s]", "cumulative input", "x: dead time 0.320 s"]),
        ("residuals", &["density [1/m]", "density", "x residual [m]", "lag [s]"]),
        ("forecast", &["x error, RMSE [m]", "horizon [s]", "kinematic"]),
    ];
    for ((name, figure), (expected_name, labels)) in figures(&flight()).iter().zip(expected) {
        assert_eq!(*name, expected_name);
        let texts = texts(&figure.svg());
        for label in labels {
            assert!(texts.iter().any(|text| text == label), "{name} has no {label:?}: {texts:?}");
        }
        assert!(!texts.iter().any(|text| text == "no data"), "{name}: {texts:?}");
    }
}

#[test]
fn a_long_flight_is_a_small_file_and_equal_data_give_equal_bytes() {
    let again = figures(&flight());
    for ((name, figure), (_, twin)) in figures(&flight()).iter().zip(&again) {
        let svg = figure.svg();
        assert!(svg.len() < 500_000, "{name}: {} bytes", svg.len());
        assert_eq!(svg, twin.svg(), "{name}");
    }
    let [(_, first), ..] = &again[..] else { panic!("no figure") };
    assert!(first.png() == first.clone().png(), "the PNG files differ");
}

#[test]
fn without_data_each_figure_says_so() {
    for values in [&[][..], &[f64::NAN; 5], &[f64::INFINITY; 2]] {
        for (name, figure) in figures(values) {
            let texts = texts(&figure.svg());
            let count = texts.iter().filter(|text| *text == "no data").count();
            assert!(count >= 3, "{name} of {values:?} shows it {count} times: {texts:?}");
        }
    }
    assert!(texts(&fit("Nothing", &[], &[], &[]).svg()).contains(&"Nothing".to_owned()));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn no_data_break_a_figure(values in proptest::collection::vec(proptest::num::f64::ANY, 0..40)) {
        for (name, figure) in figures(&values) {
            let svg = figure.svg();
            let document = roxmltree::Document::parse(&svg).expect("not XML");
            for path in document.descendants().filter_map(|node| node.attribute("d")) {
                prop_assert!(!path.contains("NaN") && !path.contains("inf"), "{name}: {path}");
            }
        }
    }
}

#[test]
fn observed_angles_are_drawn_on_the_turn_of_the_estimate() {
    let time_s = [0.0, 1.0];
    let figure = |observed: &[f64]| {
        fit(
            "",
            &time_s,
            &[],
            &[FitRow {
                row: ROWS[3],
                observed: observed.to_vec(),
                estimated: vec![PI, 3.2],
                simulated: Vec::new(),
            }],
        )
    };
    assert_eq!(figure(&[PI, 3.2 - TAU]).svg(), figure(&[PI, 3.2]).svg());
}

#[test]
fn the_box_plot_prints_the_estimate_with_the_digits_that_the_spread_allows() {
    let row = BootstrapRow {
        row: Row::linear("lambda_h", "m/s"),
        estimate: 1.064_8,
        samples: vec![0.99, f64::NAN, 1.14],
        laplace_std: None,
    };
    // The standard deviation of two samples is their distance over the root of 2.
    let texts = texts(&bootstrap("", &[row]).svg());
    assert!(texts.contains(&"1.06 (std 0.11)".to_owned()), "{texts:?}");
}

#[test]
fn a_profile_without_minimum_or_interval_says_so() {
    let open = [f64::NEG_INFINITY, 0.4];
    for (minimum_s, interval_s, expected) in [
        (0.32, open, "0.320 s, 95 % [-inf, 0.400]"),
        (0.32, [f64::NAN; 2], "0.320 s, no interval"),
        (f64::NAN, [f64::NAN; 2], "no minimum"),
    ] {
        let (dead_time_s, cost) = (&[0.2, 0.3, 0.4], &[3.0, 1.0, 2.0]);
        let curve = DelayCurve { name: "yaw", dead_time_s, cost, minimum_s, interval_s };
        let texts = texts(&delay_profile("", &[curve]).svg());
        assert!(texts.iter().any(|text| text == expected), "{expected}: {texts:?}");
    }
}

#[test]
fn save_writes_both_files_and_names_the_path_it_cannot_write() {
    let dir = std::env::temp_dir().join(format!("tello_ctl_figure_{}", std::process::id()));
    let figure = fit("Saved", &[], &[], &[]);
    let [svg, png] = save(&dir, "fit", &figure).unwrap();
    assert_eq!(fs::read_to_string(&svg).unwrap(), figure.svg());
    assert!(fs::read(&png).unwrap().starts_with(b"\x89PNG"));
    let error = save(&svg, "fit", &figure).unwrap_err().to_string();
    assert!(error.contains("fit.svg"), "{error}");
    fs::remove_dir_all(dir).unwrap();
}
