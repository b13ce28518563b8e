//! Our NatNet, QTM and VRPN servers in the hands of clients that we did not write, and of ours: all read one pose.
//!
//! NatNet by the Python packages `motioncapture` (multicast) and `natnet` (multicast, unicast), QTM by Qualisys' own
//! `qtm_rt`, VRPN by the library of VRPN in `motioncapture`.

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, TcpListener, UdpSocket};
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use horizon_model::check::maximum;
use serde_json::{Value, json};
use tello_io::clock::Clock;
use tello_io::mocap::natnet::packet::Version;
use tello_io::mocap::{
    Body, MocapSettings, MocapTable, matrix_of_angles, quaternion_of_matrix, survey,
};
use tello_sim::mocap::MocapFrame;
use tello_sim::{MocapAddresses, MocapServers, NatnetServer};

use crate::python;

const OBJECT: &str = "tello";

/// Where the body is. m, rad
const BODY: Body<'static> =
    Body { name: OBJECT.as_bytes(), pos_v: [1.0, -2.0, 1.3], angles: [0.1, 0.2, 0.3] };

/// A second one.
const OTHER: Body<'static> =
    Body { name: b"passer", pos_v: [-0.5, 0.7, 1.1], angles: [0.0, 0.0, -1.0] };

/// Numbers of single precision and of one client more may differ by so much. m, 1
const SAME: f64 = 1e-6;

const LOCAL: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 0);

/// Position and quaternion.
#[derive(Debug)]
struct Read {
    position: Vec<f64>,
    quaternion: Vec<f64>,
}

impl Read {
    /// Largest difference; a quaternion and its negative are the same rotation.
    fn gap(&self, other: &Self) -> f64 {
        let of = |a: &[f64], b: &[f64], sign: f64| {
            assert_eq!(a.len(), b.len());
            a.iter().zip(b).map(|(a, b)| (a - sign * b).abs()).fold(0.0, maximum)
        };
        let turn = |sign| of(&self.quaternion, &other.quaternion, sign);
        let (same, opposite) = (turn(1.0), turn(-1.0));
        // Each is NaN if the other is.
        maximum(of(&self.position, &other.position, 1.0), same.min(opposite))
    }
}

/// The place that the servers send.
fn truth(body: &Body<'_>) -> Read {
    let quaternion = quaternion_of_matrix(&matrix_of_angles(body.angles)).to_vec();
    Read { position: body.pos_v.to_vec(), quaternion }
}

/// Frames that the foreign client reads.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn foreign(
    python: &std::ffi::OsStr,
    client: &str,
    address: SocketAddr,
    group: Option<SocketAddrV4>,
) -> Read {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/mocap_foreign.py");
    let mut command = Command::new(python);
    command.arg(script).args([
        client,
        &address.ip().to_string(),
        &address.port().to_string(),
        OBJECT,
    ]);
    if let Some(group) = group {
        command.args([group.ip().to_string(), group.port().to_string()]);
    }
    let output = command.output().unwrap();
    let stdout = String::from_utf8_lossy(&output.stdout);
    let line = stdout.lines().find(|line| line.starts_with('{'));
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && line.is_some(), "{client}: {stdout}{complaint}");
    let value: Value = serde_json::from_str(line.unwrap()).unwrap();
    let numbers = |key: &str| serde_json::from_value(value[key].clone()).unwrap();
    Read { position: numbers("position"), quaternion: numbers("quaternion") }
}

/// Frames of `objects` that the client of this program reads.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn ours<const N: usize>(mocap: &Value, objects: [&str; N]) -> [Read; N] {
    let table: MocapTable = serde_json::from_value(mocap.clone()).unwrap();
    let settings = MocapSettings::try_from(&table).unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let duration = Duration::from_secs(3);
    let survey = runtime.block_on(async {
        survey(&settings, Clock::start(), tokio::time::sleep(duration), |_, _| ()).await
    });
    objects.map(|object| {
        let [_, newest] = survey.objects.get(object).and_then(|track| track.places).unwrap();
        let (pos_w, matrix) = settings.axes().place(&newest);
        Read { position: pos_w.to_vec(), quaternion: quaternion_of_matrix(&matrix).to_vec() }
    })
}

/// Serves at 100 Hz while `read` reads.
fn serve(asked: MocapAddresses, read: impl FnOnce(MocapAddresses)) {
    serve_with(asked, None, read);
}

/// The same with a second object.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn serve_with(
    asked: MocapAddresses,
    other: Option<Body<'static>>,
    read: impl FnOnce(MocapAddresses),
) {
    let mut servers = MocapServers::bind(asked).unwrap();
    let addresses = servers.addresses();
    let is_over = Arc::new(AtomicBool::new(false));
    let server = {
        let is_over = Arc::clone(&is_over);
        thread::spawn(move || {
            for number in 0.. {
                if is_over.load(Ordering::Relaxed) {
                    return;
                }
                let frame = MocapFrame { number, rate_hz: 100.0, object: OBJECT, body: Some(BODY) };
                servers.push_with(Some(frame), other);
                thread::sleep(Duration::from_millis(10));
            }
        })
    };
    read(addresses);
    is_over.store(true, Ordering::Relaxed);
    server.join().unwrap();
}

/// Compares a foreign client, ours and the truth.
fn assert_same(client: &str, theirs: &Read, mocap: &Value) {
    let [ours] = ours(mocap, [OBJECT]);
    for (what, gap) in [
        ("ours and theirs", ours.gap(theirs)),
        ("ours and the truth", ours.gap(&truth(&BODY))),
        ("theirs and the truth", theirs.gap(&truth(&BODY))),
    ] {
        assert!(gap < SAME, "{client}: {what} differ by {gap}");
    }
}

