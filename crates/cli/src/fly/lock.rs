//! One flight, or check of the bench, at a time for one drone.
//!
//! Owns the lock: the name of a socket that no file stands for. The kernel gives a name to one process and frees
//! it when the last one that has it ends, killed or not. The guardian inherits it, so that no other flight takes
//! off beside a guardian that lands.

use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener, UnixStream};

use anyhow::{Context, Result, bail};
use nix::fcntl::{FcntlArg, FdFlag, fcntl};
use tello_io::tello::TelloTable;

/// The right to fly a drone, until it is dropped. It holds for all users of this machine, within one
/// network namespace.
#[derive(Debug)]
pub(crate) struct Lock {
    _name: UnixListener,
}

impl Lock {
    /// Takes the drone of `table`.
    ///
    /// # Errors
    /// Another process has it; the system refuses.
    pub(crate) fn take(table: &TelloTable) -> Result<Self> {
        let TelloTable { address, interface, .. } = table;
        // Every Tello has the same address: the interface distinguishes two of them.
        let name = format!("tello-ctl/{address}/{}", interface.as_deref().unwrap_or_default());
        let name = SocketAddr::from_abstract_name(name)?;
        let listener = match UnixListener::bind_addr(&name) {
            Ok(listener) => listener,
            Err(error) if error.kind() == io::ErrorKind::AddrInUse => {
                let process = owner(&name).map_or_else(
                    || "another process".to_owned(),
                    |process| format!("process {process}, or the guardian that lands after it,"),
                );
                bail!("{process} has the drone at {address}: wait until it has ended");
            }
            Err(error) => return Err(error).context("cannot lock the drone"),
        };
        fcntl(&listener, FcntlArg::F_SETFD(FdFlag::empty())).context("cannot lock the drone")?;
        Ok(Self { _name: listener })
    }
}

/// The process that took the lock.
fn owner(name: &SocketAddr) -> Option<i32> {
    let stream = UnixStream::connect_addr(name).ok()?;
    stream.set_nonblocking(true).ok()?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build().ok()?;
    let _entered = runtime.enter();
    tokio::net::UnixStream::from_std(stream).ok()?.peer_cred().ok()?.pid()
}

#[cfg(test)]
mod tests {
    use tello_io::tello::Protocol;

    use super::*;

    fn table(address: &str, interface: Option<&str>) -> TelloTable {
        TelloTable {
            protocol: Protocol::Binary,
            address: address.to_owned(),
            local_port: 0,
            state_port: 0,
            altitude_limit_m: None,
            interface: interface.map(str::to_owned),
        }
    }

    #[test]
    fn a_drone_is_flown_once_and_free_afterwards() {
        let (one, other) = (table("127.0.0.1:1", None), table("127.0.0.1:2", None));
        let lock = Lock::take(&one).unwrap();
        let error = Lock::take(&one).unwrap_err().to_string();
        assert!(error.contains("127.0.0.1:1"), "{error}");
        assert!(error.contains(&format!("process {},", std::process::id())), "{error}");
        Lock::take(&other).unwrap();
        Lock::take(&table("127.0.0.1:1", Some("wlan1"))).unwrap();
        drop(lock);
        Lock::take(&one).unwrap();
    }
}
