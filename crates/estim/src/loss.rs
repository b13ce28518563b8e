//! Robust losses: how much a residual block costs.
//!
//! Owns the loss functions and the weight that a loss gives a block in a second-order solver. A block
//! is whitened before it comes here: `z` is the squared norm of its weighted residual.

use horizon_model::Vector;
use horizon_model::setting::{SettingError, positive};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Loss of a kind of residual block, as written in a file.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum LossTable {
    /// Plain least squares.
    None {},
    /// Quadratic near zero, linear far out. Outliers keep a bounded pull.
    Huber {
        /// Norm of the weighted residual at which it becomes linear. 1, > 0
        scale: f64,
    },
    /// Quadratic near zero, constant far out. Outliers lose all pull.
    Tukey {
        /// Norm of the weighted residual from which it is constant. 1, > 0
        scale: f64,
    },
}

impl LossTable {
    /// The loss, if its scale is valid. `key` is its name in messages.
    ///
    /// # Errors
    /// The scale is not finite and positive.
    pub fn check(&self, key: &str) -> Result<Loss, SettingError> {
        let scale = |scale| positive("scale", scale).map_err(|error| error.under(key));
        Ok(match *self {
            Self::None {} => Loss::None,
            Self::Huber { scale: a } => Loss::Huber { scale: scale(a)? },
            Self::Tukey { scale: a } => Loss::Tukey { scale: scale(a)? },
        })
    }
}

/// A loss `rho(z)`; the cost of a block is `rho(z) / 2`. Scales are positive.
///
/// With `a` the scale and `x = z / a^2`, `rho(z) = a^2 rho_1(x)`:
///
/// | loss  | `x <= 1`              | `x > 1`           |
/// |-------|-----------------------|-------------------|
/// | none  | `x`                   | `x`               |
/// | Huber | `x`                   | `2 sqrt(x) - 1`   |
/// | Tukey | `(1 - (1 - x)^3) / 3` | `1 / 3`           |
///
/// Same as in Ceres 2, so that costs are comparable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loss {
    /// `rho(z) = z`.
    None,
    /// Huber's loss.
    Huber {
        /// Norm of a weighted block above which the loss is linear. 1, > 0
        scale: f64,
    },
    /// Tukey's biweight.
    Tukey {
        /// Norm of a weighted block above which the loss is constant. 1, > 0
        scale: f64,
    },
}

/// Value and derivatives of a loss at one `z`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rho {
    /// `rho(z)`. 1
    pub(crate) value: f64,
    /// `rho'(z)`. 1, >= 0
    pub(crate) derivative: f64,
    /// `rho''(z)`. 1, <= 0
    pub(crate) curvature: f64,
}

impl Loss {
    /// The loss at the squared norm `z >= 0` of a weighted block. 1
    ///
    /// Real time: no allocation, at most one square root.
    #[inline]
    pub(crate) fn at(&self, z: f64) -> Rho {
        match *self {
            Self::Huber { scale } if z > scale * scale => {
                let norm = z.sqrt();
                let derivative = scale / norm;
                let value = scale * (2.0 * norm - scale);
                Rho { value, derivative, curvature: -0.5 * derivative / z }
            }
            Self::None | Self::Huber { .. } => Rho { value: z, derivative: 1.0, curvature: 0.0 },
            Self::Tukey { scale } => {
                let square = scale * scale;
                // f64::max would turn a NaN into a harmless outlier.
                let rest = if z > square { 0.0 } else { 1.0 - z / square };
                Rho {
                    value: square / 3.0 * (1.0 - rest * rest * rest),
                    derivative: rest * rest,
                    curvature: -2.0 / square * rest,
                }
            }
        }
    }

    /// The weight of the block with the whitened residual `r`, and the block's cost `rho / 2`.
    #[inline]
    pub(crate) fn weigh<const N: usize>(&self, r: &Vector<N>) -> (Weight, f64) {
        let z = r.norm_squared();
        let rho = self.at(z);
        // Beyond its inflection Tukey's loss is concave along r: there the weight is cut to
        // semidefinite.
        let along = (2.0 * rho.curvature).max(-rho.derivative / z.max(f64::MIN_POSITIVE));
        (Weight { derivative: rho.derivative, along }, 0.5 * rho.value)
    }
}

