//! The Tello's text SDK: what the host commands and what the drone replies.
//!
//! Pure bytes to values and back, and the only place that knows the SDK's texts, units and signs. Both
//! sides are read and written, since the emulator speaks the drone's. The state line is `state`.
//! Words and units: `docs/protocol.md`.

#![deny(clippy::indexing_slicing)]

mod state;

use std::fmt::{self, Display};

use horizon_model::rows::{Sticks, stick};
use tello_flight::drone::Protocol;
use thiserror::Error;

pub use state::{Field, StateLine};

/// Steps of `rc` from neutral to full deflection.
const STEPS_FULL: i16 = Protocol::Text.stick_steps();

/// The drone's video is not used, but its command names a port for it.
pub const VIDEO_PORT: u16 = 11111;

/// Longest command that is read: the longest of the SDK has 50 bytes.
const COMMAND_BYTES_MAX: usize = 200;

/// A command of the host.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// Enters SDK mode; nothing is executed before it.
    Enter,
    /// Starts the motors and climbs; answered when the drone hovers.
    TakeOff,
    /// Descends and stops the motors; answered on the floor.
    Land,
    /// Stops the motors at once; rarely answered.
    EmergencyStop,
    /// Ends a movement and hovers.
    Stop,
    /// Stick positions, each row a multiple of 1/100 in [-1, 1]; never answered.
    Sticks(Sticks),
    /// Flies a distance: forward, left, up. cm
    Go {
        /// Forward, left, up. cm
        cm: [i16; 3],
    },
    /// Turns. degrees, counter-clockwise from above positive
    Turn {
        /// Counter-clockwise from above. degrees
        deg: i16,
    },
    /// A flip; the drone ends where it was.
    Flip,
    /// Asks for the video stream.
    StreamOn,
    /// Asks for a value.
    Query(Query),
    /// Moves the state stream (and the video) to other ports of the host; SDK 3.0.
    Ports {
        /// For the state.
        state: u16,
        /// For the video.
        video: u16,
    },
    /// A setting that does not concern the flight, such as `speed` or `streamoff`.
    Setting,
}

/// Query of the host.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Query {
    /// Charge. %
    Battery,
    /// Speed of movements. cm/s
    Speed,
    /// Time with motors on. s
    Time,
    /// Signal-to-noise ratio of the radio.
    Wifi,
    /// Name of the drone's network; from 3.0 on.
    Ssid,
    /// Version of the SDK; from 2.0 on.
    Sdk,
    /// Serial number; from 2.0 on.
    SerialNumber,
    /// Height. dm
    Height,
    /// Range of temperatures. degrees Celsius
    Temperature,
    /// Attitude. degrees
    Attitude,
    /// Height by air pressure. m
    Barometer,
    /// Acceleration. 0.001 g
    Acceleration,
    /// Distance to the floor. mm
    TimeOfFlight,
}

impl Query {
    const ALL: [(Self, &'static str); 13] = [
        (Self::Battery, "battery?"),
        (Self::Speed, "speed?"),
        (Self::Time, "time?"),
        (Self::Wifi, "wifi?"),
        (Self::Ssid, "ssid?"),
        (Self::Sdk, "sdk?"),
        (Self::SerialNumber, "sn?"),
        (Self::Height, "height?"),
        (Self::Temperature, "temp?"),
        (Self::Attitude, "attitude?"),
        (Self::Barometer, "baro?"),
        (Self::Acceleration, "acceleration?"),
        (Self::TimeOfFlight, "tof?"),
    ];

    fn word(self) -> &'static str {
        Self::ALL.iter().find(|(query, _)| *query == self).map_or("", |(_, word)| word)
    }
}

/// Settings without a meaning for the flight, by their first word.
const SETTINGS: [&str; 16] = [
    "speed",
    "streamoff",
    "wifi",
    "ap",
    "mon",
    "moff",
    "mdirection",
    "motoron",
    "motoroff",
    "setfps",
    "setbitrate",
    "setresolution",
    "downvision",
    "keepalive",
    "wifisetchannel",
    "multiwifi",
];

