//! Logs as flights that can be fitted: cleaned, without lost commands, cut into pieces.

use std::borrow::Cow;

use crate::outage::{OutageSettings, lost_commands};
use crate::recordings::Loaded;
use crate::smooth::smooth;
use anyhow::{Result, bail};
use horizon_estim::{Observed, Recording, Span, cut};
use horizon_model::rows::{Sticks, pose, stick};
use horizon_model::setting::SettingError;
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};

use super::job::Job;

/// One flight.
pub(super) type Flight = Recording<{ stick::COUNT }, { pose::COUNT }>;

/// Flights as they are fitted, copied only if they are changed, and by flight and step whether the
/// applied command was lost.
type Prepared<'a> = (Vec<Cow<'a, Flight>>, Vec<Vec<bool>>);

/// The flights of the job.
pub(super) fn prepare<'a>(job: &Job<'a>, dead_time_s: &Sticks) -> Result<Prepared<'a>> {
    let table = job.table;
    let settings = table.lost_commands.as_ref().map(OutageSettings::try_from).transpose();
    let settings = settings.map_err(|error: SettingError| error.under("lost_commands"))?;
    let prepared = |log: &'a Loaded| {
        let mut flight = Cow::Borrowed(&log.recording);
        let mut is_lost = vec![false; flight.o.len()];
        if table.clean_observations || settings.is_some() {
            let track = smooth(&flight.o, table.dt_s);
            if let Some(settings) = &settings {
                let applied = flight.applied(dead_time_s, table.dt_s);
                is_lost = lost_commands(settings, &applied, &track, table.dt_s);
            }
            if table.clean_observations {
                flight = Cow::Owned(Flight { u: log.recording.u.clone(), o: track.o });
            }
        }
        (flight, is_lost)
    };
    Ok(job.logs.par_iter().map(prepared).unzip())
}

/// The pieces between lost commands, each from one complete observation to another: a piece that begins
/// without a heading would have to guess it.
pub(super) fn cut_logs(
    flights: &[Cow<'_, Flight>],
    is_lost: &[Vec<bool>],
    steps_min: usize,
) -> Result<Vec<Span>> {
    let mut spans = Vec::new();
    for (recording, (flight, is_lost)) in flights.iter().zip(is_lost).enumerate() {
        let is_usable: Vec<bool> = is_lost.iter().map(|is_lost| !is_lost).collect();
        for steps in cut(&is_usable, steps_min) {
            let is_complete = |k: &usize| is_complete(&flight.o[*k]);
            let (first, last) = (steps.clone().find(is_complete), steps.rev().find(is_complete));
            if let (Some(first), Some(last)) = (first, last)
                && first < last
            {
                spans.push(Span { recording, steps: first..last + 1 });
            }
        }
    }
    if spans.is_empty() {
        let (lost, steps) = is_lost
            .iter()
            .flatten()
            .fold((0, 0), |(lost, steps), is_lost| (lost + usize::from(*is_lost), steps + 1));
        let no_log =
            format!("no log has {steps_min} steps on end that can be used (piece_steps_min)");
        if lost == 0 {
            let is_whole = |flight: &Cow<'_, Flight>| flight.o.iter().all(is_complete);
            let gaps = if flights.iter().all(is_whole) { "" } else { ", with gaps" };
            bail!("{no_log}: the logs have {steps} steps{gaps}; fly longer");
        }
        bail!(
            "{no_log}; in {lost} of {steps} steps the drone did not follow its sticks: if that is most of them, the \
             object may be turned (--turn), axes or sticks exchanged, the period of a CSV not `dt_s`, or the vehicle \
             unlike `lost_commands`, as with full sticks and another `a_max_mps2` (`\"lost_commands\": null` in the \
             settings takes every step)"
        );
    }
    Ok(spans)
}

/// Whether every row was observed.
pub(super) fn is_complete(observed: &Observed<{ pose::COUNT }>) -> bool {
    observed.is_present.iter().all(|seen| *seen)
}

#[cfg(test)]
mod tests;
