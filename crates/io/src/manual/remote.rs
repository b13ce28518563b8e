//! A person who looks at the flight from elsewhere: their orders beside those of keys and device.
//!
//! Owns the end that a view of the flight holds. It refuses to wait: an order that finds no room is
//! given back, so that its sender is informed.

use rtrb::Producer;
use thiserror::Error;

use super::{Act, Ask, Event, Source};
use crate::EmergencyRequest;
use crate::clock::Clock;

/// The control thread has not taken the orders before this one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("the control loop has not taken earlier orders yet: give the order again")]
pub struct RemoteBusy;

/// Where a view of the flight gives its orders. Dropped, it takes nothing back: send
/// [`Act::Lost`] first if a person steered.
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
    pub fn push(&mut self, act: Act) -> Result<(), RemoteBusy> {
        let event = Event { at: self.clock.now(), source: Source::Remote, act };
        let pushed = self.events.push(event).map_err(|_full| RemoteBusy);
        if act == Act::Ask(Ask::EmergencyStop) {
            self.emergency.ask();
            return Ok(());
        }
        pushed
    }
}

#[cfg(test)]
mod tests {
    use super::super::settings::tests::table;
    use super::super::{ManualSettings, Person};
    use super::*;
    use crate::clock::{SpanNs, TimeNs};

    fn person() -> Person {
        Person::new(ManualSettings::try_from(&table()).unwrap()).0
    }

    #[test]
    fn an_order_from_elsewhere_is_heard_like_a_key() {
        let clock = Clock::start();
        let mut person = person();
        let mut remote = person.remote(clock);
        remote.push(Act::Manual).unwrap();
        remote.push(Act::Ask(Ask::Land)).unwrap();
        let hand = person.poll(clock.now());
        assert_eq!(hand.ask, Some(Ask::Land));
        let sticks = hand.sticks.unwrap();
        assert!(sticks.norm() < 1e-12, "sticks in hand and level: {sticks}");
        remote.push(Act::Automatic).unwrap();
        assert_eq!(person.poll(clock.now()).sticks, None);
    }

    #[test]
    fn an_emergency_stop_needs_no_room() {
        let mut person = person();
        let emergency = person.emergency();
        let mut remote = person.remote(Clock::start());
        while remote.push(Act::Manual).is_ok() {}
        assert!(!emergency.take());
        remote.push(Act::Ask(Ask::EmergencyStop)).unwrap();
        assert!(emergency.take() && !emergency.take());
    }

    #[test]
    fn who_took_the_sticks_and_is_gone_is_replaced_by_a_landing() {
        let clock = Clock::start();
        let mut person = person();
        let mut remote = person.remote(clock);
        let after = |ms| clock.now().after(SpanNs::from_ms(ms));
        remote.push(Act::Lost).unwrap();
        assert_eq!(person.poll(after(5_000)).ask, None, "no person steered");
        remote.push(Act::Manual).unwrap();
        remote.push(Act::Lost).unwrap();
        assert_eq!(person.poll(after(500)).ask, None, "another device may take over");
        assert_eq!(person.poll(after(1_500)).ask, Some(Ask::Land));
    }

    #[test]
    fn a_full_queue_gives_the_order_back() {
        let mut person = person();
        let mut remote = person.remote(Clock::start());
        let taken = (0..1000).take_while(|_| remote.push(Act::Ask(Ask::Land)).is_ok()).count();
        assert!((10..1000).contains(&taken), "{taken} orders in transit");
        person.poll(TimeNs(0));
        remote.push(Act::Ask(Ask::EmergencyStop)).unwrap();
        assert_eq!(person.poll(TimeNs(0)).ask, Some(Ask::EmergencyStop));
    }
}
