use horizon_model::check::amax;
use horizon_model::rows::Pose;
use proptest::prelude::*;

use super::packet::RigidBody;
use super::*;
use crate::mocap::axes::{Axes, Unit};
use crate::mocap::protocol::Picked;
use crate::mocap::source::{Frame, Source};
use crate::mocap::{matrix_of_angles, quaternion_of_matrix};

const VERSIONS: [(u8, u8); 5] = [(3, 0), (3, 1), (4, 0), (4, 1), (4, 2)];

const TICKS: u64 = 1_000_000;

fn version((major, minor): (u8, u8)) -> Version {
    Version { major, minor }
}

fn server(of: (u8, u8)) -> Vec<u8> {
    let mut bytes = Vec::new();
    let server = ServerInfo { version: version(of), ticks_per_s: TICKS, group: None };
    encode::server_info(&server, "Motive", &mut bytes);
    bytes
}

fn models(of: (u8, u8), bodies: &[(i32, &str)]) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode::model_definitions(version(of), bodies, &mut bytes);
    bytes
}

fn rate(rate_hz: f32) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode::response(rate_hz, &mut bytes);
    bytes
}

fn rigid(id: i32, x: f64) -> RigidBody {
    let quaternion = quaternion_of_matrix(&matrix_of_angles([0.0, 0.0, 0.5]));
    RigidBody { id, pos: [x, -2.0, 1.5], quaternion, is_tracked: true }
}

fn end() -> FrameEnd {
    FrameEnd {
        timestamp_s: 1.0,
        exposed: 5000,
        received: 7000,
        transmitted: 9000,
        has_new_models: false,
    }
}

fn frame(of: (u8, u8), number: i32, bodies: &[RigidBody]) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode::frame(version(of), number, bodies, &end(), &mut bytes);
    bytes
}

fn source(object: &str) -> Picked {
    let axes = Axes::new(None, Unit::Metre).unwrap();
    Picked::new(Box::new(NatnetProtocol::new(None)), object, axes)
}

/// What a source makes of the datagrams: its frames, and the counters.
fn read(source: &mut Picked, datagrams: &[Vec<u8>]) -> (Vec<Frame>, MocapCounters) {
    let counters = MocapCounters::default();
    let mut frames = Vec::new();
    for datagram in datagrams {
        source.push(datagram, &counters, &mut |frame| frames.push(frame)).unwrap();
    }
    (frames, counters)
}

/// Kinds of what the source asks.
fn asked(source: &mut Picked) -> Vec<u16> {
    let mut bytes = Vec::new();
    source.take_requests(&mut bytes);
    let (mut rest, mut kinds) = (bytes.as_slice(), Vec::new());
    while let Some(length) = packet::datagram_length(rest) {
        kinds.push(packet::message(&rest[..length]).unwrap().0);
        rest = &rest[length..];
    }
    assert!(rest.is_empty());
    kinds
}

/// Frame 1000 of protocol 3.0 with one rigid body, 7 at 1, 2, 3, level, seen; exposed at 5 ms, sent at 9 ms.
const FRAME_3_0: [u8; 120] = *b"\x07\x00\x74\x00\xe8\x03\x00\x00\
    \x00\x00\x00\x00\x00\x00\x00\x00\x01\x00\x00\x00\
    \x07\x00\x00\x00\x00\x00\x80\x3f\x00\x00\x00\x40\x00\x00\x40\x40\
    \x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x80\x3f\x00\x00\x00\x00\x01\x00\
    \x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\
    \x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\xf0\x3f\
    \x88\x13\x00\x00\x00\x00\x00\x00\x58\x1b\x00\x00\x00\x00\x00\x00\x28\x23\x00\x00\x00\x00\x00\x00\
    \x00\x00\x00\x00\x00\x00";

#[test]
fn the_documented_frame_is_read_and_written_byte_by_byte() {
    let quaternion = [0.0, 0.0, 0.0, 1.0];
    let body = RigidBody { id: 7, pos: [1.0, 2.0, 3.0], quaternion, is_tracked: true };
    assert_eq!(frame((3, 0), 1000, &[body]), FRAME_3_0);
    let (kind, content) = packet::message(&FRAME_3_0).unwrap();
    let mut bodies = Vec::new();
    let read = packet::frame(content, version((3, 0)), |body| bodies.push(body));
    assert_eq!((kind, read), (id::FRAMEOFDATA, Some((1000, Some(end())))));
    assert_eq!(bodies, [body]);
}

