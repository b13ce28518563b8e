//! The sockets of the drone and the control thread's handle to it.
//!
//! Moves bytes and approvals between sockets, [`Session`] and control thread. It decides nothing: what
//! is sent when is the session's.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use std::{io, iter};

use rtrb::{Consumer, Producer, RingBuffer};
use tello_flight::drone::DroneOrder;
use tello_flight::gate::Approved;
use thiserror::Error;
use tokio::net::UdpSocket;
use tokio::sync::{mpsc, watch};
use tokio::time::sleep;

use super::bind::{LinkError, bind_socket, failed};
use super::guardian::{BEAT_PERIOD, GuardianReport, GuardianSockets, Heartbeat};
use super::protocol::DATAGRAM_BYTES_MAX;
use super::session::Session;
use super::{DroneStatus, LinkCounters, TelloSettings};
use crate::clock::{Clock, TimeNs};
use crate::{EmergencyRequest, StopSignal};

/// Status packets come ten times a second and are drained every 20 ms.
const QUEUE_STATUSES: usize = 32;
const QUEUE_ORDERS: usize = 4;

/// A socket that fails at once must not keep the task busy.
const ERROR_PAUSE: Duration = Duration::from_millis(5);

/// Why an order was not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum OrderError {
    /// Earlier orders are not yet sent; try again at the next tick.
    #[error("the order was refused: {QUEUE_ORDERS} orders are already queued")]
    Busy,
    /// The link has ended.
    #[error("the link to the drone has ended")]
    Ended,
}

/// Sticks on their way from the control thread to the socket.
#[derive(Debug, Clone, Copy)]
struct HandedOver {
    approved: Approved,
    pose_is_airborne: Option<bool>,
    at: TimeNs,
}

/// The control thread's end of the link. Nothing here waits.
#[derive(Debug)]
pub struct DroneLink {
    clock: Clock,
    approved: watch::Sender<HandedOver>,
    orders: mpsc::Sender<DroneOrder>,
    statuses: Consumer<DroneStatus>,
    /// Counts of the task that owns the socket.
    pub counters: Arc<LinkCounters>,
}

impl DroneLink {
    /// Hands over the sticks to send; an unsent older value is replaced.
    ///
    /// They are repeated every 20 ms. Without a call for 100 ms the sticks become neutral, without
    /// one for 1 s the drone is landed. Once a landing is ordered, no sticks are sent any more but the
    /// neutral ones before each LAND.
    ///
    /// `pose_is_airborne`: what a fresh pose of the motion capture shows, in the air or on the floor;
    /// `None` if there is no fresh pose. It is the second source, beside the drone's status, of whether
    /// a landing has ended.
    pub fn send(&self, approved: Approved, pose_is_airborne: Option<bool>) {
        let at = self.clock.now();
        self.approved.send_replace(HandedOver { approved, pose_is_airborne, at });
    }

    /// Orders a take-off, sent again on another order only if it may be lost, a landing, repeated until the drone is
    /// down, or an emergency stop, repeated until the drone is down, with landings in between if it does not fall.
    /// There is no take-off after a landing, and no other order after an emergency stop.
    ///
    /// # Errors
    /// The queue of orders is full, or the link has ended.
    pub fn order(&self, order: DroneOrder) -> Result<(), OrderError> {
        self.orders.try_send(order).map_err(|error| match error {
            mpsc::error::TrySendError::Full(_) => OrderError::Busy,
            mpsc::error::TrySendError::Closed(_) => OrderError::Ended,
        })
    }

    /// The newest status since the last call. `None`: no status since the last call.
    pub fn poll_status(&mut self) -> Option<DroneStatus> {
        iter::from_fn(|| self.statuses.pop().ok()).last()
    }
}

/// The task that owns the socket.
#[derive(Debug)]
pub struct DroneClient {
    address: SocketAddr,
    clock: Clock,
    socket: std::net::UdpSocket,
    /// Where the text SDK's state line comes in.
    state_socket: Option<std::net::UdpSocket>,
    session: Session,
    approved: watch::Receiver<HandedOver>,
    orders: mpsc::Receiver<DroneOrder>,
    statuses: Producer<DroneStatus>,
    counters: Arc<LinkCounters>,
    protocol: super::Protocol,
    heartbeat: Heartbeat,
    emergency: EmergencyRequest,
}

