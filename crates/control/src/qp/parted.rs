//! The quadratic subproblem of a model whose rows fall into two groups, as two smaller ones.
//!
//! Owns which rows go where. Nothing in cost, dynamics or box joins the groups, so the two solutions
//! together are the solution. A block of a quarter of the rows costs a sweep a fraction of its time, and an
//! input that meets its bound starts no sweep in the other group.

use nalgebra::SVector;
use tello_model::group::{cut, pick};
use tello_model::{DriveCurvature, Group};

use super::riccati::Riccati;
use super::{Bounds, Curvature, Horizon, Limits, Problem, SolveQp, Stage, Sweep, Unsolved};

/// Groups of the lagged vehicle without its disturbance. Blocks whose size is known to the compiler are what makes
/// a sweep quick, so every pair of groups needs a type of its own.
pub(super) type LevelAndHeight = Parted<6, 3, 2, 1>;

/// Solvers of both groups: `S` states and `U` inputs each.
#[derive(Debug)]
pub(super) struct Parted<const S1: usize, const U1: usize, const S2: usize, const U2: usize> {
    first: Part<S1, U1>,
    second: Part<S2, U2>,
}

impl<const S1: usize, const U1: usize, const S2: usize, const U2: usize> Parted<S1, U1, S2, U2> {
    /// Solvers for every problem with this `curvature`, `None` if `groups` are not two of this size that hold
    /// all of its rows. All allocation happens here.
    pub(super) fn new<const NS: usize, const NU: usize>(
        curvature: &Curvature<NS, NU>,
        limits: Limits,
        groups: &[Group],
    ) -> Option<Self> {
        let [first, second] = groups else { return None };
        let parted = Self {
            first: Part::new(curvature, limits, first)?,
            second: Part::new(curvature, limits, second)?,
        };
        (S1 + S2 == NS && U1 + U2 == NU).then_some(parted)
    }
}

impl<
    const NS: usize,
    const NU: usize,
    const S1: usize,
    const U1: usize,
    const S2: usize,
    const U2: usize,
> SolveQp<NS, NU> for Parted<S1, U1, S2, U2>
{
    /// The sweeps of the group that took more of them come back.
    fn solve(
        &mut self,
        problem: &Problem<'_, NS, NU>,
        du: &mut [SVector<f64, NU>],
    ) -> Result<u32, Unsolved> {
        let solved = self.first.solve(problem).and_then(|first| {
            let second = self.second.solve(problem)?;
            Ok(first.max(second))
        });
        if solved.is_ok() {
            self.first.write(du);
            self.second.write(du);
        } else {
            Sweep::<NS, NU>::reset(self);
        }
        solved
    }
}

impl<
    const NS: usize,
    const NU: usize,
    const S1: usize,
    const U1: usize,
    const S2: usize,
    const U2: usize,
> Sweep<NS, NU> for Parted<S1, U1, S2, U2>
{
    fn shift(&mut self, moved: usize) {
        self.first.riccati.shift(moved);
        self.second.riccati.shift(moved);
    }

    fn reset(&mut self) {
        self.first.riccati.reset();
        self.second.riccati.reset();
    }
}

/// The problem of one group and its solver.
#[derive(Debug)]
struct Part<const NS: usize, const NU: usize> {
    states: [usize; NS],
    inputs: [usize; NU],
    riccati: Riccati<NS, NU>,
    stages: Vec<Stage<NS, NU>>,
    gradient: Horizon<NS, NU>,
    u: Vec<SVector<f64, NU>>,
    bounds: Vec<Bounds<NU>>,
    bends: Vec<DriveCurvature<NS, NU>>,
    du: Vec<SVector<f64, NU>>,
}

impl<const NS: usize, const NU: usize> Part<NS, NU> {
    /// `None` if the group has another size.
    fn new<const WS: usize, const WU: usize>(
        whole: &Curvature<WS, WU>,
        limits: Limits,
        group: &Group,
    ) -> Option<Self> {
        let states: Vec<usize> = group.states.iter().copied().filter(|row| *row < WS).collect();
        let (states, inputs) = (states.try_into().ok()?, group.inputs.try_into().ok()?);
        let steps = whole.diagonal.steps();
        let curvature = Curvature {
            diagonal: Horizon {
                u: whole.diagonal.u.iter().map(|u| pick(u, &inputs)).collect(),
                s: whole.diagonal.s.iter().map(|s| pick(s, &states)).collect(),
            },
            coupling: whole.coupling.iter().map(|coupling| pick(coupling, &inputs)).collect(),
        };
        Some(Self {
            states,
            inputs,
            riccati: Riccati::new(&curvature, limits),
            stages: vec![Stage::zeros(); steps],
            gradient: Horizon::zeros(steps),
            u: vec![SVector::zeros(); steps],
            bounds: vec![Bounds { lo: SVector::zeros(), hi: SVector::zeros() }; steps],
            bends: Vec::with_capacity(steps),
            du: vec![SVector::zeros(); steps],
        })
    }

    /// Solves what of the `whole` problem is this group's.
    fn solve<const WS: usize, const WU: usize>(
        &mut self,
        whole: &Problem<'_, WS, WU>,
    ) -> Result<u32, Unsolved> {
        let Self { states, inputs, riccati, stages, gradient, u, bounds, bends, du } = self;
        for (k, stage) in stages.iter_mut().enumerate() {
            stage.by_state = cut(&whole.stages[k].by_state, states, states);
            stage.by_input = cut(&whole.stages[k].by_input, states, inputs);
            gradient.s[k] = pick(&whole.gradient.s[k], states);
            gradient.u[k] = pick(&whole.gradient.u[k], inputs);
            u[k] = pick(&whole.u[k], inputs);
            let Bounds { lo, hi } = &whole.bounds[k];
            bounds[k] = Bounds { lo: pick(lo, inputs), hi: pick(hi, inputs) };
        }
        bends.clear();
        bends.extend(whole.bends.iter().map(|bend| DriveCurvature {
            by_state: cut(&bend.by_state, states, states),
            by_input_state: cut(&bend.by_input_state, inputs, states),
            by_input: cut(&bend.by_input, inputs, inputs),
        }));
        riccati.solve(&Problem { stages, gradient, u, bounds, bends }, du)
    }

    /// Puts the solution in its place.
    fn write<const WU: usize>(&self, whole: &mut [SVector<f64, WU>]) {
        for (whole, du) in whole.iter_mut().zip(&self.du) {
            for (row, du) in self.inputs.iter().zip(du) {
                whole[*row] = *du;
            }
        }
    }
}