#[test]
fn every_version_gives_pose_rate_and_age() {
    for of in VERSIONS {
        let mut source = source("tello");
        source.beat();
        assert_eq!(asked(&mut source), [id::CONNECT]);
        let (none, _) = read(&mut source, &[frame(of, 1, &[rigid(7, 1.0)]), server(of)]);
        assert!(none.is_empty(), "before the version is known nothing is read");
        assert_eq!(asked(&mut source), [id::REQUEST_MODELDEF, id::REQUEST]);
        let names = models(of, &[(3, "wand"), (7, "tello")]);
        let bodies = [rigid(3, 9.0), rigid(7, 1.0)];
        let datagrams = [rate(120.0), names, frame(of, 2, &bodies)];
        let (frames, counters) = read(&mut source, &datagrams);
        let [frame] = *frames else { panic!("{of:?}: {frames:?}") };
        assert_eq!((frame.number, frame.rate_hz, frame.latency), (2, 120.0, SpanNs::from_ms(4)));
        let gap = frame.pose.unwrap() - Pose::new(1.0, -2.0, 1.5, 0.5);
        assert!(amax(&gap) < 1e-6, "{of:?}: {gap}");
        assert_eq!(counters.malformed.get(), 0, "{of:?}");
        // As long as frames come nothing but that the client is there.
        source.beat();
        assert_eq!(asked(&mut source), [id::KEEPALIVE]);
        source.beat();
        assert_eq!(asked(&mut source), [id::CONNECT, id::KEEPALIVE]);
    }
}

#[test]
fn what_stands_before_and_behind_the_rigid_bodies_is_skipped() {
    // Protocol 3.0 with a marker set, other markers, a skeleton, a labeled marker, a force plate, a device.
    let mut content = FRAME_3_0[4..8].to_vec();
    content.extend(b"\x01\0\0\0all\0\x02\0\0\0");
    content.extend([1; 24]);
    content.extend(b"\x01\0\0\0");
    content.extend([1; 12]);
    content.extend(&FRAME_3_0[16..58]);
    content.extend(b"\x01\0\0\0\x09\0\0\0\x01\0\0\0");
    content.extend([1; 38]);
    content.extend(b"\x01\0\0\0");
    content.extend([1; 26]);
    for _ in 0..2 {
        content.extend(b"\x01\0\0\0\x05\0\0\0\x01\0\0\0\x02\0\0\0");
        content.extend([1; 8]);
    }
    content.extend(&FRAME_3_0[74..]);
    let mut bodies = Vec::new();
    let read = packet::frame(&content, version((3, 0)), |body| bodies.push(body.id));
    assert_eq!((read, bodies), (Some((1000, Some(end()))), vec![7]));
}

#[test]
fn names_stand_among_other_descriptions() {
    // Protocol 4.0: a marker set, a skeleton with one bone, a rigid body with one marker, a device.
    let bone = |name: &[u8], id: u8| {
        let mut bytes = [name, &[0, id, 0, 0, 0]].concat();
        bytes.extend([0; 16]);
        bytes.extend(b"\x01\0\0\0");
        bytes.extend([0; 16]);
        bytes.extend(b"marker\0");
        bytes
    };
    let mut content =
        b"\x04\0\0\0\0\0\0\0all\0\x01\0\0\0a\0\x02\0\0\0man\0\x09\0\0\0\x01\0\0\0".to_vec();
    content.extend(bone(b"hip", 1));
    content.extend(b"\x01\0\0\0");
    content.extend(bone(b"tello", 7));
    content.extend(b"\x04\0\0\0whatever");
    let mut names = Vec::new();
    let result = packet::rigid_body_names(&content, version((4, 0)), |id, name| {
        names.push((id, String::from_utf8_lossy(name).into_owned()));
    });
    assert_eq!((result, names), (Some(()), vec![(7, "tello".to_owned())]));
}

#[test]
fn a_body_that_is_not_tracked_or_not_there_is_a_frame_without_a_pose() {
    let lost = RigidBody { is_tracked: false, ..rigid(7, 1.0) };
    let nan = RigidBody { pos: [f64::NAN; 3], ..rigid(7, 1.0) };
    for bodies in [vec![lost], vec![nan], vec![rigid(3, 1.0)], vec![]] {
        let mut source = source("tello");
        let names = models((4, 1), &[(3, "wand"), (7, "tello")]);
        let (frames, counters) =
            read(&mut source, &[server((4, 1)), names, frame((4, 1), 9, &bodies)]);
        assert!(matches!(*frames, [Frame { number: 9, pose: None, .. }]), "{bodies:?}");
        assert_eq!(counters.malformed.get(), 0);
    }
}

#[test]
fn a_body_is_found_by_name_or_by_its_streaming_identity() {
    for (object, is_found) in
        [("tello", true), ("#7", true), ("7", false), ("#3", false), ("Tello", false)]
    {
        let mut source = source(object);
        let names = models((4, 1), &[(7, "tello")]);
        let datagrams = [server((4, 1)), names, frame((4, 1), 1, &[rigid(7, 1.0)])];
        let (frames, _) = read(&mut source, &datagrams);
        assert_eq!(frames[0].pose.is_some(), is_found, "{object}");
    }
    // By its identity also before there are names, which are asked for.
    let mut source = source("#7");
    let (frames, _) = read(&mut source, &[server((3, 0)), frame((3, 0), 1, &[rigid(7, 1.0)])]);
    assert!(frames[0].pose.is_some());
    source.beat();
    assert!(asked(&mut source).contains(&id::REQUEST_MODELDEF));
}

