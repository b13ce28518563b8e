//! Queries of the host and answers of the drone: facts that do not change in a flight.

#![deny(clippy::indexing_slicing)]

use std::fmt::{self, Display, Formatter};

use super::id;

/// Most characters of a version; those of real ones have eleven.
const VERSION_CHARS: usize = 24;

/// A question; the answer has the same id and the same sequence number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Query {
    /// Version of the firmware.
    Version,
    /// Highest altitude.
    AltitudeLimit,
    /// Charge below which the drone calls its battery low.
    BatteryThreshold,
    /// Largest tilt.
    TiltLimit,
}

/// The drone's answer to a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Answer {
    /// Version of the firmware.
    Version(Version),
    /// Highest altitude. m
    AltitudeLimit(u16),
    /// Charge below which the drone calls its battery low. %
    BatteryThreshold(u8),
    /// Largest tilt, finite. rad
    TiltLimit(f64),
}

/// Version of a firmware: printable ASCII without blanks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Version {
    chars: [u8; VERSION_CHARS],
    length: usize,
}

impl Query {
    /// Every query, in the order of the declaration.
    pub const ALL: [Self; 4] =
        [Self::Version, Self::AltitudeLimit, Self::BatteryThreshold, Self::TiltLimit];

    pub(super) fn id(self) -> u16 {
        match self {
            Self::Version => id::VERSION,
            Self::AltitudeLimit => id::ASK_ALTITUDE_LIMIT,
            Self::BatteryThreshold => id::ASK_BATTERY_THRESHOLD,
            Self::TiltLimit => id::ASK_TILT_LIMIT,
        }
    }

    pub(super) fn of_id(id: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|query| query.id() == id)
    }

    /// The answer in a payload, which begins with a status of zero.
    pub(super) fn answer(self, payload: &[u8]) -> Option<Answer> {
        let Some((0, value)) = payload.split_first() else { return None };
        match (self, value) {
            (Self::Version, text) => Version::read(text).map(Answer::Version),
            (Self::AltitudeLimit, &[low, high]) => {
                Some(Answer::AltitudeLimit(u16::from_le_bytes([low, high])))
            }
            (Self::BatteryThreshold, &[percent, ..]) => Some(Answer::BatteryThreshold(percent)),
            (Self::TiltLimit, &[b0, b1, b2, b3]) => {
                let tilt_deg = f32::from_le_bytes([b0, b1, b2, b3]);
                tilt_deg.is_finite().then(|| Answer::TiltLimit(f64::from(tilt_deg).to_radians()))
            }
            _ => None,
        }
    }
}

impl Answer {
    /// The query that this answers.
    pub fn query(&self) -> Query {
        match self {
            Self::Version(_) => Query::Version,
            Self::AltitudeLimit(_) => Query::AltitudeLimit,
            Self::BatteryThreshold(_) => Query::BatteryThreshold,
            Self::TiltLimit(_) => Query::TiltLimit,
        }
    }

    /// The payload: a status of zero, then the value.
    pub(super) fn payload(&self) -> Vec<u8> {
        let mut payload = vec![0];
        match self {
            Self::Version(version) => payload.extend_from_slice(version.to_string().as_bytes()),
            Self::AltitudeLimit(limit_m) => payload.extend_from_slice(&limit_m.to_le_bytes()),
            Self::BatteryThreshold(percent) => payload.push(*percent),
            Self::TiltLimit(tilt_rad) => {
                #[expect(
                    clippy::cast_possible_truncation,
                    reason = "the wire has single precision"
                )]
                let tilt_deg = tilt_rad.to_degrees() as f32;
                payload.extend_from_slice(&tilt_deg.to_le_bytes());
            }
        }
        payload
    }
}

impl Version {
    /// The version at the beginning of `text`, which ends with it or goes on with a zero or a blank. `None`: the
    /// text has none, or one that is too long.
    pub fn read(text: &[u8]) -> Option<Self> {
        let length = text.iter().position(|byte| !byte.is_ascii_graphic()).unwrap_or(text.len());
        let mut chars = [0; VERSION_CHARS];
        chars.get_mut(..length)?.copy_from_slice(text.get(..length)?);
        (length > 0).then_some(Self { chars, length })
    }
}

impl Display for Version {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let known = self.chars.get(..self.length).unwrap_or_default();
        known.iter().try_for_each(|byte| write!(f, "{}", char::from(*byte)))
    }
}

#[cfg(test)]
mod tests;
