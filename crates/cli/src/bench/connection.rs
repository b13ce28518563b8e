//! The wire of the bench: exactly the packets of a check go out, everything is written down with its time.
//!
//! Owns the sockets, the record and the ending: from the first packet that may start a motor on, the drone
//! is landed and its motors are stopped on every way out ([`Armed`]). Nothing is printed meanwhile: a
//! terminal that hangs would hold it up.

mod ending;

use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::thread;
use std::time::Duration;

use anyhow::Result;
use horizon_model::rows::Sticks;
use tello_eval::bench::checks::{Step, TestSite};
use tello_eval::bench::evidence::{ENDING, EndingReport};
use tello_eval::bench::wire::{self, BenchEventKind, Event, Motor, Packet, Status, hex};
use tello_flight::drone::{LAND_PERIOD, STATUS_FRESH, TAKE_OFF_TAIL};
use tello_io::clock::{CivilTime, Clock, TimeNs};
use tello_io::tello::protocol::DATAGRAM_BYTES_MAX;
use tello_io::tello::{Protocol, STATE_PORT, SenderState, TelloSettings};

use self::ending::{Ending, EndingOrder};
use super::console::Console;
use super::guard::Guard;

/// How often the sockets are looked at.
const LOOK: Duration = Duration::from_millis(5);
const STICKS_PERIOD_S: f64 = 0.05;

/// The person has stopped a step, or the guardian is lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stopped;

/// The drone and the record of what passes between it and us.
#[derive(Debug)]
pub(super) struct BenchConnection {
    socket: UdpSocket,
    state_socket: Option<UdpSocket>,
    second: UdpSocket,
    address: SocketAddr,
    protocol: Protocol,
    clock: Clock,
    began: TimeNs,
    sequence: u16,
    events: Vec<Event>,
    newest: Option<(TimeNs, Status)>,
    motor: Motor,
    take_off_at: Option<TimeNs>,
    version: Option<String>,
    /// The endings so far.
    pub(super) ending: Option<EndingReport>,
    guard: Guard,
}

impl BenchConnection {
    /// Binds the sockets; motors that may run get a guardian.
    pub(super) fn bind(settings: &TelloSettings, site: TestSite) -> Result<Self> {
        let (socket, state_socket) = settings.bind()?;
        let (address, protocol) = (settings.address(), settings.protocol());
        let guard =
            if site.spins() { Guard::start(&socket, address, protocol)? } else { Guard::absent() };
        let second = UdpSocket::bind(("0.0.0.0", 0))?;
        second.set_nonblocking(true)?;
        let clock = Clock::start();
        Ok(Self {
            socket,
            state_socket,
            second,
            address,
            protocol,
            clock,
            began: clock.now(),
            sequence: 1000,
            events: Vec::new(),
            newest: None,
            motor: Motor::default(),
            take_off_at: None,
            version: None,
            ending: None,
            guard,
        })
    }

    /// Asks for a connection until a status comes, for 6 s.
    ///
    /// # Errors
    /// The person stops it, or the guardian is lost.
    pub(super) fn connect(&mut self, console: &Console) -> Result<Option<Status>, Stopped> {
        for _ in 0..6 {
            self.send(Packet::Hello);
            if let Some(Ok(port)) =
                self.state_socket.as_ref().map(|socket| socket.local_addr().map(|at| at.port()))
                && port != STATE_PORT
            {
                self.send(Packet::Ports(port));
            }
            if self.version.is_none() {
                self.ask_version(0);
            }
            self.wait(1.0, console, |_| false)?;
            if self.status().is_some() {
                break;
            }
        }
        Ok(self.status())
    }

    /// Begins a new record.
    pub(super) fn begin(&mut self) {
        self.receive();
        self.began = self.clock.now();
        self.events.clear();
        (self.take_off_at, self.ending) = (None, None);
    }

    pub(super) fn events(&self) -> &[Event] {
        &self.events
    }

    /// Version of the firmware, if the drone reported it.
    pub(super) fn version(&self) -> Option<&str> {
        self.version.as_deref()
    }

    /// Begin of the record. ns since 1970-01-01 UTC
    pub(super) fn began_utc_ns(&self) -> i64 {
        self.clock.utc_start_ns().saturating_add(self.began.0)
    }

    /// The newest status, unless it is old.
    pub(super) fn status(&self) -> Option<Status> {
        let (at, status) = self.newest?;
        (self.clock.now().since(at) < STATUS_FRESH).then_some(status)
    }

    fn t_s(&self) -> f64 {
        self.clock.now().since(self.began).seconds()
    }

