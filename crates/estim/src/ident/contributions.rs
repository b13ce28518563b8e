//! The contribution of each piece to cost, gradient and information at the common iterate.

use horizon_model::{Matrix, Model, Vector};
use rayon::prelude::*;

use super::Ident;
use super::segment::Segment;
use crate::cholesky::NotPositive;
use crate::product::tr_mul;
use crate::reduced_system::ReducedSystem;
use crate::residual::{Iterate, Residuals};

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> Ident<M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP> + Sync,
{
    /// Gradient and curvature of the cost of each piece by the parameter at the iterate, its states
    /// following, and the cost; each piece counted once, prior and bounds left out. One pair for each
    /// piece: a system of NP rows in the units of [`ReducedSystem`], and the cost. 1
    ///
    /// # Errors
    /// The matrix of the states of a piece is not positive definite.
    pub(crate) fn piece_reduced_systems(
        &self,
    ) -> Result<Vec<(ReducedSystem<NP>, f64)>, NotPositive> {
        let Self { terms, p, curvature, segments, .. } = self;
        segments.par_iter().map(|segment| segment.reduced_system(terms, p, *curvature)).collect()
    }

    /// [`Ident::information`] from the reduced systems of all pieces at the iterate.
    pub(crate) fn information_of(
        &self,
        reduced_systems: &[(ReducedSystem<NP>, f64)],
    ) -> Matrix<NP, NP> {
        let mut sum = self.prior_information();
        for ((parameter_block, _), count) in reduced_systems.iter().zip(&self.multiplicities) {
            sum += parameter_block.hessian * f64::from(*count);
        }
        sum
    }

    /// Hessian of the prior's cost, `diag(C_p)^2`. One over the product of the units of row and column
    pub(crate) fn prior_information(&self) -> Matrix<NP, NP> {
        self.prior.information()
    }

    /// Cost of each piece at the iterate, counted once, without prior. 1
    pub(crate) fn piece_costs(&self) -> Vec<f64> {
        let cost = |Segment { s, u, o, s_rest, .. }: &Segment<NS, NU, NO, NP>| {
            self.terms.cost(&Iterate { s, u, o, p: &self.p }, s_rest)
        };
        self.segments.par_iter().map(cost).collect()
    }

    /// Derivative of the cost of a piece, counted once, by the input of each of its steps. States and
    /// parameter are held; at a minimum it makes no difference whether they follow. One vector of NU rows
    /// for each step. 1 / unit of the row
    pub(crate) fn input_gradient(&self, piece: usize) -> Vec<Vector<NU>> {
        let Segment { s, u, .. } = &self.segments[piece];
        let Residuals { model, dt_s, transition_loss, .. } = &self.terms.residuals;
        let weight = self.terms.residuals.transition_weight();
        let residuals = self.transition_residuals(piece);
        let steps = s.iter().zip(u).zip(&residuals);
        let gradient = |((s, u), r): ((&Vector<NS>, &Vector<NU>), &Vector<NS>)| {
            let by_next =
                r.component_mul(&weight) * transition_loss.at(r.norm_squared()).derivative;
            tr_mul(&model.step_by_input(s, u, &self.p, *dt_s), &by_next)
        };
        steps.map(gradient).collect()
    }

    /// How often each piece counts in the cost, by piece: 1 without a resample, else the number of its draws.
    pub fn multiplicities(&self) -> &[u32] {
        &self.multiplicities
    }

    /// Residuals less unknowns, pieces by their multiplicity, the prior on the parameter not counted. Rows without
    /// weight are no residuals.
    ///
    /// Twice the cost over this is the mean square of what a residual would be with nothing fitted:
    /// 1 where weights are inverse deviations of independent residuals.
    pub(crate) fn degrees_of_freedom(&self) -> f64 {
        // K + 1 states are NS (K + 1) unknowns, and K transitions NS K residuals: together minus NS.
        let c_o = &self.terms.residuals.c_o;
        let held = self.terms.c_0.iter().filter(|weight| **weight > 0.0).count() as f64;
        let of_piece = |(segment, count): (&Segment<NS, NU, NO, NP>, &u32)| {
            let present = |observed: &crate::residual::Observed<NO>| {
                let rows = observed.is_present.iter().zip(c_o);
                rows.filter(|(is_present, weight)| **is_present && **weight > 0.0).count()
            };
            let observations = segment.o.iter().map(present).sum::<usize>() as f64;
            f64::from(*count) * (observations + held - NS as f64)
        };
        let pieces = self.segments.iter().zip(&self.multiplicities);
        pieces.map(of_piece).sum::<f64>() - NP as f64
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::Kinematic;
    use horizon_model::rows::{Pose, Sticks};
    use horizon_model::{Matrix, Vector};

    use super::*;
    use crate::ident::{IdentSettings, Piece};
    use crate::loss::LossTable;
    use crate::residual::Observed;

    /// Two pieces away from the minimum, their residuals on both sides of the loss's scale.
    fn ident() -> Ident<Kinematic, 4, 4, 4, 4> {
        let wave = |k: usize, at: f64| (1.3 * k as f64 + at).sin();
        let piece = |number: usize| Piece {
            u: (0..5).map(|k| Sticks::from_fn(|row, _| wave(k + number, row as f64))).collect(),
            o: (0..6)
                .map(|k| Observed::full(Pose::from_fn(|row, _| 0.05 * wave(k, row as f64))))
                .collect(),
        };
        let settings = IdentSettings::builder([1.0, 0.6, 0.8, 0.1])
            .c_o([30.0; 4])
            .c_s([0.5; 4])
            .c_p([3.0; 4])
            .bounds([-9.0; 4], [9.0; 4])
            .losses(LossTable::None {}, LossTable::Huber { scale: 2.45 });
        let settings = settings.build(&Kinematic).unwrap();
        Ident::new(Kinematic, &settings, 0.02, vec![piece(0), piece(3)]).unwrap()
    }

    #[test]
    fn the_gradient_by_the_inputs_meets_its_numeric_twin() {
        let ident = ident();
        let norms = ident.transition_residuals(1).into_iter().map(|r| r.norm());
        let (near, far): (Vec<_>, Vec<_>) = norms.partition(|norm| *norm < 2.45);
        assert!(!near.is_empty() && !far.is_empty(), "{near:?}, {far:?}");
        for (k, gradient) in ident.input_gradient(1).iter().enumerate() {
            for row in 0..4 {
                let [there, back] = [1e-5, -1e-5].map(|aside| {
                    let mut moved = ident.clone();
                    let mut u = moved.segments[1].u.clone();
                    u[k][row] += aside;
                    moved.set_inputs(1, &u).unwrap();
                    moved.piece_costs()[1]
                });
                let numeric = (there - back) / 2e-5;
                let gap = (gradient[row] - numeric).abs();
                assert!(gap < 1e-7, "input {k}, row {row}: {} and {numeric}", gradient[row]);
            }
        }
    }

    #[test]
    fn what_the_pieces_cost_and_know_adds_up_to_the_problem() {
        let mut ident = ident();
        ident.set_multiplicities(&[2, 1]);
        let systems = ident.piece_reduced_systems().unwrap();
        for ((_, cost), alone) in systems.iter().zip(ident.piece_costs()) {
            assert!((cost / alone - 1.0).abs() < 1e-12, "{cost} and {alone}");
        }
        let c_p = ident.prior.c_p;
        let prior = Matrix::from_diagonal(&c_p.component_mul(&c_p));
        let sum = systems[0].0.hessian * 2.0 + systems[1].0.hessian + prior;
        let gap = (ident.information_of(&systems) - sum).norm() / sum.norm();
        assert!(gap < 1e-14, "gap {gap:e}");
    }

    #[test]
    fn absent_rows_and_free_first_states_are_no_degrees_of_freedom() {
        let mut ident = ident();
        // Six poses of four rows, less the first state of four rows, twice; less four parameters.
        let of = |ident: &Ident<Kinematic, 4, 4, 4, 4>| ident.degrees_of_freedom();
        assert!((of(&ident) - (2.0 * 20.0 - 4.0)).abs() <= 0.0);
        ident.segments[0].o[2].is_present = [true, false, false, true];
        assert!((of(&ident) - (38.0 - 4.0)).abs() <= 0.0);
        ident.set_multiplicities(&[3, 0]);
        assert!((of(&ident) - (3.0 * 18.0 - 4.0)).abs() <= 0.0);
        // A weight on a row of the first state is a residual more.
        ident.terms.c_0 = Vector::from([0.5, 0.0, 0.0, 1.0]);
        assert!((of(&ident) - (3.0 * 20.0 - 4.0)).abs() <= 0.0);
        // A row of all observations without weight is none: height, present in five of the piece's six.
        ident.terms.residuals.c_o[2] = 0.0;
        assert!((of(&ident) - (3.0 * 15.0 - 4.0)).abs() <= 0.0);
    }
}
