//! Block-diagonal partition of the normal equations into decoupled subsystems.
//!
//! Owns which rows belong to which subsystem. With plain least squares the subsystems are not coupled, so each is
//! solved by itself. The second derivative of a robust loss couples the rows of an outlier; these entries are left out
//! of the step, which is accepted on the true cost. The cost of an elimination grows with the cube of its rows. Block
//! sizes known at compile time make an elimination fast: each subsystem has blocks of its own sizes, which the model
//! states ([`Model::subsystems`]).

use std::fmt::Debug;

use horizon_model::subsystem::{scatter, select_rows, submatrix};
use horizon_model::{Matrix, Model, Vector, VisitSubsystems};

use crate::arrival_cost::{Forgetting, Marginal, OldestStep, marginalize};
use crate::back_substitution::{LongElimination, back_substitute};
use crate::chain::{Block, Eliminated, eliminate};
use crate::cholesky::NotPositive;
use crate::reduced_system::ReducedSystem;

/// The subsystems of a model with `NS` states and `NP` parameters.
#[derive(Debug, Clone)]
pub(crate) struct Partition<const NS: usize, const NP: usize> {
    subsystems: Vec<Box<dyn Eliminate<NS, NP>>>,
}

impl<const NS: usize, const NP: usize> Partition<NS, NP> {
    /// The subsystems of the model `M`, with room for `len_max` states; `None` if the model has none, or if they do
    /// not hold each of its `NS` states and `NP` parameters once. Allocates.
    pub(crate) fn of<M, const NU: usize, const NO: usize>(len_max: usize) -> Option<Self>
    where
        M: Model<NS, NU, NO, NP>,
    {
        let mut found = Collected {
            len_max,
            states: Vec::new(),
            parameters: Vec::new(),
            subsystems: Vec::new(),
        };
        M::subsystems(&mut found);
        let Collected { mut states, mut parameters, subsystems, .. } = found;
        states.sort_unstable();
        parameters.sort_unstable();
        let is_whole = states.into_iter().eq(0..NS) && parameters.into_iter().eq(0..NP);
        (is_whole && !subsystems.is_empty()).then_some(Self { subsystems })
    }

    /// Eliminates the states of `blocks` in every subsystem; `reduced` loses their contributions.
    ///
    /// # Errors
    /// The damped matrix is not positive definite.
    pub(crate) fn eliminate(
        &mut self,
        blocks: &[Block<NS, NP>],
        damping: f64,
        reduced: &mut ReducedSystem<NP>,
    ) -> Result<(), NotPositive> {
        self.subsystems.iter_mut().try_for_each(|one| one.eliminate(blocks, damping, reduced))
    }

    /// Steps of the states that [`Partition::eliminate`] eliminated, all subsystems together.
    pub(crate) fn back_substitute(&self, p_step: &Vector<NP>, steps: &mut [Vector<NS>]) {
        self.subsystems.iter().for_each(|one| one.back_substitute(p_step, steps));
    }

    /// Covariance of state `last`; zero between subsystems.
    ///
    /// # Errors
    /// The reduced system is not positive definite.
    pub(crate) fn covariance(
        &self,
        last: usize,
        reduced: &ReducedSystem<NP>,
    ) -> Result<Matrix<NS, NS>, NotPositive> {
        let mut whole = Matrix::zeros();
        self.subsystems.iter().try_for_each(|one| one.put_covariance(last, reduced, &mut whole))?;
        Ok(whole)
    }

    /// Eliminates state `k`, the next of a long chain, in every subsystem.
    ///
    /// # Errors
    /// The damped matrix is not positive definite.
    #[inline]
    pub(crate) fn eliminate_state(
        &mut self,
        k: usize,
        block: &Block<NS, NP>,
        damping: f64,
    ) -> Result<(), NotPositive> {
        self.subsystems.iter_mut().try_for_each(|one| one.eliminate_state(k, block, damping))
    }

    /// The reduced system after [`Partition::eliminate_state`] of all states, `parameter_block` included.
    pub(crate) fn reduced(&self, parameter_block: &ReducedSystem<NP>) -> ReducedSystem<NP> {
        let mut reduced = ReducedSystem::zeros();
        self.subsystems.iter().for_each(|one| one.add_reduced(parameter_block, &mut reduced));
        reduced
    }