/// A group of this machine with a port that nobody uses.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn group() -> SocketAddrV4 {
    let port = UdpSocket::bind(LOCAL).unwrap().local_addr().unwrap().port();
    SocketAddrV4::new(Ipv4Addr::new(239, 255, 42, 99), port)
}

/// NatNet of each version by a client.
fn natnet(package: &str, client: &str, versions: &[(u8, u8)], group: Option<SocketAddrV4>) {
    let Some(python) = python::with(package) else { return };
    for &(major, minor) in versions {
        let version = Version { major, minor };
        let server = NatnetServer { address: LOCAL, group, version };
        let asked = MocapAddresses { natnet: Some(server), ..MocapAddresses::default() };
        serve(asked, |addresses| {
            let Some(NatnetServer { address, .. }) = addresses.natnet else { return };
            let mocap = json!({ "natnet": { "address": address.to_string(), "object": OBJECT } });
            let name = format!("{client} {major}.{minor}");
            assert_same(&name, &foreign(&python, client, address, group), &mocap);
        });
    }
}

#[test]
fn motioncapture_reads_our_natnet_by_multicast() {
    natnet("motioncapture", "optitrack", &[(3, 0), (3, 1), (4, 0), (4, 1)], Some(group()));
}

#[test]
fn natnet_reads_ours_by_multicast() {
    natnet("natnet", "natnet", &[(3, 0), (4, 0), (4, 1), (4, 2)], Some(group()));
}

#[test]
fn natnet_reads_ours_by_unicast() {
    natnet("natnet", "natnet", &[(3, 1), (4, 1)], None);
}

#[test]
fn qualisys_own_client_reads_our_qtm() {
    let Some(python) = python::with("qtm_rt") else { return };
    let asked = MocapAddresses { qtm: Some(LOCAL), ..MocapAddresses::default() };
    serve(asked, |addresses| {
        let Some(address) = addresses.qtm else { return };
        let mocap = json!({ "qtm": { "address": address.to_string(), "object": OBJECT } });
        assert_same("qtm_rt", &foreign(&python, "qtm", address, None), &mocap);
    });
}

#[test]
fn vrpns_own_client_reads_our_vrpn() {
    let Some(python) = python::with("motioncapture") else { return };
    let asked = MocapAddresses { vrpn: Some(LOCAL), ..MocapAddresses::default() };
    serve(asked, |addresses| {
        let Some(address) = addresses.vrpn else { return };
        let mocap = json!({ "vrpn": { "address": address.to_string(), "object": OBJECT, "rate_hz": 100.0 } });
        assert_same("vrpn", &foreign(&python, "vrpn", address, None), &mocap);
    });
}

#[test]
fn a_second_object_is_seen_over_each_source() {
    let target = UdpSocket::bind(LOCAL).unwrap().local_addr().unwrap();
    let version = Version { major: 4, minor: 1 };
    let asked = MocapAddresses {
        datastream: Some(LOCAL),
        udp_target: Some(target),
        natnet: Some(NatnetServer { address: LOCAL, group: None, version }),
        qtm: Some(LOCAL),
        vrpn: Some(LOCAL),
        ..MocapAddresses::default()
    };
    serve_with(asked, Some(OTHER), |at| {
        let natnet = at.natnet.unwrap().address.to_string();
        let [datastream, qtm, vrpn] =
            [at.datastream, at.qtm, at.vrpn].map(|at| at.unwrap().to_string());
        for mocap in [
            json!({ "datastream": { "address": datastream, "object": OBJECT } }),
            json!({ "udp": { "listen": target.to_string(), "object": OBJECT, "rate_hz": 100.0 } }),
            json!({ "natnet": { "address": natnet, "object": OBJECT } }),
            json!({ "qtm": { "address": qtm, "object": OBJECT } }),
            json!({ "vrpn": { "address": vrpn, "object": OBJECT, "rate_hz": 100.0 } }),
        ] {
            for (read, body) in ours(&mocap, [OBJECT, "passer"]).iter().zip([BODY, OTHER]) {
                let gap = read.gap(&truth(&body));
                assert!(gap < SAME, "{mocap}: {body:?} is off by {gap}");
            }
        }
    });
}

/// Serves [`BODY`] at 100 Hz by the function of the document.
const DRIVER: &str = "
import itertools, sys, time
def poses():
    for frame in itertools.count():
        yield frame, *map(float, sys.argv[2:])
        time.sleep(0.01)
serve(poses, 100, port=int(sys.argv[1]))
";

#[test]
fn the_server_of_relay_lines_in_the_document_is_read() {
    let Some(python) = python::with("socket") else { return };
    let document = include_str!("../docs/protocol.md");
    let (_, code) = document.split_once("```python\n").unwrap();
    let (code, _) = code.split_once("```").unwrap();
    let address = TcpListener::bind(LOCAL).unwrap().local_addr().unwrap();
    let truth = truth(&BODY);
    let numbers = truth.position.iter().chain(&truth.quaternion).map(f64::to_string);
    let mut command = Command::new(python);
    command.arg("-c").arg(format!("{code}{DRIVER}")).arg(address.port().to_string()).args(numbers);
    let mut server = command.spawn().unwrap();
    let mocap = json!({ "relay": { "address": address.to_string(), "object": OBJECT } });
    let [read] = ours(&mocap, [OBJECT]);
    server.kill().unwrap();
    server.wait().unwrap();
    let gap = read.gap(&truth);
    assert!(gap < SAME, "{gap}");
}
