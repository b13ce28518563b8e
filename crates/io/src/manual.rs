//! A person at the controls: keys of the terminal, a keyboard or a gamepad.
//!
//! Owns what a person can ask for, the end of it that the control thread polls, and the readers, each
//! on a thread of its own. What events mean is `manual::controls`, which key is which `manual::keys`.
//! It refuses to decide what becomes of an order: that is the supervisor's.

mod controls;
mod device;
mod keys;
mod reader;
mod remote;
mod terminal;

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

use nix::errno::Errno;
use rtrb::{Consumer, Producer, RingBuffer};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};
use tello_model::rows::Sticks;
use tello_model::setting::{SettingError, in_range};
use thiserror::Error;

pub use controls::{Act, Controls, Direction, Event, Source};
pub use keys::{Decoder, KEYS_HELP, Typed};
pub use remote::{Remote, RemoteBusy};

use self::device::Layout;
use self::reader::Outlet;
use self::terminal::Mode;
use crate::clock::{Clock, SpanNs, TimeNs};

/// Events under way from one reader: a second of the quickest typing. A reader that finds the queue
/// full waits; behind it the kernel keeps what comes.
const EVENTS: usize = 64;

/// An order of the person at the controls, the weakest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Ask {
    /// Take off.
    TakeOff,
    /// Land.
    Land,
    /// Stop the motors at once, in the air as well: the drone falls.
    Cut,
}

/// What the person at the controls wants in one tick.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Hand {
    /// The strongest order since the last tick.
    pub ask: Option<Ask>,
    /// The sticks of a person who steers; `None`: the controller steers.
    pub sticks: Option<Sticks>,
}

/// How a person steers, as written in JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
// The key of an `Option` counts as optional unless said otherwise, here and in `present`.
#[schemars(extend("required" = ["device", "deflection", "smoothing_s", "pulse_s", "dead_zone"]))]
pub struct ManualTable {
    /// Keyboard or gamepad beside the terminal: a file such as `/dev/input/event5`, `gamepad` for the
    /// first one that is found, `null` for none.
    #[serde(deserialize_with = "present")]
    pub device: Option<String>,
    /// Stick of a key that is held, and of a gamepad's stick at its stop. 1, 0..=1
    pub deflection: f64,
    /// Time constant with which the sticks follow. s, 0.01..=5
    pub smoothing_s: f64,
    /// How long a key acts that cannot report its release, from each press or repetition. s, 0.05..=1
    pub pulse_s: f64,
    /// Share of a gamepad stick's way that does nothing. 1, 0..=0.5
    pub dead_zone: f64,
}

/// An optional value whose key is required: serde lets the key of an `Option` be missing.
fn present<'de, D: Deserializer<'de>>(from: D) -> Result<Option<String>, D::Error> {
    Option::deserialize(from)
}

/// Checked [`ManualTable`].
#[derive(Debug, Clone, PartialEq)]
pub struct ManualSettings {
    device: Option<String>,
    deflection: f64,
    smoothing_s: f64,
    pulse: SpanNs,
    dead_zone: f64,
}

impl TryFrom<&ManualTable> for ManualSettings {
    type Error = SettingError;

    fn try_from(table: &ManualTable) -> Result<Self, SettingError> {
        let ManualTable { device, deflection, smoothing_s, pulse_s, dead_zone } = table;
        let is_named = |device: &String| device == "gamepad" || device.starts_with('/');
        if let Some(device) = device.as_ref().filter(|device| !is_named(device)) {
            let rule = "a path from the root, gamepad or null";
            return Err(SettingError::new("device", device, rule));
        }
        let pulse_s = in_range("pulse_s", *pulse_s, 0.05..=1.0)?;
        #[expect(clippy::cast_possible_truncation, reason = "a second at most")]
        let pulse = SpanNs((pulse_s * 1e9).round() as i64);
        Ok(Self {
            device: device.clone(),
            deflection: in_range("deflection", *deflection, 0.0..=1.0)?,
            smoothing_s: in_range("smoothing_s", *smoothing_s, 0.01..=5.0)?,
            pulse,
            dead_zone: in_range("dead_zone", *dead_zone, 0.0..=0.5)?,
        })
    }
}

