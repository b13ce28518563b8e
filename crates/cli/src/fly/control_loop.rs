//! The control thread: fills the inbox, ticks, sends, hands the record to the logger.
//!
//! Owns the fixed period and nothing of control. It waits for nothing but its next deadline and, for
//! `real_time.frame_wait_s` at most, the frame that is due then.

mod orders;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::{io, iter};

use horizon_model::rows::pose;
use rtrb::Producer;
use tello_eval::flight_log::TickRecord;
use tello_eval::flight_summary::LoopEnd;
use tello_flight::cycle::{
    Inbox, Operator, Outcome, SIGHTING_AGE_MAX, SIGHTINGS_MAX, Tick, TickStage, Timing, Watch,
    is_flight_phase,
};
use tello_flight::{Incidents, Phase};
use tello_io::clock::{Beat, Clock, SpanNs, Ticker, TickerError, TimeNs, request_real_time};
use tello_io::log::Recorder;
use tello_io::manual::Person;
use tello_io::mocap::MocapFeed;
use tello_io::tello::{DroneLink, DroneStatus};
use tokio::sync::oneshot;

pub(super) use self::orders::Orders;
use self::orders::meaning;
use super::DISK_WAIT_MAX;
use super::drill::InjectedFailure;
use super::loop_times::LoopTimes;
use super::status::{STATUS_PERIOD, Status};
use crate::stdio;

/// Time that the loop goes on after the flight, so that the log shows the drone on the ground.
const SETTLE: SpanNs = SpanNs::from_ms(500);

/// Time in which a drone that reports to fly is ordered to land while its landing is unconfirmed.
const SETTLE_UNCONFIRMED: SpanNs = SpanNs::from_ms(15_000);

/// Everything that the control thread talks to.
pub(super) struct ControlLoop {
    pub(super) clock: Clock,
    pub(super) cycle: Box<dyn Tick>,
    pub(super) times: LoopTimes,
    /// Whether the vehicle is carried by hand: no take-off is waited for.
    pub(super) is_carried: bool,
    /// Poses; it gets whether the vehicle may be in the air.
    pub(super) feed: MocapFeed,
    /// Places of the obstacle that moves, if one does.
    pub(super) moving_feed: Option<MocapFeed>,
    pub(super) drone: DroneLink,
    pub(super) recorder: Recorder<TickRecord>,
    pub(super) status: Producer<Status>,
    /// Set by a signal; never cleared.
    pub(super) asks_to_land: Arc<AtomicBool>,
    /// The person at the controls.
    pub(super) person: Person,
    /// Orders to the vehicle.
    pub(super) orders: Orders,
    /// A failure on order.
    pub(super) drill: Option<InjectedFailure>,
}

/// Where the obstacle that moves was seen last, if it was since the last tick: what was seen longer ago than
/// [`SIGHTING_AGE_MAX`] is elsewhere by now. m
fn newest_place(feed: &mut MocapFeed, now: TimeNs) -> Option<[f64; 3]> {
    let newest =
        iter::from_fn(|| feed.sightings.pop().ok()).filter(|it| it.pose.is_some()).last()?;
    let is_new = now.since(newest.measured_at) <= SIGHTING_AGE_MAX;
    newest.pose.filter(|_| is_new).map(|at| [at[pose::X], at[pose::Y], at[pose::Z]])
}

/// The end of the loop and the log to close, or why the loop could not go on.
pub(super) type LoopResult = Result<(LoopEnd, Recorder<TickRecord>), TickerError>;

/// The thread of the loop. Dropping it, as a panic beside it does, asks to land and waits for the end: the
/// log is closed then, whatever landed the drone.
pub(super) struct ControlThread {
    thread: Option<JoinHandle<LoopResult>>,
    asks_to_land: Arc<AtomicBool>,
}

impl ControlThread {
    /// Runs `control` with the priority of real time and, if one is named, on `core`; `done` reports its end.
    ///
    /// # Errors
    /// The system gives no thread.
    pub(super) fn start(
        control: ControlLoop,
        core: Option<usize>,
        done: oneshot::Sender<()>,
    ) -> io::Result<Self> {
        let asks_to_land = Arc::clone(&control.asks_to_land);
        let thread = thread::Builder::new().name("tello-control".into()).spawn(move || {
            for warning in request_real_time(core) {
                stdio::note(format_args!("warning: {warning}"));
            }
            let end = control.run();
            // The receiver is gone if the main thread has failed meanwhile.
            done.send(()).ok();
            end
        })?;
        Ok(Self { thread: Some(thread), asks_to_land })
    }

