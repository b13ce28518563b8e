//! What is asked of the vehicle: the strongest of all orders, and how long an order to take off counts.

use tello_flight::{Fault, FaultSet, Operator, Phase};
use tello_io::clock::{SpanNs, TimeNs};
use tello_io::manual::{ManualInput, PersonOrder};

use crate::fly::loop_times::LoopTimes;

/// The orders of the person at the controls and of signals.
#[derive(Debug, Clone, Copy)]
pub(in crate::fly) struct Orders {
    pub(super) strongest: Operator,
    /// When the newest order to take off was given.
    take_off_at: TimeNs,
    /// Since then: when poses began to disagree, if they do, and whether they have ever agreed.
    unsettled_at: Option<TimeNs>,
    has_settled: bool,
}

impl Orders {
    /// A flight is ordered at time 0.
    pub(in crate::fly) fn to_fly() -> Self {
        Self {
            strongest: Operator::Fly,
            take_off_at: TimeNs(0),
            unsettled_at: None,
            has_settled: false,
        }
    }

    /// No flight is ordered.
    pub(in crate::fly) fn to_wait() -> Self {
        Self { strongest: Operator::Wait, ..Self::to_fly() }
    }

    /// Takes `order`, unless there is a stronger one.
    pub(super) fn give(&mut self, order: Operator, now: TimeNs) {
        if is_take_off(order) {
            (self.take_off_at, self.unsettled_at, self.has_settled) = (now, None, false);
        }
        self.strongest = self.strongest.max(order);
    }

    /// Drops an order to take off that was not executed for the ground wait, or whose drone is moved, by `faults` of
    /// the newest tick: its poses disagree after they have agreed, or for longer than they may take. Returns whether
    /// there was one. No other order is taken back. A fault that is mended later must not start a drone beside which
    /// the person stands.
    pub(super) fn lapse(
        &mut self,
        now: TimeNs,
        phase: Phase,
        faults: FaultSet,
        times: &LoopTimes,
    ) -> bool {
        let is_late = now.since(self.take_off_at) > times.ground_wait;
        let is_pending = phase == Phase::Idle && is_take_off(self.strongest);
        let lapses = is_pending && (is_late || self.is_moved(now, faults, times.settling_max));
        if lapses {
            self.strongest = Operator::Wait;
        }
        lapses
    }

    /// Whether fresh poses disagree that have agreed since the order, or do so for long.
    fn is_moved(&mut self, now: TimeNs, faults: FaultSet, settling_max: SpanNs) -> bool {
        let is_unsettled = faults.contains(Fault::MocapUnsettled);
        let disagree = is_unsettled && !faults.contains(Fault::MocapStale);
        let began = self.unsettled_at.filter(|_| disagree).or(disagree.then_some(now));
        self.unsettled_at = began;
        self.has_settled |= !is_unsettled;
        began.is_some_and(|began| self.has_settled || now.since(began) > settling_max)
    }
}

fn is_take_off(order: Operator) -> bool {
    matches!(order, Operator::Fly | Operator::FlyByHand)
}

/// What an order of the person at the controls means. A take-off with the sticks in hand does not need the cameras.
pub(super) fn meaning(order: PersonOrder, input: &ManualInput) -> Operator {
    match order {
        PersonOrder::TakeOff if input.sticks.is_some() => Operator::FlyByHand,
        PersonOrder::TakeOff => Operator::Fly,
        PersonOrder::Land => Operator::Land,
        PersonOrder::EmergencyStop => Operator::EmergencyStop,
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::rows::Sticks;

    use super::*;

    const TIMES: LoopTimes = LoopTimes {
        period: SpanNs::from_ms(20),
        solver_time: SpanNs::from_ms(15),
        ground_wait: SpanNs::from_ms(10_000),
        settling_max: SpanNs::from_ms(3000),
        frame_wait: SpanNs(0),
    };

    #[test]
    fn a_take_off_with_the_sticks_held_is_one_by_hand() {
        let with_sticks = |sticks| ManualInput { order: None, sticks, has_expired: false };
        let held = with_sticks(Some(Sticks::zeros()));
        assert_eq!(meaning(PersonOrder::TakeOff, &held), Operator::FlyByHand);
        assert_eq!(meaning(PersonOrder::TakeOff, &with_sticks(None)), Operator::Fly);
        for input in [held, with_sticks(None)] {
            assert_eq!(meaning(PersonOrder::Land, &input), Operator::Land);
            assert_eq!(meaning(PersonOrder::EmergencyStop, &input), Operator::EmergencyStop);
        }
    }

    #[test]
    fn a_flight_that_finds_the_drone_in_the_air_orders_nothing_until_a_person_does() {
        let mut orders = Orders::to_wait();
        assert_eq!(orders.strongest, Operator::Wait);
        orders.give(Operator::Land, TimeNs(0));
        assert_eq!(orders.strongest, Operator::Land);
    }

    #[test]
    fn an_order_to_take_off_lapses_on_the_ground_and_no_other_does() {
        let at = |s: i64| TimeNs(0).after(SpanNs::from_ms(1000 * s));
        let calm = FaultSet::default();
        let lapses = |orders: &mut Orders, now, phase| orders.lapse(now, phase, calm, &TIMES);
        let mut orders = Orders::to_fly();
        assert!(!lapses(&mut orders, at(10), Phase::Idle) && orders.strongest == Operator::Fly);
        assert!(lapses(&mut orders, at(11), Phase::Idle) && orders.strongest == Operator::Wait);
        assert!(!lapses(&mut orders, at(12), Phase::Idle), "once");
        orders.give(Operator::FlyByHand, at(20));
        assert!(
            !lapses(&mut orders, at(30), Phase::Idle) && orders.strongest == Operator::FlyByHand
        );
        assert!(!lapses(&mut orders, at(40), Phase::Flying), "it is obeyed");
        for order in [Operator::Land, Operator::EmergencyStop] {
            orders.give(order, at(41));
            orders.give(Operator::Fly, at(42));
            assert!(!lapses(&mut orders, at(90), Phase::Idle) && orders.strongest == order);
        }
    }

    #[test]
    fn an_order_to_take_off_lapses_when_the_drone_is_moved() {
        let at = |ms: i64| TimeNs(0).after(SpanNs::from_ms(ms));
        let of = |faults: &[Fault]| {
            let mut set = FaultSet::default();
            for fault in faults {
                set.set(*fault, true);
            }
            set
        };
        let unsettled = of(&[Fault::MocapUnsettled]);
        let stale = of(&[Fault::MocapUnsettled, Fault::MocapStale]);
        let lapses =
            |orders: &mut Orders, ms, faults| orders.lapse(at(ms), Phase::Idle, faults, &TIMES);
        // Poses come after 5 s, and settle within three.
        let mut orders = Orders::to_fly();
        assert!(!lapses(&mut orders, 20, stale) && !lapses(&mut orders, 5000, stale));
        assert!(!lapses(&mut orders, 5020, unsettled) && !lapses(&mut orders, 8020, unsettled));
        assert!(lapses(&mut orders, 8021, unsettled), "carried");
        // A new order counts anew.
        orders.give(Operator::Fly, at(9000));
        assert!(!lapses(&mut orders, 9020, unsettled));
        assert!(!lapses(&mut orders, 10_000, of(&[Fault::BatteryLow])), "it stands");
        assert!(lapses(&mut orders, 10_020, unsettled), "lifted");
        assert_eq!(orders.strongest, Operator::Wait);
    }
}
