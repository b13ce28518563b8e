//! Sums that forget: exponentially, or by a leak.

/// Fraction of a sum or deviation that remains after `dt_s` with the time constant `tau_s`. 1
pub(crate) fn decay(dt_s: f64, tau_s: f64) -> f64 {
    (-dt_s / tau_s).exp()
}

/// Fraction of the time in which a condition does not hold that is subtracted from the time in which it held. 1
pub(crate) const LEAK_RATIO: f64 = 0.2;

/// Leaky sum, which never falls below zero.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct LeakySum(f64);

impl LeakySum {
    /// Adds `amount`.
    pub(crate) fn add(&mut self, amount: f64) {
        self.0 += amount;
    }

    /// Subtracts `amount`, down to zero.
    pub(crate) fn leak(&mut self, amount: f64) {
        self.0 = (self.0 - amount).max(0.0);
    }

    /// Sets a sum above `max` to that.
    pub(crate) fn limit(&mut self, max: f64) {
        self.0 = self.0.min(max);
    }

    /// The sum, in the unit of the amounts.
    pub(crate) fn value(self) -> f64 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_third_is_left_after_the_time_constant() {
        assert!((decay(0.6, 0.6) - (-1.0_f64).exp()).abs() < 1e-12);
        assert!((decay(0.02, 0.6).powi(30) - decay(0.6, 0.6)).abs() < 1e-12);
    }

    #[test]
    fn a_leaky_sum_stays_at_zero() {
        let mut sum = LeakySum::default();
        sum.leak(1.0);
        sum.add(2.0);
        sum.leak(0.5);
        assert!((sum.value() - 1.5).abs() < 1e-12);
    }
}
