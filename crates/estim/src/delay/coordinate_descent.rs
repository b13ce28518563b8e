//! The search where the groups depend on each other: one profile after the other.

use horizon_model::Model;

use super::ProfilePoint;
use super::profile::CostProfile;
use super::search::{GroupProfile, Search, SearchStop};

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
    pub(super) fn coordinate_descent(
        &mut self,
        candidates_s: &[f64],
    ) -> Result<Vec<GroupProfile>, SearchStop> {
        let mut profiles = Vec::new();
        for _ in 0..PASSES {
            profiles.clear();
            for group in 0..self.groups.len() {
                profiles.push(self.minimize_along(group, candidates_s)?);
            }
        }
        Ok(profiles)
    }

    /// Profile of one group at fixed dead times of the others. The group is left at the lowest of the candidates and
    /// the vertex of the parabola through the lowest candidate and its neighbours.
    fn minimize_along(
        &mut self,
        group: usize,
        candidates_s: &[f64],
    ) -> Result<GroupProfile, SearchStop> {
        let present_s = self.dead_time_of(group);
        let mut at: Vec<f64> = candidates_s.iter().copied().chain([present_s]).collect();
        at.sort_by(f64::total_cmp);
        at.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
        let mut points = Vec::with_capacity(at.len());
        for dead_time_s in at {
            self.set_dead_time(group, dead_time_s);
            points.push(ProfilePoint { dead_time_s, cost: self.solve()? });
        }
        let mut profile = CostProfile::new(points);
        if let Some(dead_time_s) = profile.vertex_s() {
            self.set_dead_time(group, dead_time_s);
            let vertex = ProfilePoint { dead_time_s, cost: self.solve()? };
            if vertex.cost < profile.lowest().cost {
                profile.insert_lowest(vertex);
            }
        }
        let at_s = profile.lowest().dead_time_s;
        self.set_dead_time(group, at_s);
        self.solve()?;
        Ok(GroupProfile { curve: profile.above_lowest(), at_s })
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{dead_time_s, flights, settings, with_search};
    use super::*;

    const CANDIDATES_S: [f64; 3] = [0.24, 0.3, 0.36];

    /// Profile of roll and pitch, whose dead time is `truth_s` and before the search `present_s`, of abrupt sticks
    /// without noise.
    fn profile(truth_s: f64, present_s: f64) -> GroupProfile {
        let recordings = flights(dead_time_s(truth_s, 0.1, 0.2), 1.0, 0.0, 1);
        let start_s = dead_time_s(present_s, 0.1, 0.2);
        with_search(&recordings, 50, start_s, &settings(), |search| {
            let profile = search.minimize_along(0, &CANDIDATES_S).ok().unwrap();
            assert_eq!(search.dead_time_of(0).to_bits(), profile.at_s.to_bits());
            profile
        })
    }

    #[test]
    fn a_vertex_counts_if_it_costs_less_than_the_lowest_candidate() {
        let GroupProfile { curve, at_s } = profile(0.31, 0.3);
        assert_eq!(curve.len(), 4, "{curve:?}");
        assert!((at_s - 0.31).abs() < 0.01 && at_s > 0.3, "{at_s} s");
        for point in &curve {
            assert_eq!(
                point.cost <= 0.0,
                point.dead_time_s.to_bits() == at_s.to_bits(),
                "{point:?}"
            );
        }
        // At whole periods the profile is nonsmooth: the parabola misses the minimum.
        let GroupProfile { curve, at_s } = profile(0.3, 0.3);
        assert_eq!((curve.len(), at_s.to_bits()), (3, 0.3_f64.to_bits()), "{curve:?}");
    }

    #[test]
    fn the_present_dead_time_is_a_candidate() {
        let GroupProfile { curve, .. } = profile(0.3, 0.27);
        let at: Vec<f64> = curve.iter().map(|point| point.dead_time_s).collect();
        assert_eq!(at, [0.24, 0.27, 0.3, 0.36]);
    }
}
