use super::*;
use crate::check::amax;
use crate::differences;
use crate::vehicles::lagged::smooth::limit;
use crate::vehicles::lagged::terms::tests::{LIMIT_WIDTH, all};

/// `terms` with another change `e` before the limit, and what follows from it.
fn moved(terms: &Terms, e: &Vector2<f64>) -> Terms {
    let ratio2 = e.norm_squared() * terms.per_limit2;
    Terms { change_w_mps: *e, ratio2, limit: limit(ratio2, LIMIT_WIDTH), ..*terms }
}

#[test]
fn the_second_derivative_of_the_limited_change_meets_its_numeric_twin() {
    for terms in all() {
        let e = terms.change_w_mps;
        let w = Vector2::new(0.7, -1.3);
        let gradient = |e: &Vector2<f64>| {
            let terms = moved(&terms, e);
            Vector2::new(
                terms.limited_derivative(Vector2::x()).dot(&w),
                terms.limited_derivative(Vector2::y()).dot(&w),
            )
        };
        let numeric = differences::jacobian(gradient, &e);
        let gap = amax(&(terms.limit_curvature(w, LIMIT_WIDTH) - numeric));
        assert!(gap < 1e-5 * amax(&numeric).max(1.0), "gap {gap:e} at {e}: {numeric}");
    }
}

#[test]
fn the_absolute_value_of_a_matrix_is_that_of_its_eigenvalues() {
    for (a, b, c) in [(1.0, 0.3, -2.0), (-1.0, 0.5, -3.0), (2.0, -0.5, 1.0), (0.0, 1.0, 0.0)] {
        let h = Matrix2::new(a, b, b, c);
        let mut eigen = h.symmetric_eigen();
        eigen.eigenvalues = eigen.eigenvalues.abs();
        let gap = amax(&(absolute(&h) - eigen.recompose()));
        assert!(gap < 1e-14, "gap {gap:e} of {h}");
    }
    assert_eq!(absolute(&Matrix2::zeros()), Matrix2::zeros());
    // Of rank one there is no determinant to help.
    let along = Vector2::new(3.0, -4.0);
    let gap = amax(&(absolute(&(-along * along.transpose())) - along * along.transpose()));
    assert!(gap < 1e-13, "gap {gap:e}");
}
