//! Logs in memory, for the tests of writer, reader and recorder.

use std::collections::BTreeMap;
use std::io::{self, Cursor, Write};
use std::path::Path;
use std::sync::{Arc, Mutex};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::writer::chunked;
use super::{CONFIG, Channel, Ending, Head, LogError, LogReader, LogWriter, Summary};
use crate::clock::TimeNs;

pub(super) const COUNT: &str = "/test/count";
pub(super) const VALUE: &str = "/test/value";

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(super) struct Count {
    pub(super) step: u64,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(super) struct Sample {
    pub(super) step: u64,
    pub(super) value: f64,
    pub(super) maybe: Option<f64>,
}

pub(super) fn head() -> Head {
    Head {
        started_unix_ns: 1_700_000_000_123_456_789,
        version: "0.1.0".into(),
        revision: "0123abc".into(),
        documents: BTreeMap::from([
            (CONFIG.into(), r#"{"dt_s":0.02}"#.into()),
            ("parameters.json".into(), r#"{"lambda_h":1.294}"#.into()),
        ]),
    }
}

pub(super) fn channels() -> [Channel; 2] {
    [
        Channel { topic: COUNT, schema_name: "Count", schema: schemars::schema_for!(Count).into() },
        Channel {
            topic: VALUE,
            schema_name: "Sample",
            schema: schemars::schema_for!(Sample).into(),
        },
    ]
}

/// A file in memory that fills up at a given size.
#[derive(Clone)]
pub(super) struct Memory {
    bytes: Arc<Mutex<Vec<u8>>>,
    size_max: usize,
}

impl Memory {
    pub(super) fn endless() -> Self {
        Self::of_size(usize::MAX)
    }

    pub(super) fn of_size(size_max: usize) -> Self {
        Self { bytes: Arc::default(), size_max }
    }

    pub(super) fn writer(&self) -> Result<LogWriter, LogError> {
        LogWriter::into_sink(
            Path::new("test.mcap"),
            Box::new(self.clone()),
            chunked(),
            &head(),
            &channels(),
        )
    }

    pub(super) fn bytes(&self) -> Vec<u8> {
        self.bytes.lock().unwrap().clone()
    }
}

impl Write for Memory {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut written = self.bytes.lock().unwrap();
        let room = self.size_max - written.len();
        if room == 0 {
            return Err(io::ErrorKind::StorageFull.into());
        }
        let taken = &bytes[..bytes.len().min(room)];
        written.extend_from_slice(taken);
        Ok(taken.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

pub(super) fn reader(bytes: Vec<u8>) -> Result<LogReader, LogError> {
    LogReader::from_source(Path::new("test.mcap"), Box::new(Cursor::new(bytes)))
}

/// Steps of the messages of [`COUNT`] with how the log ends.
pub(super) fn counts(mut log: LogReader) -> (Vec<u64>, Ending) {
    let mut steps = Vec::new();
    while let Some(message) = log.next_message().unwrap() {
        if message.topic == COUNT {
            steps.push(message.decode::<Count>().unwrap().step);
        }
    }
    (steps, log.ending().unwrap().clone())
}

/// Writes and closes a flight: a message of [`COUNT`] and one of [`VALUE`] every 20 ms, flushed once a
/// second and then shown to `flushed` with the number of steps so far.
pub(super) fn fly(
    memory: &Memory,
    steps: u64,
    mut flushed: impl FnMut(u64),
) -> Result<Summary, LogError> {
    let mut log = memory.writer()?;
    flushed(0);
    for step in 0..steps {
        let t = TimeNs(20_000_000 * step.cast_signed());
        log.write(COUNT, t, &Count { step })?;
        // Hardly compressible, as the numbers of a flight are.
        let value = (step as f64).sin();
        log.write(VALUE, t, &Sample { step, value, maybe: Some(value.exp()) })?;
        if step % 50 == 49 {
            log.flush()?;
            flushed(step + 1);
        }
    }
    log.finish()
}

/// Bytes of a whole flight, and after each flush how many bytes and steps there were.
pub(super) fn flight(steps: u64) -> (Vec<u8>, Vec<(usize, u64)>) {
    let memory = Memory::endless();
    let mut flushes = Vec::new();
    fly(&memory, steps, |steps| flushes.push((memory.bytes().len(), steps))).unwrap();
    (memory.bytes(), flushes)
}
