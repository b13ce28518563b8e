//! Identification: the parameter that explains any number of recorded pieces, thesis section 3.1.3.
//!
//! Owns the maximum a posteriori problem of thesis equation 3.39 over pieces with one common parameter:
//! settings, start, weights of pieces, solution and its Laplace approximation. One piece is
//! `ident/segment.rs`, the loop is `levenberg.rs`. Files, dead times and resampling live elsewhere.

mod builder;
mod contributions;
mod problem;
mod segment;
mod settings;
mod variable_projection;

use horizon_model::setting::{SettingError, positive};
use horizon_model::{Bounds, Matrix, Model, Vector};
use thiserror::Error;

use crate::cholesky::NotPositive;
use crate::levenberg::{self, IterateScale, LmError, LmSettings, SolveReport};
use crate::residual::{Curvature, Observed, Residuals};
use crate::window_problem::Prior;
pub use builder::IdentBuilder;
use segment::{Segment, Terms};
pub use settings::{IdentSettings, IdentTable};

/// Ratio from which on [`Ident::is_extreme`] holds. 1
const EXTREME: f64 = 1e4;

/// A stretch of a recording that is explained by itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Piece<const NU: usize, const NO: usize> {
    /// `u[k]` was applied from step `k` to `k + 1`. At least one fewer than `o`; what is beyond is ignored.
    /// Unit of each row
    pub u: Vec<Vector<NU>>,
    /// What was observed in step `k`; angle rows are continuous over time.
    pub o: Vec<Observed<NO>>,
}

/// Why a piece cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PieceError {
    /// The period of all of them.
    #[error(transparent)]
    Period(#[from] SettingError),
    /// There is no such piece.
    #[error("there is no piece {piece} among {pieces}")]
    Unknown {
        /// Position that was asked for.
        piece: usize,
        /// Number of pieces.
        pieces: usize,
    },
    /// There is nothing to explain: two observations are one step.
    #[error("piece {piece} has {steps} steps; it needs at least 2")]
    Short {
        /// Position among the pieces.
        piece: usize,
        /// How many observations it has.
        steps: usize,
    },
    /// There are not enough inputs for the observations.
    #[error("piece {piece} has {inputs} inputs for {steps} steps")]
    Inputs {
        /// Position among the pieces.
        piece: usize,
        /// How many inputs it has.
        inputs: usize,
        /// How many observations it has.
        steps: usize,
    },
    /// A number is not finite.
    #[error("{what} {k} of piece {piece} is not finite")]
    NonFinite {
        /// Position among the pieces.
        piece: usize,
        /// Step inside the piece.
        k: usize,
        /// `"input"` or `"observation"`.
        what: &'static str,
    },
}

