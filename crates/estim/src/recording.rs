//! Recorded flights at a fixed period, and how they are cut into pieces.
//!
//! Owns which input was applied when, and where a recording is cut. Files and their formats:
//! `eval/recordings.rs`. The usable steps: `eval/ident/flights.rs`.

use std::ops::Range;

use horizon_model::Vector;

use crate::residual::Observed;

/// One flight at a fixed period; `u` and `o` have equal lengths.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording<const NU: usize, const NO: usize> {
    /// `u[k]` was sent in step `k`. Unit of each row
    pub u: Vec<Vector<NU>>,
    /// What was observed in step `k`.
    pub o: Vec<Observed<NO>>,
}

impl<const NU: usize, const NO: usize> Recording<NU, NO> {
    /// The applied input in each step, one for each of `u` and in its units.
    ///
    /// `dead_time_s` is that of each input row (s, >= 0), `dt_s` the period (s, > 0). A dead time that is negative, or
    /// no number of steps, is none; an infinite one never acts.
    /// With a dead time of `whole + fraction` steps, `0 <= fraction < 1`, it is
    /// `(1 - fraction) u[k - whole] + fraction u[k - whole - 1]`: linear between what was sent, continuous in the
    /// dead time, zero before the start.
    pub fn applied(&self, dead_time_s: &Vector<NU>, dt_s: f64) -> Vec<Vector<NU>> {
        self.applied_during(0..self.u.len(), dead_time_s, dt_s)
    }

    /// The inputs of [`Recording::applied`] during `steps` alone, linear in their number.
    ///
    /// # Panics
    /// `steps` lead beyond the end of `u`, and dead times do not.
    pub fn applied_during(
        &self,
        steps: Range<usize>,
        dead_time_s: &Vector<NU>,
        dt_s: f64,
    ) -> Vec<Vector<NU>> {
        let delay = dead_time_s.map(|dead_time_s| Delay::new(dead_time_s / dt_s));
        let sent = |k: Option<usize>, row: usize| k.map_or(0.0, |k| self.u[k][row]);
        let applied = |k: usize| {
            Vector::from_fn(|row, _| {
                let Delay { whole, fraction } = delay[row];
                let late = k.checked_sub(whole);
                let later = late.and_then(|k| k.checked_sub(1));
                (1.0 - fraction) * sent(late, row) + fraction * sent(later, row)
            })
        };
        steps.map(applied).collect()
    }
}

/// A dead time in steps, split.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Delay {
    whole: usize,
    /// 1, 0..1
    fraction: f64,
}

impl Delay {
    fn new(steps: f64) -> Self {
        // 0 for a NaN; infinity never acts.
        let steps = steps.max(0.0);
        let whole = horizon_model::whole(steps);
        // Infinity has no fraction.
        let fraction = if steps.is_finite() { steps.fract() } else { 0.0 };
        Self { whole, fraction }
    }
}

/// Where to cut a recording: every run of usable steps is split evenly into as many pieces as have
/// `min_steps` (>= 1); a shorter run gives none.
///
/// Pieces of one run differ in length by one at most; a usable step of a long enough run is in
/// exactly one piece. Linear in the steps.
pub fn cut(is_usable: &[bool], min_steps: usize) -> Vec<Range<usize>> {
    let mut pieces = Vec::new();
    let mut start = 0;
    for run in is_usable.chunk_by(|left, right| left == right) {
        let end = start + run.len();
        if run.first() == Some(&true) {
            let count = run.len() / min_steps.max(1);
            let bound = |piece: usize| start + run.len() * piece / count;
            pieces.extend((0..count).map(|piece| bound(piece)..bound(piece + 1)));
        }
        start = end;
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;
    use horizon_model::Vector;
    use horizon_model::check::maximum;
    use horizon_model::{InputFifo, Row};
    use proptest::prelude::*;

    const DT_S: f64 = 0.02;
    const ROWS: [Row; 2] = [Row::linear("a", "1"), Row::linear("b", "1")];

    fn recording(steps: u32) -> Recording<2, 1> {
        let u = (1..=steps).map(|k| Vector::from([f64::from(k), -f64::from(k * k)])).collect();
        Recording { u, o: vec![Observed::missing(); steps as usize] }
    }

    #[test]
    fn what_is_no_dead_time_is_none_and_an_infinite_one_never_acts() {
        let recording = recording(5);
        for (dead_time_s, dt_s, acts) in [
            (-0.01, DT_S, true),
            (f64::NAN, DT_S, true),
            (0.0, 0.0, true),
            (f64::INFINITY, DT_S, false),
            (0.1, 0.0, false),
        ] {
            let applied = recording.applied(&Vector::from([dead_time_s, 0.0]), dt_s);
            let expected = |k: usize| if acts { recording.u[k][0] } else { 0.0 };
            let gap = (0..5).map(|k| (applied[k][0] - expected(k)).abs()).fold(0.0, maximum);
            assert!(gap <= 0.0, "{dead_time_s} s by {dt_s} s: {applied:?}");
        }
    }

    #[test]
    fn the_applied_input_is_that_of_the_fifo_in_flight() {
        let recording = recording(60);
        for dead_time_s in [[0.0, 0.6], [0.25, 0.07], [0.02, 0.013]] {
            let applied = recording.applied(&Vector::from(dead_time_s), DT_S);
            let mut fifo = InputFifo::new(&dead_time_s, &ROWS, DT_S).unwrap();
            assert_eq!(recording.applied_during(7..9, &dead_time_s.into(), DT_S), applied[7..9]);
            for (k, (u, applied)) in recording.u.iter().zip(&applied).enumerate() {
                fifo.push(u);
                // Step k is the step of the newest push.
                let gap = (fifo.applied(-1) - applied).norm();
                assert!(gap < 1e-9, "step {k} at {dead_time_s:?}: gap {gap:e}");
            }
        }
    }

    #[test]
    fn a_run_is_split_evenly_and_a_short_one_left_out() {
        let mut is_usable = vec![true; 1000];
        is_usable[700] = false; // runs of 700 and 299
        assert_eq!(cut(&is_usable, 300), vec![0..350, 350..700]);
        assert_eq!(cut(&is_usable, 299), vec![0..350, 350..700, 701..1000]);
        assert_eq!(cut(&[], 300), vec![]);
        assert_eq!(cut(&[false; 5], 0), vec![]);
    }

    proptest! {
        #[test]
        fn pieces_are_long_enough_even_and_use_every_step(
            is_usable in prop::collection::vec(prop::bool::weighted(0.95), 0..400),
            min_steps in 1_usize..50,
        ) {
            let pieces = cut(&is_usable, min_steps);
            let mut in_piece = vec![false; is_usable.len()];
            for piece in &pieces {
                prop_assert!((min_steps..2 * min_steps).contains(&piece.len()), "{piece:?}");
                for k in piece.clone() {
                    prop_assert!(is_usable[k] && !in_piece[k], "step {k}");
                    in_piece[k] = true;
                }
            }
            for run in is_usable.iter().zip(&in_piece).collect::<Vec<_>>().chunk_by(|a, b| a.0 == b.0) {
                let used = run.iter().filter(|(_, in_piece)| **in_piece).count();
                let is_long = *run[0].0 && run.len() >= min_steps;
                prop_assert_eq!(used, if is_long { run.len() } else { 0 });
            }
        }
    }
}
