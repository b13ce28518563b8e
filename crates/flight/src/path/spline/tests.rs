use horizon_model::check::maximum;

use super::super::tests::{at, curves};
use super::super::*;
use super::*;

#[test]
fn a_spline_passes_its_waypoints_with_continuous_curvature() {
    for (name, path) in curves() {
        if !name.ends_with("spline") {
            continue;
        }
        for triple in path.points.windows(3) {
            let jump = (triple[2].curvature - triple[0].curvature).abs();
            // Curvature changes by less than 20 / m^2 along these curves.
            assert!(jump < 20.0 * 2.0 * SPACING_M, "{name}: jump by {jump}");
        }
        let end = &path.points[path.points.len() - 1];
        let begin = &path.points[0];
        if name == "closed spline" {
            assert!((begin.pos_w - end.pos_w).norm() < 1e-12);
            assert!((begin.tangent_w - end.tangent_w).norm() < 1e-9);
            assert!((begin.curvature - end.curvature).abs() < 1e-9);
            assert!(
                (path.points[path.marks[2]].pos_w - Vector3::new(1.5, 1.5, 1.0)).norm() < 1e-12
            );
        } else {
            assert!(maximum(begin.curvature, end.curvature) < 1e-9, "{name}");
        }
    }
}

#[test]
fn a_spline_through_a_parabolic_arc_is_the_known_one() {
    // Natural spline through (-1, 0), (0, 1), (1, 0): its second derivative at 0 is -3 / h^2 with the
    // knots at -h, 0, h, by hand.
    let path =
        spline(&[at(-1.0, 0.0, 0.0, 0.0), at(0.0, 1.0, 0.0, 0.0), at(1.0, 0.0, 0.0, 0.0)], false);
    let top = &path.points[path.marks[1]];
    // The derivative by the chord is (1 / h, 0) there, so that the curvature is 3.
    assert!((top.curvature - 3.0).abs() < 1e-9, "{}", top.curvature);
}

#[test]
fn an_open_spline_is_straight_at_its_ends_and_a_closed_one_is_not() {
    let corners = [at(0.0, 0.0, 1.0, 0.0), at(1.0, 0.0, 1.0, 0.0), at(1.0, 1.0, 1.0, 0.0)];
    let [open, closed] = [false, true].map(|is_closed| spline(&corners, is_closed));
    assert!(open.points[0].curvature < 1e-9 && closed.points[0].curvature > 0.1);
    assert_eq!((open.marks.len(), closed.marks.len()), (3, 4));
    let end = |path: &Path| path.points[path.points.len() - 1].pos_w;
    assert!((end(&open) - Vector3::new(1.0, 1.0, 1.0)).norm() < 1e-12);
    assert!((end(&closed) - Vector3::new(0.0, 0.0, 1.0)).norm() < 1e-12);
}
