use horizon_model::rows::{lag, motion};
use horizon_model::{Lagged, Model};
use nalgebra::Vector2;

use super::*;
use crate::cycle::sense::tests::{DT_NS, sighting, table};
use crate::{Phase, Sighting};

pub(super) type LaggedCycle =
    Cycle<Lagged, { motion::COUNT }, { lag::COUNT }, { motion::CONTROLLABLE }>;

pub(super) fn cycle() -> LaggedCycle {
    build::cycle(Lagged::default(), &table()).unwrap()
}

/// A drone that flies.
pub(super) fn status(received_at: TimeNs) -> DroneStatus {
    DroneStatus {
        received_at,
        is_flying: true,
        is_on_ground: false,
        takes_sticks: true,
        is_battery_low: None,
        is_battery_critical: None,
        battery_pct: 80,
        battery_v: None,
        height_m: None,
        velocity_d_mps: None,
        heading_rad: None,
        flight_mode: None,
    }
}

/// A flight of so many `steps` from the beginning of the square: a person gives the roll of `hand`, and the poses are
/// seen where `is_seen`; `see` sees each tick. How far it ends beside the first side. m
fn fly_by_hand(
    steps: i64,
    hand: impl Fn(i64) -> Option<f64>,
    is_seen: impl Fn(i64) -> bool,
    mut see: impl FnMut(i64, &LaggedCycle, &Outcome),
) -> f64 {
    let (mut cycle, model) = (cycle(), Lagged::default());
    let (mut inbox, mut out) = (Inbox::new(), cycle.new_outcome());
    let mut fifo = InputFifo::new(&table().cycle.dead_time_s, &Lagged::INPUT, cycle.dt_s).unwrap();
    let (p, begin) = (*cycle.mhe.p_hat(), sighting(TimeNs(0), 0).pose.unwrap());
    let mut s = model.at_rest(&begin);
    for step in 0..steps {
        let now = TimeNs(step * DT_NS);
        inbox.open(step.unsigned_abs(), now);
        inbox.drone = Some(status(now));
        inbox.manual = hand(step).map(|roll| [roll, 0.0, 0.0, 0.0]);
        if is_seen(step) {
            inbox.sightings.push(Sighting { pose: Some(model.observe(&s)), ..sighting(now, 0) });
        }
        cycle.tick(&inbox, &mut Unwatched::default(), &mut out);
        see(step, &cycle, &out);
        fifo.push(&out.u_sent);
        s = model.step(&s, &fifo.applied(-1), &p, cycle.dt_s);
    }
    (model.observe(&s) - begin)[pose::Y].abs()
}

#[test]
fn a_hand_back_while_poses_are_stale_holds_and_does_not_end_the_flight_by_the_distance() {
    const HAND: std::ops::Range<i64> = 100..320;
    const UNSEEN: std::ops::Range<i64> = HAND.end - 30..HAND.end + 40;
    let hand = |step| HAND.contains(&step).then_some(0.6);
    let carried_m = fly_by_hand(
        UNSEEN.end,
        hand,
        |step| !UNSEEN.contains(&step),
        |step, _, out| {
            let decision = out.decision.unwrap();
            assert_eq!(decision.phase, Phase::Flying, "{step}: {decision:?}");
            if step > HAND.end {
                assert!(!decision.may_steer(), "{step}: the poses are stale");
            }
        },
    );
    let limit_m = table().cycle.supervisor.failsafe.tracking_m;
    assert!(carried_m > limit_m + 0.3, "{carried_m} m: the test shows nothing");
}

#[test]
fn after_a_hand_back_the_mission_goes_on_from_the_vehicle() {
    const HAND: std::ops::Range<i64> = 100..200;
    let mut off_m = Vec::new();
    let hand = |step| HAND.contains(&step).then_some(0.4);
    let carried_m = fly_by_hand(
        HAND.end + 1,
        hand,
        |_| true,
        |step, cycle, out| {
            let is_by_hand = HAND.contains(&step);
            assert_eq!(cycle.memory.is_on_mission, !is_by_hand, "{step}: {:?}", out.decision);
            if let Some(reference) = out.reference.filter(|_| !is_by_hand) {
                let pred_w = Vector2::new(out.s_pred[motion::X], out.s_pred[motion::Y]);
                off_m.push((reference.fixed_rows::<2>(pose::X) - pred_w).norm());
            }
        },
    );
    let last_m = off_m.last().copied().unwrap();
    assert!(carried_m > 0.6 && last_m < 0.3, "{last_m} m after {carried_m} m aside");
}
