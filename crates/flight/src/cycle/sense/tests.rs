use horizon_model::check::maximum;
use horizon_model::rows::stick;
use serde_json::{Value, json};

use super::*;
use crate::Start;
use crate::cycle::{FlightTable, Tick, Unwatched, build};
use crate::drone::DroneStatus;

pub(in crate::cycle) const DT_NS: i64 = 20_000_000;

pub(in crate::cycle) fn cycle() -> Box<dyn Tick> {
    build(&table()).unwrap()
}

/// The big square, flown in the air by the settings that come along.
pub(in crate::cycle) fn table() -> FlightTable {
    let table = json!({
        "start": "airborne",
        "mission": read(include_str!("../../../../../configs/missions/big_square.json")),
        "cycle": read(include_str!("../../../../../configs/fly.json"))["cycle"],
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
        outcomes.iter().enumerate().skip(50).map(error_m).fold(0.0, maximum)
    };
    let [with, without] = [true, false].map(worst_m);
    // The sticks of the cycle do not move this vehicle, so the estimated velocity is not exact.
    assert!(with < 0.2 * without && without > 5e-3, "{with} {without}");
}

#[test]
fn a_position_that_is_repeated_is_no_news_whatever_the_height_does() {
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
        out.decision.unwrap().faults.contains(crate::Fault::MocapFrozen)
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
        |step: usize| outcomes[step].decision.unwrap().faults.contains(crate::Fault::MocapStale);
    // The newest pose is that of step 9; `stale_s` is 0.5 s.
    assert!((0..=34).all(|step| !is_stale(step)) && (35..40).all(is_stale));
    assert!(outcomes[20].raw.is_none() && outcomes[40].raw.is_some() && !is_stale(40));
}

#[test]
fn the_vehicle_may_be_in_the_air_unless_it_was_never_or_is_down() {
    assert!(!is_flight_phase(Phase::Idle) && !is_flight_phase(Phase::Landed));
    for phase in [
        Phase::TakingOff,
        Phase::Flying,
        Phase::Landing,
        Phase::LandingUnconfirmed,
        Phase::MotorsStopped,
    ] {
        assert!(is_flight_phase(phase), "{phase:?}");
    }
}

/// A cycle that is shown a pose in each tick, and what it makes of it.
pub(in crate::cycle) struct Shown {
    cycle: Box<dyn Tick>,
    inbox: Inbox,
    step: i64,
    manual: Option<[f64; stick::COUNT]>,
}

impl Shown {
    pub(in crate::cycle) fn of(table: &FlightTable) -> Self {
        Self { cycle: build(table).unwrap(), inbox: Inbox::new(), step: 0, manual: None }
    }

    /// From now on a person holds these sticks.
    pub(in crate::cycle) fn hold(&mut self, sticks: Option<[f64; stick::COUNT]>) {
        self.manual = sticks;
    }

    /// The outcome of a tick with this pose and this status of the drone.
    pub(in crate::cycle) fn show(
        &mut self,
        pose: Option<Pose>,
        drone: Option<DroneStatus>,
    ) -> Outcome {
        let now = TimeNs(self.step * DT_NS);
        self.inbox.open(self.step.unsigned_abs(), now);
        self.inbox.manual = self.manual;
        // Poses have noise: one that is repeated is no news.
        let noise_m = 1e-4 * ((self.step * 7) % 5) as f64;
        let pose = pose.map(|pose| pose + Pose::new(noise_m, -noise_m, noise_m, 0.0));
        self.inbox.sightings.extend(pose.map(|pose| Sighting {
            frame: now.0,
            measured_at: now,
            received_at: now,
            pose: Some(pose),
        }));
        self.inbox.drone = drone.map(|drone| DroneStatus { received_at: now, ..drone });
        self.step += 1;
        let mut out = self.cycle.new_outcome();
        self.cycle.tick(&self.inbox, &mut Unwatched::default(), &mut out);
        out
    }

    /// The last outcome of `ticks` ticks at one pose.
    fn rest(&mut self, ticks: usize, pose: Pose) -> Outcome {
        (0..ticks).for_each(|_| drop(self.show(Some(pose), None)));
        self.show(Some(pose), None)
    }
}

/// At this heading, where the flight begins.
pub(in crate::cycle) fn at(theta_rad: f64) -> Pose {
    Pose::new(-2.0, -2.0, 1.0, theta_rad)
}

/// A filter that accepts every heading: the estimate alone refuses one.
fn accepting(start: Start) -> FlightTable {
    let mut table = FlightTable { start, ..table() };
    table.cycle.filter.angle_base_rad = 3.15;
    table
}

fn heading(out: &Outcome) -> Acceptance {
    out.filtered.unwrap().heading
}

#[test]
fn a_heading_that_contradicts_an_estimate_of_25_headings_is_refused() {
    // Accepted in so many ticks before, the first of which starts the estimate and counts already.
    for (ticks, expected) in [(23, Acceptance::Accepted), (24, Acceptance::Held)] {
        let mut shown = Shown::of(&accepting(Start::Airborne));
        (0..=ticks).for_each(|_| drop(shown.show(Some(at(0.0)), None)));
        let out = shown.show(Some(at(0.8)), None);
        assert_eq!(heading(&out), expected, "{ticks} ticks");
    }
    // `jump_rad` is 0.7.
    let mut shown = Shown::of(&accepting(Start::Airborne));
    shown.rest(40, at(0.0));
    assert_eq!(heading(&shown.show(Some(at(0.6)), None)), Acceptance::Accepted);
    // A vehicle that is carried may be turned as its carrier likes.
    let mut carried = Shown::of(&accepting(Start::Carried));
    carried.rest(40, at(0.0));
    assert_eq!(heading(&carried.show(Some(at(0.8)), None)), Acceptance::Accepted);
}

#[test]
fn a_refused_heading_that_the_estimate_confirms_is_accepted() {
    // The filter follows a wrong heading in steps that it accepts, the estimate follows neither so fast.
    let follow = |start: Start, ticks: usize| {
        let mut shown = Shown::of(&FlightTable { start, ..table() });
        shown.rest(ticks, at(0.0));
        let wrong = [0.14, 0.28, 0.42];
        let seen: Vec<_> = wrong.map(|rad| heading(&shown.show(Some(at(rad)), None))).into();
        assert_eq!(seen, [Acceptance::Accepted; 3]);
        let out = shown.show(Some(at(0.05)), None);
        (heading(&out), out.filtered.unwrap().o.unwrap()[pose::THETA])
    };
    let (with, theta_rad) = follow(Start::Airborne, 40);
    let (without, held_rad) = follow(Start::Carried, 40);
    assert_eq!(with, Acceptance::Accepted, "{theta_rad} rad");
    assert_eq!(without, Acceptance::Held, "{held_rad} rad");
}

#[test]
fn contradicting_poses_begin_anew_on_the_ground_and_are_refused_in_flight() {
    let far = Pose::new(-1.0, -2.0, 1.0, 0.0);
    let position = |start: Start| {
        let mut shown = Shown::of(&FlightTable { start, ..table() });
        shown.rest(40, at(0.0));
        let out = shown.show(Some(far), None);
        let filtered = out.filtered.unwrap();
        (filtered.position, filtered.o.map(|o| o[pose::X].round()))
    };
    assert_eq!(position(Start::Grounded), (Acceptance::Accepted, Some(-1.0)));
    assert_eq!(position(Start::Airborne), (Acceptance::Held, Some(-2.0)));
}

#[test]
fn a_flight_that_began_with_a_false_heading_begins_anew() {
    let theta_hat = |start: Start, ticks: usize| {
        let mut shown = Shown::of(&FlightTable { start, ..table() });
        shown.rest(2, at(2.0));
        shown.rest(ticks, at(0.0)).s_hat[pose::THETA]
    };
    // It has contradicted the estimate for 0.8 s.
    assert!((theta_hat(Start::Airborne, 30) - 2.0).abs() < 0.1);
    assert!(theta_hat(Start::Airborne, 60).abs() < 0.1);
}

#[test]
fn held_observations_are_used_if_the_settings_say_so() {
    // Without poses the estimate follows the inputs; held observations keep it where it is.
    let moved_m = |held: HeldObservations| {
        let mut table = table();
        table.cycle.held_observations = held;
        let mut shown = Shown::of(&table);
        shown.rest(60, at(0.0));
        (0..15).for_each(|_| drop(shown.show(None, None)));
        let s_hat = shown.show(None, None).s_hat;
        (s_hat[pose::X] + 2.0).hypot(s_hat[pose::Y] + 2.0)
    };
    let [used_m, skipped_m] = [HeldObservations::Use, HeldObservations::Skip].map(moved_m);
    assert!(used_m < 0.1 * skipped_m, "{used_m} m, {skipped_m} m");
}

#[test]
fn the_age_of_a_pose_is_that_of_its_older_part() {
    let mut shown = Shown::of(&table());
    shown.rest(40, at(0.0));
    // Positions go on, headings are refused: 0.5 s later the pose is stale.
    let stale = (0..60).map(|_| {
        let out = shown.show(Some(at(3.0)), None);
        assert_eq!(out.filtered.unwrap().position, Acceptance::Accepted);
        out.decision.unwrap().faults.contains(crate::Fault::MocapStale)
    });
    let stale: Vec<bool> = stale.collect();
    assert_eq!(stale.iter().position(|is_stale| *is_stale), Some(25));
}
