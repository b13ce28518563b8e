//! Smooth forms of the dead zone and the acceleration limit, and their derivatives.
//!
//! Owns the dead zone of a stick, the limit of the acceleration and the first-order lag as functions of
//! plain numbers. Which row they belong to is known one file up.

/// Excess of an input over its dead zone, with derivatives.
#[derive(Debug, Clone, Copy)]
pub(super) struct Excess {
    /// `n(u)`: odd in `u`, about zero inside the dead zone. 1
    pub(super) value: f64,
    /// Derivative by the stick. 1
    pub(super) by_stick: f64,
    /// Derivative by `dead`. 1
    pub(super) by_dead: f64,
}

/// `n(u) = u + (sqrt((u - dead)^2 + width^2) - sqrt((u + dead)^2 + width^2)) / 2`, the smooth form of
/// `sign(u) max(|u| - dead, 0)`.
///
/// `dead` >= 0 is the largest stick without effect, `width` > 0 that of the rounded corner (`w` in `docs/model.md`,
/// section 1), both as sticks. 1. The gap is largest at the corner and below `width / 2`.
#[inline]
pub(super) fn excess(u: f64, dead: f64, width: f64) -> Excess {
    let (above, below) = (u - dead, u + dead);
    let (above_norm, below_norm) = (rounded_abs(above, width), rounded_abs(below, width));
    let (above_derivative, below_derivative) = (above / above_norm, below / below_norm);
    Excess {
        value: u + 0.5 * (above_norm - below_norm),
        by_stick: 1.0 + 0.5 * (above_derivative - below_derivative),
        by_dead: -0.5 * (above_derivative + below_derivative),
    }
}

/// Second derivative of [`excess`] by the stick. 1
#[inline]
pub(super) fn excess_second(u: f64, dead: f64, width: f64) -> f64 {
    let second = |x: f64| width * width / rounded_abs(x, width).powi(3);
    0.5 * (second(u - dead) - second(u + dead))
}

/// Newton steps of [`stick_for`]; six reach the last bit.
const STEPS_MAX: u32 = 20;

/// Fraction of what the dead zone takes below which a step is the last: the next one is about its square. 1
const SETTLED: f64 = 1e-9;

/// The stick of which [`excess`] leaves `value`. 1
///
/// With `g` the absolute value of `value` and `t` what the dead zone takes of the stick (`docs/model.md`, section 1,
/// where `d` is `dead` and `w` is `width`),
///
/// `2 g t^3 + (g^2 + width^2) t^2 - 2 g dead^2 t - g^2 dead^2 = 0`,
///
/// convex for `t > 0`. The sharp dead zone and the equation without its cube both take more: Newton's
/// method comes down from the lesser of them without overshoot.
#[inline]
pub(super) fn stick_for(value: f64, dead: f64, width: f64) -> f64 {
    let g = value.abs();
    let (g_dead, g2_width2) = (g * dead, g * g + width * width);
    let without_cube = g_dead * (dead + (dead * dead + g2_width2).sqrt()) / g2_width2;
    let mut t = without_cube.min(dead);
    for _ in 0..STEPS_MAX {
        let gap = ((2.0 * g * t + g2_width2) * t - 2.0 * g_dead * dead) * t - g_dead * g_dead;
        let derivative = (6.0 * g * t + 2.0 * g2_width2) * t - 2.0 * g_dead * dead;
        // Not for a stick at rest, nor where the products of tiny numbers vanish.
        let is_increasing = derivative > 0.0;
        if !is_increasing {
            break;
        }
        let step = gap / derivative;
        t -= step;
        if step <= SETTLED * t {
            break;
        }
    }
    value + t.copysign(value)
}

/// Factor of a vector that limits its norm, to 0.03 % at the usual width, and its derivative.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limit {
    /// `phi(q)`, in (0, 1]. 1
    pub(super) factor: f64,
    /// `phi'`, its derivative by the squared ratio `q`. 1
    pub(super) by_ratio2: f64,
}

