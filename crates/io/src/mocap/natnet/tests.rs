use horizon_model::check::amax;
use horizon_model::rows::Pose;
use proptest::prelude::*;

use super::packet::RigidBody;
use super::*;
use crate::mocap::axes::{Axes, Unit};
use crate::mocap::protocol::{SelectedProtocol, read};
use crate::mocap::source::SourceFrame;
use crate::mocap::{MocapCounters, matrix_of_angles, quaternion_of_matrix};

pub(super) const VERSIONS: [(u8, u8); 5] = [(3, 0), (3, 1), (4, 0), (4, 1), (4, 2)];

pub(super) const TICKS: u64 = 1_000_000;

pub(super) fn version((major, minor): (u8, u8)) -> Version {
    Version { major, minor }
}

pub(super) fn server(of: (u8, u8)) -> Vec<u8> {
    let mut bytes = Vec::new();
    let server = ServerInfo { version: version(of), ticks_per_s: TICKS, group: None };
    encode::server_info(&server, "Motive", &mut bytes);
    bytes
}

pub(super) fn models(of: (u8, u8), bodies: &[(i32, &str)]) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode::model_definitions(version(of), bodies, &mut bytes);
    bytes
}

fn rate(rate_hz: f32) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode::response(rate_hz, &mut bytes);
    bytes
}

pub(super) fn rigid(id: i32, x: f64) -> RigidBody {
    let quaternion = quaternion_of_matrix(&matrix_of_angles([0.0, 0.0, 0.5]));
    RigidBody { id, pos_v: [x, -2.0, 1.5], quaternion, is_tracked: true }
}

pub(super) fn end() -> FrameEnd {
    FrameEnd {
        timestamp_s: 1.0,
        exposed: 5000,
        received: 7000,
        transmitted: 9000,
        has_new_models: false,
    }
}

pub(super) fn frame(of: (u8, u8), number: i32, bodies: &[RigidBody]) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode::frame(version(of), number, bodies, &end(), &mut bytes);
    bytes
}

fn source(object: &str) -> SelectedProtocol {
    let axes = Axes::new(None, Unit::Metre).unwrap();
    SelectedProtocol::new(Box::new(NatnetProtocol::new(None)), object, axes)
}

/// Kinds of what the source asks.
fn asked(source: &mut SelectedProtocol) -> Vec<u16> {
    let mut bytes = Vec::new();
    source.protocol.take_requests(&mut bytes);
    let (mut rest, mut kinds) = (bytes.as_slice(), Vec::new());
    while let Some(length) = packet::datagram_length(rest) {
        kinds.push(packet::message(&rest[..length]).unwrap().0);
        rest = &rest[length..];
    }
    assert!(rest.is_empty());
    kinds
}

/// The body of [`FRAME_3_0`].
pub(super) const BODY_3_0: RigidBody =
    RigidBody { id: 7, pos_v: [1.0, 2.0, 3.0], quaternion: [0.0, 0.0, 0.0, 1.0], is_tracked: true };

/// Frame 1000 of protocol 3.0 with one rigid body, 7 at 1, 2, 3, level, seen; exposed at 5 ms, sent at 9 ms.
pub(super) const FRAME_3_0: [u8; 120] = *b"\x07\x00\x74\x00\xe8\x03\x00\x00\
    \x00\x00\x00\x00\x00\x00\x00\x00\x01\x00\x00\x00\
    \x07\x00\x00\x00\x00\x00\x80\x3f\x00\x00\x00\x40\x00\x00\x40\x40\
    \x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x80\x3f\x00\x00\x00\x00\x01\x00\
    \x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\
    \x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\xf0\x3f\
    \x88\x13\x00\x00\x00\x00\x00\x00\x58\x1b\x00\x00\x00\x00\x00\x00\x28\x23\x00\x00\x00\x00\x00\x00\
    \x00\x00\x00\x00\x00\x00";

#[test]
fn every_version_gives_pose_rate_and_age() {
    for of in VERSIONS {
        let mut source = source("tello");
        source.protocol.beat();
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
        // As long as frames come nothing but that the client is there, once a second.
        let mut kinds = Vec::new();
        for number in 3..11 {
            source.protocol.beat();
            kinds.extend(asked(&mut source));
            read(&mut source, [self::frame(of, number, &bodies)]);
        }
        assert_eq!(kinds, [id::KEEPALIVE; 2]);
    }
}

#[test]
fn after_a_beat_without_a_frame_it_is_asked_who_serves() {
    let (of, mut source) = ((4, 1), source("tello"));
    assert_eq!(source.protocol.beat_period(), Duration::from_millis(250));
    let names = models(of, &[(7, "tello")]);
    let frame = frame(of, 1, &[rigid(7, 1.0)]);
    source.protocol.beat();
    read(&mut source, [server(of), names.clone(), rate(100.0), frame.clone()]);
    asked(&mut source);
    let mut beat = || {
        source.protocol.beat();
        asked(&mut source)
    };
    assert!(beat().is_empty(), "a frame came since the last one");
    // One question a beat, and signs of life as before: no more than six datagrams a second.
    let silent: Vec<Vec<u16>> = (0..8).map(|_| beat()).collect();
    assert!(silent.iter().all(|kinds| kinds.first() == Some(&id::CONNECT)), "{silent:?}");
    assert_eq!(silent.concat().len(), 10, "{silent:?}");
    // The server is back, and the answer with its names is lost: they are asked for at the next beat.
    read(&mut source, [server(of)]);
    assert_eq!(asked(&mut source), [id::REQUEST_MODELDEF]);
    let (lost, _) = read(&mut source, [frame.clone()]);
    assert!(lost.is_empty());
    source.protocol.beat();
    assert_eq!(asked(&mut source), [id::REQUEST_MODELDEF]);
    let (found, _) = read(&mut source, [names, frame]);
    assert!(found[0].pose.is_some());
}