impl ManualSettings {
    /// The input device beside the terminal: a path, `gamepad` or none.
    pub fn device(&self) -> Option<&str> {
        self.device.as_deref()
    }

    /// Largest deflection that a person's sticks have. 1, 0..=1
    pub fn deflection(&self) -> f64 {
        self.deflection
    }

    /// The place of a gamepad's stick, -1..=1, with its dead zone cut out and the rest stretched to the
    /// whole way.
    pub fn beyond_dead_zone(&self, place: f64) -> f64 {
        let beyond = (place.abs() - self.dead_zone).max(0.0) / (1.0 - self.dead_zone);
        beyond.min(1.0).copysign(place)
    }
}

/// The control thread's end of the controls.
#[derive(Debug)]
pub struct Pilot {
    controls: Controls,
    terminal: Consumer<Event>,
    device: Consumer<Event>,
    /// A view of this program, if one was asked for.
    remote: Option<Consumer<Event>>,
}

impl Pilot {
    /// An end, and where the events of terminal and device go.
    pub fn new(settings: ManualSettings) -> (Self, Producer<Event>, Producer<Event>) {
        let (terminal_events, terminal) = RingBuffer::new(EVENTS);
        let (device_events, device) = RingBuffer::new(EVENTS);
        let controls = Controls::new(settings);
        (Self { controls, terminal, device, remote: None }, terminal_events, device_events)
    }

    /// Where a view of the flight gives its orders. One there is: a second call closes the first.
    pub fn remote(&mut self, clock: Clock) -> Remote {
        let (events, remote) = RingBuffer::new(EVENTS);
        self.remote = Some(remote);
        Remote::new(events, clock)
    }

    /// What the person wants at `now`; called once per tick.
    ///
    /// Real time: no allocation, at most the queued events; never waits.
    pub fn poll(&mut self, now: TimeNs) -> Hand {
        for events in [&mut self.terminal, &mut self.device].into_iter().chain(&mut self.remote) {
            for _ in 0..EVENTS {
                let Ok(event) = events.pop() else { break };
                self.controls.hear(&event);
            }
        }
        self.controls.hand(now)
    }
}

