//! The guardian: a second process of this program, which lands the drone when the first one cannot.
//!
//! Owns how the process is started and ended, and what it is apart from its parent: no terminal, no signals,
//! little memory, a priority above all threads of the flight. When it lands what is `tello_io`'s.

use std::ffi::CString;
use std::fs;
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt, parent_id};
use std::process::{Child, Command, id};
use std::thread;
use std::time::Duration;

use anyhow::Result;
use clap::Args;
use nix::sys::prctl::set_name;
use nix::sys::signal::SigSet;
use nix::unistd::setsid;
use tello_io::clock::{Role, request_priority};
use tello_io::tello::{GuardianSockets, Protocol, WatchEnd};

use crate::{Verdict, stdio};

/// This program, whatever became of its file since it was started.
const OURSELVES: &str = "/proc/self/exe";

/// Another name than the flight's: a kill of all programs of that name does not reach the guardian.
const NAME: &str = "tello-guardian";

/// First processes of containers that end with their only child, as `docker run --init` starts one.
const INITS_OF_ONE: [&str; 6] =
    ["docker-init", "podman-init", "catatonit", "tini", "tini-static", "dumb-init"];

const ENDS_WITH_PARENT: &str = "this container ends with this program, and so would the guardian, which lands the \
    drone if this program is killed: start a container that goes on (`docker run -d .. sleep infinity`), and this \
    program in it (`docker exec -it .. tello-ctl ..`)";

/// Looks, and time between two of them, for the end of a guardian that received the end of the flight.
const END_LOOKS: u32 = 100;
const END_LOOK_PERIOD: Duration = Duration::from_millis(10);

/// Watches the process whose drone socket is the standard input and whose channel is the standard output:
/// started by `fly` and `bench`.
#[derive(Debug, Args)]
#[command(hide = true)]
pub(crate) struct Arguments {
    /// The drone.
    drone: SocketAddr,
    /// How to talk to it.
    protocol: Protocol,
}

/// The process of the guardian, as its parent has it. Whatever ends the parent, the guardian ends by itself:
/// at once if the sender reported so or no drone depended on it, else after its landings.
#[derive(Debug)]
pub(crate) struct Guardian {
    process: Child,
}

impl Guardian {
    /// Tries whether a guardian would outlive this program, if it flies the real drone at `address`.
    ///
    /// # Errors
    /// It would not.
    pub(crate) fn probe(address: SocketAddr) -> io::Result<()> {
        let first = fs::read_to_string("/proc/1/comm").unwrap_or_default();
        if !address.ip().is_loopback() && ends_with_parent(id(), parent_id(), first.trim()) {
            return Err(io::Error::other(ENDS_WITH_PARENT));
        }
        Ok(())
    }

    /// Starts the process.
    ///
    /// # Errors
    /// The system refuses, or [`Self::probe`].
    pub(crate) fn spawn(post: GuardianSockets) -> io::Result<Self> {
        let GuardianSockets { socket, channel, address, protocol } = post;
        Self::probe(address)?;
        let mut command = command(address, protocol);
        // The standard error stays ours, for the one line that an abandoned guardian prints.
        let process =
            command.stdin(OwnedFd::from(socket)).stdout(OwnedFd::from(channel)).spawn()?;
        Ok(Self { process })
    }

    /// Waits for the end of a guardian whose sender reported the end of the flight, and ends one that does not.
    pub(crate) fn end(mut self) {
        for _ in 0..END_LOOKS {
            if !matches!(self.process.try_wait(), Ok(None)) {
                return;
            }
            thread::sleep(END_LOOK_PERIOD);
        }
        // It was stopped, or waits for something: nothing is left for it to do.
        self.process.kill().and_then(|()| self.process.wait()).ok();
    }
}

/// Whether the end of process `id` ends all others of its container: it is the first one there, or the `first` one is
/// its parent and ends with it.
fn ends_with_parent(id: u32, parent: u32, first: &str) -> bool {
    id == 1 || (parent == 1 && INITS_OF_ONE.contains(&first))
}

/// This program as the guardian of the drone at `address`.
fn command(address: SocketAddr, protocol: Protocol) -> Command {
    let mut command = Command::new(OURSELVES);
    command.arg0(NAME).args(["guardian", &address.to_string(), &protocol.to_string()]);
    command
}

/// The process of the guardian.
pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    detach();
    let socket = UdpSocket::from(io::stdin().as_fd().try_clone_to_owned()?);
    let channel = UnixStream::from(io::stdout().as_fd().try_clone_to_owned()?);
    let Arguments { drone: address, protocol } = *arguments;
    let mut guardian =
        tello_io::tello::Guardian::start(GuardianSockets { socket, channel, address, protocol })?;
    match guardian.watch() {
        WatchEnd::Over => {}
        WatchEnd::OrderedLanding => stdio::note(format_args!(
            "tello-ctl: the flight stopped responding and then ended; its guardian has ordered the drone at \
             {address} to land. Check that it is down."
        )),
        WatchEnd::Abandoned => {
            stdio::note(format_args!(
                "tello-ctl: the flight ended unexpectedly; for 15 s its guardian orders the drone at {address} to land"
            ));
            guardian.land_alone();
        }
    }
    Ok(Verdict::Good)
}

/// Lets nothing that ends or holds up the parent reach this process. What the system refuses is done without:
/// the parent warns of real time, and a guardian without any of it still lands.
fn detach() {
    // A reader of the standard error that does not read must not keep an orphan alive.
    stdio::never_wait();
    if let Ok(name) = CString::new(NAME) {
        set_name(&name).ok();
    }
    // Of the terminal: neither its keys nor its end send signals here.
    setsid().ok();
    // All but SIGKILL and SIGSTOP: they stay pending until the end.
    SigSet::all().thread_set_mask().ok();
    // The last process to be killed when memory runs out, where that is permitted.
    fs::write("/proc/self/oom_score_adj", "-1000").ok();
    drop(request_priority(Role::Guardian));
}

#[cfg(test)]
mod tests;