/// Why a command is not executed: the drone's reply in words.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum CommandError {
    /// The word is not one of the SDK's, or its arguments do not fit it.
    #[error("unknown command")]
    Unknown,
    /// An argument is beyond its range.
    #[error("out of range")]
    OutOfRange,
}

impl Command {
    /// Writes the datagram over the content of `to`.
    pub fn encode(&self, to: &mut Vec<u8>) {
        to.clear();
        to.extend_from_slice(self.to_string().as_bytes());
    }

    /// The command in a datagram of a host, ours or another program's.
    ///
    /// # Errors
    /// What the drone replies to it instead of obeying.
    pub fn decode(datagram: &[u8]) -> Result<Self, CommandError> {
        let text = plain(datagram).filter(|text| text.len() <= COMMAND_BYTES_MAX);
        let mut words = text.ok_or(CommandError::Unknown)?.split_ascii_whitespace();
        let word = words.next().ok_or(CommandError::Unknown)?;
        let mut numbers = words.clone().map(|word| word.parse::<i16>().ok());
        let arguments: [Option<i16>; 5] = std::array::from_fn(|_| numbers.next().flatten());
        let count = words.clone().count();
        if let Some((query, _)) = Query::ALL.iter().find(|(_, name)| *name == word) {
            return Ok(Self::Query(*query));
        }
        match (word, count, arguments) {
            ("command", 0, _) => Ok(Self::Enter),
            ("takeoff", 0, _) => Ok(Self::TakeOff),
            ("land", 0, _) => Ok(Self::Land),
            ("emergency", 0, _) => Ok(Self::EmergencyStop),
            ("stop", 0, _) => Ok(Self::Stop),
            ("streamon", 0, _) => Ok(Self::StreamOn),
            ("flip", 1, _) => {
                let is_direction = words.all(|word| matches!(word, "l" | "r" | "f" | "b"));
                if is_direction { Ok(Self::Flip) } else { Err(CommandError::Unknown) }
            }
            ("rc", 4, [Some(right), Some(forward), Some(up), Some(clockwise), _]) => {
                sticks_of([right, forward, up, clockwise]).map(Self::Sticks)
            }
            ("go", 4, [Some(x), Some(y), Some(z), Some(speed), _]) => go([x, y, z], speed),
            ("cw", 1, [Some(deg), ..]) => turn(deg, -1),
            ("ccw", 1, [Some(deg), ..]) => turn(deg, 1),
            ("port", 2, _) => {
                let mut ports = words.map(|word| word.parse().ok().filter(|port| *port > 1024));
                let (Some(Some(state)), Some(Some(video))) = (ports.next(), ports.next()) else {
                    return Err(CommandError::OutOfRange);
                };
                Ok(Self::Ports { state, video })
            }
            (_, 1, [Some(cm), ..]) if direction(word).is_some() => {
                let cm = within(cm, 20, 500)?;
                direction(word)
                    .map(|axes| Self::Go { cm: axes.map(|axis| axis * cm) })
                    .ok_or(CommandError::Unknown)
            }
            _ if SETTINGS.contains(&word) => Ok(Self::Setting),
            _ => Err(CommandError::Unknown),
        }
    }
}

impl Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Enter => f.write_str("command"),
            Self::TakeOff => f.write_str("takeoff"),
            Self::Land => f.write_str("land"),
            Self::EmergencyStop => f.write_str("emergency"),
            Self::Stop => f.write_str("stop"),
            Self::Sticks(u) => {
                let [right, forward, up, clockwise] = steps_of(u);
                write!(f, "rc {right} {forward} {up} {clockwise}")
            }
            Self::Go { cm: [forward, left, up] } => write!(f, "go {forward} {left} {up} 50"),
            Self::Turn { deg } if *deg < 0 => write!(f, "cw {}", deg.unsigned_abs()),
            Self::Turn { deg } => write!(f, "ccw {deg}"),
            Self::Query(query) => f.write_str(query.word()),
            Self::Ports { state, video } => write!(f, "port {state} {video}"),
            Self::Flip => f.write_str("flip f"),
            Self::StreamOn => f.write_str("streamon"),
            Self::Setting => f.write_str("speed 50"),
        }
    }
}

