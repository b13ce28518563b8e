use std::fs;
use std::path::PathBuf;

use mcap::MAGIC;

use super::*;
use crate::log::Ending;
use crate::log::tests::{counts, flight, reader};

/// A path without a file.
pub(super) fn fresh(name: &str) -> PathBuf {
    let path =
        std::env::temp_dir().join(format!("tello-ctl-recover-{}-{name}", std::process::id()));
    fs::remove_file(&path).ok();
    path
}

/// The bytes that come of `bytes`, and the report on them.
fn recovered(name: &str, bytes: &[u8]) -> (Vec<u8>, Recovered) {
    let [from, to] = ["from", "to"].map(|end| fresh(&format!("{name}-{end}.mcap")));
    fs::write(&from, bytes).unwrap();
    let recovered = recover(&from, &to).unwrap();
    let copy = fs::read(&to).unwrap();
    fs::remove_file(from).unwrap();
    fs::remove_file(to).unwrap();
    (copy, recovered)
}

#[test]
fn a_whole_log_is_copied_with_all_that_is_in_it() {
    let (bytes, _) = flight(120);
    let (copy, recovered) = recovered("whole", &bytes);
    // A message on each of two channels in a step.
    let expected = Recovered { messages: 240, ..Recovered::default() };
    assert_eq!(recovered, expected);
    let (old, new) = (reader(bytes).unwrap(), reader(copy).unwrap());
    assert_eq!(new.head(), old.head());
    assert_eq!(counts(new), ((0..120).collect(), Ending::Complete));
}

#[test]
fn a_torn_log_is_whole_up_to_its_last_flush() {
    let (bytes, flushes) = flight(120);
    let (size, steps) = flushes[2];
    // Some bytes of the next chunk are there.
    let (copy, recovered) = recovered("torn", &bytes[..size + 20]);
    let expected =
        Recovered { messages: 200, was_torn: true, unread_bytes: 20, ..Recovered::default() };
    assert_eq!((recovered, steps), (expected, 100));
    assert_eq!(counts(reader(copy).unwrap()), ((0..100).collect(), Ending::Complete));
}

#[test]
fn nothing_is_made_of_what_is_no_log_and_nothing_is_overwritten() {
    let [from, to] = ["no-log", "target"].map(fresh);
    fs::write(&from, b"pos,0,1,2,3,4\n").unwrap();
    assert!(recover(&from, &to).is_err() && !to.exists());
    fs::write(&from, flight(1).0).unwrap();
    fs::write(&to, b"mine").unwrap();
    let error = recover(&from, &to).unwrap_err();
    assert!(matches!(error, LogError::Exists { ref path } if *path == to), "{error}");
    assert_eq!(fs::read(&to).unwrap(), b"mine");
    fs::remove_file(from).unwrap();
    fs::remove_file(to).unwrap();
}

#[test]
fn a_damaged_chunk_is_left_out_alone() {
    let (bytes, flushes) = flight(120);
    let cases: [(usize, Vec<u64>, usize); 3] = [
        // A chunk of messages; the first one, whose channels the index knows; the records behind a chunk.
        (flushes[1].0 + 200, (0..flushes[1].1).chain(flushes[2].1..120).collect(), 1),
        (flushes[0].0 - 40, (0..120).collect(), 1),
        (flushes[1].0 - 40, (0..120).collect(), 0),
    ];
    for (at, left, damaged) in cases {
        let mut bytes = bytes.clone();
        bytes[at] ^= 1;
        let (copy, recovered) = recovered("flipped", &bytes);
        assert!(recovered.was_torn && recovered.damaged.len() == damaged, "{recovered:?}");
        assert_eq!(recovered.messages, 2 * left.len() as u64);
        assert_eq!(counts(reader(copy).unwrap()), (left, Ending::Complete));
    }
}

#[test]
fn of_two_logs_in_one_file_the_second_is_missed_and_counted() {
    let once = flight(60).0;
    let (rest_bytes, twice) = (once.len() as u64, once.repeat(2));
    let (copy, recovered) = recovered("twice", &twice);
    assert_eq!(recovered, Recovered { messages: 120, rest_bytes, ..Recovered::default() });
    let (steps, ending) = counts(reader(twice).unwrap());
    assert!(ending.to_string().contains("more bytes follow its end"), "{ending}");
    assert_eq!((steps, Ending::Complete), counts(reader(copy).unwrap()));
}

