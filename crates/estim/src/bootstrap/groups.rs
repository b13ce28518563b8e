//! Groups of pieces, as those of one flight, that contradict the other groups.

use horizon_model::{Matrix, Model, Vector};

use super::interval_variance;
use super::laplace::inverse;
use crate::cholesky::NotPositive;
use crate::ident::Ident;

/// How far each of `groups` of pieces pulls each row of the parameter from the others, in standard deviations of this
/// pull if one parameter were right for all. 1; NaN for a row on which it has no information
///
/// A group moves the estimate to first order by the sum of the `-H^-1 g_i` of its pieces, symbols as of
/// [`Laplace`](crate::Laplace). With its information `I` the variance of this is `A - A H A`, `A = H^-1 I H^-1`, times
/// the residual variance if that exceeds 1; or, if it is more, the scatter of its pieces around their parts of it.
/// `ident` is solved. Costs as much as an iteration.
///
/// # Errors
/// A parameter that neither data nor prior determine.
///
/// # Panics
/// A group names a piece that `ident` does not have.
pub fn group_deviations<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
    ident: &Ident<M, NS, NU, NO, NP>,
    groups: &[Vec<usize>],
) -> Result<Vec<Vector<NP>>, NotPositive>
where
    M: Model<NS, NU, NO, NP> + Sync,
{
    let systems = ident.piece_reduced_systems()?;
    let hessian = ident.information_of(&systems);
    let covariance = inverse(&hessian)?;
    let cost: f64 = systems.iter().map(|(_, cost)| cost).sum();
    let variance = interval_variance(2.0 * cost / ident.degrees_of_freedom());
    let pulls: Vec<Pull<NP>> = systems
        .iter()
        .map(|(system, _)| Pull {
            by: -covariance * system.gradient,
            known: covariance * system.hessian * covariance,
        })
        .collect();
    let of_all = Pull::sum(pulls.iter());
    let deviations = |pieces: &Vec<usize>| {
        let of_group = || pieces.iter().map(|piece| &pulls[*piece]);
        let group = Pull::sum(of_group());
        let by_weights = (group.known - group.known * hessian * group.known) * variance;
        let count = pieces.len() as f64;
        Vector::from_fn(|row, _| {
            let scatter: f64 = of_group().map(|piece| piece.beyond_part(&group, row).powi(2)).sum();
            let by_scatter = scatter * count / (count - 1.0).max(1.0);
            // The sum over all groups is what the prior pulls.
            group.beyond_part(&of_all, row) / by_weights[(row, row)].max(by_scatter).sqrt()
        })
    };
    Ok(groups.iter().map(deviations).collect())
}

/// What pieces do to the estimate to first order.
struct Pull<const NP: usize> {
    /// `-H^-1 g`. Unit of the row
    by: Vector<NP>,
    /// `H^-1 I H^-1`, its covariance. Product of the units of row and column
    known: Matrix<NP, NP>,
}

impl<const NP: usize> Pull<NP> {
    fn sum<'a>(pulls: impl Iterator<Item = &'a Self>) -> Self {
        let none = Self { by: Vector::zeros(), known: Matrix::zeros() };
        pulls.fold(none, |sum, pull| Self { by: sum.by + pull.by, known: sum.known + pull.known })
    }

    /// What is more than the part of `whole` by the information on `row`. Unit of the row
    fn beyond_part(&self, whole: &Self, row: usize) -> f64 {
        self.by[row] - self.known[(row, row)] / whole.known[(row, row)] * whole.by[row]
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::Kinematic;
    use horizon_model::rows::gain;

    use super::super::tests::{pieces_of, solved};
    use super::*;

    #[test]
    fn a_group_with_another_gain_stands_out_from_groups_that_agree() {
        let groups = [vec![0, 1, 2, 3], vec![4, 5, 6, 7], vec![8, 9, 10, 11]];
        let deviations = |lambda_h_of_last: f64| {
            // Noise in the parameter of each piece: the pieces do not agree by chance.
            let ident = solved(pieces_of(|piece| {
                let mut p = Vector::from([1.0, 0.5, 0.9, 0.0]);
                p[gain::LAMBDA_H] = if piece < 8 { 1.0 } else { lambda_h_of_last };
                p.map(|p| p + 0.02 * (3.7 * piece as f64).sin())
            }));
            group_deviations::<Kinematic, 4, 4, 4, 4>(&ident, &groups).unwrap()
        };
        for of_group in deviations(1.0) {
            assert!(of_group.iter().all(|deviation| deviation.abs() < 4.0), "{of_group}");
        }
        let apart = deviations(9.0);
        assert!(apart[2][gain::LAMBDA_H] > 4.0, "{}", apart[2]);
        assert!(apart[0][gain::LAMBDA_H] < 0.0 && apart[1][gain::LAMBDA_H] < 0.0, "{apart:?}");
        assert!(apart[2][gain::LAMBDA_V].abs() < 4.0, "{}", apart[2]);
    }
}
