//! Which raw observations are used, and how old they are.
//!
//! Owns the way from the sightings of a tick to the rows that the estimator may use.

use horizon_estim::Observed;
use horizon_model::Model;
use horizon_model::angle::wrap;
use horizon_model::rows::{Pose, pose, stick};
use nalgebra::SVector;

use super::measurement_time::Seen;
use super::{Cycle, HeldObservations, Inbox, Outcome};
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

/// Whether the vehicle may be in the air in `phase`: the clock of the mocap system is held then.
///
/// After an unconfirmed landing or an emergency stop the vehicle may still be in the air.
pub fn is_airborne(phase: Phase) -> bool {
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

impl<M, const NS: usize, const NP: usize, const NR: usize> Cycle<M, NS, NP, NR>
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP>,
{
    /// Steps 1 and 2 of thesis section 4.3.11: the rows of the raw observations that the estimator uses.
    ///
    /// `None` until the filter has seen its first valid pose.
    pub(super) fn sense(&mut self, inbox: &Inbox, out: &mut Outcome) -> Option<Seen> {
        self.memory.drone = inbox.drone.or(self.memory.drone);
        (self.memory.o_seen, self.memory.o_repeated) = (None, None);
        self.plausibility.open();
        if self.supervisor.phase() == Phase::Idle {
            self.plausibility.stand();
        }
        // A late sighting is left out: it would lead the filter back to an earlier place.
        let timely = || inbox.sightings.iter().filter(|sighting| !is_late(sighting, inbox.now));
        // The filter is updated in a tick without a sighting, too: its limits grow.
        let nothing = timely().next().is_none().then_some(None);
        let mut o = None;
        let [mut is_position_new, mut is_heading_new] = [false; 2];
        for (k, sighting) in timely().map(Some).chain(nothing).enumerate() {
            let measured_at = sighting.map_or(inbox.now, |sighting| sighting.measured_at);
            let filtered = self.filtered(sighting, k == 0, measured_at);
            out.observe(sighting, &filtered);
            let is_new = self.note_accepted(&filtered, measured_at);
            is_position_new |= is_new && filtered.position == Acceptance::Accepted;
            is_heading_new |= is_new && filtered.heading == Acceptance::Accepted;
            o = filtered.o;
        }
        let observed = self.usable_rows(o?, is_position_new, is_heading_new);
        Some(self.place(observed, inbox.now, [is_position_new, is_heading_new]))
    }

    /// The filter's verdict on `sighting`, the first one of its tick or a further one.
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
        self.plausibility.judge(raw, &filtered, measured_at);
        filtered
    }

    /// Notes when and what was accepted; whether the stream does more than repeat itself.
    fn note_accepted(&mut self, filtered: &Filtered, measured_at: TimeNs) -> bool {
        let is_new = !self.is_frozen();
        let has_heading = filtered.heading == Acceptance::Accepted;
        if filtered.position == Acceptance::Accepted && is_new {
            self.memory.position_at = Some(measured_at);
            self.memory.o_seen = filtered.o;
            self.monitors.observe_heading(has_heading);
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
            Phase::Idle => self.start.observe(raw, at),
            Phase::Flying if self.has_few_headings() => {
                self.start.observe_in_flight(raw[pose::THETA], self.theta_hat_rad(), at)
            }
            _ => false,
        };
        if is_other {
            self.filter.restart();
            self.plausibility.restart();
            self.mhe.restart();
            self.memory.headings = 0;
            self.monitors.restart_direction();
        }
    }

    /// The newest estimated heading. rad
    pub(super) fn theta_hat_rad(&self) -> f64 {
        self.model.observe(self.mhe.s_hat())[pose::THETA]
    }

    /// Whether the estimate of a flight rests on too few headings to refuse one by it.
    fn has_few_headings(&self) -> bool {
        let is_judged = self.mhe.is_started() && !self.is_carried;
        is_judged && self.memory.headings < HEADINGS_MIN
    }

    /// Accepts a refused heading that is the one of an estimate that rests on enough headings.
    fn confirm_heading(&mut self, raw: Option<&Pose>, filtered: Filtered) -> Filtered {
        let is_flying = self.supervisor.phase() == Phase::Flying && !self.is_carried;
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
        let is_flying = self.supervisor.phase() == Phase::Flying && !self.is_carried;
        let is_judged = is_flying && self.mhe.is_started();
        let Some(o) = filtered.o.filter(|_| is_judged && filtered.heading == Acceptance::Accepted)
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
    pub(super) fn is_frozen(&self) -> bool {
        let is_in_flight = self.supervisor.phase() == Phase::Flying && !self.is_carried;
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
pub(super) mod tests {
    use horizon_model::rows::Pose;
    use serde_json::{Value, json};

    use super::*;
    use crate::cycle::{FlightTable, Tick, Unwatched, build};

    pub(in crate::cycle) const DT_NS: i64 = 20_000_000;

    pub(in crate::cycle) fn cycle() -> Box<dyn Tick> {
        build(&table()).unwrap()
    }

    /// The big square, flown in the air by the settings that come along.
    pub(in crate::cycle) fn table() -> FlightTable {
        let table = json!({
            "start": "airborne",
            "mission": read(include_str!("../../../../configs/missions/big_square.json")),
            "cycle": read(include_str!("../../../../configs/fly.json"))["cycle"],
            "protocol": "binary",
        });
        serde_json::from_value(table).unwrap()
    }

    fn read(text: &str) -> Value {
        serde_json::from_str(text).unwrap()
    }

    /// A vehicle at 0.5 m/s, and its sighting of age `age_ns` at `now`.
    pub(in crate::cycle) fn sighting(now: TimeNs, age_ns: i64) -> Sighting {
        let measured_at = now.after(SpanNs(-age_ns));
        let pose = Some(Pose::new(-2.0 + 0.5 * measured_at.seconds(), -2.0, 1.0, 0.0));
        Sighting { frame: measured_at.0, measured_at, received_at: now, pose }
    }

    /// The outcomes of ticks whose sightings have these ages. ns
    fn fly(ages_ns: &[&[i64]]) -> Vec<Outcome> {
        fly_by(cycle(), ages_ns)
    }

    pub(in crate::cycle) fn fly_by(mut cycle: Box<dyn Tick>, ages_ns: &[&[i64]]) -> Vec<Outcome> {
        let mut inbox = Inbox::new();
        let tick = |(step, ages_ns): (i64, &&[i64])| {
            let now = TimeNs(step * DT_NS);
            inbox.open(step.unsigned_abs(), now);
            inbox.sightings.extend(ages_ns.iter().map(|age_ns| sighting(now, *age_ns)));
            let mut out = cycle.new_outcome();
            cycle.tick(&inbox, &mut Unwatched::default(), &mut out);
            out
        };
        (0..).zip(ages_ns).map(tick).collect()
    }

    #[test]
    fn a_late_sighting_is_none() {
        const TOO_LATE: i64 = SIGHTING_AGE_MAX.0 + 1;
        const VERY_LATE: i64 = 1_200_000_000;
        let mut with_late: Vec<&[i64]> = vec![&[0]; 10];
        let mut without: Vec<&[i64]> = vec![&[0]; 10];
        for (some, none) in [
            (&[TOO_LATE][..], &[][..]),
            (&[VERY_LATE, TOO_LATE, 0], &[0]),
            (&[0, VERY_LATE], &[0]),
            (&[VERY_LATE, VERY_LATE], &[]),
            (&[TOO_LATE, 20_000_000, 0], &[20_000_000, 0]),
        ] {
            with_late.extend([some; 3]);
            without.extend([none; 3]);
        }
        assert_eq!(fly(&with_late), fly(&without));
    }

    #[test]
    fn a_pose_counts_from_its_measurement() {
        // A source of 60 Hz: ages of 0 to 13 ms.
        let ages_ns: Vec<[i64; 1]> = (0..150).map(|k| [k * DT_NS % 16_666_667]).collect();
        let ages_ns: Vec<&[i64]> = ages_ns.iter().map(|ages_ns| &ages_ns[..]).collect();
        let worst_m = |uses_measurement_time| {
            let mut table = table();
            table.cycle.uses_measurement_time = uses_measurement_time;
            let outcomes = fly_by(build(&table).unwrap(), &ages_ns);
            let error_m = |(step, out): (usize, &Outcome)| {
                (out.s_hat[pose::X] - (-2.0 + 0.5 * 0.02 * step as f64)).abs()
            };
            outcomes.iter().enumerate().skip(50).map(error_m).fold(0.0, f64::max)
        };
        let [with, without] = [true, false].map(worst_m);
        // The sticks of the cycle do not move this vehicle, so the estimated velocity is not exact.
        assert!(with < 0.2 * without && without > 5e-3, "{with} {without}");
    }

    #[test]
    fn a_place_that_is_repeated_is_no_news_whatever_the_height_does() {
        let mut cycle = cycle();
        let mut inbox = Inbox::new();
        let found = (0..60).map(|step: i64| {
            let now = TimeNs(step * DT_NS);
            inbox.open(step.unsigned_abs(), now);
            let mut seen = sighting(now, 0);
            if let Some(pose) = seen.pose.as_mut().filter(|_| step > 10) {
                pose[pose::X] = -1.9;
                pose[pose::Z] += 1e-3 * (step % 7) as f64;
            }
            inbox.sightings.push(seen);
            let mut out = cycle.new_outcome();
            cycle.tick(&inbox, &mut Unwatched::default(), &mut out);
            out.ruling.unwrap().faults.contains(crate::Fault::MocapFrozen)
        });
        let found: Vec<bool> = found.collect();
        // Three repetitions, then `stale_s`, 0.5 s.
        let first = found.iter().position(|is_frozen| *is_frozen);
        assert!(first.is_some_and(|first| (36..=42).contains(&first)), "{first:?}");
    }

    #[test]
    fn late_sightings_alone_are_silence_and_a_timely_one_ends_it() {
        let mut ages_ns: Vec<&[i64]> = vec![&[0]; 10];
        ages_ns.extend([&[1_200_000_000][..]; 30]);
        // The oldest age that still counts.
        ages_ns.push(&[100_000_000]);
        let outcomes = fly(&ages_ns);
        let is_stale =
            |step: usize| outcomes[step].ruling.unwrap().faults.contains(crate::Fault::MocapStale);
        // The newest pose is that of step 9; `stale_s` is 0.5 s.
        assert!((0..=34).all(|step| !is_stale(step)) && (35..40).all(is_stale));
        assert!(outcomes[20].raw.is_none() && outcomes[40].raw.is_some() && !is_stale(40));
    }

    #[test]
    fn the_vehicle_may_be_in_the_air_unless_it_was_never_or_is_down() {
        assert!(!is_airborne(Phase::Idle) && !is_airborne(Phase::Landed));
        for phase in [
            Phase::TakingOff,
            Phase::Flying,
            Phase::Landing,
            Phase::LandingUnconfirmed,
            Phase::MotorsStopped,
        ] {
            assert!(is_airborne(phase), "{phase:?}");
        }
    }
}
