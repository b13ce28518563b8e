//! Bytes of a terminal: whatever came before, Backspace stops the motors.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tello_io::manual::{Decoder, InputAction, PersonOrder, Typed};

fuzz_target!(|bytes: &[u8]| {
    let mut decoder = Decoder::default();
    for byte in bytes {
        decoder.feed(*byte);
    }
    assert_eq!(decoder.feed(0x7f), Some(Typed::Action(InputAction::Order(PersonOrder::EmergencyStop))));
});
