use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::super::tests::at;
use super::super::*;
use super::*;

#[test]
fn a_fixed_heading_turns_the_short_way_in_proportion_to_the_way() {
    let path =
        rounded(&[at(0.0, 0.0, 1.0, 0.0), at(2.0, 0.0, 1.0, 0.0), at(2.0, 1.0, 1.0, 0.0)], 0.1);
    let headings = path.headings(Heading::Fixed, &[3.0, -3.0, 2.0]);
    assert_eq!(headings.len(), path.points.len());
    let [first, second, third] = [0, 1, 2].map(|k| headings[path.marks[k]]);
    assert!((first - 3.0).abs() < 1e-12 && (second - (TAU - 3.0)).abs() < 1e-12, "{second}");
    assert!((third - 2.0).abs() < 1e-12, "{third}");
    let half = path.arcs_m.partition_point(|arc_m| *arc_m < 0.5 * path.arcs_m[path.marks[1]]);
    assert!((headings[half] - PI).abs() < 2e-3, "{}", headings[half]);
}

#[test]
fn a_heading_along_the_path_is_its_direction_and_never_jumps_by_a_turn() {
    let path = circle(Vector3::zeros(), 1.0, 0.0, 2.0);
    let headings = path.headings(Heading::Along, &[0.0, 0.0]);
    assert!((headings[0] - FRAC_PI_2).abs() < 1e-12);
    assert!((headings[headings.len() - 1] - FRAC_PI_2 - 2.0 * TAU).abs() < 1e-9);
    // Straight up has no direction: the one before it goes on, or the one after it comes early.
    let up = [at(0.0, 0.0, 1.0, 0.0), at(0.0, 0.0, 2.0, 0.0), at(0.0, -1.0, 2.0, 0.0)];
    for heading in rounded(&up, 0.0).headings(Heading::Along, &[1.0; 3]) {
        assert!((heading + FRAC_PI_2).abs() < 1e-12, "{heading}");
    }
    for heading in rounded(&up[..2], 0.0).headings(Heading::Along, &[1.0; 2]) {
        assert!((heading - 1.0).abs() < 1e-12, "{heading}");
    }
}

#[test]
fn a_direction_needs_a_horizontal_part() {
    for (x_m, expected) in [(2.0e-6, 0.0), (-2.0e-6, PI), (0.5e-6, 0.7)] {
        let path = rounded(&[at(0.0, 0.0, 0.0, 0.0), at(x_m, 0.0, 1.0, 0.0)], 0.0);
        let headings = path.headings(Heading::Along, &[0.7, 0.0]);
        assert!(headings.iter().all(|theta| (theta - expected).abs() < 1e-12), "{x_m} m");
    }
}

#[test]
fn without_any_theta_a_fixed_heading_is_zero() {
    let path = rounded(&[at(0.0, 0.0, 0.0, 1.0), at(1.0, 0.0, 0.0, 1.0)], 0.0);
    assert_eq!(path.headings(Heading::Fixed, &[]), [0.0]);
}
