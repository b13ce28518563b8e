//! Soft constraints of the quadratic subproblem.
//!
//! Owns the one-sided quadratic penalty `1/2 squared_weight max(0, c + g' ds)^2` of a linearized constraint `c + g' ds
//! <= 0`. It is what a slack variable leaves: `min 1/2 sigma^2` subject to `sigma >= w (c + g' ds)` with the weight
//! `w`.

use horizon_model::Vector;

/// Penalty on the state after a stage: `1/2 squared_weight max(0, excess + gradient' ds_{k+1})^2`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Penalty<const NS: usize> {
    /// The stage `k`.
    pub stage: usize,
    /// `w^2 m_k` of `docs/model.md`: the squared weight of a step times the steps of the stage. 1 / squared unit of
    /// `c`, > 0
    pub squared_weight: f64,
    /// `c`: positive where the constraint is violated. In the unit of the constraint
    pub excess: f64,
    /// `g`. Unit of `c` / unit of the row
    pub gradient: Vector<NS>,
}

impl<const NS: usize> Penalty<NS> {
    /// The linearized constraint at `ds`, in the unit of the constraint.
    #[inline]
    pub fn excess_at(&self, ds: &Vector<NS>) -> f64 {
        self.excess + self.gradient.dot(ds)
    }

    /// The penalty of an excess, which is in the unit of the constraint. 1
    #[inline]
    pub fn cost(&self, excess: f64) -> f64 {
        one_sided(self.squared_weight, excess)
    }

    /// Weight of the violation over the stage, which is not squared. 1 / unit of `c`
    pub(crate) fn weight(&self) -> f64 {
        self.squared_weight.sqrt()
    }

    /// Derivative of the penalty at `ds = 0`. 1 / unit of the row
    #[inline]
    pub(crate) fn gradient_at_zero(&self) -> Vector<NS> {
        self.gradient * (self.squared_weight * if self.excess <= 0.0 { 0.0 } else { self.excess })
    }

    /// What the penalty at `ds` has more than its tangent at `ds = 0`; not negative. 1
    #[inline]
    pub(crate) fn above_tangent(&self, ds: &Vector<NS>) -> f64 {
        let excess = self.excess_at(ds);
        self.cost(excess) - self.cost(self.excess) - self.gradient_at_zero().dot(ds)
    }
}

/// `1/2 squared_weight max(0, excess)^2`; NaN if the excess is.
#[inline]
pub(crate) fn one_sided(squared_weight: f64, excess: f64) -> f64 {
    if excess <= 0.0 { 0.0 } else { 0.5 * squared_weight * excess * excess }
}

/// Indices of the penalties of stage `k`; `penalties` are in the order of their stages.
#[inline]
pub(crate) fn of_stage<const NS: usize>(
    penalties: &[Penalty<NS>],
    k: usize,
) -> std::ops::Range<usize> {
    if penalties.is_empty() {
        return 0..0;
    }
    let begin = penalties.partition_point(|penalty| penalty.stage < k);
    begin..begin + penalties[begin..].partition_point(|penalty| penalty.stage == k)
}

#[cfg(test)]
mod tests {
    use super::*;
    use horizon_model::Vector;
    use horizon_model::check::jacobian_gap;

    fn penalty(excess: f64) -> Penalty<2> {
        Penalty { stage: 0, squared_weight: 4.0, excess, gradient: Vector::from([1.0, -0.5]) }
    }

    #[test]
    fn the_gradient_meets_its_numeric_twin_on_both_sides() {
        for excess in [-0.3, 0.2] {
            let penalty = penalty(excess);
            let cost = |ds: &Vector<2>| Vector::from([penalty.cost(penalty.excess_at(ds))]);
            let exact = penalty.gradient_at_zero().transpose();
            let gap = jacobian_gap(cost, &Vector::zeros(), &exact);
            assert!(gap < 1e-8, "gap {gap:e} with excess {excess}");
        }
    }

    #[test]
    fn the_penalty_lies_above_its_tangent_and_below_its_quadratic() {
        for excess in [-0.3, 0.0, 0.2] {
            let penalty = penalty(excess);
            for ds in [[0.5, 0.1], [-0.5, 0.1], [0.1, 2.0], [-1.0, -1.0]].map(Vector::from) {
                let along = penalty.gradient.dot(&ds);
                let quadratic = 0.5 * penalty.squared_weight * along * along;
                let above = penalty.above_tangent(&ds);
                assert!((-1e-15..=quadratic + 1e-15).contains(&above), "{above} of {quadratic}");
            }
        }
        // Where the constraint stays violated it is the quadratic itself: 1/2 4 (0.5 - 0.05)^2.
        assert!((penalty(0.2).above_tangent(&[0.5, 0.1].into()) - 0.405).abs() < 1e-15);
    }

    #[test]
    fn a_cost_that_is_not_a_number_stays_visible() {
        assert!(one_sided(1.0, f64::NAN).is_nan());
        assert!(penalty(f64::NAN).gradient_at_zero()[0].is_nan());
    }

    #[test]
    fn a_stage_finds_its_penalties_and_no_others() {
        let of = |stage| Penalty { stage, ..penalty(0.0) };
        let penalties = [of(1), of(1), of(4)];
        let found: Vec<_> = (0..6).map(|k| of_stage(&penalties, k)).collect();
        assert_eq!(found, [0..0, 0..2, 2..2, 2..2, 2..3, 3..3]);
        assert_eq!(of_stage::<2>(&[], 3), 0..0);
    }
}