    /// Waits for the end; `None` after a panic.
    pub(super) fn join(mut self) -> Option<LoopResult> {
        self.thread.take()?.join().ok()
    }
}

impl Drop for ControlThread {
    fn drop(&mut self) {
        let Some(thread) = self.thread.take() else { return };
        self.asks_to_land.store(true, Ordering::Relaxed);
        // A second panic has been printed, and no summary is left that could name a log that cannot be closed.
        if let Ok(Ok((_, recorder))) = thread.join() {
            recorder.stop(|waited| waited >= DISK_WAIT_MAX).ok();
        }
    }
}

impl ControlLoop {
    /// Ticks until the flight is over.
    ///
    /// # Errors
    /// The operating system refuses to sleep.
    pub(super) fn run(mut self) -> LoopResult {
        let LoopTimes { period, ground_wait, frame_wait, .. } = self.times;
        let arrival = Arc::clone(&self.feed.arrival);
        let mut ticker = Ticker::new(self.clock, period).with_frames(arrival, frame_wait);
        let mut record = TickRecord::with_buffers(&self.cycle.new_outcome());
        let mut end = LoopEnd::default();
        let mut end_condition = EndCondition::new(ground_wait);
        let mut is_drilled = false;
        let period_ns = period.duration().as_nanos().max(1);
        let status_ticks = (STATUS_PERIOD.as_nanos() / period_ns).max(1);
        for step in 0.. {
            if let Some(drill) = self.drill {
                drill.inject(self.clock.now(), &mut is_drilled);
            }
            let beat = ticker.wait()?;
            record.inbox.open(step, beat.due.after(beat.lateness));
            record.inbox.skipped = beat.skipped;
            end.sightings_dropped += self.fill(&mut record.inbox, &end);
            end_condition.receive(record.inbox.drone);
            end.has_frames |= !record.inbox.sightings.is_empty();
            let has_lost_order = self.tick(&mut record, beat);
            end.orders_lost += u64::from(has_lost_order);
            ticker.follow(&record.inbox.sightings);

            self.note_outcome(&record.out, &mut end);
            if u128::from(step).is_multiple_of(status_ticks) {
                // If the ring is full this line is dropped: the display needs a recent one only.
                self.status.push(Status::of(&record)).ok();
            }
            let is_in_vain = self.is_carried
                && !end.has_frames
                && record.inbox.now.since(TimeNs(0)) > ground_wait;
            let pose_is_airborne = record.out.pose_is_airborne();
            let is_over =
                end_condition.update(&record.inbox, end.phase, pose_is_airborne) || is_in_vain;
            if let Some(mut slot) = self.recorder.borrow() {
                std::mem::swap(&mut *slot, &mut record);
                self.recorder.submit(slot);
            }
            if is_over {
                break;
            }
        }
        end.records_dropped = self.recorder.dropped();
        Ok((end, self.recorder))
    }

    /// Notes the outcome of a tick, and reports to the readers of the mocap whether the vehicle may be in the air.
    fn note_outcome(&self, out: &Outcome, end: &mut LoopEnd) {
        let was_flying = end.phase == Phase::Flying;
        end.note(out.decision);
        end.targets_reached = out.targets_reached;
        if was_flying && end.phase != Phase::Flying {
            end.found = self.cycle.parameter_estimate();
        }
        // A carried vehicle is not steered, and may be carried for hours.
        let is_in_flight = is_flight_phase(end.phase) && !self.is_carried;
        for feed in iter::once(&self.feed).chain(&self.moving_feed) {
            feed.airborne.store(is_in_flight, Ordering::Relaxed);
        }
    }

