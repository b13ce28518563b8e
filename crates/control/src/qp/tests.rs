pub(super) mod case;

use self::case::{Case, Kind, kinematic, lagged, random};
use super::*;

const LIMITS: Limits = Limits { tolerance: 1e-12, iterations_max: 200 };

/// What a comparison of both solvers found.
#[derive(Debug, Default)]
struct Found {
    count: usize,
    inputs: usize,
    active: usize,
    sweeps: u32,
    sweeps_max: u32,
    residual: f64,
    /// Cost above Clarabel's, relative.
    cost_gap: f64,
    /// Inputs beside Clarabel's.
    input_gap: f64,
}

impl Found {
    /// Solves one problem with both solvers, from no guess.
    fn compare<const NS: usize, const NU: usize>(&mut self, case: &Case<NS, NU>) {
        let mut du = vec![SVector::zeros(); case.steps()];
        let mut oracle_du = du.clone();
        let sweeps = Riccati::new(&case.curvature, LIMITS).solve(&case.problem(), &mut du).unwrap();
        let mut oracle = Clarabel::new(&case.curvature, LIMITS).unwrap();
        oracle.solve(&case.problem(), &mut oracle_du).unwrap();
        for (k, bounds) in case.bounds.iter().enumerate() {
            let u = case.u[k] + du[k];
            // u + (bound - u) is rounded.
            assert!((u - bounds.clamp(&u)).amax() < 1e-15, "u_{k} = {u} outside of {bounds:?}");
            let input_gap = (bounds.clamp(&u) - bounds.clamp(&(case.u[k] + oracle_du[k]))).amax();
            self.input_gap = self.input_gap.max(input_gap);
        }
        let (cost, oracle_cost) = (case.cost(&du), case.cost(&oracle_du));
        let residual = case.kkt_residual(&du);
        assert!(residual.is_finite() && cost.is_finite(), "residual {residual}, cost {cost}");
        self.count += 1;
        self.inputs += case.steps() * NU;
        self.active += case.active_count(&du);
        self.sweeps += sweeps;
        self.sweeps_max = self.sweeps_max.max(sweeps);
        self.residual = self.residual.max(residual);
        self.cost_gap = self.cost_gap.max((cost - oracle_cost) / (1.0 + oracle_cost.abs()));
    }

    fn judge(&self, name: &str) {
        println!("{name}: {self:?}");
        // Active sets are exact: rounding only, which the horizon amplifies.
        assert!(self.residual < 1e-10, "{name}: {self:?}");
        // Clarabel's own gap is 1e-12; it may lie above, not below.
        assert!(self.cost_gap < 1e-11, "{name}: {self:?}");
        let share = self.active as f64 / self.inputs as f64;
        assert!((0.1..0.9).contains(&share), "{name}: a share of {share} at bounds");
    }
}

/// 700 problems of every kind, horizons 1 to 60.
fn compare_all<const NS: usize, const NU: usize>(
    name: &str,
    make: impl Fn(u64, Kind) -> Case<NS, NU>,
) {
    let mut found = Found::default();
    for seed in 0..700 {
        let steps = 1 + (seed as usize * 7) % 60;
        let kind = Kind { steps, couples: seed % 2 == 0, gives: seed % 3 == 0 };
        found.compare(&make(seed, kind));
    }
    found.judge(name);
}

#[test]
fn random_problems_are_solved_as_by_clarabel_but_exactly() {
    compare_all("random", random);
}

#[test]
fn kinematic_problems_are_solved_as_by_clarabel_but_exactly() {
    compare_all("kinematic", kinematic);
}

#[test]
fn lagged_problems_are_solved_as_by_clarabel_but_exactly() {
    compare_all("lagged", lagged);
}
