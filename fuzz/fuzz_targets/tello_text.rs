//! Datagrams of the text SDK, either way: what is understood survives a round trip.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tello_io::tello::text::{Command, Reply, StateLine};

fuzz_target!(|bytes: &[u8]| {
    let mut written = Vec::new();
    if let Ok(command) = Command::decode(bytes) {
        command.encode(&mut written);
        assert_eq!(Command::decode(&written), Ok(command));
    }
    if let Some(line) = StateLine::decode(bytes) {
        line.encode(&mut written);
        assert!(StateLine::decode(&written).is_some(), "{line:?}");
    }
    let _is_text = Reply::decode(bytes).is_some();
});
