//! Profile of the cost over the dead time of one group, and its minimum.

use horizon_model::check::maximum;

use super::ProfilePoint;

/// Points of a profile by ascending dead time, with costs up to a constant.
pub(super) struct CostProfile {
    points: Vec<ProfilePoint>,
    /// Index of the point of least cost.
    lowest: usize,
}

impl CostProfile {
    /// The profile through `points`, of which there is at least one, by ascending dead time.
    pub(super) fn new(points: Vec<ProfilePoint>) -> Self {
        let mut lowest = 0;
        for (i, point) in points.iter().enumerate() {
            if point.cost < points[lowest].cost {
                lowest = i;
            }
        }
        Self { points, lowest }
    }

    /// The point of least cost.
    pub(super) fn lowest(&self) -> ProfilePoint {
        self.points[self.lowest]
    }

    /// Vertex of the parabola through the lowest point and its two neighbours. s
    ///
    /// `None` at an end of the profile, and if the parabola is not convex.
    pub(super) fn vertex_s(&self) -> Option<f64> {
        let left = self.lowest.checked_sub(1)?;
        match self.points.get(left..left + 3)? {
            [left, middle, right] => vertex_s(*left, *middle, *right),
            _ => None,
        }
    }

    /// Adds `point`, which lies between the lowest point and one of its neighbours and costs no more: the new lowest.
    pub(super) fn insert_lowest(&mut self, point: ProfilePoint) {
        self.lowest += usize::from(point.dead_time_s >= self.lowest().dead_time_s);
        self.points.insert(self.lowest, point);
    }

    /// The points, with their costs above that of the lowest.
    pub(super) fn above_lowest(mut self) -> Vec<ProfilePoint> {
        let ProfilePoint { cost: least, .. } = self.lowest();
        for point in &mut self.points {
            point.cost -= least;
        }
        self.points
    }
}

/// Vertex of the parabola through three points. s; `None` if it is not convex.
fn vertex_s(left: ProfilePoint, middle: ProfilePoint, right: ProfilePoint) -> Option<f64> {
    let gradient =
        |a: ProfilePoint, b: ProfilePoint| (b.cost - a.cost) / (b.dead_time_s - a.dead_time_s);
    let (before, after) = (gradient(left, middle), gradient(middle, right));
    let curvature = 2.0 * (after - before) / (right.dead_time_s - left.dead_time_s);
    (curvature > 0.0).then(|| 0.5 * (left.dead_time_s + middle.dead_time_s) - before / curvature)
}

/// Minimum of a profile that is known by its gradients.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LocalMinimum {
    pub(super) at_s: f64,
    /// Second derivative there; `None` at an end of the range, where the dead time stays. 1/s^2
    pub(super) curvature: Option<f64>,
}

/// Profile from the `gradients` at ascending candidates, by the trapezoidal rule, with the minimum between two
/// candidates as a point of its own.
pub(super) fn integrate(candidates_s: &[f64], gradients: &[f64]) -> (CostProfile, LocalMinimum) {
    let mut cost = 0.0;
    let first_s = candidates_s.first().copied().unwrap_or(0.0);
    let mut points = vec![ProfilePoint { dead_time_s: first_s, cost }];
    for (at_s, gradient) in candidates_s.windows(2).zip(gradients.windows(2)) {
        let [left_s, right_s] = *at_s else { continue };
        let [left, right] = *gradient else { continue };
        cost += 0.5 * (left + right) * (right_s - left_s);
        points.push(ProfilePoint { dead_time_s: right_s, cost });
    }
    let mut profile = CostProfile::new(points);
    let lowest = profile.lowest;
    let ProfilePoint { dead_time_s: lowest_s, cost: least } = profile.lowest();
    // The gradient vanishes between the lowest candidate and the neighbour in the direction of descent.
    let neighbour = if gradients[lowest] < 0.0 { Some(lowest + 1) } else { lowest.checked_sub(1) };
    let next = neighbour.and_then(|at| candidates_s.get(at).zip(gradients.get(at)));
    let minimum = next.and_then(|(other_s, other)| {
        let curvature = (other - gradients[lowest]) / (other_s - lowest_s);
        let at_s = lowest_s - gradients[lowest] / curvature;
        (curvature > 0.0).then_some(LocalMinimum { at_s, curvature: Some(curvature) })
    });
    if let Some(LocalMinimum { at_s, .. }) = minimum
        && at_s.total_cmp(&lowest_s).is_ne()
    {
        let cost = least + 0.5 * gradients[lowest] * (at_s - lowest_s);
        profile.insert_lowest(ProfilePoint { dead_time_s: at_s, cost });
    }
    (profile, minimum.unwrap_or(LocalMinimum { at_s: lowest_s, curvature: None }))
}

/// Rise of `curve` to the left and to the right of `at_s`: the highest cost on each side. The costs are finite, since
/// a solve with a cost that is not finite fails.
pub(super) fn rises(curve: &[ProfilePoint], at_s: f64) -> [f64; 2] {
    let highest = |is_there: fn(f64, f64) -> bool| {
        let there = curve.iter().filter(|point| is_there(point.dead_time_s, at_s));
        there.map(|point| point.cost).fold(0.0, maximum)
    };
    [highest(|s, at_s| s < at_s), highest(|s, at_s| s > at_s)]
}

/// Where `curve`, a parabola from each point to the next, has first risen to `cost` behind `at_s`, where it is 0; its
/// end if it never has. s
pub(super) fn risen_at_s(curve: &[ProfilePoint], at_s: f64, cost: f64) -> f64 {
    let mut before = ProfilePoint { dead_time_s: at_s, cost: 0.0 };
    for point in curve.iter().filter(|point| point.dead_time_s > at_s) {
        if point.cost >= cost {
            let fraction = ((cost - before.cost) / (point.cost - before.cost)).sqrt();
            return before.dead_time_s + fraction * (point.dead_time_s - before.dead_time_s);
        }
        before = *point;
    }
    before.dead_time_s
}

/// Ends of the dead times around `lowest_s`, where `curve` is 0, up to which it has not risen above `cost`. s
pub(super) fn plausible_s(curve: &[ProfilePoint], lowest_s: f64, cost: f64) -> [f64; 2] {
    let mirrored = curve.iter().rev();
    let mirrored = mirrored.map(|at| ProfilePoint { dead_time_s: -at.dead_time_s, ..*at });
    let mirrored: Vec<ProfilePoint> = mirrored.collect();
    [-risen_at_s(&mirrored, -lowest_s, cost), risen_at_s(curve, lowest_s, cost)]
}

#[cfg(test)]
mod tests;