impl DroneClient {
    /// Binds the sockets. With `is_dry_run` neither sticks nor orders are ever sent.
    ///
    /// # Errors
    /// The port is in use, the interface does not exist, or the system refuses otherwise.
    pub fn bind(
        settings: &TelloSettings,
        clock: Clock,
        is_dry_run: bool,
    ) -> Result<(Self, DroneLink), LinkError> {
        let socket = bind_socket(settings, "local_port", settings.local_port)?;
        let (approved, at) = (Approved::neutral(), clock.now());
        let nothing = HandedOver { approved, pose_is_airborne: None, at };
        let (approved_in, approved_out) = watch::channel(nothing);
        let (orders_in, orders_out) = mpsc::channel(QUEUE_ORDERS);
        let (statuses_in, statuses_out) = RingBuffer::new(QUEUE_STATUSES);
        let counters = Arc::new(LinkCounters::default());
        let (session, state_socket) = match settings.protocol {
            super::Protocol::Binary => {
                let (utc_start_ns, limit_m) = (clock.utc_start_ns(), settings.altitude_limit_m);
                (Session::binary(utc_start_ns, limit_m, is_dry_run, Arc::clone(&counters)), None)
            }
            super::Protocol::Text => {
                let socket = bind_socket(settings, "state_port", settings.state_port)?;
                let local = socket.local_addr().map_err(failed("read the state port"))?;
                (Session::text(local.port(), is_dry_run, Arc::clone(&counters)), Some(socket))
            }
        };
        let client = Self {
            address: settings.address,
            clock,
            socket,
            state_socket,
            session,
            approved: approved_out,
            orders: orders_out,
            statuses: statuses_in,
            counters: Arc::clone(&counters),
            protocol: settings.protocol,
            heartbeat: Heartbeat::default(),
            emergency: EmergencyRequest::default(),
        };
        let link = DroneLink {
            clock,
            approved: approved_in,
            orders: orders_in,
            statuses: statuses_out,
            counters,
        };
        Ok((client, link))
    }

    /// Starts a guardian as [`Heartbeat::start_guardian`]; in a dry run there is nothing to guard.
    ///
    /// # Errors
    /// As [`Heartbeat::start_guardian`].
    pub fn start_guardian<T>(
        &mut self,
        start: impl FnOnce(GuardianSockets) -> io::Result<T>,
    ) -> Result<T, LinkError> {
        let (heartbeat, started) =
            Heartbeat::start_guardian(&self.socket, self.address, self.protocol, start)
                .map_err(failed("start the guardian"))?;
        self.heartbeat = heartbeat;
        Ok(started)
    }

    /// Executes an emergency stop also while no orders come from the control thread.
    pub fn obey(&mut self, emergency: EmergencyRequest) {
        self.emergency = emergency;
    }

    /// Talks to the drone until it is stopped. A drone that may fly is landed before the end: that lasts until its
    /// status and the poses show it down, and 15 s at most.
    ///
    /// # Errors
    /// The runtime does not accept the socket. A drone that is silent, and a network that comes and
    /// goes, are no errors: the link asks for a connection every 2 s.
    pub async fn run(self, mut stop: StopSignal) -> Result<(), LinkError> {
        let Self { mut approved, mut orders, clock, address, counters, .. } = self;
        let usable = |socket| UdpSocket::from_std(socket).map_err(failed("use the UDP socket"));
        let socket = usable(self.socket)?;
        let state_socket = self.state_socket.map(usable).transpose()?;
        let mut sender = Sender {
            clock,
            session: self.session,
            wire: Wire { socket, state_socket, address, counters, bytes: Vec::new() },
            heartbeat: self.heartbeat,
            emergency: self.emergency,
            handed_over_at: None,
        };
        let mut statuses = self.statuses;
        let mut datagram = vec![0; DATAGRAM_BYTES_MAX];
        let mut state_line = vec![0; DATAGRAM_BYTES_MAX];
        let mut is_stopped = false;
        while !sender.session.is_over(clock.now()) {
            // After every event, so that a flood of one kind cannot hold up what is due.
            sender.send_due().await;
            let Sender { session, wire, .. } = &mut sender;
            let wait = session.next_deadline().since(clock.now()).min(BEAT_PERIOD).duration();
            // An ended control thread closes both channels; their branches are then disabled and the
            // session's watchdog lands the drone.
            tokio::select! {
                biased;
                () = stop.ordered(), if !is_stopped => {
                    is_stopped = true;
                    session.stop(clock.now());
                }
                Some(order) = orders.recv() => {
                    session.order(order, clock.now());
                }
                Ok(()) = approved.changed() => {
                    let newest = *approved.borrow_and_update();
                    sender.take(newest);
                }
                bytes = wire.receive(&mut datagram) => {
                    let status = session.receive(bytes, clock.now());
                    wire.hand_on(status, &mut statuses);
                }
                bytes = wire.receive_state(&mut state_line) => {
                    let status = session.receive_state(bytes, clock.now());
                    wire.hand_on(status, &mut statuses);
                }
                () = sleep(wait) => {}
            }
        }
        sender.heartbeat.end();
        Ok(())
    }
}

