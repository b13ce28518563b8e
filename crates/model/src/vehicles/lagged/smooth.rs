//! Kinks of the vehicle with their corners rounded, and their derivatives.
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
/// `dead` >= 0 is the largest stick without effect, `width` > 0 that of the rounded corner, both as sticks. 1. The
/// gap is largest at the corner and below `width / 2`.
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

/// Part of what the dead zone takes below which a step is the last: the next one is about its square.
const SETTLED: f64 = 1e-9;

/// The stick of which [`excess`] leaves `value`. 1
///
/// With `g` its absolute value and `t` what the dead zone takes of the stick (`docs/model.md`, section 1),
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

/// Factor of a vector that limits its norm, to 0.02 % at the usual width, and its derivative.
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