    /// Puts into the inbox what arrived since the last tick. Returns the number of sightings that were dropped.
    fn fill(&mut self, inbox: &mut Inbox, before: &LoopEnd) -> u64 {
        let mut dropped = 0;
        // A full inbox drops its oldest sighting.
        while let Ok(sighting) = self.feed.sightings.pop() {
            if inbox.sightings.len() == SIGHTINGS_MAX {
                inbox.sightings.remove(0);
                dropped += 1;
            }
            inbox.sightings.push(sighting);
        }
        inbox.obstacle_w = self.moving_feed.as_mut().and_then(|feed| newest_place(feed, inbox.now));
        inbox.drone = self.drone.poll_status();
        let hand = self.person.poll(inbox.now);
        let by_signal = self.asks_to_land.load(Ordering::Relaxed).then_some(Operator::Land);
        let by_hand = hand.ask.map(|ask| meaning(ask, &hand));
        // Before the first tick nothing is known of the poses.
        if inbox.step > 0
            && self.orders.lapse(inbox.now, before.phase, before.faults_last, &self.times)
        {
            self.person.note_lapsed_take_off();
        }
        for order in [by_signal, by_hand].into_iter().flatten() {
            self.orders.give(order, inbox.now);
        }
        inbox.operator = self.orders.strongest;
        // A drone that was landed in place of this loop: for the supervisor and the log.
        inbox.incidents = Incidents {
            is_guardian_lost: self.drone.counters.has_lost_guardian(),
            has_landed_unasked: self.drone.counters.has_landed_unasked(),
            has_input_expired: hand.has_expired,
            is_mocap_undated: !self.is_carried && !self.feed.counters.has_clock(),
        };
        inbox.manual = hand.sticks.map(Into::into);
        dropped
    }

    /// One tick with its times. Returns whether the link did not take its order.
    fn tick(&mut self, record: &mut TickRecord, beat: Beat) -> bool {
        let late_at = beat.due.after(self.times.solver_time);
        let mut watch = LiveWatch::new(self.clock, late_at, &self.drone);
        self.cycle.tick(&record.inbox, &mut watch, &mut record.out);
        record.inbox.late_at_poll = watch.late_at_poll;
        record.timing = watch.timing(record.inbox.step, beat.lateness);
        watch.has_lost_order
    }
}

/// When the loop ends.
struct EndCondition {
    ground_wait: SpanNs,
    is_flying: bool,
    /// When the phase was last one that goes on.
    went_on_at: TimeNs,
}

impl EndCondition {
    fn new(ground_wait: SpanNs) -> Self {
        Self { ground_wait, is_flying: false, went_on_at: TimeNs(0) }
    }

    fn receive(&mut self, status: Option<DroneStatus>) {
        self.is_flying = status.map_or(self.is_flying, |status| status.is_flying);
    }

    fn update(&mut self, inbox: &Inbox, phase: Phase, pose_is_airborne: Option<bool>) -> bool {
        // A person who holds the sticks may take time before the take-off.
        let person_holds_sticks = phase == Phase::Idle && inbox.manual.is_some();
        if matches!(phase, Phase::TakingOff | Phase::Flying | Phase::Landing) || person_holds_sticks
        {
            self.went_on_at = inbox.now;
        }
        let has_waited = inbox.now.since(self.went_on_at);
        match phase {
            Phase::TakingOff | Phase::Flying | Phase::Landing => false,
            Phase::Idle => {
                let is_ended = inbox.operator == Operator::Land || inbox.incidents.ends_flight();
                is_ended || has_waited > self.ground_wait
            }
            // The drone has time to receive the order again, and the log to show it on the ground.
            Phase::LandingUnconfirmed | Phase::MotorsStopped
                if self.is_flying || pose_is_airborne == Some(true) =>
            {
                has_waited > SETTLE_UNCONFIRMED
            }
            Phase::Landed | Phase::LandingUnconfirmed | Phase::MotorsStopped => has_waited > SETTLE,
        }
    }
}

/// The clock and the link of a live tick, and the notes that a replay and the summary need.
struct LiveWatch<'a> {
    clock: Clock,
    drone: &'a DroneLink,
    has_lost_order: bool,
    begin: TimeNs,
    /// From the control thread to the socket, of the sticks of the tick before.
    sticks_latency: SpanNs,
    late_at: TimeNs,
    polls: u32,
    late_at_poll: Option<u32>,
    /// End of the last stage.
    marked: TimeNs,
    estimate: SpanNs,
    plan: SpanNs,
    sent: SpanNs,
}

impl<'a> LiveWatch<'a> {
    fn new(clock: Clock, late_at: TimeNs, drone: &'a DroneLink) -> Self {
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

    fn timing(&self, step: u64, lateness: SpanNs) -> Timing {
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

#[cfg(test)]
mod tests;
