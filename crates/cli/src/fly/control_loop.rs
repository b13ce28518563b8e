//! The control thread: fills the inbox, ticks, sends, hands the record to the logger.
//!
//! Owns the fixed period and nothing of control. It waits for nothing but its next deadline.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rtrb::{Consumer, Producer};
use tello_control::{FaultSet, Phase};
use tello_io::clock::{Clock, SpanNs, Ticker, TickerError, TimeNs};
use tello_io::log::Recorder;
use tello_io::tello::{DroneLink, DroneStatus};
use tello_io::vicon::Sighting;

use super::status::Status;
use crate::cycle::{Inbox, Operator, SIGHTINGS_MAX, Stage, Tick, Timing, Watch};
use crate::flight_log::TickRecord;

/// Ticks between two status lines.
const STATUS_EVERY_TICKS: u64 = 10;

/// How long the loop goes on after the flight, so that the log shows the drone on the ground.
const SETTLE: SpanNs = SpanNs::from_ms(500);

/// How long a drone that says it flies is told to land after a fault.
const SETTLE_IN_FAULT: SpanNs = SpanNs::from_ms(15_000);

/// Everything that the control thread talks to.
pub(super) struct ControlLoop {
    pub(super) clock: Clock,
    pub(super) cycle: Box<dyn Tick>,
    pub(super) period: SpanNs,
    /// Time for the solvers inside a period.
    pub(super) solver_time: SpanNs,
    /// How long to wait on the ground for mocap and drone.
    pub(super) patience: SpanNs,
    pub(super) sightings: Consumer<Sighting>,
    pub(super) drone: DroneLink,
    pub(super) recorder: Recorder<TickRecord>,
    pub(super) status: Producer<Status>,
    /// Set by Ctrl-C; never cleared.
    pub(super) asks_to_land: Arc<AtomicBool>,
}

/// How the loop ended.
#[derive(Debug, Clone, Copy)]
pub(super) struct LoopEnd {
    /// Phase after the last tick.
    pub(super) phase: Phase,
    /// Every fault that was present at some time.
    pub(super) faults: FaultSet,
    /// Records that the logger could not take.
    pub(super) records_dropped: u64,
}

impl ControlLoop {
    /// Ticks until the flight is over.
    ///
    /// # Errors
    /// The operating system refuses to sleep.
    pub(super) fn run(mut self) -> Result<(LoopEnd, Recorder<TickRecord>), TickerError> {
        let mut ticker = Ticker::new(self.clock, self.period)?;
        let mut record = TickRecord::with_buffers(&self.cycle.new_outcome());
        let mut end =
            LoopEnd { phase: Phase::Idle, faults: FaultSet::default(), records_dropped: 0 };
        let mut over = Over::new(self.patience);
        for step in 0.. {
            let beat = ticker.wait()?;
            record.inbox.open(step, beat.due.after(beat.lateness));
            self.fill(&mut record.inbox);
            over.hear(record.inbox.drone);
            self.tick(&mut record);
            record.timing.late_ns = beat.lateness.0;
            record.timing.missed = beat.skipped;

            end.phase = record.out.phase();
            end.faults =
                record.out.ruling.map_or(end.faults, |ruling| end.faults.union(ruling.faults));
            if step % STATUS_EVERY_TICKS == 0 {
                // A line that nobody has taken yet is replaced by the next: no loss.
                self.status.push(Status::of(&record.out, &record.timing)).ok();
            }
            let is_over = over.is_over(record.inbox.now, end.phase, record.inbox.operator);
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

    fn fill(&mut self, inbox: &mut Inbox) {
        while inbox.sightings.len() < SIGHTINGS_MAX
            && let Ok(sighting) = self.sightings.pop()
        {
            inbox.sightings.push(sighting);
        }
        inbox.drone = self.drone.poll_status();
        let asks_to_land = self.asks_to_land.load(Ordering::Relaxed);
        inbox.operator = if asks_to_land { Operator::Land } else { Operator::Fly };
    }

    /// Decides and sends; everything after the send is bookkeeping.
    fn tick(&mut self, record: &mut TickRecord) {
        let mut watch = LiveWatch::new(self.clock, self.solver_time);
        self.cycle.tick(&record.inbox, &mut watch, &mut record.out);
        if let Some(order) = record.out.order() {
            // A full queue is emptied by the next tick; the supervisor repeats its orders.
            self.drone.order(order).ok();
        }
        self.drone.send(record.out.approved);
        record.inbox.late_at_poll = watch.late_at_poll;
        record.timing = watch.timing(record.inbox.step);
    }
}

/// When to stop ticking.
struct Over {
    patience: SpanNs,
    is_flying: bool,
    /// When the phase was last one that goes on.
    went_on_at: TimeNs,
}

impl Over {
    fn new(patience: SpanNs) -> Self {
        Self { patience, is_flying: false, went_on_at: TimeNs(0) }
    }

    fn hear(&mut self, status: Option<DroneStatus>) {
        self.is_flying = status.map_or(self.is_flying, |status| status.is_flying);
    }

    fn is_over(&mut self, now: TimeNs, phase: Phase, operator: Operator) -> bool {
        if matches!(phase, Phase::TakingOff | Phase::Flying | Phase::Landing) {
            self.went_on_at = now;
            return false;
        }
        let has_waited = now.since(self.went_on_at);
        match phase {
            Phase::Idle => operator == Operator::Land || has_waited > self.patience,
            // The drone has time to be told again, and the log to show it on the ground.
            Phase::Fault if self.is_flying => has_waited > SETTLE_IN_FAULT,
            _ => has_waited > SETTLE,
        }
    }
}

/// The clock of a live tick, and the notes that a replay and the summary need.
struct LiveWatch {
    clock: Clock,
    begin: TimeNs,
    late_at: TimeNs,
    polls: u32,
    late_at_poll: Option<u32>,
    /// End of the last stage.
    marked: TimeNs,
    estimate: SpanNs,
    plan: SpanNs,
}

impl LiveWatch {
    fn new(clock: Clock, solver_time: SpanNs) -> Self {
        let begin = clock.now();
        let late_at = begin.after(solver_time);
        Self {
            clock,
            begin,
            late_at,
            polls: 0,
            late_at_poll: None,
            marked: begin,
            estimate: SpanNs(0),
            plan: SpanNs(0),
        }
    }

    fn timing(&self, step: u64) -> Timing {
        Timing {
            step,
            late_ns: 0,
            estimate_ns: self.estimate.0,
            plan_ns: self.plan.0,
            tick_ns: self.clock.now().since(self.begin).0,
            missed: 0,
        }
    }
}

impl Watch for LiveWatch {
    fn is_late(&mut self) -> bool {
        // Once late, always late: a replay counts polls up to the first.
        if self.late_at_poll.is_none() && self.clock.now() >= self.late_at {
            self.late_at_poll = Some(self.polls);
        }
        self.polls = self.polls.saturating_add(1);
        self.late_at_poll.is_some()
    }

    fn mark(&mut self, stage: Stage) {
        let now = self.clock.now();
        let span = now.since(self.marked);
        match stage {
            Stage::Estimated => self.estimate = span,
            Stage::Planned => self.plan = span,
        }
        self.marked = now;
    }
}
