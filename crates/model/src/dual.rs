//! Exact derivatives by forward-mode automatic differentiation, with the dual numbers of `num-dual`.

use nalgebra::{SMatrix, SVector};
use num_dual::{DualNum, DualSVec64};

use crate::least_squares;
use crate::model::Model;
use crate::row::Row;
use crate::subsystem::VisitSubsystems;

/// A number that a [`DualModel`] computes with: `f64`, or a dual number that carries derivatives.
///
/// It has `+ - * /` with itself and with `f64`, and `sin`, `cos`, `exp`, `sqrt`, `powi`, ... as methods
/// ([`DualNum`]). Constants: `Self::from(9.81)`.
pub trait Scalar: DualNum<Primitive = f64> + Copy {}

impl<T: DualNum<Primitive = f64> + Copy> Scalar for T {}

/// A [`Model`] written once in the type of the scalar; [`Dual`] makes a [`Model`] of it.
///
/// Shapes, units and constants as in [`Model`].
pub trait DualModel<const NS: usize, const NU: usize, const NO: usize, const NP: usize>:
    Copy
{
    /// [`Model::NAME`].
    const NAME: &'static str = "unnamed";
    /// [`Model::STATE`].
    const STATE: [Row; NS] = [Row::UNNAMED; NS];
    /// [`Model::INPUT`].
    const INPUT: [Row; NU] = [Row::UNNAMED; NU];
    /// [`Model::OBSERVATION`].
    const OBSERVATION: [Row; NO] = [Row::UNNAMED; NO];
    /// [`Model::PARAMETER`].
    const PARAMETER: [Row; NP] = [Row::UNNAMED; NP];
    /// [`Model::CONTROLLABLE`].
    const CONTROLLABLE: usize = NS;

    /// [`Model::subsystems`].
    fn subsystems(_visit: &mut impl VisitSubsystems) {}

    /// [`Model::at_rest`]; with `None` that function's default.
    fn at_rest(&self, _o: &SVector<f64, NO>) -> Option<SVector<f64, NS>> {
        None
    }

    /// [`Model::step`].
    fn step<D: Scalar>(
        &self,
        s: &SVector<D, NS>,
        u: &SVector<D, NU>,
        p: &SVector<D, NP>,
        dt_s: f64,
    ) -> SVector<D, NS>;

    /// [`Model::observe`].
    fn observe<D: Scalar>(&self, s: &SVector<D, NS>) -> SVector<D, NO>;
}

/// A [`DualModel`] as [`Model`]: its Jacobians are exact to rounding.
///
/// Cost of a Jacobian of `N` columns: about one step with numbers of `N + 1` parts, without allocation.
///
/// ```
/// use horizon_model::{Dual, DualModel, Model, Scalar};
/// use nalgebra::SVector;
///
/// /// `s' = s + dt p sin(u)`.
/// #[derive(Clone, Copy)]
/// struct Turn;
///
/// impl DualModel<1, 1, 1, 1> for Turn {
///     fn step<D: Scalar>(
///         &self,
///         s: &SVector<D, 1>,
///         u: &SVector<D, 1>,
///         p: &SVector<D, 1>,
///         dt_s: f64,
///     ) -> SVector<D, 1> {
///         SVector::from([s[0] + p[0] * u[0].sin() * dt_s])
///     }
///
///     fn observe<D: Scalar>(&self, s: &SVector<D, 1>) -> SVector<D, 1> {
///         *s
///     }
/// }
///
/// let (s, u, p) = ([0.0].into(), [0.3].into(), [2.0].into());
/// let by_input = Dual(Turn).step_by_input(&s, &u, &p, 0.1);
/// assert!((by_input[0] - 0.2 * f64::cos(0.3)).abs() < 1e-15);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Dual<M>(pub M);

/// `x` as the variables of a derivative.
#[inline]
fn variables<const N: usize>(x: &SVector<f64, N>) -> SVector<DualSVec64<N>, N> {
    SVector::from_fn(|row, _| DualSVec64::from_re(x[row]).derivative(row))
}

/// `x` as constants of a derivative by `N` variables.
#[inline]
fn constants<const N: usize, const K: usize>(x: &SVector<f64, K>) -> SVector<DualSVec64<N>, K> {
    x.map(DualSVec64::from_re)
}

/// The derivatives that the rows of `y` carry.
#[inline]
fn jacobian<const M: usize, const N: usize>(y: &SVector<DualSVec64<N>, M>) -> SMatrix<f64, M, N> {
    SMatrix::from_fn(|row, col| y[row].eps.0.as_ref().map_or(0.0, |eps| eps[col]))
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> Model<NS, NU, NO, NP>
    for Dual<M>
where
    M: DualModel<NS, NU, NO, NP>,
{
    const NAME: &'static str = M::NAME;
    const STATE: [Row; NS] = M::STATE;
    const INPUT: [Row; NU] = M::INPUT;
    const OBSERVATION: [Row; NO] = M::OBSERVATION;
    const PARAMETER: [Row; NP] = M::PARAMETER;
    const CONTROLLABLE: usize = M::CONTROLLABLE;

    fn subsystems(visit: &mut impl VisitSubsystems) {
        M::subsystems(visit);
    }

    fn at_rest(&self, o: &SVector<f64, NO>) -> SVector<f64, NS> {
        let default =
            || least_squares::least_squares(|s| self.observe(s), |s| self.observe_by_state(s), o);
        self.0.at_rest(o).unwrap_or_else(default)
    }

    #[inline]
    fn step(
        &self,
        s: &SVector<f64, NS>,
        u: &SVector<f64, NU>,
        p: &SVector<f64, NP>,
        dt_s: f64,
    ) -> SVector<f64, NS> {
        self.0.step(s, u, p, dt_s)
    }

    #[inline]
    fn step_by_state(
        &self,
        s: &SVector<f64, NS>,
        u: &SVector<f64, NU>,
        p: &SVector<f64, NP>,
        dt_s: f64,
    ) -> SMatrix<f64, NS, NS> {
        jacobian(&self.0.step(&variables(s), &constants(u), &constants(p), dt_s))
    }

    #[inline]
    fn step_by_input(
        &self,
        s: &SVector<f64, NS>,
        u: &SVector<f64, NU>,
        p: &SVector<f64, NP>,
        dt_s: f64,
    ) -> SMatrix<f64, NS, NU> {
        jacobian(&self.0.step(&constants(s), &variables(u), &constants(p), dt_s))
    }

    #[inline]
    fn step_by_parameter(
        &self,
        s: &SVector<f64, NS>,
        u: &SVector<f64, NU>,
        p: &SVector<f64, NP>,
        dt_s: f64,
    ) -> SMatrix<f64, NS, NP> {
        jacobian(&self.0.step(&constants(s), &constants(u), &variables(p), dt_s))
    }

    #[inline]
    fn observe(&self, s: &SVector<f64, NS>) -> SVector<f64, NO> {
        self.0.observe(s)
    }

    #[inline]
    fn observe_by_state(&self, s: &SVector<f64, NS>) -> SMatrix<f64, NO, NS> {
        jacobian(&self.0.observe(&variables(s)))
    }
}
