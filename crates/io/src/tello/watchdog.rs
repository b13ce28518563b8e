//! Lands the drone when the task that talks to it has fallen silent.
//!
//! Owns a thread, a copy of the socket and two packets, and needs neither runtime nor session: it stands
//! when the task has panicked, or something blocks the thread that it runs on. The sender says each time
//! by when it will speak again; who is late by a fifth of a second is taken to be dead. A sender that
//! comes back finds the landing ordered and goes on with it.

use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use crate::clock::{Clock, SpanNs, TimeNs};

/// How late the sender may be before it is looked at a second time.
const GRACE: SpanNs = SpanNs::from_ms(150);
/// Between two looks. If the whole process stood still the sender speaks in this time.
const LOOK_PERIOD: Duration = Duration::from_millis(50);
const LAND_PERIOD: Duration = Duration::from_millis(500);
/// Landings until the drone's own net is as good: 15 s.
const LANDINGS_MAX: u32 = 30;

/// Of a sender with nothing to guard.
const NEVER: i64 = i64::MAX;

/// Packets that need nobody to build them any more.
#[derive(Debug, Clone)]
pub(super) struct LastWords {
    /// All sticks at rest.
    pub(super) neutral: Vec<u8>,
    /// The order to land.
    pub(super) land: Vec<u8>,
}

/// What the sender tells the watchdog, and hears from it.
#[derive(Debug)]
pub(super) struct Heart {
    /// When the sender will have spoken at the latest; [`NEVER`] if no drone depends on it. ns
    due_ns: AtomicI64,
    is_over: AtomicBool,
    has_landed: AtomicBool,
}

impl Heart {
    pub(super) fn new() -> Self {
        Self {
            due_ns: AtomicI64::new(NEVER),
            is_over: AtomicBool::new(false),
            has_landed: AtomicBool::new(false),
        }
    }

    /// The sender lives and will speak again by `due`, or nothing depends on it.
    pub(super) fn beat(&self, due: Option<TimeNs>) {
        self.due_ns.store(due.map_or(NEVER, |due| due.0), Ordering::SeqCst);
    }

    /// The sender has ended as it should.
    pub(super) fn end(&self) {
        self.is_over.store(true, Ordering::SeqCst);
    }

    /// Whether the watchdog has ordered a landing since the last call.
    pub(super) fn has_landed(&self) -> bool {
        self.has_landed.swap(false, Ordering::SeqCst)
    }

    /// The promise that was broken at `now`, if one was.
    fn broken(&self, now: TimeNs) -> Option<i64> {
        let due_ns = self.due_ns.load(Ordering::SeqCst);
        (due_ns != NEVER && now.since(TimeNs(due_ns)) > GRACE).then_some(due_ns)
    }
}

/// The thread that watches the sender. Dropping it waits until the drone was told to land, if nobody
/// else does so any more: for 15 s at most.
#[derive(Debug)]
pub struct Watchdog {
    is_dropped: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Watchdog {
    /// Starts the thread.
    ///
    /// # Errors
    /// The system gives no thread.
    pub(super) fn start(
        socket: UdpSocket,
        address: SocketAddr,
        words: LastWords,
        heart: Arc<Heart>,
        clock: Clock,
    ) -> io::Result<Self> {
        let is_dropped = Arc::new(AtomicBool::new(false));
        let guard = Guard { socket, address, words, heart, clock, is_dropped: is_dropped.clone() };
        let thread =
            thread::Builder::new().name("tello-watchdog".into()).spawn(move || guard.watch())?;
        Ok(Self { is_dropped, thread: Some(thread) })
    }
}

impl Drop for Watchdog {
    fn drop(&mut self) {
        self.is_dropped.store(true, Ordering::SeqCst);
        // Its own panic has been printed; there is nobody left to land.
        self.thread.take().map(JoinHandle::join);
    }
}

/// What the thread owns.
struct Guard {
    socket: UdpSocket,
    address: SocketAddr,
    words: LastWords,
    heart: Arc<Heart>,
    clock: Clock,
    is_dropped: Arc<AtomicBool>,
}

impl Guard {
    fn watch(self) {
        let mut suspected = None;
        while !self.heart.is_over.load(Ordering::SeqCst) {
            thread::sleep(LOOK_PERIOD);
            let broken = self.heart.broken(self.clock.now());
            if broken.is_some() && broken == suspected {
                self.land();
            }
            // With the sender alive or nothing in the air, whoever drops us need not wait.
            if self.is_dropped.load(Ordering::SeqCst) && !self.is_promised() {
                return;
            }
            suspected = broken;
        }
    }

    fn is_promised(&self) -> bool {
        self.heart.due_ns.load(Ordering::SeqCst) != NEVER
    }

    /// Levels the sticks and lands, until the sender is back.
    fn land(&self) {
        self.send(&self.words.neutral);
        for _ in 0..LANDINGS_MAX {
            // Before the packet: a sender that wakes up now must not cancel it by sticks.
            self.heart.has_landed.store(true, Ordering::SeqCst);
            self.send(&self.words.land);
            thread::sleep(LAND_PERIOD);
            if self.heart.broken(self.clock.now()).is_none() {
                return;
            }
        }
        // The drone has been on the ground for long.
        self.heart.beat(None);
    }

    fn send(&self, packet: &[u8]) {
        // A socket that takes nothing now may do so at the next repetition.
        self.socket.send_to(packet, self.address).ok();
    }
}
