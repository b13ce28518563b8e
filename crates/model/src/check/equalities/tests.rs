use crate::Vector;
use crate::check::model_gap;

use super::*;

/// An integrator with a quadratic input nonlinearity and a switch for what is wrong.
#[derive(Debug, Clone, Copy)]
struct Valve {
    wrong: &'static str,
    gain: f64,
    has_passed: bool,
}

impl Valve {
    fn new(wrong: &'static str) -> Self {
        Self { wrong, gain: 1.0, has_passed: false }
    }

    fn if_wrong(&self, function: &str, wrong: f64) -> f64 {
        if self.wrong == function { wrong } else { 1.0 }
    }
}

impl Model<1, 1, 1, 1> for Valve {
    fn step(&self, s: &Vector<1>, u: &Vector<1>, p: &Vector<1>, dt_s: f64) -> Vector<1> {
        let effect = if self.has_passed { u[0] } else { u[0] * u[0] };
        Vector::from([s[0] + dt_s * self.gain * p[0] * effect])
    }

    fn observe(&self, s: &Vector<1>) -> Vector<1> {
        s * 2.0
    }

    fn at_rest(&self, o: &Vector<1>) -> Vector<1> {
        o * (0.5 * self.if_wrong("at_rest", 3.0))
    }

    fn core(&self) -> Self {
        Self { has_passed: true, ..*self }
    }

    fn prepared(&self, _p: &Vector<1>, _dt_s: f64) -> Self {
        Self { gain: self.if_wrong("prepared", -1.0), ..*self }
    }

    fn effect(&self, u: &Vector<1>, _p: &Vector<1>) -> Vector<1> {
        u * (u[0] * self.if_wrong("core", 2.0))
    }

    fn input_for(&self, effect: &Vector<1>, _p: &Vector<1>) -> Vector<1> {
        effect.map(f64::sqrt)
            * (self.if_wrong("input_for", 2.0) / self.if_wrong("core", 2.0).sqrt())
    }
}

#[test]
fn a_function_that_does_not_agree_with_the_model_is_named() {
    // The negative input has the effect of the positive one.
    for u in [0.4, -0.4] {
        let at = Point { s: [0.7].into(), u: [u].into(), p: [3.0].into(), dt_s: 0.1 };
        let right = model_gap(&Valve::new(""), &at);
        assert!(right.gap < 1e-8, "{right}");
        for name in NAMES {
            let gap = model_gap(&Valve::new(name), &at);
            assert!(gap.derivative == name && gap.gap > 0.05, "{name}: {gap}");
            assert!(gap.to_string().contains(", expected "), "{gap}");
        }
    }
}

/// A prepared model that is right for its period alone.
#[derive(Debug, Clone, Copy)]
struct OnePeriod(Option<f64>);

impl Model<1, 1, 1, 1> for OnePeriod {
    fn step(&self, s: &Vector<1>, u: &Vector<1>, p: &Vector<1>, dt_s: f64) -> Vector<1> {
        s + u * (self.0.unwrap_or(dt_s) * p[0])
    }

    fn observe(&self, s: &Vector<1>) -> Vector<1> {
        *s
    }

    fn prepared(&self, _p: &Vector<1>, dt_s: f64) -> Self {
        Self(Some(dt_s))
    }
}

#[test]
fn a_prepared_model_is_right_for_another_period_too() {
    let at = Point { s: [0.0].into(), u: [0.4].into(), p: [3.0].into(), dt_s: 0.1 };
    let gap = model_gap(&OnePeriod(None), &at);
    assert!(gap.derivative == "prepared" && gap.gap > 0.1, "{gap}");
}
