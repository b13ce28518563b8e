//! Random quadratic subproblems, and what makes a solution of one optimal.

use horizon_model::check::{amax, maximum};
use horizon_model::{Kinematic, Lagged, LaggedShape, Matrix, Model, Vector};

use super::super::*;

/// Period of the vehicles. s
const DT_S: f64 = 0.02;

/// Numbers in -1..1 from a seed: xorshift64* (Vigna, 2016).
pub(crate) struct Numbers(u64);

impl Numbers {
    pub(crate) fn new(seed: u64) -> Self {
        Self((seed + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15))
    }

    fn bits(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11
    }

    pub(crate) fn next(&mut self) -> f64 {
        self.bits() as f64 / (1_u64 << 52) as f64 - 1.0
    }

    pub(crate) fn fill<const R: usize, const C: usize>(&mut self) -> Matrix<R, C> {
        Matrix::from_fn(|_, _| self.next())
    }
}

/// What kind of problem.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Kind {
    pub(crate) steps: usize,
    /// Whether neighbouring inputs are coupled.
    pub(crate) couples: bool,
    /// Whether some inputs are given.
    pub(crate) gives: bool,
}

/// A problem and everything that it borrows.
#[derive(Debug, Clone)]
pub(crate) struct Case<const NS: usize, const NU: usize> {
    pub(crate) curvature: CostHessian<NS, NU>,
    pub(crate) stages: Vec<Stage<NS, NU>>,
    pub(crate) gradient: Horizon<NS, NU>,
    pub(crate) u: Vec<Vector<NU>>,
    pub(crate) bounds: Vec<Bounds<NU>>,
    pub(crate) penalties: Vec<Penalty<NS>>,
}

/// Dynamics that mean nothing.
pub(crate) fn random(seed: u64, kind: Kind) -> Case<3, 2> {
    let mut numbers = Numbers::new(seed);
    let bounds = Bounds { lo: Vector::from([-1.2, -1.0]), hi: Vector::from([1.0, 1.1]) };
    let weights = [Vector::from([1.0, 0.5, 0.0]), Vector::from([4.0, 0.0, 9.0])];
    let mut case = Case::inputs(&mut numbers, kind, Vector::from([0.7, 1.9]), weights, bounds);
    for stage in &mut case.stages {
        stage.by_state = Matrix::identity() + numbers.fill::<3, 3>() * 0.3;
        stage.by_input = numbers.fill();
    }
    case.gradient.u.fill_with(|| numbers.fill() * 2.0);
    case.gradient.s.fill_with(|| numbers.fill() * 3.0);
    case
}

/// The kinematic vehicle on its way to a target, thesis weights.
pub(crate) fn kinematic(seed: u64, kind: Kind) -> Case<4, 4> {
    let bounds =
        Bounds { lo: -Vector::from([0.8, 0.8, 1.0, 1.0]), hi: [0.8, 0.8, 1.0, 1.0].into() };
    let weights = [Vector::from([2.25, 2.25, 1.0, 1.0]), [225.0, 225.0, 100.0, 100.0].into()];
    let c_u = [1.44, 1.44, 0.64, 0.64].into();
    let p = Vector::from([1.29, 0.445, 0.994, 0.033]);
    let mut numbers = Numbers::new(seed);
    let mut case = Case::inputs(&mut numbers, kind, c_u, weights, bounds);
    case.follow(&mut numbers, &Kinematic, &p);
    case
}

/// The lagged vehicle on its way to a target. Velocities and disturbances weigh nothing.
pub(crate) fn lagged(seed: u64, kind: Kind) -> Case<11, 4> {
    let bounds =
        Bounds { lo: -Vector::from([0.8, 0.8, 1.0, 1.0]), hi: [0.8, 0.8, 1.0, 1.0].into() };
    let model = Lagged::new(LaggedShape::default()).unwrap();
    let stage = model.at_rest(&Vector::from([9.0, 9.0, 16.0, 1.0]));
    let weights = [stage, 10.0 * stage];
    let c_u = [0.04, 0.04, 0.09, 0.01].into();
    let p = [1.4, 0.9, 1.6, 0.03, 0.4, 0.25, 0.15, 0.05, 0.08, 0.06, 2.5].into();
    let mut numbers = Numbers::new(seed);
    let mut case = Case::inputs(&mut numbers, kind, c_u, weights, bounds);
    case.follow(&mut numbers, &model, &p);
    case
}

