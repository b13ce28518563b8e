use std::f64::consts::{FRAC_PI_4, FRAC_PI_8, PI};
use std::sync::Arc;

use tello_eval::telemetry::Telemetry;

use super::*;
use crate::fly::tui::tests::view;

#[test]
fn the_arrow_is_the_nearest_of_eight_directions() {
    let arrow = |theta| arrow(&Spot { theta, ..Spot::default() }, Projection::Above);
    for (eighth, expected) in ARROWS.into_iter().enumerate() {
        let theta = eighth as f64 * FRAC_PI_4;
        for turn in [-4.0 * PI, 0.0, 2.0 * PI] {
            for off in [-0.49, 0.0, 0.49] {
                assert_eq!(arrow(theta + turn + off * FRAC_PI_4), expected, "{eighth}: {off}");
            }
        }
    }
    assert_eq!(arrow(-FRAC_PI_8 - 0.01), "\u{2198}");
    assert_eq!(super::arrow(&Spot::default(), Projection::Side), "o");
}

/// Bounds of a view of these places in an area.
fn bounds_of(places: &[PosW], (columns, rows): (u16, u16), seen: Projection) -> [[f64; 2]; 2] {
    let mut view = view(true);
    view.briefing.path = places.to_vec();
    view.facts = Arc::new(Telemetry::default());
    bounds(&view, Rect::new(0, 0, columns, rows), seen)
}

#[test]
fn a_metre_is_as_long_to_the_right_as_up_and_all_is_inside_with_a_margin() {
    let places = [[-1.0, 2.0, 1.0], [3.0, 0.0, 1.5]];
    for size in [(40, 10), (10, 40), (20, 10)] {
        for (seen, [x_m, y_m]) in [
            (Projection::Above, [[-1.0, 3.0], [0.0, 2.0]]),
            (Projection::Side, [[-1.0, 3.0], [0.0, 1.5]]),
        ] {
            let [[left, right], [low, high]] = bounds_of(&places, size, seen);
            // Two dots to the right and four up in a character.
            let dots = [2.0 * f64::from(size.0), 4.0 * f64::from(size.1)];
            let [across, up] = [(right - left) / dots[0], (high - low) / dots[1]];
            assert!((across - up).abs() < 1e-12, "{size:?}: {across} and {up} m per dot");
            // Rounding of the middle.
            let slack = MARGIN_M - 1e-12;
            assert!(x_m[0] - left >= slack && right - x_m[1] >= slack, "{left}..{right}");
            assert!(y_m[0] - low >= slack && high - y_m[1] >= slack, "{low}..{high}");
            // One of both is just as wide as it has to be.
            let spare = (right - left - (x_m[1] - x_m[0])).min(high - low - (y_m[1] - y_m[0]));
            assert!((spare - 2.0 * MARGIN_M).abs() < 1e-12, "{spare} m");
        }
    }
}

#[test]
fn the_side_shows_the_floor_under_the_path_alone() {
    let [_, [low, _]] = bounds_of(&[[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]], (10, 10), Projection::Side);
    assert!(low <= -MARGIN_M + 1e-12, "{low} m");
    assert_eq!(bounds_of(&[], (10, 10), Projection::Side), [[-1.0, 1.0]; 2], "nothing to show");
}
