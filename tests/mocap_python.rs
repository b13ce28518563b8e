//! Our DataStream server in the hands of a client that we did not write: the Python package
//! `motioncapture`, which contains Vicon's own.

use std::io::{BufRead, BufReader, Lines};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::process::{ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use horizon_model::check::maximum;
use serde_json::Value;
use tello_io::mocap::Body;
use tello_sim::mocap::MocapFrame;
use tello_sim::{MocapAddresses, MocapServers};

use crate::python;

const OBJECT: &str = "tello";

/// Where the body is. m, rad
const BODY: Body<'static> =
    Body { name: OBJECT.as_bytes(), pos_v: [1.0, -2.0, 1.3], angles: [0.1, 0.2, 0.3] };

/// Quaternion x y z w of these angles, by Vicon's program.
const QUATERNION: [f64; 4] = [0.0641, 0.0912, 0.1534, 0.9819];

/// Sends the body at 100 Hz, or leaves it out, until it is stopped.
fn serve(mut servers: MocapServers, is_seen: &AtomicBool, is_over: &AtomicBool) {
    for number in 0.. {
        if is_over.load(Ordering::Relaxed) {
            return;
        }
        let body = is_seen.load(Ordering::Relaxed).then_some(BODY);
        servers.push(Some(MocapFrame { number, rate_hz: 100.0, object: OBJECT, body }));
        thread::sleep(Duration::from_millis(10));
    }
}

#[expect(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]
fn next(lines: &mut Lines<BufReader<ChildStdout>>) -> Value {
    let line = lines.next().expect("the client ended").unwrap();
    serde_json::from_str(&line).unwrap()
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

#[test]
fn vicons_own_client_reads_metres_a_quaternion_and_an_occlusion() {
    let Some(python) = python::with("motioncapture") else { return };
    let any_port = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let asked = MocapAddresses { datastream: Some(any_port), ..MocapAddresses::default() };
    let servers = MocapServers::bind(asked).unwrap();
    let address = servers.addresses().datastream.unwrap().to_string();
    let [is_seen, is_over] = [true, false].map(|value| Arc::new(AtomicBool::new(value)));
    let server = {
        let (is_seen, is_over) = (Arc::clone(&is_seen), Arc::clone(&is_over));
        thread::spawn(move || serve(servers, &is_seen, &is_over))
    };

    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/mocap_python.py");
    let mut client = Command::new(python)
        .arg(script)
        .args([&address, OBJECT])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(client.stdout.take().unwrap()).lines();
    let seen = next(&mut lines);
    is_seen.store(false, Ordering::Relaxed);
    let lost = next(&mut lines);
    assert!(client.wait().unwrap().success());
    is_over.store(true, Ordering::Relaxed);
    server.join().unwrap();

    let gap = |value: &Value, expected: &[f64]| {
        let numbers = numbers(value);
        assert_eq!(numbers.len(), expected.len(), "{value}");
        numbers.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, maximum)
    };
    assert!(gap(&seen["position"], &BODY.pos_v) < 1e-6, "{seen}");
    assert!(gap(&seen["quaternion"], &QUATERNION) < 1e-4, "{seen}");
    assert_eq!(lost, serde_json::json!({ "lost": OBJECT, "others": [] }));
}
