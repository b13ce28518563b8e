//! A listener for connections that are not yet sockets of watchers: few at a time, for a short time, and so many
//! a second. Sockets are files, and processors are shared, and the flight needs both.
//!
//! Whoever is slow makes room: a connection has seconds for its one request and the answer, and if all places are
//! taken the oldest of the peer that has most of them goes. Idle connections keep nobody out.

use std::collections::BTreeMap;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::extract::connect_info::Connected;
use axum::serve::{IncomingStream, Listener};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::oneshot;
use tokio::time::{Interval, MissedTickBehavior, Sleep, interval, sleep};

/// Connections at a time that no watcher has yet.
const VISITORS: usize = 24;

/// How long a visitor has from the first byte of his request to the last of the answer.
const VISIT: Duration = Duration::from_secs(3);

/// Time between two that are let in. Each has one request: what a flood can make this machine do is
/// bounded.
const BETWEEN: Duration = Duration::from_millis(10);

/// Who is in, and how to show him out.
#[derive(Debug, Default)]
struct Visitors {
    newest: u64,
    /// By their numbers, and so by their age.
    inside: BTreeMap<u64, (IpAddr, oneshot::Sender<()>)>,
}

type Lobby = Arc<Mutex<Visitors>>;

fn lock(lobby: &Lobby) -> MutexGuard<'_, Visitors> {
    lobby.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Visitors {
    /// Lets one in, if need be in the place of another. His number, and what tells him to go.
    fn enter(&mut self, peer: IpAddr) -> (u64, oneshot::Receiver<()>) {
        if self.inside.len() >= VISITORS
            && let Some(number) = self.in_the_way()
        {
            // Dropped, the sender tells him.
            self.inside.remove(&number);
        }
        self.newest += 1;
        let (go, goes) = oneshot::channel();
        self.inside.insert(self.newest, (peer, go));
        (self.newest, goes)
    }

    /// The oldest of the peer that has most.
    fn in_the_way(&self) -> Option<u64> {
        let count = |peer: &IpAddr| self.inside.values().filter(|(other, _)| other == peer).count();
        let most = self.inside.values().map(|(peer, _)| count(peer)).max()?;
        self.inside.iter().find(|(_, (peer, _))| count(peer) == most).map(|(number, _)| *number)
    }
}

/// A listener that lets in at most [`VISITORS`].
pub(super) struct Door {
    listener: TcpListener,
    lobby: Lobby,
    pace: Interval,
}

/// A connection.
pub(super) struct Guest {
    stream: TcpStream,
    ticket: Ticket,
    /// Its time as a visitor; nothing once it is a watcher's.
    visit: Option<Visit>,
}

struct Visit {
    over: Pin<Box<Sleep>>,
    is_shown_out: oneshot::Receiver<()>,
}

/// What makes a watcher's of a visitor's connection.
#[derive(Debug, Clone)]
pub(super) struct Ticket {
    number: u64,
    lobby: Lobby,
}

impl Door {
    /// Needs the runtime of the calling thread.
    pub(super) fn new(listener: TcpListener) -> Self {
        let mut pace = interval(BETWEEN);
        pace.set_missed_tick_behavior(MissedTickBehavior::Delay);
        Self { listener, lobby: Lobby::default(), pace }
    }
}

impl Listener for Door {
    type Io = Guest;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Guest, SocketAddr) {
        self.pace.tick().await;
        let (stream, address) = Listener::accept(&mut self.listener).await;
        // What is shown is worth nothing a moment later.
        stream.set_nodelay(true).ok();
        let (number, is_shown_out) = lock(&self.lobby).enter(address.ip());
        let ticket = Ticket { number, lobby: Arc::clone(&self.lobby) };
        let visit = Visit { over: Box::pin(sleep(VISIT)), is_shown_out };
        (Guest { stream, ticket, visit: Some(visit) }, address)
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

impl Connected<IncomingStream<'_, Door>> for Ticket {
    fn connect_info(stream: IncomingStream<'_, Door>) -> Self {
        stream.io().ticket.clone()
    }
}

impl Ticket {
    /// The connection is a watcher's from now on: others bound it.
    pub(super) fn stay(&self) {
        if let Some((_, go)) = lock(&self.lobby).inside.remove(&self.number) {
            go.send(()).ok();
        }
    }
}

impl Guest {
    /// Fails once the visit is over.
    fn poll_visit(&mut self, context: &mut Context<'_>) -> io::Result<()> {
        let Some(visit) = &mut self.visit else { return Ok(()) };
        match Pin::new(&mut visit.is_shown_out).poll(context) {
            Poll::Ready(Ok(())) => {
                self.visit = None;
                return Ok(());
            }
            Poll::Ready(Err(_)) => return Err(io::ErrorKind::ConnectionAborted.into()),
            Poll::Pending => {}
        }
        match visit.over.as_mut().poll(context) {
            Poll::Ready(()) => Err(io::ErrorKind::TimedOut.into()),
            Poll::Pending => Ok(()),
        }
    }
}

impl Drop for Guest {
    fn drop(&mut self) {
        lock(&self.ticket.lobby).inside.remove(&self.ticket.number);
    }
}

impl AsyncRead for Guest {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        self.poll_visit(context)?;
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl AsyncWrite for Guest {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        self.poll_visit(context)?;
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.poll_visit(context)?;
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.poll_visit(context)?;
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;

    fn peer(last: u8) -> IpAddr {
        Ipv4Addr::new(10, 0, 0, last).into()
    }

    #[test]
    fn a_crowd_from_one_address_keeps_nobody_out() {
        let mut visitors = Visitors::default();
        let (_, mut first) = visitors.enter(peer(1));
        let mut crowd: Vec<_> = (0..VISITORS - 1).map(|_| visitors.enter(peer(2)).1).collect();
        assert!(crowd[0].try_recv().is_err_and(|e| e == oneshot::error::TryRecvError::Empty));
        for _ in 0..VISITORS {
            let (_, go) = visitors.enter(peer(2));
            crowd.push(go);
            assert_eq!(visitors.inside.len(), VISITORS);
        }
        // He is the oldest, and the only one of his address.
        assert_eq!(first.try_recv(), Err(oneshot::error::TryRecvError::Empty));
        let gone = crowd.iter_mut().map(oneshot::Receiver::try_recv);
        let gone = gone.take_while(|go| *go == Err(oneshot::error::TryRecvError::Closed)).count();
        assert_eq!(gone, VISITORS, "the oldest of the crowd go first");
    }

    #[test]
    fn a_place_is_free_again_when_its_connection_is_a_watchers() {
        let lobby = Lobby::default();
        let (number, mut goes) = lock(&lobby).enter(peer(1));
        Ticket { number, lobby: Arc::clone(&lobby) }.stay();
        assert_eq!(goes.try_recv(), Ok(()));
        assert!(lock(&lobby).inside.is_empty());
    }
}
