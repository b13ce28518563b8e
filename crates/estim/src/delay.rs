//! Dead time of each group of inputs, by the likelihood itself.
//!
//! Owns the profile of the identification's cost over the dead time: parameters and states are found
//! anew for every candidate. All candidates explain the same steps, so that their costs compare.
//! How an input is delayed is [`Recording::acting`], what explains a step is `ident.rs`.
//!
//! An input that is held over its period and acts `n + f` periods later acts with its share `f` of a
//! period as the older one: the average over the period is exactly the linear interpolation between
//! steps. The cost is therefore smooth between whole steps and has at most a small kink there, in
//! proportion to how abruptly the sticks move; a halving grid is not misled by it.

mod settings;

use std::ops::Range;

use nalgebra::SVector;
use tello_model::Model;
use thiserror::Error;

use crate::ident::{Ident, Piece, PieceError};
use crate::levenberg::{SolveError, Stop};
use crate::recording::Recording;

pub use settings::{DelaySettings, DelayTable};

/// Half the width of the 95 % interval of a normal distribution. standard deviations
const NORMAL_HALF_WIDTH: f64 = 1.959_963_984_540_054;

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
    pub recordings: &'a [Recording<NU, NO>],
    /// The pieces, in their order.
    pub spans: &'a [Span],
    /// Period. s, > 0
    pub dt_s: f64,
}

/// What makes a delay search impossible.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum DelayError {
    /// The spans are not the pieces of the identification.
    #[error(transparent)]
    Piece(#[from] PieceError),
    /// The model is not finite where a candidate leads.
    #[error(transparent)]
    Solve(#[from] SolveError),
}

/// Profile of the cost over the dead time of one group of inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct DelayProfile {
    /// Input rows of the group.
    pub rows: Vec<usize>,
    /// Candidates of the first round with their cost, by ascending dead time. The other groups then
    /// had not all been moved: differences count, not values. (s, 1)
    pub curve: Vec<(f64, f64)>,
    /// Where the cost is least, the other groups at their best. s
    pub dead_time_s: f64,
    /// How far that may be off; `None` within a period of the ends of the searched range.
    pub spread: Option<DelaySpread>,
}

/// Uncertainty of a dead time.
///
/// With `J` the profile over the dead time `d` and `J_i` the share of piece `i` in it, curvature and
/// slopes are differences over one period to either side.
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

impl<const NU: usize, const NO: usize> Flights<'_, NU, NO> {
    /// The pieces with the inputs that acted in them.
    pub fn pieces(&self, dead_time_s: &SVector<f64, NU>) -> Vec<Piece<NU, NO>> {
        let observed = |span: &Span| self.recordings[span.recording].o[span.steps.clone()].to_vec();
        let pieces = self.inputs(dead_time_s).into_iter().zip(self.spans);
        pieces.map(|(u, span)| Piece { u, o: observed(span) }).collect()
    }

    /// The inputs that acted in each piece.
    fn inputs(&self, dead_time_s: &SVector<f64, NU>) -> Vec<Vec<SVector<f64, NU>>> {
        let acting: Vec<_> = self
            .recordings
            .iter()
            .map(|recording| recording.acting(dead_time_s, self.dt_s))
            .collect();
        self.spans.iter().map(|span| acting[span.recording][span.steps.clone()].to_vec()).collect()
    }

    /// Searches the dead time of each of `groups`, one after the other, starting from `dead_time_s`.
    ///
    /// The first round looks everywhere, the others only near what was found, since groups hardly
    /// depend on each other. `ident` is an identification over [`Flights::pieces`]; it is left solved
    /// at the dead times found, which are left in `dead_time_s`. `None` if `is_late` said so. Rows in
    /// no group keep their dead time.
    ///
    /// Cost: a warm solve per candidate; about `dead_time_max_s / grid_s + 8` of them per group in the
    /// first round, 5 in another.
    ///
    /// # Errors
    /// The pieces of `ident` are others, or the model is not finite somewhere.
    pub fn search<M, const NS: usize, const NP: usize>(
        &self,
        ident: &mut Ident<M, NS, NU, NO, NP>,
        groups: &[&[usize]],
        dead_time_s: &mut SVector<f64, NU>,
        settings: &DelaySettings,
        is_late: &mut dyn FnMut() -> bool,
    ) -> Result<Option<Vec<DelayProfile>>, DelayError>
    where
        M: Model<NS, NU, NO, NP> + Sync,
    {
        let mut search = Search { flights: self, ident, dead_time_s, settings, is_late };
        match search.run(groups) {
            Ok(profiles) => Ok(Some(profiles)),
            Err(Halt::Late) => Ok(None),
            Err(Halt::Error(error)) => Err(error),
        }
    }
}

/// Why a search goes no further.
enum Halt {
    Late,
    Error(DelayError),
}

impl<E: Into<DelayError>> From<E> for Halt {
    fn from(error: E) -> Self {
        Self::Error(error.into())
    }
}

