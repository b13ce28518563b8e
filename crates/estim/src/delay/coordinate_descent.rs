//! The search where the groups depend on each other: each along its own profile, one after the other.

use horizon_model::Model;

use super::ProfilePoint;
use super::search::{Found, Halt, Search};

/// Passes over the groups.
const PASSES: usize = 2;

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>
    Search<'_, M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP> + Sync,
{
    /// Cyclic coordinate descent from the present dead times, which are left at the best that was found.
    /// The present dead time of a group is one of its candidates.
    ///
    /// Cost: a warm solve per group, candidate and pass.
    pub(super) fn coordinate_descent(&mut self, candidates_s: &[f64]) -> Result<Vec<Found>, Halt> {
        let mut found = Vec::new();
        for _ in 0..PASSES {
            found.clear();
            for group in 0..self.groups.len() {
                found.push(self.along(group, candidates_s)?);
            }
        }
        Ok(found)
    }

    /// The profile of one group, the others as they are, and the vertex of the parabola through its least
    /// point and the two neighbours, if the cost there is less.
    fn along(&mut self, group: usize, candidates_s: &[f64]) -> Result<Found, Halt> {
        let now_s = self.groups[group].first().map_or(0.0, |row| self.dead_time_s[*row]);
        let mut at: Vec<f64> = candidates_s.iter().copied().chain([now_s]).collect();
        at.sort_by(f64::total_cmp);
        at.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
        let mut curve = Vec::with_capacity(at.len());
        for dead_time_s in at {
            self.put(group, dead_time_s);
            curve.push(ProfilePoint { dead_time_s, cost: self.solve()? });
        }
        let mut best = 0;
        for (i, point) in curve.iter().enumerate() {
            if point.cost < curve[best].cost {
                best = i;
            }
        }
        let mut minimum = curve[best];
        let around = best.checked_sub(1).and_then(|left| curve.get(left..left + 3));
        if let Some([left, middle, right]) = around
            && let Some(dead_time_s) = vertex(*left, *middle, *right)
        {
            self.put(group, dead_time_s);
            let vertex = ProfilePoint { dead_time_s, cost: self.solve()? };
            if vertex.cost < minimum.cost {
                let is_left = dead_time_s < minimum.dead_time_s;
                curve.insert(if is_left { best } else { best + 1 }, vertex);
                minimum = vertex;
            }
        }
        self.put(group, minimum.dead_time_s);
        self.solve()?;
        for point in &mut curve {
            point.cost -= minimum.cost;
        }
        Ok(Found { curve, at_s: minimum.dead_time_s })
    }
}

/// Where the parabola through three points is least; `None` if it is not convex.
fn vertex(left: ProfilePoint, middle: ProfilePoint, right: ProfilePoint) -> Option<f64> {
    let gradient =
        |a: ProfilePoint, b: ProfilePoint| (b.cost - a.cost) / (b.dead_time_s - a.dead_time_s);
    let (before, after) = (gradient(left, middle), gradient(middle, right));
    let curvature = 2.0 * (after - before) / (right.dead_time_s - left.dead_time_s);
    (curvature > 0.0).then(|| 0.5 * (left.dead_time_s + middle.dead_time_s) - before / curvature)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_vertex_is_that_of_the_parabola() {
        let cost = |s: f64| 3.0 * (s - 0.31).powi(2) + 7.0;
        let parabola = |s: f64| ProfilePoint { dead_time_s: s, cost: cost(s) };
        let found = vertex(parabola(0.2), parabola(0.3), parabola(0.36)).unwrap();
        assert!((found - 0.31).abs() < 1e-12, "{found}");
        let flipped = |s: f64| ProfilePoint { dead_time_s: s, cost: -cost(s) };
        assert!(vertex(flipped(0.2), flipped(0.3), flipped(0.36)).is_none());
    }
}
