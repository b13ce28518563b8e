//! The bootstrap of a fit: which resamples are computed, and the result of all of them.

use anyhow::Result;
use horizon_estim::{DelayInfluence, Spread};
use horizon_model::Model;
use horizon_model::rows::{pose, stick};
use nalgebra::SVector;
use sha2::{Digest, Sha256};
use tello_io::clock::Clock;

use super::Identification;
use crate::REVISION;
use crate::ident::job::Resampled;
use crate::ident::report::Bootstrap;
use crate::ident::resamples::{BootstrapPlan, ResampleFile, ResampleRow, distinct};

impl<M, const NS: usize, const NP: usize> Identification<'_, M, NS, NP>
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP> + Send + Sync + 'static,
{
    /// Estimates of the resamples that are not in files yet, and the result of all of them.
    pub(super) fn bootstrap(
        &self,
        plan: &BootstrapPlan,
    ) -> Result<(Resampled, Option<(Bootstrap, Spread<NP>)>)> {
        let clock = Clock::start();
        let names = M::PARAMETER.map(|row| row.name.to_owned()).to_vec();
        let mut file = ResampleFile::gather(self.problem()?, names, plan)?;
        let missing = file.missing(plan);
        let observer = self.job.observer;
        observer.begin("bootstrap", Some(missing.len() as u64));
        let done = horizon_estim::bootstrap(
            &self.ident,
            plan.seed,
            &missing,
            &|| observer.is_stopped(),
            &|_| observer.advance(),
        )?;
        observer.end();
        let rows = done.iter().map(|resample| {
            ResampleRow::new(resample.index, resample.p.as_slice(), resample.cost, resample.stop)
        });
        file.add(rows);
        let asked = || file.resamples.iter().filter(|row| row.index < plan.resamples);
        let estimate = |row: &ResampleRow| {
            let p: SVector<f64, NP> = SVector::from_column_slice(&row.p);
            p + self.by_dead_times(plan.seed, row.index)
        };
        let estimates: Vec<SVector<f64, NP>> = asked().map(estimate).collect();
        let unconverged = asked().filter(|row| row.is_unconverged()).count();
        let is_cut_short = observer.is_stopped() && (estimates.len() as u64) < plan.resamples;
        // Each resample of one piece is that piece: no spread, which no interval of width 0 may stand for. Nor may the
        // few resamples before Ctrl-C stand for all.
        let spread = Spread::of(&estimates).filter(|_| self.spans.len() > 1 && !is_cut_short);
        let report = spread.map(|spread| {
            let correlation = spread.correlation.row_iter();
            let report = Bootstrap {
                resamples: estimates.len(),
                unconverged,
                distinct: distinct(plan.seed, asked().map(|row| row.index), self.spans.len()),
                asked: plan.resamples,
                seed: plan.seed,
                seconds: clock.now().seconds(),
                mean: spread.mean.iter().copied().collect(),
                correlation: correlation.map(|row| row.iter().copied().collect()).collect(),
            };
            (report, spread)
        });
        let estimates = estimates.iter().map(|p| p.iter().copied().collect()).collect();
        Ok((Resampled { file, estimates }, report))
    }

    /// Correction of a resample's estimate, to first order, for its dead times in place of those of all pieces.
    fn by_dead_times(&self, seed: u64, resample: u64) -> SVector<f64, NP> {
        let counts = horizon_estim::multiplicities(seed, resample, self.spans.len());
        let moved = |influence: &DelayInfluence<NP>| {
            let by_piece = influence.by_piece_s.iter().zip(&counts);
            let moved_s: f64 =
                by_piece.map(|(by_piece_s, count)| by_piece_s * (f64::from(*count) - 1.0)).sum();
            influence.parameter_by_dead_time * moved_s
        };
        self.influences.iter().map(moved).sum()
    }

    /// Hash of everything that a resample's estimate depends on beside its index and seed, the program included.
    fn problem(&self) -> Result<String> {
        let logs: Vec<&str> = self.job.logs.iter().map(|log| log.sha256.as_str()).collect();
        let dead_time_s: Vec<f64> = self.dead_time_s.iter().copied().collect();
        let mut table = self.job.table.clone();
        // These keys do not change an estimate: results of other values are taken up.
        (table.threads, table.logs, table.logs_max) = (0, Vec::new(), 0);
        table.clear_estimates = false;
        let settings = (table, dead_time_s, logs, REVISION);
        Ok(format!("{:x}", Sha256::digest(serde_json::to_vec(&settings)?)))
    }
}

#[cfg(test)]
mod tests;