    /// Steps of the states that [`Partition::eliminate_state`] eliminated, all subsystems together.
    pub(crate) fn back_substitute_states(&self, p_step: &Vector<NP>, steps: &mut [Vector<NS>]) {
        self.subsystems.iter().for_each(|one| one.back_substitute_states(p_step, steps));
    }

    /// As [`marginalize`], subsystem by subsystem.
    ///
    /// # Errors
    /// The matrix is not positive definite.
    pub(crate) fn marginalize(
        &self,
        oldest: &OldestStep<NS, NP>,
    ) -> Result<Marginal<NS, NP>, NotPositive> {
        let mut whole = Marginal::zeros();
        self.subsystems.iter().try_for_each(|one| one.put_marginal(oldest, &mut whole))?;
        Ok(whole)
    }
}

/// Memory of an elimination: `W` of an undivided system, or the partition into subsystems.
#[derive(Debug, Clone)]
pub(crate) enum WholeOrPartition<W, const NS: usize, const NP: usize> {
    Whole(W),
    Partition(Partition<NS, NP>),
}

/// Collects the subsystems of a model.
struct Collected<const NS: usize, const NP: usize> {
    len_max: usize,
    states: Vec<usize>,
    parameters: Vec<usize>,
    subsystems: Vec<Box<dyn Eliminate<NS, NP>>>,
}

impl<const NS: usize, const NP: usize> VisitSubsystems for Collected<NS, NP> {
    fn visit<const S: usize, const P: usize>(
        &mut self,
        states: &'static [usize; S],
        _inputs: &'static [usize],
        parameters: &'static [usize; P],
    ) {
        self.states.extend(states);
        self.parameters.extend(parameters);
        let rows = Vec::with_capacity(self.len_max);
        let state_by_state = LongElimination::new(0);
        self.subsystems.push(Box::new(SubsystemElimination {
            states,
            parameters,
            rows,
            state_by_state,
        }));
    }
}

/// A subsystem of any size within a system of `NS` states and `NP` parameters. Each method does for one
/// subsystem what the method of [`Partition`] that calls it does for all.
trait Eliminate<const NS: usize, const NP: usize>: Debug + Send + Sync {
    fn eliminate(
        &mut self,
        blocks: &[Block<NS, NP>],
        damping: f64,
        reduced: &mut ReducedSystem<NP>,
    ) -> Result<(), NotPositive>;

    fn back_substitute(&self, p_step: &Vector<NP>, steps: &mut [Vector<NS>]);

    fn put_covariance(
        &self,
        last: usize,
        reduced: &ReducedSystem<NP>,
        whole: &mut Matrix<NS, NS>,
    ) -> Result<(), NotPositive>;

    fn eliminate_state(
        &mut self,
        k: usize,
        block: &Block<NS, NP>,
        damping: f64,
    ) -> Result<(), NotPositive>;

    fn add_reduced(&self, parameter_block: &ReducedSystem<NP>, reduced: &mut ReducedSystem<NP>);

    fn back_substitute_states(&self, p_step: &Vector<NP>, steps: &mut [Vector<NS>]);

    fn put_marginal(
        &self,
        oldest: &OldestStep<NS, NP>,
        whole: &mut Marginal<NS, NP>,
    ) -> Result<(), NotPositive>;

    fn boxed(&self) -> Box<dyn Eliminate<NS, NP>>;
}

impl<const NS: usize, const NP: usize> Clone for Box<dyn Eliminate<NS, NP>> {
    fn clone(&self) -> Self {
        self.boxed()
    }
}

/// Elimination of one decoupled subsystem.
#[derive(Debug, Clone)]
struct SubsystemElimination<const S: usize, const P: usize> {
    states: &'static [usize; S],
    parameters: &'static [usize; P],
    rows: Vec<Eliminated<S, P>>,
    /// Used instead of `rows` by a chain that is eliminated block by block.
    state_by_state: LongElimination<S, P>,
}

