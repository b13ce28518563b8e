//! Which raw observations are used, and how old they are.
//!
//! Owns how the sightings of a tick become the rows that the estimator may use.

use horizon_estim::Observed;
use horizon_model::angle::wrap;
use horizon_model::rows::{Pose, pose};
use nalgebra::SVector;

use super::measurement_time::TickObservations;
use super::{Cycle, HeldObservations, Inbox, Outcome, Vehicle};
use crate::time::{SpanNs, TimeNs};
use crate::{Acceptance, Filtered, Phase, Sighting};

/// Age beyond which a sighting is not used: the estimator's window reaches back as far (`measurement_time.rs`), and
/// in 0.1 s a Tello at 1 m/s is 0.1 m further on. A healthy pose is as old as its period, the tick's and the jitter of
/// its network: 20, 20 and, behind a delayed acknowledgement of TCP, 40 ms. After a stall the newest pose is current at
/// once, and only the older ones of its burst are late.
pub const SIGHTING_AGE_MAX: SpanNs = SpanNs::from_ms(100);

/// Headings accepted in flight before one that contradicts the estimate is refused: a flight that begins in the air may
/// begin with a wrong one.
const HEADINGS_MIN: u32 = 25;

/// Whether `phase` belongs to a flight, from the order to take off to the confirmed landing: the clock of the mocap
/// system is held then.
///
/// After an unconfirmed landing or an emergency stop the vehicle may still be in the air.
pub fn is_flight_phase(phase: Phase) -> bool {
    match phase {
        Phase::Idle | Phase::Landed => false,
        Phase::TakingOff
        | Phase::Flying
        | Phase::Landing
        | Phase::LandingUnconfirmed
        | Phase::MotorsStopped => true,
    }
}

fn is_late(sighting: &Sighting, now: TimeNs) -> bool {
    now.since(sighting.measured_at) > SIGHTING_AGE_MAX
}

impl<M: Vehicle<NS, NP>, const NS: usize, const NP: usize, const NR: usize> Cycle<M, NS, NP, NR> {
    /// Steps 1 and 2 of thesis section 4.3.11: the rows of the raw observations that the estimator uses.
    ///
    /// `None` until the filter has seen its first valid pose.
    pub(super) fn sense(&mut self, inbox: &Inbox, out: &mut Outcome) -> Option<TickObservations> {
        self.memory.drone = inbox.drone.or(self.memory.drone);
        (self.memory.o_seen, self.memory.o_repeated) = (None, None);
        self.plausibility.begin_tick();
        if self.supervisor.phase() == Phase::Idle {
            self.plausibility.reset_shift();
        }
        // A late sighting is left out: it would lead the filter back to an earlier position.
        let timely = || inbox.sightings.iter().filter(|sighting| !is_late(sighting, inbox.now));
        // One turn with `None` if no sighting is timely: the limits of the filter grow in each tick.
        let empty_turn = timely().next().is_none().then_some(None);
        let mut o = None;
        let [mut is_position_new, mut is_heading_new] = [false; 2];
        for (k, sighting) in timely().map(Some).chain(empty_turn).enumerate() {
            let measured_at = sighting.map_or(inbox.now, |sighting| sighting.measured_at);
            let filtered = self.filtered(sighting, k == 0, measured_at);
            out.observe(sighting, &filtered);
            let is_new = self.note_accepted(&filtered, measured_at);
            is_position_new |= is_new && filtered.position == Acceptance::Accepted;
            is_heading_new |= is_new && filtered.heading == Acceptance::Accepted;
            o = filtered.o;
        }
        let observed = self.usable_rows(o?, is_position_new, is_heading_new);
        Some(self.assign_to_states(observed, inbox.now, [is_position_new, is_heading_new]))
    }

    /// Result of the filter for `sighting`, the first one of its tick or a further one.
    fn filtered(
        &mut self,
        sighting: Option<&Sighting>,
        is_first: bool,
        measured_at: TimeNs,
    ) -> Filtered {
        let raw = sighting.and_then(|sighting| sighting.pose.as_ref());
        self.restart_if_moved(raw, measured_at);
        let filtered =
            if is_first { self.filter.update(raw) } else { self.filter.update_again(raw) };
        let filtered = self.confirm_heading(raw, filtered);
        let filtered = self.check_heading(filtered);
        self.plausibility.check(raw, &filtered, measured_at);
        filtered
    }

