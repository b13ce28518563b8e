//! A person at the controls: keys of the terminal, a keyboard or a gamepad.
//!
//! Owns the orders of a person, the end that the control thread polls, and the readers, each
//! on a thread of its own. What events mean is `manual::controls`, which key is which `manual::keys`.
//! It refuses to decide what becomes of an order: that is the supervisor's.

mod controls;
mod device;
mod keys;
mod notes;
mod panel;
mod reader;
mod remote;
mod settings;
mod terminal;

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

use horizon_model::rows::Sticks;
use nix::errno::Errno;
use rtrb::{Consumer, Producer, RingBuffer};
use thiserror::Error;

pub use controls::{Direction, Event, InputAction, Source};
pub use keys::{Decoder, KEYS_HELP, Typed};
pub use remote::{Remote, RemoteBusy};
pub use settings::{ManualSettings, ManualTable};
pub use terminal::{discard_typed, is_ours as is_terminal_ours};

use self::controls::ControlState;
use self::device::Layout;
use self::notes::Notes;
use self::panel::Note;
use self::reader::Outlet;
use self::terminal::Mode;
use crate::EmergencyRequest;
use crate::clock::{Clock, TimeNs};

/// Events in transit from one reader, and per tick: all that a terminal holds when text was pasted, so that an order
/// behind it is heard in the next tick. A reader that finds the queue full waits; behind it the kernel keeps what
/// comes.
const EVENTS: usize = 4096;

/// Orders in transit from a view, which is informed that the control thread takes none before many gather.
const REMOTE_EVENTS: usize = 64;

/// An order of the person at the controls, the weakest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum PersonOrder {
    /// Take off.
    TakeOff,
    /// Land.
    Land,
    /// Stop the motors at once, in the air as well: the drone falls.
    EmergencyStop,
}

/// Order and sticks of the person at the controls in one tick.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ManualInput {
    /// The strongest order since the last tick.
    pub order: Option<PersonOrder>,
    /// The sticks of a person who steers; `None`: the controller steers. 1
    pub sticks: Option<Sticks>,
    /// Whether a timer let go of a key or a stick in the person's place since the last tick.
    pub has_expired: bool,
}

/// The control thread's end of the queues of terminal, device and view.
#[derive(Debug)]
pub struct ManualControls {
    controls: ControlState,
    terminal: Consumer<Event>,
    device: Consumer<Event>,
    /// A view of this program, if one was asked for.
    remote: Option<Consumer<Event>>,
    emergency: EmergencyRequest,
    notes: Notes,
}

impl ManualControls {
    /// The control thread's end, and the queues into which the readers of terminal and device put their events, in this
    /// order. A queue holds 4096 events; a reader that finds its queue full waits. Allocates the queues.
    pub fn new(settings: ManualSettings) -> (Self, Producer<Event>, Producer<Event>) {
        let (terminal_events, terminal) = RingBuffer::new(EVENTS);
        let (device_events, device) = RingBuffer::new(EVENTS);
        let controls = ControlState::new(settings);
        let (emergency, notes) = (EmergencyRequest::default(), Notes::default());
        let controls = Self { controls, terminal, device, remote: None, emergency, notes };
        (controls, terminal_events, device_events)
    }

    /// Where a view of the flight gives its orders. At most one: a second call closes the first.
    pub fn remote(&mut self, clock: Clock) -> Remote {
        let (events, remote) = RingBuffer::new(REMOTE_EVENTS);
        self.remote = Some(remote);
        Remote::new(events, self.emergency.clone(), clock)
    }

    /// Emergency stops from every source, for the sender: [`crate::tello::DroneClient::obey`].
    pub fn emergency(&self) -> EmergencyRequest {
        self.emergency.clone()
    }

    /// Order and sticks of the person at `now`; called once per tick.
    ///
    /// Real time: no allocation, at most the queued events; never waits.
    pub fn poll(&mut self, now: TimeNs) -> ManualInput {
        for events in [&mut self.terminal, &mut self.device].into_iter().chain(&mut self.remote) {
            for _ in 0..EVENTS {
                let Ok(event) = events.pop() else { break };
                self.controls.receive(&event);
            }
        }
        let input = self.controls.input(now);
        let note = self.controls.take_note();
        if let Some(note) = note {
            self.notes.leave(note);
        }
        ManualInput { has_expired: note.is_some(), ..input }
    }