/// Second derivative of `rho(|r|^2) / 2` by `r`, made positive semidefinite: `W = rho' I + 2 rho'' r r'`, with
/// `2 rho''` at least `-rho' / z`. The first derivative is `rho' r`.
///
/// Plain reweighting (`W = rho' I`) ignores that a Huber block in its linear part has no curvature
/// along `r`; it then needs dozens of iterations where this weight needs a few.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Weight {
    /// `rho'`. 1, >= 0
    pub(crate) derivative: f64,
    /// `2 rho''`, cut at `-rho' / z`. 1, <= 0
    pub(crate) along: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use horizon_model::check::jacobian_gap;
    use horizon_model::{Matrix, Vector};

    const LOSSES: [Loss; 4] = [
        Loss::None,
        Loss::Huber { scale: 1.0 },
        Loss::Huber { scale: 0.3 },
        Loss::Tukey { scale: 2.0 },
    ];

    #[test]
    fn every_derivative_meets_its_numeric_twin() {
        for loss in LOSSES {
            // None of these lies within a difference's width of a nonsmooth point.
            for z in [1e-3, 0.05, 0.5, 0.97, 1.04, 3.9, 4.1, 100.0] {
                let at = |z: f64| loss.at(z);
                let x = Vector::from([z]);
                let value = |x: &Vector<1>| Vector::from([at(x.x).value]);
                let derivative = |x: &Vector<1>| Vector::from([at(x.x).derivative]);
                let gap = jacobian_gap(value, &x, &Matrix::from([[at(z).derivative]]));
                assert!(gap < 1e-8, "{loss:?}: derivative gap {gap:e} at {z}");
                let gap = jacobian_gap(derivative, &x, &Matrix::from([[at(z).curvature]]));
                assert!(gap < 1e-6, "{loss:?}: curvature gap {gap:e} at {z}");
            }
        }
    }

    #[test]
    fn a_weight_is_the_second_derivative_of_the_cost() {
        for (loss, is_convex) in [
            (Loss::None, true),
            (Loss::Huber { scale: 1.0 }, true),
            (Loss::Huber { scale: 9.0 }, true),
            (Loss::Tukey { scale: 9.0 }, true),
            (Loss::Tukey { scale: 4.0 }, false),
        ] {
            let r = Vector::from([1.0, -2.0, 0.5]);
            let gradient = |r: &Vector<3>| r * loss.weigh(r).0.derivative;
            let (Weight { derivative, along }, _) = loss.weigh(&r);
            let weight = Matrix::identity() * derivative + r * r.transpose() * along;
            let gap = jacobian_gap(gradient, &r, &weight);
            assert_eq!(gap < 1e-7, is_convex, "{loss:?}: gap {gap:e}");
            // Convex or cut: never a direction of negative curvature.
            let lowest = weight.symmetric_eigenvalues().min();
            assert!(lowest > -1e-14, "{loss:?}: eigenvalue {lowest:e}");
        }
    }

    #[test]
    fn losses_join_without_a_step() {
        for (loss, z) in [(Loss::Huber { scale: 1.5 }, 2.25), (Loss::Tukey { scale: 1.5 }, 2.25)] {
            let (left, right) = (loss.at(z), loss.at(z * (1.0 + 1e-15)));
            assert!((left.value - right.value).abs() < 1e-12, "{left:?} {right:?}");
            assert!((left.derivative - right.derivative).abs() < 1e-12, "{left:?} {right:?}");
        }
        // The convention of the reference solutions.
        assert!((Loss::Huber { scale: 1.0 }.at(9.0).value - 5.0).abs() < 1e-15);
    }

    #[test]
    fn nan_stays_visible() {
        for loss in LOSSES {
            assert!(loss.at(f64::NAN).value.is_nan(), "{loss:?}");
        }
    }

    #[test]
    fn a_scale_must_be_positive_and_a_key_known() {
        let error = LossTable::Huber { scale: 0.0 }.check("observation_loss").unwrap_err();
        assert_eq!(error.to_string(), "observation_loss.scale = 0: expected finite and > 0");
        let parse = serde_json::from_str::<LossTable>;
        assert_eq!(
            parse(r#"{"kind": "tukey", "scale": 2.0}"#).unwrap(),
            LossTable::Tukey { scale: 2.0 }
        );
        assert!(parse(r#"{"kind": "none"}"#).is_ok());
        assert!(parse(r#"{"kind": "none", "scale": 1.0}"#).is_err());
        assert!(parse(r#"{"kind": "huber"}"#).is_err());
    }
}
