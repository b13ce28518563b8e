//! The reduced system in the parameter: the Schur complement of the normal equations after every state is
//! eliminated.
//!
//! Owns its minimization under `lo <= p <= hi` by a primal active-set method (Nocedal and Wright, Numerical
//! Optimization, 2006, algorithm 16.3), which is exact. Chains with a common `p` add their reduced systems and
//! solve once.

use std::ops::AddAssign;

use horizon_model::{Bounds, Matrix, Vector};

use crate::cholesky::{Cholesky, NotPositive};

/// A quadratic in the parameter step `d`: `gradient' d + d' hessian d / 2 - decrease`. The cost has no unit, `d` has
/// those of the parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ReducedSystem<const NP: usize> {
    /// Second derivative by `p`, the states eliminated. 1 / (unit of the row, unit of the column)
    pub(crate) hessian: Matrix<NP, NP>,
    /// Derivative by `p`, the states eliminated. 1 / unit of the row
    pub(crate) gradient: Vector<NP>,
    /// Decrease of the cost by the states' step at constant `p`. 1, >= 0
    pub(crate) decrease: f64,
}

/// The active bound of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Lo,
    Hi,
}

impl<const NP: usize> ReducedSystem<NP> {
    /// No curvature, no gradient: a system to add to.
    pub(crate) fn zeros() -> Self {
        Self { hessian: Matrix::zeros(), gradient: Vector::zeros(), decrease: 0.0 }
    }

    /// The sum of `count` copies.
    #[must_use]
    pub(crate) fn times(&self, count: u32) -> Self {
        let count = f64::from(count);
        Self {
            hessian: self.hessian * count,
            gradient: self.gradient * count,
            decrease: self.decrease * count,
        }
    }

    /// The parameter that minimizes `self + damping |d|^2 / 2` inside the box, and the decrease.
    ///
    /// `p` must lie inside the box. Units of the rows. The result lies inside the box; a row with an active bound is
    /// equal to its bound.
    ///
    /// Real time: no allocation; one factorization per change of the working set, at most `4 NP + 4`.
    ///
    /// # Errors
    /// The damped matrix is not positive definite.
    pub(crate) fn solve(
        &self,
        damping: f64,
        p: &Vector<NP>,
        bounds: &Bounds<NP>,
    ) -> Result<(Vector<NP>, f64), NotPositive> {
        let hessian = self.hessian + Matrix::from_diagonal_element(damping);
        // A multiplier less negative than this is rounding: its bound stays in the working set.
        let multiplier_min = 1e-12 * self.gradient.amax();
        let mut active = [None; NP];
        let mut p_next = *p;
        // Every round moves to a lower cost. The limit is only against ties in the rounding.
        for _ in 0..4 * NP + 4 {
            let target = self.subspace_minimum(&hessian, p, &p_next, &active)?;
            if let Some((row, side, fraction)) = blocking_bound(&p_next, &target, bounds, &active) {
                p_next += (target - p_next) * fraction;
                p_next[row] = match side {
                    Side::Lo => bounds.lo[row],
                    Side::Hi => bounds.hi[row],
                };
                active[row] = Some(side);
                continue;
            }
            p_next = target;
            let gradient = hessian * (p_next - p) + self.gradient;
            let Some(row) = bound_to_release(&gradient, &active, multiplier_min) else { break };
            active[row] = None;
        }
        let step = p_next - p;
        let gain = -self.gradient.dot(&step) - 0.5 * step.dot(&(hessian * step));
        Ok((p_next, self.decrease + gain))
    }

    /// The minimum over the rows with inactive bounds; rows with an active bound keep their value.
    fn subspace_minimum(
        &self,
        hessian: &Matrix<NP, NP>,
        p: &Vector<NP>,
        p_next: &Vector<NP>,
        active: &[Option<Side>; NP],
    ) -> Result<Vector<NP>, NotPositive> {
        let mut matrix = *hessian;
        let mut right = -self.gradient;
        for row in (0..NP).filter(|row| active[*row].is_some()) {
            right -= hessian.column(row) * (p_next[row] - p[row]);
            matrix.fill_row(row, 0.0);
            matrix.fill_column(row, 0.0);
            matrix[(row, row)] = 1.0;
        }
        let step = Cholesky::new(matrix)?.solve(right);
        Ok(Vector::from_fn(
            |row, _| {
                if active[row].is_some() { p_next[row] } else { p[row] + step[row] }
            },
        ))
    }
}

impl<const NP: usize> AddAssign<&Self> for ReducedSystem<NP> {
    fn add_assign(&mut self, other: &Self) {
        self.hessian += other.hessian;
        self.gradient += other.gradient;
        self.decrease += other.decrease;
    }
}

