//! Flights in the thesis' CSV: rows ascend, and what is written is read again.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tello_io::log::csv;

fuzz_target!(|bytes: &[u8]| {
    let flight = csv::parse(bytes);
    assert!(flight.rows.is_sorted_by_key(|row| row.step));
    for row in &flight.rows {
        let mut written = Vec::new();
        assert!(row.write(&mut written, 9).is_ok());
        let again = csv::parse(&written);
        assert!(again.skipped.is_empty(), "{row:?} was written as {written:?}: {again:?}");
    }
});
