//! Dead time of each group of inputs, by the likelihood itself.
//!
//! Owns the profile of the identification's cost over the dead time: parameters and states are found
//! anew for every candidate. All candidates explain the same steps, so that their costs compare.
//! How an input is delayed is [`Recording::applied`], what explains a step is `ident.rs`.
//!
//! An input that is held over its period and acts `whole + fraction` periods later is the older one for the
//! `fraction` of a period: its average over the period is exactly the linear interpolation between steps. The
//! cost is therefore smooth between whole steps, with a small jump of the gradient there that grows with how
//! abruptly the inputs move, and favours no fraction.
//!
//! At a minimum over states and parameter the gradient of the profile is that of the cost itself, so one
//! solve yields the gradients for all groups. They hardly depend on each other; all groups move at once.

mod coordinate_descent;
mod descent;
mod profile;
mod scan;
mod search;
mod settings;

use std::borrow::Cow;
use std::ops::Range;

use horizon_model::{Matrix, Model, Vector};
use thiserror::Error;

use crate::ident::{Ident, Piece, PieceError};
use crate::levenberg::LmError;
use crate::recording::Recording;
use search::{Search, SearchStop};
pub use settings::{DelaySettings, DelayTable};

/// A stretch of a recording that is one piece of the identification.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Span {
    /// Position of the recording.
    pub recording: usize,
    /// Steps of the recording.
    pub steps: Range<usize>,
}

/// The pieces of an identification as stretches of recordings: what can be delayed anew.
#[derive(Debug, Clone, Copy)]
pub struct Flights<'a, const NU: usize, const NO: usize> {
    /// Recorded flights.
    pub recordings: &'a [Cow<'a, Recording<NU, NO>>],
    /// The pieces, in their order.
    pub spans: &'a [Span],
    /// Period. s, > 0
    pub dt_s: f64,
}

/// What makes a delay search impossible.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum DelayError {
    /// The spans are not the pieces of the identification.
    #[error(transparent)]
    Piece(#[from] PieceError),
    /// The model is not finite where a candidate leads.
    #[error(transparent)]
    Solve(#[from] LmError),
    /// A group names a row that no input has.
    #[error("input row {row}: expected 0..={}", inputs - 1)]
    Row {
        /// The row.
        row: usize,
        /// Number of inputs.
        inputs: usize,
    },
    /// The recordings have another period than the identification.
    #[error(
        "the recordings have a period of {recordings_s} s, the identification one of {ident_s} s"
    )]
    Period {
        /// Period of the recordings. s
        recordings_s: f64,
        /// Period of the identification. s
        ident_s: f64,
    },
    /// A dead time to start from is not finite, or negative.
    #[error("dead time {0} s of the start: expected finite, >= 0")]
    Start(f64),
}

/// A point of a profile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProfilePoint {
    /// Dead time of the group. s
    pub dead_time_s: f64,
    /// What it costs, or costs more than the minimum. 1
    pub cost: f64,
}

/// Profile of the cost over the dead time of one group of inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct DelayProfile<const NP: usize> {
    /// Input rows of the group.
    pub rows: Vec<usize>,
    /// Points by ascending dead time: the candidates and the minimum between them. Costs are differences to the
    /// minimum, integrated from gradients with all groups shifted together. The curve ends where the cost is far
    /// above the minimum. s, 1
    pub curve: Vec<ProfilePoint>,
    /// Where the cost is least, the other groups at their best; where the search started unless there
    /// is a minimum, inside of the range or at zero. s
    pub dead_time_s: f64,
    /// Standard deviation and interval; `None` unless there is a minimum, inside of the range or at zero.
    pub spread: Option<DelaySpread>,
    /// What an error of the dead time does to the parameter; `None` unless there is a minimum.
    pub influence: Option<DelayInfluence<NP>>,
    /// Effect on the parameter of what the profile leaves open; `None` at a minimum and at the end of the range.
    pub undecided: Option<UndecidedDelay<NP>>,
    /// Whether there is a minimum.
    pub verdict: DelayVerdict,
}

/// Judgement of a dead time by its likelihood.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DelayVerdict {
    /// The profile has a minimum inside of the range and rises from there to both sides by more than chance.
    Minimum,
    /// The profile is least within a period of zero and rises above by more than chance: the vehicle has no dead time,
    /// a bound of physics. The interval begins at zero and ends where the profile has risen so far.
    Zero,
    /// The profile is least within a period of the upper end of the searched range, below which it is higher by more
    /// than chance.
    EndOfRange,
    /// The profile is flatter than chance on one side at least: the likelihood does not decide. Or the solves at other
    /// dead times ended higher than that of the start.
    Undecided,
}

/// Uncertainty of a dead time.
///
/// With `J` the profile over the dead time `D` and `J_i` the contribution of piece `i` to it, curvature and
/// gradients are differences over one period to either side. With `n` < 10 pieces, whose gradients add up to zero,
/// `std_s` is multiplied by `sqrt(n / (n - 1))` and is at least `sqrt(max(1, 2 J / dof) / J'')`, with the degrees of
/// freedom `dof`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DelaySpread {
    /// `sqrt(sum of J_i'^2) / J''`: right if the pieces are independent, whatever the residuals inside
    /// are and however they are weighted. s
    pub std_s: f64,
    /// `sqrt(2 J / dof / J'')`: right if every residual is independent and the weights have the right
    /// ratios. s
    pub std_white_s: f64,
    /// Lower end of the 95 % interval by `std_s`, >= 0. s
    pub lower_s: f64,
    /// Upper end. s
    pub upper_s: f64,
}