impl<const NS: usize, const NU: usize> Case<NS, NU> {
    /// Random inputs inside their bounds, and the curvature; nothing else yet.
    fn inputs(
        numbers: &mut Numbers,
        kind: Kind,
        c_u: Vector<NU>,
        [stage, end]: [Vector<NS>; 2],
        bounds: Bounds<NU>,
    ) -> Self {
        let steps = kind.steps;
        let mut diagonal = Horizon::zeros(steps);
        diagonal.u.fill(if kind.couples { 2.0 * c_u } else { c_u });
        diagonal.u[steps - 1] = c_u;
        diagonal.s.fill(stage);
        diagonal.s[steps - 1] = end;
        let mut case = Self {
            curvature: CostHessian {
                diagonal,
                coupling: vec![-c_u; if kind.couples { steps } else { 0 }],
            },
            stages: vec![Stage::zeros(); steps],
            gradient: Horizon::zeros(steps),
            u: Vec::new(),
            bounds: vec![bounds; steps],
            penalties: Vec::new(),
        };
        // Wider than the box: some inputs begin at a bound.
        case.u = (0..steps).map(|_| bounds.clamp(&(numbers.fill() * 1.3))).collect();
        for i in 0..NU {
            let given_fraction = if kind.gives { 0.25 * (1.0 + numbers.next()) } else { 0.0 };
            for k in (0..steps).take_while(|k| (*k as f64) < given_fraction * steps as f64) {
                case.u[k][i] = 1.5 * numbers.next();
                case.bounds[k].lo[i] = case.u[k][i];
                case.bounds[k].hi[i] = case.u[k][i];
            }
        }
        case
    }

    /// Dynamics of `model` along its inputs, and the gradient of the way to a target that is as far as
    /// a few steps to several horizons of flight.
    fn follow<M, const NO: usize, const NP: usize>(
        &mut self,
        numbers: &mut Numbers,
        model: &M,
        p: &Vector<NP>,
    ) where
        M: Model<NS, NU, NO, NP>,
    {
        let mut s = model.at_rest(&numbers.fill());
        let target = s + 10.0_f64.powf(numbers.next()) * model.at_rest(&numbers.fill());
        for (k, (stage, u)) in self.stages.iter_mut().zip(&self.u).enumerate() {
            stage.by_state = model.step_by_state(&s, u, p, DT_S);
            stage.by_input = model.step_by_input(&s, u, p, DT_S);
            s = model.step(&s, u, p, DT_S);
            self.gradient.s[k] = self.curvature.diagonal.s[k].component_mul(&(s - target));
        }
        // The gradient of the input cost is its curvature times the inputs.
        for (k, gradient) in self.gradient.u.iter_mut().enumerate() {
            *gradient = self.curvature.by_input(&self.u, k);
        }
    }

    pub(crate) fn steps(&self) -> usize {
        self.stages.len()
    }