#[test]
fn behind_a_broken_frame_the_next_whole_chunk_is_found() {
    let (bytes, flushes) = flight(120);
    let [(first, _), (second, before), (third, after), ..] = flushes[..] else { panic!() };
    let left: Vec<u64> = (0..before).chain(after..120).collect();
    assert!(first < second && second < third);
    for (name, at, flipped) in
        [("the length", 7, 0x7f), ("a length within the file", 1, 0x40), ("the opcode", 0, 0x80)]
    {
        let mut bytes = bytes.clone();
        bytes[second + at] ^= flipped;
        let (copy, recovered) = recovered("frame", &bytes);
        assert_eq!(counts(reader(copy).unwrap()), (left.clone(), Ending::Complete), "{name}");
        assert_eq!(recovered.messages, 2 * left.len() as u64, "{name}");
        assert_eq!(recovered.unread_bytes, (third - second) as u64, "{name}");
        assert!(recovered.was_torn && recovered.damaged.is_empty(), "{name}");
    }
}

#[test]
fn of_two_logs_in_one_file_the_first_whose_end_is_damaged_takes_nothing_of_the_second() {
    let once = flight(60).0;
    let mut twice = once.repeat(2);
    // The opcode of the footer, which has 29 bytes.
    twice[once.len() - MAGIC.len() - 29] = 0;
    let (_, of_two) = recovered("ends", &twice);
    assert_eq!((of_two.messages, of_two.rest_bytes), (120, once.len() as u64));
    let (_, of_one) = recovered("ends", &twice[..once.len()]);
    assert_eq!((of_one.messages, of_one.rest_bytes, of_one.unread_bytes), (120, 0, 29));
}

#[test]
fn of_two_logs_in_one_file_the_first_torn_takes_nothing_of_the_second() {
    let (once, flushes) = flight(120);
    let (size, steps) = flushes[1];
    let length = once[size + 1..size + 9].try_into().map(u64::from_le_bytes).unwrap();
    let chunk = 9 + usize::try_from(length).unwrap();
    // At the end of a frame; with a part of the next chunk, whose length reaches into the second log.
    for (name, cut) in [
        ("at a frame", 0),
        ("in a length", 5),
        ("in a chunk", chunk / 2),
        ("at its end", chunk - 3),
    ] {
        let two = [&once[..size + cut], &once].concat();
        let (copy, of_two) = recovered("torn-two", &two);
        assert_eq!(counts(reader(copy).unwrap()).0, (0..steps).collect::<Vec<_>>(), "{name}");
        let unread_bytes = cut as u64;
        let (messages, rest_bytes) = (2 * steps, once.len() as u64);
        let expected =
            Recovered { messages, was_torn: true, unread_bytes, rest_bytes, ..of_two.clone() };
        assert_eq!(of_two, expected, "{name}");
    }
}

#[test]
fn a_damaged_document_of_the_head_is_left_out_alone() {
    let (mut bytes, _) = flight(120);
    let document = b"\"dt_s\":0.02";
    let at = bytes.windows(document.len()).position(|window| window == document).unwrap();
    bytes[at] ^= 1;
    assert!(reader(bytes.clone()).is_err());
    let (copy, recovered) = recovered("document", &bytes);
    assert!(recovered.messages == 240 && recovered.was_torn && recovered.unread_bytes > 0);
    let mut expected = reader(flight(120).0).unwrap().head().clone();
    expected.documents.remove(crate::log::CONFIG).unwrap();
    assert_eq!(*reader(copy).unwrap().head(), expected);
}

#[test]
fn a_log_of_another_compression_names_what_makes_a_log_of_it() {
    let mut bytes = flight(60).0;
    let at = bytes.windows(4).position(|window| window == b"zstd").unwrap();
    bytes[at..at + 4].copy_from_slice(b"lz4x");
    let refusal = reader(bytes).unwrap_err().to_string();
    assert!(refusal.contains("mcap compress --compression zstd"), "{refusal}");
}
