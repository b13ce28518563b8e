//! FIFO of sent inputs: what acts on the system now was sent one dead time ago.
//!
//! Owns the thesis' delay queue (section 4.3.10), generalized to one fractional dead time per axis.
//! The inputs to send are those of the controller, `horizon_control::Mpc`.

use crate::Vector;
use crate::row::Row;
use crate::setting::{SettingError, in_range, positive, vector};

/// Longest dead time that is accepted. s
pub const DEAD_TIME_MAX_S: f64 = 2.0;

/// Longest dead time in steps that is accepted: 2 s at 100 kHz, and a bound of the memory. steps
const STEPS_MAX: f64 = 200_000.0;

/// How far [`InputFifo::applied`] may look behind the coming step.
const LOOK_BACK_STEPS: usize = 2;

/// Inputs kept beyond the dead time and the look back: the neighbour of a fractional dead time, and one to spare.
const EXTRA_INPUTS: usize = 2;

/// Inputs sent so far, readable as inputs applied at a time.
///
/// With a dead time of `whole + fraction` steps, `0 <= fraction < 1`, the input applied on an axis during
/// step `k` is `(1 - fraction) u[k - whole] + fraction u[k - whole - 1]`: linear between what was sent. Before
/// the first push zeros were sent.
#[derive(Debug, Clone, PartialEq)]
pub struct InputFifo<const NU: usize> {
    /// Dead time per axis. steps, >= 0
    dead_time_steps: Vector<NU>,
    /// Dead time per axis before a correction. steps, >= 0
    nominal_steps: Vector<NU>,
    /// Fraction of each nominal dead time that a correction leaves. 1, 0..=1
    min_ratio: f64,
    /// Ring of sent inputs; `newest` is the latest.
    sent: Vec<Vector<NU>>,
    newest: usize,
}

impl<const NU: usize> InputFifo<NU> {
    /// An empty FIFO. The only allocation.
    ///
    /// # Errors
    /// `dead_time_s` has the wrong length or an entry outside 0..=2 s; `dt_s` is not positive, or so short that a dead
    /// time has more than 200,000 steps.
    pub fn new(dead_time_s: &[f64], rows: &[Row; NU], dt_s: f64) -> Result<Self, SettingError> {
        let dt_s = positive("dt_s", dt_s)?;
        let dead_time_s = vector("dead_time_s", dead_time_s, rows, |key, value| {
            in_range(key, value, 0.0..=DEAD_TIME_MAX_S)
        })?;
        // 0.6 / 0.02 is 30 only up to rounding; a whole number of steps must stay whole.
        let dead_time_steps = dead_time_s.map(|d| {
            let steps = d / dt_s;
            if (steps - steps.round()).abs() < 1e-9 { steps.round() } else { steps }
        });
        if dead_time_steps.max() > STEPS_MAX {
            let rule = format!("a dead time of at most {STEPS_MAX} steps");
            return Err(SettingError::new("dt_s", dt_s, rule));
        }
        let depth = crate::whole(dead_time_steps.max()) + LOOK_BACK_STEPS + EXTRA_INPUTS;
        let sent = vec![Vector::zeros(); depth];
        Ok(Self {
            dead_time_steps,
            nominal_steps: dead_time_steps,
            min_ratio: 0.0,
            sent,
            newest: 0,
        })
    }

    /// The FIFO with room for `steps` more inputs: for a longer dead time ([`InputFifo::correct`]) or a look further
    /// back ([`InputFifo::applied`]). Allocates; nothing must have been pushed.
    #[must_use]
    pub fn with_room(mut self, steps: usize) -> Self {
        self.sent.resize(self.sent.len() + steps, Vector::zeros());
        self
    }

    /// The FIFO whose corrections leave at least `min_ratio` of each dead time, 0..=1; without it, 0.
    ///
    /// # Errors
    /// `min_ratio` is not in its range.
    pub fn with_min_ratio(mut self, min_ratio: f64) -> Result<Self, SettingError> {
        self.min_ratio = in_range("min_ratio", min_ratio, 0.0..=1.0)?;
        Ok(self)
    }

    /// Makes each dead time longer than [`InputFifo::new`] was given by its `steps`, or shorter; none falls below
    /// its least one ([`InputFifo::with_min_ratio`]). What was sent stays. A longer one takes as much room, see
    /// [`InputFifo::with_room`].
    ///
    /// Real time: no allocation, constant cost.
    pub fn correct(&mut self, steps: [i32; NU]) {
        let longer = Vector::from(steps.map(f64::from));
        self.dead_time_steps = self
            .nominal_steps
            .zip_map(&longer, |steps, longer| (steps + longer).max(self.min_ratio * steps));
    }

    /// Dead time of each axis as [`InputFifo::new`] was given it. steps
    pub fn nominal_steps(&self) -> &Vector<NU> {
        &self.nominal_steps
    }

    /// Remembers `u_sent` as the input of the newest step.
    ///
    /// Real time: no allocation, constant cost.
    pub fn push(&mut self, u_sent: &Vector<NU>) {
        self.newest = (self.newest + 1) % self.sent.len();
        self.sent[self.newest] = *u_sent;
    }

