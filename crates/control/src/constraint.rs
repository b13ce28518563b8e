//! Soft constraints on the states of a plan, beside the box of the inputs.
//!
//! Owns what a constraint has to tell, and bounds of single rows. What else is constrained, a wall or a distance, is
//! not known here.

use horizon_model::Vector;
use horizon_model::setting::{SettingError, positive};

/// A constraint `c(s) <= 0` at one state, and its weight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Excess<const NS: usize> {
    /// `c(s)`: positive where the constraint is violated. Unit of the constraint
    pub value: f64,
    /// Derivative of `c` by `s`. Unit of `c` / unit of the row
    pub gradient: Vector<NS>,
    /// Weight of the violation in one step, which is not squared. 1/unit, >= 0; its square is finite
    pub weight: f64,
}

/// Constraints `c_i(s_k) <= 0` on the states after each stage, with the penalty `1/2 |w_i max(0, c_i(s_k))|^2` for
/// each step.
///
/// The constraints may be nonlinear and change over the horizon. Functions are pure and do not allocate. The
/// derivative is exact where `c` is smooth; the curvature of `c` is left out (Gauss-Newton).
///
/// ```
/// use horizon_control::{MpcProblem, Excess, Mpc, MpcSettings, SoftConstraints};
/// use horizon_model::Kinematic;
/// use horizon_model::rows::pose;
/// use nalgebra::SVector;
///
/// /// Not beyond x = 0.05 m.
/// struct Wall;
///
/// impl SoftConstraints<4> for Wall {
///     fn count(&self) -> usize {
///         1
///     }
///     fn excess(&self, _i: usize, s: &SVector<f64, 4>, _ahead_s: f64) -> Option<Excess<4>> {
///         let mut gradient = SVector::zeros();
///         gradient[pose::X] = 1.0;
///         Some(Excess { value: s[pose::X] - 0.05, gradient, weight: 100.0 })
///     }
/// }
///
/// let settings = MpcSettings::builder(30).build(&Kinematic)?.with_constraints(1);
/// let mut mpc = Mpc::<_, 4, 4, 4, 4, 4>::new(Kinematic, settings, 0.02)?;
/// let (s, p, u) = (SVector::zeros(), SVector::from([1.3, 0.45, 1.0, 0.0]), SVector::zeros());
/// let s_ref = [SVector::from([0.3, 0.0, 0.0, 0.0]); 30];
/// let report = mpc.solve_with(&MpcProblem::new(&s, &p, &u, &s_ref), Some(&Wall), &mut || false)?;
/// assert!(report.has_new_plan());
/// assert!(mpc.planned_states().iter().all(|s| s[pose::X] < 0.051));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait SoftConstraints<const NS: usize> {
    /// Number of constraints, at most that of [`MpcSettings::with_constraints`](crate::MpcSettings::with_constraints).
    fn count(&self) -> usize;

    /// Constraint `i` at the state `s`, `ahead_s` after the beginning of the plan; `None` far inside of what is
    /// allowed, where no step of a solve can violate it.
    fn excess(&self, i: usize, s: &Vector<NS>, ahead_s: f64) -> Option<Excess<NS>>;
}

/// Bounds `lo <= s <= hi` on the rows of the state as soft constraints; an infinite bound is none.
///
/// Constraint `i` is the upper bound of row `i`, constraint `NS + i` the lower bound of row `i`: these are `2 NS` for
/// [`MpcSettings::with_constraints`](crate::MpcSettings::with_constraints), infinite ones included.
///
/// ```
/// use horizon_control::{SoftConstraints, StateBounds};
/// use nalgebra::SVector;
///
/// let (lo, hi) = ([f64::NEG_INFINITY, -0.5].into(), [f64::INFINITY, 0.5].into());
/// let bounds = StateBounds::new(lo, hi, [1.0, 100.0].into())?;
/// let found = bounds.excess(1, &SVector::from([7.0, 0.75]), 0.0);
/// assert_eq!(found.map(|excess| excess.value), Some(0.25));
/// assert_eq!(bounds.excess(0, &SVector::from([7.0, 0.75]), 0.0), None);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StateBounds<const NS: usize> {
    lo: Vector<NS>,
    hi: Vector<NS>,
    weight: Vector<NS>,
}

