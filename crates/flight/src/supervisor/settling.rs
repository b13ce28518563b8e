//! The hover after a take-off, before control starts.
//!
//! Owns when it ends: the firmware holds the vehicle meanwhile, unless a draught or a floor without texture carries it
//! away.

use horizon_model::rows::{Pose, pose};

use super::evidence::Evidence;
use super::since::elapsed_s;

/// Horizontal distance from the place of the take-off at which control starts at once. m
const DRIFT_MAX_M: f64 = 0.3;

/// What is known of the take-off.
#[derive(Debug, Clone, Default)]
pub(super) struct Settling {
    /// Where the vehicle stood, world frame. m, rad
    stood: Option<Pose>,
    /// When the take-off was confirmed; `None` if the flight began in the air. ns
    risen_ns: Option<i64>,
    has_drifted: bool,
}

impl Settling {
    /// The take-off begins at `stood`.
    pub(super) fn stand(&mut self, stood: Option<Pose>) {
        self.stood = stood;
    }

    /// The take-off is confirmed.
    pub(super) fn rise(&mut self, t_ns: i64) {
        self.risen_ns = Some(t_ns);
    }

    /// Whether `settle_s` have passed since, or the vehicle has drifted away.
    ///
    /// Real time: no allocation, constant cost.
    pub(super) fn is_over(&mut self, e: &Evidence, settle_s: f64) -> bool {
        let drift_m = self.stood.zip(e.pose).map_or(0.0, |(stood, now)| {
            (now[pose::X] - stood[pose::X]).hypot(now[pose::Y] - stood[pose::Y])
        });
        self.has_drifted |= drift_m > DRIFT_MAX_M;
        self.has_drifted
            || self.risen_ns.is_none_or(|risen_ns| elapsed_s(risen_ns, e.t_ns) >= settle_s)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::*;
    use super::*;

    /// Tenths of a second from the order to take off to control by a vehicle that the climb carries by `drift_m`.
    fn steered_after(drift_m: f64) -> Option<usize> {
        let mut bench = Bench::taking_off();
        let drifted = Pose::new(drift_m, 0.0, 1.0, 0.0);
        let aloft = Evidence { pose: Some(drifted), ..ALOFT };
        (0..60).find(|_| bench.tick(&aloft).may_steer())
    }

    #[test]
    fn control_starts_after_its_time_or_at_once_when_the_vehicle_drifts() {
        let at_rest = steered_after(0.0).unwrap();
        assert_eq!(steered_after(DRIFT_MAX_M), Some(at_rest), "the limit itself");
        let carried = steered_after(DRIFT_MAX_M.next_up()).unwrap();
        let sooner_s = 0.1 * f64::from(u32::try_from(at_rest - carried).unwrap());
        assert!((sooner_s - TABLE.settle_s).abs() < 1e-9, "{at_rest}, {carried}");
        assert_eq!(steered_after(f64::NAN), None, "no place");
    }

    #[test]
    fn a_drift_is_measured_from_where_the_vehicle_stood() {
        for (x_m, y_m, is_over) in [(1.2, -2.2, false), (1.0, -2.31, true), (0.69, -2.0, true)] {
            let mut settling = Settling::default();
            settling.stand(Some(Pose::new(1.0, -2.0, 0.0, 0.0)));
            settling.rise(0);
            let e = Evidence { pose: Some(Pose::new(x_m, y_m, 1.0, 0.0)), t_ns: 0, ..ALOFT };
            assert_eq!(settling.is_over(&e, 1.0), is_over, "{x_m}, {y_m} m");
        }
    }
}
