//! Transport of a mocap source: a connection, a local port, or the ports of a NatNet server.

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, SocketAddrV4};
use std::time::Duration;

use socket2::{Domain, Protocol, Socket, Type};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpStream, UdpSocket, lookup_host};
use tokio::task::JoinHandle;
use tokio::time::timeout;

use super::MocapSettings;
use super::natnet::packet::datagram_length;
use super::settings::Transport;

/// More than the largest datagram.
pub(super) const CHUNK_BYTES: usize = 1 << 16;

/// A kernel gives up a connect after two minutes; a flight cannot wait for that. For each address of a host.
pub(super) const CONNECT_TIMEOUT: Duration = Duration::from_secs(2);

/// Wait for the addresses of a host's name, while there are none so far.
const NAME_TIMEOUT: Duration = Duration::from_secs(2);
/// The same, while there are those of an earlier time: in flight a connection is made anew without a name server.
const NAME_AGAIN_TIMEOUT: Duration = Duration::from_millis(100);

const NO_ANSWER: &str = "no answer, as from a host that is off or behind a firewall";

/// Opens the socket of a source again and again. Keeps the addresses of its host, and a look-up that is late.
#[derive(Debug)]
pub(super) struct Connector {
    transport: Transport,
    /// The one to try first is the first: of a connection the one that answered last.
    addresses: Vec<SocketAddr>,
    lookup: Option<JoinHandle<io::Result<Vec<SocketAddr>>>>,
}

/// Socket of a source.
#[derive(Debug)]
pub(super) enum Wire {
    Tcp(TcpStream),
    Udp(UdpSocket),
    Natnet(NatnetWire),
}

/// Questions and answers by one socket, frames by the same or by a multicast group.
#[derive(Debug)]
pub(super) struct NatnetWire {
    server: SocketAddr,
    command: UdpSocket,
    /// With the group that it joined.
    data: Option<(SocketAddrV4, UdpSocket)>,
}

impl Connector {
    pub(super) fn new(settings: &MocapSettings) -> Self {
        Self { transport: settings.transport.clone(), addresses: Vec::new(), lookup: None }
    }

    /// The source's socket, within [`NAME_TIMEOUT`] and [`CONNECT_TIMEOUT`] for each address of its host.
    ///
    /// # Errors
    /// The host's name has no address so far, or none of them answers; a port that is taken.
    pub(super) async fn open(&mut self) -> io::Result<Wire> {
        match self.transport.clone() {
            Transport::Tcp(host) => {
                self.look_up(host).await?;
                self.connect().await
            }
            Transport::Udp(address) => {
                Ok(Wire::Udp(UdpSocket::bind(address).await.map_err(explain_foreign)?))
            }
            Transport::Natnet(host) => {
                self.look_up(host.clone()).await?;
                Ok(Wire::Natnet(NatnetWire::open(&host, &self.addresses).await?))
            }
        }
    }

    /// Renews the addresses. If there are some, neither a name server that is slow nor one that fails matters.
    async fn look_up(&mut self, host: String) -> io::Result<()> {
        let is_first = self.addresses.is_empty();
        let lookup = self.lookup.get_or_insert_with(|| {
            tokio::spawn(async { lookup_host(host).await.map(Iterator::collect) })
        });
        let wait_max = if is_first { NAME_TIMEOUT } else { NAME_AGAIN_TIMEOUT };
        let Ok(found) = timeout(wait_max, lookup).await else {
            return if is_first { Err(late("its name is not resolved so far")) } else { Ok(()) };
        };
        self.lookup = None;
        match found.unwrap_or_else(|panicked| Err(panicked.into())) {
            Ok(mut addresses) => {
                let place =
                    |address: &SocketAddr| self.addresses.iter().position(|it| it == address);
                addresses.sort_by_key(|address| place(address).unwrap_or(usize::MAX));
                self.addresses = addresses;
                Ok(())
            }
            Err(error) if is_first => Err(error),
            Err(_) => Ok(()),
        }
    }

    /// After a connection without a message: NatNet is tried at the next IPv4 address of its server. A socket of
    /// datagrams does not show that an address is out of reach; a TCP connection does.
    pub(super) fn note_silence(&mut self) {
        let tried = self.addresses.iter().position(SocketAddr::is_ipv4);
        if let (Transport::Natnet(_), Some(tried)) = (&self.transport, tried) {
            let address = self.addresses.remove(tried);
            self.addresses.push(address);
        }
    }

    /// Connects to the first address that answers.
    async fn connect(&mut self) -> io::Result<Wire> {
        let mut failed = io::ErrorKind::AddrNotAvailable.into();
        for (index, address) in self.addresses.iter().enumerate() {
            let connected = timeout(CONNECT_TIMEOUT, TcpStream::connect(address)).await;
            match connected.unwrap_or_else(|_| Err(late(NO_ANSWER))) {
                Ok(socket) => {
                    self.addresses.swap(0, index);
                    socket.set_nodelay(true)?;
                    return Ok(Wire::Tcp(socket));
                }
                Err(error) => failed = error,
            }
        }
        Err(failed)
    }
}

