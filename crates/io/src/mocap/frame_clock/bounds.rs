//! Bounds of the time per frame number, by all measurements so far.

use super::SKEW_USUAL;

/// Largest difference between a rate and its nominal value, such as 59.94 Hz that is called 60, or 240 Hz
/// with 241 in the settings. 1
pub(super) const DEVIATION_MAX: f64 = 5e-3;

/// Largest correction in flight: beyond [`DEVIATION_MAX`], since the ground measures in two seconds with jitter. 1
const CORRECTION_MAX: f64 = 8e-3;

/// Error of a measured rate by the jitter of two arrivals, times the span between them. ns
pub(super) const JITTER_NS: f64 = 10e6;

/// An interval of times per number. Only ever becomes narrower. ns
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bounds {
    min_ns: f64,
    max_ns: f64,
}

impl Bounds {
    /// Bounds around an announced period.
    pub(super) fn around(nominal_ns: f64) -> Self {
        let deviation_ns = nominal_ns * CORRECTION_MAX;
        Self { min_ns: nominal_ns - deviation_ns, max_ns: nominal_ns + deviation_ns }
    }

    /// Takes in a period that was measured over a span, unless it contradicts all before it.
    pub(super) fn narrow(&mut self, measured_ns: f64, span_ns: f64) {
        let error_ns = measured_ns * (JITTER_NS / span_ns + SKEW_USUAL);
        let min_ns = self.min_ns.max(measured_ns - error_ns);
        let max_ns = self.max_ns.min(measured_ns + error_ns);
        if min_ns <= max_ns {
            (self.min_ns, self.max_ns) = (min_ns, max_ns);
        }
    }

    pub(super) fn contain(&self, period_ns: f64) -> bool {
        (self.min_ns..=self.max_ns).contains(&period_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_announced_period_leaves_eight_thousandths_open() {
        let bounds = Bounds::around(1e6);
        for (period_ns, is_inside) in [
            (1e6, true),
            (1.008e6, true),
            (1.008e6_f64.next_up(), false),
            (0.992e6, true),
            (0.992e6_f64.next_down(), false),
            (f64::NAN, false),
        ] {
            assert_eq!(bounds.contain(period_ns), is_inside, "{period_ns} ns");
        }
    }

    #[test]
    fn a_measured_period_narrows_by_its_span_and_never_widens() {
        let mut bounds = Bounds::around(1e6);
        // Over 10 s: 1e-3 by jitter, 5e-6 by drift.
        bounds.narrow(1.002e6, 10e9);
        let error_ns = 1.002e6 * 1.005e-3;
        let inside = [1.002e6 - error_ns + 1.0, 1.002e6 + error_ns - 1.0];
        let outside = [1.002e6 - error_ns - 1.0, 1.002e6 + error_ns + 1.0];
        assert!(inside.iter().all(|period_ns| bounds.contain(*period_ns)), "{bounds:?}");
        assert!(!outside.iter().any(|period_ns| bounds.contain(*period_ns)), "{bounds:?}");
        let before = bounds;
        bounds.narrow(1.002e6, 1e8);
        assert_eq!(bounds, before, "a short span");
        for contradiction_ns in [1.1e6, 0.9e6, -1e6, f64::NAN] {
            bounds.narrow(contradiction_ns, 10e9);
            assert_eq!(bounds, before, "{contradiction_ns} ns");
        }
    }
}
