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
    #[error(
        "UDP port {port} is in use: stop the other program, or set tello.{key} to 0{}",
        if *key == "state_port" { ", which needs a drone with SDK 3.0" } else { "" }
    )]
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
        /// Attempted action.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tello;

    fn settings(interface: Option<&str>) -> TelloSettings {
        TelloSettings {
            protocol: tello::Protocol::Binary,
            address: SocketAddr::from((Ipv4Addr::LOCALHOST, 8889)),
            local_port: 0,
            state_port: 0,
            altitude_limit_m: None,
            interface: interface.map(str::to_owned),
        }
    }

    #[test]
    fn a_port_that_is_in_use_is_named_with_its_setting() {
        let first = bind_socket(&settings(None), "local_port", 0).unwrap();
        let port = first.local_addr().unwrap().port();
        let refused = bind_socket(&settings(None), "state_port", port).unwrap_err().to_string();
        let expected = format!(
            "UDP port {port} is in use: stop the other program, or set tello.state_port to 0, which needs a drone \
             with SDK 3.0"
        );
        assert_eq!(refused, expected);
    }

    #[test]
    fn a_socket_does_not_wait_for_a_datagram() {
        let socket = bind_socket(&settings(None), "local_port", 0).unwrap();
        let error = socket.recv(&mut [0; 8]).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::WouldBlock);
    }

    #[test]
    fn an_interface_that_does_not_exist_is_named() {
        let refused = bind_socket(&settings(Some("none-such0")), "local_port", 0).unwrap_err();
        assert!(matches!(&refused, LinkError::NoInterface { name } if name == "none-such0"));
    }
}
