//! Packets of QTM's real-time protocol, for clients and for the emulator.

#![deny(clippy::indexing_slicing)]

use super::packet::{BODIES, LOSSES_BYTES, kind};
use crate::mocap::Placement;

/// Components of a frame: the bodies alone.
const COMPONENTS: u32 = 1;

/// Appends a packet of the type `kind` with a text, ended by a zero.
pub fn text(kind: u32, text: &str, to: &mut Vec<u8>) {
    packet(kind, to, |to| {
        to.extend(text.bytes());
        to.push(0);
    });
}

/// Appends an event packet with the event number `event`: what changed.
pub fn event(event: u8, to: &mut Vec<u8>) {
    packet(kind::EVENT, to, |to| to.push(event));
}

/// Appends the document of one system: rate, axis that points up, names of the bodies.
pub fn parameters(rate_hz: f64, up: &str, bodies: &[&str], to: &mut Vec<u8>) {
    let escaped = |name: &str| name.replace('&', "&amp;").replace('<', "&lt;");
    let bodies = bodies.iter().map(|name| {
        let name = escaped(name);
        format!("<Body><Name>{name}</Name><Enabled>true</Enabled><Color R=\"0\" G=\"0\" B=\"255\"/></Body>")
    });
    let bodies: String = bodies.collect();
    let document = format!(
        "<QTM_Parameters_Ver_1.19><General><Frequency>{rate_hz}</Frequency></General>\
         <The_3D><AxisUpwards>{up}</AxisUpwards><Labels>0</Labels></The_3D>\
         <The_6D>{bodies}</The_6D></QTM_Parameters_Ver_1.19>"
    );
    text(kind::XML, &document, to);
}

/// Appends a frame; positions are in millimetres, `time_us` is in us since the start of the measurement; `None` for a
/// body that is not seen.
pub fn frame(number: u32, time_us: u64, bodies: &[Option<Placement>], to: &mut Vec<u8>) {
    packet(kind::DATA, to, |to| {
        to.extend(time_us.to_le_bytes());
        to.extend(number.to_le_bytes());
        to.extend(COMPONENTS.to_le_bytes());
        packet(BODIES, to, |to| {
            to.extend(u32::try_from(bodies.len()).unwrap_or(u32::MAX).to_le_bytes());
            to.extend([0; LOSSES_BYTES]);
            for body in bodies {
                let [a, b, c, d, e, f, g, h, i] = body.map_or([f64::NAN; 9], |body| body.matrix);
                let pos_v = body.map_or([f64::NAN; 3], |body| body.pos_v);
                for value in pos_v.into_iter().chain([a, d, g, b, e, h, c, f, i]) {
                    #[expect(
                        clippy::cast_possible_truncation,
                        reason = "the protocol is in single precision"
                    )]
                    to.extend((value as f32).to_le_bytes());
                }
            }
        });
    });
}

/// Appends what `fill` appends, behind its size and its kind; packets and components look alike.
fn packet(kind: u32, to: &mut Vec<u8>, fill: impl FnOnce(&mut Vec<u8>)) {
    let mut body = Vec::new();
    fill(&mut body);
    to.extend(u32::try_from(body.len() + 8).unwrap_or(u32::MAX).to_le_bytes());
    to.extend(kind.to_le_bytes());
    to.append(&mut body);
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
