//! Logs that are torn, damaged or none at all.
#![no_main]

use std::io::Cursor;
use std::path::Path;

use libfuzzer_sys::fuzz_target;
use tello_io::log::LogReader;

fuzz_target!(|bytes: &[u8]| {
    let source = Box::new(Cursor::new(bytes.to_vec()));
    let Ok(mut log) = LogReader::from_source(Path::new("noise.mcap"), source) else {
        return;
    };
    while matches!(log.next_message(), Ok(Some(_))) {}
});