    /// Notifies the person that their order to take off counts no more, if there is anything to order again with.
    /// Real time: never waits.
    pub fn note_lapsed_take_off(&self) {
        let mut inputs = [&self.terminal, &self.device].into_iter().chain(&self.remote);
        if inputs.any(|events| !events.is_abandoned()) {
            self.notes.leave(Note::TakeOffLapsed);
        }
    }
}

/// Why manual control is not available.
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
        /// The error of the operating system.
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
        /// The error of the operating system.
        source: io::Error,
    },
    /// The terminal cannot be read key by key.
    #[error("cannot read single keys from the terminal; --no-keys flies without")]
    Terminal(#[source] Errno),
    /// A reader's thread cannot be started.
    #[error("cannot start a thread for keys")]
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
    ) -> Result<(ManualControls, Self), ManualError> {
        let (controls, terminal_events, device_events) = ManualControls::new(settings.clone());
        let ends = Arc::new(AtomicBool::new(false));
        let mut inputs = Self { ends: Arc::clone(&ends), readers: Vec::new(), mode: None };
        let shown = notes::show(controls.notes.clone(), Arc::clone(&ends));
        shown.map_err(ManualError::Thread)?;
        if let Some(name) = settings.device.as_deref() {
            let device = device::open(name)?;
            let axes = device
                .get_absinfo()
                .map_err(|source| ManualError::Open { name: name.into(), source })?;
            let layout = Layout::new(settings.clone(), axes);
            let outlet = Outlet::new(device_events, controls.emergency(), clock, Arc::clone(&ends));
            inputs.start("tello-device", move || device::read_events(device, layout, outlet))?;
        }
        if uses_keys && terminal::is_ours() {
            inputs.mode = Some(Mode::enter().map_err(ManualError::Terminal)?);
            let outlet = Outlet::new(terminal_events, controls.emergency(), clock, ends);
            inputs.start("tello-keys", move || terminal::read_keys(outlet))?;
        }
        Ok((controls, inputs))
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
    use super::settings::tests::table;
    use super::*;

    #[test]
    fn the_end_polls_both_queues_and_the_strongest_order_wins() {
        let settings = ManualSettings::try_from(&table()).unwrap();
        let (mut controls, mut terminal, mut device) = ManualControls::new(settings);
        assert_eq!(controls.poll(TimeNs(0)), ManualInput::default());
        let event = |source, action| Event { at: TimeNs(0), source, action };
        terminal
            .push(event(Source::Terminal, InputAction::Order(PersonOrder::EmergencyStop)))
            .unwrap();
        device.push(event(Source::Device, InputAction::Order(PersonOrder::TakeOff))).unwrap();
        device.push(event(Source::Device, InputAction::Manual)).unwrap();
        let input = controls.poll(TimeNs(20_000_000));
        let sticks = Some(Sticks::zeros());
        assert_eq!(
            input,
            ManualInput { order: Some(PersonOrder::EmergencyStop), sticks, has_expired: false }
        );
        assert_eq!(controls.poll(TimeNs(40_000_000)).order, None, "an order is given once");
    }

    #[test]
    fn a_key_that_expires_is_reported_in_one_tick() {
        let settings = ManualSettings::try_from(&table()).unwrap();
        let (mut controls, mut terminal, _device) = ManualControls::new(settings);
        let press = InputAction::Press(Direction::Forward);
        terminal.push(Event { at: TimeNs(0), source: Source::Terminal, action: press }).unwrap();
        let expired: Vec<i64> = (0..250)
            .map(|tick| 20_000_000 * tick)
            .filter(|now_ns| controls.poll(TimeNs(*now_ns)).has_expired)
            .collect();
        assert_eq!(expired.len(), 1, "{expired:?}");
        assert!(expired[0] > 0, "{expired:?}");
    }
}
