//! Rows of a foreign recording as samples: which poses are observations.

use std::f64::consts::PI;

use anyhow::{Result, bail};
use horizon_estim::Observed;
use horizon_model::rows::{Pose, pos_w, pose};
use tello_flight::{Acceptance, FilterSettings, PoseFilter};
use tello_io::log::csv::CsvRow;

use super::rows::RowFlight;
use super::{GAP_STEPS_MAX, PERIOD_S, Sample, note, observed};
use crate::smooth::ORIGIN_M;

/// Digits behind the point with which a pose that repeats itself may be a new one: the mocap's noise of
/// 0.3 mm hides in a centimetre, not in a tenth of a millimetre.
const ROUNDED_DECIMALS: usize = 2;

/// A pose is not that of the vehicle before if it is further away than this, beside the way at the speed below since
/// that one came: stalled streams of real flights jump by up to 0.46 m (the thesis' pieces). m, m/s
const JUMP_M: f64 = 0.5;
const JUMP_MPS: f64 = 2.0;

/// Headings further from zero are no angles in rad, unless a vehicle has turned as often. rad
const TURNS_MAX_RAD: f64 = 60.0;

/// The samples of `flight`, and what of it is no observation.
///
/// A recording is raw if the object is at the origin once, which means that it is lost, or if a heading
/// jumps by more than half a turn, or a position further than any vehicle. Then it runs through `filter`, as in
/// flight. Otherwise every pose counts and headings are continuous already. Where accepted poses have jumped another
/// recording begins. A repeated pose is a stall of the stream and no
/// observation, unless the file is rounded to [`ROUNDED_DECIMALS`].
///
/// # Errors
/// Most headings jump, and there are such as degrees have.
pub(super) fn samples(
    flight: RowFlight,
    filter: FilterSettings,
    skipped: &mut Vec<String>,
) -> Result<Vec<Sample>> {
    skipped.extend(flight.notes);
    let mut reader = RowReader {
        repeats: flight.decimals <= ROUNDED_DECIMALS,
        filter: is_raw(&flight.rows).then(|| PoseFilter::new(filter)),
        counts: RowCounts::default(),
        newest: None,
        step: None,
        seen: None,
    };
    let samples = flight.rows.iter().map(|row| reader.take(row)).collect();
    let counts = reader.counts;
    let is_in_degrees = |o: Pose| o[pose::THETA].abs() > TURNS_MAX_RAD;
    let is_mostly_held = counts.headings_held > counts.headings;
    if is_mostly_held && flight.rows.iter().filter_map(|row| row.pos).any(is_in_degrees) {
        let RowCounts { headings_held, headings, .. } = counts;
        bail!("{headings_held} headings jump, {headings} do not: theta is in rad");
    }
    note(skipped, counts.stalled, "pose", "repeated while the stream stalled");
    note(skipped, counts.lost, "pose", "of a lost object");
    note(skipped, counts.positions_held, "pose", "not accepted by the filter");
    note(skipped, counts.headings_held, "heading", "not accepted by the filter");
    Ok(samples)
}

/// Rows of a recording, counted by what became of them.
#[derive(Default)]
struct RowCounts {
    /// Poses that repeat the one before while the stream stalls.
    stalled: usize,
    /// Poses at the origin: the object is lost.
    lost: usize,
    /// Positions that the filter held, and headings of accepted positions that it held.
    positions_held: usize,
    headings_held: usize,
    /// Headings that the filter accepted.
    headings: usize,
}

/// Reader of rows by ascending step, with its memory of the rows before.
struct RowReader {
    /// Whether a pose that repeats the one before may be a new one.
    repeats: bool,
    /// Filter of a raw recording.
    filter: Option<PoseFilter>,
    counts: RowCounts,
    /// Newest pose as recorded. m, rad
    newest: Option<Pose>,
    /// Step of the row before.
    step: Option<u64>,
    /// Newest observed pose that differs from the one before, and its step. m, rad
    seen: Option<(u64, Pose)>,
}

impl RowReader {
    /// The sample of the next row.
    fn take(&mut self, row: &CsvRow) -> Sample {
        let is_stalled = !self.repeats && row.pos.is_some() && row.pos == self.newest;
        let is_lost = !is_stalled && row.pos.as_ref().is_some_and(is_at_origin);
        self.counts.stalled += usize::from(is_stalled);
        self.counts.lost += usize::from(is_lost);
        self.newest = row.pos.or(self.newest);
        let o = self.observe(row, row.pos.filter(|_| !is_stalled && !is_lost));
        self.step = Some(row.step);
        let now = o.is_present[pose::X].then_some((row.step, o.o));
        let has_jumped = self.seen.zip(now).is_some_and(|(before, now)| is_jump(before, now));
        if self.seen.map(|(_, before)| before) != now.map(|(_, now)| now) {
            // A stream that stalls repeats a pose, and the vehicle has flown on.
            self.seen = now.or(self.seen);
        }
        Sample { step: row.step, u: row.input, o, has_jumped }
    }

