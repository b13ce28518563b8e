//! `tello-ctl mocap ros2`: a pose topic of ROS 2 as a mocap source.
//!
//! Owns the way from the topic to lines of the relay. A process of its own: whatever becomes of ROS 2, a flight sees a
//! relay that falls silent.

use std::io;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use clap::Args;
use futures_util::StreamExt;
use tello_eval::ros2::Kind;
use tello_io::mocap::StampNumbers;
use tokio::io::AsyncWriteExt;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::broadcast;

use crate::ros2::{Network, Node, PoseStamped};
use crate::{Verdict, stdio};

/// Lines that wait for a client; of a slow one the oldest are lost.
const LINES: usize = 64;

/// Between a client that was not accepted and the next one.
const ACCEPT_AGAIN: Duration = Duration::from_millis(200);

/// Serve the poses of a ROS 2 topic (`geometry_msgs/PoseStamped`) as a relay, until Ctrl-C.
///
/// A flight reads it with `"mocap": { "relay": { "address": "127.0.0.1:51602", "object": "tello" } }`. Poses in
/// metres, z up, the object's x axis ahead, as REP 103 wants it. Needs no ROS installation.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Topic, such as `/tello/pose`.
    topic: String,
    /// Rate of the topic. Hz, 4 to 1000
    #[arg(long, value_name = "HZ", value_parser = rate_hz)]
    rate_hz: f64,
    /// Name of the object in the relay's lines.
    #[arg(long, value_name = "NAME", default_value = "tello")]
    object: String,
    /// Where clients connect to.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:51602")]
    listen: String,
    #[command(flatten)]
    network: Network,
}

/// As [`Arguments::rate_hz`] has to be.
fn rate_hz(text: &str) -> Result<f64> {
    let rate_hz = text.parse()?;
    ensure!((4.0..=1000.0).contains(&rate_hz), "expected 4 to 1000 Hz");
    Ok(rate_hz)
}

pub(super) async fn run(arguments: &Arguments) -> Result<Verdict> {
    let Arguments { topic, rate_hz, object, listen, network } = arguments;
    let listener = TcpListener::bind(listen).await.with_context(|| {
        format!("cannot listen at {listen}: is the port in use? Choose another --listen")
    })?;
    let node = Node::join(*network)?;
    let mut poses = node.reader::<PoseStamped>(topic, Kind::Pose)?;
    let (lines, _) = broadcast::channel(LINES);
    drop(tokio::spawn(accept(listener, lines.clone())));
    stdio::note(format_args!("{topic} at --source relay={listen}"));
    let (mut counts, mut numbers) = ([0_u64; 2], StampNumbers::default());
    loop {
        tokio::select! {
            pose = poses.next() => {
                let [read, refused] = &mut counts;
                match pose.with_context(|| format!("{topic}: the subscription ended"))? {
                    Ok(pose) => {
                        *read += 1;
                        // An error: there is no client.
                        drop(lines.send(line(&pose, &mut numbers, *rate_hz, object)));
                    }
                    Err(_) => *refused += 1,
                }
            }
            end = tokio::signal::ctrl_c() => {
                end?;
                let [read, refused] = counts;
                stdio::line(format_args!("{read} poses, {refused} refused"))?;
                return Ok(Verdict::Good);
            }
        }
    }
}

/// Lets clients in, beside the relay of poses.
async fn accept(listener: TcpListener, lines: broadcast::Sender<String>) {
    loop {
        let accepted = listener.accept().await;
        match accepted.and_then(|(client, _)| client.set_nodelay(true).map(|()| client)) {
            // It ends with its client.
            Ok(client) => drop(tokio::spawn(serve(client, lines.subscribe()))),
            // The reason, such as too many open files, lasts.
            Err(error) => {
                stdio::note(format_args!("no client: {error}"));
                tokio::time::sleep(ACCEPT_AGAIN).await;
            }
        }
    }
}

/// A line of the relay. There are no frame numbers.
fn line(pose: &PoseStamped, numbers: &mut StampNumbers, rate_hz: f64, object: &str) -> String {
    let ([x, y, z], [qx, qy, qz, qw]) = pose.pose;
    let number = numbers.number(pose.stamp_s(), rate_hz);
    format!("{number} {rate_hz} {object} 0 {x} {y} {z} {qx} {qy} {qz} {qw}\n")
}

/// Sends a client all lines that it has time for.
async fn serve(mut client: TcpStream, mut lines: broadcast::Receiver<String>) -> io::Result<()> {
    loop {
        match lines.recv().await {
            Ok(line) => client.write_all(line.as_bytes()).await?,
            Err(broadcast::error::RecvError::Lagged(_)) => {}
            Err(broadcast::error::RecvError::Closed) => return Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use tello_io::mocap::parse_line;

    use super::*;

    #[test]
    fn a_line_is_that_of_the_relay_and_its_number_keeps_pace_with_time() {
        let pose = |stamp| PoseStamped::new(stamp, ([1.0, -2.0, 1.5], [0.0, 0.0, 0.6, 0.8]));
        let mut numbers = StampNumbers::default();
        let mut of = |stamp| line(&pose(stamp), &mut numbers, 100.0, "tello");
        let text = of((7, 250_000_000));
        assert_eq!(text, "725 100 tello 0 1 -2 1.5 0 0 0.6 0.8\n");
        assert_eq!(of((7, 259_600_000)).split(' ').next(), Some("726"));
        let read = parse_line(text.trim_end().as_bytes()).unwrap();
        assert_eq!(read.object, "tello");
    }

    #[test]
    fn a_rate_that_numbers_no_frames_is_refused() {
        assert!((rate_hz("50").unwrap() - 50.0).abs() < 1e-12);
        for wrong in ["0", "-50", "nan", "inf", "fast"] {
            assert!(rate_hz(wrong).is_err(), "{wrong}");
        }
    }

    #[tokio::test]
    async fn a_client_that_is_late_gets_the_newest_lines_and_the_end() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let (lines, unread) = broadcast::channel(2);
        for number in 0..5 {
            lines.send(format!("{number}\n")).unwrap();
        }
        let client = TcpStream::connect(listener.local_addr().unwrap()).await.unwrap();
        let (server, _) = listener.accept().await.unwrap();
        drop(lines);
        serve(server, unread).await.unwrap();
        let mut text = String::new();
        tokio::io::AsyncReadExt::read_to_string(&mut { client }, &mut text).await.unwrap();
        assert_eq!(text, "3\n4\n");
    }
}
