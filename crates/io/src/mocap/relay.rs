//! The text lines of the thesis' relay, to and from poses.
//!
//! `<frame> <rate> <name> <occluded> <x> <y> <z> <r1> .. <rN>`, separated by spaces; N = 3 angles in
//! rad of `R = Rx Ry Rz`, N = 4 quaternion x y z w, N = 9 row-major matrix.
//! Pure: bytes to values and back. A malformed line has its error, and the next line is read as if it had not
//! been there.

#![deny(clippy::indexing_slicing)]

use std::io::Write;

use horizon_model::rows::Pose;
use thiserror::Error;

use super::axes::Placement;
use super::body::{
    Body, heading_of_angles, heading_of_matrix, heading_of_quaternion, is_all_zero,
    matrix_of_angles,
};
use super::lines::Lines;
use super::protocol::{BodyProtocol, Head, Name, Taker};
use super::source::{Connection, Frame, Source, SourceError};
use super::{MocapCounters, body};
use crate::clock::SpanNs;

/// Longest piece of a bad field that is repeated in the message. characters
const QUOTE_CHARS_MAX: usize = 24;

/// One line of the relay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RelayPose<'a> {
    /// Frame number of the mocap system.
    pub frame: i64,
    /// Frame rate that the system claims, finite. Hz
    pub rate_hz: f64,
    /// Name of the object.
    pub object: &'a str,
    /// Pose in the world frame, heading in [-pi, pi]; `None` if occluded or all zero. m, rad
    pub pose: Option<Pose>,
}

/// Why a line is not a pose.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum LineError {
    /// Nothing but spaces.
    #[error("empty line")]
    Empty,
    /// Bytes that are no text.
    #[error("not UTF-8 from byte {valid_up_to}")]
    NotText {
        /// Number of good bytes before the bad one.
        valid_up_to: usize,
    },
    /// The line ends before this field.
    #[error("field `{field}` is missing")]
    Missing {
        /// Name of the field.
        field: &'static str,
    },
    /// A field is not a finite number; the frame and occlusion fields are integers.
    #[error("field `{field}` = {text:?} is not a finite number")]
    Number {
        /// Name of the field.
        field: &'static str,
        /// Its text, shortened.
        text: String,
    },
    /// Neither angles nor quaternion nor matrix.
    #[error("{count} rotation numbers instead of 3, 4 or 9")]
    RotationCount {
        /// How many there are; more than 9 count as 10.
        count: usize,
    },
    /// Quaternion or matrix with entries beyond 1, or a body without a heading.
    #[error("the {count} rotation numbers are no rotation with a heading")]
    Rotation {
        /// 3, 4 or 9.
        count: usize,
    },
}

/// The pose in one line, without its line feed.
///
/// Occlusion other than 0 and a pose of nothing but zeros mean that the object was not seen. The
/// heading is the direction of the body's x axis, `atan2(R10, R00)`, whatever form the rotation has.
///
/// # Errors
/// The first field that is missing, not a finite number or not a rotation; the line is lost, the
/// stream goes on.
pub fn parse_line(line: &[u8]) -> Result<RelayPose<'_>, LineError> {
    let text = std::str::from_utf8(line)
        .map_err(|error| LineError::NotText { valid_up_to: error.valid_up_to() })?;
    let mut fields = text.split(' ').filter(|field| !field.is_empty()).peekable();
    fields.peek().ok_or(LineError::Empty)?;
    let mut next = |field| fields.next().ok_or(LineError::Missing { field });

    let frame = integer("frame", next("frame")?)?;
    let rate_hz = number("rate", next("rate")?)?;
    let object = next("name")?;
    let is_occluded = integer("occluded", next("occluded")?)? != 0;
    let x = number("x", next("x")?)?;
    let y = number("y", next("y")?)?;
    let z = number("z", next("z")?)?;

    let mut rotation = [0.0; 9];
    let mut count = 0;
    for text in fields {
        let Some(slot) = rotation.get_mut(count) else {
            return Err(LineError::RotationCount { count: count + 1 });
        };
        *slot = number("rotation", text)?;
        count += 1;
    }
    if ![3, 4, 9].contains(&count) {
        return Err(LineError::RotationCount { count });
    }
    if is_occluded || is_all_zero([x, y, z].into_iter().chain(rotation)) {
        return Ok(RelayPose { frame, rate_hz, object, pose: None });
    }
    let [r1, r2, r3, r4, ..] = rotation;
    let theta = match count {
        3 => heading_of_angles([r1, r2, r3]),
        4 => heading_of_quaternion([r1, r2, r3, r4]),
        _ => heading_of_matrix(&rotation),
    };
    let pose = theta.and_then(|theta| body::pose([x, y, z], theta));
    Ok(RelayPose { frame, rate_hz, object, pose: Some(pose.ok_or(LineError::Rotation { count })?) })
}

