//! Clients of a TCP server that is polled.
//!
//! Owns the connections. No client can hold up another or the world: nothing here waits, and a client
//! that does not read is dropped.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};

/// Unsent bytes at which a client counts as stuck: seconds of lines.
const BACKLOG_MAX_BYTES: usize = 64 * 1024;
/// Clients that connect beyond this are turned away.
const CLIENTS_MAX: usize = 16;
/// Most that is heard of one client at a time.
const CHUNK_BYTES: usize = 4096;

/// The listening socket and its clients, each with a state of its own.
#[derive(Debug)]
pub(super) struct Clients<S> {
    listener: TcpListener,
    /// Sent to each client first.
    greeting: Vec<u8>,
    connected: Vec<Client<S>>,
}

#[derive(Debug)]
struct Client<S> {
    stream: TcpStream,
    /// Bytes that the socket did not take yet.
    backlog: Vec<u8>,
    state: S,
}

impl<S: Default> Clients<S> {
    /// Listens on `address`; `greeting` is sent to each client first.
    pub(super) fn bind(address: SocketAddr, greeting: Vec<u8>) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        Ok(Self { listener, greeting, connected: Vec::new() })
    }

    /// Where clients connect to.
    pub(super) fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Accepts new clients.
    pub(super) fn accept(&mut self) {
        while let Ok((stream, _)) = self.listener.accept() {
            // A client whose socket cannot be set up is turned away, like one too many.
            let is_ready = stream.set_nonblocking(true).and(stream.set_nodelay(true)).is_ok();
            if is_ready && self.connected.len() < CLIENTS_MAX {
                let backlog = self.greeting.clone();
                self.connected.push(Client { stream, backlog, state: S::default() });
            }
        }
    }

    /// Accepts new clients and passes the bytes of each to `handle`; a client that left or caused an error is removed.
    pub(super) fn receive(&mut self, mut handle: impl FnMut(&mut S, &[u8]) -> io::Result<()>) {
        self.accept();
        self.connected.retain_mut(|client| client.receive(&mut handle).is_ok());
    }

    /// Receives as `receive`, and sends the bytes that the sockets did not take before.
    pub(super) fn listen(&mut self, handle: impl FnMut(&mut S, &[u8]) -> io::Result<()>) {
        self.receive(handle);
        self.send(|_, _| ());
    }

    /// Sends what `send` appends for each client; disconnected clients are removed.
    pub(super) fn send(&mut self, mut send: impl FnMut(&mut S, &mut Vec<u8>)) {
        self.connected.retain_mut(|client| {
            send(&mut client.state, &mut client.backlog);
            client.send().is_ok()
        });
    }
}

impl<S> Client<S> {
    fn receive(&mut self, handle: impl FnOnce(&mut S, &[u8]) -> io::Result<()>) -> io::Result<()> {
        let mut chunk = [0; CHUNK_BYTES];
        match self.stream.read(&mut chunk) {
            Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
            Ok(count) => handle(&mut self.state, chunk.get(..count).unwrap_or_default()),
            Err(error) if is_passing(&error) => Ok(()),
            Err(error) => Err(error),
        }
    }

    /// Sends the backlog, as much as the socket takes.
    fn send(&mut self) -> io::Result<()> {
        while !self.backlog.is_empty() {
            match self.stream.write(&self.backlog) {
                Ok(sent) => drop(self.backlog.drain(..sent)),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if is_passing(&error) => break,
                Err(error) => return Err(error),
            }
        }
        if self.backlog.len() > BACKLOG_MAX_BYTES {
            return Err(ErrorKind::TimedOut.into());
        }
        Ok(())
    }
}

/// Whether the socket may do later what it could not do now.
fn is_passing(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;

    fn push(clients: &mut Clients<()>, line: &[u8]) {
        clients.accept();
        clients.send(|(), to| to.extend_from_slice(line));
    }

    #[test]
    fn a_client_that_does_not_read_is_dropped_and_delays_no_other() {
        let mut relay = Clients::bind((Ipv4Addr::LOCALHOST, 0).into(), Vec::new()).unwrap();
        let address = relay.address().unwrap();
        let _stuck = TcpStream::connect(address).unwrap();
        let mut reader = TcpStream::connect(address).unwrap();
        let line = [b'x'; 4096];
        let mut taken = [0; 4096];
        push(&mut relay, &line);
        assert_eq!(relay.connected.len(), 2);
        // 80 MB are beyond what the system buffers for one connection.
        for k in 0..20_000 {
            reader.read_exact(&mut taken).unwrap();
            push(&mut relay, &line);
            if relay.connected.len() == 1 {
                assert!(k > 10, "dropped after {k} lines");
                return;
            }
        }
        panic!("a stuck client was kept");
    }

    #[test]
    fn clients_over_the_limit_are_turned_away() {
        let mut relay = Clients::bind((Ipv4Addr::LOCALHOST, 0).into(), Vec::new()).unwrap();
        let address = relay.address().unwrap();
        let clients: Vec<_> =
            (0..CLIENTS_MAX + 3).map(|_| TcpStream::connect(address).unwrap()).collect();
        push(&mut relay, b"line\n");
        assert_eq!(relay.connected.len(), CLIENTS_MAX);
        drop(clients);
    }
}