    fn note(&mut self, what: BenchEventKind) {
        self.events.push(Event { t_s: self.t_s(), what });
    }

    /// Runs one step.
    fn take(&mut self, step: &Step, console: &Console) -> Result<(), Stopped> {
        self.note(BenchEventKind::Step(step.to_string()));
        match *step {
            Step::TakeOff => {
                // The last look before the motors start.
                self.wait(0.0, console, |_| false)?;
                self.take_off_at = Some(self.clock.now());
                let sequence = self.count();
                self.send(Packet::TakeOff(sequence));
            }
            Step::Land => self.send_land(),
            Step::Lands { for_s, has_same_number } => {
                let until_s = self.t_s() + for_s;
                let mut sequence = self.count();
                while self.t_s() < until_s && !self.is_over() {
                    self.send(Packet::Land(sequence));
                    sequence = if has_same_number { sequence } else { self.count() };
                    self.wait(LAND_PERIOD.seconds(), console, |_| false)?;
                }
            }
            Step::Emergency => {
                self.send(Packet::Emergency);
                self.send(Packet::Emergency);
            }
            Step::Hello => self.send(Packet::Hello),
            Step::Ask(sequence) => self.ask_version(sequence),
            Step::Sticks(u, for_s) => return self.steer(u, None, for_s, console),
            Step::Second(u, for_s) => return self.steer([0.0; 4], Some(u), for_s, console),
            Step::Quiet(for_s) => return self.wait(for_s, console, |_| false),
            Step::Flying(most_s) => {
                return self.wait(most_s, console, |link| {
                    link.status().is_some_and(|status| status.is_flying)
                });
            }
            Step::Down(most_s) => return self.wait(most_s, console, Self::is_over),
        }
        Ok(())
    }

    /// Sends sticks at once and until `for_s` have passed, and those of a second program beside them.
    fn steer(
        &mut self,
        u: [f64; 4],
        second: Option<[f64; 4]>,
        for_s: f64,
        console: &Console,
    ) -> Result<(), Stopped> {
        let until_s = self.t_s() + for_s;
        loop {
            self.send(Packet::Sticks(u.into()));
            if let Some(u) = second {
                self.send_by_second(Packet::Sticks(u.into()));
            }
            if self.t_s() >= until_s {
                return Ok(());
            }
            self.wait(STICKS_PERIOD_S, console, |_| false)?;
        }
    }

    /// Listens for so long, or until `is_enough`.
    pub(super) fn wait(
        &mut self,
        for_s: f64,
        console: &Console,
        is_enough: impl Fn(&Self) -> bool,
    ) -> Result<(), Stopped> {
        let until_s = self.t_s() + for_s;
        loop {
            self.receive();
            if console.asks_to_stop() || self.guard.has_failed() {
                return Err(Stopped);
            }
            if self.t_s() >= until_s || is_enough(self) {
                return Ok(());
            }
            thread::sleep(LOOK);
        }
    }

    /// Whether a take-off had its time and the drone reports now that the motors are off.
    fn is_over(&self) -> bool {
        let since_s = |at| self.clock.now().since(at).seconds();
        self.take_off_at.is_none_or(|at| since_s(at) > TAKE_OFF_TAIL.seconds())
            && self.status().is_some_and(|status| !status.is_running)
    }

    /// Neutral sticks and LAND until the drone is down. Without propellers, after 8 s in vain, or after one more
    /// Ctrl-C, `emergency` in turn with them.
    pub(super) fn end(&mut self, site: TestSite, console: &Console) {
        let mut ending = Ending::new(self.t_s(), site, console.interrupts());
        self.note(BenchEventKind::Step(ENDING.into()));
        self.guard.set(SenderState::Landing, self.clock.now());
        while !(ending.is_down || ending.is_given_up(self.t_s())) {
            let t_s = self.t_s();
            match ending.advance(t_s, console.interrupts()) {
                Some(EndingOrder::EmergencyStop) => self.send(Packet::Emergency),
                Some(EndingOrder::Land) => {
                    self.send(Packet::Sticks(Sticks::zeros()));
                    self.send_land();
                }
                None => {}
            }
            self.receive();
            ending.observe(t_s, self.is_over());
            thread::sleep(LOOK);
        }
        let Ending { began_s, is_down, .. } = ending;
        if is_down {
            self.guard.set(SenderState::Idle, self.clock.now());
        }
        let began_s = self.ending.map_or(began_s, |first| first.began_s);
        self.ending = Some(EndingReport { began_s, is_down });
    }