    /// The observation of `row`, whose pose is `raw`: of a raw recording what the filter accepts.
    fn observe(&mut self, row: &CsvRow, raw: Option<Pose>) -> Observed<{ pose::COUNT }> {
        let Some(filter) = &mut self.filter else { return observed(raw) };
        // The limits of the filter grow while there is nothing to see.
        let gap = self.step.map_or(0, |step| row.step - step - 1).min(GAP_STEPS_MAX);
        for _ in 0..gap {
            filter.update(None);
        }
        let filtered = filter.update(raw.as_ref());
        let is_new = |acceptance| acceptance == Acceptance::Accepted;
        self.counts.positions_held += usize::from(filtered.position == Acceptance::Held);
        self.counts.headings_held +=
            usize::from(is_new(filtered.position) && filtered.heading == Acceptance::Held);
        self.counts.headings += usize::from(is_new(filtered.heading));
        filtered.o.map_or_else(Observed::missing, |o| {
            accepted(o, is_new(filtered.position), is_new(filtered.heading))
        })
    }
}

/// The rows of a filtered pose that are new.
pub(crate) fn accepted(
    o: Pose,
    is_position_new: bool,
    is_heading_new: bool,
) -> Observed<{ pose::COUNT }> {
    let mut is_present = [is_position_new; pose::COUNT];
    is_present[pose::THETA] = is_heading_new;
    Observed { o, is_present }
}

fn is_at_origin(o: &Pose) -> bool {
    pos_w(o).amax() < ORIGIN_M
}

/// Whether no vehicle gets from a pose to a later one in the steps between.
fn is_jump((from, before): (u64, Pose), (to, now): (u64, Pose)) -> bool {
    let moved_m = (pos_w(&now) - pos_w(&before)).norm();
    moved_m > JUMP_M + JUMP_MPS * PERIOD_S * (to - from) as f64
}

fn is_raw(rows: &[CsvRow]) -> bool {
    let poses = || rows.iter().filter_map(|row| row.pos);
    let turns = |(before, after): (Pose, Pose)| (after - before)[pose::THETA].abs() > PI;
    // A stream that stalls repeats a pose, and the vehicle has flown on.
    let mut news: Vec<(u64, Pose)> = Vec::new();
    for (step, o) in rows.iter().filter_map(|row| Some((row.step, row.pos?))) {
        if news.last().is_none_or(|(_, newest)| *newest != o) {
            news.push((step, o));
        }
    }
    poses().any(|o| is_at_origin(&o))
        || poses().zip(poses().skip(1)).any(turns)
        || news.windows(2).any(|pair| is_jump(pair[0], pair[1]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(poses: &[Option<[f64; 4]>]) -> Vec<CsvRow> {
        let row = |(step, pos): (u64, &Option<[f64; 4]>)| CsvRow {
            step,
            pos: pos.map(Pose::from),
            ..CsvRow::default()
        };
        (0..).zip(poses).map(row).collect()
    }

    #[test]
    fn a_recording_is_raw_if_its_object_was_at_the_origin_or_jumped_or_its_heading_wraps() {
        let at = |theta: f64| Some([1.0, 0.0, 1.0, theta]);
        for (poses, is_raw_expected) in [
            (vec![], false),
            (vec![at(3.1), at(-0.04)], false),
            (vec![at(3.1), at(-0.05)], true),
            // Over a missing pose, too.
            (vec![at(3.1), None, at(-3.1)], true),
            (vec![at(0.0), Some([0.0009, -0.0009, 0.0, 2.0])], true),
            (vec![Some([0.1, 0.0, 0.1, 0.0]), Some([0.0011, 0.0, 0.0, 0.0])], false),
            // 0.5 m, and 2 m/s for 0.02 s.
            (vec![at(0.0), Some([1.53, 0.0, 1.0, 0.0])], false),
            (vec![at(0.0), Some([1.55, 0.0, 1.0, 0.0])], true),
            (vec![at(0.0), None, Some([1.55, 0.0, 1.0, 0.0])], false),
            (vec![at(0.0), at(0.0), Some([1.55, 0.0, 1.0, 0.0])], false),
        ] {
            assert_eq!(is_raw(&rows(&poses)), is_raw_expected, "{poses:?}");
        }
    }

    #[test]
    fn a_stall_is_a_pose_equal_to_the_newest_one_also_over_a_missing_line() {
        let moving = |x: f64| Some([x, 0.0, 1.0, 0.0]);
        let poses = [moving(0.5), None, moving(0.5), moving(0.6), moving(0.5)];
        let filter = &tello_io::config::fly(None, None).unwrap().0.cycle.filter;
        let filter: FilterSettings = filter.try_into().unwrap();
        for (decimals, expected) in
            [(4, [true, false, false, true, true]), (2, [true, false, true, true, true])]
        {
            let notes = vec!["a note".into()];
            let flight = RowFlight { rows: rows(&poses), decimals, notes, is_complete: true };
            let mut skipped = Vec::new();
            let samples = samples(flight, filter, &mut skipped).unwrap();
            let present: Vec<bool> = samples.iter().map(|one| one.o.is_present[pose::X]).collect();
            assert_eq!(present, expected, "{decimals} decimals");
            assert_eq!(skipped.len(), 1 + usize::from(decimals > ROUNDED_DECIMALS), "{skipped:?}");
        }
    }
}
