//! The motion capture relay on TCP: pushes lines to whoever connects.
//!
//! Owns the connections. No client can hold up another or the world: nothing here waits, and a client
//! that does not read is dropped.

use std::io::{self, ErrorKind, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};

/// Unsent bytes at which a client counts as stuck: more than ten seconds of lines.
const BACKLOG_MAX_BYTES: usize = 64 * 1024;
/// Clients that connect beyond this are turned away.
const CLIENTS_MAX: usize = 16;

/// The listening socket and its clients.
#[derive(Debug)]
pub(super) struct RelayPort {
    listener: TcpListener,
    clients: Vec<Client>,
}

#[derive(Debug)]
struct Client {
    stream: TcpStream,
    /// What the socket did not take yet.
    backlog: Vec<u8>,
}

impl RelayPort {
    /// Listens on `address`.
    pub(super) fn bind(address: SocketAddr) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        Ok(Self { listener, clients: Vec::new() })
    }

    /// Where clients connect to.
    pub(super) fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Takes in who knocks, sends `line` to all, forgets who left.
    pub(super) fn push(&mut self, line: &[u8]) {
        while let Ok((stream, _)) = self.listener.accept() {
            // A client whose socket cannot be set up is turned away, like one too many.
            let is_ready = stream.set_nonblocking(true).and(stream.set_nodelay(true)).is_ok();
            if is_ready && self.clients.len() < CLIENTS_MAX {
                self.clients.push(Client { stream, backlog: Vec::new() });
            }
        }
        self.clients.retain_mut(|client| client.push(line).is_ok());
    }
}

impl Client {
    /// Sends the backlog and `line`, as much as the socket takes.
    fn push(&mut self, line: &[u8]) -> io::Result<()> {
        self.backlog.extend_from_slice(line);
        while !self.backlog.is_empty() {
            match self.stream.write(&self.backlog) {
                Ok(sent) => drop(self.backlog.drain(..sent)),
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        if self.backlog.len() > BACKLOG_MAX_BYTES {
            return Err(ErrorKind::TimedOut.into());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read;
    use std::net::Ipv4Addr;

    use super::*;

    #[test]
    fn a_client_that_does_not_read_is_dropped_and_holds_up_nobody() {
        let mut relay = RelayPort::bind((Ipv4Addr::LOCALHOST, 0).into()).unwrap();
        let address = relay.address().unwrap();
        let _stuck = TcpStream::connect(address).unwrap();
        let mut reader = TcpStream::connect(address).unwrap();
        let line = [b'x'; 4096];
        let mut taken = [0; 4096];
        relay.push(&line);
        assert_eq!(relay.clients.len(), 2);
        // 80 MB are beyond what the system buffers for one connection.
        for k in 0..20_000 {
            reader.read_exact(&mut taken).unwrap();
            relay.push(&line);
            if relay.clients.len() == 1 {
                assert!(k > 10, "dropped after {k} lines");
                return;
            }
        }
        panic!("a stuck client was kept");
    }

    #[test]
    fn clients_beyond_the_limit_are_turned_away() {
        let mut relay = RelayPort::bind((Ipv4Addr::LOCALHOST, 0).into()).unwrap();
        let address = relay.address().unwrap();
        let clients: Vec<_> =
            (0..CLIENTS_MAX + 3).map(|_| TcpStream::connect(address).unwrap()).collect();
        relay.push(b"line\n");
        assert_eq!(relay.clients.len(), CLIENTS_MAX);
        drop(clients);
    }
}
