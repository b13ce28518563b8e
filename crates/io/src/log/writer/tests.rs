use std::sync::{Arc, Mutex};

use proptest::prelude::*;

use super::*;
use crate::log::Ending;
use crate::log::tests::{COUNT, Count, Memory, Sample, VALUE, counts, flight, fly, head, reader};

fn samples(log: &Memory) -> Vec<Result<Sample, LogError>> {
    let mut log = reader(log.bytes()).unwrap();
    let mut samples = Vec::new();
    while let Some(message) = log.next_message().unwrap() {
        samples.push(message.decode());
    }
    samples
}

#[test]
fn what_is_written_is_read_in_file_order() {
    let memory = Memory::endless();
    let mut log = memory.writer().unwrap();
    let sample = Sample { step: 7, value: -0.0, maybe: None };
    log.write(COUNT, TimeNs(-5), &Count { step: 6 }).unwrap();
    log.write(VALUE, TimeNs(20_000_000), &sample).unwrap();
    let summary = log.finish().unwrap();
    assert_eq!((summary.messages, summary.bytes), (2, memory.bytes().len() as u64));

    let mut log = reader(memory.bytes()).unwrap();
    assert_eq!(*log.head(), head());
    let message = log.next_message().unwrap().unwrap();
    assert_eq!((message.topic, message.t), (COUNT, TimeNs(-5)));
    assert_eq!(message.decode::<Count>().unwrap(), Count { step: 6 });
    let message = log.next_message().unwrap().unwrap();
    assert_eq!((message.topic, message.t), (VALUE, TimeNs(20_000_000)));
    let read = message.decode::<Sample>().unwrap();
    assert_eq!((read.value.to_bits(), read.maybe), ((-0.0_f64).to_bits(), None));
    assert_eq!(log.next_message().unwrap(), None);
    assert_eq!(log.ending(), Some(&Ending::Complete));
}

/// Topic, time in ns since 1970, and JSON.
type Received = (String, u64, Vec<u8>);

/// Keeps what it receives, in order.
#[derive(Clone, Default)]
struct Keeper(Arc<Mutex<Vec<Received>>>);

impl Tap for Keeper {
    fn receive(&mut self, topic: &str, log_time_ns: u64, json: &[u8]) {
        self.0.lock().unwrap().push((topic.into(), log_time_ns, json.into()));
    }
}

#[test]
fn a_tap_receives_what_the_file_has_from_its_beginning_on() {
    let memory = Memory::endless();
    let mut log = memory.writer().unwrap();
    log.write(COUNT, TimeNs(0), &Count { step: 6 }).unwrap();
    let keeper = Keeper::default();
    log.add_tap(Box::new(keeper.clone()));
    log.write(COUNT, TimeNs(20), &Count { step: 7 }).unwrap();
    log.write("/no/channel", TimeNs(30), &Count { step: 8 }).unwrap_err();
    log.finish().unwrap();
    let started = head().started_unix_ns;
    let received = keeper.0.lock().unwrap();
    assert_eq!(*received, [(COUNT.to_owned(), started + 20, br#"{"step":7}"#.to_vec())]);
    assert_eq!(Arc::strong_count(&keeper.0), 1, "a closed log has no tap");
}

proptest! {
    #[test]
    fn every_bit_of_a_finite_number_survives(
        numbers in prop::collection::vec(prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL, 200),
    ) {
        let memory = Memory::endless();
        let mut log = memory.writer().unwrap();
        for number in &numbers {
            log.write(VALUE, TimeNs(0), &Sample { step: 0, value: *number, maybe: None }).unwrap();
        }
        log.finish().unwrap();
        let read = samples(&memory);
        prop_assert_eq!(read.len(), numbers.len());
        for (read, number) in read.into_iter().zip(&numbers) {
            let read = read.unwrap().value;
            prop_assert_eq!(read.to_bits(), number.to_bits(), "{:e} became {:e}", number, read);
        }
    }
}

#[test]
fn a_number_that_is_not_finite_is_refused_by_its_reader() {
    for number in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let memory = Memory::endless();
        let mut log = memory.writer().unwrap();
        log.write(VALUE, TimeNs(40), &Sample { step: 0, value: number, maybe: None }).unwrap();
        log.finish().unwrap();
        let message = samples(&memory).remove(0).unwrap_err().to_string();
        let start = "message of /test/value at 40 ns: invalid type: null, expected f64";
        assert!(message.starts_with(start), "{number}: {message}");
    }
}

#[test]
fn an_unknown_topic_is_refused_and_leaves_the_log_usable() {
    let memory = Memory::endless();
    let mut log = memory.writer().unwrap();
    let error = log.write("/test/cuont", TimeNs(0), &Count { step: 0 }).unwrap_err();
    assert_eq!(error.to_string(), "/test/cuont is no channel of test.mcap");
    log.write(COUNT, TimeNs(0), &Count { step: 1 }).unwrap();
    log.finish().unwrap();
    assert_eq!(counts(reader(memory.bytes()).unwrap()), (vec![1], Ending::Complete));
}

#[test]
fn a_full_disk_is_an_error_wherever_it_strikes() {
    let size_of_whole = flight(200).0.len();
    for size in (0..size_of_whole).step_by(97) {
        let message = fly(&Memory::of_size(size), 200, |_| {}).unwrap_err().to_string();
        assert_eq!(message, "cannot write to test.mcap: no storage space", "{size} bytes");
    }
    assert_eq!(fly(&Memory::of_size(size_of_whole), 200, |_| {}).unwrap().messages, 400);
}

#[test]
fn a_dropped_log_is_closed() {
    let memory = Memory::endless();
    let mut log = memory.writer().unwrap();
    log.write(COUNT, TimeNs(0), &Count { step: 3 }).unwrap();
    drop(log);
    assert_eq!(counts(reader(memory.bytes()).unwrap()), (vec![3], Ending::Complete));
}