/// The blocking bound between `from` and `to`: row, side and step length of the first inactive bound on the way.
fn blocking_bound<const NP: usize>(
    from: &Vector<NP>,
    to: &Vector<NP>,
    bounds: &Bounds<NP>,
    active: &[Option<Side>; NP],
) -> Option<(usize, Side, f64)> {
    let mut first = None;
    let mut shortest = 1.0;
    for row in (0..NP).filter(|row| active[*row].is_none()) {
        let (side, bound) = if to[row] < bounds.lo[row] {
            (Side::Lo, bounds.lo[row])
        } else if to[row] > bounds.hi[row] {
            (Side::Hi, bounds.hi[row])
        } else {
            continue;
        };
        let fraction = (bound - from[row]) / (to[row] - from[row]);
        if first.is_none() || fraction < shortest {
            shortest = fraction;
            first = Some((row, side, fraction));
        }
    }
    first
}

/// The row of the active bound with the most negative multiplier, if that is below `-multiplier_min`. The multiplier is
/// the derivative of the quadratic in the direction into the box. 1 / unit of the row
fn bound_to_release<const NP: usize>(
    gradient: &Vector<NP>,
    active: &[Option<Side>; NP],
    multiplier_min: f64,
) -> Option<usize> {
    let mut worst = None;
    let mut least = -multiplier_min;
    for (row, side) in active.iter().enumerate() {
        let multiplier = match side {
            None => continue,
            Some(Side::Lo) => gradient[row],
            Some(Side::Hi) => -gradient[row],
        };
        if multiplier < least {
            least = multiplier;
            worst = Some(row);
        }
    }
    worst
}

#[cfg(test)]
mod tests {
    use horizon_model::check::{amax, maximum};
    use horizon_model::{Matrix, Vector};
    use proptest::prelude::*;

    use super::*;

    /// Largest violation of the optimality conditions of the box problem, gradient scaled to 1.
    fn optimality_gap(
        reduced: &ReducedSystem<3>,
        damping: f64,
        (p, p_next): (&Vector<3>, &Vector<3>),
        b: &Bounds<3>,
    ) -> f64 {
        let step = p_next - p;
        let gradient = reduced.hessian * step + step * damping + reduced.gradient;
        let mut worst = 0.0_f64;
        for row in 0..3 {
            let at = |bound: f64| (p_next[row] - bound).to_bits() << 1 == 0;
            let gap = match (at(b.lo[row]), at(b.hi[row])) {
                (true, true) => 0.0,
                (true, false) => maximum(-gradient[row], 0.0),
                (false, true) => maximum(gradient[row], 0.0),
                (false, false) => gradient[row].abs(),
            };
            worst = maximum(worst, gap);
        }
        worst / maximum(amax(&reduced.gradient), 1.0)
    }

    proptest! {
        #[test]
        fn the_minimum_satisfies_the_optimality_conditions(
            root in prop::array::uniform9(-2.0..2.0),
            gradient in prop::array::uniform3(-5.0..5.0),
            lo in prop::array::uniform3(-1.0..0.0),
            hi in prop::array::uniform3(0.0..1.0),
            start in prop::array::uniform3(0.0..=1.0),
        ) {
            let root = Matrix::<3, 3>::from_column_slice(&root);
            let reduced = ReducedSystem { hessian: root * root.transpose(), gradient: gradient.into(), decrease: 0.0 };
            let bounds = Bounds { lo: lo.into(), hi: hi.into() };
            let p = bounds.lo + (bounds.hi - bounds.lo).component_mul(&Vector::from(start));
            let (p_next, decrease) = reduced.solve(1e-3, &p, &bounds).unwrap();
            for row in 0..3 {
                prop_assert!((bounds.lo[row]..=bounds.hi[row]).contains(&p_next[row]), "{p_next}");
            }
            // The damping bounds the condition number by about 1e4.
            let gap = optimality_gap(&reduced, 1e-3, (&p, &p_next), &bounds);
            prop_assert!(gap < 1e-9, "gap {gap:e}");
            prop_assert!(decrease >= 0.0, "{decrease}");
        }
    }

    #[test]
    fn a_fixed_row_never_moves() {
        let reduced = ReducedSystem {
            hessian: Matrix::<2, 2>::new(2.0, 1.0, 1.0, 2.0),
            gradient: Vector::from([-3.0, 4.0]),
            decrease: 0.0,
        };
        let p = Vector::from([0.3, 0.1]);
        let bounds = Bounds { lo: Vector::from([0.3, -10.0]), hi: Vector::from([0.3, 10.0]) };
        let (p_next, _) = reduced.solve(0.0, &p, &bounds).unwrap();
        assert_eq!(p_next.x.to_bits(), 0.3_f64.to_bits());
        assert!((p_next.y - (0.1 - 2.0)).abs() < 1e-15, "{p_next}");
    }
}
