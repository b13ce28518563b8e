//! A person who looks at the flight from elsewhere: their orders beside those of keys and device.
//!
//! Owns the end that a view of the flight holds. It refuses to wait: an order that finds no room is
//! given back, so that its sender is informed.

use rtrb::Producer;
use thiserror::Error;

use super::{Event, InputAction, PersonOrder, Source};
use crate::EmergencyRequest;
use crate::clock::Clock;

/// The control thread has not taken the orders before this one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("the control loop has not taken earlier orders yet: give the order again")]
pub struct RemoteBusy;

/// Where a view of the flight gives its orders. Dropped, it takes nothing back: send
/// [`InputAction::Lost`] first if a person steered.
#[derive(Debug)]
pub struct Remote {
    events: Producer<Event>,
    emergency: EmergencyRequest,
    clock: Clock,
}

impl Remote {
    pub(super) fn new(events: Producer<Event>, emergency: EmergencyRequest, clock: Clock) -> Self {
        Self { events, emergency, clock }
    }

    /// Whether a control thread hears it: not after the flight.
    pub fn is_heard(&self) -> bool {
        !self.events.is_abandoned()
    }

    /// Hands `act` to the control thread, which takes it in its next tick, and an emergency stop to the sender as well.
    /// Never waits.
    ///
    /// # Errors
    /// The queue is full: the control thread has not polled since 64 events. The event is not queued. Never for an
    /// emergency stop, which the sender obeys whether the control thread hears of it or not.
    pub fn push(&mut self, action: InputAction) -> Result<(), RemoteBusy> {
        let event = Event { at: self.clock.now(), source: Source::Remote, action };
        let pushed = self.events.push(event).map_err(|_full| RemoteBusy);
        if action == InputAction::Order(PersonOrder::EmergencyStop) {
            self.emergency.ask();
            return Ok(());
        }
        pushed
    }
}

#[cfg(test)]
mod tests {
    use super::super::settings::tests::table;
    use super::super::{ManualControls, ManualSettings};
    use super::*;
    use crate::clock::{SpanNs, TimeNs};

    fn controls() -> ManualControls {
        ManualControls::new(ManualSettings::try_from(&table()).unwrap()).0
    }

    #[test]
    fn an_order_from_elsewhere_is_heard_like_a_key() {
        let clock = Clock::start();
        let mut controls = controls();
        let mut remote = controls.remote(clock);
        remote.push(InputAction::Manual).unwrap();
        remote.push(InputAction::Order(PersonOrder::Land)).unwrap();
        let input = controls.poll(clock.now());
        assert_eq!(input.order, Some(PersonOrder::Land));
        let sticks = input.sticks.unwrap();
        assert!(sticks.norm() < 1e-12, "sticks in hand and level: {sticks}");
        remote.push(InputAction::Automatic).unwrap();
        assert_eq!(controls.poll(clock.now()).sticks, None);
    }

    #[test]
    fn an_emergency_stop_needs_no_room() {
        let mut controls = controls();
        let emergency = controls.emergency();
        let mut remote = controls.remote(Clock::start());
        while remote.push(InputAction::Manual).is_ok() {}
        assert!(!emergency.take());
        remote.push(InputAction::Order(PersonOrder::EmergencyStop)).unwrap();
        assert!(emergency.take() && !emergency.take());
    }

    #[test]
    fn who_took_the_sticks_and_is_gone_is_replaced_by_a_landing() {
        let clock = Clock::start();
        let mut controls = controls();
        let mut remote = controls.remote(clock);
        let after = |ms| clock.now().after(SpanNs::from_ms(ms));
        remote.push(InputAction::Lost).unwrap();
        assert_eq!(controls.poll(after(5_000)).order, None, "no person steered");
        remote.push(InputAction::Manual).unwrap();
        remote.push(InputAction::Lost).unwrap();
        assert_eq!(controls.poll(after(500)).order, None, "another device may take over");
        assert_eq!(controls.poll(after(1_500)).order, Some(PersonOrder::Land));
    }

    #[test]
    fn a_full_queue_gives_the_order_back() {
        let mut controls = controls();
        let mut remote = controls.remote(Clock::start());
        let taken = (0..1000)
            .take_while(|_| remote.push(InputAction::Order(PersonOrder::Land)).is_ok())
            .count();
        assert!((10..1000).contains(&taken), "{taken} orders in transit");
        controls.poll(TimeNs(0));
        remote.push(InputAction::Order(PersonOrder::EmergencyStop)).unwrap();
        assert_eq!(controls.poll(TimeNs(0)).order, Some(PersonOrder::EmergencyStop));
    }
}
