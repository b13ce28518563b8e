//! Whether reported intervals have their nominal coverage, on data with a known truth.
//!
//! Owns the tally over many identifications. Where the data come from, and how they are identified, is
//! the caller's.

use std::ops::Range;

use horizon_model::{Model, Vector};
use rayon::prelude::*;
use thiserror::Error;

use super::{Laplace, Spread, bootstrap};
use crate::cholesky::NotPositive;
use crate::ident::Ident;
use crate::levenberg::LmError;

/// What makes a trial impossible.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub(super) enum TrialError {
    /// A resample leads to where the model is not finite.
    #[error(transparent)]
    Solve(#[from] LmError),
    /// Neither data nor prior determine some parameter.
    #[error(transparent)]
    NotPositive(#[from] NotPositive),
}

/// One identification of data whose truth is known, with the uncertainty that it claims. Rows are those of the
/// parameter, in its units.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Trial<const NP: usize> {
    /// Estimate minus truth. Unit of each row
    pub(super) error: Vector<NP>,
    /// What each method claims, by name.
    pub(super) claims: Vec<Claim<NP>>,
}

/// What one method claims of an estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Claim<const NP: usize> {
    /// Name of the method: `plain`, `scaled` and `clustered` as in [`Laplace`], or `bootstrap`.
    pub(super) method: &'static str,
    /// Standard deviation. Unit of each row
    pub(super) std: Vector<NP>,
    /// Whether its 95 % interval contains the truth.
    pub(super) holds: [bool; NP],
}

impl<const NP: usize> Trial<NP> {
    /// The trial of `ident`, which is solved, against the true parameter `truth`, in the units of its rows. The
    /// bootstrap takes part if there are at least two `resamples`.
    ///
    /// Cost: one identification for each of the `resamples`. Allocates.
    ///
    /// # Errors
    /// A covariance does not exist, or a resample cannot be solved.
    pub(super) fn new<M, const NS: usize, const NU: usize, const NO: usize>(
        ident: &mut Ident<M, NS, NU, NO, NP>,
        truth: &Vector<NP>,
        seed: u64,
        resamples: u64,
    ) -> Result<Self, TrialError>
    where
        M: Model<NS, NU, NO, NP> + Send + Sync,
    {
        let p = *ident.parameter();
        let laplace = Laplace::of(ident)?;
        let claim = |method, spread: &Spread<NP>| Claim {
            method,
            std: spread.std,
            holds: spread.contains(truth),
        };
        let mut claims = vec![
            claim("plain", &Spread::normal(&p, &laplace.plain)),
            claim("scaled", &Spread::normal(&p, &laplace.scaled)),
            claim("clustered", &Spread::normal(&p, &laplace.clustered)),
        ];
        let resamples: Vec<u64> = (0..resamples).collect();
        let resamples = bootstrap(ident, seed, &resamples, &|| false, &|_| ())?;
        let estimates: Vec<_> = resamples.iter().map(|resample| resample.p).collect();
        claims.extend(Spread::of(&estimates).map(|spread| claim("bootstrap", &spread)));
        Ok(Self { error: p - truth, claims })
    }
}

/// What many trials amount to, row by row in the units of the parameter.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Calibration<const NP: usize> {
    /// Number of trials.
    pub(super) runs: usize,
    /// Mean of the errors: what is systematic in them. Unit of each row
    pub(super) bias: Vector<NP>,
    /// Standard deviation of the errors: what each method tries to tell. Unit of each row
    pub(super) std: Vector<NP>,
    /// How each method did, in the order of the trials' claims.
    pub(super) methods: Vec<Coverage<NP>>,
}

/// How well one method knows the error of an estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Coverage<const NP: usize> {
    /// Name of the method, see [`Claim::method`].
    pub(super) method: &'static str,
    /// Root mean square of the standard deviations that it claimed. Unit of each row
    pub(super) std: Vector<NP>,
    /// Fraction of the trials whose 95 % interval contains the truth. 1, 0..=1
    pub(super) fraction: Vector<NP>,
}

/// Runs `trial` for each seed, in parallel, and counts; `None` for fewer than two seeds.
///
/// # Errors
/// The first error of a trial, by seed.
pub(super) fn calibrate<const NP: usize, E: Send>(
    seeds: Range<u64>,
    trial: impl Fn(u64) -> Result<Trial<NP>, E> + Send + Sync,
) -> Result<Option<Calibration<NP>>, E> {
    let trials: Vec<Result<Trial<NP>, E>> = seeds.into_par_iter().map(trial).collect();
    let trials = trials.into_iter().collect::<Result<Vec<_>, E>>()?;
    let errors: Vec<_> = trials.iter().map(|trial| trial.error).collect();
    let Some(spread) = Spread::of(&errors) else { return Ok(None) };
    let runs = trials.len() as f64;
    let mut methods: Vec<Coverage<NP>> = Vec::new();
    for claim in trials.iter().flat_map(|trial| &trial.claims) {
        let known = methods.iter().position(|coverage| coverage.method == claim.method);
        let at = known.unwrap_or_else(|| {
            let (std, fraction) = (Vector::zeros(), Vector::zeros());
            methods.push(Coverage { method: claim.method, std, fraction });
            methods.len() - 1
        });
        methods[at].std += claim.std.component_mul(&claim.std) / runs;
        methods[at].fraction +=
            Vector::from(claim.holds.map(|holds| f64::from(u8::from(holds)))) / runs;
    }
    for coverage in &mut methods {
        coverage.std.apply(|square| *square = square.sqrt());
    }
    Ok(Some(Calibration { runs: trials.len(), bias: spread.mean, std: spread.std, methods }))
}

#[cfg(test)]
mod tests;