    /// Notes when and what was accepted; whether the stream does more than repeat itself.
    fn note_accepted(&mut self, filtered: &Filtered, measured_at: TimeNs) -> bool {
        let is_new = !self.is_stream_repeating();
        let has_heading = filtered.heading == Acceptance::Accepted;
        if filtered.position == Acceptance::Accepted && is_new {
            self.memory.position_at = Some(measured_at);
            self.memory.o_seen = filtered.o;
            self.monitors.note_heading_measured(has_heading);
        } else if filtered.position == Acceptance::Accepted {
            self.memory.o_repeated = filtered.o;
        }
        if has_heading && is_new {
            self.memory.heading_at = Some(measured_at);
        }
        is_new
    }

    /// Restarts filter and estimator if a pose before or at the start of a flight contradicts the earlier ones.
    fn restart_if_moved(&mut self, raw: Option<&Pose>, at: TimeNs) {
        let finite = raw.filter(|raw| raw.iter().all(|row| row.is_finite()));
        let Some(raw) = finite else { return };
        let is_other = match self.supervisor.phase() {
            Phase::Idle => self.standing_start.observe(raw, at),
            Phase::Flying if self.has_few_headings() => {
                self.standing_start.observe_in_flight(raw[pose::THETA], self.theta_hat_rad(), at)
            }
            _ => false,
        };
        if is_other {
            self.filter.restart();
            self.plausibility.restart();
            self.mhe.restart();
            self.memory.headings = 0;
            self.monitors.restart_heading_and_direction();
        }
    }

    /// The newest estimated heading. rad
    pub(super) fn theta_hat_rad(&self) -> f64 {
        self.model.observe(self.mhe.s_hat())[pose::THETA]
    }

    /// Whether the estimate of a flight rests on too few headings to refuse one by it.
    fn has_few_headings(&self) -> bool {
        let is_checked = self.mhe.is_started() && !self.is_dry_run;
        is_checked && self.memory.headings < HEADINGS_MIN
    }

    /// Accepts a refused heading that is the one of an estimate that rests on enough headings.
    fn confirm_heading(&mut self, raw: Option<&Pose>, filtered: Filtered) -> Filtered {
        let is_flying = self.supervisor.phase() == Phase::Flying && !self.is_dry_run;
        let is_known = self.mhe.is_started() && self.memory.headings >= HEADINGS_MIN;
        match raw {
            Some(raw) if is_flying && is_known => {
                self.filter.confirm_heading(raw, self.theta_hat_rad(), filtered)
            }
            _ => filtered,
        }
    }

    /// Refuses an accepted heading that is too far from the estimate: the filter accepts any value that is
    /// repeated for long enough.
    fn check_heading(&mut self, filtered: Filtered) -> Filtered {
        let is_flying = self.supervisor.phase() == Phase::Flying && !self.is_dry_run;
        let is_checked = is_flying && self.mhe.is_started();
        let Some(o) = filtered.o.filter(|_| is_checked && filtered.heading == Acceptance::Accepted)
        else {
            return filtered;
        };
        self.memory.headings = self.memory.headings.saturating_add(1);
        if self.memory.headings < HEADINGS_MIN {
            return filtered;
        }
        if wrap(o[pose::THETA] - self.theta_hat_rad()).abs() <= self.jump_rad {
            return filtered;
        }
        self.filter.refuse_heading(self.theta_hat_rad())
    }

    /// Whether the stream repeats itself while the vehicle flies. On the ground it may.
    pub(super) fn is_stream_repeating(&self) -> bool {
        let is_in_flight = self.supervisor.phase() == Phase::Flying && !self.is_dry_run;
        is_in_flight && self.plausibility.is_repeated()
    }

    /// The rows of a filtered observation that the estimator may use.
    fn usable_rows(
        &self,
        o: SVector<f64, { pose::COUNT }>,
        is_position_new: bool,
        is_heading_new: bool,
    ) -> Observed<{ pose::COUNT }> {
        let uses_held = self.held == HeldObservations::Use;
        let mut is_present = [is_position_new || uses_held; pose::COUNT];
        is_present[pose::THETA] = is_heading_new || uses_held;
        Observed { o, is_present }
    }

    /// Age of the older of the newest position and the newest heading; `None` before the first.
    pub(super) fn pose_age_s(&self, inbox: &Inbox) -> Option<f64> {
        let oldest = self.memory.position_at?.min(self.memory.heading_at?);
        Some(inbox.now.since(oldest).seconds())
    }
}

#[cfg(test)]
pub(super) mod tests;
