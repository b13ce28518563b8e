use std::sync::LazyLock;

use proptest::prelude::*;

use super::*;
use crate::log::tests::{COUNT, counts, flight, head, reader};

/// Ten seconds of flight.
const STEPS: u64 = 500;

#[test]
fn a_log_cut_anywhere_has_everything_before_its_last_flush() {
    let (bytes, flushes) = flight(STEPS);
    for cut in (flushes[0].0..bytes.len()).step_by(61) {
        let log = reader(bytes[..cut].to_vec()).unwrap();
        assert_eq!(*log.head(), head(), "cut at {cut}");
        let (steps, ending) = counts(log);
        let flushed = flushes.iter().rev().find(|(size, _)| *size <= cut).unwrap().1;
        let found = steps.len() as u64;
        assert_eq!(steps, (0..found).collect::<Vec<_>>(), "cut at {cut}");
        // A chunk that is whole is read, even if the cut went through its index.
        assert!((flushed..=flushed + 50).contains(&found), "{found} of {flushed}, cut at {cut}");
        let Ending::Torn { messages, last, bytes, .. } = ending else {
            panic!("cut at {cut}: {ending}");
        };
        assert_eq!((messages, bytes), (2 * found, cut as u64));
        let last_step = found.checked_sub(1).map(u64::cast_signed);
        assert_eq!(last, last_step.map(|step| TimeNs(20_000_000 * step)), "cut at {cut}");
    }
}

#[test]
fn a_log_cut_within_its_head_is_refused() {
    let (bytes, flushes) = flight(0);
    let mut refused = 0;
    for cut in 0..flushes[0].0 {
        match reader(bytes[..cut].to_vec()) {
            Ok(log) => assert_eq!(*log.head(), head(), "cut at {cut}"),
            Err(LogError::NotALog { .. }) => refused += 1,
            Err(other) => panic!("cut at {cut}: {other}"),
        }
    }
    assert!(refused > 400, "only {refused} of {} cuts refused", flushes[0].0);
}

#[test]
fn the_ending_of_a_torn_log_states_where() {
    let (bytes, flushes) = flight(STEPS);
    let (size, _) = flushes[3];
    let (_, ending) = counts(reader(bytes[..=size].to_vec()).unwrap());
    let expected = format!(
        "torn 2.98 s into the log, after 300 messages and {} bytes: MCAP file ended in the middle of \
         a record",
        size + 1
    );
    assert_eq!(ending.to_string(), expected);
    assert!(!ending.is_complete() && Ending::Complete.is_complete());
}

#[test]
fn a_selection_hands_out_its_topics_only() {
    let (bytes, _) = flight(10);
    let mut log = reader(bytes).unwrap().select(&[COUNT, "/test/unknown"]);
    let mut messages = 0;
    while let Some(message) = log.next_message().unwrap() {
        assert_eq!(message.topic, COUNT);
        messages += 1;
    }
    assert_eq!(messages, 10);
    assert!(log.ending().unwrap().is_complete());
}

#[test]
fn what_is_no_log_is_refused_with_the_way_out() {
    let mut foreign = mcap::Writer::new(io::Cursor::new(Vec::new())).unwrap();
    foreign.add_channel(0, "/a", "json", &BTreeMap::new()).unwrap();
    foreign.finish().unwrap();
    let foreign = foreign.into_inner().into_inner();
    let convert = "(`tello-ctl convert` makes a log from a CSV flight log; `tello-ctl log recover` saves what is \
                   left of a damaged one)";
    for (bytes, why) in [
        (Vec::new(), "it is empty".to_owned()),
        (b"pos,0,-0.38,-2.23,1.22,1.22\n".to_vec(), format!("Bad magic number {convert}")),
        (
            flight(0).0[..20].to_vec(),
            format!("MCAP file ended in the middle of a record {convert}"),
        ),
        (foreign, "it is MCAP, but without the metadata record `tello-ctl`".to_owned()),
    ] {
        let message = reader(bytes).unwrap_err().to_string();
        assert_eq!(message, format!("test.mcap is not a log of tello-ctl: {why}"));
    }
}

