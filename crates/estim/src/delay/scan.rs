//! The scan of the dead times from their start to both ends of the range: where the profiles have their minima.

use horizon_model::Model;

use super::search::{COST_TOLERANCE_SCAN, Search, SearchStop};
use crate::ident::Ident;

/// A dead time and the gradient of a group's profile there. s, 1/s
pub(super) type GradientPoint = (f64, f64);

/// Scan of one group in one direction.
struct GroupScan {
    /// In the order of the scan, the start first.
    points: Vec<GradientPoint>,
    /// Cost above that of the start by the trapezoidal rule. 1
    cost: f64,
    /// Least of these costs. 1, <= 0
    least: f64,
    /// Whether the cost has risen far enough.
    has_risen: bool,
}

impl GroupScan {
    fn new(start: GradientPoint) -> Self {
        Self { points: vec![start], cost: 0.0, least: 0.0, has_risen: false }
    }

    /// The next dead time, one step on or the end of the range; `None` if the scan is at its end. s
    fn next_s(&self, step_s: f64, dead_time_max_s: f64) -> Option<f64> {
        let last_s = self.points.last().map_or(0.0, |(last_s, _)| *last_s);
        let next_s = (last_s + step_s).clamp(0.0, dead_time_max_s);
        let has_place = (next_s - last_s).abs() > 0.1 * step_s.abs();
        (has_place && !self.has_risen).then_some(next_s)
    }

    /// Adds the gradient at the next dead time. The scan ends where the cost is `rise_max` above its least.
    fn add(&mut self, at_s: f64, gradient: f64, rise_max: f64) {
        if let Some((last_s, last)) = self.points.last() {
            self.cost += 0.5 * (last + gradient) * (at_s - last_s);
        }
        // False for NaN.
        let is_below = self.cost < self.least + rise_max;
        self.has_risen = !is_below;
        self.least = self.least.min(self.cost);
        self.points.push((at_s, gradient));
    }
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>
    Search<'_, M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP> + Sync,
{
    /// Gradients of the profile of each group by ascending dead time, from the present dead times, which are solved in
    /// `start`, down and up to the ends of the range or until a profile is `rise_max` above its least cost. All groups
    /// move at once.
    pub(super) fn scan(
        &mut self,
        start: &Ident<M, NS, NU, NO, NP>,
        rise_max: f64,
    ) -> Result<Vec<Vec<GradientPoint>>, SearchStop> {
        let starts_s = (0..self.groups.len()).map(|group| self.dead_time_of(group));
        let starts: Vec<GradientPoint> = starts_s.zip(self.gradients()).collect();
        let mut scanned = self.scan_towards(start, &starts, -self.settings.grid_s, rise_max)?;
        let upward = self.scan_towards(start, &starts, self.settings.grid_s, rise_max)?;
        for (points, upward) in scanned.iter_mut().zip(upward) {
            points.reverse();
            points.extend(upward.into_iter().skip(1));
        }
        Ok(scanned)
    }

    /// Scans in steps of `step_s` from `starts`. Returns the points of each group in the order of the scan.
    fn scan_towards(
        &mut self,
        start: &Ident<M, NS, NU, NO, NP>,
        starts: &[GradientPoint],
        step_s: f64,
        rise_max: f64,
    ) -> Result<Vec<Vec<GradientPoint>>, SearchStop> {
        self.ident.restart_at(start);
        let mut scans: Vec<GroupScan> = starts.iter().copied().map(GroupScan::new).collect();
        loop {
            let dead_time_max_s = self.settings.dead_time_max_s;
            let next = scans.iter().map(|scan| scan.next_s(step_s, dead_time_max_s));
            let next: Vec<Option<f64>> = next.collect();
            for (group, (next_s, (start_s, _))) in next.iter().zip(starts).enumerate() {
                self.set_dead_time(group, next_s.unwrap_or(*start_s));
            }
            if next.iter().all(Option::is_none) {
                return Ok(scans.into_iter().map(|scan| scan.points).collect());
            }
            self.solve_to(|of_settings| of_settings.max(COST_TOLERANCE_SCAN))?;
            for ((scan, next_s), gradient) in scans.iter_mut().zip(next).zip(self.gradients()) {
                if let Some(at_s) = next_s {
                    scan.add(at_s, gradient, rise_max);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_S: f64 = 0.1;
    const END_S: f64 = 0.5;

    /// A scan that has come to `at_s`, up or down.
    fn scan(at_s: f64) -> GroupScan {
        GroupScan::new((at_s, 0.0))
    }

    #[test]
    fn the_last_step_of_a_scan_ends_at_the_end_of_the_range_and_has_a_tenth_of_a_step() {
        for (at_s, step_s, next_s) in [
            (0.25, STEP_S, Some(0.35)),
            (0.25, -STEP_S, Some(0.15)),
            (0.45, STEP_S, Some(END_S)),
            (0.489, STEP_S, Some(END_S)),
            (0.491, STEP_S, None),
            (END_S, STEP_S, None),
            (0.05, -STEP_S, Some(0.0)),
            (0.011, -STEP_S, Some(0.0)),
            (0.009, -STEP_S, None),
            (0.0, -STEP_S, None),
        ] {
            let found_s = scan(at_s).next_s(step_s, END_S);
            let gap_s = found_s.zip(next_s).map(|(found_s, next_s)| (found_s - next_s).abs());
            assert_eq!(found_s.is_some(), next_s.is_some(), "{at_s} s by {step_s} s: {found_s:?}");
            assert!(gap_s.is_none_or(|gap_s| gap_s < 1e-12), "{at_s} s by {step_s} s: {found_s:?}");
        }
    }

    #[test]
    fn a_scan_ends_where_its_cost_has_risen_above_its_least_one() {
        // By the trapezoidal rule 0, -0.5, -0.5, 0.75: a rise of 1.25 above the least.
        for (rise_max, is_over) in [(1.26, false), (1.25, true), (1.0, true)] {
            let mut scan = GroupScan::new((0.0, -1.0));
            for (at_s, gradient) in [(1.0, 0.0), (2.0, 0.0)] {
                scan.add(at_s, gradient, rise_max);
                assert!(!scan.has_risen, "{at_s} s");
            }
            scan.add(3.0, 2.5, rise_max);
            assert_eq!(scan.has_risen, is_over, "{rise_max}");
            assert_eq!(scan.next_s(1.0, 9.0), (!is_over).then_some(4.0), "{rise_max}");
            assert!((scan.cost - 0.75).abs() < 1e-12 && (scan.least + 0.5).abs() < 1e-12);
            assert_eq!(scan.points, [(0.0, -1.0), (1.0, 0.0), (2.0, 0.0), (3.0, 2.5)]);
        }
    }

    #[test]
    fn a_gradient_that_is_no_number_ends_a_scan() {
        let mut scan = scan(0.2);
        scan.add(0.3, f64::NAN, 9.0);
        assert_eq!(scan.next_s(STEP_S, END_S), None);
    }
}