#[test]
fn a_body_that_is_not_tracked_or_not_there_is_a_frame_without_a_pose() {
    let lost = RigidBody { is_tracked: false, ..rigid(7, 1.0) };
    let nan = RigidBody { pos_v: [f64::NAN; 3], ..rigid(7, 1.0) };
    for bodies in [vec![lost], vec![nan], vec![rigid(3, 1.0)], vec![]] {
        let mut source = source("tello");
        let names = models((4, 1), &[(3, "wand"), (7, "tello")]);
        let (frames, counters) =
            read(&mut source, &[server((4, 1)), names, frame((4, 1), 9, &bodies)]);
        assert!(matches!(*frames, [SourceFrame { number: 9, pose: None, .. }]), "{bodies:?}");
        assert_eq!(counters.malformed.get(), 0);
    }
}

#[test]
fn a_tracked_body_without_a_rotation_is_refused_with_that_reason_if_it_is_the_object() {
    for (id, refused) in [(7, Some(Refusal::Rotation)), (3, None)] {
        let mut source = source("tello");
        let names = models((4, 1), &[(3, "wand"), (7, "tello")]);
        let long = RigidBody { quaternion: [0.0, 0.0, 0.0, 2.0], ..rigid(id, 1.0) };
        let (_, counters) = read(&mut source, &[server((4, 1)), names, frame((4, 1), 9, &[long])]);
        assert_eq!(counters.refused(), refused, "{id}");
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
    source.protocol.beat();
    assert!(asked(&mut source).contains(&id::REQUEST_MODELDEF));
}

#[test]
fn before_there_are_names_nothing_is_missing() {
    let mut source = source("tello");
    let (frames, counters) =
        read(&mut source, &[server((4, 1)), frame((4, 1), 1, &[rigid(7, 1.0)])]);
    assert_eq!((frames.len(), counters.other_object.get(), counters.unnamed.get()), (0, 0, 1));
    let names = models((4, 1), &[(3, "wand")]);
    let (frames, counters) = read(&mut source, &[names, frame((4, 1), 2, &[rigid(3, 1.0)])]);
    let counts = [counters.other_object.get(), counters.unnamed.get()];
    assert_eq!((frames.len(), counts), (1, [1, 0]));
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
    source.protocol.beat();
    assert_eq!(asked(&mut source), [id::KEEPALIVE, id::REQUEST_MODELDEF]);
    read(&mut source, &[server((3, 1))]);
    assert_eq!(asked(&mut source), [id::REQUEST_MODELDEF]);
}

#[test]
fn a_server_that_was_started_again_is_asked_for_its_names_anew() {
    let (of, mut source) = ((4, 1), source("tello"));
    let bodies = [rigid(3, 9.0), rigid(7, 1.0)];
    let names = models(of, &[(3, "wand"), (7, "tello")]);
    read(&mut source, &[server(of), names, rate(100.0), frame(of, 1, &bodies)]);
    asked(&mut source);
    // After a short silence the names stay until new ones come, after a second they are forgotten.
    let (frames, _) = read(&mut source, &[server(of), frame(of, 1, &bodies)]);
    assert!(frames.iter().all(|frame| frame.pose.is_some()) && !frames.is_empty(), "{frames:?}");
    assert!(asked(&mut source).contains(&id::REQUEST_MODELDEF));
    for _ in 0..=BEATS_PER_SLOW {
        source.protocol.beat();
    }
    asked(&mut source);
    let (frames, _) = read(&mut source, &[server(of), frame(of, 1, &bodies)]);
    assert!(frames.iter().all(|frame| frame.pose.is_none()), "of unknown bodies: {frames:?}");
    assert!(asked(&mut source).contains(&id::REQUEST_MODELDEF));
    let names = models(of, &[(3, "tello"), (7, "wand")]);
    let (frames, _) = read(&mut source, &[names, frame(of, 2, &bodies)]);
    let [frame] = *frames else { panic!("{frames:?}") };
    assert!((frame.pose.unwrap() - Pose::new(9.0, -2.0, 1.5, 0.5)).amax() < 1e-6, "{frame:?}");
}

#[test]
fn a_protocol_that_is_not_read_is_named() {
    for of in [(2, 10), (5, 0)] {
        let counters = MocapCounters::default();
        let error = source("tello").push(&server(of), &counters, &mut |_| ()).unwrap_err();
        assert_eq!(error, SourceError::NatnetVersion { major: of.0, minor: of.1 });
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
        source.protocol.beat();
        let mut requests = Vec::new();
        source.protocol.take_requests(&mut requests);
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
