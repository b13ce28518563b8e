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
