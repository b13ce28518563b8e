//! Lines of the Vicon relay: what is understood is written and read again without a change.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tello_io::vicon::{format_line, parse_line};

fuzz_target!(|bytes: &[u8]| {
    if let Ok(line) = parse_line(bytes) {
        let mut written = Vec::new();
        format_line(&line, &mut written);
        let again = parse_line(written.strip_suffix(b"\n").unwrap_or(&written));
        assert!(again.is_ok(), "{line:?} was written as {:?}", String::from_utf8_lossy(&written));
    }
});