    fn ask_version(&mut self, sequence: u16) {
        match self.protocol {
            Protocol::Binary => self.send(Packet::Version(sequence)),
            Protocol::Text => {}
        }
    }

    fn count(&mut self) -> u16 {
        self.sequence = self.sequence.wrapping_add(1);
        self.sequence
    }

    fn send_land(&mut self) {
        let sequence = self.count();
        self.send(Packet::Land(sequence));
    }

    fn send(&mut self, packet: Packet) {
        self.send_by(|link| &link.socket, packet);
    }

    fn send_by_second(&mut self, packet: Packet) {
        self.send_by(|link| &link.second, packet);
    }

    fn send_by(&mut self, socket: impl Fn(&Self) -> &UdpSocket, packet: Packet) {
        let bytes = self.encode(packet);
        let error = socket(self).send_to(&bytes, self.address).err().map(|error| error.to_string());
        let (packet, sequence) = packet.name();
        self.note(BenchEventKind::Sent { packet, sequence, bytes: hex(&bytes), error });
    }

    fn encode(&self, packet: Packet) -> Vec<u8> {
        let now_ns = self.clock.utc_start_ns().saturating_add(self.clock.now().0);
        packet.encode(self.protocol, CivilTime::from_unix_ns(now_ns).time)
    }

    /// Listens for a moment, without a record, which would grow for as long as the person does not answer.
    pub(super) fn listen(&mut self) {
        let count = self.events.len();
        self.receive();
        self.events.truncate(count);
        thread::sleep(LOOK);
    }

    /// Whether the guardian has ordered a landing, or is lost: the check is over.
    pub(super) fn has_lost_guardian(&self) -> bool {
        self.guard.has_failed()
    }

    /// Writes down all that has arrived, and sends the guardian its heartbeat.
    fn receive(&mut self) {
        self.guard.turn(self.clock.now());
        let mut buffer = vec![0; DATAGRAM_BYTES_MAX];
        while let Some(bytes) = next(&self.socket, self.address, &mut buffer) {
            let what = wire::read(bytes, self.protocol);
            if let BenchEventKind::LogHeader { sequence, header_id } = what {
                self.send(Packet::LogHeaderAck(sequence, header_id));
            }
            self.record(what);
        }
        while let Some(bytes) =
            self.state_socket.as_ref().and_then(|socket| next(socket, self.address, &mut buffer))
        {
            let what = wire::read_state(bytes, &mut self.motor, self.clock.now());
            self.record(what);
        }
        while let Some(bytes) = next(&self.second, self.address, &mut buffer) {
            // Some drones report to the newest host alone: its status is as good.
            if let BenchEventKind::Status(status) = wire::read(bytes, self.protocol) {
                self.newest = Some((self.clock.now(), status));
            }
            self.note(BenchEventKind::AtSecond(hex(bytes)));
        }
    }

    /// Writes down the content of a datagram.
    fn record(&mut self, what: BenchEventKind) {
        match &what {
            BenchEventKind::Status(status) => self.newest = Some((self.clock.now(), *status)),
            BenchEventKind::Version { version, .. } => self.version = Some(version.clone()),
            _ => {}
        }
        self.note(what);
    }
}

/// A drone whose motors may run: landed when this goes out of scope, by whatever way.
#[derive(Debug)]
pub(super) struct Armed<'a> {
    link: &'a mut BenchConnection,
    site: TestSite,
    console: &'a Console,
}

impl<'a> Armed<'a> {
    pub(super) fn new(link: &'a mut BenchConnection, site: TestSite, console: &'a Console) -> Self {
        if site.spins() {
            link.guard.set(SenderState::Steering, link.clock.now());
        }
        Self { link, site, console }
    }

    /// Runs the steps until one is stopped.
    pub(super) fn run(&mut self, steps: &[Step]) -> Result<(), Stopped> {
        steps.iter().try_for_each(|step| self.link.take(step, self.console))
    }
}

impl Drop for Armed<'_> {
    fn drop(&mut self) {
        if self.site.spins() {
            self.link.end(self.site, self.console);
        }
    }
}

/// The next datagram of the drone at `socket`.
fn next<'a>(socket: &UdpSocket, drone: SocketAddr, buffer: &'a mut [u8]) -> Option<&'a [u8]> {
    loop {
        match socket.recv_from(buffer) {
            // State lines come from any port of the drone.
            Ok((length, from)) if from.ip() == drone.ip() => return buffer.get(..length),
            Ok(_) => {}
            Err(error) if error.kind() == ErrorKind::ConnectionRefused => {}
            Err(_) => return None,
        }
    }
}

#[cfg(test)]
pub(super) mod tests;
