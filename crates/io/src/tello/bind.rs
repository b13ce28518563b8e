//! The UDP sockets of the drone, and why there may be none.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};

use socket2::{Domain, Protocol, Socket, Type};
use thiserror::Error;

use super::TelloSettings;

/// Why there is no socket to talk to the drone.
#[derive(Debug, Error)]
pub enum LinkError {
    /// Another program has the port.
    #[error("UDP port {port} is in use: stop the other program, or set tello.{key} to 0")]
    PortInUse {
        /// The local port.
        port: u16,
        /// Its setting.
        key: &'static str,
    },
    /// There is no interface of this name.
    #[error("network interface `{name}` does not exist: `ip link` lists those that do")]
    NoInterface {
        /// Name as configured.
        name: String,
    },
    /// Any other refusal of the operating system.
    #[error("cannot {doing}: {source}")]
    Socket {
        /// What was attempted.
        doing: &'static str,
        /// The system's answer.
        source: io::Error,
    },
}

pub(super) fn failed(doing: &'static str) -> impl Fn(io::Error) -> LinkError {
    move |source| LinkError::Socket { doing, source }
}

/// A socket on `port`, which is the setting `key`, of the configured interface.
pub(super) fn bind_socket(
    settings: &TelloSettings,
    key: &'static str,
    port: u16,
) -> Result<UdpSocket, LinkError> {
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))
        .map_err(failed("open a UDP socket"))?;
    if let Some(name) = &settings.interface {
        socket.bind_device(Some(name.as_bytes())).map_err(|source| {
            if source.raw_os_error() == Some(nix::errno::Errno::ENODEV as i32) {
                LinkError::NoInterface { name: name.clone() }
            } else {
                LinkError::Socket { doing: "bind to the network interface", source }
            }
        })?;
    }
    let local = SocketAddr::from((Ipv4Addr::UNSPECIFIED, port));
    socket.bind(&local.into()).map_err(|source| match source.kind() {
        io::ErrorKind::AddrInUse => LinkError::PortInUse { port, key },
        _ => LinkError::Socket { doing: "bind the UDP port", source },
    })?;
    socket.set_nonblocking(true).map_err(failed("make the UDP socket non-blocking"))?;
    Ok(socket.into())
}