#[test]
fn before_there_are_names_nothing_is_missing() {
    let mut source = source("tello");
    let (frames, counters) =
        read(&mut source, &[server((4, 1)), frame((4, 1), 1, &[rigid(7, 1.0)])]);
    assert_eq!((frames.len(), counters.other_object.get()), (0, 0));
    let names = models((4, 1), &[(3, "wand")]);
    let (frames, counters) = read(&mut source, &[names, frame((4, 1), 2, &[rigid(3, 1.0)])]);
    assert_eq!((frames.len(), counters.other_object.get()), (1, 1));
    assert_eq!(frames[0].pose, None);
}

#[test]
fn new_models_are_asked_for_and_another_version_too() {
    let mut source = source("tello");
    let names = models((4, 1), &[(7, "tello")]);
    read(&mut source, &[server((4, 1)), names, rate(100.0), frame((4, 1), 1, &[rigid(7, 1.0)])]);
    asked(&mut source);
    let changed = FrameEnd { has_new_models: true, ..end() };
    let mut bytes = Vec::new();
    encode::frame(version((4, 1)), 2, &[rigid(7, 1.0)], &changed, &mut bytes);
    read(&mut source, &[bytes]);
    source.beat();
    assert_eq!(asked(&mut source), [id::KEEPALIVE, id::REQUEST_MODELDEF]);
    read(&mut source, &[server((3, 1))]);
    assert_eq!(asked(&mut source), [id::REQUEST_MODELDEF]);
}

#[test]
fn a_protocol_that_is_not_read_is_named() {
    for of in [(2, 10), (5, 0)] {
        let counters = MocapCounters::default();
        let error = source("tello").push(&server(of), &counters, &mut |_| ()).unwrap_err();
        assert_eq!(error, SourceError::NatnetVersion { major: of.0, minor: of.1 });
    }
}

#[test]
fn a_server_names_its_group_or_none() {
    let group = "239.255.42.99:1511".parse().unwrap();
    let info = ServerInfo { version: version((3, 1)), ticks_per_s: TICKS, group: Some(group) };
    let mut bytes = Vec::new();
    encode::server_info(&info, "Motive", &mut bytes);
    let (_, body) = packet::message(&bytes).unwrap();
    assert_eq!(packet::server_info(body), Some(info));
    // What a server of protocol 3.0 leaves out.
    let short = packet::server_info(&body[..264]).unwrap();
    assert_eq!(short, ServerInfo { ticks_per_s: 0, group: None, ..info });
    assert_eq!(packet::server_info(&body[..263]), None);
}

#[test]
fn every_truncation_is_refused() {
    for of in VERSIONS {
        for whole in [server(of), models(of, &[(7, "tello")]), frame(of, 1, &[rigid(7, 1.0)])] {
            for length in 0..whole.len() {
                assert_eq!(packet::message(&whole[..length]), None, "{length}");
            }
        }
        let whole = frame(of, 1, &[rigid(7, 1.0)]);
        let bodies_end = if version(of).has_sizes() { 70 } else { 58 };
        for length in 4..whole.len() {
            let read = packet::frame(&whole[4..length], version(of), |_| ());
            // Poses that are there count, whatever is missing behind them.
            assert_eq!(read.is_some(), length >= bodies_end, "{of:?}: {length}");
        }
    }
}

/// Datagrams of a conversation, some bytes of which are others.
fn mutated() -> impl Strategy<Value = Vec<Vec<u8>>> {
    let change = (0..5_usize, any::<prop::sample::Index>(), any::<u8>());
    let changes = prop::collection::vec(change, 0..12);
    (prop::sample::select(VERSIONS.to_vec()), changes).prop_map(|(of, changes)| {
        let bodies = [rigid(3, 9.0), rigid(7, 1.0)];
        let names = models(of, &[(3, "wand"), (7, "tello")]);
        let mut datagrams =
            vec![server(of), names, rate(100.0), frame(of, 1, &bodies), frame(of, 2, &bodies)];
        for (which, at, byte) in changes {
            let datagram = &mut datagrams[which];
            let at = at.index(datagram.len());
            datagram[at] = byte;
        }
        datagrams
    })
}

fn push_all(datagrams: &[Vec<u8>]) -> Result<(), TestCaseError> {
    let mut source = source("tello");
    let counters = MocapCounters::default();
    for datagram in datagrams {
        let mut poses = Vec::new();
        let result = source.push(datagram, &counters, &mut |frame| poses.extend(frame.pose));
        if result.is_err() {
            source.restart();
        }
        for pose in poses {
            prop_assert!(pose.iter().all(|value| value.is_finite()));
        }
        source.beat();
        let mut requests = Vec::new();
        source.take_requests(&mut requests);
        prop_assert!(requests.len() < 200);
    }
    Ok(())
}

proptest! {
    #[test]
    fn random_datagrams_give_finite_poses_or_nothing(
        datagrams in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..400), 0..5),
    ) {
        push_all(&datagrams)?;
    }

    #[test]
    fn datagrams_with_other_bytes_give_finite_poses_or_nothing(datagrams in mutated()) {
        push_all(&datagrams)?;
    }
}