fn integer(field: &'static str, text: &str) -> Result<i64, LineError> {
    text.parse().ok().ok_or_else(|| refusal(field, text))
}

fn number(field: &'static str, text: &str) -> Result<f64, LineError> {
    text.parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(|| refusal(field, text))
}

fn refusal(field: &'static str, text: &str) -> LineError {
    LineError::Number { field, text: text.chars().take(QUOTE_CHARS_MAX).collect() }
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
        seen.map_or_else(Default::default, |body| (body.pos_w, body.angles));
    // Writing into memory cannot fail.
    writeln!(
        to,
        "{frame} {rate_hz:.1} {object} {is_occluded} {x:.4} {y:.4} {z:.4} {a:.4} {b:.4} {c:.4}"
    )
    .ok();
}

/// The lines of a relay, read for one object.
#[derive(Debug)]
pub(super) struct RelaySource {
    object: String,
    lines: Lines,
}

impl RelaySource {
    pub(super) fn new(object: &str) -> Self {
        Self { object: object.to_owned(), lines: Lines::default() }
    }
}

impl Source for RelaySource {
    fn push(
        &mut self,
        bytes: &[u8],
        counters: &MocapCounters,
        on_frame: &mut dyn FnMut(Frame),
    ) -> Result<(), SourceError> {
        let Self { object, lines } = self;
        lines.push(bytes, |line| {
            counters.messages.count();
            match line.map(parse_line) {
                Some(Ok(line)) if line.object == object => {
                    let RelayPose { frame: number, rate_hz, pose, .. } = line;
                    let (stamp, latency) = (None, SpanNs(0));
                    on_frame(Frame { number, rate_hz, stamp, latency, pose });
                }
                Some(Ok(_)) => counters.other_object.count(),
                Some(Err(_)) | None => counters.malformed.count(),
            }
        });
        Ok(())
    }
}

impl Connection for RelaySource {
    fn restart(&mut self) {
        self.lines.clear();
    }
}

/// The lines of a relay, read for every object that it has.
#[derive(Debug, Default)]
pub(super) struct RelayBodies {
    lines: Lines,
}

impl BodyProtocol for RelayBodies {
    fn push(
        &mut self,
        bytes: &[u8],
        counters: &MocapCounters,
        taker: &mut dyn Taker,
    ) -> Result<(), SourceError> {
        self.lines.push(bytes, |line| {
            counters.messages.count();
            let Some(read) = line.and_then(|line| parse_line(line).ok()) else {
                counters.malformed.count();
                return;
            };
            // The relay's reader keeps the heading of a rotation alone.
            let at = read.pose.map(|at| {
                let [x, y, z, theta] = at.into();
                Placement { pos_v: [x, y, z], matrix: matrix_of_angles([0.0, 0.0, theta]) }
            });
            taker.body(Name { text: Some(read.object), id: None }, at.as_ref());
            let (number, rate_hz, stamp) = (read.frame, read.rate_hz, None);
            taker.frame(Head { number, rate_hz, stamp, latency: SpanNs(0), is_whole: false });
        });
        Ok(())
    }
}

impl Connection for RelayBodies {
    fn restart(&mut self) {
        self.lines = Lines::default();
    }
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