/// `(1 + (q - 1 + sqrt((q - 1)^2 + width^2) - (sqrt(1 + width^2) - 1)) / 2)^(-1/2)`, the smooth form of
/// `min(1, 1 / sqrt(q))`.
///
/// `q = ratio2` is the squared norm over the squared limit, >= 0: the norm itself has no derivative at
/// zero. The factor is exactly 1 at zero; the gap is largest at `q = 1` and below `width / 4`.
#[inline]
pub(super) fn limit(ratio2: f64, width: f64) -> Limit {
    let over = ratio2 - 1.0;
    let over_norm = rounded_abs(over, width);
    let at_zero = rounded_abs(1.0, width) - 1.0;
    let factor2 = 1.0 / (1.0 + 0.5 * (over + over_norm - at_zero));
    let factor = factor2.sqrt();
    Limit { factor, by_ratio2: -0.25 * factor * factor2 * (1.0 + over / over_norm) }
}

/// Second derivative of [`limit`] by the squared ratio. 1
#[inline]
pub(super) fn limit_second(ratio2: f64, width: f64) -> f64 {
    let over_norm = rounded_abs(ratio2 - 1.0, width);
    let Limit { factor, by_ratio2 } = limit(ratio2, width);
    // Of one over the squared factor, the second derivative is that of the rounded |q - 1| / 2.
    let second = 0.5 * (width / over_norm).powi(2) / over_norm;
    3.0 * by_ratio2 * by_ratio2 / factor - 0.5 * factor.powi(3) * second
}

/// Fraction of the way to its target that a first-order lag covers in one period, with its derivative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fraction {
    /// `1 - exp(-dt / tau)`. 1
    pub(super) value: f64,
    /// Derivative by `tau`. 1/s
    pub(super) by_tau: f64,
}

/// [`Fraction`] of a lag with time constant `tau_s` > 0.
#[inline]
pub(super) fn fraction(tau_s: f64, dt_s: f64) -> Fraction {
    let keep = (-dt_s / tau_s).exp();
    Fraction { value: 1.0 - keep, by_tau: -dt_s / (tau_s * tau_s) * keep }
}

/// `sqrt(x^2 + width^2)`, the smooth form of `|x|`.
#[inline]
#[expect(
    clippy::imprecise_flops,
    reason = "far from overflow, and hypot is a call that does not inline"
)]
fn rounded_abs(x: f64, width: f64) -> f64 {
    (x * x + width * width).sqrt()
}

#[cfg(test)]
mod tests {
    use crate::{Matrix, Vector};
    use nalgebra::Vector1;

    use super::*;
    use crate::check::{jacobian_gap, maximum};

    /// Widths of [`LaggedShape`](crate::LaggedShape) by default.
    const DEAD_WIDTH: f64 = 0.01;
    const LIMIT_WIDTH: f64 = 0.1;

    #[test]
    fn the_smooth_dead_zone_stays_within_half_its_width() {
        let width = DEAD_WIDTH;
        for dead in [0.0, 0.02, 0.07, 0.12] {
            let gap = |u: f64| {
                let sharp = f64::max(u.abs() - dead, 0.0).copysign(u);
                (excess(u, dead, width).value - sharp).abs()
            };
            let worst = (-1000..=1000).map(|k| gap(f64::from(k) * 1e-3)).fold(0.0, maximum);
            assert!(worst < 0.5 * width, "{worst} at dead zone {dead}");
        }
        assert!(excess(0.0, 0.07, width).value.abs() < f64::EPSILON);
    }

    #[test]
    fn the_smooth_limit_stays_within_a_quarter_of_its_width() {
        let width = LIMIT_WIDTH;
        let mut worst = 0.0_f64;
        let mut acceleration_max = 0.0_f64;
        for k in 0..5000 {
            let ratio = f64::from(k) * 1e-3;
            let smooth = ratio * limit(ratio * ratio, width).factor;
            acceleration_max = maximum(acceleration_max, smooth);
            worst = maximum(worst, (smooth - ratio.min(1.0)).abs());
        }
        assert!(worst < 0.25 * width, "{worst}");
        assert!(acceleration_max < 1.0 + 3e-4, "{acceleration_max}");
        assert!((limit(0.0, width).factor - 1.0).abs() < f64::EPSILON);
    }