/// What decides and sends, between two events.
#[derive(Debug)]
struct Sender {
    clock: Clock,
    session: Session,
    wire: Wire,
    heartbeat: Heartbeat,
    emergency: EmergencyRequest,
    /// When the control thread handed over the newest sticks, until they are sent.
    handed_over_at: Option<TimeNs>,
}

impl Sender {
    /// Obeys guardian and emergency stop, then sends what is due.
    async fn send_due(&mut self) {
        let Self { clock, session, wire, heartbeat, emergency, handed_over_at } = self;
        // Before anything is decided or sent: this program may have been stopped and the drone landed.
        wire.ask_guardian(heartbeat, session, clock.now());
        if emergency.take() {
            session.order(DroneOrder::EmergencyStop, clock.now());
        }
        session.advance(clock.now());
        heartbeat.beat(session.sender_state(clock.now()), clock.now());
        let Sent { any, all } = wire.send_all(session).await;
        if let Some(at) = handed_over_at.take().filter(|_| any) {
            wire.counters.note_sticks_latency(clock.now().since(at));
        }
        if !all {
            session.note_refused(clock.now());
        }
    }

    /// Takes sticks and pose of the control thread.
    fn take(&mut self, newest: HandedOver) {
        self.session.observe_pose(newest.pose_is_airborne, newest.at);
        self.session.approve(newest.approved, newest.at, self.clock.now());
        self.handed_over_at = Some(newest.at);
    }
}

/// Result of sending packets.
struct Sent {
    /// Whether there were any packets.
    any: bool,
    /// Whether the system took all of them.
    all: bool,
}

/// The socket and the address of the drone.
#[derive(Debug)]
struct Wire {
    socket: UdpSocket,
    state_socket: Option<UdpSocket>,
    address: SocketAddr,
    counters: Arc<LinkCounters>,
    /// The packet that is being sent.
    bytes: Vec<u8>,
}

impl Wire {
    /// Asks whether the guardian has ordered a landing, and goes on with the landing if it has. If the guardian is
    /// lost, no process would land the drone in place of this task: it lands the drone now.
    fn ask_guardian(&self, heartbeat: &mut Heartbeat, session: &mut Session, now: TimeNs) {
        self.counters.note_pause(heartbeat.pause(now));
        match heartbeat.report(now) {
            GuardianReport::Continue => {}
            GuardianReport::LandingOrdered { is_steered } => {
                if is_steered {
                    self.counters.guardian_landings.count();
                }
                session.adopt_landing(now);
            }
            GuardianReport::Gone => {
                self.counters.guardians_lost.count();
                session.adopt_landing(now);
            }
        }
    }

    /// Sends what the session has decided. A datagram that the system does not take is lost, as it might
    /// be in the air.
    async fn send_all(&mut self, session: &mut Session) -> Sent {
        let mut result = Sent { any: false, all: true };
        for packet in session.drain() {
            result.any = true;
            packet.encode(&mut self.bytes);
            let sent = self.socket.send_to(&self.bytes, self.address);
            if !matches!(tokio::time::timeout(ERROR_PAUSE, sent).await, Ok(Ok(_))) {
                result.all = false;
                self.counters.socket_errors.count();
            }
        }
        result
    }

    /// The next datagram of the drone. Safe to cancel.
    async fn receive<'a>(&self, buffer: &'a mut [u8]) -> &'a [u8] {
        self.receive_from(&self.socket, |from| from == self.address, buffer).await
    }

    /// The next state line, which may come from any port of the drone; never, in the binary protocol.
    /// Safe to cancel.
    async fn receive_state<'a>(&self, buffer: &'a mut [u8]) -> &'a [u8] {
        match &self.state_socket {
            Some(socket) => {
                self.receive_from(socket, |from| from.ip() == self.address.ip(), buffer).await
            }
            None => std::future::pending().await,
        }
    }

    async fn receive_from<'a>(
        &self,
        socket: &UdpSocket,
        is_drone: impl Fn(SocketAddr) -> bool,
        buffer: &'a mut [u8],
    ) -> &'a [u8] {
        loop {
            match socket.recv_from(buffer).await {
                Ok((count, from)) if is_drone(from) => {
                    return buffer.get(..count).unwrap_or_default();
                }
                Ok(_) => self.counters.malformed.count(),
                Err(_) => {
                    self.counters.socket_errors.count();
                    sleep(ERROR_PAUSE).await;
                }
            }
        }
    }

    /// Gives a status to the control thread.
    fn hand_on(&self, status: Option<DroneStatus>, to: &mut Producer<DroneStatus>) {
        if status.is_some_and(|status| to.push(status).is_err()) {
            self.counters.overflow.count();
        }
    }
}

#[cfg(test)]
mod tests;
