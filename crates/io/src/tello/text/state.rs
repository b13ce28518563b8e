//! The state line that the drone pushes ten times a second.

#![deny(clippy::indexing_slicing)]

use std::fmt::{self, Display};

use crate::tello::protocol::from_tenths;

/// A larger heading is none. degrees
const YAW_MAX_DEG: f64 = 360.0;

/// One value of the state line, in the order in which drones send them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Field {
    /// Mission pad: 1..=8, -1 none seen, -2 detection off, 257 on drones without it.
    Mid,
    /// Place over the pad. cm
    X,
    /// Place over the pad. cm
    Y,
    /// Place over the pad. cm
    Z,
    /// Nose up. degrees
    Pitch,
    /// Right side down. degrees
    Roll,
    /// From the direction at power-up, clockwise from above. degrees
    Yaw,
    /// Speed; axis and sign differ between reports. dm/s
    Vgx,
    /// Speed; axis and sign differ between reports. dm/s
    Vgy,
    /// Speed; axis and sign differ between reports. dm/s
    Vgz,
    /// Lowest temperature. degrees Celsius
    Templ,
    /// Highest temperature. degrees Celsius
    Temph,
    /// Distance to the floor: 30..=1000, 10 on the ground, 6553 without an echo. cm
    Tof,
    /// Height in steps of 10, low by an offset that differs from flight to flight. cm
    H,
    /// Charge. %
    Bat,
    /// Height by air pressure, from an arbitrary zero. m
    Baro,
    /// Time with motors on, all flights together. s
    Time,
    /// Acceleration. 0.001 g
    Agx,
    /// Acceleration. 0.001 g
    Agy,
    /// Acceleration. 0.001 g
    Agz,
}

impl Field {
    const COUNT: usize = 20;

    /// Each with its key and the decimals that drones write.
    const ALL: [(Self, &'static str, usize); Self::COUNT] = [
        (Self::Mid, "mid", 0),
        (Self::X, "x", 0),
        (Self::Y, "y", 0),
        (Self::Z, "z", 0),
        (Self::Pitch, "pitch", 0),
        (Self::Roll, "roll", 0),
        (Self::Yaw, "yaw", 0),
        (Self::Vgx, "vgx", 0),
        (Self::Vgy, "vgy", 0),
        (Self::Vgz, "vgz", 0),
        (Self::Templ, "templ", 0),
        (Self::Temph, "temph", 0),
        (Self::Tof, "tof", 0),
        (Self::H, "h", 0),
        (Self::Bat, "bat", 0),
        (Self::Baro, "baro", 2),
        (Self::Time, "time", 0),
        (Self::Agx, "agx", 2),
        (Self::Agy, "agy", 2),
        (Self::Agz, "agz", 2),
    ];
}

/// A state line: the values that it has, which differ from firmware to firmware.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StateLine {
    values: [Option<f64>; Field::COUNT],
    /// Attitude over the mission pad: pitch, roll, yaw. degrees
    pub mpry: Option<[i16; 3]>,
}

impl StateLine {
    /// The value of `field`, in the field's unit. `None`: the line has no such field, here and below.
    pub fn get(&self, field: Field) -> Option<f64> {
        self.values.get(field as usize).copied().flatten()
    }

    /// This line with a value more, in the field's unit.
    #[must_use]
    pub fn with(mut self, field: Field, value: f64) -> Self {
        if let Some(slot) = self.values.get_mut(field as usize) {
            *slot = Some(value);
        }
        self
    }

    /// Height in whole steps of the drone, low by an offset that differs from flight to flight. m
    pub fn height_m(&self) -> Option<f64> {
        Some(from_tenths(whole(self.get(Field::H)? / 10.0)))
    }

    /// Distance to the floor below; more than 10 m without an echo. m
    pub fn tof_m(&self) -> Option<f64> {
        Some(self.get(Field::Tof)? / 100.0)
    }

    /// Speeds along three axes; axis and sign differ between reports. m/s
    pub fn velocity_d_mps(&self) -> Option<[f64; 3]> {
        let axis = |field| Some(from_tenths(whole(self.get(field)?)));
        Some([axis(Field::Vgx)?, axis(Field::Vgy)?, axis(Field::Vgz)?])
    }

    /// Heading from the direction at power-up, counter-clockwise from above; `None` beyond a turn. rad
    pub fn heading_rad(&self) -> Option<f64> {
        let yaw_deg = self.get(Field::Yaw).filter(|yaw_deg| yaw_deg.abs() <= YAW_MAX_DEG)?;
        Some(-yaw_deg.to_radians())
    }

    /// The line in a datagram; `None` if it has no value that is known. Keys that are not known and
    /// values that are no finite numbers count as absent.
    pub fn decode(datagram: &[u8]) -> Option<Self> {
        let mut line = Self::default();
        for (key, value) in super::plain(datagram)?.split(';').filter_map(|p| p.split_once(':')) {
            if key == "mpry" {
                line.mpry = angles(value);
            } else if let Some((field, ..)) = Field::ALL.iter().find(|(_, name, _)| *name == key)
                && let Some(value) = value.parse().ok().filter(|value: &f64| value.is_finite())
            {
                line = line.with(*field, value);
            }
        }
        (line != Self::default()).then_some(line)
    }

    /// Writes the datagram over the content of `to`.
    pub fn encode(&self, to: &mut Vec<u8>) {
        to.clear();
        to.extend_from_slice(self.to_string().as_bytes());
    }
}

impl Display for StateLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (field, key, decimals) in Field::ALL {
            if field == Field::Pitch
                && let Some([pitch, roll, yaw]) = self.mpry
            {
                write!(f, "mpry:{pitch},{roll},{yaw};")?;
            }
            if let Some(value) = self.get(field) {
                write!(f, "{key}:{value:.decimals$};")?;
            }
        }
        f.write_str("\r\n")
    }
}

/// The nearest whole number of the drone's steps, as wide as in the binary protocol; larger ones saturate.
fn whole(value: f64) -> i16 {
    #[expect(clippy::cast_possible_truncation, reason = "a cast saturates")]
    let whole = value.round() as i16;
    whole
}

fn angles(value: &str) -> Option<[i16; 3]> {
    let mut angles = value.split(',').map(|angle| angle.parse().ok());
    let triple = [angles.next()??, angles.next()??, angles.next()??];
    angles.next().is_none().then_some(triple)
}

#[cfg(test)]
mod tests;