#[test]
fn a_failing_disk_is_an_error_and_no_ending() {
    struct Failing(io::Cursor<Vec<u8>>);
    impl Read for Failing {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            match self.0.read(buffer)? {
                0 => Err(io::Error::other("bad sector")),
                read => Ok(read),
            }
        }
    }
    let (bytes, flushes) = flight(STEPS);
    let source = Failing(io::Cursor::new(bytes[..flushes[2].0].to_vec()));
    let mut log = LogReader::from_source(Path::new("test.mcap"), Box::new(source)).unwrap();
    let error = loop {
        match log.next_message() {
            Ok(message) => assert!(message.is_some(), "the end of a failing disk ended the log"),
            Err(error) => break error,
        }
    };
    assert_eq!(error.to_string(), "cannot read test.mcap: bad sector");
}

#[test]
fn a_chunk_that_claims_gigabytes_is_not_unpacked() {
    let (mut bytes, flushes) = flight(STEPS);
    let (size, steps_before) = flushes[3];
    bytes.truncate(size);
    // Two times, what it unpacks to, no checksum, "zstd", nothing packed: the reader would ask for more for ever.
    bytes.push(op::CHUNK);
    bytes.extend(1_000_000_u64.to_le_bytes());
    bytes.extend([0; 16]);
    bytes.extend(u64::from(u32::MAX).to_le_bytes());
    bytes.extend([0; 4]);
    bytes.extend(4_u32.to_le_bytes());
    bytes.extend(b"zstd");
    bytes.extend(999_960_u64.to_le_bytes());
    bytes.resize(bytes.len() + 1_000_000, 0);
    let (steps, ending) = counts(reader(bytes).unwrap());
    assert_eq!(steps.len() as u64, steps_before, "what stands before it is read");
    let why = format!("the chunk at byte {size} would unpack to 4294967295 bytes");
    assert!(ending.to_string().contains(&why), "{ending}");
}

#[test]
fn an_attachment_too_short_for_its_fields_is_damage() {
    // Two times, an empty name, an empty media type, a length of zero, a checksum.
    let whole = [0; 16 + 4 + 4 + 8 + 4];
    assert!(is_attachment(&whole));
    for length in 0..whole.len() {
        assert!(!is_attachment(&whole[..length]), "{length} bytes");
        assert!(parse(op::ATTACHMENT, &whole[..length]).is_err(), "{length} bytes");
    }
    let mut huge_name = whole;
    huge_name[16..20].fill(0xff);
    assert!(!is_attachment(&huge_name));
}

proptest! {
    #[test]
    fn damage_is_noticed_and_hands_out_nothing_false(
        at in any::<prop::sample::Index>(),
        garbage in prop::collection::vec(any::<u8>(), 1..40),
    ) {
        static WHOLE: LazyLock<Vec<u8>> = LazyLock::new(|| flight(100).0);
        let mut bytes = WHOLE.clone();
        let at = at.index(bytes.len());
        for (byte, garbage) in bytes[at..].iter_mut().zip(&garbage) {
            *byte = *garbage;
        }
        prop_assume!(bytes != *WHOLE);
        if let Ok(log) = reader(bytes) {
            let (steps, ending) = counts(log);
            prop_assert!(steps.is_sorted_by(|a, b| a < b) && steps.iter().all(|step| *step < 100));
            prop_assert!(!ending.is_complete());
        }
    }

    #[test]
    fn garbage_is_no_log(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let is_refused = matches!(reader(bytes), Err(LogError::NotALog { .. }));
        prop_assert!(is_refused);
    }

    #[test]
    fn garbage_behind_the_magic_is_no_log(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let bytes = [mcap::MAGIC, &bytes].concat();
        let is_refused = matches!(reader(bytes), Err(LogError::NotALog { .. }));
        prop_assert!(is_refused);
    }
}
