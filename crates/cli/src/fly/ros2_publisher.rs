//! A flight live in ROS 2: what goes into the log is published as messages of ROS 2.
//!
//! Owns the thread that publishes and the bounded queue to it. The log's thread never waits for it: what finds no
//! room is counted and lost to ROS 2 alone. Messages are made from the bytes of the log, as `log ros2` makes them.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use anyhow::Result;
use rustdds::no_key::DataWriter;
use tello_eval::ros2::{self, RosTopic};
use tello_io::log::{LogWriter, Tap};

use crate::ros2::{Encoded, Network, Node};
use crate::stdio;

/// Records of the log on their way to the thread: two seconds.
const RECORDS: usize = 1000;

/// How long the end of a flight waits for readers to have all messages.
const FAREWELL: Duration = Duration::from_secs(2);

/// A record of the log.
struct Record {
    topic: &'static str,
    stamp_ns: u64,
    bytes: Vec<u8>,
}

/// Publishes `log` in `network` as well. If that is not possible, a warning is printed and the flight goes on.
pub(super) fn publish(network: Network, log: &mut LogWriter) {
    match Publisher::start(network) {
        Ok(publisher) => log.add_tap(Box::new(publisher)),
        Err(error) => {
            stdio::note(format_args!("cannot publish in ROS 2: {}", stdio::chain(&error)));
        }
    }
}

/// The near end of the queue.
struct Publisher {
    /// `None` at the end.
    records: Option<SyncSender<Record>>,
    /// Closed when the thread is done.
    done: Receiver<()>,
    lost: u64,
}

impl Publisher {
    fn start(network: Network) -> Result<Self> {
        let node = Node::join(network)?;
        let writers: Result<Vec<_>> =
            RosTopic::ALL.iter().map(|&topic| Ok((topic, node.writer(topic)?))).collect();
        let writers = writers?;
        let (records, queue) = sync_channel(RECORDS);
        let (end, done) = sync_channel::<()>(0);
        thread::Builder::new().name("tello-ros2".into()).spawn(move || {
            write_all(&queue, &writers);
            drop((writers, node, end));
        })?;
        Ok(Self { records: Some(records), done, lost: 0 })
    }
}

impl Tap for Publisher {
    fn receive(&mut self, topic: &str, stamp_ns: u64, bytes: &[u8]) {
        let known = ros2::sources().into_iter().find(|known| *known == topic);
        let (Some(topic), Some(records)) = (known, &self.records) else { return };
        let record = Record { topic, stamp_ns, bytes: bytes.to_vec() };
        self.lost += u64::from(records.try_send(record).is_err());
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        self.records = None;
        let is_hung = self.done.recv_timeout(FAREWELL) == Err(RecvTimeoutError::Timeout);
        if self.lost > 0 {
            stdio::note(format_args!("ROS 2 missed {} records", self.lost));
        }
        if is_hung {
            stdio::note("ROS 2 missed the end of the flight");
        }
    }
}

/// Publishes what comes until the log is closed, then gives readers time to have it.
fn write_all(queue: &Receiver<Record>, writers: &[(RosTopic, DataWriter<Vec<u8>, Encoded>)]) {
    let mut refused = 0_u64;
    for Record { topic, stamp_ns, bytes } in queue {
        let Ok(messages) = ros2::messages(topic, stamp_ns, &bytes) else {
            refused += 1;
            continue;
        };
        for (topic, message) in messages {
            let writer = writers.iter().find(|(of, _)| *of == topic);
            let written = writer.map(|(_, writer)| writer.write(message, None));
            refused += u64::from(!matches!(written, Some(Ok(()))));
        }
    }
    let timeout = FAREWELL / 2 / u32::try_from(writers.len()).unwrap_or(1).max(1);
    for (_, writer) in writers {
        // A reader that has not answered by then is gone.
        writer.wait_for_acknowledgments(timeout).ok();
    }
    if refused > 0 {
        stdio::note(format_args!("{refused} messages could not be published in ROS 2"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_records_that_ros_2_has_are_queued_and_those_without_room_are_counted() {
        let (records, queue) = sync_channel(2);
        let (_end, done) = sync_channel::<()>(0);
        let mut publisher = Publisher { records: Some(records), done, lost: 0 };
        let known = ros2::sources().into_iter().next().unwrap();
        publisher.receive("/no/such/channel", 1, b"{}");
        for stamp_ns in 1..=5 {
            publisher.receive(known, stamp_ns, b"{}");
        }
        assert_eq!(publisher.lost, 3);
        let stamps: Vec<u64> = queue.try_iter().map(|record| record.stamp_ns).collect();
        assert_eq!(stamps, [1, 2]);
    }
}