/// Why nobody can steer by hand.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ManualError {
    /// No gamepad among the input devices that may be read.
    #[error(
        "no gamepad found: is it plugged in, and may this user read /dev/input (group `input`)?"
    )]
    NoGamepad,
    /// The device cannot be opened.
    #[error("cannot open {name}: is it plugged in, and may this user read it (group `input`)?")]
    Open {
        /// Its file.
        name: String,
        /// What the system said.
        source: io::Error,
    },
    /// The device has neither the keys of a keyboard nor the sticks of a gamepad.
    #[error("{name} is neither a keyboard nor a gamepad with two sticks")]
    Unfit {
        /// Its file.
        name: String,
    },
    /// Another program has the device for itself.
    #[error("{name} belongs to another program: end that, or choose another device")]
    Grab {
        /// Its file.
        name: String,
        /// What the system said.
        source: io::Error,
    },
    /// The terminal cannot be read key by key.
    #[error("cannot read single keys from the terminal; --no-keys flies without")]
    Terminal(#[source] Errno),
    /// A reader's thread cannot be started.
    #[error("cannot start a thread to read keys")]
    Thread(#[source] io::Error),
}

/// The readers of keys and sticks. Dropped, they end and the terminal is as it was.
#[derive(Debug)]
pub struct Inputs {
    ends: Arc<AtomicBool>,
    readers: Vec<JoinHandle<()>>,
    mode: Option<Mode>,
}

impl Inputs {
    /// Starts to read the device of the settings and, if `uses_keys` and the program runs in the
    /// foreground of a terminal, its keys.
    ///
    /// # Errors
    /// The device or the terminal cannot be used; see [`ManualError`].
    pub fn open(
        settings: &ManualSettings,
        uses_keys: bool,
        clock: Clock,
    ) -> Result<(Pilot, Self), ManualError> {
        let (pilot, terminal_events, device_events) = Pilot::new(settings.clone());
        let ends = Arc::new(AtomicBool::new(false));
        let mut inputs = Self { ends: Arc::clone(&ends), readers: Vec::new(), mode: None };
        if let Some(name) = settings.device() {
            let device = device::open(name)?;
            let axes = device
                .get_absinfo()
                .map_err(|source| ManualError::Open { name: name.into(), source })?;
            let layout = Layout::new(settings.clone(), axes);
            let outlet = Outlet::new(device_events, clock, Arc::clone(&ends));
            inputs.start("tello-device", move || device::read_events(device, layout, outlet))?;
        }
        if uses_keys && terminal::is_ours() {
            inputs.mode = Some(Mode::enter().map_err(ManualError::Terminal)?);
            let outlet = Outlet::new(terminal_events, clock, ends);
            inputs.start("tello-keys", move || terminal::read_keys(outlet))?;
        }
        Ok((pilot, inputs))
    }

    /// Whether the keys of the terminal are live.
    pub fn has_keys(&self) -> bool {
        self.mode.is_some()
    }

    fn start(
        &mut self,
        name: &str,
        read: impl FnOnce() + Send + 'static,
    ) -> Result<(), ManualError> {
        let thread = thread::Builder::new().name(name.into()).spawn(read);
        self.readers.push(thread.map_err(ManualError::Thread)?);
        Ok(())
    }
}

impl Drop for Inputs {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        for reader in self.readers.drain(..) {
            // A reader that panicked is over, too; the mode of the terminal goes back after them all.
            reader.join().ok();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> ManualTable {
        ManualTable {
            device: None,
            deflection: 0.5,
            smoothing_s: 0.2,
            pulse_s: 0.15,
            dead_zone: 0.1,
        }
    }

    #[test]
    fn nonsense_settings_are_refused_with_key_value_and_rule() {
        let check =
            |table: ManualTable| ManualSettings::try_from(&table).map_err(|e| e.to_string());
        assert!(check(table()).is_ok());
        assert!(check(ManualTable { device: Some("gamepad".into()), ..table() }).is_ok());
        let error = check(ManualTable { device: Some("event5".into()), ..table() }).unwrap_err();
        assert_eq!(error, "device = event5 violates a path from the root, gamepad or null");
        let error = check(ManualTable { deflection: 1.5, ..table() }).unwrap_err();
        assert_eq!(error, "deflection = 1.5 violates 0.0..=1.0");
        assert!(check(ManualTable { smoothing_s: 0.0, ..table() }).is_err());
        assert!(check(ManualTable { pulse_s: f64::NAN, ..table() }).is_err());
        assert!(check(ManualTable { dead_zone: 1.0, ..table() }).is_err());
    }

    #[test]
    fn the_end_polls_both_queues_and_the_strongest_order_wins() {
        let settings = ManualSettings::try_from(&table()).unwrap();
        let (mut pilot, mut terminal, mut device) = Pilot::new(settings);
        assert_eq!(pilot.poll(TimeNs(0)), Hand::default());
        let event = |source, act| Event { at: TimeNs(0), source, act };
        terminal.push(event(Source::Terminal, Act::Ask(Ask::Cut))).unwrap();
        device.push(event(Source::Device, Act::Ask(Ask::TakeOff))).unwrap();
        device.push(event(Source::Device, Act::Manual)).unwrap();
        let hand = pilot.poll(TimeNs(20_000_000));
        assert_eq!(hand, Hand { ask: Some(Ask::Cut), sticks: Some(Sticks::zeros()) });
        assert_eq!(pilot.poll(TimeNs(40_000_000)).ask, None, "an order is given once");
    }
}
