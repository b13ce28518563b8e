use clarabel::algebra::TriangularMatrixChecks;

use super::*;

const STEPS: usize = 6;
const LIMITS: Limits = Limits { tolerance: 1e-10, iterations_max: 50 };

/// A sequence of numbers in -1..1 that jumps about: the fraction of multiples of the golden ratio.
struct Numbers(f64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = (self.0 + 0.618_033_988_749_895).fract();
        2.0 * self.0 - 1.0
    }

    fn fill<const R: usize, const C: usize>(&mut self) -> SMatrix<f64, R, C> {
        SMatrix::from_fn(|_, _| self.next())
    }
}

/// A problem with three states and two inputs.
struct Problem {
    curvature: Curvature<3, 2>,
    stages: Vec<Stage<3, 2>>,
    gradient: Horizon<3, 2>,
    u: Vec<SVector<f64, 2>>,
}

const LO: [f64; 2] = [-1.2, -1.0];
const HI: [f64; 2] = [1.0, 1.1];

impl Problem {
    fn new(seed: f64, has_coupling: bool) -> Self {
        let mut numbers = Numbers(seed);
        let weight = SVector::from([0.7, 1.9]);
        let mut diagonal = Horizon::zeros(STEPS);
        diagonal.u.fill(weight * 2.0);
        diagonal.s.fill(SVector::from([1.0, 0.5, 4.0]));
        let stage = |numbers: &mut Numbers| Stage {
            by_state: SMatrix::identity() + numbers.fill::<3, 3>() * 0.3,
            by_input: numbers.fill(),
        };
        let stages = (0..STEPS).map(|_| stage(&mut numbers)).collect();
        let mut gradient = Horizon::zeros(STEPS);
        gradient.u.fill_with(|| numbers.fill() * 2.0);
        gradient.s.fill_with(|| numbers.fill() * 3.0);
        let u = (0..STEPS).map(|_| numbers.fill()).collect();
        let coupling = has_coupling.then_some(-weight);
        Self { curvature: Curvature { diagonal, coupling }, stages, gradient, u }
    }

    fn solve(&self, qp: &mut Qp<3, 2>) -> Vec<SVector<f64, 2>> {
        let (lo, hi) = (&SVector::from(LO), &SVector::from(HI));
        let input_box = InputBox { u: &self.u, lo, hi };
        let mut du = vec![SVector::zeros(); STEPS];
        qp.solve(&self.stages, &self.gradient, &input_box, &mut du).unwrap();
        du
    }

    /// Distance of `du` to the point that a projected gradient step leads to: zero at the optimum
    /// and nowhere else. The gradient by the inputs comes from the costates.
    fn kkt_residual(&self, du: &[SVector<f64, 2>]) -> f64 {
        let mut ds = [SVector::<f64, 3>::zeros(); STEPS + 1];
        for (k, stage) in self.stages.iter().enumerate() {
            ds[k + 1] = stage.by_state * ds[k] + stage.by_input * du[k];
        }
        let mut worst = 0.0_f64;
        let mut costate = SVector::<f64, 3>::zeros();
        for k in (0..STEPS).rev() {
            if let Some(next) = self.stages.get(k + 1) {
                costate = next.by_state.transpose() * costate;
            }
            costate += self.curvature.diagonal.s[k].component_mul(&ds[k + 1]) + self.gradient.s[k];
            let mut slope = self.gradient.u[k]
                + self.curvature.diagonal.u[k].component_mul(&du[k])
                + self.stages[k].by_input.transpose() * costate;
            if let Some(coupling) = self.curvature.coupling {
                for neighbour in [k.wrapping_sub(1), k + 1] {
                    slope +=
                        du.get(neighbour).map_or(SVector::zeros(), |v| coupling.component_mul(v));
                }
            }
            let u = self.u[k] + du[k];
            let moved = (u - slope).sup(&SVector::from(LO)).inf(&SVector::from(HI));
            worst = worst.max((u - moved).amax());
        }
        worst
    }
}