/// A maximum a posteriori problem at its current iterate.
#[derive(Debug, Clone)]
pub struct Ident<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> {
    terms: Terms<M, NS, NU, NO, NP>,
    prior: Prior<NP>,
    curvature: Curvature,
    solver: LmSettings,
    segments: Vec<Segment<NS, NU, NO, NP>>,
    /// How often each segment counts.
    multiplicities: Vec<u32>,
    p: Vector<NP>,
    p_candidate: Vector<NP>,
    /// Cost at `p_candidate`. 1
    cost_candidate: f64,
    /// Cost and largest diagonal entry at the iterate of the running solve. The derivatives are formed where
    /// they are eliminated.
    known: Option<IterateScale>,
    /// Whether the exact curvature is to be trusted here.
    is_near: bool,
    /// Whether the candidate is neither accepted nor rejected yet.
    is_tried: bool,
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> Ident<M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP> + Sync,
{
    /// The period. s
    pub fn dt_s(&self) -> f64 {
        self.terms.residuals.dt_s
    }

    /// The problem over `pieces`, each counting once, started. `dt_s` is the period. s, > 0
    ///
    /// Allocates; linear in the length of the pieces.
    ///
    /// # Errors
    /// `dt_s` is not positive; a piece is too short, lacks inputs or has a number that is not finite.
    pub fn new(
        model: M,
        settings: &IdentSettings<NS, NO, NP>,
        dt_s: f64,
        pieces: Vec<Piece<NU, NO>>,
    ) -> Result<Self, PieceError> {
        let mut segments = Vec::with_capacity(pieces.len());
        for (piece, Piece { mut u, o }) in pieces.into_iter().enumerate() {
            if o.len() < 2 {
                return Err(PieceError::Short { piece, steps: o.len() });
            }
            check_inputs(piece, &u, o.len())?;
            if let Some(k) = o.iter().position(|observed| !observed.is_finite()) {
                return Err(PieceError::NonFinite { piece, k, what: "observation" });
            }
            u.truncate(o.len() - 1);
            segments.push(Segment::new(&model, u, o));
        }
        let residuals = Residuals {
            model,
            dt_s: positive("dt_s", dt_s)?,
            c_o: settings.c_o,
            c_s: settings.c_s,
            observation_loss: settings.observation_loss,
            transition_loss: settings.transition_loss,
        };
        let p = settings.prior.p_prior;
        let mut ident = Self {
            terms: Terms { residuals, c_0: settings.c_0 },
            prior: settings.prior,
            curvature: settings.curvature,
            solver: settings.solver,
            multiplicities: vec![1; segments.len()],
            segments,
            p,
            p_candidate: p,
            known: None,
            cost_candidate: f64::NAN,
            is_near: false,
            is_tried: false,
        };
        ident.start();
        Ok(ident)
    }

    /// Starts again: the prior parameter; observed rows of a state where they were observed, the
    /// others as the model rolls them out from rest. Pieces and settings stay. Linear in the length of the pieces.
    pub fn start(&mut self) {
        self.p = self.prior.p_prior;
        self.is_near = false;
        let Residuals { model, dt_s, .. } = &self.terms.residuals;
        for segment in &mut self.segments {
            segment.start(model, &self.p, *dt_s);
        }
    }

    /// Starts again at the parameter `p`, each piece with the best states for it. Linear in the length of the pieces.
    pub fn start_at(&mut self, p: &Vector<NP>) {
        self.start();
        self.p = *p;
        self.known = None;
        self.reoptimize_states();
    }

    /// Starts from the iterate of `other`, a clone of this identification: only iterates are copied. Linear in the
    /// number of steps.
    pub(crate) fn restart_at(&mut self, other: &Self) {
        debug_assert_eq!(self.segments.len(), other.segments.len(), "other pieces");
        self.p = other.p;
        self.is_near = true;
        for (segment, other) in self.segments.iter_mut().zip(&other.segments) {
            segment.s.clone_from(&other.s);
        }
    }

    /// Replaces the applied inputs in a piece; the iterate stays.
    ///
    /// # Errors
    /// There is no such piece, there are too few inputs, or one is not finite; nothing is replaced.
    pub(crate) fn set_inputs(&mut self, piece: usize, u: &[Vector<NU>]) -> Result<(), PieceError> {
        let pieces = self.segments.len();
        let Some(segment) = self.segments.get_mut(piece) else {
            return Err(PieceError::Unknown { piece, pieces });
        };
        check_inputs(piece, u, segment.o.len())?;
        segment.u.copy_from_slice(&u[..segment.o.len() - 1]);
        Ok(())
    }

    /// Sets how often each piece counts; one that counts 0 times is left out and costs no time.
    ///
    /// A piece that counts twice is the same as the piece given twice. Pieces beyond the end of
    /// `multiplicities` keep theirs.
    pub(crate) fn set_multiplicities(&mut self, multiplicities: &[u32]) {
        for (own, new) in self.multiplicities.iter_mut().zip(multiplicities) {
            *own = *new;
        }
    }

    /// Minimizes from the current iterate; the best iterate found is left.
    ///
    /// `is_late` is polled once per iteration. Pieces are shared out over the threads of the current
    /// rayon pool and summed in their order: the result has the same bits with any number of threads.
    /// Cost per iteration: linear in the number of steps.
    ///
    /// # Errors
    /// A residual or a derivative is not finite at the current iterate.
    pub fn solve(&mut self, is_late: &mut dyn FnMut() -> bool) -> Result<SolveReport, LmError> {
        let solver = self.solver;
        self.known = None;
        if !self.is_near {
            self.reoptimize_states();
        }
        levenberg::solve(self, &solver, is_late)
    }

    /// Solves as [`Ident::solve`] does from an iterate near the minimum: with less damping, and with a cost tolerance
    /// that depends on that of the settings.
    ///
    /// # Errors
    /// As [`Ident::solve`].
    pub(crate) fn solve_near(
        &mut self,
        cost_tolerance: fn(f64) -> f64,
        is_late: &mut dyn FnMut() -> bool,
    ) -> Result<SolveReport, LmError> {
        let far = self.solver;
        self.solver = far.near(cost_tolerance(far.cost_tolerance()));
        let report = self.solve(is_late);
        self.solver = far;
        report
    }

    /// The parameter: NP rows in the units of [`Model::PARAMETER`], the prior before the first solve.
    pub fn parameter(&self) -> &Vector<NP> {
        &self.p
    }

    /// Whether a row of the parameter lies at an end of its box that is no point, or [`EXTREME`] times as far from its
    /// prior as that is large.
    pub(crate) fn is_extreme(&self) -> bool {
        let Prior { p_prior, bounds: Bounds { lo, hi }, .. } = &self.prior;
        (0..NP).any(|row| {
            let is_inside = lo[row] < self.p[row] && self.p[row] < hi[row];
            let is_near =
                (self.p[row] - p_prior[row]).abs() < EXTREME * p_prior[row].abs().max(1.0);
            lo[row] < hi[row] && !(is_inside && is_near)
        })
    }

    /// How many pieces there are, left out ones included.
    pub fn pieces(&self) -> usize {
        self.segments.len()
    }

    /// The states of a piece, one for each observation: NS rows in the units of [`Model::STATE`].
    ///
    /// # Panics
    /// There are fewer than `piece + 1` [`pieces`](Self::pieces).
    pub fn states(&self, piece: usize) -> &[Vector<NS>] {
        &self.segments[piece].s
    }

    /// `C_s (f(s, u, p) - s_next) / dt` of each step of a piece, without loss: NS rows, one vector fewer than
    /// observations. 1
    ///
    /// # Panics
    /// There are fewer than `piece + 1` [`pieces`](Self::pieces).
    pub fn transition_residuals(&self, piece: usize) -> Vec<Vector<NS>> {
        let Segment { s, u, .. } = &self.segments[piece];
        let pairs = s.iter().zip(s.iter().skip(1)).zip(u);
        pairs.map(|((s, next), u)| self.terms.residuals.transition(s, next, u, &self.p)).collect()
    }

    /// `C_o (o - g(s))` of each observation of a piece, zero in absent rows, without loss: NO rows. 1
    ///
    /// # Panics
    /// There are fewer than `piece + 1` [`pieces`](Self::pieces).
    pub fn observation_residuals(&self, piece: usize) -> Vec<Vector<NO>> {
        let Segment { s, o, .. } = &self.segments[piece];
        s.iter().zip(o).map(|(s, o)| self.terms.residuals.observation(s, o)).collect()
    }

    /// Information on the parameter at the iterate: the Schur complement on `p` of the second
    /// derivative of the cost, prior included, bounds not. Its inverse is the covariance of Laplace's
    /// approximation.
    ///
    /// With [`Curvature::GaussNewton`] the second derivative is that without residuals, which is too
    /// large where these are.
    ///
    /// # Errors
    /// The matrix of the states is not positive definite: this is no minimum.
    pub fn information(&self) -> Result<Matrix<NP, NP>, NotPositive> {
        Ok(self.information_of(&self.piece_reduced_systems()?))
    }
}

/// Whether `u` suffices for a piece of `steps` observations.
fn check_inputs<const NU: usize>(
    piece: usize,
    u: &[Vector<NU>],
    steps: usize,
) -> Result<(), PieceError> {
    if u.len() + 1 < steps {
        return Err(PieceError::Inputs { piece, inputs: u.len(), steps });
    }
    let is_broken = |u: &Vector<NU>| !u.iter().all(|row| row.is_finite());
    match u[..steps - 1].iter().position(is_broken) {
        Some(k) => Err(PieceError::NonFinite { piece, k, what: "input" }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests;
