use std::fs;
use std::path::PathBuf;

use mcap::records::{self, MessageHeader, SchemaHeader};

use super::*;
use crate::log::Ending;
use crate::log::testing::{counts, flight, reader};

/// A path without a file.
fn fresh(name: &str) -> PathBuf {
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
    assert_eq!(recovered, Recovered { messages: 240, was_torn: false });
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
    assert_eq!((recovered, steps), (Recovered { messages: 200, was_torn: true }, 100));
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
fn a_record_refers_to_what_was_there_before() {
    let path = fresh("copy.mcap");
    let mcap = chunked().create(BufWriter::new(File::create(&path).unwrap())).unwrap();
    let mut copy = Copy { mcap, schemas: BTreeMap::new(), channels: BTreeMap::new(), messages: 0 };
    let schema = Record::Schema {
        header: SchemaHeader { id: 5, name: "S".into(), encoding: "jsonschema".into() },
        data: Cow::Borrowed(b"{}"),
    };
    let channel = |id, schema_id| {
        Record::Channel(records::Channel {
            id,
            schema_id,
            topic: format!("/{id}"),
            message_encoding: "json".into(),
            metadata: BTreeMap::new(),
        })
    };
    let message = |channel_id| Record::Message {
        header: MessageHeader { channel_id, sequence: 0, log_time: 0, publish_time: 0 },
        data: Cow::Borrowed(b"{}"),
    };
    assert!(!copy.knows(&channel(9, 5)) && copy.knows(&channel(9, 0)), "0 is no schema");
    copy.take(schema).unwrap();
    assert!(copy.knows(&channel(9, 5)) && !copy.knows(&channel(9, 6)));
    assert!(!copy.knows(&message(9)));
    copy.take(channel(9, 5)).unwrap();
    assert!(copy.knows(&message(9)) && !copy.knows(&message(5)));
    copy.take(message(9)).unwrap();
    copy.take(message(7)).unwrap();
    assert_eq!(copy.messages, 1, "of a channel that is not there");
    drop(copy);
    fs::remove_file(path).unwrap();
}
