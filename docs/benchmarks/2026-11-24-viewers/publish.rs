//! Publishes the payloads of a file (u32 length, CDR with its head) over and over: FILE COUNT RATE_HZ.
use std::thread;
use std::time::{Duration, Instant};

use rustdds::bytes::Bytes;
use rustdds::no_key::SerializerAdapter;
use rustdds::policy::{Durability, History, Reliability};
use rustdds::{DomainParticipantBuilder, QosPolicyBuilder, RepresentationIdentifier, TopicKind};

struct Raw;

impl SerializerAdapter<Bytes> for Raw {
    type Error = std::io::Error;
    fn output_encoding() -> RepresentationIdentifier {
        RepresentationIdentifier::CDR_LE
    }
    fn to_bytes(value: &Bytes) -> Result<Bytes, Self::Error> {
        Ok(value.clone())
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let file = std::fs::read(&arguments[1]).expect("a measurement");
    let count: usize = arguments[2].parse().expect("a measurement");
    let period = Duration::from_secs_f64(1.0 / arguments[3].parse::<f64>().expect("a measurement"));
    let depth: i32 = arguments[4].parse().expect("a measurement");
    let mut payloads = Vec::new();
    let mut rest = Bytes::from(file);
    while rest.len() > 4 {
        let length = u32::from_le_bytes(rest.split_to(4)[..].try_into().expect("a measurement")) as usize;
        payloads.push(rest.split_to(length).slice(4..));
    }
    let participant = DomainParticipantBuilder::new(0).with_only_networks([std::net::IpAddr::from([127, 0, 0, 1])]).build().expect("a measurement");
    let qos = QosPolicyBuilder::new()
        .reliability(Reliability::Reliable { max_blocking_time: rustdds::Duration::from_secs(1) })
        .durability(Durability::Volatile)
        .history(if depth == 0 { History::KeepAll } else { History::KeepLast { depth } })
        .build();
    let topic = participant
        .create_topic(
            "rt/tello/pose".into(),
            "geometry_msgs::msg::dds_::PoseStamped_".into(),
            &qos,
            TopicKind::NoKey,
        )
        .expect("a measurement");
    let publisher = participant.create_publisher(&qos).expect("a measurement");
    let writer =
        publisher.create_datawriter_no_key::<Bytes, Raw>(&topic, Some(qos.clone())).expect("a measurement");
    thread::sleep(Duration::from_secs(6));
    let began = Instant::now();
    let mut worst = Duration::ZERO;
    let mut sum = Duration::ZERO;
    let mut failed = 0;
    for i in 0..count {
        let due = began + period * i as u32;
        let now = Instant::now();
        if due > now {
            thread::sleep(due - now);
        }
        let before = Instant::now();
        if writer.write(payloads[i % payloads.len()].clone(), None).is_err() {
            failed += 1;
        }
        let took = before.elapsed();
        worst = worst.max(took);
        sum += took;
    }
    println!("{count} sent in {:?}, {failed} failed, mean {:?}, worst {worst:?}", began.elapsed(), sum / count as u32);
    let acknowledged = writer.wait_for_acknowledgments(Duration::from_secs(10));
    println!("acknowledged: {acknowledged:?}");
    thread::sleep(Duration::from_secs(2));
}
