//! The text lines of the thesis' relay, to and from poses.
//!
//! `<frame> <rate> <name> <occluded> <x> <y> <z> <r1> .. <rN>`, separated by spaces; N = 3 angles in
//! rad of `R = Rx Ry Rz`, N = 4 quaternion x y z w, N = 9 row-major matrix.
//! Pure: bytes to values and back. A malformed line is counted, and the next line is read as if it had not
//! been there.

#![deny(clippy::indexing_slicing)]

use std::io::Write;

use horizon_model::rows::Pose;

use super::axes::{Axes, Placement, matrix_of_quaternion};
use super::body::{Body, is_all_zero, matrix_of_angles};
use super::lines::Lines;
use super::protocol::{Absence, BodyProtocol, FrameVisitor, Head, Name};
use super::source::{Refusal, SourceError};
use crate::clock::SpanNs;

/// One line of the relay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RelayPose<'a> {
    /// Frame number of the mocap system.
    pub frame: i64,
    /// Frame rate that the system claims, finite. Hz
    pub rate_hz: f64,
    /// Name of the object.
    pub object: &'a str,
    /// Where it is in the world frame, finite numbers; `None` if occluded or all zero. m
    pub at: Option<Placement>,
}

impl RelayPose<'_> {
    /// The pose, heading in [-pi, pi]; `None` also if the rotation is none, or its top further than 60 degrees from
    /// up. m, rad
    pub fn pose(&self) -> Option<Pose> {
        Axes::ours().pose(self.at.as_ref()?)
    }
}

/// Content of one line, which comes without its line feed.
///
/// Occlusion other than 0 and a pose of nothing but zeros mean that the object was not seen.
///
/// # Errors
/// A field is missing or not a finite number, or there are others than 3, 4 or 9 rotation numbers, or the length of a
/// quaternion is not 1. The stream goes on.
pub fn parse_line(line: &[u8]) -> Result<RelayPose<'_>, Refusal> {
    let text = str::from_utf8(line).map_err(|_error| Refusal::Form)?;
    let mut fields = text.split(' ').filter(|field| !field.is_empty());
    let mut next = || fields.next().ok_or(Refusal::Form);
    let frame = next()?.parse().map_err(|_error| Refusal::FrameNumber)?;
    let rate_hz = number(next()?)?;
    let object = next()?;
    let is_occluded = next()?.parse::<i64>().map_err(|_error| Refusal::Fields)? != 0;
    let pos_v = [number(next()?)?, number(next()?)?, number(next()?)?];

    let mut rotation = [0.0; 9];
    let mut count = 0;
    for text in fields {
        *rotation.get_mut(count).ok_or(Refusal::Fields)? = number(text)?;
        count += 1;
    }
    if ![3, 4, 9].contains(&count) {
        // One more number than rotations have may be the end of a name that was split.
        let is_shifted = [5, 10].contains(&count);
        return Err(if is_shifted { Refusal::Fields } else { Refusal::Form });
    }
    if is_occluded || is_all_zero(pos_v.into_iter().chain(rotation)) {
        return Ok(RelayPose { frame, rate_hz, object, at: None });
    }
    let [r1, r2, r3, r4, ..] = rotation;
    let matrix = match count {
        3 => matrix_of_angles([r1, r2, r3]),
        4 => matrix_of_quaternion([r1, r2, r3, r4]).ok_or(Refusal::Rotation)?,
        _ => rotation,
    };
    Ok(RelayPose { frame, rate_hz, object, at: Some(Placement { pos_v, matrix }) })
}

fn number(text: &str) -> Result<f64, Refusal> {
    text.parse().ok().filter(|value: &f64| value.is_finite()).ok_or(Refusal::Number)
}

/// Appends the relay's line of one frame, line feed included: 4 decimals, three angles.
///
/// An object that is not seen is occluded with zeros. The object's name must be free of spaces.
pub fn format_line(
    frame: i64,
    rate_hz: f64,
    object: &str,
    seen: Option<&Body<'_>>,
    to: &mut Vec<u8>,
) {
    let is_occluded = u8::from(seen.is_none());
    let ([x, y, z], [a, b, c]) =
        seen.map_or_else(Default::default, |body| (body.pos_v, body.angles));
    // Writing into memory cannot fail.
    writeln!(
        to,
        "{frame} {rate_hz:.1} {object} {is_occluded} {x:.4} {y:.4} {z:.4} {a:.4} {b:.4} {c:.4}"
    )
    .ok();
}

/// The lines of a relay.
#[derive(Debug, Default)]
pub(super) struct RelayProtocol {
    lines: Lines,
}

impl BodyProtocol for RelayProtocol {
    fn push(&mut self, bytes: &[u8], visitor: &mut dyn FrameVisitor) -> Result<(), SourceError> {
        self.lines.push(bytes, |line| {
            visitor.message();
            let read = line.ok_or(Refusal::Form).and_then(parse_line);
            let RelayPose { frame, rate_hz, object, at } = match read {
                Ok(pose) => pose,
                Err(why) => return visitor.refuse(why),
            };
            visitor.body(Name { text: Some(object.as_bytes()), id: None }, at.as_ref());
            let (stamp, latency, absence) = (None, SpanNs(0), Absence::Unknown);
            visitor.frame(Head { number: frame, rate_hz, stamp, latency, absence });
        });
        Ok(())
    }

    fn restart(&mut self) {
        self.lines.clear();
    }
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