impl<const NS: usize> StateBounds<NS> {
    /// Lower and upper bounds, in the units of the rows, and the weights of [`Excess::weight`], in 1 / unit.
    ///
    /// # Errors
    /// A bound is NaN, an upper one lies below its lower one, or a weight is not finite and positive.
    pub fn new(lo: Vector<NS>, hi: Vector<NS>, weight: Vector<NS>) -> Result<Self, SettingError> {
        for row in 0..NS {
            // So is a range to or from a NaN.
            if (lo[row]..=hi[row]).is_empty() {
                let rule = format!("at least the lower bound, {}", lo[row]);
                return Err(SettingError::new(format!("hi[{row}]"), hi[row], rule));
            }
            positive(&format!("weight[{row}]"), weight[row])?;
        }
        Ok(Self { lo, hi, weight })
    }
}

impl<const NS: usize> SoftConstraints<NS> for StateBounds<NS> {
    fn count(&self) -> usize {
        2 * NS
    }

    fn excess(&self, i: usize, s: &Vector<NS>, _ahead_s: f64) -> Option<Excess<NS>> {
        let row = i % NS;
        let (sign, bound) = if i < NS { (1.0, self.hi[row]) } else { (-1.0, self.lo[row]) };
        let mut gradient = Vector::zeros();
        gradient[row] = sign;
        let value = sign * (s[row] - bound);
        bound.is_finite().then_some(Excess { value, gradient, weight: self.weight[row] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use horizon_model::Vector;
    use horizon_model::check::jacobian_gap;

    const BOUNDS: StateBounds<2> = StateBounds {
        lo: Vector::<2>::new(-0.5, f64::NEG_INFINITY),
        hi: Vector::<2>::new(0.25, 2.0),
        weight: Vector::<2>::new(10.0, 3.0),
    };

    #[test]
    fn a_bound_is_violated_beyond_it_and_nowhere_else() {
        for (s, violated) in [
            ([0.0, 0.0], [false; 3]),
            ([0.5, 0.0], [true, false, false]),
            ([-0.75, 0.0], [false, false, true]),
            ([0.0, 3.0], [false, true, false]),
        ] {
            let found = [0, 1, 2].map(|i| BOUNDS.excess(i, &s.into(), 0.0).unwrap().value > 0.0);
            assert_eq!(found, violated, "{s:?}");
        }
        assert_eq!(BOUNDS.excess(3, &Vector::from([0.0, -9.0]), 0.0), None);
        assert_eq!(BOUNDS.count(), 4);
    }

    #[test]
    fn bounds_that_would_bind_nothing_are_refused() {
        let bounds = |lo: f64, hi: f64, weight: f64| {
            let of = |it: f64| Vector::from([0.0, it]);
            let built = StateBounds::new(of(lo), of(hi), Vector::from([1.0, weight]));
            built.map_err(|error| error.to_string())
        };
        assert!(bounds(f64::NEG_INFINITY, 1.0, 2.0).is_ok() && bounds(1.0, 1.0, 2.0).is_ok());
        for (lo, hi) in [(0.0, f64::NAN), (f64::NAN, 0.0), (2.0, 1.0)] {
            let error = bounds(lo, hi, 1.0).unwrap_err();
            assert!(error.starts_with(&format!("hi[1] = {hi}")), "{error}");
        }
        for weight in [0.0, -100.0, f64::NAN, f64::INFINITY] {
            let error = bounds(0.0, 1.0, weight).unwrap_err();
            assert!(error.starts_with(&format!("weight[1] = {weight}")), "{error}");
        }
    }

    #[test]
    fn the_gradient_meets_its_numeric_twin() {
        let s = Vector::from([0.5, -1.0]);
        for (i, row) in [(0, 0), (1, 1), (2, 0)] {
            let excess = BOUNDS.excess(i, &s, 0.0).unwrap();
            let value = |s: &Vector<2>| Vector::from([BOUNDS.excess(i, s, 0.0).unwrap().value]);
            let gap = jacobian_gap(value, &s, &excess.gradient.transpose());
            assert!(gap < 1e-8, "gap {gap:e} of constraint {i}");
            assert_eq!(excess.weight.to_bits(), BOUNDS.weight[row].to_bits());
        }
    }
}
