//! The flight log: MCAP files out and in, the thesis' CSV in and out, and the hand-off to the thread
//! that writes.
//!
//! Owns the log's files and nothing of their meaning: a record is anything that serializes to JSON, or bytes of
//! a published kind for viewers; a channel is a topic with a schema, and times are handed in. No clock is read here.
//!
//! A log is a sequence of
//! 1. a metadata record `tello-ctl` and one attachment per document, together the [`Head`];
//! 2. chunks of messages, each chunk compressed with zstd and closed at 64 KiB or by a flush.
//!
//! The head comes first and the file only ever grows at its end, so a log whose writer was killed
//! has everything up to its last flush; [`Ending`] states where it stops.
//!
//! Every bit of a finite `f64` survives. JSON has no NaN and no infinity: such a number is written as
//! `null`, which a reader that expects a plain `f64` refuses by name ([`LogError::Decode`]). Values
//! that may be absent are `Option` in the record, `null` in its schema.

pub mod csv;
mod disk;
mod framing;
mod reader;
mod recorder;
mod recover;
#[cfg(test)]
mod tests;
mod writer;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::clock::TimeNs;

pub use disk::free_bytes;
pub use reader::{Ending, LogReader, Message};
pub use recorder::Recorder;
pub use recover::{Recovered, recover};
pub use writer::{LogWriter, Summary, Tap};

/// Name of the document in [`Head::documents`] that holds the complete resolved configuration.
pub const CONFIG: &str = "config.json";

/// Encoding of records that are read again.
const JSON: &str = "json";

/// Statements of a log about itself, before its first message.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Head {
    /// Wall-clock time of `TimeNs(0)`. ns since 1970-01-01 UTC
    pub started_unix_ns: u64,
    /// Version of the program that wrote the log.
    pub version: String,
    /// Git revision of that program.
    pub revision: String,
    /// JSON documents by file name, [`CONFIG`] among them.
    pub documents: BTreeMap<String, String>,
}

/// A channel of the log: one kind of record under one name.
#[derive(Debug, Clone)]
pub struct Channel {
    /// Name of the channel, `/subject/what`.
    pub topic: &'static str,
    /// Name of the kind of record.
    pub schema_name: &'static str,
    /// Form and schema of the messages.
    pub schema: Schema,
}

/// Form of a channel's messages, with what a reader needs to decode them.
#[derive(Debug, Clone)]
pub enum Schema {
    /// JSON, with its JSON schema.
    Json(schemars::Schema),
    /// Protocol Buffers, with the `FileDescriptorSet` of the message.
    Protobuf(Cow<'static, [u8]>),
    /// ROS 2 in CDR, with the definition of the message and of all its parts.
    Ros2(Cow<'static, str>),
}

impl Schema {
    /// Name of the messages' encoding in the registry of MCAP.
    pub fn message_encoding(&self) -> &'static str {
        match self {
            Self::Json(_) => JSON,
            Self::Protobuf(_) => "protobuf",
            Self::Ros2(_) => "cdr",
        }
    }

    /// Name of the schema's encoding in the registry of MCAP.
    pub fn schema_encoding(&self) -> &'static str {
        match self {
            Self::Json(_) => "jsonschema",
            Self::Protobuf(_) => "protobuf",
            Self::Ros2(_) => "ros2msg",
        }
    }

    /// The schema as it stands in the file.
    pub fn data(&self) -> Cow<'_, [u8]> {
        match self {
            Self::Json(schema) => Cow::Owned(schema.as_value().to_string().into_bytes()),
            Self::Protobuf(descriptors) => Cow::Borrowed(descriptors),
            Self::Ros2(definition) => Cow::Borrowed(definition.as_bytes()),
        }
    }
}

impl From<schemars::Schema> for Schema {
    fn from(schema: schemars::Schema) -> Self {
        Self::Json(schema)
    }
}

/// Why a log could not be written or read. Every message names the file or the topic.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LogError {
    /// A log is never overwritten.
    #[error("{} exists already and is kept: move it away or choose another name", path.display())]
    Exists {
        /// The file in the way.
        path: PathBuf,
    },
    /// The operating system refused. After a refused write the log is to be given up: it has what was flushed before.
    #[error("cannot {what} {}: {source}", path.display())]
    Io {
        /// What could not be done: create, open, read, write to, start the thread that writes.
        what: &'static str,
        /// The log.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The log was created without this channel.
    #[error("{topic} is no channel of {}", path.display())]
    NoChannel {
        /// The unknown topic.
        topic: String,
        /// The log.
        path: PathBuf,
    },
    /// A record cannot be written in the form of its channel.
    #[error("a record of {topic} cannot be written: {source}")]
    Encode {
        /// Topic of the record.
        topic: String,
        /// Error of the encoder.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The thread that writes the log panicked.
    #[error("the thread that writes the log panicked; the log ends at its last flush")]
    ThreadPanicked,
    /// The disk did not take the log in time.
    #[error("the disk does not take the rest of it")]
    Unfinished,
    /// The file is something else, or was cut off before its head was complete.
    #[error("{} is not a log of tello-ctl: {why}", path.display())]
    NotALog {
        /// The file.
        path: PathBuf,
        /// Kind of the file, and what to do.
        why: String,
    },
    /// A message is not of the type that the reader expects.
    #[error("message of {topic} at {} ns: {source}", t.0)]
    Decode {
        /// Topic of the message.
        topic: String,
        /// Its time.
        t: TimeNs,
        /// Key and position of the mismatch.
        source: serde_json::Error,
    },
}

/// Makes the error of an operating system that refused to do `what` with the log.
fn io_error(what: &'static str, path: &Path) -> impl FnOnce(io::Error) -> LogError {
    move |source| LogError::Io { what, path: path.to_owned(), source }
}