#[test]
fn solutions_meet_the_optimality_conditions_with_some_bounds_active() {
    let mut active = 0;
    for seed in 0..20 {
        for has_coupling in [false, true] {
            let problem = Problem::new(f64::from(seed) / 20.0, has_coupling);
            let du = problem.solve(&mut Qp::new(&problem.curvature, LIMITS).unwrap());
            let residual = problem.kkt_residual(&du);
            // A gap of 1e-10 leaves inputs at weakly active bounds off by its square root.
            assert!(residual < 1e-5, "residual {residual:e}, seed {seed}, coupling {has_coupling}");
            for (u, du) in problem.u.iter().zip(&du) {
                active += (0..2)
                    .filter(|i| {
                        let u_next = u[*i] + du[*i];
                        (u_next - LO[*i]).min(HI[*i] - u_next) < 1e-6
                    })
                    .count();
            }
        }
    }
    // 480 inputs: the problems are neither free nor all at their bounds.
    assert!((50..430).contains(&active), "{active} inputs at a bound");
}

#[test]
fn an_update_in_place_equals_a_new_solver() {
    for has_coupling in [false, true] {
        let [first, second] = [0.3, 0.8].map(|seed| Problem::new(seed, has_coupling));
        let mut reused = Qp::new(&first.curvature, LIMITS).unwrap();
        let du_first = first.solve(&mut reused);
        let du_second = second.solve(&mut reused);
        let mut fresh = Qp::new(&second.curvature, LIMITS).unwrap();
        // Without equilibration nothing of the first problem stays: equal bits.
        assert_eq!(du_second, second.solve(&mut fresh));
        assert_eq!(du_first, first.solve(&mut reused));
        assert_ne!(du_first, du_second);
    }
}

#[test]
fn zeros_in_the_data_do_not_change_the_shape() {
    let mut problem = Problem::new(0.1, true);
    let mut qp = Qp::new(&problem.curvature, LIMITS).unwrap();
    let du_full = problem.solve(&mut qp);
    let full = problem.stages.clone();
    problem.stages.fill(Stage::zeros());
    let residual = problem.kkt_residual(&problem.solve(&mut qp));
    assert!(residual < 1e-5, "residual {residual:e} with zero blocks");
    problem.stages = full;
    assert_eq!(problem.solve(&mut qp), du_full);
}

#[test]
fn sparse_matrices_are_well_formed() {
    let problem = Problem::new(0.2, true);
    let constraint = by_columns((STEPS * 7, STEPS * 5), |entry| {
        constraint_entries(&problem.stages, entry);
    });
    assert!(constraint.check_format().is_ok());
    // Rows at their bounds, then full blocks for all but the first state, then one -1 per state.
    assert_eq!(constraint.nnz(), STEPS * (2 * 2 + 3 * 2 + 3) + (STEPS - 1) * 9);
    let curvature = by_columns((STEPS * 5, STEPS * 5), |entry| {
        curvature_entries(&problem.curvature, entry);
    });
    assert!(curvature.check_format().is_ok() && curvature.is_triu());
}

#[test]
fn a_solve_cut_short_is_no_solution() {
    let problem = Problem::new(0.4, false);
    let limits = Limits { iterations_max: 2, ..LIMITS };
    let mut qp = Qp::new(&problem.curvature, limits).unwrap();
    let (lo, hi) = (&SVector::from(LO), &SVector::from(HI));
    let mut du = vec![SVector::from([0.25, 0.5]); STEPS];
    let before = du.clone();
    let input_box = InputBox { u: &problem.u, lo, hi };
    let unsolved = qp.solve(&problem.stages, &problem.gradient, &input_box, &mut du).unwrap_err();
    assert_eq!(unsolved, Unsolved { status: SolverStatus::MaxIterations, iterations: 2 });
    assert_eq!(
        unsolved.to_string(),
        "the quadratic subproblem ended as MaxIterations after 2 iterations"
    );
    assert_eq!(du, before);
}