    /// The input that acts during the step `ahead` of the coming one, -2 or later, or as much earlier as there is
    /// [room](InputFifo::with_room).
    ///
    /// The coming step (`ahead == 0`) is the one whose input is pushed next; `ahead == -1` is the
    /// step of the newest push. A push moves the coming step on by one:
    ///
    /// ```text
    /// pushed               u[k-2]    u[k-1]    u[k]
    /// step                   k-2       k-1       k        k+1
    /// ahead, before u[k]     -2        -1        0         1
    /// ahead, after u[k]      -3        -2       -1         0
    /// ```
    ///
    /// Where an axis would need an input that is not yet sent, the newest one is held; where it would need one that is
    /// forgotten for lack of room, the oldest.
    ///
    /// # Panics
    /// With debug assertions, where an axis would need a forgotten input.
    ///
    /// Real time: no allocation, constant cost.
    pub fn applied(&self, ahead: isize) -> Vector<NU> {
        Vector::from_fn(|axis, _| {
            let whole = self.dead_time_steps[axis].floor();
            let fraction = self.dead_time_steps[axis] - whole;
            // Age 0 is the newest push, one step before the coming one.
            let age = crate::whole(whole).cast_signed() - 1 - ahead;
            let late = self.sent_at_age(age)[axis];
            if fraction > 0.0 {
                (1.0 - fraction) * late + fraction * self.sent_at_age(age + 1)[axis]
            } else {
                late
            }
        })
    }

    /// Dead time of each axis. steps
    pub fn dead_time_steps(&self) -> &Vector<NU> {
        &self.dead_time_steps
    }

    /// Number of coming steps whose applied input is already sent on every axis: the shortest dead
    /// time, rounded down. steps
    ///
    /// Real time: no allocation, constant cost.
    pub fn known_steps(&self) -> usize {
        crate::whole(self.dead_time_steps.min())
    }

    /// The inputs that act in the coming steps and are sent on every axis, oldest first.
    ///
    /// Real time: no allocation; each in constant cost.
    pub fn in_transit(&self) -> impl Iterator<Item = Vector<NU>> {
        (0..self.known_steps().cast_signed()).map(move |ahead| self.applied(ahead))
    }

    /// The last input [in transit](InputFifo::in_transit): it acts directly before a plan. Without a dead time it is
    /// the one that acts now.
    ///
    /// Real time: no allocation, constant cost.
    pub fn last_in_transit(&self) -> Vector<NU> {
        self.applied(self.known_steps().cast_signed() - 1)
    }

    /// The input to send now for a `plan` of one input for each coming step from step [`InputFifo::known_steps`] on. A
    /// row is what is planned for the step in which it begins to act. With a fraction of a step in its dead time it
    /// acts in two, and is the mean of what is planned for both. The last input of a plan that is too short is held;
    /// zeros without a plan.
    ///
    /// Real time: no allocation, constant cost.
    pub fn to_send(&self, plan: &[Vector<NU>]) -> Vector<NU> {
        let planned =
            |step: usize, axis: usize| plan.get(step).or(plan.last()).map_or(0.0, |u| u[axis]);
        Vector::from_fn(|axis, _| {
            let steps = self.dead_time_steps[axis];
            let (step, fraction) = (crate::whole(steps) - self.known_steps(), steps.fract());
            (1.0 - fraction) * planned(step, axis) + fraction * planned(step + 1, axis)
        })
    }

    /// Time from sending an input until it acts on every axis: the longest dead time, rounded up. steps
    ///
    /// Real time: no allocation, constant cost.
    pub fn longest_steps(&self) -> usize {
        crate::whole(self.dead_time_steps.max().ceil())
    }

    /// The latest pushed input, in its units; zero before the first.
    pub fn newest(&self) -> &Vector<NU> {
        &self.sent[self.newest]
    }

