use super::super::tests::{
    BODY_3_0, FRAME_3_0, TICKS, VERSIONS, end, frame, models, rigid, server, version,
};
use super::*;
use crate::mocap::natnet::encode;

#[test]
fn the_documented_frame_is_read_byte_by_byte() {
    let (kind, content) = message(&FRAME_3_0).unwrap();
    let mut bodies = Vec::new();
    let read = super::frame(content, version((3, 0)), |body| bodies.push(body));
    assert_eq!((kind, read), (id::FRAMEOFDATA, Some((1000, Some(end())))));
    assert_eq!(bodies, [BODY_3_0]);
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
    let read = super::frame(&content, version((3, 0)), |body| bodies.push(body.id));
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
    let result = rigid_body_names(&content, version((4, 0)), |id, name| {
        names.push((id, String::from_utf8_lossy(name).into_owned()));
    });
    assert_eq!((result, names), (Some(()), vec![(7, "tello".to_owned())]));
}

#[test]
fn a_server_names_its_group_or_none() {
    let group = "239.255.42.99:1511".parse().unwrap();
    let info = ServerInfo { version: version((3, 1)), ticks_per_s: TICKS, group: Some(group) };
    let mut bytes = Vec::new();
    encode::server_info(&info, "Motive", &mut bytes);
    let (_, body) = message(&bytes).unwrap();
    assert_eq!(server_info(body), Some(info));
    // What a server of protocol 3.0 leaves out.
    let short = server_info(&body[..264]).unwrap();
    assert_eq!(short, ServerInfo { ticks_per_s: 0, group: None, ..info });
    assert_eq!(server_info(&body[..263]), None);
}

#[test]
fn every_truncation_is_refused() {
    for of in VERSIONS {
        for whole in [server(of), models(of, &[(7, "tello")]), frame(of, 1, &[rigid(7, 1.0)])] {
            for length in 0..whole.len() {
                assert_eq!(message(&whole[..length]), None, "{length}");
            }
        }
        let whole = frame(of, 1, &[rigid(7, 1.0)]);
        let bodies_end = if version(of).has_sizes() { 70 } else { 58 };
        for length in 4..whole.len() {
            let read = super::frame(&whole[4..length], version(of), |_| ());
            // Poses that are there count, whatever is missing behind them.
            assert_eq!(read.is_some(), length >= bodies_end, "{of:?}: {length}");
        }
    }
}