    pub(crate) fn problem(&self) -> Problem<'_, NS, NU> {
        let Self { stages, gradient, u, bounds, penalties, .. } = self;
        Problem { stages, gradient, u, bounds, second_derivatives: &[], penalties }
    }

    /// Up to `max` penalties on the state after each stage, on the first `rows` rows of the state. In about half of
    /// them the constraint is violated.
    pub(crate) fn penalize(&mut self, seed: u64, max: usize, rows: usize) {
        let mut numbers = Numbers::new(seed.wrapping_add(7_000_000));
        for stage in 0..self.steps() {
            let count = (numbers.next().abs() * (max + 1) as f64).floor().min(max as f64);
            let mut left = count;
            while left > 0.0 {
                let gradient = Vector::from_fn(|i, _| if i < rows { numbers.next() } else { 0.0 });
                let squared_weight = 10.0_f64.powf(2.0 * numbers.next() + 1.0);
                let excess = 0.3 * numbers.next();
                self.penalties.push(Penalty { stage, squared_weight, excess, gradient });
                left -= 1.0;
            }
        }
    }

    /// Number of penalties whose constraint is violated after `du`.
    pub(crate) fn violated_count(&self, du: &[Vector<NU>]) -> usize {
        let ds = self.states(du);
        self.penalties.iter().filter(|one| one.excess_at(&ds[one.stage]) > 0.0).count()
    }

    fn states(&self, du: &[Vector<NU>]) -> Vec<Vector<NS>> {
        let mut s = Vector::zeros();
        let next = |(stage, du): (&Stage<NS, NU>, &_)| {
            s = stage.by_state * s + stage.by_input * du;
            s
        };
        self.stages.iter().zip(du).map(next).collect()
    }

    pub(crate) fn cost(&self, du: &[Vector<NU>]) -> f64 {
        let mut cost = 0.0;
        for (k, ds) in self.states(du).iter().enumerate() {
            let by_s = self.curvature.diagonal.s[k].component_mul(ds);
            cost += ds.dot(&(0.5 * by_s + self.gradient.s[k]));
            cost += du[k].dot(&(0.5 * self.curvature.by_input(du, k) + self.gradient.u[k]));
            let penalties = self.penalties.iter().filter(|one| one.stage == k);
            cost += penalties.map(|one| one.cost(one.excess_at(ds))).sum::<f64>();
        }
        cost
    }

    /// How far `du` is from optimal: the largest distance, in input units, to where each input would
    /// go if it followed its gradient, scaled by its own weight, inside its bounds. Zero at the
    /// optimum and nowhere else. The gradient comes from the costates.
    pub(crate) fn kkt_residual(&self, du: &[Vector<NU>]) -> f64 {
        let ds = self.states(du);
        let mut worst = 0.0_f64;
        let mut costate = Vector::<NS>::zeros();
        for k in (0..self.steps()).rev() {
            if let Some(next) = self.stages.get(k + 1) {
                costate = next.by_state.transpose() * costate;
            }
            costate += self.curvature.diagonal.s[k].component_mul(&ds[k]) + self.gradient.s[k];
            for one in self.penalties.iter().filter(|one| one.stage == k) {
                costate += one.gradient * (one.squared_weight * one.excess_at(&ds[k]).max(0.0));
            }
            let by_input = self.curvature.by_input(du, k) + self.gradient.u[k];
            let gradient = by_input + self.stages[k].by_input.transpose() * costate;
            let u = self.u[k] + du[k];
            let goal = u - gradient.component_div(&self.curvature.diagonal.u[k]);
            let gap = amax(&(u - self.bounds[k].clamp(&goal)));
            worst = maximum(worst, gap);
        }
        worst
    }

    /// Number of inputs at a bound, those that are given aside.
    pub(crate) fn active_count(&self, du: &[Vector<NU>]) -> usize {
        let is_active = |k: usize, i: usize| {
            let (u, bounds) = (self.u[k][i] + du[k][i], &self.bounds[k]);
            !bounds.is_given(i) && (u - bounds.lo[i]).min(bounds.hi[i] - u) < 1e-9
        };
        (0..self.steps()).map(|k| (0..NU).filter(|i| is_active(k, *i)).count()).sum()
    }
}

impl<const NS: usize, const NU: usize> CostHessian<NS, NU> {
    /// Row block of `P` at input `k`, times `u`.
    fn by_input(&self, u: &[Vector<NU>], k: usize) -> Vector<NU> {
        let mut product = self.diagonal.u[k].component_mul(&u[k]);
        // The block between two inputs is that of the later one.
        for (neighbour, later) in [(k.wrapping_sub(1), k), (k + 1, k + 1)] {
            if let (Some(u), Some(coupling)) = (u.get(neighbour), self.coupling.get(later)) {
                product += coupling.component_mul(u);
            }
        }
        product
    }
}
