//! The control loop: fills the inbox, ticks, sends, hands the record to the logger.
//!
//! Owns the fixed period and nothing of control. It waits for nothing but its next deadline and, for
//! `real_time.frame_wait_s` at most, the frame that is due then.

mod end_condition;
mod live_watch;
mod orders;
mod thread;

use std::iter;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use horizon_model::rows::pose;
use rtrb::Producer;
use tello_eval::flight_log::TickRecord;
use tello_eval::flight_summary::LoopEnd;
use tello_flight::cycle::{
    Inbox, Operator, Outcome, SIGHTING_AGE_MAX, SIGHTINGS_MAX, Tick, is_flight_phase,
};
use tello_flight::{Incidents, Phase};
use tello_io::clock::{Beat, Clock, Ticker, TickerError, TimeNs};
use tello_io::log::Recorder;
use tello_io::manual::ManualControls;
use tello_io::mocap::MocapFeed;
use tello_io::tello::DroneLink;

use self::end_condition::EndCondition;
use self::live_watch::LiveWatch;
pub(super) use self::orders::Orders;
use self::orders::meaning;
pub(super) use self::thread::ControlThread;
use super::drill::InjectedFailure;
use super::loop_times::LoopTimes;
use super::status::{STATUS_PERIOD, Status};

/// The end of the loop and the log to close, or why the loop could not go on.
pub(super) type LoopResult = Result<(LoopEnd, Recorder<TickRecord>), TickerError>;

/// Everything that the control thread talks to.
pub(super) struct ControlLoop {
    pub(super) clock: Clock,
    pub(super) cycle: Box<dyn Tick>,
    pub(super) times: LoopTimes,
    /// Whether the vehicle is carried by hand: no take-off is waited for.
    pub(super) is_dry_run: bool,
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
    pub(super) controls: ManualControls,
    /// Orders to the vehicle.
    pub(super) orders: Orders,
    /// A failure on order.
    pub(super) drill: Option<InjectedFailure>,
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
            let is_in_vain = self.is_dry_run
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
        let is_in_flight = is_flight_phase(end.phase) && !self.is_dry_run;
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
        let input = self.controls.poll(inbox.now);
        let by_signal = self.asks_to_land.load(Ordering::Relaxed).then_some(Operator::Land);
        let by_hand = input.order.map(|order| meaning(order, &input));
        // Before the first tick nothing is known of the poses.
        if inbox.step > 0
            && self.orders.lapse(inbox.now, before.phase, before.faults_last, &self.times)
        {
            self.controls.note_lapsed_take_off();
        }
        for order in [by_signal, by_hand].into_iter().flatten() {
            self.orders.give(order, inbox.now);
        }
        inbox.operator = self.orders.strongest;
        // A drone that was landed in place of this loop: for the supervisor and the log.
        inbox.incidents = Incidents {
            is_guardian_lost: self.drone.counters.has_lost_guardian(),
            has_landed_unasked: self.drone.counters.has_landed_unasked(),
            has_input_expired: input.has_expired,
            is_mocap_undated: !self.is_dry_run && !self.feed.counters.has_clock(),
        };
        inbox.manual = input.sticks.map(Into::into);
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

/// Where the obstacle that moves was seen last, if it was since the last tick: what was seen longer ago than
/// [`SIGHTING_AGE_MAX`] is elsewhere by now. m
fn newest_place(feed: &mut MocapFeed, now: TimeNs) -> Option<[f64; 3]> {
    let newest =
        iter::from_fn(|| feed.sightings.pop().ok()).filter(|it| it.pose.is_some()).last()?;
    let is_new = now.since(newest.measured_at) <= SIGHTING_AGE_MAX;
    newest.pose.filter(|_| is_new).map(|at| [at[pose::X], at[pose::Y], at[pose::Z]])
}
