//! Logs on a real disk.

use std::fs;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tello_io::clock::TimeNs;
use tello_io::log::{
    Channel, Ending, Head, LogError, LogReader, LogWriter, Recovered, csv, recover,
};

const TOPIC: &str = "/test/count";

#[derive(Serialize, Deserialize, JsonSchema)]
struct Count {
    step: u64,
}

/// A path in the build's scratch folder at which nothing is.
fn fresh(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    // Left by an earlier run, or nothing; if it stays, the test fails at its creation.
    drop(fs::remove_file(&path));
    path
}

fn create(path: &Path) -> Result<LogWriter, LogError> {
    let schema = schemars::schema_for!(Count).into();
    LogWriter::create(
        path,
        &Head::default(),
        &[Channel { topic: TOPIC, schema_name: "Count", schema }],
    )
}

/// The steps in a log, and whether it is complete.
fn steps(path: &Path) -> Result<(Vec<u64>, bool), LogError> {
    let mut log = LogReader::open(path)?;
    let mut steps = Vec::new();
    while let Some(message) = log.next_message()? {
        steps.push(message.decode::<Count>()?.step);
    }
    Ok((steps, log.ending().is_some_and(Ending::is_complete)))
}

#[test]
fn a_flush_brings_everything_into_the_file() {
    let path = fresh("flushed.mcap");
    let mut log = create(&path).unwrap();
    assert_eq!(steps(&path).unwrap(), (vec![], false), "the head is there from the start");
    log.write(TOPIC, TimeNs(0), &Count { step: 1 }).unwrap();
    log.flush().unwrap();
    log.write(TOPIC, TimeNs(0), &Count { step: 2 }).unwrap();
    // What a kill would leave at this moment.
    assert_eq!(steps(&path).unwrap(), (vec![1], false));

    let summary = log.finish().unwrap();
    assert_eq!(steps(&path).unwrap(), (vec![1, 2], true));
    assert_eq!((summary.messages, summary.bytes), (2, fs::metadata(&path).unwrap().len()));
    assert_eq!(summary.path, path);
}

#[test]
fn an_existing_file_is_kept() {
    let path = fresh("kept.mcap");
    fs::write(&path, "not a log").unwrap();
    let message = create(&path).unwrap_err().to_string();
    let expected = format!(
        "{} exists already and is kept: move it away or choose another name",
        path.display()
    );
    assert_eq!(message, expected);
    assert_eq!(fs::read_to_string(&path).unwrap(), "not a log");
}

#[test]
fn messages_name_the_file() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let missing = folder.join("no_such_folder/flight.mcap");
    let shown = missing.display();
    for (message, start) in [
        (create(&missing).unwrap_err().to_string(), format!("cannot create {shown}: No such file")),
        (
            LogReader::open(&missing).unwrap_err().to_string(),
            format!("cannot open {shown}: No such"),
        ),
        (
            csv::read(&missing).unwrap_err().to_string(),
            format!("cannot read {shown}: No such file"),
        ),
        (
            LogReader::open(folder).unwrap_err().to_string(),
            format!("cannot read {}: Is a directory", folder.display()),
        ),
    ] {
        assert!(message.starts_with(&start), "{message}");
    }
}

#[test]
fn a_csv_without_a_flight_is_refused() {
    let path = fresh("empty.log");
    for (text, why) in [
        ("", "it is empty"),
        ("\n\n", "it is empty"),
        ("{\n}\n", "line 1, unknown tag: {"),
        ("pos,0,1,2,3,4", "line 1, cut off before its line break: pos,0,1,2,3,4"),
    ] {
        fs::write(&path, text).unwrap();
        let message = csv::read(&path).unwrap_err().to_string();
        let start = format!("{}: no line of a flight log: {why}; ", path.display());
        assert!(message.starts_with(&start) && message.contains("TAG,STEP"), "{message}");
    }
}

#[test]
fn a_log_cut_at_any_byte_is_recovered_up_to_its_last_whole_chunk() {
    let path = fresh("whole.mcap");
    let mut log = create(&path).unwrap();
    for step in 0..200_u64 {
        log.write(TOPIC, TimeNs(20_000_000 * step.cast_signed()), &Count { step }).unwrap();
        if step % 50 == 49 {
            log.flush().unwrap();
        }
    }
    log.finish().unwrap();
    let bytes = fs::read(&path).unwrap();
    let (cut, mended) = (fresh("cut.mcap"), fresh("mended.mcap"));
    let (mut most, mut refused) = (0, 0);
    for end in (0..bytes.len()).step_by(7).chain([bytes.len()]) {
        fs::write(&cut, &bytes[..end]).unwrap();
        drop(fs::remove_file(&mended));
        let Ok((before, is_complete)) = steps(&cut) else {
            assert!(recover(&cut, &mended).is_err() && !mended.exists(), "at byte {end}");
            refused += 1;
            continue;
        };
        let Recovered { messages, was_torn, .. } = recover(&cut, &mended).unwrap();
        assert_eq!(was_torn, !is_complete, "at byte {end}");
        assert_eq!(steps(&mended).unwrap(), (before.clone(), true), "at byte {end}");
        assert_eq!(messages, before.len() as u64, "at byte {end}");
        assert!(before.iter().copied().eq(0..messages), "at byte {end}: {before:?}");
        most = most.max(messages);
    }
    assert_eq!(most, 200);
    assert!(refused > 10, "only {refused} cuts fell into the head");
    assert!(matches!(recover(&path, &path), Err(LogError::Exists { .. })));
}