fn late(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::TimedOut, what)
}

impl Wire {
    /// The next piece or datagram. Safe to cancel.
    pub(super) async fn read(&mut self, chunk: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(socket) => match socket.read(chunk).await? {
                0 => Err(io::ErrorKind::UnexpectedEof.into()),
                count => Ok(count),
            },
            Self::Udp(socket) => socket.recv(chunk).await,
            Self::Natnet(wire) => wire.read(chunk).await,
        }
    }

    /// Sends `bytes`, if there are any. The object stream only receives: for it this does nothing.
    pub(super) async fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Tcp(socket) => socket.write_all(bytes).await,
            Self::Udp(_) => Ok(()),
            Self::Natnet(wire) => wire.write(bytes).await,
        }
    }

    /// Joins the group that frames come by, if there is one and it is another than before.
    pub(super) fn join(&mut self, group: Option<SocketAddrV4>) -> io::Result<()> {
        match (self, group) {
            (Self::Natnet(wire), Some(group)) => wire.join(group),
            _ => Ok(()),
        }
    }
}

impl NatnetWire {
    /// Of the server `host` with these `addresses`.
    async fn open(host: &str, addresses: &[SocketAddr]) -> io::Result<Self> {
        let server = addresses.iter().copied().find(SocketAddr::is_ipv4);
        let no_ipv4 = || {
            let text = format!("{host} has no IPv4 address, and NatNet is read over IPv4 only");
            io::Error::new(io::ErrorKind::AddrNotAvailable, text)
        };
        let server = server.ok_or_else(no_ipv4)?;
        let command = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).await?;
        Ok(Self { server, command, data: None })
    }

    /// The next datagram of the server, whichever of its ports sent it.
    async fn read(&mut self, chunk: &mut [u8]) -> io::Result<usize> {
        loop {
            let (count, from) = match &self.data {
                None => self.command.recv_from(chunk).await?,
                Some((_, data)) => {
                    // Whichever is there first; the other one stays in its socket.
                    tokio::select! {
                        ready = data.readable() => { ready?; receive(data, chunk) }
                        ready = self.command.readable() => { ready?; receive(&self.command, chunk) }
                    }
                    .or_else(would_block)?
                }
            };
            // Other systems may send to the same group.
            if count > 0 && from.ip() == self.server.ip() {
                return Ok(count);
            }
        }
    }

    /// Sends each datagram in `bytes`.
    async fn write(&mut self, mut bytes: &[u8]) -> io::Result<()> {
        while let Some(length) = datagram_length(bytes) {
            let (datagram, rest) = bytes.split_at_checked(length).unwrap_or((bytes, &[]));
            self.command.send_to(datagram, self.server).await?;
            bytes = rest;
        }
        Ok(())
    }

    fn join(&mut self, group: SocketAddrV4) -> io::Result<()> {
        if self.data.as_ref().is_some_and(|(joined, _)| *joined == group) {
            return Ok(());
        }
        let socket = self.joined(group).map_err(|error| {
            let text = format!("the multicast group {} cannot be joined: {error}", group.ip());
            io::Error::new(error.kind(), text)
        })?;
        self.data = Some((group, socket));
        Ok(())
    }

    fn joined(&self, group: SocketAddrV4) -> io::Result<UdpSocket> {
        let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
        // Other programs on this machine may listen, too.
        socket.set_reuse_address(true)?;
        socket.set_nonblocking(true)?;
        socket.bind(&SocketAddr::V4(group).into())?;
        socket.join_multicast_v4(group.ip(), &self.interface()?)?;
        UdpSocket::from_std(socket.into())
    }

    /// Our address on the way to the server.
    fn interface(&self) -> io::Result<Ipv4Addr> {
        let probe = std::net::UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        probe.connect(self.server)?;
        match probe.local_addr()?.ip() {
            IpAddr::V4(address) => Ok(address),
            IpAddr::V6(_) => Err(io::ErrorKind::AddrNotAvailable.into()),
        }
    }
}

fn receive(socket: &UdpSocket, chunk: &mut [u8]) -> io::Result<(usize, SocketAddr)> {
    socket.try_recv_from(chunk)
}

/// No bytes, from no address, for a socket that was ready without a datagram; every other error stays.
fn would_block(error: io::Error) -> io::Result<(usize, SocketAddr)> {
    match error.kind() {
        io::ErrorKind::WouldBlock => Ok((0, (Ipv4Addr::UNSPECIFIED, 0).into())),
        _ => Err(error),
    }
}

/// `error`, with the way out if the address to listen at belongs to another machine.
fn explain_foreign(error: io::Error) -> io::Error {
    if error.kind() != io::ErrorKind::AddrNotAvailable {
        return error;
    }
    let text =
        "it is no address of this machine, at which the stream is received; 0.0.0.0 is any of them";
    io::Error::new(error.kind(), text)
}

#[cfg(test)]
mod tests;