    #[test]
    fn every_derivative_meets_its_numeric_twin() {
        // Third derivatives are of order 1 / width^2: 1e4 for the dead zone, of which the difference leaves 6e-8, and
        // of the second one, a difference of first derivatives, 1e-6 of 1 / width = 100.
        for u in [-0.9, -0.3, -0.075, -0.07, -0.01, 0.0, 0.02, 0.07, 0.08, 0.5] {
            let (x, exact) = (Vector::from([u, 0.07]), excess(u, 0.07, DEAD_WIDTH));
            let exact = Matrix::<1, 2>::new(exact.by_stick, exact.by_dead);
            let value = |x: &Vector<2>| Vector1::new(excess(x[0], x[1], DEAD_WIDTH).value);
            let gap = jacobian_gap(value, &x, &exact);
            assert!(gap < 3e-7, "gap {gap:e} at {u}");
            let by_stick = |x: &Vector1<f64>| Vector1::new(excess(x[0], 0.07, DEAD_WIDTH).by_stick);
            let second = Vector1::new(excess_second(u, 0.07, DEAD_WIDTH));
            let gap = jacobian_gap(by_stick, &Vector1::new(u), &second);
            assert!(gap < 1e-6, "gap {gap:e} of the second derivative at {u}");
        }
        for ratio2 in [0.0, 0.3, 0.9, 0.99, 1.0, 1.02, 1.5, 40.0] {
            let x = Vector1::new(ratio2);
            let Limit { by_ratio2, .. } = limit(ratio2, LIMIT_WIDTH);
            let factor = |x: &Vector1<f64>| Vector1::new(limit(x[0], LIMIT_WIDTH).factor);
            let gap = jacobian_gap(factor, &x, &Vector1::new(by_ratio2));
            assert!(gap < 1e-8, "gap {gap:e} at {ratio2}");
            let first = |x: &Vector1<f64>| Vector1::new(limit(x[0], LIMIT_WIDTH).by_ratio2);
            let gap = jacobian_gap(first, &x, &Vector1::new(limit_second(ratio2, LIMIT_WIDTH)));
            assert!(gap < 1e-7, "gap {gap:e} of the second derivative at {ratio2}");
        }
        for tau_s in [0.05, 0.12, 0.64, 3.0] {
            let value = |x: &Vector1<f64>| Vector1::new(fraction(x[0], 0.02).value);
            let by_tau = Vector1::new(fraction(tau_s, 0.02).by_tau);
            let gap = jacobian_gap(value, &Vector1::new(tau_s), &by_tau);
            assert!(gap < 1e-7, "gap {gap:e} at {tau_s} s");
        }
    }

    #[test]
    fn the_dead_zone_is_odd_in_every_bit() {
        for u in [0.0, 0.01, 0.07, 0.3, 1.0] {
            let [there, back] = [u, -u].map(|u| excess(u, 0.07, DEAD_WIDTH));
            assert_eq!(there.value.to_bits(), (-back.value + 0.0).to_bits(), "{u}");
            assert_eq!(there.by_stick.to_bits(), back.by_stick.to_bits(), "{u}");
        }
    }

    #[test]
    fn two_periods_of_a_lag_cover_what_one_of_twice_the_length_covers() {
        let [one, two] = [0.02, 0.04].map(|dt_s| 1.0 - fraction(0.64, dt_s).value);
        assert!((one * one - two).abs() < 1e-15, "{one} twice, {two} at once");
    }

    #[test]
    fn the_stick_for_what_is_not_finite_is_not_finite() {
        for (value, dead) in [(f64::NAN, 0.07), (f64::INFINITY, 0.07), (0.3, f64::NAN)] {
            let stick = stick_for(value, dead, DEAD_WIDTH);
            assert!(!stick.is_finite(), "{stick} for {value} behind {dead}");
        }
    }
}
