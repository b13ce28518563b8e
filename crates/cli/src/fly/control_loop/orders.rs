//! What is asked of the vehicle: the strongest of all orders, and how long an order to take off counts.

use tello_flight::{Operator, Phase};
use tello_io::clock::{SpanNs, TimeNs};
use tello_io::manual::{Ask, Hand};

/// The orders of the person at the controls and of signals.
#[derive(Debug, Clone, Copy)]
pub(in crate::fly) struct Orders {
    pub(super) strongest: Operator,
    /// When the newest order to take off was given.
    take_off_at: TimeNs,
}

impl Orders {
    /// A flight is ordered at time 0.
    pub(in crate::fly) fn to_fly() -> Self {
        Self { strongest: Operator::Fly, take_off_at: TimeNs(0) }
    }

    /// No flight is ordered.
    pub(in crate::fly) fn to_wait() -> Self {
        Self { strongest: Operator::Wait, ..Self::to_fly() }
    }

    /// Takes `order`, unless there is a stronger one.
    pub(super) fn give(&mut self, order: Operator, now: TimeNs) {
        if is_take_off(order) {
            self.take_off_at = now;
        }
        self.strongest = self.strongest.max(order);
    }

    /// Drops an order to take off that was not obeyed for `patience`; whether there was one. No other order is taken
    /// back. A fault that is mended later must not start a drone beside which the person stands.
    pub(super) fn lapse(&mut self, now: TimeNs, phase: Phase, patience: SpanNs) -> bool {
        let is_late = now.since(self.take_off_at) > patience;
        let lapses = phase == Phase::Idle && is_take_off(self.strongest) && is_late;
        if lapses {
            self.strongest = Operator::Wait;
        }
        lapses
    }
}

fn is_take_off(order: Operator) -> bool {
    matches!(order, Operator::Fly | Operator::FlyByHand)
}

/// What an order of the person at the controls means. A take-off with the sticks in hand does not need the cameras.
pub(super) fn meaning(ask: Ask, hand: &Hand) -> Operator {
    match ask {
        Ask::TakeOff if hand.sticks.is_some() => Operator::FlyByHand,
        Ask::TakeOff => Operator::Fly,
        Ask::Land => Operator::Land,
        Ask::EmergencyStop => Operator::EmergencyStop,
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::rows::Sticks;

    use super::*;

    const PATIENCE: SpanNs = SpanNs::from_ms(10_000);

    #[test]
    fn a_take_off_with_the_sticks_held_is_one_by_hand() {
        let hand = |sticks| Hand { ask: None, sticks, has_expired: false };
        let held = hand(Some(Sticks::zeros()));
        assert_eq!(meaning(Ask::TakeOff, &held), Operator::FlyByHand);
        assert_eq!(meaning(Ask::TakeOff, &hand(None)), Operator::Fly);
        for hand in [held, hand(None)] {
            assert_eq!(meaning(Ask::Land, &hand), Operator::Land);
            assert_eq!(meaning(Ask::EmergencyStop, &hand), Operator::EmergencyStop);
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
        let lapses = |orders: &mut Orders, now, phase| orders.lapse(now, phase, PATIENCE);
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
}