/// Forward, left and up of the word of a direction.
fn direction(word: &str) -> Option<[i16; 3]> {
    Some(match word {
        "forward" => [1, 0, 0],
        "back" => [-1, 0, 0],
        "left" => [0, 1, 0],
        "right" => [0, -1, 0],
        "up" => [0, 0, 1],
        "down" => [0, 0, -1],
        _ => return None,
    })
}

fn within(value: i16, lo: i16, hi: i16) -> Result<i16, CommandError> {
    if (lo..=hi).contains(&value) { Ok(value) } else { Err(CommandError::OutOfRange) }
}

fn turn(deg: i16, sign: i16) -> Result<Command, CommandError> {
    Ok(Command::Turn { deg: sign * within(deg, 1, 3600)? })
}

/// `go x y z speed`: forward, left, up; too short in all three is out of range, too.
fn go(cm: [i16; 3], speed_cmps: i16) -> Result<Command, CommandError> {
    within(speed_cmps, 10, 100)?;
    for cm in cm {
        within(cm, -500, 500)?;
    }
    if cm.iter().all(|cm| cm.abs() < 20) {
        return Err(CommandError::OutOfRange);
    }
    Ok(Command::Go { cm })
}

/// Right, forward, up and clockwise in steps of the wire, limited before they become integers; a row
/// that is not a number becomes 0.
fn steps_of(u: &Sticks) -> [i16; 4] {
    let steps = |u: f64| {
        #[expect(clippy::cast_possible_truncation, reason = "limited; NaN becomes 0")]
        let steps = (u.clamp(-1.0, 1.0) * f64::from(STEPS_FULL)).round() as i16;
        steps
    };
    let yaw = -steps(u[stick::YAW]);
    [steps(u[stick::ROLL]), steps(u[stick::PITCH]), steps(u[stick::THROTTLE]), yaw]
}

/// The inverse of [`steps_of`].
fn sticks_of(steps: [i16; 4]) -> Result<Sticks, CommandError> {
    for steps in steps {
        within(steps, -STEPS_FULL, STEPS_FULL)?;
    }
    let [right, forward, up, clockwise] =
        steps.map(|steps| f64::from(steps) / f64::from(STEPS_FULL));
    // Adding zero turns the -0 of a stick at rest into 0.
    Ok(Sticks::new(right, forward, -clockwise + 0.0, up))
}

/// The text of a datagram without white space and NUL around it; `None` if it is not printable.
fn plain(datagram: &[u8]) -> Option<&str> {
    let text = std::str::from_utf8(datagram).ok()?;
    let text = text.trim_matches(|c: char| c.is_ascii_whitespace() || c == '\0');
    let is_plain = text.bytes().all(|byte| byte == b' ' || byte.is_ascii_graphic());
    (is_plain && !text.is_empty()).then_some(text)
}

/// Reply of the drone to a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reply {
    /// `ok`: done.
    Done,
    /// Any refusal: not done, or not to its end.
    Refused,
    /// A value, or words that mean neither.
    Value,
}

impl Reply {
    /// The reply in a datagram of the drone, in letters of either case; `None` if it is no text, as the binary status
    /// that often is the first answer. A refusal begins with a phrase that is known; what follows does not matter. No
    /// allocation.
    pub fn decode(datagram: &[u8]) -> Option<Self> {
        const REFUSALS: [&str; 6] =
            ["error", "out of range", "unknown", "unknow", "command error", "forced stop"];
        let text = plain(datagram)?;
        let begins = |words: &str| {
            text.get(..words.len()).is_some_and(|begin| begin.eq_ignore_ascii_case(words))
        };
        Some(if text.eq_ignore_ascii_case("ok") {
            Self::Done
        } else if REFUSALS.iter().any(|words| begins(words)) {
            Self::Refused
        } else {
            Self::Value
        })
    }
}

#[cfg(test)]
mod tests;
