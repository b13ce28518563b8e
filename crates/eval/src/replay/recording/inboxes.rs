//! The inputs of the ticks of a foreign flight, and its applied sticks.

use horizon_model::rows::{Pose, Sticks, pose, stick};
use horizon_model::setting::SettingError;
use horizon_model::{InputFifo, Kinematic, Model};
use tello_flight::cycle::{CycleTable, Inbox};
use tello_io::clock::{SpanNs, TimeNs};
use tello_io::log::csv::CsvRow;
use tello_io::mocap::Sighting;

use crate::recordings::{GAP_STEPS_MAX, PERIOD_S};

/// The longest part of `rows` in which no more than a second is missing at once.
pub(super) fn longest_part(rows: &[CsvRow]) -> &[CsvRow] {
    let parts = rows.chunk_by(|a, b| b.step - a.step <= GAP_STEPS_MAX + 1);
    parts.max_by_key(|part| part.len()).unwrap_or_default()
}

/// The inbox of each row. Missing steps are periods without a tick; missing sticks are the last ones.
pub(super) fn of_rows(rows: &[CsvRow]) -> Vec<Inbox> {
    let first_step = rows.first().map_or(0, |row| row.step);
    let (mut next_step, mut newest, mut flown) = (first_step, None, Sticks::zeros());
    let inbox = |row: &CsvRow| {
        let mut inbox = Inbox::new();
        let step = row.step - first_step;
        let now = TimeNs(0).after(SpanNs::from_seconds(step as f64 * PERIOD_S));
        inbox.open(step, now);
        inbox.skipped = row.step - next_step;
        next_step = row.step + 1;
        // The recordings repeat the last pose while the stream stalls: that is no observation.
        if let Some(o) = row.pos.filter(|o| newest != Some(*o)) {
            inbox.sightings.push(sighting(row.step, now, o));
            newest = Some(o);
        }
        flown = row.input.unwrap_or(flown);
        inbox.flown = Some(flown.into());
        inbox
    };
    rows.iter().map(inbox).collect()
}

fn sighting(step: u64, at: TimeNs, o: Pose) -> Sighting {
    // An object that is not seen is reported at the origin.
    let is_seen = o.fixed_rows::<3>(pose::X).norm() > 0.0;
    let frame = i64::try_from(step).unwrap_or(i64::MAX);
    Sighting { frame, measured_at: at, received_at: at, pose: is_seen.then_some(o) }
}

/// The sticks that act from each step to the next, by the dead times of `cycle`.
///
/// # Errors
/// A dead time or period that breaks its rule.
pub(super) fn applied(inboxes: &[Inbox], cycle: &CycleTable) -> Result<Vec<Sticks>, SettingError> {
    let rows = <Kinematic as Model<4, { stick::COUNT }, 4, 4>>::INPUT;
    let mut fifo = InputFifo::new(&cycle.dead_time_s, &rows, cycle.dt_s)?;
    let mut u_applied = Vec::with_capacity(inboxes.len());
    for inbox in inboxes {
        for _ in 0..inbox.skipped {
            let u_sent = *fifo.newest();
            fifo.push(&u_sent);
            u_applied.push(fifo.applied(-1));
        }
        fifo.push(&inbox.flown.map_or_else(Sticks::zeros, Into::into));
        // The step of the newest push.
        u_applied.push(fifo.applied(-1));
    }
    Ok(u_applied)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(step: u64, x: Option<f64>, pitch: Option<f64>) -> CsvRow {
        let mut input = Sticks::zeros();
        let input = pitch.map(|pitch| {
            input[stick::PITCH] = pitch;
            input
        });
        CsvRow { step, pos: x.map(|x| Pose::new(x, 0.0, 1.0, 0.0)), input, ..CsvRow::default() }
    }

    #[test]
    fn a_repeated_pose_is_no_sighting_and_missing_sticks_are_the_last_ones() {
        let rows = [row(7, Some(0.1), Some(0.5)), row(8, Some(0.1), None), row(9, Some(0.2), None)];
        let inboxes = of_rows(&rows);
        let sightings: Vec<usize> = inboxes.iter().map(|inbox| inbox.sightings.len()).collect();
        assert_eq!(sightings, [1, 0, 1]);
        assert_eq!(inboxes[2].step, 2);
        assert_eq!(inboxes[2].flown, inboxes[0].flown);
    }

    #[test]
    fn a_recording_goes_on_over_missing_steps_and_is_cut_at_a_long_gap() {
        let rows = [row(0, None, Some(0.5)), row(3, None, Some(0.1)), row(1000, None, None)];
        let part = longest_part(&rows);
        assert_eq!(part.len(), 2);
        let inboxes = of_rows(part);
        assert_eq!((inboxes[0].skipped, inboxes[1].skipped, inboxes[1].step), (0, 2, 3));
        let mut table = tello_io::config::fly(None, None).unwrap().0.cycle;
        table.dead_time_s = vec![0.02; stick::COUNT];
        let u_applied = applied(&inboxes, &table).unwrap();
        let pitch: Vec<f64> = u_applied.iter().map(|u| u[stick::PITCH]).collect();
        assert_eq!(pitch, [0.0, 0.5, 0.5, 0.5]);
        assert!(longest_part(&[]).is_empty());
    }
}