impl<const S: usize, const P: usize, const NS: usize, const NP: usize> Eliminate<NS, NP>
    for SubsystemElimination<S, P>
{
    fn eliminate(
        &mut self,
        blocks: &[Block<NS, NP>],
        damping: f64,
        reduced: &mut ReducedSystem<NP>,
    ) -> Result<(), NotPositive> {
        let mut parameter_block = self.reduced_system(reduced);
        let Self { states, parameters, rows, .. } = self;
        let own = blocks.iter().map(|block| of_block(block, states, parameters));
        eliminate(rows, own, damping, &mut parameter_block)?;
        self.put_reduced_system(&parameter_block, reduced);
        Ok(())
    }

    fn back_substitute(&self, p_step: &Vector<NP>, steps: &mut [Vector<NS>]) {
        let p_step = select_rows(p_step, self.parameters);
        back_substitute(&self.rows, &p_step, steps.len(), |k, step| {
            scatter(&step, self.states, &[0], &mut steps[k]);
        });
    }

    fn put_covariance(
        &self,
        last: usize,
        reduced: &ReducedSystem<NP>,
        whole: &mut Matrix<NS, NS>,
    ) -> Result<(), NotPositive> {
        let row = self.rows.get(last).ok_or(NotPositive)?;
        let covariance = row.covariance(&self.reduced_system(reduced).hessian)?;
        scatter(&covariance, self.states, self.states, whole);
        Ok(())
    }

    fn eliminate_state(
        &mut self,
        k: usize,
        block: &Block<NS, NP>,
        damping: f64,
    ) -> Result<(), NotPositive> {
        self.state_by_state.eliminate(k, &of_block(block, self.states, self.parameters), damping)
    }

    fn add_reduced(&self, parameter_block: &ReducedSystem<NP>, reduced: &mut ReducedSystem<NP>) {
        let mut own = self.reduced_system(parameter_block);
        own += self.state_by_state.reduced();
        self.put_reduced_system(&own, reduced);
    }

    fn back_substitute_states(&self, p_step: &Vector<NP>, steps: &mut [Vector<NS>]) {
        let p_step = select_rows(p_step, self.parameters);
        back_substitute(self.state_by_state.rows(), &p_step, steps.len(), |k, step| {
            scatter(&step, self.states, &[0], &mut steps[k]);
        });
    }

    fn put_marginal(
        &self,
        oldest: &OldestStep<NS, NP>,
        whole: &mut Marginal<NS, NP>,
    ) -> Result<(), NotPositive> {
        let Self { states, parameters, .. } = self;
        let forgetting = oldest.forgetting.as_ref().map(|Forgetting { factor, prior }| {
            Forgetting { factor: *factor, prior: self.reduced_system(prior) }
        });
        let marginal = marginalize(OldestStep {
            block: of_block(&oldest.block, states, parameters),
            next: of_block(&oldest.next, states, parameters),
            parameter_block: self.reduced_system(&oldest.parameter_block),
            forgetting,
        })?;
        scatter(&marginal.block.diagonal, states, states, &mut whole.block.diagonal);
        scatter(&marginal.block.border, states, parameters, &mut whole.block.border);
        self.put_reduced_system(&marginal.parameter_block, &mut whole.parameter_block);
        scatter(&marginal.s_step, states, &[0], &mut whole.s_step);
        scatter(&marginal.p_step, parameters, &[0], &mut whole.p_step);
        Ok(())
    }

    fn boxed(&self) -> Box<dyn Eliminate<NS, NP>> {
        Box::new(self.clone())
    }
}

impl<const S: usize, const P: usize> SubsystemElimination<S, P> {
    /// The rows of `whole` that belong to this subsystem, with zero decrease.
    fn reduced_system<const NP: usize>(&self, whole: &ReducedSystem<NP>) -> ReducedSystem<P> {
        ReducedSystem {
            hessian: submatrix(&whole.hessian, self.parameters, self.parameters),
            gradient: select_rows(&whole.gradient, self.parameters),
            decrease: 0.0,
        }
    }

    /// Writes the rows back and adds the decrease.
    fn put_reduced_system<const NP: usize>(
        &self,
        parameter_block: &ReducedSystem<P>,
        whole: &mut ReducedSystem<NP>,
    ) {
        scatter(&parameter_block.hessian, self.parameters, self.parameters, &mut whole.hessian);
        scatter(&parameter_block.gradient, self.parameters, &[0], &mut whole.gradient);
        whole.decrease += parameter_block.decrease;
    }
}

/// The rows of `whole` that belong to a subsystem.
#[inline]
fn of_block<const NS: usize, const NP: usize, const S: usize, const P: usize>(
    whole: &Block<NS, NP>,
    states: &[usize; S],
    parameters: &[usize; P],
) -> Block<S, P> {
    Block {
        diagonal: submatrix(&whole.diagonal, states, states),
        before: submatrix(&whole.before, states, states),
        border: submatrix(&whole.border, states, parameters),
        gradient: select_rows(&whole.gradient, states),
    }
}

#[cfg(test)]
mod tests;
