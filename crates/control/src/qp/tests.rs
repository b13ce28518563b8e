pub(crate) mod case;
mod penalties;

use self::case::{Case, Kind, kinematic, lagged, random};
use super::*;
use horizon_model::Vector;
use horizon_model::check::{amax, maximum};

pub(super) const LIMITS: Limits =
    Limits { tolerance: 1e-12, iterations_max: 200, penalties_max: 0 };

/// What a comparison of both solvers found.
#[derive(Debug, Default)]
struct Found {
    count: usize,
    inputs: usize,
    active: usize,
    iterations: u32,
    iterations_max: u32,
    residual: f64,
    /// Cost above Clarabel's, relative.
    cost_gap: f64,
    /// Inputs beside Clarabel's.
    input_gap: f64,
}

impl Found {
    /// Solves one problem with both solvers, from no guess.
    fn compare<const NS: usize, const NU: usize>(&mut self, case: &Case<NS, NU>) {
        let mut du = vec![Vector::zeros(); case.steps()];
        let mut oracle_du = du.clone();
        let iterations =
            ActiveSet::new(&case.curvature, LIMITS).solve(&case.problem(), &mut du).unwrap();
        let mut oracle = Clarabel::new(&case.curvature, LIMITS).unwrap();
        oracle.solve(&case.problem(), &mut oracle_du).unwrap();
        for (k, bounds) in case.bounds.iter().enumerate() {
            let u = case.u[k] + du[k];
            // u + (bound - u) is rounded.
            assert!(amax(&(u - bounds.clamp(&u))) < 1e-15, "u_{k} = {u} outside of {bounds:?}");
            let input_gap = amax(&(bounds.clamp(&u) - bounds.clamp(&(case.u[k] + oracle_du[k]))));
            self.input_gap = maximum(self.input_gap, input_gap);
        }
        let (cost, oracle_cost) = (case.cost(&du), case.cost(&oracle_du));
        let residual = case.kkt_residual(&du);
        assert!(residual.is_finite() && cost.is_finite(), "residual {residual}, cost {cost}");
        self.count += 1;
        self.inputs += case.steps() * NU;
        self.active += case.active_count(&du);
        self.iterations += iterations;
        self.iterations_max = self.iterations_max.max(iterations);
        self.residual = maximum(self.residual, residual);
        self.cost_gap = maximum(self.cost_gap, (cost - oracle_cost) / (1.0 + oracle_cost.abs()));
    }

    fn judge(&self, name: &str) {
        println!("{name}: {self:?}");
        // Active sets are exact: rounding only, which the horizon amplifies.
        assert!(self.residual < 1e-10, "{name}: {self:?}");
        // Clarabel's own gap is 1e-12; it may lie above, not below.
        assert!(self.cost_gap < 1e-11, "{name}: {self:?}");
        let fraction = self.active as f64 / self.inputs as f64;
        assert!((0.1..0.9).contains(&fraction), "{name}: a fraction of {fraction} at bounds");
    }
}

/// Problems of every kind of vehicle in a quick run: a full round of the horizons 1 to 61.
const QUICK: u64 = 61;
/// The same in a thorough one.
const THOROUGH: u64 = 700;

/// So many problems of every kind, horizons 1 to 61.
fn compare_all<const NS: usize, const NU: usize>(
    name: &str,
    problems: u64,
    make: impl Fn(u64, Kind) -> Case<NS, NU>,
) {
    let mut found = Found::default();
    for (seed, steps) in (0..problems).zip((1..=61).cycle()) {
        let kind = Kind { steps, couples: seed % 2 == 0, gives: seed % 3 == 0 };
        found.compare(&make(seed, kind));
    }
    found.judge(name);
}

#[test]
fn random_problems_are_solved_as_by_clarabel_but_exactly() {
    compare_all("random", QUICK, random);
}

#[test]
fn kinematic_problems_are_solved_as_by_clarabel_but_exactly() {
    compare_all("kinematic", QUICK, kinematic);
}

#[test]
fn lagged_problems_are_solved_as_by_clarabel_but_exactly() {
    compare_all("lagged", QUICK, lagged);
}

#[test]
#[ignore = "2,100 problems: in .ci/run all"]
fn thousands_of_problems_are_solved_as_by_clarabel_but_exactly() {
    compare_all("random", THOROUGH, random);
    compare_all("kinematic", THOROUGH, kinematic);
    compare_all("lagged", THOROUGH, lagged);
}

#[test]
fn a_problem_with_too_many_iterations_goes_to_clarabel() {
    let case = random(1211, Kind { steps: 60, couples: true, gives: false });
    let limits = Limits { iterations_max: 40, ..LIMITS };
    let mut du = vec![Vector::zeros(); case.steps()];
    let alone =
        ActiveSet::new(&case.curvature, limits).solve(&case.problem(), &mut du).unwrap_err();
    assert_eq!(alone, Unsolved { reason: Reason::IterationLimit, iterations: 40 });
    let mut qp = Qp::new(&case.curvature, limits, true).unwrap();
    let before = du.clone();
    let late = qp.solve(&case.problem(), &mut du, &mut || true).unwrap_err();
    assert!(late.is_late() && late.iterations == 40 && du == before, "{late}");
    let solved = qp.solve(&case.problem(), &mut du, &mut || false).unwrap();
    assert!(solved.has_fallen_back && solved.iterations > 40, "{solved:?}");
    let residual = case.kkt_residual(&du);
    // A gap of 1e-12 leaves inputs at weakly active bounds off by its square root.
    assert!(residual < 1e-5, "residual {residual:e}");
    // Its solution is the warm start of the next problem, here the same one.
    let next = qp.solve(&case.problem(), &mut du, &mut || false).unwrap();
    assert!(!next.has_fallen_back && next.iterations < 10, "{next:?}");
    assert!(case.kkt_residual(&du) < 1e-10, "residual {:e}", case.kkt_residual(&du));
}
