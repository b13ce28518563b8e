//! Estimates and residuals along the pieces of a fit, as rows of numbers.

use horizon_estim::Span;
use horizon_model::Model;
use horizon_model::rows::{pose, stick};
use nalgebra::SVector;
use rayon::iter::{IndexedParallelIterator, IntoParallelRefIterator, ParallelIterator};

use super::Identification;
use crate::ident::job::Trace;

impl<M, const NS: usize, const NP: usize> Identification<'_, M, NS, NP>
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP> + Send + Sync + 'static,
{
    /// The estimates along each piece.
    pub(super) fn traces(&self) -> Vec<Trace> {
        let trace = |(piece, span): (usize, &Span)| {
            let observed = &self.recordings[span.recording].o[span.steps.clone()];
            let mut observation_residuals = columns(&self.ident.observation_residuals(piece));
            for (row, residuals) in observation_residuals.iter_mut().enumerate() {
                for (residual, observed) in residuals.iter_mut().zip(observed) {
                    if !observed.is_present[row] {
                        *residual = f64::NAN;
                    }
                }
            }
            let (s, simulated, transition_residuals) = if self.job.keeps_estimates {
                let transition_residuals = self.ident.transition_residuals(piece);
                let simulated = self.simulated(piece, span);
                (columns(self.ident.states(piece)), simulated, columns(&transition_residuals))
            } else {
                (Vec::new(), Vec::new(), Vec::new())
            };
            let steps = span.steps.clone();
            Trace {
                log: span.recording,
                steps,
                s,
                simulated,
                transition_residuals,
                observation_residuals,
            }
        };
        self.spans.par_iter().enumerate().map(trace).collect()
    }

    /// Open-loop simulation of a piece: the observed rows from its first state and the applied inputs alone.
    fn simulated(&self, piece: usize, span: &Span) -> Vec<Vec<f64>> {
        let (p, dt_s) = (self.ident.parameter(), self.job.table.dt_s);
        let flight = &self.recordings[span.recording];
        let applied = flight.applied_during(span.steps.clone(), &self.dead_time_s, dt_s);
        let Some(mut s) = self.ident.states(piece).first().copied() else { return Vec::new() };
        let observed: Vec<_> = applied
            .iter()
            .map(|u| {
                let o = self.model.observe(&s);
                s = self.model.step(&s, u, p, dt_s);
                o
            })
            .collect();
        columns(&observed)
    }
}

/// Each row of vectors over time.
fn columns<const N: usize>(vectors: &[SVector<f64, N>]) -> Vec<Vec<f64>> {
    (0..N).map(|row| vectors.iter().map(|vector| vector[row]).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_the_rows_over_time() {
        let vectors = [[1.0, 10.0], [2.0, 20.0], [3.0, 30.0]].map(SVector::from);
        assert_eq!(columns(&vectors), [vec![1.0, 2.0, 3.0], vec![10.0, 20.0, 30.0]]);
        assert_eq!(columns::<2>(&[]), [Vec::<f64>::new(), Vec::new()]);
    }
}
