//! `tello-ctl mocap ros2`: a pose topic of ROS 2 as a mocap source.
//!
//! Owns the way from the topic to lines of the relay. A process of its own: whatever becomes of ROS 2, a flight sees a
//! relay that falls silent.

use std::io;

use anyhow::{Context, Result};
use clap::Args;
use futures_util::StreamExt;
use tello_eval::ros2::Kind;
use tokio::io::AsyncWriteExt;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::broadcast;

use crate::ros2::{Network, Node, PoseStamped};
use crate::{Verdict, stdio};

/// Lines that wait for a client; of a slow one the oldest are lost.
const LINES: usize = 64;

/// Serve the poses of a ROS 2 topic (`geometry_msgs/PoseStamped`) as a relay, until Ctrl-C.
///
/// A flight reads it with `"mocap": { "relay": { "address": "127.0.0.1:51602", "object": "tello" } }`. Poses in
/// metres, z up, the object's x axis ahead, as REP 103 wants it. Needs no ROS installation.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Topic, such as `/tello/pose`.
    topic: String,
    /// Rate of the topic. Hz
    #[arg(long, value_name = "HZ")]
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

pub(super) async fn run(arguments: &Arguments) -> Result<Verdict> {
    let Arguments { topic, rate_hz, object, listen, network } = arguments;
    let listener = TcpListener::bind(listen).await.with_context(|| format!("listen {listen}"))?;
    let node = Node::join(*network)?;
    let mut poses = node.reader::<PoseStamped>(topic, Kind::Pose)?;
    let (lines, _) = broadcast::channel(LINES);
    stdio::note(format_args!("{topic} at --source relay={listen}"));
    let mut counts = [0_u64; 2];
    loop {
        tokio::select! {
            accepted = listener.accept() => {
                let (client, _) = accepted?;
                client.set_nodelay(true)?;
                // It ends with its client.
                drop(tokio::spawn(serve(client, lines.subscribe())));
            }
            pose = poses.next() => {
                let [read, refused] = &mut counts;
                match pose.with_context(|| format!("{topic}: no more poses come"))? {
                    Ok(pose) => {
                        *read += 1;
                        // An error: there is no client.
                        drop(lines.send(line(&pose, *rate_hz, object)));
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

/// A line of the relay. There are no frame numbers: times in periods are numbers that keep pace with time.
fn line(pose: &PoseStamped, rate_hz: f64, object: &str) -> String {
    let ([x, y, z], [qx, qy, qz, qw]) = pose.pose;
    let number = (pose.stamp_s() * rate_hz).round();
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
        let of = |stamp| line(&pose(stamp), 100.0, "tello");
        let text = of((7, 250_000_000));
        assert_eq!(text, "725 100 tello 0 1 -2 1.5 0 0 0.6 0.8\n");
        assert_eq!(of((7, 259_600_000)).split(' ').next(), Some("726"));
        let read = parse_line(text.trim_end().as_bytes()).unwrap();
        assert_eq!(read.object, "tello");
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
