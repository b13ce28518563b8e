//! Clock and link of a live tick: deadline, times of its stages, and what it sends.

use tello_flight::cycle::{Outcome, TickStage, Timing, Watch};
use tello_io::clock::{Clock, SpanNs, TimeNs};
use tello_io::tello::DroneLink;

/// The clock and the link of a live tick, and the notes that a replay and the summary need.
pub(super) struct LiveWatch<'a> {
    clock: Clock,
    drone: &'a DroneLink,
    /// Whether the link did not take the order of this tick.
    pub(super) has_lost_order: bool,
    begin: TimeNs,
    /// From the control thread to the socket, of the sticks of the tick before.
    sticks_latency: SpanNs,
    late_at: TimeNs,
    polls: u32,
    /// Poll at which the tick was late first, if it was.
    pub(super) late_at_poll: Option<u32>,
    /// End of the last stage.
    marked: TimeNs,
    estimate: SpanNs,
    plan: SpanNs,
    sent: SpanNs,
}

impl<'a> LiveWatch<'a> {
    pub(super) fn new(clock: Clock, late_at: TimeNs, drone: &'a DroneLink) -> Self {
        let begin = clock.now();
        Self {
            clock,
            drone,
            has_lost_order: false,
            begin,
            sticks_latency: drone.counters.sticks_latency(),
            late_at,
            polls: 0,
            late_at_poll: None,
            marked: begin,
            estimate: SpanNs(0),
            plan: SpanNs(0),
            sent: SpanNs(0),
        }
    }

    pub(super) fn timing(&self, step: u64, lateness: SpanNs) -> Timing {
        Timing {
            step,
            late_ns: lateness.0,
            estimate_ns: self.estimate.0,
            plan_ns: self.plan.0,
            sent_ns: self.sent.0,
            socket_latency_ns: self.sticks_latency.0,
            tick_ns: self.clock.now().since(self.begin).0,
        }
    }
}

impl Watch for LiveWatch<'_> {
    fn is_late(&mut self) -> bool {
        // Once late, always late: a replay counts polls up to the first.
        if self.late_at_poll.is_none() && self.clock.now() >= self.late_at {
            self.late_at_poll = Some(self.polls);
        }
        self.polls = self.polls.saturating_add(1);
        self.late_at_poll.is_some()
    }

    fn mark(&mut self, stage: TickStage) {
        let now = self.clock.now();
        let span = now.since(self.marked);
        match stage {
            TickStage::Estimated => self.estimate = span,
            TickStage::Planned => self.plan = span,
        }
        self.marked = now;
    }

    fn send(&mut self, out: &Outcome) {
        if let Some(order) = out.order() {
            self.has_lost_order = self.drone.order(order).is_err();
        }
        self.drone.send(out.approved, out.pose_is_airborne());
        self.sent = self.clock.now().since(self.begin);
    }
}
