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
