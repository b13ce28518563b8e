//! The world behind the sockets of a real Tello and a real motion capture system.
//!
//! Owns the thread that lives through the world in real time: every 20 ms it hears what was sent to
//! the drone, advances the world and speaks. A command heard between two steps acts in the next one,
//! as in virtual time. Sockets are polled, never waited for, so that the rate is the ticker's alone.
//! The thread is the emulator's own, beside the flight's; it allocates.

mod clients;
mod datastream;
mod drone;
mod mocap;
mod natnet;
mod object_stream;
mod qtm;
mod vrpn;

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use parking_lot::Mutex;
use tello_io::clock::{Clock, SpanNs, Ticker, TickerError, TimeNs};
use thiserror::Error;

use crate::drone::Truth;
use crate::fault::InjectedFault;
use crate::frames;
use crate::mocap::MocapFrame;
use crate::world::World;
use drone::DronePort;
pub use mocap::{MocapAddresses, MocapServers};
pub use natnet::NatnetServer;

/// [`crate::DT_S`] on the clock.
const PERIOD: SpanNs = SpanNs::from_ms(20);

/// Why there is no emulator.
#[derive(Debug, Error)]
pub enum EmulatorError {
    /// An address is taken, not ours, or not permitted.
    #[error(
        "the emulated {what} cannot use {address}; \
         stop what uses it, or choose another address (port 0 takes a free one)"
    )]
    Bind {
        /// Which part.
        what: &'static str,
        /// The address as asked for.
        address: SocketAddr,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The system gives no clock to tick by.
    #[error(transparent)]
    Ticker(#[from] TickerError),
    /// The system gives no thread.
    #[error("the emulator's thread cannot start")]
    Thread(#[source] io::Error),
}

/// A running emulator; dropping it stops it and closes its sockets.
#[derive(Debug)]
pub struct Emulator {
    drone_address: SocketAddr,
    mocap: MocapAddresses,
    world: Arc<Mutex<World>>,
    is_stopping: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<(), TickerError>>>,
}

impl Emulator {
    /// Starts `world` with its drone on UDP and its motion capture as in `mocap`; port 0 takes a free
    /// port.
    ///
    /// # Errors
    /// An address that cannot be bound, no clock or no thread.
    pub fn start(
        world: World,
        drone_address: SocketAddr,
        mocap: MocapAddresses,
    ) -> Result<Self, EmulatorError> {
        let refused =
            |address| move |source| EmulatorError::Bind { what: "drone", address, source };
        let drone = DronePort::bind(drone_address, &world).map_err(refused(drone_address))?;
        let drone_address = drone.address().map_err(refused(drone_address))?;
        let servers = MocapServers::bind(mocap)?;
        let mocap = servers.addresses();
        let world = Arc::new(Mutex::new(world));
        let is_stopping = Arc::new(AtomicBool::new(false));
        let clock = Clock::start();
        let world_thread = WorldThread {
            clock,
            ticker: Ticker::new(clock, PERIOD),
            world: Arc::clone(&world),
            is_stopping: Arc::clone(&is_stopping),
            drone,
            servers,
        };
        let thread = std::thread::Builder::new()
            .name("sim-world".into())
            .spawn(move || world_thread.live())
            .map_err(EmulatorError::Thread)?;
        Ok(Self { drone_address, mocap, world, is_stopping, thread: Some(thread) })
    }

    /// Where the drone listens. UDP.
    pub fn drone_address(&self) -> SocketAddr {
        self.drone_address
    }

    /// Addresses of the emulated motion capture.
    pub fn mocap(&self) -> MocapAddresses {
        self.mocap
    }

    /// The drone as it really is, now.
    pub fn truth(&self) -> Truth {
        self.world.lock().truth()
    }

    /// Switches a fault on or off, from the next step on.
    pub fn set_fault(&self, fault: InjectedFault, is_on: bool) {
        self.world.lock().set_fault(fault, is_on);
    }

    /// Stops the world and closes its sockets.
    ///
    /// # Errors
    /// The clock failed and the world has stood still since.
    pub fn stop(mut self) -> Result<(), EmulatorError> {
        Ok(self.finish()?)
    }

    fn finish(&mut self) -> Result<(), TickerError> {
        self.is_stopping.store(true, Ordering::Relaxed);
        // A thread that ended by a bug has printed it already.
        self.thread.take().and_then(|thread| thread.join().ok()).unwrap_or(Ok(()))
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        // A caller that wants to know calls `stop`.
        self.finish().ok();
    }
}

/// State of the thread that advances the world.
struct WorldThread {
    clock: Clock,
    ticker: Ticker,
    world: Arc<Mutex<World>>,
    is_stopping: Arc<AtomicBool>,
    drone: DronePort,
    servers: MocapServers,
}

impl WorldThread {
    /// Runs until it is stopped, or until the clock fails.
    fn live(mut self) -> Result<(), TickerError> {
        while !self.is_stopping.load(Ordering::Relaxed) {
            let beat = self.ticker.wait()?;
            let mut world = self.world.lock();
            self.drone.receive(&mut world);
            // Time that was missed has passed for the drone, too.
            for _ in 0..=beat.skipped {
                world.advance();
            }
            self.drone.report(&mut world);
            if !world.has_frame_by_step() {
                drop(world);
                self.show_between(beat.due);
                continue;
            }
            // The sockets only take what they can at once: the world is not held up.
            let passer = world.frame_of_passer();
            self.servers.push_with(world.frames(), passer.and_then(|frame| frame.body));
            if let Some(frame) = passer {
                self.servers.push_to_relay(&frame);
            }
        }
        Ok(())
    }

    /// Sends the frames of a step that began at `due`: those of the step itself at their times, late ones at once.
    fn show_between(&mut self, due: TimeNs) {
        let (rate_hz, step) = {
            let world = self.world.lock();
            let rate_hz = world.mocap_rate_hz;
            for (frame, change) in world.moving_frames() {
                if u64::from(frame.number) == world.step() {
                    continue;
                }
                for number in frames::numbers(frame.number, rate_hz) {
                    self.servers.push([frames::moved(frame, number, rate_hz, &change)]);
                }
            }
            (rate_hz, world.step())
        };
        // Frame numbers of 32 bits last for years.
        let Ok(step) = u32::try_from(step) else { return };
        for number in frames::numbers(step, rate_hz) {
            let offset = SpanNs::from_seconds(frames::offset_s(number, step, rate_hz));
            std::thread::sleep(due.after(offset).since(self.clock.now()).duration());
            let world = self.world.lock();
            let of_step = |(frame, _): &(MocapFrame<'_>, _)| frame.number == step;
            let as_frame = |(frame, change)| frames::moved(frame, number, rate_hz, &change);
            let passer =
                world.frame_of_passer().map(|frame| MocapFrame { number, rate_hz, ..frame });
            let other = passer.and_then(|frame| frame.body);
            self.servers.push_with(world.moving_frames().filter(of_step).map(as_frame), other);
            if let Some(frame) = passer {
                self.servers.push_to_relay(&frame);
            }
        }
    }
}

#[cfg(test)]
mod tests;
