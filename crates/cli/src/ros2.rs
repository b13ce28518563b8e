//! ROS 2 without a ROS installation: a participant in a DDS network.
//!
//! Owns names on the wire, quality of service and the network; the content of messages is `tello_eval::ros2`'s.

use std::net::{IpAddr, Ipv4Addr};

use anyhow::Result;
use clap::Args;
use rustdds::bytes::Bytes;
use rustdds::no_key::{BareDataReaderStream, DataWriter, SerializerAdapter};
use rustdds::policy::{Durability, History, Reliability};
use rustdds::{
    CDRDeserializerAdapter, DomainParticipant, DomainParticipantBuilder, Duration, QosPolicies,
    QosPolicyBuilder, RepresentationIdentifier, Topic, TopicKind,
};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use tello_eval::ros2::{Kind, RosTopic};

/// Bytes that name the encoding, in front of a message in a file; on the wire the library writes them.
const HEAD_BYTES: usize = 4;

/// Messages of a topic that are kept for readers that missed them.
const KEPT: i32 = 2000;

/// Poses that wait to be read: the newest ones count.
const UNREAD: i32 = 16;

/// Where ROS 2 is.
#[derive(Debug, Clone, Copy, Args)]
pub(crate) struct Network {
    /// Address of this machine in the network of the other ROS 2 nodes.
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    ros2_interface: IpAddr,
    /// Domain of the other ROS 2 nodes: their `ROS_DOMAIN_ID`.
    #[arg(long, value_name = "NUMBER", default_value_t = 0)]
    #[arg(value_parser = clap::value_parser!(u16).range(0..=232))]
    ros2_domain: u16,
}

/// A pose as in `geometry_msgs/PoseStamped`.
#[derive(Debug, Clone, Deserialize)]
pub(crate) struct PoseStamped {
    header: Header,
    /// Position x, y, z in m; quaternion x, y, z, w.
    pub(crate) pose: ([f64; 3], [f64; 4]),
}

#[derive(Debug, Clone, Deserialize)]
struct Header {
    /// Whole seconds since 1970, and ns.
    stamp: (i32, u32),
    /// The frame, which is not used.
    _frame_id: String,
}

impl PoseStamped {
    /// A pose at `stamp`.
    #[cfg(test)]
    pub(crate) fn new(stamp: (i32, u32), pose: ([f64; 3], [f64; 4])) -> Self {
        Self { header: Header { stamp, _frame_id: "world".into() }, pose }
    }

    /// Time of the measurement since 1970. s
    pub(crate) fn stamp_s(&self) -> f64 {
        let (seconds, nanoseconds) = self.header.stamp;
        f64::from(seconds) + f64::from(nanoseconds) * 1e-9
    }
}

/// A participant.
pub(crate) struct Node(DomainParticipant);

/// Messages that are bytes already, as they are in a file.
pub(crate) struct Encoded;

impl SerializerAdapter<Vec<u8>> for Encoded {
    type Error = std::io::Error;

    fn output_encoding() -> RepresentationIdentifier {
        RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(message: &Vec<u8>) -> Result<Bytes, Self::Error> {
        Ok(Bytes::copy_from_slice(message.get(HEAD_BYTES..).unwrap_or_default()))
    }
}

impl Node {
    /// Joins `network` as a participant.
    ///
    /// # Errors
    /// No sockets, no threads.
    pub(crate) fn join(network: Network) -> Result<Self> {
        let builder = DomainParticipantBuilder::new(network.ros2_domain);
        Ok(Self(builder.with_only_networks([network.ros2_interface]).build()?))
    }

    /// The writer of a topic, which sends each reader all of its messages.
    ///
    /// # Errors
    /// The library refuses a topic, publisher or writer.
    pub(crate) fn writer(&self, topic: RosTopic) -> Result<DataWriter<Vec<u8>, Encoded>> {
        let max_blocking_time = Duration::from_millis(100);
        let qos = quality(Reliability::Reliable { max_blocking_time }, KEPT);
        let named = self.topic(topic.name(), topic.kind(), &qos)?;
        Ok(self.0.create_publisher(&qos)?.create_datawriter_no_key(&named, Some(qos.clone()))?)
    }

    /// The newest messages that others publish, reliably or not.
    ///
    /// # Errors
    /// The library refuses a topic, subscriber or reader.
    pub(crate) fn reader<T: DeserializeOwned + 'static>(
        &self,
        name: &str,
        kind: Kind,
    ) -> Result<BareDataReaderStream<T, CDRDeserializerAdapter<T>>> {
        let qos = quality(Reliability::BestEffort, UNREAD);
        let named = self.topic(name, kind, &qos)?;
        let reader =
            self.0.create_subscriber(&qos)?.create_datareader_no_key(&named, Some(qos.clone()))?;
        Ok(reader.async_bare_sample_stream())
    }

    /// `/tf` of `tf2_msgs/msg/TFMessage` is `rt/tf` of `tf2_msgs::msg::dds_::TFMessage_` in DDS.
    fn topic(&self, name: &str, kind: Kind, qos: &QosPolicies) -> Result<Topic> {
        let (package, message) = kind.name().rsplit_once('/').unwrap_or(("", kind.name()));
        let kind = format!("{}::dds_::{message}_", package.replace('/', "::"));
        let name = format!("rt/{}", name.trim_start_matches('/'));
        Ok(self.0.create_topic(name, kind, qos, TopicKind::NoKey)?)
    }
}

fn quality(reliability: Reliability, depth: i32) -> QosPolicies {
    QosPolicyBuilder::new()
        .reliability(reliability)
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth })
        .build()
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use futures_util::StreamExt;
    use tello_eval::ros2;
    use tokio::time::timeout;

    use super::*;

    /// What a log has of a pose, as messages of ROS 2, is read back by another participant.
    #[tokio::test]
    async fn a_pose_of_the_log_arrives_at_another_participant() {
        // A domain that nobody else uses.
        let network = Network { ros2_interface: Ipv4Addr::LOCALHOST.into(), ros2_domain: 117 };
        let (ours, theirs) = (Node::join(network).unwrap(), Node::join(network).unwrap());
        let record = br#"{"t_ns":5,"x":1.0,"y":-2.0,"z":1.5,"theta":0.0}"#;
        let (topic, message) = ros2::sources()
            .into_iter()
            .find_map(|source| {
                let messages = ros2::messages(source, 7_250_000_000, record).ok()?;
                messages.into_iter().find(|(topic, _)| topic.kind() == Kind::Pose)
            })
            .unwrap();
        let writer = ours.writer(topic).unwrap();
        let mut poses = theirs.reader::<PoseStamped>(topic.name(), topic.kind()).unwrap();
        let read = async {
            loop {
                // Until they have found each other.
                writer.write(message.clone(), None).unwrap();
                if let Ok(Some(pose)) = timeout(Duration::from_millis(200), poses.next()).await {
                    return pose.unwrap();
                }
            }
        };
        let pose = timeout(Duration::from_secs(20), read).await.unwrap();
        assert_eq!(pose.pose.0.map(f64::to_bits), [1.0, -2.0, 1.5].map(f64::to_bits));
        assert!((pose.stamp_s() - 7.25).abs() < 1e-9, "{}", pose.stamp_s());
    }
}
