//! Transport of a mocap source: a connection, a local port, or the ports of a NatNet server.

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, SocketAddrV4};

use socket2::{Domain, Protocol, Socket, Type};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpStream, UdpSocket, lookup_host};

use super::MocapSettings;
use super::natnet::packet::datagram_length;
use super::settings::Transport;

/// More than the largest datagram.
pub(super) const CHUNK_BYTES: usize = 1 << 16;

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

impl Wire {
    pub(super) async fn open(settings: &MocapSettings) -> io::Result<Self> {
        match &settings.transport {
            Transport::Tcp(address) => {
                let socket = TcpStream::connect(address.as_str()).await?;
                socket.set_nodelay(true)?;
                Ok(Self::Tcp(socket))
            }
            Transport::Udp(address) => Ok(Self::Udp(UdpSocket::bind(address).await?)),
            Transport::Natnet(address) => Ok(Self::Natnet(NatnetWire::open(address).await?)),
        }
    }

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
    async fn open(address: &str) -> io::Result<Self> {
        let mut found = lookup_host(address).await?;
        let server = found.find(SocketAddr::is_ipv4);
        let no_ipv4 = || {
            let text = format!("{address} has no IPv4 address, and NatNet is read over IPv4 only");
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
        let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
        // Other programs on this machine may listen, too.
        socket.set_reuse_address(true)?;
        socket.set_nonblocking(true)?;
        socket.bind(&SocketAddr::V4(group).into())?;
        socket.join_multicast_v4(group.ip(), &self.interface()?)?;
        self.data = Some((group, UdpSocket::from_std(socket.into())?));
        Ok(())
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

#[cfg(test)]
mod tests {
    use super::*;

    fn block_on<T>(task: impl Future<Output = T>) -> T {
        tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(task)
    }

    #[test]
    fn a_socket_that_was_ready_for_nothing_has_no_bytes_and_other_errors_stay() {
        let (count, from) = would_block(io::ErrorKind::WouldBlock.into()).unwrap();
        assert_eq!((count, from.ip()), (0, IpAddr::V4(Ipv4Addr::UNSPECIFIED)));
        let refused = would_block(io::ErrorKind::ConnectionReset.into()).unwrap_err();
        assert_eq!(refused.kind(), io::ErrorKind::ConnectionReset);
    }

    #[test]
    fn the_end_of_a_connection_is_an_error_and_no_piece_of_no_bytes() {
        let listener = std::net::TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let address = listener.local_addr().unwrap();
        let error = block_on(async {
            let mut wire = Wire::Tcp(TcpStream::connect(address).await.unwrap());
            drop(listener.accept().unwrap());
            wire.read(&mut [0; 8]).await.unwrap_err()
        });
        assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof);
    }

    #[test]
    fn natnet_over_ipv6_is_refused_by_name() {
        let error = block_on(NatnetWire::open("[::1]:1510")).unwrap_err();
        assert!(error.to_string().contains("IPv4 only"), "{error}");
    }

    #[test]
    fn datagrams_of_another_system_are_left_out() {
        let server = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
        let other = std::net::UdpSocket::bind("127.0.0.2:0").unwrap();
        let address = server.local_addr().unwrap().to_string();
        block_on(async {
            let mut wire = NatnetWire::open(&address).await.unwrap();
            let to = (Ipv4Addr::LOCALHOST, wire.command.local_addr().unwrap().port());
            other.send_to(b"other", to).unwrap();
            server.send_to(b"ours", to).unwrap();
            let mut chunk = [0; 16];
            let count = wire.read(&mut chunk).await.unwrap();
            assert_eq!(&chunk[..count], b"ours");
        });
    }
}