/// A search at its present dead times.
struct Search<'a, 'b, M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> {
    flights: &'a Flights<'b, NU, NO>,
    ident: &'a mut Ident<M, NS, NU, NO, NP>,
    dead_time_s: &'a mut SVector<f64, NU>,
    settings: &'a DelaySettings,
    is_late: &'a mut dyn FnMut() -> bool,
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>
    Search<'_, '_, M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP> + Sync,
{
    fn run(&mut self, groups: &[&[usize]]) -> Result<Vec<DelayProfile>, Halt> {
        let mut profiles = Vec::with_capacity(groups.len());
        for rows in groups {
            let mut curve = Vec::new();
            for candidate_s in self.settings.grid() {
                curve.push((candidate_s, self.cost(rows, candidate_s)?));
            }
            self.refine(rows, &mut curve, 0.5 * self.settings.grid_s)?;
            let dead_time_s = minimum(&curve);
            self.cost(rows, dead_time_s)?;
            profiles.push(DelayProfile { rows: rows.to_vec(), curve, dead_time_s, spread: None });
        }
        for _ in 1..self.settings.rounds {
            let mut moved_s = 0.0_f64;
            for profile in &mut profiles {
                let rows = &profile.rows;
                let mut curve = vec![(profile.dead_time_s, self.cost(rows, profile.dead_time_s)?)];
                self.refine(rows, &mut curve, 2.0 * self.settings.tolerance_s)?;
                let dead_time_s = minimum(&curve);
                self.cost(rows, dead_time_s)?;
                moved_s = moved_s.max((dead_time_s - profile.dead_time_s).abs());
                profile.dead_time_s = dead_time_s;
            }
            if moved_s < self.settings.tolerance_s {
                break;
            }
        }
        for profile in &mut profiles {
            profile.spread = self.spread(&profile.rows, profile.dead_time_s)?;
        }
        Ok(profiles)
    }

    /// The least cost with this dead time of `rows`.
    fn cost(&mut self, rows: &[usize], candidate_s: f64) -> Result<f64, Halt> {
        for row in rows {
            self.dead_time_s[*row] = candidate_s;
        }
        for (piece, u) in self.flights.inputs(self.dead_time_s).iter().enumerate() {
            self.ident.set_inputs(piece, u)?;
        }
        let report = self.ident.solve(&mut *self.is_late)?;
        if report.stop == Stop::Late { Err(Halt::Late) } else { Ok(report.cost) }
    }

    /// Adds candidates around the best one of `curve` until it has neighbours within the tolerance,
    /// from the distance `step_s` on.
    fn refine(
        &mut self,
        rows: &[usize],
        curve: &mut Vec<(f64, f64)>,
        mut step_s: f64,
    ) -> Result<(), Halt> {
        loop {
            let (best_s, _) = curve[lowest(curve)];
            for candidate_s in [best_s - step_s, best_s + step_s] {
                let is_known = curve.iter().any(|(at, _)| (at - candidate_s).abs() < 0.5 * step_s);
                let is_inside = (0.0..=self.settings.dead_time_max_s).contains(&candidate_s);
                if is_inside && !is_known {
                    curve.push((candidate_s, self.cost(rows, candidate_s)?));
                }
            }
            curve.sort_by(|(left, _), (right, _)| left.total_cmp(right));
            let (new_s, _) = curve[lowest(curve)];
            let has_stayed = (new_s - best_s).abs() < 0.5 * step_s;
            if has_stayed && step_s <= self.settings.tolerance_s {
                return Ok(());
            }
            if has_stayed {
                step_s *= 0.5;
            }
        }
    }

    fn spread(&mut self, rows: &[usize], dead_time_s: f64) -> Result<Option<DelaySpread>, Halt> {
        let width_s = self.flights.dt_s;
        let (left_s, right_s) = (dead_time_s - width_s, dead_time_s + width_s);
        if left_s < 0.0 || right_s > self.settings.dead_time_max_s {
            return Ok(None);
        }
        let left = self.cost(rows, left_s)?;
        let left_pieces = self.ident.piece_costs();
        let right = self.cost(rows, right_s)?;
        let right_pieces = self.ident.piece_costs();
        let middle = self.cost(rows, dead_time_s)?;
        let curvature = (left - 2.0 * middle + right) / (width_s * width_s);
        if curvature.is_nan() || curvature <= 0.0 {
            return Ok(None);
        }
        let slopes = left_pieces.iter().zip(&right_pieces).map(|(l, r)| 0.5 * (r - l) / width_s);
        let counted = slopes.zip(self.ident.multiplicities());
        let scatter: f64 = counted.map(|(slope, count)| f64::from(*count) * slope * slope).sum();
        let variance = 2.0 * middle / self.ident.degrees_of_freedom();
        let std_s = scatter.sqrt() / curvature;
        let half_s = NORMAL_HALF_WIDTH * std_s;
        Ok(Some(DelaySpread {
            std_s,
            std_white_s: (variance / curvature).sqrt(),
            lower_s: (dead_time_s - half_s).max(0.0),
            upper_s: dead_time_s + half_s,
        }))
    }
}

/// Position of the lowest cost.
fn lowest(curve: &[(f64, f64)]) -> usize {
    let mut best = 0;
    for (i, (_, cost)) in curve.iter().enumerate() {
        if *cost < curve[best].1 {
            best = i;
        }
    }
    best
}

/// Lowest point of the parabola through the lowest candidate and its neighbours; the candidate itself
/// at an end of the curve.
fn minimum(curve: &[(f64, f64)]) -> f64 {
    let best = lowest(curve);
    let (at, cost) = curve[best];
    let neighbours = best.checked_sub(1).and_then(|left| curve.get(left)).zip(curve.get(best + 1));
    let Some(((left_at, left), (right_at, right))) = neighbours else { return at };
    // Slopes of the chords; both end in the lowest point, so they have opposite signs.
    let left_slope = (cost - left) / (at - left_at);
    let right_slope = (right - cost) / (right_at - at);
    let bend = right_slope - left_slope;
    if bend > 0.0 {
        0.5 * (left_at + at) - left_slope / bend * 0.5 * (right_at - left_at)
    } else {
        at
    }
}

#[cfg(test)]
mod tests;
