//! Who may give orders to the flight, and which.
//!
//! Owns the token and the way from an order to the flight's controls. It refuses to judge an order: what
//! becomes of it is the supervisor's.

use std::fmt::Write;
use std::sync::Arc;

use anyhow::{Context, Result};
use parking_lot::Mutex;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use tello_io::manual::{InputAction, PersonOrder, Remote, RemoteBusy};

use crate::stdio;

/// Length of a token. bytes
const TOKEN_BYTES: usize = 16;

/// Orders of a page; each does what a key does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum PageOrder {
    /// T.
    TakeOff,
    /// R or Q.
    Land,
    /// E with no other key: the sticks are a person's, and level.
    Hold,
    /// C.
    Automatic,
    /// Backspace.
    EmergencyStop,
}

impl PageOrder {
    fn action(self) -> InputAction {
        match self {
            Self::TakeOff => InputAction::Order(PersonOrder::TakeOff),
            Self::Land => InputAction::Order(PersonOrder::Land),
            Self::Hold => InputAction::Manual,
            Self::Automatic => InputAction::Automatic,
            Self::EmergencyStop => InputAction::Order(PersonOrder::EmergencyStop),
        }
    }
}

/// A random token of 128 bits, as hexadecimal digits.
///
/// # Errors
/// The system has no random numbers.
pub(super) fn token() -> Result<String> {
    let mut bytes = [0; TOKEN_BYTES];
    getrandom::fill(&mut bytes).context("no random numbers for the token of the live page")?;
    Ok(bytes.iter().fold(String::new(), |mut text, byte| {
        // Writing to a string does not fail.
        write!(text, "{byte:02x}").ok();
        text
    }))
}

/// Where orders are handed in.
#[derive(Debug)]
pub(super) struct OrderAccess {
    token: [u8; 32],
    inside: Mutex<Inside>,
}

#[derive(Debug)]
struct Inside {
    remote: Remote,
    /// The right by which a page took the sticks, if none has given them back or ordered more since.
    holder: Option<u64>,
    /// Rights to give orders that are held now, and all that ever were.
    rights: usize,
    rights_given: u64,
}

/// The right to give orders. When the last one goes, a person who steered from a page is gone.
#[derive(Debug)]
pub(super) struct OrderRight {
    access: Arc<OrderAccess>,
    number: u64,
}

impl OrderAccess {
    /// Access for those who know `token`.
    pub(super) fn new(token: &str, remote: Remote) -> Self {
        Self {
            token: digest(token),
            inside: Mutex::new(Inside { remote, holder: None, rights: 0, rights_given: 0 }),
        }
    }

    /// The right to give orders, for a viewer that knows the token.
    pub(super) fn authorize(self: &Arc<Self>, token: &str) -> Option<OrderRight> {
        // Of digests, and of all their bytes: the time that it takes depends on no part of the token.
        let differing = digest(token).iter().zip(&self.token).fold(0, |d, (a, b)| d | (a ^ b));
        if differing != 0 {
            return None;
        }
        let mut inside = self.inside.lock();
        inside.rights += 1;
        inside.rights_given += 1;
        Some(OrderRight { access: Arc::clone(self), number: inside.rights_given })
    }
}

impl OrderRight {
    /// Hands an order in.
    ///
    /// # Errors
    /// The control loop has not taken earlier orders.
    pub(super) fn order(&self, order: PageOrder) -> Result<(), RemoteBusy> {
        let mut inside = self.access.inside.lock();
        inside.remote.push(order.action())?;
        inside.holder = (order == PageOrder::Hold).then_some(self.number);
        Ok(())
    }
}

impl Drop for OrderRight {
    fn drop(&mut self) {
        let mut inside = self.access.inside.lock();
        inside.rights -= 1;
        let is_last = inside.rights == 0;
        if is_last {
            // If the queue is full the control loop stands still, and the sender's watchdog lands the drone.
            inside.remote.push(InputAction::Lost).ok();
        }
        if inside.holder.take_if(|holder| *holder == self.number).is_some()
            && inside.remote.is_heard()
        {
            let what_follows = if is_last {
                "it lands if nobody else steers"
            } else {
                "it hovers until another page or a person at the keys gives an order"
            };
            stdio::note(format_args!(
                "warning: the page that held the drone is gone: {what_follows}"
            ));
        }
    }
}

fn digest(token: &str) -> [u8; 32] {
    Sha256::digest(token).into()
}

#[cfg(test)]
mod tests {
    use tello_io::clock::{Clock, SpanNs};
    use tello_io::config;
    use tello_io::manual::{ManualControls, ManualSettings};

    use super::*;

    fn access(clock: Clock) -> (Arc<OrderAccess>, ManualControls) {
        let (table, _) = config::fly(None, None).unwrap();
        let (mut controls, ..) =
            ManualControls::new(ManualSettings::try_from(&table.manual).unwrap());
        let remote = controls.remote(clock);
        (Arc::new(OrderAccess::new("right", remote)), controls)
    }

    #[test]
    fn only_the_token_opens_and_tokens_differ() {
        let (access, _pilot) = access(Clock::start());
        for wrong in ["", "righ", "right ", "Right", "wrong"] {
            assert!(access.authorize(wrong).is_none(), "{wrong:?}");
        }
        assert!(access.authorize("right").is_some());
        let tokens = [token().unwrap(), token().unwrap()];
        assert_ne!(tokens[0], tokens[1]);
        assert!(tokens.iter().all(|token| token.len() == 2 * TOKEN_BYTES), "{tokens:?}");
    }

    #[test]
    fn each_order_does_what_its_key_does() {
        let clock = Clock::start();
        let (access, mut controls) = access(clock);
        let right = access.authorize("right").unwrap();
        for (page_order, order, steers) in [
            (PageOrder::TakeOff, Some(PersonOrder::TakeOff), false),
            (PageOrder::Hold, None, true),
            (PageOrder::Automatic, None, false),
            (PageOrder::Land, Some(PersonOrder::Land), false),
            (PageOrder::EmergencyStop, Some(PersonOrder::EmergencyStop), false),
        ] {
            right.order(page_order).unwrap();
            let input = controls.poll(clock.now());
            assert_eq!((input.order, input.sticks.is_some()), (order, steers), "{page_order:?}");
        }
    }

    #[test]
    fn who_holds_from_a_page_and_closes_the_last_one_is_landed() {
        let clock = Clock::start();
        let (access, mut controls) = access(clock);
        let rights = [access.authorize("right").unwrap(), access.authorize("right").unwrap()];
        rights[0].order(PageOrder::Hold).unwrap();
        let later = || clock.now().after(SpanNs::from_ms(1_500));
        let [first, second] = rights;
        drop(first);
        assert_eq!(controls.poll(later()).order, None, "another page is open");
        drop(second);
        assert_eq!(controls.poll(later()).order, Some(PersonOrder::Land));
    }
}
