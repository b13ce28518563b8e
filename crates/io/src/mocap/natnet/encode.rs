//! Datagrams of NatNet, for clients and for the emulator.
//!
//! Only what an emulated room needs: rigid bodies without markers.

#![deny(clippy::indexing_slicing)]

use super::packet::{
    FIXED_NAME_BYTES, FrameEnd, PARENT_BYTES, PRECISION_TIME_BYTES, RigidBody, ServerInfo,
    TIME_CODE_BYTES, Version, described, id,
};

const NO_PARENT: i32 = -1;
const OFFSET_BYTES: usize = PARENT_BYTES - 4;
const NO_MARKERS: [u8; 4] = [0; 4];
/// Mean distance of the markers from their places in the body: an emulated room fits exactly. m
const MEAN_ERROR_M: [u8; 4] = [0; 4];
const END_OF_DATA: [u8; 4] = [0; 4];
/// Marker sets, unlabeled markers.
const LISTS_BEFORE_BODIES: usize = 2;
/// Skeletons, labeled markers, force plates, devices; versions with sizes have assets, too.
const LISTS_BEHIND_BODIES: usize = 4;

/// Appends a datagram of `kind` with `body`.
pub fn request(kind: u16, body: &[u8], to: &mut Vec<u8>) {
    message(kind, to, |to| to.extend_from_slice(body));
}

/// Appends a `SERVERINFO`: name of the application, cut to 255 bytes, versions, clock and group of the server.
pub fn server_info(server: &ServerInfo, application: &str, to: &mut Vec<u8>) {
    let Version { major, minor } = server.version;
    message(id::SERVERINFO, to, |to| {
        let padding = std::iter::repeat(0);
        to.extend(
            application.bytes().take(FIXED_NAME_BYTES - 1).chain(padding).take(FIXED_NAME_BYTES),
        );
        to.extend([major, minor, 0, 0, major, minor, 0, 0]);
        to.extend(server.ticks_per_s.to_le_bytes());
        let (port, group) =
            server.group.map_or((0, [0; 4]), |group| (group.port(), group.ip().octets()));
        to.extend(port.to_le_bytes());
        to.push(u8::from(server.group.is_some()));
        to.extend(group);
    });
}

/// Appends the descriptions of rigid bodies, by identity and name.
pub fn model_definitions(version: Version, bodies: &[(i32, &str)], to: &mut Vec<u8>) {
    message(id::MODELDEF, to, |to| {
        to.extend(length(bodies.len()).to_le_bytes());
        for (body, name) in bodies {
            to.extend(described::RIGID_BODY.to_le_bytes());
            sized(version, to, |to| {
                to.extend(name.bytes().filter(|byte| *byte != 0));
                to.push(0);
                to.extend(body.to_le_bytes());
                to.extend(NO_PARENT.to_le_bytes());
                to.extend([0; OFFSET_BYTES]);
                if version >= (Version { major: 4, minor: 2 }) {
                    to.extend([0.0, 0.0, 0.0, 1.0_f32].map(f32::to_le_bytes).as_flattened());
                }
                to.extend(NO_MARKERS);
            });
        }
    });
}

/// Appends the answer `value` to a command, in the unit of what was asked for: the frame rate in Hz.
pub fn response(value: f32, to: &mut Vec<u8>) {
    message(id::RESPONSE, to, |to| to.extend(value.to_le_bytes()));
}

/// Appends a frame; positions of `bodies` are in metres on the wire, as Motive sends them.
pub fn frame(
    version: Version,
    number: i32,
    bodies: &[RigidBody],
    end: &FrameEnd,
    to: &mut Vec<u8>,
) {
    message(id::FRAMEOFDATA, to, |to| {
        to.extend(number.to_le_bytes());
        (0..LISTS_BEFORE_BODIES).for_each(|_| none(version, to));
        to.extend(length(bodies.len()).to_le_bytes());
        sized(version, to, |to| bodies.iter().for_each(|body| rigid_body(body, to)));
        let lists = LISTS_BEHIND_BODIES + usize::from(version.has_sizes());
        (0..lists).for_each(|_| none(version, to));
        to.extend([0; TIME_CODE_BYTES]);
        to.extend(end.timestamp_s.to_le_bytes());
        for ticks in [end.exposed, end.received, end.transmitted] {
            to.extend(ticks.to_le_bytes());
        }
        if version.has_sizes() {
            to.extend([0; PRECISION_TIME_BYTES]);
        }
        to.extend((u16::from(end.has_new_models) << 1).to_le_bytes());
        to.extend(END_OF_DATA);
    });
}

fn rigid_body(body: &RigidBody, to: &mut Vec<u8>) {
    to.extend(body.id.to_le_bytes());
    for value in body.pos_v.into_iter().chain(body.quaternion) {
        #[expect(clippy::cast_possible_truncation, reason = "the protocol has single precision")]
        to.extend((value as f32).to_le_bytes());
    }
    to.extend(MEAN_ERROR_M);
    to.extend(u16::from(body.is_tracked).to_le_bytes());
}

/// A list without elements.
fn none(version: Version, to: &mut Vec<u8>) {
    to.extend(length(0).to_le_bytes());
    sized(version, to, |_| ());
}

/// Appends the bytes of `fill`, behind their size where the version has it.
fn sized(version: Version, to: &mut Vec<u8>, fill: impl FnOnce(&mut Vec<u8>)) {
    let mut inner = Vec::new();
    fill(&mut inner);
    if version.has_sizes() {
        to.extend(length(inner.len()).to_le_bytes());
    }
    to.append(&mut inner);
}

fn message(kind: u16, to: &mut Vec<u8>, fill: impl FnOnce(&mut Vec<u8>)) {
    let mut body = Vec::new();
    fill(&mut body);
    // What no datagram can carry is cut, and refused by its reader.
    let size = u16::try_from(body.len()).unwrap_or(u16::MAX);
    to.extend(kind.to_le_bytes());
    to.extend(size.to_le_bytes());
    to.append(&mut body);
}

fn length(count: usize) -> i32 {
    i32::try_from(count).unwrap_or(i32::MAX)
}

#[cfg(test)]
mod tests;
