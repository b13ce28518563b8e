//! One flight, or check of the bench, at a time for one drone, and one flight for one object of the motion capture.
//!
//! Owns the lock: the name of a socket that no file stands for. The kernel gives a name to one process and frees
//! it when the last one that has it ends, killed or not. The guardian inherits it, so that no other flight takes
//! off beside a guardian that lands.

use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener, UnixStream};

use anyhow::{Context, Result, bail};
use nix::fcntl::{FcntlArg, FdFlag, fcntl};
use tello_io::mocap::MocapTable;
use tello_io::tello::TelloTable;

/// Longest name that the kernel takes; of a longer one this is the part that counts. bytes
const NAME_BYTES: usize = 107;

/// The right to fly a drone, or by an object, until it is dropped. It holds for all users of this machine, within one
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
    pub(crate) fn drone(table: &TelloTable) -> Result<Self> {
        let TelloTable { address, interface, .. } = table;
        // Every Tello has the same address: the interface distinguishes two of them.
        let name = format!("tello-ctl/{address}/{}", interface.as_deref().unwrap_or_default());
        Self::take(&name, &format!("the drone at {address}"))
    }

    /// Takes the object of `table`: two drones that fly by the poses of one object fly blind, one of them at least.
    ///
    /// # Errors
    /// As [`Self::drone`].
    pub(super) fn object(table: &MocapTable) -> Result<Self> {
        let ((_, address), object) = (table.address(), table.object());
        let what = format!("the object {object:?} of the motion capture at {address}");
        Self::take(&format!("tello-ctl/object/{address}/{object}"), &what)
    }

    /// Takes `name`, which stands for `what`.
    fn take(name: &str, what: &str) -> Result<Self> {
        let name = SocketAddr::from_abstract_name(&name.as_bytes()[..name.len().min(NAME_BYTES)])?;
        let listener = match UnixListener::bind_addr(&name) {
            Ok(listener) => listener,
            Err(error) if error.kind() == io::ErrorKind::AddrInUse => {
                let process = owner(&name).map_or_else(
                    || "another process".to_owned(),
                    |process| format!("process {process}, or the guardian that lands after it,"),
                );
                bail!("{process} has {what}: wait until it has ended");
            }
            Err(error) => return Err(error).with_context(|| format!("cannot lock {what}")),
        };
        fcntl(&listener, FcntlArg::F_SETFD(FdFlag::empty()))
            .with_context(|| format!("cannot lock {what}"))?;
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
    use tello_io::mocap::ServerTable;
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
        let lock = Lock::drone(&one).unwrap();
        let error = Lock::drone(&one).unwrap_err().to_string();
        assert!(error.contains("127.0.0.1:1"), "{error}");
        assert!(error.contains(&format!("process {},", std::process::id())), "{error}");
        Lock::drone(&other).unwrap();
        Lock::drone(&table("127.0.0.1:1", Some("wlan1"))).unwrap();
        drop(lock);
        Lock::drone(&one).unwrap();
    }

    #[test]
    fn one_drone_flies_by_an_object_and_a_name_of_any_length_can_be_taken() {
        let table = |address: &str, object: &str| {
            MocapTable::Relay(ServerTable { address: address.into(), object: object.into() })
        };
        let long = "x".repeat(200);
        for object in ["lock", &long] {
            let _lock = Lock::object(&table("127.0.0.1:3", object)).unwrap();
            let error = Lock::object(&table("127.0.0.1:3", object)).unwrap_err().to_string();
            assert!(error.contains(&format!("the object {object:?} of the motion")), "{error}");
            Lock::object(&table("127.0.0.1:4", object)).unwrap();
            Lock::object(&table("127.0.0.1:3", "other")).unwrap();
        }
    }
}
