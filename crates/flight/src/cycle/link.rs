//! Whether the sent sticks act, and which ones did.
//!
//! Owns what the loop does with the link monitor's decision: the applied sticks in the estimator's window are corrected
//! back to the moment when the link changed.

use horizon_estim::Observed;
use horizon_model::InputFifo;
use horizon_model::rows::{Sticks, lag, pose, stick};
use nalgebra::SVector;

use super::dead_time::{DeadTime, DeadTimeChange};
use crate::ring::Ring;
use crate::{LinkDecision, LinkMonitor, LinkState};

/// Least length of the ring of sticks, in which the held command is found: longer than the monitor takes to notice an
/// outage. steps
const HELD_STEPS: usize = 64;

/// Link monitor and the sticks that would have been applied.
#[derive(Debug)]
pub(super) struct Link {
    dt_s: f64,
    monitor: LinkMonitor,
    dead_time: DeadTime,
    /// Largest stick of the controller while the link is down. 1
    stick_max: f64,
    /// Steps that the estimator can amend.
    window_steps: usize,
    /// The nominal inputs: applied if the link is up. 1
    nominal: Ring<Sticks>,
    state: LinkState,
    /// For how long the link has been in that state; the largest number before the first change. steps
    state_steps: usize,
    /// The sticks that act while an old command is held.
    held: Sticks,
}

impl Link {
    /// A link that is up, whose inputs are kept over `window_steps`.
    pub(super) fn new(
        monitor: LinkMonitor,
        dead_time: DeadTime,
        stick_max: f64,
        window_steps: usize,
        dt_s: f64,
    ) -> Self {
        let nominal = Ring::new(Sticks::zeros(), window_steps.max(HELD_STEPS));
        Self {
            dt_s,
            monitor,
            dead_time,
            stick_max,
            window_steps,
            nominal,
            state: LinkState::Up,
            state_steps: usize::MAX,
            held: Sticks::zeros(),
        }
    }

    /// Corrects the dead times of `fifo` by the motion that [`Link::update`] has received, and subtracts each
    /// correction from the monitor's errors; whether there is a correction.
    pub(super) fn correct_dead_time(&mut self, fifo: &mut InputFifo<{ stick::COUNT }>) -> bool {
        if self.is_up() && self.dead_time.end_return_if_done() {
            self.monitor.restart();
        }
        if !self.dead_time.correct(self.monitor.dead_time_errors()) {
            return false;
        }
        let before_steps = *fifo.dead_time_steps();
        fifo.correct(self.dead_time.change().map_or([0; stick::COUNT], |change| change.steps));
        self.monitor.correct_dead_time(&((fifo.dead_time_steps() - before_steps) * self.dt_s));
        true
    }

    /// The correction of the dead times; `None` if they stay as they are configured.
    pub(super) fn dead_time(&self) -> Option<DeadTimeChange> {
        self.dead_time.change()
    }

    /// Whether the sticks act later than the dead times may be corrected.
    pub(super) fn is_dead_time_long(&self) -> bool {
        self.dead_time.is_too_long()
    }

    /// Replaces the nominal inputs of the newest `steps` steps: `u_nominal(back)` would have been applied.
    pub(super) fn rewrite_nominal(&mut self, steps: usize, u_nominal: impl Fn(usize) -> Sticks) {
        for back in 0..steps.min(self.nominal.len()) {
            self.nominal.replace(back, u_nominal(back));
        }
    }

    /// Steps by which more of the sent sticks are asked for than without corrections.
    pub(super) fn capacity_steps(&self) -> usize {
        self.window_steps + self.dead_time.steps_max().unsigned_abs() as usize
    }

    pub(super) fn state(&self) -> LinkState {
        self.state
    }

    pub(super) fn is_up(&self) -> bool {
        !self.state.is_down()
    }

    /// The decision after a period in which `u_nominal` was applied if the link was up; and on a change of it,
    /// the number of steps since the change.
    pub(super) fn update(
        &mut self,
        u_nominal: &Sticks,
        observed: &Observed<{ pose::COUNT }>,
        p: &SVector<f64, { lag::COUNT }>,
    ) -> (LinkDecision, Option<usize>) {
        self.nominal.push(*u_nominal);
        let decision = self.monitor.update(u_nominal, observed, p);
        if self.is_up() && decision.state.is_down() {
            self.dead_time.note_outage();
        }
        self.state = decision.state;
        let since_steps = decision.onset_steps as usize;
        self.state_steps = self.state_steps.saturating_add(1);
        if decision.has_changed {
            self.state_steps = since_steps;
            self.held = self.nominal.back(since_steps.min(self.nominal.len() - 1));
        }
        (decision, decision.has_changed.then_some(since_steps.min(self.window_steps)))
    }

    /// For how many steps the newest decision holds; sticks before were applied by another decision.
    pub(super) fn state_steps(&self) -> usize {
        self.state_steps
    }

    /// The applied sticks `back` steps before the newest, by the newest decision.
    pub(super) fn applied(&self, back: usize) -> Sticks {
        self.outage_input().unwrap_or_else(|| self.nominal.back(back))
    }

    /// What acts in place of all that is sent; `None` while the link is up.
    pub(super) fn outage_input(&self) -> Option<Sticks> {
        match self.state {
            LinkState::Up => None,
            LinkState::Released => Some(Sticks::zeros()),
            LinkState::Held => Some(self.held),
        }
    }

