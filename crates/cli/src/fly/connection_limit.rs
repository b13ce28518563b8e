//! A listener that limits the connections of viewers: their number, their duration and how many are accepted in a
//! second. The flight needs the same file handles and processors.
//!
//! If the limit is reached, the oldest connection of the peer that has most of them is closed, so that idle connections
//! cannot block others.

use std::collections::BTreeMap;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use axum::extract::connect_info::Connected;
use axum::serve::{IncomingStream, Listener};
use parking_lot::Mutex;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::oneshot;
use tokio::time::{Interval, MissedTickBehavior, Sleep, interval, sleep};

/// Bounds of the connections.
#[derive(Debug, Clone, Copy)]
pub(super) struct ConnectionLimit {
    /// Largest number of connections that were not released, at least one.
    pub(super) count: usize,
    /// Time from the acceptance of a connection to its release or its last byte.
    pub(super) time: Option<Duration>,
}

/// Time between two accepted connections: bounds the load of a peer that connects again and again.
const ACCEPT_PERIOD: Duration = Duration::from_millis(10);

/// The connections under the limit, each with the sender whose drop closes it.
#[derive(Debug)]
struct OpenConnections {
    count_max: usize,
    newest: u64,
    /// By their numbers, and so by their age.
    inside: BTreeMap<u64, (IpAddr, oneshot::Sender<()>)>,
}

type SharedConnections = Arc<Mutex<OpenConnections>>;

impl OpenConnections {
    fn new(count_max: usize) -> Self {
        Self { count_max, newest: 0, inside: BTreeMap::new() }
    }

    /// Adds a connection, if need be in the place of another. Its number, and what signals its end.
    fn enter(&mut self, peer: IpAddr) -> (u64, oneshot::Receiver<()>) {
        if self.inside.len() >= self.count_max
            && let Some(number) = self.oldest_of_busiest_peer()
        {
            // Dropping the sender closes it.
            self.inside.remove(&number);
        }
        self.newest += 1;
        let (go, goes) = oneshot::channel();
        self.inside.insert(self.newest, (peer, go));
        (self.newest, goes)
    }

    /// The oldest connection of the peer that has most.
    fn oldest_of_busiest_peer(&self) -> Option<u64> {
        let count = |peer: &IpAddr| self.inside.values().filter(|(other, _)| other == peer).count();
        let most = self.inside.values().map(|(peer, _)| count(peer)).max()?;
        self.inside.iter().find(|(_, (peer, _))| count(peer) == most).map(|(number, _)| *number)
    }
}

/// A listener whose connections stay within a [`ConnectionLimit`].
pub(super) struct LimitedListener {
    listener: TcpListener,
    time: Option<Duration>,
    shared: SharedConnections,
    pace: Interval,
}

/// A connection.
pub(super) struct LimitedStream {
    stream: TcpStream,
    handle: LimitHandle,
    /// `None` once it was released.
    limit: Option<RequestLimit>,
}

struct RequestLimit {
    over: Option<Pin<Box<Sleep>>>,
    is_closed: oneshot::Receiver<()>,
}

/// Takes a connection out of the limit.
#[derive(Debug, Clone)]
pub(super) struct LimitHandle {
    number: u64,
    shared: SharedConnections,
}

impl LimitedListener {
    /// Needs the runtime of the calling thread.
    pub(super) fn new(listener: TcpListener, limit: ConnectionLimit) -> Self {
        let mut pace = interval(ACCEPT_PERIOD);
        pace.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let shared = Arc::new(Mutex::new(OpenConnections::new(limit.count)));
        Self { listener, time: limit.time, shared, pace }
    }
}

impl Listener for LimitedListener {
    type Io = LimitedStream;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (LimitedStream, SocketAddr) {
        self.pace.tick().await;
        let (stream, address) = Listener::accept(&mut self.listener).await;
        // Facts are sent as they come: without Nagle's delay.
        stream.set_nodelay(true).ok();
        let (number, is_closed) = self.shared.lock().enter(address.ip());
        let handle = LimitHandle { number, shared: Arc::clone(&self.shared) };
        let over = self.time.map(|time| Box::pin(sleep(time)));
        let limit = RequestLimit { over, is_closed };
        (LimitedStream { stream, handle, limit: Some(limit) }, address)
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

impl Connected<IncomingStream<'_, LimitedListener>> for LimitHandle {
    fn connect_info(stream: IncomingStream<'_, LimitedListener>) -> Self {
        stream.io().handle.clone()
    }
}

impl LimitHandle {
    /// The connection is outside of the limit from now on: its caller bounds it.
    pub(super) fn release(&self) {
        if let Some((_, go)) = self.shared.lock().inside.remove(&self.number) {
            go.send(()).ok();
        }
    }
}

impl LimitedStream {
    /// Fails once the time is over or the connection was closed for another one.
    fn poll_limit(&mut self, context: &mut Context<'_>) -> io::Result<()> {
        let Some(limit) = &mut self.limit else { return Ok(()) };
        match Pin::new(&mut limit.is_closed).poll(context) {
            Poll::Ready(Ok(())) => {
                self.limit = None;
                return Ok(());
            }
            Poll::Ready(Err(_)) => return Err(io::ErrorKind::ConnectionAborted.into()),
            Poll::Pending => {}
        }
        match limit.over.as_mut().map(|over| over.as_mut().poll(context)) {
            Some(Poll::Ready(())) => Err(io::ErrorKind::TimedOut.into()),
            Some(Poll::Pending) | None => Ok(()),
        }
    }
}

impl Drop for LimitedStream {
    fn drop(&mut self) {
        self.handle.shared.lock().inside.remove(&self.handle.number);
    }
}

impl AsyncRead for LimitedStream {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        self.poll_limit(context)?;
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl AsyncWrite for LimitedStream {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        self.poll_limit(context)?;
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.poll_limit(context)?;
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.poll_limit(context)?;
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;

    const COUNT_MAX: usize = 24;

    fn peer(last: u8) -> IpAddr {
        Ipv4Addr::new(10, 0, 0, last).into()
    }

    #[test]
    fn many_connections_from_one_address_keep_no_other_out() {
        let mut open = OpenConnections::new(COUNT_MAX);
        let (_, mut first) = open.enter(peer(1));
        let mut crowd: Vec<_> = (0..COUNT_MAX - 1).map(|_| open.enter(peer(2)).1).collect();
        assert!(crowd[0].try_recv().is_err_and(|e| e == oneshot::error::TryRecvError::Empty));
        for _ in 0..COUNT_MAX {
            let (_, go) = open.enter(peer(2));
            crowd.push(go);
            assert_eq!(open.inside.len(), COUNT_MAX);
        }
        // The oldest viewer, and the only one of its address.
        assert_eq!(first.try_recv(), Err(oneshot::error::TryRecvError::Empty));
        let gone = crowd.iter_mut().map(oneshot::Receiver::try_recv);
        let gone = gone.take_while(|go| *go == Err(oneshot::error::TryRecvError::Closed)).count();
        assert_eq!(gone, COUNT_MAX, "the oldest of the crowd go first");
    }

    #[test]
    fn a_place_is_free_again_when_its_connection_is_released() {
        let shared = Arc::new(Mutex::new(OpenConnections::new(COUNT_MAX)));
        let (number, mut goes) = shared.lock().enter(peer(1));
        LimitHandle { number, shared: Arc::clone(&shared) }.release();
        assert_eq!(goes.try_recv(), Ok(()));
        assert!(shared.lock().inside.is_empty());
    }
}