/// First-order sensitivity of a dead time to the pieces, and of the parameter to the dead time.
///
/// Gains and lags of an axis are estimated at its dead time: an error of the one is an error of the others.
#[derive(Debug, Clone, PartialEq)]
pub struct DelayInfluence<const NP: usize> {
    /// `-J_i' / J''`, see [`DelaySpread`]: what piece `i`, counted once more, adds to the dead time. s
    pub by_piece_s: Vec<f64>,
    /// Derivative of the parameter by the dead time, along the profile. Unit of the row per s
    pub parameter_by_dead_time: Vector<NP>,
    /// `J''`, the information on the dead time: `1 / sqrt(J'')` is its deviation by the weights. 1/s^2, > 0
    pub information: f64,
}

/// Uncertainty of a dead time that does not follow the pieces: one that was kept, or is at the bound of zero.
///
/// The axis is estimated at this dead time, as if it were known: its lag, for one, would have an interval that is far
/// too narrow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UndecidedDelay<const NP: usize> {
    /// Distance to the farther end of the dead times that the profile does not exclude, over [`NORMAL_HALF_WIDTH`]. s
    ///
    /// [`NORMAL_HALF_WIDTH`]: crate::NORMAL_HALF_WIDTH
    pub std_s: f64,
    /// As in [`DelayInfluence`]. Unit of the row per s
    pub parameter_by_dead_time: Vector<NP>,
}

impl<const NP: usize> UndecidedDelay<NP> {
    /// What it adds to the covariance of the parameter, to first order. Product of the units of row and column
    pub fn covariance(&self) -> Matrix<NP, NP> {
        let moved = self.parameter_by_dead_time * self.std_s;
        moved * moved.transpose()
    }
}

impl<const NU: usize, const NO: usize> Flights<'_, NU, NO> {
    /// The pieces with the applied inputs in them; `dead_time_s` is that of each input row. s, >= 0
    ///
    /// # Panics
    /// A span is of no recording, ends before it begins, or leads beyond the end of its `u` or `o`.
    pub fn pieces(&self, dead_time_s: &Vector<NU>) -> Vec<Piece<NU, NO>> {
        let observed = |span: &Span| self.recordings[span.recording].o[span.steps.clone()].to_vec();
        let pieces = self.inputs(dead_time_s).into_iter().zip(self.spans);
        pieces.map(|(u, span)| Piece { u, o: observed(span) }).collect()
    }

    /// The applied inputs in each piece.
    fn inputs(&self, dead_time_s: &Vector<NU>) -> Vec<Vec<Vector<NU>>> {
        let applied = |span: &Span| {
            let recording = &self.recordings[span.recording];
            recording.applied_during(span.steps.clone(), dead_time_s, self.dt_s)
        };
        self.spans.iter().map(applied).collect()
    }

    /// Searches the dead time of each of `groups`, starting from `dead_time_s`.
    ///
    /// `ident` is an identification over [`Flights::pieces`]; it is left solved at the dead times
    /// found or kept, which are left in `dead_time_s`. `None` if `is_late` returned true. Rows in no group keep their
    /// dead time.
    ///
    /// Cost: a rough warm solve per candidate, at most `dead_time_max_s / grid_s` of them, to see where the minima
    /// are; an exact one per step of refinement, and two per group for the spread.
    ///
    /// # Errors
    /// The pieces or the period of `ident` are others, a group has a row that is no input, a dead time to start from is
    /// not finite or negative, or the model is not finite somewhere.
    pub fn search<M, const NS: usize, const NP: usize>(
        &self,
        ident: &mut Ident<M, NS, NU, NO, NP>,
        groups: &[&[usize]],
        dead_time_s: &mut Vector<NU>,
        settings: &DelaySettings,
        is_late: &mut dyn FnMut() -> bool,
    ) -> Result<Option<Vec<DelayProfile<NP>>>, DelayError>
    where
        M: Model<NS, NU, NO, NP> + Sync,
    {
        if let Some(row) = groups.iter().copied().flatten().copied().find(|row| *row >= NU) {
            return Err(DelayError::Row { row, inputs: NU });
        }
        let (recordings_s, ident_s) = (self.dt_s, ident.dt_s());
        // Comparisons are false for NaN.
        let is_same = (recordings_s - ident_s).abs() <= 1e-9 * ident_s;
        if !is_same {
            return Err(DelayError::Period { recordings_s, ident_s });
        }
        let is_start = |at_s: &f64| at_s.is_finite() && *at_s >= 0.0;
        if let Some(at_s) = dead_time_s.iter().find(|at_s| !is_start(at_s)) {
            return Err(DelayError::Start(*at_s));
        }
        match (Search { flights: self, ident, groups, dead_time_s, settings, is_late }).run() {
            Ok(profiles) => Ok(Some(profiles)),
            Err(SearchStop::Late) => Ok(None),
            Err(SearchStop::Error(error)) => Err(error),
        }
    }

    /// Derivative of [`Flights::inputs`] by the dead time, every row by its own.
    fn inputs_by_dead_time(&self, dead_time_s: &Vector<NU>) -> Vec<Vec<Vector<NU>>> {
        // Linear between whole periods: the difference of the two around is the gradient.
        let below_s = dead_time_s.map(|at| (at / self.dt_s).floor() * self.dt_s);
        let mut gradients = self.inputs(&below_s.add_scalar(self.dt_s));
        for (gradient, below) in
            gradients.iter_mut().flatten().zip(self.inputs(&below_s).iter().flatten())
        {
            *gradient = (*gradient - below) / self.dt_s;
        }
        gradients
    }
}

#[cfg(test)]
mod tests;