    /// `u_plan` as it may be sent: limited while the link is down. In an outage few commands act; if the outage is in
    /// fact a hand or a push, full sticks would press against it.
    pub(super) fn limited(&self, u_plan: &Sticks) -> Sticks {
        if self.is_up() {
            *u_plan
        } else {
            u_plan.map(|u| u.clamp(-self.stick_max, self.stick_max))
        }
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::rows::Pose;
    use horizon_model::{Kinematic, Lagged, Model};

    use super::*;
    use crate::link::tests::{parameter, table};
    use crate::{LinkSettings, LinkTable};

    const DT_S: f64 = 0.02;
    const WINDOW_STEPS: usize = 10;
    const STICK_MAX: f64 = 0.4;

    /// A link whose dead times may change by so much. s
    fn link(dead_time_change_s: f64) -> Link {
        let table = LinkTable { dead_time_change_s, ..table() };
        let monitor = LinkMonitor::new(&LinkSettings::try_from(&table).unwrap(), DT_S);
        let dead_time = DeadTime::new(&table, &Sticks::new(0.34, 0.34, 0.04, 0.19), DT_S);
        Link::new(monitor, dead_time, STICK_MAX, WINDOW_STEPS, DT_S)
    }

    #[test]
    fn nominal_inputs_are_kept_beyond_the_end_of_the_ring_and_can_be_rewritten() {
        let (mut link, p) = (link(0.1), parameter());
        let nominal = |step: u32| Sticks::repeat(1e-3 * f64::from(step));
        for step in 0..200 {
            link.update(&nominal(step), &Observed::missing(), &p);
        }
        assert!(link.is_up() && link.outage_input().is_none());
        assert_eq!(link.limited(&Sticks::repeat(-1.0)), Sticks::repeat(-1.0));
        for back in 0..60 {
            assert_eq!(link.applied(back as usize), nominal(199 - back), "{back} steps ago");
        }
        link.rewrite_nominal(5, |_| Sticks::repeat(0.5));
        assert_eq!(link.applied(4), Sticks::repeat(0.5));
        assert_eq!(link.applied(5), nominal(194));
        assert_eq!(link.capacity_steps(), WINDOW_STEPS + 5);
    }

    #[test]
    fn sticks_that_do_not_act_are_replaced_back_to_the_onset_within_the_window() {
        let (mut link, p) = (link(0.1), parameter());
        let model = Lagged::default();
        let mut s = model.at_rest(&Pose::new(0.0, 0.0, 1.0, 0.2));
        let mut found = None;
        for step in 0..200 {
            let mut u = Sticks::zeros();
            u[stick::PITCH] = if step < 50 { 0.0 } else { 0.5 };
            // From step 50 on nothing of it reaches the vehicle.
            s = model.step(&s, &Sticks::zeros(), &p, DT_S);
            let (decision, since_steps) = link.update(&u, &Observed::full(model.observe(&s)), &p);
            if since_steps.is_some() {
                found = found.or(Some((step, decision.onset_steps, since_steps)));
            }
        }
        let (step, onset_steps, since_steps) = found.unwrap();
        assert!((50..100).contains(&step), "noticed in step {step}");
        assert_eq!(since_steps, Some(WINDOW_STEPS.min(onset_steps as usize)));
        assert_eq!((link.state(), link.is_up()), (LinkState::Released, false));
        assert_eq!(link.state_steps(), onset_steps as usize + 199 - step);
        assert_eq!(
            (link.outage_input(), link.applied(3)),
            (Some(Sticks::zeros()), Sticks::zeros())
        );
        let u_plan = Sticks::new(-0.9, 0.3, 0.41, 1.0);
        assert_eq!(link.limited(&u_plan), Sticks::new(-0.4, 0.3, 0.4, 0.4));
    }

    #[test]
    fn a_correction_is_taken_off_the_error_of_each_axis_as_far_as_the_axis_changes() {
        let mut link = link(0.3);
        let fifo = |pitch_s| {
            InputFifo::new(&[pitch_s, pitch_s, 0.04, 0.19], &Kinematic::INPUT, DT_S).unwrap()
        };
        let mut assumed = fifo(0.34).with_room(link.capacity_steps()).with_min_ratio(0.5).unwrap();
        // A vehicle that answers ten periods sooner, of which the correction may take eight.
        let mut real = fifo(0.14);
        let (model, p) = (Lagged::default(), parameter());
        let mut s = model.at_rest(&Pose::new(0.0, 0.0, 1.0, 0.2));
        let mut corrections = 0;
        for k in 0..1500 {
            let t_s = f64::from(k) * DT_S;
            let mut u = Sticks::zeros();
            u[stick::PITCH] = 0.3 * (3.0 * t_s).sin() + 0.25 * (8.0 * t_s).sin();
            for fifo in [&mut assumed, &mut real] {
                fifo.push(&u);
            }
            s = model.step(&s, &real.applied(-1), &p, DT_S);
            link.update(&assumed.applied(-1), &Observed::full(model.observe(&s)), &p);
            corrections += u32::from(link.correct_dead_time(&mut assumed));
        }
        assert_eq!((link.dead_time().unwrap().steps, corrections), ([-8; 4], 8));
        assert_eq!(*assumed.dead_time_steps(), Sticks::new(9.0, 9.0, 1.0, 4.75));
        // Yaw went from two periods to one. Its filter has seen no turn since: the error fades with `adapt_s`, 30 s.
        let left_s = link.monitor.yaw_dead_time_error_s().unwrap();
        assert!((0.3 * DT_S..=DT_S).contains(&left_s), "{left_s} s");
    }
}
