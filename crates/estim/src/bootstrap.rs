//! Bootstrap over pieces: how the estimate varies when the flights had been others.
//!
//! Owns the resampling, thesis section 5.1.2: pieces are drawn with replacement and the parameter is
//! identified again. What a piece is and how a parameter is found is `ident.rs`; what the estimates
//! amount to is `bootstrap/spread.rs`. It owns no files: shards of resamples are merged by the program that
//! collects them.

use horizon_model::{Model, Vector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rayon::prelude::*;

use crate::ident::Ident;
use crate::levenberg::{LmError, LmStop};

mod groups;
mod laplace;
mod spread;

pub use groups::group_deviations;
pub use laplace::{Laplace, standard_deviations};
pub(crate) use spread::interval_variance;
pub use spread::{NORMAL_HALF_WIDTH, Spread};

/// How often each of `pieces` pieces was drawn in a sample of as many, with replacement.
///
/// A function of its arguments alone: any process that computes resample 17 of a seed, alone or among others,
/// gets the same one. The values never change.
pub fn multiplicities(seed: u64, resample: u64, pieces: usize) -> Vec<u32> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    generator.set_stream(resample);
    let mut counts = vec![0; pieces];
    for _ in 0..pieces {
        // The high half of the product is uniform up to 2^-64 times the number of pieces.
        let wide = u128::from(generator.next_u64()) * pieces as u128;
        #[expect(clippy::cast_possible_truncation, reason = "less than `pieces`")]
        let drawn = (wide >> 64) as usize;
        counts[drawn] += 1;
    }
    counts
}

/// The estimate of one resample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resample<const NP: usize> {
    /// Number of the resample.
    pub index: u64,
    /// Parameter estimated from the resample. Unit of each row
    pub p: Vector<NP>,
    /// Cost of the resample at `p`. 1
    pub cost: f64,
    /// Why its solve stopped.
    pub stop: LmStop,
}

/// Identifies again with each of `resamples` of `seed`; results in the order of `resamples`.
///
/// `ident` is solved: every resample starts from its iterate, so that results depend neither on each
/// other nor on the number of threads, and the shards of a run merge to the same bits. Resamples run in
/// parallel in the current rayon pool, each thread on a clone of `ident`, and each solve on one thread.
///
/// Cost: each resample is a whole [`Ident::solve`], the most costly call of this library; the clones need the memory
/// of `ident` per thread.
///
/// `is_stopped` is polled once per iteration; what is not done when it becomes true is missing in the
/// result. `on_done` is called from the worker threads.
///
/// # Errors
/// A resample leads to where the model is not finite.
pub fn bootstrap<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
    ident: &Ident<M, NS, NU, NO, NP>,
    seed: u64,
    resamples: &[u64],
    is_stopped: &(dyn Fn() -> bool + Sync),
    on_done: &(dyn Fn(&Resample<NP>) + Sync),
) -> Result<Vec<Resample<NP>>, LmError>
where
    M: Model<NS, NU, NO, NP> + Send + Sync,
{
    let solve = |worker: &mut Ident<M, NS, NU, NO, NP>, index: u64| {
        if is_stopped() {
            return Ok(None);
        }
        worker.restart_at(ident);
        worker.set_multiplicities(&multiplicities(seed, index, ident.pieces()));
        let report = worker.solve(&mut || is_stopped())?;
        if report.stop == LmStop::Late {
            return Ok(None);
        }
        let p = *worker.parameter();
        let resample = Resample { index, p, cost: report.cost, stop: report.stop };
        on_done(&resample);
        Ok(Some(resample))
    };
    // A clone holds every state and costs as much as an iteration: few stripes, but enough of them to
    // keep every thread busy to the end.
    let stripe = resamples.len().div_ceil(4 * rayon::current_num_threads()).max(1);
    let done: Result<Vec<Vec<_>>, LmError> = resamples
        .par_chunks(stripe)
        .map(|stripe| {
            let mut worker = ident.clone();
            stripe.iter().filter_map(|index| solve(&mut worker, *index).transpose()).collect()
        })
        .collect();
    Ok(done?.concat())
}

#[cfg(test)]
mod tests;
