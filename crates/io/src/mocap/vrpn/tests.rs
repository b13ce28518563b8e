use horizon_model::check::amax;
use horizon_model::rows::Pose;
use proptest::prelude::*;

use super::*;
use crate::mocap::MocapCounters;
use crate::mocap::axes::{Axes, Unit};
use crate::mocap::protocol::{SelectedProtocol, read};

fn source(object: &str) -> SelectedProtocol {
    let axes = Axes::new(None, Unit::Metre).unwrap();
    SelectedProtocol::new(Box::new(VrpnProtocol::new(100.0)), object, axes)
}

pub(super) fn message(time_s: f64, sender: i32, kind: i32, body: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode::message(&VrpnMessage { time_s, sender, kind, body }, &mut bytes);
    bytes
}

/// A cookie, trackers `wand` as 3 and `tello` as 4, poses as 5.
pub(super) fn begin() -> Vec<u8> {
    let mut bytes = Vec::new();
    encode::cookie(&mut bytes);
    for (kind, number, name) in [
        (kind::SENDER, 3, "wand"),
        (kind::SENDER, 4, "tello"),
        (kind::TYPE, 6, "vrpn_Tracker Velocity"),
        (kind::TYPE, 5, POSE),
    ] {
        bytes.extend(message(0.0, number, kind, &encode::description(name)));
    }
    bytes
}

pub(super) fn pose(time_s: f64, sender: i32, sensor: i32) -> Vec<u8> {
    let half = 0.25_f64;
    let body = encode::pose(sensor, [1.0, -2.0, 1.5], [0.0, 0.0, half.sin(), half.cos()]);
    message(time_s, sender, 5, &body)
}

#[test]
fn poses_of_the_tracker_are_frames_numbered_by_time() {
    for length in [1, 7, 64, 4096] {
        let mut source = source("tello");
        source.protocol.beat();
        let mut cookie = Vec::new();
        source.protocol.take_requests(&mut cookie);
        assert_eq!(cookie.len(), 24);
        source.protocol.beat();
        source.protocol.take_requests(&mut cookie);
        assert_eq!(cookie.len(), 24, "once");
        let bytes = [begin(), pose(2.0, 3, 0), pose(2.0, 4, 0), pose(2.03, 4, 0), pose(2.04, 4, 1)]
            .concat();
        let (frames, counters) = read(&mut source, bytes.chunks(length));
        let numbers: Vec<_> = frames.iter().map(|frame| (frame.number, frame.rate_hz)).collect();
        assert_eq!(numbers, [(200, 100.0), (203, 100.0)]);
        let gap = frames[0].pose.unwrap() - Pose::new(1.0, -2.0, 1.5, 0.5);
        assert!(amax(&gap) < 1e-12, "{gap}");
        assert_eq!((counters.other_object.get(), counters.malformed.get()), (2, 0));
    }
}

#[test]
fn another_sensor_has_its_number_in_the_name() {
    let bytes = [begin(), pose(2.0, 4, 0), pose(2.0, 4, 1)].concat();
    for (object, count) in [("tello", 1), ("tello#1", 1), ("tello#2", 0), ("tell", 0), ("wand", 0)]
    {
        assert_eq!(read(&mut source(object), bytes.chunks(4096)).0.len(), count, "{object}");
    }
}

#[test]
fn numbers_that_are_no_pose_are_refused() {
    let none = |pos_v, quaternion| message(1.0, 4, 5, &encode::pose(0, pos_v, quaternion));
    for bad in [
        none([f64::NAN, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]),
        none([0.0; 3], [0.0; 4]),
        none([0.0; 3], [9.0, 0.0, 0.0, 1.0]),
        message(1.0, 4, 5, &[0; 63]),
        pose(1.0, 9, 0),
    ] {
        let (frames, counters) = read(&mut source("tello"), [begin(), bad].concat().chunks(4096));
        assert_eq!((frames.len(), counters.malformed.get()), (0, 1));
    }
}

#[test]
fn other_servers_are_given_up() {
    let push = |bytes: &[u8]| source("tello").push(bytes, &MocapCounters::default(), &mut |_| ());
    assert_eq!(push(b"\x23\0\0\0\x01\0\0\0QTM RT"), Err(SourceError::NoVrpn));
    assert_eq!(push(b"vrpn: ver. 06"), Err(SourceError::NoVrpn));
    assert_eq!(push(b"vrpn: ver. 07.15"), Ok(()));
}

fn push_all(bytes: &[u8], length: usize) -> Result<(), TestCaseError> {
    let mut source = source("tello");
    let counters = MocapCounters::default();
    for piece in bytes.chunks(length.max(1)) {
        let mut poses = Vec::new();
        let result = source.push(piece, &counters, &mut |frame| poses.extend(frame.pose));
        if result.is_err() {
            source.restart();
        }
        for pose in poses {
            prop_assert!(pose.iter().all(|value| value.is_finite()));
        }
    }
    Ok(())
}

proptest! {
    #[test]
    fn random_bytes_give_finite_poses_or_nothing(
        noise in prop::collection::vec(any::<u8>(), 0..400), length in 1..100_usize,
    ) {
        push_all(&noise, length)?;
        push_all(&[begin(), noise].concat(), length)?;
    }

    #[test]
    fn messages_with_other_bytes_give_finite_poses_or_nothing(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..12),
        length in 1..300_usize,
    ) {
        let mut bytes = [begin(), pose(2.0, 3, 0), pose(2.0, 4, 0), pose(2.03, 4, 0)].concat();
        for (at, byte) in changes {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        push_all(&bytes, length)?;
    }

    #[test]
    fn a_pose_comes_back_as_it_was(
        pos_v in prop::array::uniform3(-50.0..50.0), angle in -3.0..3.0_f64, time_s in 0.0..1e6_f64,
    ) {
        let quaternion = [0.0, 0.0, (angle / 2.0).sin(), (angle / 2.0).cos()];
        let bytes = [begin(), message(time_s, 4, 5, &encode::pose(0, pos_v, quaternion))].concat();
        let (frames, _) = read(&mut source("tello"), bytes.chunks(4096));
        let gap = frames[0].pose.unwrap() - Pose::new(pos_v[0], pos_v[1], pos_v[2], angle);
        prop_assert!(amax(&gap) < 1e-12, "{gap}");
    }
}