    fn sent_at_age(&self, age: isize) -> &Vector<NU> {
        let depth = self.sent.len();
        debug_assert!(age < depth.cast_signed(), "age {age} of {depth}");
        let age = usize::try_from(age).unwrap_or(0).min(depth - 1);
        &self.sent[(self.newest + depth - age) % depth]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vector;

    const ROWS: [Row; 2] = [Row::linear("a", "1"), Row::linear("b", "1")];
    const DT_S: f64 = 0.02;

    /// FIFO after pushing 1, 2, .. `count` on the first axis and their negatives on the second.
    fn counted(dead_time_s: [f64; 2], count: u32) -> InputFifo<2> {
        let mut fifo = InputFifo::new(&dead_time_s, &ROWS, DT_S).unwrap();
        for k in 1..=count {
            fifo.push(&Vector::from([f64::from(k), -f64::from(k)]));
        }
        fifo
    }

    fn assert_close(got: Vector<2>, expected: [f64; 2]) {
        assert!((got - Vector::from(expected)).norm() < 1e-9, "{got} instead of {expected:?}");
    }

    #[test]
    fn what_is_sent_is_the_mean_of_the_planned_inputs_of_the_steps_in_which_it_acts() {
        let plan = [[1.0, 10.0], [2.0, 20.0], [4.0, 40.0]].map(Vector::from);
        for (dead_time_s, expected) in [
            ([0.04, 0.04], [1.0, 10.0]),
            ([0.045, 0.055], [1.25, 17.5]),
            ([0.04, 0.07], [1.0, 30.0]),
            ([0.2, 0.0], [4.0, 10.0]),
        ] {
            assert_close(counted(dead_time_s, 9).to_send(&plan), expected);
        }
        assert_close(counted([0.045, 0.055], 9).to_send(&[]), [0.0; 2]);
    }

    #[test]
    fn an_input_acts_one_dead_time_after_it_was_sent() {
        // The coming step is 101; what acts in it was sent in step 101 - 30.
        let fifo = counted([0.6, 0.6], 100);
        assert_eq!((fifo.known_steps(), fifo.longest_steps()), (30, 30));
        assert_close(fifo.applied(0), [71.0, -71.0]);
        assert_close(fifo.applied(-2), [69.0, -69.0]);
        assert_close(fifo.applied(29), [100.0, -100.0]);
    }

    #[test]
    fn axes_have_their_own_fractional_dead_time() {
        // 0.25 and 0.07 s are 12.5 and 3.5 steps.
        let fifo = counted([0.25, 0.07], 50);
        assert_close(fifo.applied(0), [38.5, -47.5]);
        assert_eq!((fifo.known_steps(), fifo.longest_steps()), (3, 13));
        let in_transit: Vec<_> = fifo.in_transit().collect();
        assert_eq!(in_transit, [fifo.applied(0), fifo.applied(1), fifo.applied(2)]);
        assert_eq!(fifo.last_in_transit(), fifo.applied(2));
    }

    #[test]
    fn what_is_not_yet_sent_is_held() {
        let fifo = counted([0.1, 0.0], 20);
        assert_close(fifo.applied(0), [16.0, -20.0]);
        assert_close(fifo.applied(50), [20.0, -20.0]);
    }

    #[test]
    fn a_correction_shifts_all_axes_and_none_below_zero() {
        // 0.25 and 0.07 s are 12.5 and 3.5 steps.
        let mut fifo = InputFifo::new(&[0.25, 0.07], &ROWS, DT_S).unwrap().with_room(8);
        for k in 1..=50_u32 {
            fifo.push(&Vector::from([f64::from(k), -f64::from(k)]));
        }
        assert_close(fifo.applied(0), [38.5, -47.5]);
        fifo.correct([5; 2]);
        assert_close(fifo.applied(0), [33.5, -42.5]);
        assert_close(fifo.applied(-3), [30.5, -39.5]);
        assert_eq!((fifo.known_steps(), fifo.longest_steps()), (8, 18));
        fifo.correct([-5; 2]);
        assert_close(fifo.applied(0), [43.5, -50.0]);
        assert_eq!(fifo.known_steps(), 0);
        assert!((fifo.nominal_steps()[1] - 3.5).abs() < 1e-9);
        fifo.correct([0; 2]);
        assert_close(fifo.applied(0), [38.5, -47.5]);
    }

    #[test]
    fn a_correction_leaves_each_axis_its_part() {
        let mut fifo = InputFifo::new(&[0.24, 0.08], &ROWS, DT_S).unwrap();
        fifo = fifo.with_min_ratio(0.5).unwrap();
        for k in 1..=50_u32 {
            fifo.push(&Vector::from([f64::from(k), -f64::from(k)]));
        }
        // 12 and 4 steps: the second axis keeps two of them.
        fifo.correct([-3; 2]);
        assert_close(fifo.applied(0), [42.0, -49.0]);
        fifo.correct([-50; 2]);
        assert_close(fifo.applied(0), [45.0, -49.0]);
    }

    #[test]
    fn zeros_were_applied_before_the_first_push() {
        let fifo = counted([0.6, 0.6], 0);
        assert_close(fifo.applied(-2), [0.0, 0.0]);
        assert_close(counted([0.6, 0.6], 5).applied(0), [0.0, 0.0]);
    }

    #[test]
    fn a_dead_time_or_period_outside_of_its_range_is_refused_with_key_value_and_rule() {
        let error = InputFifo::new(&[0.1, f64::NAN], &ROWS, DT_S).unwrap_err();
        assert_eq!(error.to_string(), "dead_time_s[1] = NaN: expected 0.0..=2.0");
        assert!(InputFifo::new(&[0.1, -0.1], &ROWS, DT_S).is_err());
        assert!(InputFifo::new(&[0.1], &ROWS, DT_S).is_err());
        assert!(InputFifo::new(&[0.1, 0.1], &ROWS, 0.0).is_err());
        let error = InputFifo::new(&[0.1, 0.1], &ROWS, 1e-300).unwrap_err();
        assert!(
            error.to_string().ends_with(": expected a dead time of at most 200000 steps"),
            "{error}"
        );
        for min_ratio in [f64::NAN, -1.0, 3.0] {
            let error = counted([0.1, 0.1], 0).with_min_ratio(min_ratio).unwrap_err();
            assert!(error.to_string().starts_with("min_ratio = "), "{error}");
        }
    }
}
