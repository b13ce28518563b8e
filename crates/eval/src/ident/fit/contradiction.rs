//! Logs that contradict the others, and a log whose halves contradict each other.
//!
//! Owns the parts that are compared. Each log is cut into short pieces first: only the scatter of several shows how far
//! they differ by chance.

use horizon_estim::{Flights, Ident, Span, group_deviations};
use horizon_model::Model;
use horizon_model::rows::{pose, stick};
use horizon_model::setting::SettingError;

use anyhow::Result;
use nalgebra::SVector;

use super::Identification;
use crate::ident::flights::is_complete;

/// Standard deviations from which on a log contradicts the rest, and from which on no parameter stands for it. The
/// recorded flights of the thesis have 7 at most.
const CONTRADICTION_MIN: f64 = 4.0;
const REFUSED_MIN: f64 = 10.0;

/// Shortest piece of a log, many lags and dead times; and most pieces of one half.
const PIECE_S: f64 = 6.0;
const PIECES_PER_HALF: usize = 8;

/// Fewer pieces do not show how they scatter.
const PIECES_MIN: usize = 4;

/// A log that contradicts the rest.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::ident) struct Contradiction {
    pub(in crate::ident) log: String,
    /// Whether its second half contradicts its first, in place of the log the other logs.
    pub(in crate::ident) is_within: bool,
    /// Parameters that do, and by how many standard deviations, the most first; at least one.
    pub(in crate::ident) rows: Vec<(&'static str, f64)>,
    /// Whether there are enough pieces on both sides to show how they scatter.
    pub(in crate::ident) has_scatter: bool,
}

impl Contradiction {
    /// Whether no parameter can stand for all logs.
    pub(in crate::ident) fn is_refused(&self) -> bool {
        self.has_scatter && self.most().1.abs() > REFUSED_MIN
    }

    /// The parameter that contradicts most, and its standard deviations.
    fn most(&self) -> (&'static str, f64) {
        self.rows.first().copied().unwrap_or(("", 0.0))
    }

    /// What contradicts, and what may be the cause.
    pub(in crate::ident) fn sentence(&self) -> String {
        let (log, (parameter, deviations)) = (&self.log, self.most());
        if self.is_within {
            let names: Vec<&str> = self.rows.iter().map(|(name, _)| *name).collect();
            return format!(
                "the first and the second half of {log} disagree in {}, most by {:.0} standard deviations: the clocks \
                 of sticks and poses drift apart or jump, the object was moved or turned, or the vehicle changed; the \
                 estimate is between the halves",
                names.join(", "),
                deviations.abs()
            );
        }
        format!(
            "{log} contradicts the other logs, most in {parameter}, by {deviations:.0} standard deviations: the \
             estimate is between them; identify each drone, and each definition of its object, by logs of its own"
        )
    }
}

impl<M, const NS: usize, const NP: usize> Identification<'_, M, NS, NP>
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP> + Send + Sync + 'static,
{
    /// Logs that contradict the others, or the only one if its halves do.
    ///
    /// # Errors
    /// The settings are not valid, or a number is not finite.
    pub(super) fn contradictions(&self) -> Result<Vec<Contradiction>> {
        let (table, model) = (self.job.table, self.model);
        let settings = table.map.check::<M, NS, { stick::COUNT }, { pose::COUNT }, NP>();
        let settings = settings.map_err(|error: SettingError| error.under("map"))?;
        let spans = self.short_spans();
        let flights = Flights { recordings: &self.recordings, spans: &spans, dt_s: table.dt_s };
        let pieces = flights.pieces(&self.dead_time_s);
        let mut ident = Ident::new(model, &settings, table.dt_s, pieces)?;
        ident.start_at(self.ident.parameter());
        let is_within = self.job.logs.len() == 1;
        let groups = if is_within { halves(&spans).to_vec() } else { self.by_log(&spans) };
        // A missing standard deviation has a note of its own.
        let deviations = group_deviations(&ident, &groups).unwrap_or_default();
        let beyond = |of_group: &SVector<f64, NP>| {
            let rows = M::PARAMETER.iter().zip(of_group);
            let rows = rows.filter(|(_, it)| it.is_finite() && it.abs() > CONTRADICTION_MIN);
            let mut rows: Vec<_> = rows.map(|(row, it)| (row.name, *it)).collect();
            rows.sort_by(|(_, a), (_, b)| b.abs().total_cmp(&a.abs()));
            rows
        };
        let found = groups.iter().zip(&deviations).enumerate().map(|(at, (pieces, of_group))| {
            let log = &self.job.logs[if is_within { 0 } else { at }];
            let others = spans.len() - pieces.len();
            Contradiction {
                log: log.path.display().to_string(),
                is_within,
                // Without others a log is compared with nothing.
                rows: if others > 0 { beyond(of_group) } else { Vec::new() },
                has_scatter: pieces.len().min(others) >= PIECES_MIN,
            }
        });
        // Two halves say the same twice, and too few pieces of one log nothing.
        let counts = |found: &Contradiction| {
            !found.rows.is_empty() && (found.has_scatter || !found.is_within)
        };
        Ok(found.filter(counts).take(if is_within { 1 } else { usize::MAX }).collect())
    }

    /// Pieces by log.
    fn by_log(&self, spans: &[Span]) -> Vec<Vec<usize>> {
        let mut groups = vec![Vec::new(); self.job.logs.len()];
        for (piece, span) in spans.iter().enumerate() {
            groups[span.recording].push(piece);
        }
        groups
    }

    /// The pieces of the fit, cut into short ones.
    fn short_spans(&self) -> Vec<Span> {
        let table = self.job.table;
        let least = horizon_model::steps(PIECE_S, table.dt_s).max(table.piece_steps_min);
        let mut used = vec![0; self.job.logs.len()];
        for span in &self.spans {
            used[span.recording] += span.steps.len();
        }
        let cut = |span: &Span| {
            let is_start = |k: &usize| is_complete(&self.recordings[span.recording].o[*k]);
            let least = least.max(used[span.recording] / (2 * PIECES_PER_HALF));
            cut(span, least, is_start)
        };
        self.spans.iter().flat_map(cut).collect()
    }
}

/// `span` in parts of about `least` steps or more, each from a step with `is_start` on.
fn cut(span: &Span, least: usize, is_start: impl Fn(&usize) -> bool) -> Vec<Span> {
    let Span { recording, steps } = span;
    let count = (steps.len() / least.max(2)).max(1);
    let start = |part: usize| {
        let from = steps.start + part * steps.len() / count;
        (from..steps.end - 1).find(|k| is_start(k))
    };
    let mut starts: Vec<usize> = (1..count).filter_map(start).collect();
    starts.insert(0, steps.start);
    starts.dedup();
    let ends = starts.iter().skip(1).copied().chain([steps.end]);
    let part = |(start, end): (&usize, usize)| Span { recording: *recording, steps: *start..end };
    // Less than two steps are no piece.
    starts.iter().zip(ends).map(part).filter(|part| part.steps.len() > 1).collect()
}

/// The pieces of the first half of all steps, and those of the second.
fn halves(spans: &[Span]) -> [Vec<usize>; 2] {
    let total: usize = spans.iter().map(|span| span.steps.len()).sum();
    let mut halves = [Vec::new(), Vec::new()];
    let mut before = 0;
    for (piece, span) in spans.iter().enumerate() {
        let is_second = 2 * before + span.steps.len() > total;
        halves[usize::from(is_second)].push(piece);
        before += span.steps.len();
    }
    halves
}

#[cfg(test)]
mod tests;
