use super::super::tests::{NUMBERED, documented, packet};
use super::*;

#[test]
fn the_documented_packet_is_written_byte_by_byte() {
    let written = packet(|to| frame(1000, 1_000_000, &[Some(NUMBERED)], to));
    assert_eq!(written, documented());
}

#[test]
fn a_body_that_is_not_seen_is_twelve_numbers_that_are_none() {
    let written = packet(|to| frame(1, 0, &[None], to));
    assert_eq!(written.len(), documented().len());
    let numbers = written[40..].chunks(4).map(|raw| f32::from_le_bytes(raw.try_into().unwrap()));
    assert_eq!(numbers.filter(|number| number.is_nan()).count(), 12);
}
